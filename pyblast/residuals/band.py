"""What a record holds within a frequency band: few numbers, without decimation or filter ends."""

from dataclasses import dataclass, field

import numpy as np
from scipy import fft, linalg

from ..errors import InputError

CONCENTRATION = 0.9
MARGIN = 6


@dataclass(frozen=True, eq=False)
class Band:
    """Orthonormal functions on a time window whose energy lies within a band.

    Parameters
    ----------
    dt : float, s
    low, high : float, Hz
    basis : (n_samples, n_functions) float64
        Each column of unit length, with at least 0.9 of its energy between ``low`` and ``high``.
    gapped : dict of (blast, receiver, component) to (n_samples, n_functions) float64
        Functions of channels with invalid samples, zero there; fewer of them, and columns of
        zeros in place of those that are lost.
    """

    dt: float
    low: float
    high: float
    basis: np.ndarray
    gapped: dict = field(default_factory=dict)

    @property
    def n_functions(self):
        """Numbers to a channel."""
        return self.basis.shape[1]

    def functions(self, channel):
        """Return the functions of one channel (blast, receiver, component)."""
        return self.gapped.get(channel, self.basis)

    def project(self, motion):
        """Return what motion holds in the band.

        Parameters
        ----------
        motion : (..., n_blasts, n_receivers, 3, n_samples) float

        Returns
        -------
        (..., n_blasts, n_receivers, 3, n_functions) float64
            Invalid samples have no part in it, whatever they hold.

        Raises
        ------
        InputError
            If a valid sample is not finite.
        """
        motion = np.asarray(motion, dtype=float)
        held = motion @ self.basis
        for channel, functions in self.gapped.items():
            heard = np.any(functions != 0.0, axis=1)
            held[(..., *channel, slice(None))] = (
                motion[(..., *channel, slice(None))][..., heard] @ functions[heard]
            )
        if not np.all(np.isfinite(held)):
            place = np.argwhere(~np.isfinite(held))[0][-4:-1]
            raise InputError(
                f"seismograms: blast {place[0]}, receiver {place[1]}, component {place[2]} has a "
                "sample that is not finite; mark it invalid"
            )
        return held

    def restore(self, coefficients):
        """Return the motion (..., n_samples) that coefficients describe; zero where invalid."""
        motion = coefficients @ self.basis.T
        for channel, functions in self.gapped.items():
            held = coefficients[(..., *channel, slice(None))]
            motion[(..., *channel, slice(None))] = held @ functions.T
        return motion


def band_functions(n_samples, dt, band, valid=None) -> Band:
    """Build the functions of a band on a window.

    Parameters
    ----------
    n_samples : int
    dt : float, s
    band : tuple of 2 float, Hz
    valid : (n_blasts, n_receivers, 3, n_samples) bool, optional
        False where a sample is clipped or missing.

    Returns
    -------
    Band
        About ``2 (high - low) n_samples dt`` functions.

    Raises
    ------
    InputError
        If the band is empty, reaches beyond the Nyquist frequency, or is so narrow that the
        window holds none of its motion.

    Notes
    -----
    Eigenvectors of the band's own operator on the window (Slepian 1978), theory.md (7.9), looked
    for among the cosines in and near the band. Where samples are invalid, those combinations are
    kept that have 0.9 of their energy in the band and in the samples that are left.
    """
    low, high = map(float, band)
    if not 0.0 <= low < high < 0.5 / dt:
        raise InputError(
            f"band: need 0 <= low < high < {0.5 / dt:g} Hz (half the sampling rate), "
            f"got {low:g} to {high:g} Hz"
        )
    duration = n_samples * dt
    first = max(0, int(2.0 * low * duration) - MARGIN)
    last = min(n_samples, int(2.0 * high * duration) + MARGIN + 2)
    unit = np.zeros((n_samples, last - first))
    unit[np.arange(first, last), np.arange(last - first)] = 1.0
    cosines = fft.idct(unit, axis=0, norm="ortho")
    lag = np.arange(n_samples)
    above, below = (2.0 * edge * dt * np.sinc(2.0 * edge * dt * lag) for edge in (high, low))
    share, mixture = linalg.eigh(cosines.T @ linalg.matmul_toeplitz(above - below, cosines))
    kept = share >= CONCENTRATION
    if not np.any(kept):
        raise InputError(
            f"band: {low:g} to {high:g} Hz is too narrow for a window of {duration:g} s; "
            f"make it longer than about {1.0 / (high - low):.2g} s"
        )
    basis = cosines @ mixture[:, kept]
    return Band(float(dt), low, high, basis, {} if valid is None else _gapped(basis, valid))


def _gapped(basis, valid):
    """Return the functions of each channel in which a sample is invalid."""
    valid = np.asarray(valid, dtype=bool)
    if valid.ndim != 4 or valid.shape[2:] != (3, len(basis)):
        raise InputError(
            f"valid: must have shape (n_blasts, n_receivers, 3, {len(basis)}), got {valid.shape}"
        )
    gapped = {}
    for place in np.argwhere(~valid.all(axis=-1)):
        channel = tuple(map(int, place))
        left, length, _ = linalg.svd(basis * valid[channel][:, None], full_matrices=False)
        gapped[channel] = left * (length**2 >= CONCENTRATION)
    return gapped
