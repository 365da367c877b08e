"""T3: twelve "holes" from real hits; whether scatter of the firing times is named.

Every waveform is real, only the sum is made here: two unused hits at each of six places, 42 or
17 ms apart; the tool knows the first hit of each place and the plan. Drawn and hidden: times, or
scales, or one t*, or a delay and gain of each receiver. Controls: the plan kept, by other hits
(whose triggers really differ) and by the very hits that the tool knows, with drawn noise.
Argument: the folder.
"""

import numpy as np
from blast_cause import blast_cause
from keeper import Sealed, folder_of_recordings, keep
from line_analysis import scale_and_shift
from real_line import hits_by_place, seismograms

BAND, DT, JITTER = (10.0, 80.0), 1e-3, 1.5e-3
LENGTH, EVERY = 1500, 3  # samples; of them the tool sees every third


def known_hits(folder):
    """Return hits by place, each (24, n_samples) from 0.1 s before the trigger, in the band."""
    return [[[s.bandpassed(*BAND) for s in seismograms(g)] for g in hits]
            for hits in hits_by_place(folder / "wghs").values()]  # fmt: skip


def samples(hit):
    """Return the samples of a hit, (24, n_samples)."""
    return np.array([s.velocity[:, 2] for s in hit])


def summed(hits, times, scales):
    """Sum hits at times, (24, LENGTH)."""
    frequency = np.fft.rfftfreq(2 * LENGTH, DT)
    total = 0.0
    for hit, time, scale in zip(hits, times, scales, strict=True):
        turns = np.exp(-2j * np.pi * frequency * time)
        total = total + scale * np.fft.rfft(hit, 2 * LENGTH) * turns
    return np.fft.irfft(total)[:, :LENGTH]


def made(kind, hits, nominal, sigma, rng):
    """Make the record of a blast with one effect; return it with times and scales."""
    times, scales = nominal.copy(), np.ones(12)
    if kind == "delay_scatter":
        times = times + rng.normal(0.0, sigma, 12)
    if kind == "misfire_or_charge_error":
        scales = rng.lognormal(0.0, 0.4, 12)
        scales[rng.integers(12)] = 0.0
    record = summed(hits, times, scales)
    frequency = np.fft.rfftfreq(2 * LENGTH, DT)
    if kind == "attenuation_Q":
        spectrum = np.fft.rfft(record, 2 * LENGTH) * np.exp(-np.pi * frequency * 8e-3)
        record = np.fft.irfft(spectrum)[:, :LENGTH]
    if kind == "site":
        late, gain = rng.normal(0.0, 4e-3, 24), rng.lognormal(0.0, 0.3, 24)
        turns = np.exp(-2j * np.pi * frequency * late[:, None]) * gain[:, None]
        record = np.fft.irfft(np.fft.rfft(record, 2 * LENGTH) * turns)[:, :LENGTH]
    return record, times, scales


def one(name, kind, places, delay, sigma, rng, *, same=False):
    """Make, seal, ask, open, score."""
    nominal = delay * np.arange(12)
    chosen = [rng.permutation(np.arange(1, 5))[:2] for _ in places]
    known = [place[0] for place in places] * 2
    hits = known if same else [p[two[n]] for n in (0, 1) for p, two in zip(places, chosen,
                                                                          strict=True)]  # fmt: skip
    lags = np.zeros(12) if same else np.array(
        [scale_and_shift(s, h, range(24), BAND)[1] for s, h in zip(known, hits, strict=True)]
    )  # fmt: skip
    record, times, scales = made(kind, [samples(h) for h in hits], nominal, sigma, rng)
    if same:
        record = record + 0.1 * record.std() * smooth_noise(rng, record.shape)
    sealed = Sealed(name, {"label": kind, "times": (times + lags).tolist(),
                           "scales": scales.tolist()})  # fmt: skip
    said = blast_cause(np.array([samples(h)[:, ::EVERY] for h in known]), record[:, ::EVERY],
                       EVERY * DT, nominal,
                       sigma=np.hypot(sigma, JITTER))  # fmt: skip
    sealed.answered([said])
    truth = sealed.opened()
    scores = {"held_out": said.held_out}
    if said.label == "delay_scatter" and said.outcome == "NAMED":
        found = np.array([said.parameters[f"time_{n}"] for n in range(12)])
        error = np.abs(found[:, 0] - truth["times"])
        scores |= {
            "error_ms": (1e3 * np.percentile(error, [50, 90])).tolist(),
            "plan_error_ms": (1e3 * np.percentile(np.abs(nominal - truth["times"]),
                                                  [50, 90])).tolist(),
            "inside_90": float(np.mean((found[:, 1] <= truth["times"])
                                       & (truth["times"] <= found[:, 2]))),
        }  # fmt: skip
    right = said.outcome == "NULL" if kind is None else (
        said.outcome == "NAMED" and said.label == truth["label"]
    )  # fmt: skip
    return sealed.scored(right, **scores)


def smooth_noise(rng, shape):
    """Return noise of unit variance in the band."""
    frequency = np.fft.rfftfreq(shape[1], DT)
    inside = (frequency > BAND[0]) & (frequency < BAND[1])
    noise = np.fft.irfft(np.fft.rfft(rng.normal(size=shape)) * inside, shape[1])
    return noise / noise.std()


def main():
    """Run the test and keep its rows."""
    places, rng, rows = known_hits(folder_of_recordings()), np.random.default_rng(3), {}
    for k in range(2):
        for delay, sigma in ((0.042, 3e-3), (0.017, 2e-3)):
            name = f"{1e3 * delay:g} ms, {1e3 * sigma:g} ms, {k + 1}"
            rows[name] = one(name, "delay_scatter", places, delay, sigma, rng)
    for kind in ("misfire_or_charge_error", "attenuation_Q", "site"):
        for same in (True,) if kind != "misfire_or_charge_error" else (True, False):
            name = f"{kind}, {'the known hits' if same else 'other hits'}"
            rows[name] = one(name, kind, places, 0.042, 3e-3, rng, same=same)
    for k in range(2):
        rows[f"null: the known hits, {k + 1}"] = one("null", None, places, 0.042, 3e-3, rng,
                                                     same=True)  # fmt: skip
    rows["plan kept, other hits (triggers differ)"] = one(
        "plan kept, other hits", "delay_scatter", places, 0.042, 0.0, rng
    )
    keep("T3", rows)


if __name__ == "__main__":
    main()
