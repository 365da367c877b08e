"""How reliable bands and best delays are where no two hits are alike.

Twelve "holes" are two hits at each of six places. Bands of PPV and the best delays come from one
hit of each place and a scatter of times and strengths; the blasts that they are compared
with are sums of the other hits, with their own times. Argument: the folder.
"""

import sys

import numpy as np
from line_analysis import scale_and_shift
from real_figures import draw_plans
from real_line import hits_by_place, keep_results, recordings_folder, seismograms

from pyblast.planning import FiringScatter, best_delays, gain_of_plan, peak_bands, rows_pattern
from pyblast.runs.blast_ensemble import signature_spectra

BAND, HOUSES, SHARES = (10.0, 40.0), (6, 12, 18), (0.5, 0.9, 0.95)
DELAY, DOUBT, N_BANDS, N_REAL, N_FRESH = 0.003, 0.5, 2000, 40, 1000
ALONG = range(0, 24, 3)
PATTERN, NOMINAL = rows_pattern(2, 6), (0.017, 0.042)
LOW, HIGH = (0.005, 0.008), (0.042, 0.150)


def ready(records, chosen, channels):
    """Return spectra of twelve holes, hit ``chosen[hole]`` of each place, at some receivers."""
    places = list(records)
    own = {f"{2 * c} m": [records[places[n % 6]][chosen[n]][c] for n in range(12)]
           for c in channels}  # fmt: skip
    return signature_spectra(own, 12, earliest=-0.1, latest=0.6)


def real_peaks(records, known, times, scatter, channels, seed):
    """Return peaks (N_REAL, n_receivers) of blasts summed from hits other than the known one."""
    generator, peaks = np.random.default_rng(seed), []
    others = np.delete(np.arange(5), known)
    for _ in range(N_REAL):
        chosen = np.transpose([generator.permutation(others)[:2] for _ in range(6)]).ravel()
        drawn, _ = scatter.drawn(times, 1, generator.integers(2**31))
        blast = ready(records, chosen, channels)
        peaks.append(np.nanmax(blast.peaks(drawn).ppv[0], axis=-1))
    return np.array(peaks)


def hit_scatter(records):
    """Spread of strength (log) and trigger (s) of hits beside the first of their place."""
    fits = np.array([scale_and_shift(hits[0], h, range(24), BAND)
                     for hits in records.values() for h in hits[1:]])  # fmt: skip
    scales, shifts = np.log(fits[:, 0]).reshape(6, 4), fits[:, 1].reshape(6, 4)
    middle = np.median(np.abs(shifts - np.median(shifts, axis=1, keepdims=True)))
    return float(scales.std(axis=1, ddof=1).mean()), float(1.4826 * middle)


def coverage(records, charge, trigger):
    """How often real peaks lie in bands and below levels: scatter known, in doubt, left out."""
    times = PATTERN @ NOMINAL
    hidden = FiringScatter(delay=DELAY)
    known = FiringScatter(delay=np.hypot(DELAY, trigger), charge=charge)
    tried = {
        "known": known,
        "in doubt": FiringScatter(known.delay, 0.0, charge, doubt=DOUBT),
        "times only": FiringScatter(delay=DELAY),
    }
    found = {name: [] for name in tried}
    for hit in range(5):
        spectra = ready(records, [hit] * 12, ALONG)
        peaks = real_peaks(records, hit, times, hidden, ALONG, hit)
        for name, scatter in tried.items():
            bands = peak_bands(spectra, times, scatter, n_blasts=N_BANDS, seed=hit)
            held = [[bands.coverage(peaks, share), np.mean(peaks <= bands.level(share))]
                    for share in SHARES]  # fmt: skip
            found[name].append(held)
            if hit == 0 and name == "known":
                first = bands, peaks
    table = {name: {f"{100 * share:g} %": {"band": float(held[0]), "level": float(held[1])}
                    for share, held in zip(SHARES, np.mean(rows, axis=0), strict=True)}
             for name, rows in found.items()}  # fmt: skip
    return table, first


def plans(records, charge, trigger):
    """Search the best delays by each hit; gains on fresh drawn blasts, then on real ones."""
    scatter = FiringScatter(delay=np.hypot(DELAY, trigger), charge=charge)
    hidden, drawn, real, delays = FiringScatter(delay=DELAY), [], [], []
    nominal = PATTERN @ NOMINAL
    for hit in range(5):
        spectra = ready(records, [hit] * 12, HOUSES)
        limits = np.median(peak_bands(spectra, nominal, scatter, n_blasts=500).peaks, axis=0)
        best = best_delays(spectra, PATTERN, LOW, HIGH, scatter, limits=limits, points=10,
                           n_blasts=60)  # fmt: skip
        searched = best.tried[:, 2].min() / best_level(spectra, nominal, scatter, limits)
        worth = gain_of_plan(spectra, nominal, best.times, scatter, limits=limits, n_blasts=N_FRESH)
        drawn.append([1.0 - searched, worth.reduction, *worth.interval])
        pair = [np.max(real_peaks(records, hit, t, hidden, HOUSES, 100 + hit) / limits, axis=1)
                for t in (nominal, best.times)]  # fmt: skip
        real.append(pair)
        delays.append(1e3 * best.delays)
    return np.array(drawn), np.array(real), np.array(delays), best


def best_level(spectra, times, scatter, limits):
    """Severity of a plan on the draws of the search."""
    bands = spectra.peaks(*scatter.drawn(times, 60, 0)).ppv.max(axis=-1)
    return float(np.quantile(np.max(bands / limits, axis=1), 0.9))


def resampled(real, share=0.9):
    """Reduction of the level of real blasts, and 90 % of those of resampled ones."""
    generator = np.random.default_rng(0)
    before, after = real.transpose(1, 0, 2).reshape(2, -1)
    chosen = generator.integers(len(before), size=(2000, len(before)))
    drawn = 1.0 - np.quantile(after[chosen], share, axis=1) / np.quantile(before[chosen], share,
                                                                           axis=1)  # fmt: skip
    whole = 1.0 - np.quantile(after, share) / np.quantile(before, share)
    return [float(whole), *np.quantile(drawn, [0.05, 0.95]).tolist()]


def main():
    """Run the study, keep its numbers and draw it."""
    gathers = hits_by_place(recordings_folder(sys.argv[1:]) / "wghs")
    records = {place: [[s.bandpassed(*BAND) for s in seismograms(g)] for g in hits]
               for place, hits in gathers.items()}  # fmt: skip
    charge, trigger = hit_scatter(records)
    table, first = coverage(records, charge, trigger)
    print("coverage", table)
    drawn, real, delays, best = plans(records, charge, trigger)
    middle = [resampled(real, share) for share in (0.5, 0.9)]
    results = {
        "band_hz": BAND, "strength_log": charge, "trigger_ms": 1e3 * trigger, "coverage": table,
        "delays_ms": delays.tolist(), "reduction_of_the_search": drawn[:, 0].tolist(),
        "reduction_fresh": drawn[:, 1:].tolist(), "reduction_real_50": middle[0],
        "reduction_real_90": middle[1],
    }  # fmt: skip
    print({k: v for k, v in results.items() if k != "coverage"})
    keep_results("bands_and_delays", results)
    draw_plans(first, best, real, table, NOMINAL)


if __name__ == "__main__":
    main()
