"""What is the effect of no two hits being alike? Real hits summed over a firing plan.

Twelve "holes" are two real hits at each of six places, 42 ms apart; the prediction repeats one
other real hit of each place. Every waveform is real, only the sum is made here.
Argument: the folder.
"""

import sys

import numpy as np
from line_analysis import noise_misfit, repeatability, scale_and_shift, spread
from real_figures import draw_hits
from real_line import hits_by_place, keep_results, recordings_folder, seismograms

from pyblast import Blast, compare, superpose
from pyblast.blasts.blast import Firing
from pyblast.blasts.signature import travel_shifts

DELAY, BAND = 0.042, (10.0, 40.0)
OCTAVES = [(5.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, 80.0), (80.0, 160.0)]
GROUND_WAVE, N_DRAWS = 195.0, 10
FIRING = Firing(DELAY * np.arange(12), np.ones(12))


def predictions(signatures, hits, channels):
    """Sum the hits; predict the sum by the signatures, plain and with scale and shift per hit."""
    n_channels, plain, corrected = len(hits[0]), {}, {}
    even, odd = np.arange(0, n_channels, 2), np.arange(1, n_channels, 2)
    pairs = list(zip(signatures, hits, strict=True))
    fits = [np.transpose([scale_and_shift(s, h, others, BAND) for s, h in pairs])
            for others in (odd, even)]  # fmt: skip
    for c in channels:
        own = [s[c] for s in signatures]
        truth = superpose(own[0], FIRING, signatures=[h[c] for h in hits])
        scales, shifts = fits[c % 2]
        moved = Firing(FIRING.times, scales)
        plain[c] = truth, superpose(own[0], FIRING, signatures=own)
        corrected[c] = truth, superpose(own[0], moved, signatures=own, travel_shifts=shifts)
    return plain, corrected


def scores(pairs):
    """Waveform misfit, PPV and dominant-frequency deviation by channel, misfit by octave."""
    found, octaves = [], []
    for truth, predicted in pairs.values():
        c = compare(truth, predicted, BAND, time_frequency=False)
        found.append([c.waveform_misfit[2], c.ppv_deviation[2], c.frequency_deviation[2]])
        bands = [(truth.bandpassed(*b), predicted.bandpassed(*b)) for b in OCTAVES]
        bands = [(t, p.sampled(t.start, t.dt, len(t.velocity))) for t, p in bands]
        octaves.append([np.nansum((t.velocity - p.velocity) ** 2) / np.nansum(t.velocity**2)
                        for t, p in bands])  # fmt: skip
    return np.array(found), np.array(octaves)


def one_signature_for_all(records, hit):
    """Predict six holes west of the line by one hit at -10 m and travel shifts; by channel."""
    places = [place for place in (-5.0, -10.0, -20.0) for _ in (0, 1)]
    hits = [records[p][(hit + 1 + n % 2) % 5] for n, p in enumerate(places)]
    ground = np.column_stack([places, np.zeros((6, 2))])
    blast = Blast("west", ground, ground, np.full(6, np.nan), DELAY * np.arange(6))
    signature, misfits = records[-10.0][hit], []
    for c in range(24):
        place = (2.0 * c, 0.0, 0.0)
        shifts = travel_shifts(blast, place, GROUND_WAVE, reference=(-10.0, 0.0, 0.0))
        truth = superpose(signature[c], blast.firing(), signatures=[h[c] for h in hits])
        guess = superpose(signature[c], blast.firing(), travel_shifts=shifts)
        own = [records[p][hit][c] for p in places]
        each = superpose(signature[c], blast.firing(), signatures=own)
        found = [compare(truth, g, BAND, time_frequency=False) for g in (guess, each)]
        misfits.append([f.waveform_misfit[2] for f in found])
    return misfits


def main():
    """Run the study, keep its numbers and draw it."""
    gathers = hits_by_place(recordings_folder(sys.argv[1:]) / "wghs")
    records = {place: [seismograms(g) for g in hits] for place, hits in gathers.items()}
    generator = np.random.default_rng(2017)
    names = ("plain", "corrected")
    found, octaves, floors = {n: [] for n in names}, {n: [] for n in names}, []
    for draw in range(N_DRAWS):
        chosen = [(p, [draw % 5, *generator.permutation(np.delete(np.arange(5), draw % 5))[:2]])
                  for p in gathers] * 2  # fmt: skip
        source = [(p, k[0], k[1 + n // 6]) for n, (p, k) in enumerate(chosen)]
        signatures = [records[p][s] for p, s, _ in source]
        pairs = predictions(signatures, [records[p][h] for p, _, h in source], range(24))
        for name, each in zip(names, pairs, strict=True):
            score, octave = scores(each)
            found[name].append(score)
            octaves[name].append(octave)
        used = [gathers[p][s] for p, s, _ in source], [gathers[p][h] for p, _, h in source]
        floors.append(noise_misfit(used[0], used[1], pairs[0], BAND))
        print(f"draw {draw + 1} of {N_DRAWS}: misfit {np.median(found['plain'][-1][:, 0]):.3f}")
    noise = {
        f"{b[0]:g}-{b[1]:g} Hz": spread(noise_misfit(used[0], used[1], pairs[0], b))
        for b in OCTAVES
    }
    west = np.array([one_signature_for_all(records, hit) for hit in range(5)])
    hit = records[-10.0][0][12]
    again = superpose(hit, FIRING).velocity[:, 2]
    by_hand = np.zeros_like(again)
    for n in range(12):
        by_hand[42 * n : 42 * n + len(hit.velocity)] += hit.velocity[:, 2]
    results = {"band_hz": BAND, "repeatability": repeatability(records, BAND), "draws": N_DRAWS,
               "noise_floor": spread(floors), "noise_by_octave": noise,
               "same_hit_again": float(np.max(np.abs(again - by_hand)) / np.max(np.abs(again))),
               "one_signature_for_three_places": spread(west[:, 12:, 0]),
               "own_signatures_for_three_places": spread(west[:, 12:, 1])}  # fmt: skip
    for name in names:
        values = np.array(found[name])
        results[name] = {
            "misfit": spread(values[..., 0]),
            "misfit_median_per_draw": spread(np.median(values[..., 0], axis=1)),
            "ppv_deviation_percent": spread(100 * values[..., 1]),
            "ppv_absolute_deviation_percent": spread(100 * np.abs(values[..., 1])),
            "frequency_absolute_deviation_percent": spread(100 * np.abs(values[..., 2])),
            "misfit_by_octave": {f"{a:g}-{b:g} Hz": spread(np.array(octaves[name])[..., n])
                                 for n, (a, b) in enumerate(OCTAVES)},
        }  # fmt: skip
    keep_results("hits_superposed", results)
    draw_hits(pairs, found, np.array(floors), octaves, noise, BAND, OCTAVES)


if __name__ == "__main__":
    main()
