"""Linear superposition of a production blast from single-hole signatures."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft

from ..errors import InputError
from ..signals.seismogram import Seismogram, fast_length
from .blast import Blast, Firing


def superpose(
    signature: Seismogram,
    firing: Firing,
    *,
    signatures: Sequence[Seismogram | None] | None = None,
    travel_shifts: ArrayLike | None = None,
    method: str = "fft",
) -> Seismogram:
    """Superpose the single-hole signature over the holes of a blast.

    Parameters
    ----------
    signature : Seismogram
        Single-hole seismogram at the place of interest, zero time at its firing.
    firing : Firing
        Times in s and scales relative to the signature hole.
    signatures : sequence of Seismogram or None, optional
        Own seismogram of each hole; None in the sequence stands for ``signature``.
    travel_shifts : (n_holes,) float64, s, optional
        Added to the firing times, see :func:`travel_shifts`.
    method : str
        "fft" multiplies spectra; "direct" adds shifted copies in time. Both use the same
        band-limited shift and agree to 1e-12 of the peak; "direct" is slow.

    Returns
    -------
    Seismogram
        From the first to the last moved sample of all holes.

    Raises
    ------
    InputError
        If lengths, samplings or components do not agree, or the method is unknown.

    Notes
    -----
    ``u = u_s * sum_i a_i delta(t - t_i)``: eq. (9) to (14) of the paper; theory.md (5.4).
    The shift is exact for motion below the Nyquist frequency that begins and ends at rest; a
    delay of whole samples moves any samples unchanged.

    Examples
    --------
    >>> pulse = Seismogram(np.hanning(21)[:, None] * [1e-3, 0.0, 0.0], 1e-3)
    >>> superpose(pulse, Firing.rows(3, 1, delay=0.05)).duration.__round__(3)
    0.12
    """
    if method not in ("fft", "direct"):
        raise InputError(f'superpose.method: must be "fft" or "direct", got {method!r}')
    own = _own_signatures(signature, signatures, len(firing.times))
    times = firing.times + _checked_shifts(travel_shifts, len(firing.times))
    delays = (times + [s.start - signature.start for s in own]) / signature.dt
    first = math.floor(np.min(delays) + 1e-9)
    delays = delays - first
    n_samples = max(
        math.ceil(delay - 1e-9) + len(s.velocity) for delay, s in zip(delays, own, strict=True)
    )
    n_padded = fast_length(2 * n_samples)
    add = _add_spectra if method == "fft" else _add_samples
    motion = add(own, delays, firing.scales, n_padded)[:n_samples]
    start = signature.start + first * signature.dt
    return replace(signature, velocity=motion, start=start, label="superposed")


def travel_shifts(
    blast: Blast, receiver: ArrayLike, speed: float, reference: ArrayLike
) -> np.ndarray:
    """Return how much later each hole's waves arrive than those of the signature hole.

    Parameters
    ----------
    blast : Blast
    receiver : (3,) float64, m
    speed : float, m/s
        Of the wave that carries the peak.
    reference : (3,) float64, m
        Place of the signature hole.

    Returns
    -------
    (n_holes,) float64, s
        ``(|centre_i - receiver| - |reference - receiver|) / speed``; negative when nearer.

    Raises
    ------
    InputError
        If the speed is not positive.
    """
    if not speed > 0.0:
        raise InputError(f"travel_shifts.speed: must be positive, got {speed:g} m/s")
    receiver = np.asarray(receiver, dtype=np.float64)
    distance = np.linalg.norm(blast.centres - receiver, axis=1)
    return (distance - np.linalg.norm(np.asarray(reference) - receiver)) / speed


def _checked_shifts(shifts, n_holes):
    """One finite travel-time shift per hole, zero where none is given."""
    if shifts is None:
        return np.zeros(n_holes)
    shifts = np.asarray(shifts, dtype=np.float64)
    if shifts.shape != (n_holes,) or not np.all(np.isfinite(shifts)):
        raise InputError(
            f"superpose.travel_shifts: need {n_holes} finite values, got shape {shifts.shape}"
        )
    return shifts


def _own_signatures(signature, signatures, n_holes):
    """One seismogram per hole, all sampled like the common one."""
    if signatures is None:
        return [signature] * n_holes
    if len(signatures) != n_holes:
        raise InputError(f"superpose.signatures: {len(signatures)} given for {n_holes} holes")
    own = [signature if s is None else s for s in signatures]
    for hole, s in enumerate(own):
        if abs(s.dt - signature.dt) > 1e-9 * signature.dt or s.components != signature.components:
            raise InputError(
                f"superpose.signatures[{hole}]: must have dt = {signature.dt:g} s and components "
                f"{signature.components}; resample or rotate it first"
            )
    return own


def _split_delay(delay):
    """Whole samples and a fraction between -0.5 and 0.5; rounding noise is no fraction."""
    whole = round(delay)
    fraction = delay - whole
    return whole, (fraction if abs(fraction) > 1e-9 else 0.0)


def _add_spectra(own, delays, scales, n_padded):
    """Add phase-turned spectra; holes that share a signature share its transform."""
    turns = np.arange(n_padded // 2 + 1)
    combs = {}
    for s, delay, scale in zip(own, delays, scales, strict=True):
        whole, fraction = _split_delay(delay)
        cycles = (turns * whole % n_padded + turns * fraction) / n_padded
        comb = combs.setdefault(id(s), (s, np.zeros(len(turns), dtype=np.complex128)))[1]
        comb += scale * np.exp(-2j * np.pi * cycles)
    spectrum = np.zeros((len(turns), 3), dtype=np.complex128)
    for s, comb in combs.values():
        spectrum += np.asarray(fft.rfft(s.velocity, n_padded, axis=0)) * comb[:, None]
    return np.asarray(fft.irfft(spectrum, n_padded, axis=0))


def _add_samples(own, delays, scales, n_padded):
    """Add shifted copies in time; a fraction of a sample by the periodic sinc."""
    motion = np.zeros((n_padded, 3))
    for s, delay, scale in zip(own, delays, scales, strict=True):
        whole, fraction = _split_delay(delay)
        copy = np.zeros((n_padded, 3))
        if fraction == 0.0:
            copy[: len(s.velocity)] = s.velocity
        else:
            kernel = _periodic_sinc(fraction, n_padded)
            for n in range(len(s.velocity)):
                copy += np.roll(kernel, n)[:, None] * s.velocity[n]
        motion += scale * np.roll(copy, whole, axis=0)
    return motion


def _periodic_sinc(fraction, n_padded):
    """Band-limited unit sample, ``fraction`` of a sample late, repeated every n_padded samples."""
    n = np.arange(n_padded)
    n = np.where(n > n_padded // 2, n - n_padded, n)
    angle = np.pi * (n - fraction) / n_padded
    period = np.tan(angle) if n_padded % 2 == 0 else np.sin(angle)
    sign = np.where(n % 2 == 0, -1.0, 1.0)
    return sign * math.sin(math.pi * fraction) / (n_padded * period)
