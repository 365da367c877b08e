"""Recorded holes made ready for thousands of blasts: spectra of one signature per receiver."""

from math import ceil

import numpy as np
from scipy import fft

from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..solving.model import Receiver
from .scatter import BlastSpectra, trimmed


def signature_spectra(
    signatures,
    n_holes: int,
    *,
    latest: float,
    earliest: float = 0.0,
    travel_shifts=None,
) -> BlastSpectra:
    """Prepare the holes of a blast by what one hole did at each receiver.

    Parameters
    ----------
    signatures : dict of str to Seismogram, or to a sequence of n_holes of them
        By receiver, zero time at the firing; a sequence gives each hole its own. A component
        that was not recorded counts as still.
    n_holes : int
    latest, earliest : float, s
        Between which any hole of any blast may fire.
    travel_shifts : (n_receivers, n_holes) float, s, optional
        How much later than the signature each hole arrives, see `superposition.travel_shifts`.

    Returns
    -------
    BlastSpectra
        Whose receivers have no place.

    Raises
    ------
    InputError
        If numbers, samplings or axes do not agree, or the times are in the wrong order.

    Notes
    -----
    The motion of `superpose` for each blast; theory.md (5.5), (9.4).
    """
    if not earliest <= latest:
        raise InputError(f"latest: must not be below earliest, got {latest:g} < {earliest:g} s")
    table = [_own(name, each, n_holes) for name, each in signatures.items()]
    first = table[0][0]
    for name, row in zip(signatures, table, strict=True):
        for one in row:
            if abs(one.dt - first.dt) > 1e-9 * first.dt or one.components != row[0].components:
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
    begins = shifts + [[one.start for one in row] for row in table]
    longest = max(len(one.velocity) for row in table for one in row)
    n = longest + ceil((np.ptp(begins) + latest - earliest) / first.dt) + 1
    size = fft.next_fast_len(n, real=True)
    turns = -2j * np.pi * fft.rfftfreq(size, first.dt)[:, None]
    spectra = np.empty((len(turns), n_holes, len(table), 3), dtype=complex)
    for number, row in enumerate(table):
        known = {id(one): fft.rfft(np.nan_to_num(one.velocity), size, axis=0) for one in row}
        for hole, one in enumerate(row):
            late = np.exp(turns * (begins[number, hole] - begins.min()))
            spectra[:, hole, number] = known[id(one)] * late
    kept, n_samples = trimmed(spectra.reshape(len(turns), n_holes, -1) / size)
    receivers = tuple(Receiver(name, (0.0, 0.0, 0.0)) for name in signatures)
    return BlastSpectra(
        kept, receivers, 1.0 / (size * first.dt), n_samples,
        earliest + float(begins.min()), earliest, latest,
    )  # fmt: skip


def _own(name, each, n_holes):
    """Return one seismogram for each hole."""
    row = [each] * n_holes if isinstance(each, Seismogram) else list(each)
    if len(row) != n_holes or n_holes < 1:
        raise InputError(f"signatures[{name!r}]: {len(row)} seismograms for {n_holes} holes")
    return row
