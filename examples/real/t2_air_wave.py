"""T2: a reference model of solid ground only; whether the air wave is named.

The tool gets shots and the usable band. Truth: the published speed for each site; arrivals picked
by the keeper, as the largest envelope within 15 % of 345 m/s. Controls: the same shots below the
air wave's band; noise before the triggers; receivers shifted so that the wave has 450 m/s.
Argument: the folder.
"""

from dataclasses import replace

import numpy as np
from keeper import Sealed, crossed_lines, folder_of_recordings, keep, refraction_line, wghs
from scipy import signal

from pyblast.line_records.shots import shifted
from pyblast.line_records.waves import air_wave

AIR = 345.0
BANDS = {"refrapy_ex02": (120.0, 500.0), "soda_lakes": (120.0, 600.0), "wghs": (120.0, 400.0)}
SHEARED = 450.0


def picked(shots, band):
    """Return the keeper's windows after offset/345: the middle half of picks, plus half a width."""
    lags, widths = [], []
    for shot in shots:
        shot = shot.banded(band)
        for x, row in zip(shot.offsets, np.abs(signal.hilbert(shot.motion, axis=1)), strict=True):
            if x < 15.0:
                continue
            near = np.flatnonzero(np.abs(shot.times - x / AIR) < 0.15 * x / AIR)
            top = near[np.argmax(row[near])]
            lags.append(shot.times[top] - x / AIR)
            widths.append(np.sum(row[near] > 0.5 * row[top]) * shot.dt)
    return float(np.median(lags)), float(np.median(widths))


def sheared(shot):
    """Shift each receiver so that the air wave crosses the line at a speed impossible in air."""
    late = shot.offsets * (1.0 / SHEARED - 1.0 / AIR)
    return replace(shot, motion=shifted(shot.motion, late, shot.dt))


def before_trigger(shot):
    """Return the noise before the trigger as if it began at time 0."""
    n = int(np.count_nonzero(shot.times < -0.02))
    return replace(shot, motion=shot.motion[:, :n], start=0.0)


def overlap(window, truth, offset):
    """Return the overlap of two windows, over both, at a receiver."""
    a, b = (np.array(w) + offset / c for w, c in (window, truth))
    both = max(0.0, min(a[1], b[1]) - max(a[0], b[0]))
    return both / (max(a[1], b[1]) - min(a[0], b[0]))


def positive(name, shots, band):
    """Seal, ask, open, score one site."""
    lag, width = picked(shots, band)
    sealed = Sealed(name, {"label": "air_blast", "speed": AIR, "lag": lag, "width": width})
    said = air_wave(shots, band)
    sealed.answered([said])
    truth = sealed.opened()
    if said.outcome != "NAMED":
        return sealed.scored(False)
    speed, delay = said.parameters["speed"][0], said.parameters["delay"][0]
    window = (np.array(said.window) + delay, speed)
    true = (truth["lag"] + np.array([-0.5, 0.5]) * truth["width"], AIR)
    offsets = np.concatenate([shot.offsets[shot.offsets > 15.0] for shot in shots])
    share = float(np.mean([overlap(window, true, x) for x in offsets]))
    return sealed.scored(
        abs(speed / AIR - 1.0) < 0.03, speed_error=speed / AIR - 1.0, window_overlap=share,
        held_out_energy=(said.held_out or (0.0, 0.0))[1],
    )  # fmt: skip


def control(name, shots, band):
    """Ask where there is no air wave."""
    sealed = Sealed(name, {"label": None})
    said = air_wave(shots, band)
    sealed.answered([said])
    return sealed.scored(said.outcome == "NULL")


def main():
    """Run the test and keep its rows."""
    folder, rows = folder_of_recordings(), {}
    lines = {"refrapy_ex02": refraction_line(folder), "soda_lakes": crossed_lines(folder),
             "wghs": [shot for hits in wghs(folder).values() for shot in hits[:2]]}  # fmt: skip
    for name, shots in lines.items():
        rows[name] = positive(name, shots, BANDS[name])
        rows[f"{name}, 5-80 Hz"] = control(f"{name}, 5-80 Hz", shots, (5.0, 80.0))
        made = [sheared(shot) for shot in shots]
        rows[f"{name}, sheared"] = control(f"{name}, sheared", made, BANDS[name])
    noise = [before_trigger(shot) for shot in lines["wghs"]]
    rows["wghs, noise"] = control("wghs, noise", noise, BANDS["wghs"])
    keep("T2", rows)


if __name__ == "__main__":
    main()
