"""When did each hole fire? Real hits summed over a plan with scatter, and the times recovered.

Twelve "holes" are two real hits at each of six places; what the search knows is one other hit of
each place and the plan. Every waveform is real; the sum and its scatter are made here. A hit is
compared with the known one of its place by correlation, so the true time is the drawn one plus that
lag. Times are estimated from every other receiver; the unseen rest shows what they explain.
Argument: the folder.
"""

import sys
from functools import partial

import numpy as np
from firing_times import firing_times
from line_analysis import scale_and_shift, spread
from real_figures import draw_firing_times
from real_line import hits_by_place, keep_results, recordings_folder, seismograms

from pyblast import superpose
from pyblast.blasts.blast import Firing

BAND, N_DRAWS = (10.0, 80.0), 20
PLANS = {"42 ms, 3 ms": (0.042, 0.003), "17 ms, 2 ms": (0.017, 0.002), "42 ms, none": (0.042, 0.0)}
JITTER, SCALES = 0.0015, 0.25  # of the trigger and the hammer, by hits beside the first of a place
HALVES = np.arange(0, 24, 2), np.arange(1, 24, 2)


def blast(hits, firing):
    """Sum the hits at all receivers, (n_receivers, n_samples) from the first hit on."""
    sums = [superpose(hits[0][c], firing, signatures=[h[c] for h in hits]) for c in range(24)]
    return np.array([one.velocity[:, 2] for one in sums]), sums[0].start


def weighed(motion, weights):
    """Scale all receivers to equal strength."""
    return motion * weights[:, None]


def explained(recorded, predicted):
    """Return the share of the energy that is predicted, all receivers weighing the same."""
    left = np.sum((recorded - predicted) ** 2, axis=1) / np.sum(recorded**2, axis=1)
    return float(1.0 - left.mean())


def one_draw(records, delay, sigma, generator):
    """Make a blast, find its times from each half of the receivers; errors and shares explained."""
    chosen = [(place, generator.permutation(np.arange(1, 5))[:2]) for place in records]
    known = [records[place][0] for place, _ in chosen] * 2
    hits = [records[place][two[n]] for n in (0, 1) for place, two in chosen]
    nominal = delay * np.arange(12)
    drawn = nominal + generator.normal(0.0, sigma, 12)
    lags = [scale_and_shift(s, h, range(24), BAND)[1] for s, h in zip(known, hits, strict=True)]
    recorded, start = blast(hits, Firing(drawn, np.ones(12)))
    greens = np.array([[s.velocity[:, 2] for s in one] for one in known])
    begins = known[0][0].start - start
    found: dict = {"truth": drawn + lags, "nominal": nominal, "recorded": recorded, "start": start}
    for half, (fitted, held) in enumerate([HALVES, HALVES[::-1]]):
        loudness = 1.0 / np.sqrt(np.mean(recorded[fitted] ** 2, axis=1))
        answer = firing_times(
            greens[:, fitted], recorded[fitted], 1e-3, nominal + begins,
            sigma=np.hypot(sigma, JITTER), scale_sigma=SCALES,
            whiten=partial(weighed, weights=loudness),
        )  # fmt: skip
        times, scales = answer.times - begins, answer.scales
        guesses = [on_record(known, firing, recorded.shape[1], start)
                   for firing in (Firing(nominal, np.ones(12)), Firing(times, scales))]  # fmt: skip
        found[half] = {
            "times": times, "scales": scales, "intervals": answer.intervals(0.9) - begins,
            "guesses": guesses, "held": held,
            "explained": [explained(recorded[held], g[held]) for g in guesses],
        }  # fmt: skip
    return found


def on_record(known, firing, n_samples, start):
    """Sum the known hits over the samples of the record."""
    motion, first = blast(known, firing)
    lead, out = round((first - start) * 1e3), np.zeros((24, n_samples))
    taken = motion[:, max(0, -lead) : n_samples - lead]
    out[:, max(0, lead) : max(0, lead) + taken.shape[1]] = taken
    return out


def summary(draws):
    """Errors in ms, shares explained and how often intervals hold the truth."""
    both = [(draw, draw[half]) for draw in draws for half in (0, 1)]
    errors = 1e3 * np.array([half["times"] - draw["truth"] for draw, half in both])
    planned = 1e3 * np.array([draw["nominal"] - draw["truth"] for draw in draws])
    shares = np.array([half["explained"] for _, half in both])
    wide = [1e3 * np.diff(half["intervals"])[:, 0] / 2 for _, half in both]
    inside = [(half["intervals"][:, 0] < draw["truth"]) & (draw["truth"] < half["intervals"][:, 1])
              for draw, half in both]  # fmt: skip
    quantiles = [50, 90]
    return {
        "plan_error_ms": np.percentile(np.abs(planned), quantiles).tolist(),
        "found_error_ms": np.percentile(np.abs(errors), quantiles).tolist(),
        "explained_by_plan": spread(shares[:, 0]), "explained_by_found": spread(shares[:, 1]),
        "interval_90_half_width_ms": spread(wide), "truth_inside_90": float(np.mean(inside)),
    }  # fmt: skip


def main():
    """Run the study, keep its numbers and draw it."""
    gathers = hits_by_place(recordings_folder(sys.argv[1:]) / "wghs")
    records = {place: [[s.bandpassed(*BAND) for s in seismograms(g)] for g in hits]
               for place, hits in gathers.items()}  # fmt: skip
    results, first = {"band_hz": BAND, "draws": N_DRAWS}, None
    for name, (delay, sigma) in PLANS.items():
        generator = np.random.default_rng(2017)
        draws = [one_draw(records, delay, sigma, generator) for _ in range(N_DRAWS)]
        results[name] = summary(draws)
        first = first or draws
        print(name, results[name])
    keep_results("firing_times", results)
    draw_firing_times(first)


if __name__ == "__main__":
    main()
