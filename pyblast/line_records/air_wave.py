"""Whether the air brought part of the records: envelopes stacked along slants."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import signal

from ..errors import InputError
from .shots import SURE, Shot, Verdict, interval, jackknifed, share_as_large, shifted

AIR = (312.0, 361.0)  # m/s at -30 to 50 degrees C: 20.05 sqrt(T)
SPEEDS = np.geomspace(120.0, 2000.0, 340)
N_DRAWS, N_DELAYS = 99, 15
NEAREST = 3.0  # m, within which the slowest and the fastest wave come together


@dataclass(frozen=True, eq=False)
class Slants:
    """Envelopes of a shot, each over its root mean square, and the delays that are tried."""

    envelopes: np.ndarray
    offsets: np.ndarray
    dt: float
    start: float
    delays: np.ndarray

    def stacked(self, speeds: np.ndarray) -> np.ndarray:
        """Return the mean over receivers at each speed and delay, (n_speeds, n_delays)."""
        total = np.zeros((len(speeds), len(self.delays)))
        for row, offset in zip(self.envelopes, self.offsets, strict=True):
            times = offset / speeds[:, None] + self.delays
            index = np.rint((times - self.start) / self.dt).astype(int)
            inside = (index >= 0) & (index < len(row))
            total = total + np.where(inside, row[np.clip(index, 0, len(row) - 1)], 0.0)
        return total / len(self.envelopes)


def air_wave(shots: Sequence[Shot], band: tuple[float, float], *, seed: int = 0) -> Verdict:
    """Look for a wave that left the source at its time and came through the air.

    Parameters
    ----------
    shots : list of Shot
    band : tuple of 2 float, Hz
        Where the records are usable; the search keeps to it.
    seed : int

    Returns
    -------
    Verdict
        "air_blast" with "speed" [m/s] and "delay" [s]; ``window`` holds what of it follows the
        time offset/speed. ``held_out`` is the energy explained in the window at every other
        receiver by those between, where ground alone foretells nothing. "UNKNOWN" is a wave of the
        speed of air that does not start with the source or changes speed with frequency.

    Notes
    -----
    The largest stack over speeds and delays against that of envelopes turned in time at random,
    theory.md (15.2). One speed for all shots, a delay for each, since triggers err.
    """
    if not shots:
        raise InputError("air_wave: needs at least one shot")
    slants = [_slants(shot, band) for shot in shots]
    stacks = [slant.stacked(SPEEDS) for slant in slants]
    speed, most = _peak(stacks)
    rng = np.random.default_rng(seed)
    drawn = [_peak([_turned(slant, rng).stacked(SPEEDS) for slant in slants])[1]
             for _ in range(N_DRAWS)]  # fmt: skip
    chance = share_as_large(most, drawn)
    if chance > SURE:
        return Verdict("NULL", "air_blast", "no wave crosses the line beyond chance",
                       band=band, chance=chance)  # fmt: skip
    found = _refined(slants, speed)
    if not AIR[0] < found[0] < AIR[1]:
        return Verdict(
            "NULL", "air_blast",
            f"the clearest wave has {found[0]:.0f} m/s, which is not the speed of sound in air",
            parameters={"speed": found}, band=band, chance=chance,
        )  # fmt: skip
    delays = [_delay(slant, found[0]) for slant in slants]
    window = _window(slants, found[0], delays)
    trouble = _against_air(shots, band, found, delays, window)
    held = held_out(shots, band, found[0], delays, window)
    return Verdict(
        "UNKNOWN" if trouble or held[1] <= held[0] else "NAMED", "air_blast",
        trouble or f"a wave of {found[0]:.0f} m/s leaves the source at its time in all of the band",
        tuple(int(c) for c in shots[0].channels),
        {"speed": found, "delay": interval(delays)}, window, band, chance, held,
    )  # fmt: skip


def _slants(shot, band):
    """Prepare one shot; delays reach as far as a period of the lowest frequency."""
    shot = shot.banded(band)
    far = shot.offsets > NEAREST
    if far.sum() < 6:
        raise InputError(f"air_wave: needs 6 receivers beyond {NEAREST:g} m, got {far.sum()}")
    envelopes = np.abs(signal.hilbert(shot.motion[far], axis=1))
    envelopes = envelopes / np.sqrt(np.mean(envelopes**2, axis=1, keepdims=True))
    reach = 2.0 / band[0]
    return Slants(
        envelopes, shot.offsets[far], shot.dt, shot.start, np.linspace(-reach, reach, N_DELAYS)
    )


def _peak(stacks):
    """Return the speed whose best delays add up to most, and the mean of that."""
    ridge = np.mean([stack.max(axis=1) for stack in stacks], axis=0)
    best = int(np.argmax(ridge))
    return float(SPEEDS[best]), float(ridge[best])


def _turned(slant, rng):
    """Turn each envelope in time by a draw."""
    n = slant.envelopes.shape[1]
    index = (np.arange(n) + rng.integers(n, size=(len(slant.envelopes), 1))) % n
    return Slants(np.take_along_axis(slant.envelopes, index, 1), slant.offsets, slant.dt,
                  slant.start, slant.delays)  # fmt: skip


def _refined(slants, speed):
    """Return speed with its 90 % interval, each tenth of the receivers left out in turn."""
    near = np.linspace(0.94, 1.06, 121) * speed

    def best(skip):
        kept = [_without(slant, skip) for slant in slants]
        return near[np.argmax(np.mean([k.stacked(near).max(axis=1) for k in kept], axis=0))]

    middle, low, high = jackknifed([best(part) for part in range(10)])
    step = near[1] - near[0]
    return middle, min(low, middle - step), max(high, middle + step)


def _without(slant, part):
    """Leave out every tenth receiver."""
    kept = np.arange(len(slant.offsets)) % 10 != part
    return Slants(slant.envelopes[kept], slant.offsets[kept], slant.dt, slant.start, slant.delays)


def _delay(slant, speed):
    """Return the delay of a shot at one speed."""
    return float(slant.delays[np.argmax(slant.stacked(np.array([speed]))[0])])


def _window(slants, speed, delays):
    """Return when, after offset/speed, the aligned envelopes of all shots stand out by half."""
    lags = np.arange(-0.05, 0.1, 0.25 * slants[0].dt)
    profile = np.zeros(len(lags))
    for slant, delay in zip(slants, delays, strict=True):
        line = Slants(slant.envelopes, slant.offsets, slant.dt, slant.start, lags + delay)
        profile = profile + line.stacked(np.array([speed]))[0]
    top = int(np.argmax(profile))
    out = profile < 0.5 * (profile[top] + np.median(profile))
    first = top - int(np.argmax(out[top::-1])) if out[: top + 1].any() else 0
    last = top + int(np.argmax(out[top:])) if out[top:].any() else len(lags) - 1
    return float(lags[first]), float(lags[last])


def _against_air(shots, band, found, delays, window):
    """Say what speaks against air, or nothing."""
    late = float(np.median(delays))
    if abs(late) > 1.0 / band[0] + window[1] - window[0]:
        return f"the wave leaves {1e3 * late:.1f} ms beside the source's time, as refracted ones do"
    middle = float(np.sqrt(band[0] * band[1]))
    for part in ((band[0], middle), (middle, band[1])):
        slants = [_slants(shot, part) for shot in shots]
        speed = _refined(slants, found[0])
        if not AIR[0] < speed[0] < AIR[1]:
            return f"at {part[0]:.0f} to {part[1]:.0f} Hz the wave has {speed[0]:.0f} m/s"
    return ""


def held_out(
    shots: Sequence[Shot],
    band: tuple[float, float],
    speed: float,
    delays: Sequence[float],
    window: tuple[float, float],
) -> tuple[float, float]:
    """Return shares of energy in the window explained at every other receiver, 0 and by air.

    The waveform at a receiver is the mean of its neighbours' on the line, moved by the speed, of a
    size between theirs (geometric mean); nothing of the receiver itself is used.
    """
    left = []
    for shot, delay in zip(shots, delays, strict=True):
        shot = shot.banded(band)
        order = np.flatnonzero(shot.offsets > NEAREST)
        moved = shifted(shot.motion, -shot.offsets / speed, shot.dt)
        lag = shot.times - delay
        inside = (lag >= window[0]) & (lag <= window[1])
        for a, n, b in zip(order[:-2:2], order[1:-1:2], order[2::2], strict=False):
            cut = moved[[a, n, b]][:, inside]
            size = np.linalg.norm(cut, axis=1) + np.finfo(float).tiny
            guess = cut[0] / size[0] + cut[2] / size[2]
            guess *= np.sqrt(size[0] * size[2]) / (np.linalg.norm(guess) + np.finfo(float).tiny)
            left.append(np.sum((cut[1] - guess) ** 2) / (size[1] ** 2 + np.finfo(float).tiny))
    return 0.0, float(1.0 - np.median(left))
