"""Noise of each channel, learnt from the windows before the blasts."""

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg, signal, stats

from ..errors import InputError
from .band import Band, band_functions

ORDER = 8
TIME_BANDWIDTH = 1.5
N_TAPERS = 2
REACH = 2.0
FLOOR = 0.02
SURE = 0.01
PADDING = 8


@dataclass(frozen=True, eq=False)
class Noise:
    """Stationary noise of each channel as an autoregression.

    Parameters
    ----------
    step : float, s
        Of the autoregression: half a period of twice the top of the band.
    coefficients : (n_receivers, 3, order) float64
    variance : (n_receivers, 3) float64, (m/s)2
        Of what the autoregression does not foresee, with ``doubt`` in it.
    correlation : (n_receivers, 3, 3) float64
        Between the components; the unit matrix where the windows do not speak against it.
    doubt : (n_receivers, 3) float64
        By which the variance was raised because few windows tell it.
    resolved : float, Hz
        One period to a window. Below, the density is held at what it is here.
    """

    step: float
    coefficients: np.ndarray
    variance: np.ndarray
    correlation: np.ndarray
    doubt: np.ndarray
    resolved: float

    def density(self, frequency):
        """Return the two-sided density at frequencies, (n_receivers, 3, n) (m/s)2/Hz."""
        order = np.arange(1, self.coefficients.shape[-1] + 1)
        turns = np.exp(-2j * np.pi * self.step * np.outer(order, frequency))
        reply = np.abs(1.0 - self.coefficients @ turns) ** 2
        return self.step * self.variance[..., None] / reply

    def covariance(self, band, blast, receiver):
        """Return the covariance of a receiver's coefficients in one blast.

        Parameters
        ----------
        band : Band
        blast, receiver : int

        Returns
        -------
        (3 n_functions, 3 n_functions) float64, (m/s)2
            With 2 % of its mean on the diagonal; zero where functions are lost.

        Notes
        -----
        ``sqrt(T_c) rho_cd sqrt(T_d)`` for components c and d; theory.md (7.11), (7.12).
        """
        n = band.n_functions
        root = np.zeros((3, n, n))
        n_padded = fft.next_fast_len(2 * len(band.basis), real=True)
        frequency = fft.rfftfreq(n_padded, band.dt)
        frequency = frequency[frequency <= 0.5 / self.step]
        power = 2.0 * self.density(frequency)[receiver] / (n_padded * band.dt)
        power[:, 0] /= 2.0
        for c in range(3):
            functions = band.functions((blast, receiver, c))
            kept = np.any(functions != 0.0, axis=0)
            waves = fft.rfft(functions, n_padded, axis=0)[: len(frequency)]
            toeplitz = np.real((waves.conj() * power[c][:, None]).T @ waves)
            level = np.trace(toeplitz) / max(1, np.count_nonzero(kept))
            root[c] = symmetric_root(toeplitz + FLOOR * level * np.diag(kept))
        block = np.einsum("cij,cd,dkj->cidk", root, self.correlation[receiver], root)
        return block.reshape(3 * n, 3 * n)


def noise_of(windows, dt, band) -> Noise:
    """Learn the noise of each channel from its windows before the blasts.

    Parameters
    ----------
    windows : (n_blasts, n_receivers, 3, n_samples) float, m/s
        Samples before anything arrives. A window that is not finite throughout is left out.
    dt : float, s
    band : tuple of 2 float, Hz

    Raises
    ------
    InputError
        If a channel has no window, or one that never moves, or windows are shorter than 16
        samples or than a period at the top of the band.

    Notes
    -----
    The multitaper spectra of all blasts are pooled and Levinson's recursion finds the
    autoregression of order 8 with their autocovariance at 4 times the top of the band;
    theory.md (7.10). A level from nu degrees of freedom is raised by ``nu / (nu - 2)``, so that
    what it whitens has unit variance in the mean.
    """
    windows = np.asarray(windows, dtype=float)
    if windows.ndim != 4 or windows.shape[2] != 3:
        raise InputError(
            "noise windows: must have shape (n_blasts, n_receivers, 3, n_samples), "
            f"got {windows.shape}"
        )
    n = windows.shape[-1]
    if n < 16 or n * dt * band[1] < 1.0:
        raise InputError(
            f"noise windows: need 16 samples and {1.0 / band[1]:g} s, got {n} and {n * dt:g} s"
        )
    windows = windows - windows.mean(axis=-1, keepdims=True)
    given = np.all(np.isfinite(windows), axis=-1)
    moving = given & np.any(windows != 0.0, axis=-1)
    if not np.all(moving.any(axis=0)):
        receiver, component = np.argwhere(~moving.any(axis=0))[0]
        raise InputError(
            f"noise windows: receiver {receiver}, component {component} has none that moves; "
            "leave the channel out"
        )
    windows = np.where(moving[..., None], windows, 0.0)
    freedom = 2.0 * N_TAPERS * np.count_nonzero(moving, axis=0)
    doubt = freedom / (freedom - 2.0)
    step = max(dt, 0.5 / (REACH * band[1]))
    coefficients, variance = _autoregression(windows, np.count_nonzero(moving, axis=0), dt, step)
    unmixed = np.broadcast_to(np.eye(3), (*variance.shape[:1], 3, 3))
    noise = Noise(step, coefficients, variance * doubt, unmixed, doubt, 1.0 / (n * dt))
    return _correlated(noise, windows, moving, band_functions(n, dt, band))


def _autoregression(windows, n_windows, dt, step):
    """Return coefficients (n_receivers, 3, order) and variance of pooled windows."""
    n = windows.shape[-1]
    tapers = signal.windows.dpss(n, TIME_BANDWIDTH, N_TAPERS)
    n_padded = fft.next_fast_len(PADDING * n, real=True)
    frequency = fft.rfftfreq(n_padded, dt)
    frequency = frequency[frequency <= 0.5 / step * (1.0 + 1e-9)]
    density = np.zeros((*n_windows.shape, len(frequency)))
    for taper in tapers:
        spectrum = fft.rfft(windows * taper, n_padded, axis=-1)[..., : len(frequency)]
        density += dt / N_TAPERS * np.sum(np.abs(spectrum) ** 2, axis=0) / n_windows[..., None]
    first = np.searchsorted(frequency, 1.0 / (n * dt))
    density[..., :first] = density[..., first : first + 1]
    weight = np.full(len(frequency), 2.0 / (n_padded * dt))
    weight[[0, -1]] /= 2.0
    lags = step * np.arange(ORDER + 1)
    covariance = (density * weight) @ np.cos(2.0 * np.pi * np.outer(frequency, lags))
    coefficients = np.empty((*n_windows.shape, ORDER))
    for channel in np.ndindex(n_windows.shape):
        lagged = covariance[channel]
        coefficients[channel] = linalg.solve_toeplitz(lagged[:-1], lagged[1:])
    variance = covariance[..., 0] - np.sum(coefficients * covariance[..., 1:], axis=-1)
    return coefficients, variance


def _correlated(noise, windows, moving, band: Band):
    """Keep the correlation between components where chance alone seldom makes it."""
    n = band.n_functions
    held = band.project(windows)
    correlation = np.array(noise.correlation)
    for receiver in range(windows.shape[1]):
        whole = moving[:, receiver].all(axis=-1)
        count = n * np.count_nonzero(whole)
        if count < 12:
            continue
        block = noise.covariance(band, 0, receiver)
        white = held[whole, receiver].reshape(-1, 3 * n) @ symmetric_root(block, -0.5)
        found = np.corrcoef(white.reshape(-1, 3, n).transpose(1, 0, 2).reshape(3, -1))
        spread = -(count - 1.0 - 11.0 / 6.0) * np.linalg.slogdet(found)[1]
        if stats.chi2.sf(spread, 3) < SURE:
            correlation[receiver] = found
    return Noise(
        noise.step, noise.coefficients, noise.variance, correlation, noise.doubt, noise.resolved
    )


def symmetric_root(matrix, power=0.5):
    """Return a power of a matrix that is positive definite but for rows and columns of zeros."""
    kept = np.flatnonzero(np.diag(matrix) > 0.0)
    value, vector = linalg.eigh(matrix[np.ix_(kept, kept)])
    root = np.zeros_like(matrix)
    root[np.ix_(kept, kept)] = (vector * value**power) @ vector.T
    return root
