"""T4: a half-space as reference model; whether a soft layer is named, and its Vs.

The tool sees the hits from one end and the line's coordinates; those from the other end are
held out. Truth: phase speeds of the held hits, picked by the keeper from phases between neighbours
(no stack over speeds); the two layers of `03_ground_point_force.py` (2.4 m of 178 over 231 m/s,
by hand from first breaks and waveforms). Control: the same hits with their dispersion taken
out, frequency by frequency, so that the ground is a half-space. Argument: the folder.
"""

from dataclasses import replace

import numpy as np
from keeper import Sealed, folder_of_recordings, keep, wghs

from pyblast.line_records.waves import phase_speeds, soft_layer

BAND = (10.0, 50.0)
HAND = {"thickness": 2.4, "vs": (178.0, 231.0)}
FREQUENCIES = np.geomspace(*BAND, 14)


def by_differences(shots):
    """Return phase speeds from the mean phase difference between geophones 3 apart, all hits."""
    turns = 0.0
    for shot in shots:
        order = np.argsort(shot.offsets)
        spectrum = np.fft.rfft(shot.motion[order], 8192)
        index = np.rint(FREQUENCIES * 8192 * shot.dt).astype(int)
        phases = spectrum[:, index] / np.abs(spectrum[:, index])
        turns = turns + np.mean(phases[1:] * phases[:-1].conj(), axis=0)
        gap = np.median(np.diff(shot.offsets[order]))
    return 2.0 * np.pi * FREQUENCIES * gap / np.mod(-np.angle(turns), 2.0 * np.pi)


def undispersed(shots, speed=200.0):
    """Advance each frequency so that the fitted phase speeds become one speed."""
    picks = phase_speeds(shots, np.geomspace(6.0, 80.0, 40))
    made = []
    for shot in shots:
        n = 4 * shot.motion.shape[1]
        frequency = np.fft.rfftfreq(n, shot.dt)
        slow = np.interp(frequency, picks.frequency, 1.0 / picks.speed)
        turns = np.exp(2j * np.pi * frequency * shot.offsets[:, None] * (slow - 1.0 / speed))
        motion = np.fft.irfft(np.fft.rfft(shot.motion, n) * turns, n)
        made.append(replace(shot, motion=motion[:, : shot.motion.shape[1]]))
    return made


def main():
    """Run the test and keep its rows."""
    hits, rows = wghs(folder_of_recordings()), {}
    left = [s for place in (-5.0, -10.0, -20.0) for s in hits[place]]
    right = [s for place in (51.0, 56.0, 66.0) for s in hits[place]]
    for name, fitted, held in (("from the left", left, right), ("from the right", right, left)):
        truth = {"label": "soft_surface_layer", "speeds": by_differences(held).tolist(), **HAND}
        sealed = Sealed(name, truth)
        said = soft_layer(fitted, held, BAND)
        sealed.answered([said])
        opened = sealed.opened()
        picks = phase_speeds(fitted, FREQUENCIES)
        true = np.interp(picks.frequency, FREQUENCIES, opened["speeds"])
        off = picks.speed / true - 1.0
        scores = {"median_speed_deviation": float(np.median(np.abs(off))),
                  "held_out_sigmas": said.held_out}  # fmt: skip
        if said.parameters:
            depth = 0.5 * np.max(picks.speed / picks.frequency)
            top, (one, two) = opened["thickness"], opened["vs"]
            hand = depth / (top / one + (depth - top) / two)
            scores |= {"vs_mean": said.parameters["vs_mean"][0], "vs_mean_by_hand": hand}
        rows[name] = sealed.scored(said.outcome == "NAMED", **scores)
    for name, fitted, held in (("left", left, right), ("right", right, left)):
        sealed = Sealed(f"undispersed, {name}", {"label": None})
        said = soft_layer(undispersed(fitted), undispersed(held), BAND)
        sealed.answered([said])
        rows[f"control: undispersed, {name}"] = sealed.scored(said.outcome == "NULL")
    keep("T4", rows)


if __name__ == "__main__":
    main()
