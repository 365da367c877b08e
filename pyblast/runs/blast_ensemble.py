"""Ensembles of one blast with scattered firing times and strengths, by superposed spectra."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.model import Receiver
from ..model.source import PointForce
from ..signals.seismogram import Seismogram, fast_length
from .greens import GreensFunctions, PointSource, drive, history

DROPPED = 1e-10  # fraction of the power above the highest frequency
RINGS = 3.0  # cycles of the lower corner for which a filter rings before and after
SAMPLES_PER_PERIOD = 8  # of the highest frequency; peaks are interpolated by a parabola
# Values of motion per batch of blasts: fits the cache, and products are too small for threads.
AT_ONCE = 2**19


class Peaks(NamedTuple):
    """Peaks of many blasts.

    Parameters
    ----------
    ppv : (n_blasts, n_receivers, 3) float64, m/s
        By component.
    pvs : (n_blasts, n_receivers) float64, m/s
        Peak vector sum.
    """

    ppv: np.ndarray
    pvs: np.ndarray


@dataclass(frozen=True, eq=False)
class BlastSpectra:
    """Spectra of the motion of each hole at all receivers, to be superposed.

    Parameters
    ----------
    spectra : (n_frequencies, n_holes, 3 n_receivers) complex128
        Motion of each hole fired at 0 s with its charge.
    receivers : tuple of Receiver
    spacing : float, Hz
        Frequency interval, from 0.
    n_samples : int
        Samples of the motion.
    start : float, s
        Time of its first sample.
    earliest, latest : float, s
        Range of firing times.
    """

    spectra: np.ndarray
    receivers: tuple[Receiver, ...]
    spacing: float
    n_samples: int
    start: float
    earliest: float
    latest: float

    @property
    def dt(self) -> float:
        """Time between samples, s."""
        return 1.0 / (self.spacing * self.n_samples)

    def peaks(self, times: ArrayLike, scales: ArrayLike = 1.0) -> Peaks:
        """Return the peaks of many blasts; theory.md (9.4).

        Parameters
        ----------
        times : (n_blasts, n_holes) float, s
            Firing times.
        scales : (n_blasts, n_holes) float or what spreads to it
            Factors on the motion of each hole.

        Raises
        ------
        InputError
            If a firing time is out of range.
        """
        times, scales = self._checked(times, scales)
        together = max(1, AT_ONCE // (3 * len(self.receivers) * self.n_samples))
        ppv, pvs = [], []
        for first in range(0, len(times), together):
            here = slice(first, first + together)
            motion = self._motion(times[here], scales[here])
            ppv.append(_top(np.abs(motion)))
            pvs.append(np.sqrt(_top(np.einsum("brct,brct->brt", motion, motion))))
        return Peaks(np.concatenate(ppv), np.concatenate(pvs))

    def seismograms(self, times: ArrayLike, scales: ArrayLike = 1.0) -> dict[str, Seismogram]:
        """Return the seismograms of one blast, times and scales (n_holes,)."""
        motion = self._motion(*self._checked(np.atleast_2d(times), scales))[0]
        records = {}
        for receiver, velocity in zip(self.receivers, motion, strict=True):
            record = Seismogram(velocity.T, self.dt, self.start, receiver.name)
            if receiver.azimuth is not None:
                names = record.rotated(receiver.azimuth).components
                record = replace(record, components=names)
            records[receiver.name] = record
        return records

    def banded(self, low: float, high: float) -> "BlastSpectra":
        """Band-pass from ``low`` to ``high`` Hz, -6 dB at both; theory.md (13.5).

        Raises
        ------
        InputError
            If the band is empty.
        """
        top = self.spacing * len(self.spectra)
        if not 0.0 < low < min(high, top):
            raise InputError(
                f"band: need 0 < low < high and low below {top:g} Hz, got {low:g}, {high:g} Hz"
            )
        rings = int(np.ceil(RINGS / (low * self.dt)))
        motion = scipy.fft.irfft(self.spectra, self.n_samples, axis=0)
        size = fast_length(self.n_samples + 2 * rings)
        hz = scipy.fft.rfftfreq(size, self.dt)
        off = (hz**2 - low * high) / np.maximum(hz * (high - low), 1e-30)
        gain = np.exp(-2j * np.pi * hz * rings * self.dt) / (1.0 + np.minimum(abs(off), 1e30) ** 8)
        spectra, n_samples = trimmed(
            np.asarray(scipy.fft.rfft(motion, size, axis=0)) * gain[:, None, None] / size
        )
        return replace(
            self, spectra=spectra, n_samples=n_samples, spacing=1.0 / (size * self.dt),
            start=self.start - rings * self.dt,
        )  # fmt: skip

    def _checked(self, times, scales):
        """Return times and scales (n_blasts, n_holes)."""
        times, n_holes = np.asarray(times, dtype=float), self.spectra.shape[1]
        if times.ndim != 2 or times.shape[1] != n_holes:
            raise InputError(f"times: need (n_blasts, {n_holes}), got {times.shape}")
        if not ((times >= self.earliest) & (times <= self.latest)).all():
            raise InputError(
                f"times: must lie in {self.earliest:g} to {self.latest:g} s, got "
                f"{times.min():g} to {times.max():g} s; allow for more when the spectra are made"
            )
        return times, np.broadcast_to(np.asarray(scales, dtype=float), times.shape)

    def _motion(self, times, scales):
        """Return the motion (n_blasts, n_receivers, 3, n_samples)."""
        turn = np.exp(-2j * np.pi * self.spacing * (times - self.earliest))
        holes = scales.astype(complex)
        total = np.empty((len(times), self.spectra.shape[2], len(self.spectra)), dtype=complex)
        for number, matrix in enumerate(self.spectra):
            total[..., number] = holes @ matrix
            holes *= turn
        motion = np.asarray(scipy.fft.irfft(total, self.n_samples, overwrite_x=True))
        return motion.reshape(len(times), len(self.receivers), 3, -1)


def blast_spectra(
    bank: GreensFunctions, sources: Sequence[PointSource], *, latest: float, earliest: float = 0.0
) -> BlastSpectra:
    """Return the spectra of the holes of a blast, for many sets of times and scales.

    Parameters
    ----------
    bank : GreensFunctions
    sources : sequence of Hole, Column or MomentTensor
        With charges and time functions; their times are ignored.
    latest, earliest : float, s
        Range of firing times.

    Raises
    ------
    InputError
        If a source is at no stored place, or ``latest`` is before ``earliest``.

    Notes
    -----
    Times between samples are phase shifts, exact below the Nyquist frequency of the time step.
    Motion later than ``bank.duration`` after a firing is missing; see ``bank.unfinished``.
    """
    if not earliest <= latest:
        raise InputError(f"latest: must not be below earliest, got {latest:g} < {earliest:g} s")
    numbers, dt = bank.numbers(sources), bank.dt
    drives, lead = _drives(bank, sources, numbers)
    longest = max(len(drive) for parts in drives for _, drive in parts)
    size = fast_length(bank.response.shape[-1] + longest + int(np.ceil((latest - earliest) / dt)))
    responses = [_turned(bank, part, size) for part in range(len(bank.parts))]
    spectra = np.stack([sum(np.asarray(scipy.fft.rfft(drive, size)) * responses[part]
                            for part, drive in parts) for parts in drives])  # fmt: skip
    spectra, n_samples = trimmed(spectra.transpose(2, 0, 1) / size)
    return BlastSpectra(
        spectra, bank.receivers, 1.0 / (size * dt), n_samples, (-0.5 - lead) * dt + earliest,
        earliest, latest,
    )  # fmt: skip


def trimmed(spectra: np.ndarray) -> tuple[np.ndarray, int]:
    """Return spectra without high frequencies of negligible power, and fewer samples.

    Parameters
    ----------
    spectra : (n_frequencies, n_holes, n_components) complex128
        Over the number of samples that they were made from.

    Returns
    -------
    spectra : (n_kept, n_holes, n_components) complex128
        For an inverse transform to ``n_samples``.
    n_samples : int
    """
    power = np.sum(np.abs(spectra) ** 2, axis=(1, 2))
    above = np.cumsum(power[::-1])[::-1]
    n_frequencies = max(2, int(np.count_nonzero(above > DROPPED * above[0])))
    n_samples = fast_length(max(SAMPLES_PER_PERIOD * n_frequencies, 4))
    return np.ascontiguousarray(spectra[:n_frequencies]) * n_samples, n_samples


def _top(values):
    """Return the largest of positive values (..., n), interpolated by a parabola."""
    at = np.clip(values.argmax(axis=-1), 1, values.shape[-1] - 2)[..., None]
    before, top, after = (np.take_along_axis(values, at + k, axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = np.maximum(2.0 * top - before - after, 1e-300)
    above = (after - before) ** 2 / (8.0 * bend)
    return np.where(top >= np.maximum(before, after), top + above, np.maximum(before, after))


def _drives(bank, sources, numbers):
    """Return parts and moment increments (n,) of sources fired at 0 s, and the steps before."""
    still = [
        source if isinstance(source, PointForce) else replace(source, time=0.0)
        for source in sources
    ]
    parts = [
        [(part, width) for part, (number, width) in enumerate(bank.parts) if number == at]
        for at in numbers
    ]
    functions = [
        drive(source, width) for source, own in zip(still, parts, strict=True) for _, width in own
    ]
    lead = max(0, int(np.ceil(-min(each.start for each in functions) / bank.dt)))
    last = max(each.start + each.dt * len(each.values) for each in functions)
    times = bank.dt * np.arange(-lead, min(bank.response.shape[-1], np.ceil(last / bank.dt) + 2))
    return [
        [(part, np.diff(history(source, times, width), prepend=0.0)) for part, width in own]
        for source, own in zip(still, parts, strict=True)
    ], lead


def _turned(bank, number, size):
    """Return spectra (3 n_receivers, n_frequencies) of one place in receiver components."""
    spectra = np.asarray(scipy.fft.rfft(bank.response[number], size))
    for receiver, three in zip(bank.receivers, spectra, strict=True):
        east, north, _ = three
        if receiver.azimuth is not None:
            sine, cosine = np.sin(receiver.azimuth), np.cos(receiver.azimuth)
            east[:], north[:] = sine * east + cosine * north, cosine * east - sine * north
        if receiver.normal is not None:
            three[:] = np.outer(receiver.normal, np.asarray(receiver.normal) @ three)
    return spectra.reshape(-1, spectra.shape[-1])


def signature_spectra(
    signatures: dict[str, Any],
    n_holes: int,
    *,
    latest: float,
    earliest: float = 0.0,
    travel_shifts: ArrayLike | None = None,
) -> BlastSpectra:
    """Return the spectra of the holes of a blast from single-hole signatures.

    Parameters
    ----------
    signatures : dict of str to Seismogram, or to a sequence of n_holes of them
        By receiver, time zero at firing; a sequence has one per hole. Components that were not
        recorded are zero.
    n_holes : int
    latest, earliest : float, s
        Range of firing times.
    travel_shifts : (n_receivers, n_holes) float, s, optional
        Later arrival of each hole than the signature, see `superposition.travel_shifts`.

    Returns
    -------
    BlastSpectra
        With receivers at the origin.

    Raises
    ------
    InputError
        If numbers, samplings or components differ, or ``latest`` is before ``earliest``.

    Notes
    -----
    The motion of `superpose` for each blast; theory.md (5.5), (9.4).
    """
    if not earliest <= latest:
        raise InputError(f"latest: must not be below earliest, got {latest:g} < {earliest:g} s")
    table = [_own(name, each, n_holes) for name, each in signatures.items()]
    first = table[0][0]
    for name, row in zip(signatures, table, strict=True):
        for seismogram in row:
            resampled = abs(seismogram.dt - first.dt) > 1e-9 * first.dt
            if resampled or seismogram.components != row[0].components:
                raise InputError(
                    f"signatures[{name!r}]: need dt = {first.dt:g} s and one set of axes; resample "
                    "or rotate first"
                )
    shifts = np.zeros((len(table), n_holes)) if travel_shifts is None else travel_shifts
    shifts = np.array(shifts, dtype=float)
    if shifts.shape != (len(table), n_holes) or not np.isfinite(shifts).all():
        raise InputError(
            f"travel_shifts: need ({len(table)}, {n_holes}) finite values, got {shifts.shape}"
        )
    begins = shifts + [[seismogram.start for seismogram in row] for row in table]
    longest = max(len(seismogram.velocity) for row in table for seismogram in row)
    n = longest + ceil((np.ptp(begins) + latest - earliest) / first.dt) + 1
    size = fast_length(n)
    turns = -2j * np.pi * scipy.fft.rfftfreq(size, first.dt)[:, None]
    spectra = np.empty((len(turns), n_holes, len(table), 3), dtype=complex)
    for number, row in enumerate(table):
        known = {id(s): scipy.fft.rfft(np.nan_to_num(s.velocity), size, axis=0) for s in row}
        for hole, seismogram in enumerate(row):
            late = np.exp(turns * (begins[number, hole] - begins.min()))
            spectra[:, hole, number] = known[id(seismogram)] * late
    spectra, n_samples = trimmed(spectra.reshape(len(turns), n_holes, -1) / size)
    receivers = tuple(Receiver(name, (0.0, 0.0, 0.0)) for name in signatures)
    return BlastSpectra(
        spectra, receivers, 1.0 / (size * first.dt), n_samples,
        earliest + float(begins.min()), earliest, latest,
    )  # fmt: skip


def _own(name, each, n_holes):
    """Return one seismogram for each hole."""
    row = [each] * n_holes if isinstance(each, Seismogram) else list(each)
    if len(row) != n_holes or n_holes < 1:
        raise InputError(f"signatures[{name!r}]: {len(row)} seismograms for {n_holes} holes")
    return row
