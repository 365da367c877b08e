"""When each hole fired and how strong it was, from records of the blast and of its holes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from ..blasting.blast import Firing
from ..errors import InputError
from .hole_fit import hole_fit, settled


@dataclass(frozen=True, eq=False)
class FiringTimes:
    """Times and scales of the holes with what remains unknown about them.

    Parameters
    ----------
    times : (n_holes,) float64, s
    scales : (n_holes,) float64
        Factor on the seismograms of each hole.
    covariance : (2 n_holes, 2 n_holes) float64, s and 1
        Of all times, then all scales.
    nominal : (n_holes,) float64, s
    misfit_before, misfit_after : float
        Whitened energy of the difference over that of the record, by the plan and by these times.
    temper : float
        By how much what the noise leaves unknown exceeds what independent samples would.
    """

    times: np.ndarray
    scales: np.ndarray
    covariance: np.ndarray
    nominal: np.ndarray
    misfit_before: float
    misfit_after: float
    temper: float

    @property
    def firing(self) -> Firing:
        """Times and scales, ready to be superposed."""
        return Firing(self.times, self.scales)

    def intervals(self, share=0.90):
        """Return intervals (n_holes, 2) of the times in s that hold each with this probability."""
        return self._around(self.times, slice(0, len(self.times)), share)

    def scale_intervals(self, share=0.90):
        """Return intervals (n_holes, 2) of the scales that hold each with this probability."""
        return self._around(self.scales, slice(len(self.times), None), share)

    def _around(self, values, part, share):
        """Return normal intervals around values, of this part of the covariance."""
        if not 0.0 < share < 1.0:
            raise InputError(f"firing times: share must lie between 0 and 1, got {share:g}")
        half = norm.ppf(0.5 + 0.5 * share) * np.sqrt(np.diag(self.covariance)[part])
        return np.column_stack([values - half, values + half])


def firing_times(
    greens,
    recorded,
    dt: float,
    nominal,
    *,
    sigma,
    scale_sigma=0.3,
    whiten: Callable | None = None,
) -> FiringTimes:
    """Find times and scales of the holes that explain records of their blast.

    Parameters
    ----------
    greens : (n_holes, n_receivers, n_components, n_samples) or (n_holes, n_receivers, n_samples)
        Motion by each hole with scale 1, from its firing on, in m/s or what the record is in.
    recorded : (n_receivers, n_components, n_recorded) or (n_receivers, n_recorded) float
    dt : float, s
    nominal : (n_holes,) float, s
        Planned times after the first sample of the record.
    sigma : float or (n_holes,), s
        Standard deviation of each time around its plan, before the records are seen.
    scale_sigma : float or (n_holes,)
        The same of each scale around 1; about 1 allows for a misfire.
    whiten : callable, optional
        Linear operator on motion shaped like ``recorded``, which makes noise white and equal in
        all receivers, up to one factor. None: the noise is so already.

    Returns
    -------
    FiringTimes

    Raises
    ------
    InputError
        If shapes do not agree, a value is not finite, or a standard deviation is not positive.

    Notes
    -----
    Least squares with the prior as further data, theory.md (13.1); the level of the noise is that
    of the remainder, raised by theory.md (13.2) where samples are not independent: noise has
    colours, and no two holes have quite the same waveform.
    """
    fit = hole_fit(*_checked(greens, recorded, dt, nominal, sigma, scale_sigma), whiten)
    values, variance, temper = settled(fit)
    rows = fit.derivatives(values).reshape(len(values), -1)
    covariance = np.linalg.inv(rows @ rows.T / variance + np.diag(fit.trust))
    planned = np.sum(fit.remainder(fit.prior) ** 2)
    left, total = np.sum(fit.remainder(values) ** 2), np.sum(fit.whitened(fit.recorded) ** 2)
    n_holes = len(fit.nominal)
    return FiringTimes(
        fit.nominal + values[:n_holes], values[n_holes:], covariance, fit.nominal,
        float(planned / total), float(left / total), temper,
    )  # fmt: skip


def _checked(greens, recorded, dt, nominal, sigma, scale_sigma):
    """Refuse what can not be fitted; return arrays, the spreads of times and scales as one."""
    greens, recorded = np.asarray(greens, dtype=float), np.asarray(recorded, dtype=float)
    nominal = np.asarray(nominal, dtype=float)
    n_holes = len(nominal)
    if greens.ndim not in (3, 4) or greens.shape[:-1] != (n_holes, *recorded.shape[:-1]):
        raise InputError(
            f"firing_times.greens: need ({n_holes}, receivers[, components], samples) for "
            f"{n_holes} holes and a record of shape {recorded.shape}, got {greens.shape}"
        )
    for name, array in (("greens", greens), ("recorded", recorded), ("nominal", nominal)):
        if not np.isfinite(array).all():
            raise InputError(f"firing_times.{name}: must be finite; leave out what is missing")
    if not 0.0 < dt < np.inf:
        raise InputError(f"firing_times.dt: must be positive, got {dt:g} s")
    length, known = dt * recorded.shape[-1], dt * greens.shape[-1]
    if not ((nominal > -known) & (nominal < length)).all():
        raise InputError(
            f"firing_times.nominal: motion must reach into the record of {length:g} s, got times "
            f"of {nominal.min():g} to {nominal.max():g} s for motion of {known:g} s"
        )
    spreads = [np.broadcast_to(one, nominal.shape) for one in (sigma, scale_sigma)]
    for name, one in zip(("sigma", "scale_sigma"), spreads, strict=True):
        if not ((one > 0.0) & np.isfinite(one)).all():
            raise InputError(f"firing_times.{name}: must be positive, got {one.min():g}")
    silent = np.flatnonzero(~(greens**2).reshape(n_holes, -1).any(axis=1))
    if len(silent):
        raise InputError(f"firing_times.greens: hole {silent[0]} moves no receiver; leave it out")
    return greens, recorded, dt, nominal, np.concatenate(spreads)
