"""Firing times and strengths of the holes, estimated from records of the blast."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft
from scipy.stats import norm

from pyblast.blasts.blast import Firing
from pyblast.errors import InputError
from pyblast.inference.gauss_newton import LeastSquares, gauss_newton
from pyblast.signals.seismogram import fast_length

REACH = 4.0  # standard deviations of the prior, range of the grid search
TURN = 0.5  # rad of the mean frequency, step of the grid search
CONVERGED = 1e-4  # rad of the mean frequency: smaller changes end the rounds
LEAST_STEP = 1e-7  # rad of the mean frequency, or of a scale: smaller steps end the search
DAMPING = 1e-3  # of the largest diagonal element of the Hessian, at first
ROUNDS, SWEEPS, STEPS = 6, 12, 30  # at most
BANDS = 4
FAINTEST = 1e-20  # of the energy of the record: noise below this is rounding


@dataclass(frozen=True, eq=False)
class HoleFit:
    """Fit problem of a blast; motion is (n_receivers, n_components, n_recorded).

    Values are the deviations of all holes from their planned times in s, then all scales.

    Parameters
    ----------
    spectra : (n_holes, n_receivers, n_components, n_frequencies) complex128
    turns : (n_frequencies,) complex128, rad/s
        i times the angular frequency.
    recorded : (n_receivers, n_components, n_recorded) float64
    nominal : (n_holes,) float64, s
    precision : (2 n_holes,) float64
        Prior inverse variances of the values.
    mean_frequency : (n_holes,) float64, rad/s
        Mean angular frequency of each hole.
    size : int
        Length of the transform with zero padding.
    whiten : callable or None
    shape : tuple of int
        Original shape of the record, for the operator.
    """

    spectra: np.ndarray
    turns: np.ndarray
    recorded: np.ndarray
    nominal: np.ndarray
    precision: np.ndarray
    mean_frequency: np.ndarray
    size: int
    whiten: Callable | None
    shape: tuple[int, ...]

    def whitened(self, motion: np.ndarray) -> np.ndarray:
        """Return whitened motion."""
        if self.whiten is None:
            return motion
        return np.asarray(self.whiten(motion.reshape(self.shape))).reshape(motion.shape)

    def motion(self, hole: int, delay: float, rate: bool = False) -> np.ndarray:
        """Return the motion of one hole, or its derivative by time."""
        spectrum = np.exp(-self.turns * (self.nominal[hole] + delay)) * self.spectra[hole]
        if rate:
            spectrum *= -self.turns
        moved = np.asarray(fft.irfft(spectrum, self.size, overwrite_x=True))
        return moved[..., : self.recorded.shape[-1]]

    def residual(self, values: np.ndarray) -> np.ndarray:
        """Return the whitened residual."""
        n_holes = len(self.nominal)
        spectrum = sum(
            scale * np.exp(-self.turns * (time + delay)) * hole
            for hole, time, delay, scale in zip(
                self.spectra, self.nominal, values[:n_holes], values[n_holes:], strict=True
            )
        )
        motion = np.asarray(fft.irfft(spectrum, self.size))[..., : self.recorded.shape[-1]]
        return self.whitened(self.recorded - motion)

    def derivatives(self, values: np.ndarray) -> np.ndarray:
        """Return the Jacobian of the whitened motion, (2 n_holes, ...)."""
        n_holes = len(self.nominal)
        by_time = [
            values[n_holes + hole] * self.whitened(self.motion(hole, values[hole], rate=True))
            for hole in range(n_holes)
        ]
        by_scale = [self.whitened(self.motion(hole, values[hole])) for hole in range(n_holes)]
        return np.stack([*by_time, *by_scale])

    @property
    def prior(self) -> np.ndarray:
        """Planned values."""
        return np.repeat([0.0, 1.0], len(self.nominal))


def estimated(fit: HoleFit) -> tuple[np.ndarray, float, float]:
    """Return the best values, the noise variance and its inflation; theory.md (13.1), (13.2).

    The initial noise variance is that of the residual of the plan, so that the prior dominates at
    first.
    """
    values, n_holes = fit.prior, len(fit.nominal)
    variance, inflation = float(np.mean(fit.residual(values) ** 2)), 1.0
    for _ in range(ROUNDS):
        variance = max(variance, FAINTEST * float(np.mean(fit.whitened(fit.recorded) ** 2)))
        updated = adjusted(fit, grid_search(fit, values, variance), variance)
        moved = np.abs(updated - values)[:n_holes].max()
        values = updated
        variance, inflation = noise_variance(fit, values)
        if moved < CONVERGED / fit.mean_frequency.max():
            break
    return values, variance, inflation


def grid_search(fit: HoleFit, values: np.ndarray, variance: float) -> np.ndarray:
    """Grid search of the time of each hole in turn, with its best scale, until none moves."""
    values, n_holes = values.copy(), len(fit.nominal)
    residual = fit.residual(values)
    for _ in range(SWEEPS):
        before = values[:n_holes].copy()
        for hole in range(n_holes):
            motion = fit.whitened(fit.motion(hole, values[hole]))
            alone = residual + values[n_holes + hole] * motion
            delay, scale, motion = _best_alone(fit, hole, values[hole], alone, variance)
            values[hole], values[n_holes + hole] = delay, scale
            residual = alone - scale * motion
        if (values[:n_holes] == before).all():
            break
    return values


def _best_alone(fit, hole, now, alone, variance):
    """Return delay, scale and whitened motion of one hole with the smallest residual."""
    sure_time, sure_scale = fit.precision[[hole, len(fit.nominal) + hole]]
    reach, step = REACH / np.sqrt(sure_time), TURN / fit.mean_frequency[hole]
    around = step * np.arange(1, int(np.ceil(reach / step)) + 1)
    most, best = -np.inf, (now, 0.0, np.zeros_like(alone))
    for delay in (now, 0.0, *around, *-around):
        motion = fit.whitened(fit.motion(hole, delay))
        likeness = np.vdot(motion, alone) / variance + sure_scale
        weight = np.vdot(motion, motion) / variance + sure_scale
        scale = max(likeness, 0.0) / weight
        gain = scale * likeness - sure_time * delay**2
        if gain > most:
            most, best = gain, (delay, scale, motion)
    return best


def adjusted(fit: HoleFit, values: np.ndarray, variance: float) -> np.ndarray:
    """Minimise over all times and scales by damped Gauss-Newton; theory.md (13.1)."""
    rows = fit.derivatives(values).reshape(len(values), -1)
    unit = np.sqrt(np.sum(rows**2, axis=1) / variance + fit.precision)  # of the Hessian's diagonal
    phase = np.append(fit.mean_frequency, np.ones(len(fit.nominal))) / unit

    def residual(x):
        white = fit.residual(x / unit)
        return white.reshape(len(white), -1) / np.sqrt(variance)

    def jacobian(x, _):
        rows = fit.derivatives(x / unit) / -np.sqrt(variance)
        return rows.reshape(len(x), len(rows[0]), -1) / unit[:, None, None]

    problem = LeastSquares(
        residual, jacobian, mean=fit.prior * unit, precision=fit.precision / unit**2
    )
    start = values * unit
    end = gauss_newton(
        problem, start, residual(start), rounds=STEPS, damping=DAMPING,
        converged=lambda step, *_: np.abs(step * phase).max() < LEAST_STEP,
    )  # fmt: skip
    return end.x / unit


def noise_variance(fit: HoleFit, values: np.ndarray) -> tuple[float, float]:
    """Return the noise variance and its inflation; theory.md (13.2).

    Mean square of the residual, times the variance of the gradient of the misfit between receivers
    and between bands over that of independent samples: coloured noise differs between receivers,
    errors of the waveforms of holes are common to receivers but differ between bands.
    """
    residual = fit.residual(values)
    variance, n_receivers = np.mean(residual**2), len(residual)
    rows = fit.derivatives(values).reshape(len(values), n_receivers, -1)
    parts = _by_receiver_and_band(rows, residual.reshape(n_receivers, -1)) / variance
    known = np.einsum("prn,qrn->pq", rows, rows) / variance
    solved = np.linalg.inv(known + np.diag(fit.precision))

    def excess(slopes):
        """Return the variance of slopes (n_values, n) over that of independent samples."""
        count = slopes.shape[1]
        if count < 2:
            return 0.0
        slopes = slopes - slopes.mean(axis=1, keepdims=True)
        spread = slopes @ slopes.T * count / (count - 1)
        return float(np.sum(solved * spread) / np.sum(solved * known))

    receivers, bands, both = (
        excess(part)
        for part in (parts.sum(axis=2), parts.sum(axis=1), parts.reshape(len(parts), -1))
    )
    inflation = max(1.0, receivers, receivers + bands - both)
    return float(variance * inflation), inflation


def _by_receiver_and_band(rows, residual):
    """Split the derivatives of the misfit, (n_values, n_receivers, BANDS) of equal weight."""
    size = fast_length(rows.shape[-1])
    derivative, spectrum = (np.asarray(fft.rfft(each, size)) for each in (rows, residual))
    power = np.cumsum(np.sum(np.abs(derivative) ** 2, axis=(0, 1)))
    band = np.minimum((BANDS * power / power[-1]).astype(int), BANDS - 1)
    product = np.real(derivative.conj() * spectrum) * (2.0 / size)
    return np.stack([product[..., band == k].sum(axis=-1) for k in range(BANDS)], axis=-1)


def hole_fit(
    greens: np.ndarray,
    recorded: np.ndarray,
    dt: float,
    nominal: np.ndarray,
    spread: np.ndarray,
    whiten: Callable | None,
) -> HoleFit:
    """Return the fit problem; arguments as checked by `firing_times`."""
    n_holes, n_receivers, n = len(nominal), len(recorded), recorded.shape[-1]
    reach = int(np.ceil(REACH * spread[:n_holes].max() / dt))
    size = fast_length(n + greens.shape[-1] + 2 * reach)
    spectra = np.asarray(fft.rfft(greens.reshape(n_holes, n_receivers, -1, greens.shape[-1]), size))
    turns = 2j * np.pi * fft.rfftfreq(size, dt)
    power = np.sum(np.abs(spectra) ** 2, axis=(1, 2))
    mean_frequency = np.sqrt(power @ np.abs(turns) ** 2 / power.sum(axis=1))
    return HoleFit(
        spectra, turns, recorded.reshape(n_receivers, -1, n), nominal, spread**-2.0,
        mean_frequency, size,
        whiten, recorded.shape,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class FiringTimes:
    """Estimated firing times and scales, with covariance.

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
    inflation : float
        Inflation of the noise variance over that of independent samples.
    """

    times: np.ndarray
    scales: np.ndarray
    covariance: np.ndarray
    nominal: np.ndarray
    misfit_before: float
    misfit_after: float
    inflation: float

    @property
    def firing(self) -> Firing:
        """Times and scales, ready to be superposed."""
        return Firing(self.times, self.scales)

    def intervals(self, share: float = 0.90) -> np.ndarray:
        """Return intervals (n_holes, 2) of the times in s that hold each with this probability."""
        return self._around(self.times, slice(0, len(self.times)), share)

    def scale_intervals(self, share: float = 0.90) -> np.ndarray:
        """Return intervals (n_holes, 2) of the scales that hold each with this probability."""
        return self._around(self.scales, slice(len(self.times), None), share)

    def _around(self, values, part, share):
        """Return normal intervals around values, of this part of the covariance."""
        if not 0.0 < share < 1.0:
            raise InputError(f"firing times: share must lie between 0 and 1, got {share:g}")
        half = norm.ppf(0.5 + 0.5 * share) * np.sqrt(np.diag(self.covariance)[part])
        return np.column_stack([values - half, values + half])


def firing_times(
    greens: ArrayLike,
    recorded: ArrayLike,
    dt: float,
    nominal: ArrayLike,
    *,
    sigma: ArrayLike,
    scale_sigma: ArrayLike = 0.3,
    whiten: Callable | None = None,
) -> FiringTimes:
    """Estimate firing times and scales of holes from records of their blast.

    Parameters
    ----------
    greens : (n_holes, n_receivers, n_components, n_samples) or (n_holes, n_receivers, n_samples)
        Motion of each hole with scale 1 from its firing, in the unit of the record.
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
    Least squares with a Gaussian prior, theory.md (13.1); the noise variance is that of the
    residual, inflated by theory.md (13.2) for coloured noise and for differences between the
    waveforms of holes.
    """
    fit = hole_fit(*_checked(greens, recorded, dt, nominal, sigma, scale_sigma), whiten)
    values, variance, inflation = estimated(fit)
    rows = fit.derivatives(values).reshape(len(values), -1)
    covariance = np.linalg.inv(rows @ rows.T / variance + np.diag(fit.precision))
    planned = np.sum(fit.residual(fit.prior) ** 2)
    after, total = np.sum(fit.residual(values) ** 2), np.sum(fit.whitened(fit.recorded) ** 2)
    n_holes = len(fit.nominal)
    return FiringTimes(
        fit.nominal + values[:n_holes], values[n_holes:], covariance, fit.nominal,
        float(planned / total), float(after / total), inflation,
    )  # fmt: skip


def _checked(greens, recorded, dt, nominal, sigma, scale_sigma):
    """Return checked arrays, with the standard deviations of times and scales joined."""
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
    spreads = [np.broadcast_to(spread, nominal.shape) for spread in (sigma, scale_sigma)]
    for name, spread in zip(("sigma", "scale_sigma"), spreads, strict=True):
        if not ((spread > 0.0) & np.isfinite(spread)).all():
            raise InputError(f"firing_times.{name}: must be positive, got {spread.min():g}")
    silent = np.flatnonzero(~(greens**2).reshape(n_holes, -1).any(axis=1))
    if len(silent):
        raise InputError(f"firing_times.greens: hole {silent[0]} moves no receiver; leave it out")
    return greens, recorded, dt, nominal, np.concatenate(spreads)
