"""Effects concealed in real hits on a line of geophones, for `pyblast diagnose` to find.

A trial trusts one hit of each of six places, questions another of each, in which an effect is
concealed, and holds out a third. The reference is a simulation of two layers; the blow is unknown.
All draws come from a seed. `verification/proof` answers the trials, each once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import real_projects as sets
from real_line import recordings_folder
from scipy import fft

from pyblast.workflows.diagnose import diagnose_file

SEED = 20261128
LABELS = {
    "gain": "instrument_response", "polarity": "sensor_orientation_or_polarity",
    "clock": "clock_error", "coordinates": "wrong_coordinates", "swap": "swapped_channels",
    "response": "instrument_response", "loss": "attenuation_Q",
}  # fmt: skip
CONCEALED = {
    "gain": 6, "polarity": 6, "clock": 6, "coordinates": 6, "swap": 5, "response": 5, "loss": 6,
}  # fmt: skip
UNTOUCHED = 24
KEYS = {
    "band_hz": [10.0, 35.0], "until_s": 0.35, "source_s": 0.1, "calibrate": False,
}  # fmt: skip


def drawn() -> list[dict]:
    """Return the trials, drawn by `SEED`.

    Returns
    -------
    list of dict
        ``trial``, ``concealed`` (kind or None), ``label`` that is right, ``draw``.
    """
    rng = np.random.default_rng(SEED)
    kinds = [kind for kind, count in CONCEALED.items() for _ in range(count)]
    kinds = rng.permutation(np.array([*kinds, *[None] * UNTOUCHED], object)).tolist()
    return [
        {"trial": number, "concealed": kind, "label": LABELS.get(kind),
         "draw": np.round(rng.random(40), 6).tolist()}
        for number, kind in enumerate(kinds)
    ]  # fmt: skip


def answered(trial: Mapping, folder: Path) -> tuple[dict, list[str]]:
    """Conceal the effect of a trial, and diagnose its records.

    Parameters
    ----------
    trial : mapping
        As of `drawn`.
    folder : path
        Keeps project files and runs; the runs serve all trials, since the ground is one.

    Returns
    -------
    dict
        As in ``diagnosis.json``.
    list of str
        Receivers in which the effect is; empty where it is in all or there is none.
    """
    hits = sets.wghs_shots(recordings_folder())
    trusted, questioned, held = shots_of(trial["draw"], hits)
    changed, targets = conceal([*questioned, *held], trial)
    names = {"trusted": [s.name for s in trusted], "held_out": [s.name for s in held]}
    project = sets.write_project(
        folder / f"real-{trial['trial']:02d}", sets.WGHS_GROUND, [*trusted, *changed],
        sets.ricker(), names | KEYS,
    )  # fmt: skip
    return diagnose_file(project, folder / "runs"), targets


def shots_of(draw: Sequence[float], hits: Sequence) -> tuple[list, list, list]:
    """Return trusted, questioned and held-out hits, one of each place."""
    trusted = [hit for hit in hits if hit.name.endswith("_1")]
    questioned, held = [], []
    for p, first in enumerate(trusted):
        stem = first.name[:-1]
        order = 2 + np.argsort(draw[4 * p : 4 * p + 4]) if 4 * p + 4 <= 20 else [2, 3]
        for k, into in zip(order, (questioned, held), strict=False):
            into.append(next(hit for hit in hits if hit.name == f"{stem}{k}"))
    return trusted, questioned, held


def conceal(shots: Sequence, trial: Mapping) -> tuple[list, list[str]]:
    """Return the hits with the concealed effect, and its receivers."""
    kind, u = trial["concealed"], trial["draw"]
    names = sorted({name for shot in shots for name in shot.receivers})
    target = names[2:-2][int(u[20] * len(names[2:-2]))]
    sign = 1.0 if u[21] < 0.5 else -1.0
    if kind is None:
        return list(shots), []
    if kind == "loss":
        return [lossy(shot, 0.03 + 0.04 * u[22]) for shot in shots], []
    if kind == "swap":
        places = shots[0].receivers
        near = sorted(set(names) - {target},
                      key=lambda n: (abs(places[n][0] - places[target][0]), n))  # fmt: skip
        other = near[int(u[22] * 4)]
        return [swapped(shot, target, other) for shot in shots], [target, other]
    return [one_receiver(shot, target, kind, sign, u) for shot in shots], [target]


def filtered(samples, dt, change):
    """Return samples with their spectrum multiplied by ``change(frequency)``."""
    size = fft.next_fast_len(2 * samples.shape[-1], real=True)
    spectrum = fft.rfft(samples, size) * change(fft.rfftfreq(size, dt))
    return fft.irfft(spectrum, size)[..., : samples.shape[-1]]


def late(samples, dt, shift):
    """Return samples late by a shift in s."""
    return filtered(samples, dt, lambda f: np.exp(-2j * np.pi * f * shift))


def lossy(shot, loss):
    """Return all records of a shot after ground that loses more: 1/Q from the time of the shot."""
    n, dt, middle = shot.data.shape[1], shot.dt, 20.0
    f = fft.rfftfreq(2 * n, dt)
    t = np.maximum(shot.start + dt * np.arange(n), 0.0)
    kept = np.clip(f, 5.0, 100.0)
    phase = -2j * np.pi * f * (dt * np.arange(n)[:, None] - loss * t[:, None]
                               * np.log(kept / middle) / np.pi)  # fmt: skip
    operator = fft.irfft(np.exp(phase - np.pi * loss * t[:, None] * kept), 2 * n)[:, :n]
    return replace(shot, data=shot.data @ operator)


def swapped(shot, first, second):
    """Return a shot with two channels exchanged."""
    names, data = list(shot.receivers), shot.data.copy()
    a, b = names.index(first), names.index(second)
    data[[a, b]] = data[[b, a]]
    return replace(shot, data=data)


def without(shot, name):
    """Return a shot without the record of a receiver."""
    data = shot.data.copy()
    data[list(shot.receivers).index(name)] = np.nan
    return replace(shot, data=data)


def one_receiver(shot, target, kind, sign, u):
    """Return a shot with the record of one receiver changed."""
    names, data = list(shot.receivers), shot.data.copy()
    r, dt = names.index(target), shot.dt
    rest = data[r] - data[r, : max(int(-shot.start / dt) - 5, 1)].mean()
    if kind == "gain":
        data[r] *= 0.5 if sign < 0 else 2.0
    elif kind == "polarity":
        data[r] *= -1.0
    elif kind == "clock":
        data[r] = late(rest, dt, 3e-3 * sign)
    elif kind == "response":
        corner, damping = 10.0 + 8.0 * u[22], 0.3 + 0.4 * u[23]

        def sensed(f):
            s = 1j * f / corner
            return s**2 / (1.0 + 2.0 * damping * s + s**2)

        data[r] = filtered(rest, dt, sensed)
    elif kind == "coordinates":  # stood 2 m further: its record is that of the neighbour
        data[r] = data[r + int(sign)]
        return without(replace(shot, data=data), names[r + int(sign)])
    return replace(shot, data=data)
