"""Covariance of residuals: noise and model error, with inferred levels, and its whitening."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from ..errors import InputError
from .nuisances import Nuisances, mesh_columns, nuisances, scattering
from .records import Band, Noise, Records, symmetric_root

SCATTER = "scatter"
LEVELS = {
    "delay": 1e-3,
    "gain": 0.05,
    "receiver": 0.05,
    "rotation": 0.05,
    "source": 0.05,
    "mesh": 1.0,
    SCATTER: 0.1,
}


@dataclass(frozen=True, eq=False)
class Whitener:
    """Covariance of residuals: noise, scattering and nuisance columns; built by `whitener`.

    Parameters
    ----------
    band : Band
    turns : (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, s/m
        From the coefficients of a blast and receiver to a basis with white noise and uncorrelated
        scattering.
    backs : the same shape
        Orthogonal, from this basis back to the coefficients.
    spread : (n_blasts, n_receivers, 3 n_functions) float64
        Variances of scattering at level one.
    columns : (n_columns, n_data) float64
        Of the nuisances at level one, in the turned basis.
    groups : tuple of n_columns str
    levels : dict of str to float
        Standard deviation of each group, and of ``scatter``.
    n_data_each : (n_blasts, n_receivers) int
        Coefficients of each record that carry data; fewer where samples are invalid.
    """

    band: Band
    turns: np.ndarray
    backs: np.ndarray
    spread: np.ndarray
    columns: np.ndarray
    groups: tuple[str, ...]
    levels: dict[str, float]
    n_data_each: np.ndarray

    def __post_init__(self):
        """Check that each group has a level."""
        wanted = set(self.groups) | ({SCATTER} if np.any(self.spread) else set())
        if set(self.levels) != wanted:
            raise InputError(
                f"whitener.levels: need those of {', '.join(sorted(wanted)) or 'nothing'}, got "
                f"{', '.join(sorted(self.levels)) or 'nothing'}"
            )
        for name, level in self.levels.items():
            if not 0.0 <= level < math.inf:
                raise InputError(f"whitener.levels.{name}: must be finite, not negative: {level:g}")

    @property
    def n_data(self) -> int:
        """Number of coefficients that carry data."""
        return int(np.sum(self.n_data_each))

    @property
    def deviation(self):
        """Standard deviation of noise and scattering in the turned basis, (n_data,)."""
        return np.sqrt(1.0 + self.levels.get(SCATTER, 0.0) ** 2 * self.spread.ravel())

    @cached_property
    def roots(self) -> np.ndarray:
        """Inverse roots of the covariance of noise and scattering of each record.

        (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, s/m; symmetric. Zero where
        functions are lost.
        """
        deviation = self.deviation.reshape(self.spread.shape)
        return self.backs @ (self.turns / deviation[..., None])

    @cached_property
    def noise_share(self) -> np.ndarray:
        """Mean square of whitened noise alone in each record, (n_blasts, n_receivers)."""
        variance = self.deviation.reshape(self.spread.shape) ** -2.0
        lost = self.spread.shape[-1] - self.n_data_each
        return (np.sum(variance, axis=-1) - lost) / np.maximum(self.n_data_each, 1)

    @cached_property
    def _directions(self):
        """Eigenvectors of the nuisance columns, their eigenvalues, and the mixing matrix."""
        scale = np.array([self.levels[group] for group in self.groups])
        columns = self.columns * scale[:, None] / self.deviation
        strength, mixture = linalg.eigh(columns @ columns.T)
        return mixture.T @ columns, np.maximum(strength, 0.0), mixture

    def turned(self, residual):
        """Return a residual (..., n_blasts, n_receivers, 3, n_samples) in the turned basis.

        (..., n_data): noise is white, scattering uncorrelated; nuisances are still included.
        """
        held = self.band.project(residual)
        held = held.reshape(*held.shape[:-2], -1)
        return _each(self.turns, held).reshape(*held.shape[:-3], -1)

    def apply(self, residual):
        """Whiten a residual.

        Parameters
        ----------
        residual : (..., n_blasts, n_receivers, 3, n_samples) float, m/s

        Returns
        -------
        (..., n_blasts, n_receivers, 3, n_functions) float64
            Independent, of unit variance if the covariance is right; their sum of squares is
            ``r^T C^-1 r``. `Band.restore` returns them as a time series.

        Notes
        -----
        ``(I + U U^T)^(-1/2)`` after whitening noise and scattering, with symmetric roots, which
        shift the data least in time; theory.md (7.17).
        """
        if not len(self.columns):
            held = self.band.project(residual)
            white = _each(self.roots, held.reshape(*held.shape[:-2], -1))
            return white.reshape(held.shape)
        plain = self.turned(residual) / self.deviation
        direction, strength, _ = self._directions
        # (1 + s)^(-1/2) - 1 over s, without loss of digits at small s
        gain = -1.0 / (np.sqrt(1.0 + strength) * (1.0 + np.sqrt(1.0 + strength)))
        plain = plain + (plain @ direction.T * gain) @ direction
        shape = (*plain.shape[:-1], *self.spread.shape)
        plain = _each(self.backs, plain.reshape(shape))
        return plain.reshape(*shape[:-1], 3, -1)

    def chi_square(self, residual):
        """Return chi-square ``r^T C^-1 r``, (...) float64; its mean is ``n_data``."""
        plain = self.turned(residual) / self.deviation
        direction, strength, _ = self._directions
        along = plain @ direction.T
        return np.sum(plain**2, axis=-1) - np.sum(along**2 / (1.0 + strength), axis=-1)


def whitener(
    noise: Noise,
    band: Band,
    n_blasts: int,
    *,
    nuisances: Nuisances | None = None,
    scattering: np.ndarray | None = None,
    levels: dict[str, float] | None = None,
) -> Whitener:
    """Build the covariance of residuals from its parts.

    Parameters
    ----------
    noise : Noise
    band : Band
    n_blasts : int
    nuisances : Nuisances, optional
    scattering : (n_blasts, n_receivers, 3, n_functions, n_functions) float, optional
        As of `scattering`.
    levels : dict of str to float, optional
        Standard deviation of each group of nuisances, and ``scatter``; default ``LEVELS``: 1 ms,
        5 % and 0.05 rad, 10 % scattered, the whole mesh error.

    Raises
    ------
    InputError
        If a level is missing, unknown or negative.
    """
    n_receivers, size = len(noise.variance), 3 * band.n_functions
    turns = np.empty((n_blasts, n_receivers, size, size))
    backs, spread = np.empty_like(turns), np.zeros(turns.shape[:3])
    whole = {}
    n_data = np.zeros((n_blasts, n_receivers), dtype=int)
    for b, r in np.ndindex(n_blasts, n_receivers):
        gapped = any((b, r, c) in band.gapped for c in range(3))
        if gapped or r not in whole:
            block = noise.covariance(band, b, r)
            root, rank = symmetric_root(block, -0.5), np.count_nonzero(np.diag(block) > 0.0)
            if not gapped:
                whole[r] = root, rank
        else:
            root, rank = whole[r]
        n_data[b, r] = rank
        turns[b, r], backs[b, r] = root, np.eye(size)
        if scattering is not None:
            block = linalg.block_diag(*scattering[b, r])
            spread[b, r], vector = linalg.eigh(root @ block @ root)
            turns[b, r], backs[b, r] = vector.T @ root, vector
    turned, groups = np.zeros((0, spread.size)), ()
    if nuisances is not None:
        held = nuisances.columns.reshape(-1, n_blasts, n_receivers, size)
        turned = _each(turns, held).reshape(len(held), -1)
        groups = nuisances.groups
    spread = np.maximum(spread, 0.0)
    used = {*groups, *([] if scattering is None else [SCATTER])}
    levels = {name: LEVELS[name] for name in LEVELS if name in used} | (levels or {})
    if scattering is not None and not spread.any():  # no record exceeds its noise
        del levels[SCATTER]
    return Whitener(band, turns, backs, spread, turned, groups, levels, n_data)


def _each(blocks, numbers):
    """Apply the matrix of each blast and receiver to numbers (..., n_blasts, n_receivers, n)."""
    flat = numbers.reshape(-1, *numbers.shape[-3:])
    return (blocks @ flat.transpose(1, 2, 3, 0)).transpose(3, 0, 1, 2).reshape(numbers.shape)


def error_columns(motion, band: Band, mesh_errors=()) -> Nuisances:
    """Return the nuisance columns of a motion, mesh error included."""
    parts = nuisances(motion, band)
    if len(mesh_errors):
        errors = np.asarray(mesh_errors, dtype=np.float64)
        alone = np.eye(errors.shape[2])[:, None, None, :, None, None] * errors
        alone = alone.reshape(-1, *errors.shape[1:])
        parts += mesh_columns(alone[np.any(alone, axis=(1, 2, 3, 4))], band)
    return parts


MEMORY = 0.2  # s, decay time of the power of a coda


@dataclass(frozen=True, eq=False)
class RecordBlocks:
    """Covariance of the errors of each record by levels: noise, scattering, coda.

    Parameters
    ----------
    noise : (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, (m/s)2
        One on the diagonal where a function is lost.
    scatter, coda : (n_blasts, n_receivers, 3, n_functions, n_functions) float64, (m/s)2
        At a level of one: with the energy of the simulated motion of each channel.
    energy : (n_blasts, n_receivers) float64, (m/s)2
        Of the records.
    noise_energy : the same shape
        Expected of their noise.
    """

    noise: np.ndarray
    scatter: np.ndarray
    coda: np.ndarray
    energy: np.ndarray
    noise_energy: np.ndarray

    def whiten(self, rows, scatter: float, coda: float) -> tuple[np.ndarray, float]:
        """Return rows (k, n_blasts, n_receivers, 3 n_functions) whitened, and the log determinant.

        Parameters
        ----------
        rows : array
        scatter, coda : float
            Levels, in shares of the energy of each channel.
        """
        roots = np.linalg.cholesky(self._total(scatter, coda))
        logarithm = 2.0 * np.sum(np.log(np.diagonal(roots, axis1=-2, axis2=-1)))
        return _each(np.linalg.inv(roots), rows), float(logarithm)

    def of(self, blasts: Sequence[int]) -> "RecordBlocks":
        """Return the covariance of the records of some blasts."""
        parts = (getattr(self, each.name)[list(blasts)] for each in fields(self))
        return RecordBlocks(*parts)

    def beside(self, change, band: Band, share: float) -> "RecordBlocks":
        """Return the covariance with an error of a change of motion, a share of its energy.

        Parameters
        ----------
        change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        band : Band
        share : float
        """
        errors = _of_energy(scattering(change, band), np.sum(band.project(change) ** 2, axis=-1))
        n, noise = errors.shape[-1], self.noise.copy()
        for c in range(3):
            each = slice(c * n, (c + 1) * n)
            noise[..., each, each] += share * errors[:, :, c]
        return replace(self, noise=noise)

    def draws(self, rng: np.random.Generator, n: int, *shares: float) -> np.ndarray:
        """Draw errors (n, n_blasts, n_receivers, 3 n_functions), m/s, at levels as of `whiten`."""
        roots = np.linalg.cholesky(self._total(*shares))
        return _each(roots, rng.standard_normal((n, *roots.shape[:3])))

    def _total(self, scatter, coda):
        """Return the covariance of each record, of the shape of the noise."""
        n = self.scatter.shape[-1]
        errors = scatter * self.scatter + coda * self.coda
        total = self.noise.copy()
        for c in range(3):
            each = slice(c * n, (c + 1) * n)
            total[..., each, each] += errors[:, :, c]
        return total

    def above_noise(self, remaining) -> np.ndarray:
        """Return the share of the energy of each record that remains above its noise."""
        energy = np.sum(np.asarray(remaining) ** 2, axis=(-2, -1)) - self.noise_energy
        return np.maximum(energy, 0.0) / np.maximum(self.energy, np.finfo(float).tiny)


def record_blocks(records: Records, motion) -> RecordBlocks:
    """Build the covariance of the errors of each record around a simulation.

    Parameters
    ----------
    records : Records
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s

    Notes
    -----
    theory.md (7.11), (7.16), (12.5).
    """
    band = records.band
    shape, size = records.motion.shape[:2], 3 * band.n_functions
    noise = np.array([records.noise.covariance(band, b, r) for b, r in np.ndindex(shape)])
    noise = noise.reshape(*shape, size, size)
    power = np.diagonal(noise, axis1=-2, axis2=-1)
    lost = np.where(power > 0.0, 0.0, 1.0)
    held, recorded = band.project(motion), band.project(records.motion)
    energy = np.sum(held**2, axis=-1)
    return RecordBlocks(
        noise + lost[..., None] * np.eye(size),
        _of_energy(scattering(motion, band), energy),
        _of_energy(scattering(motion, band, MEMORY), energy),
        np.sum(recorded**2, axis=(-2, -1)),
        np.sum(power, axis=-1),
    )


def _of_energy(blocks, energy):
    """Return covariances of channels with an energy."""
    trace = np.trace(blocks, axis1=-2, axis2=-1)
    return blocks * (energy / np.maximum(trace, np.finfo(float).tiny))[..., None, None]
