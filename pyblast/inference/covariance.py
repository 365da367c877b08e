"""Covariance of residuals: noise and model error of each record."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.linalg import lapack

from .nuisances import scattering
from .records import Band, Noise, Records


def applied(blocks, numbers):
    """Return numbers (..., n_blasts, n_receivers, n) by the matrix of each blast and receiver."""
    flat = numbers.reshape(-1, *numbers.shape[-3:]).transpose(1, 2, 0, 3)
    return (flat @ blocks.swapaxes(-1, -2)).transpose(2, 0, 1, 3).reshape(numbers.shape)


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
    paths : (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, (m/s)2, optional
        At a level of one: what varies from hole to hole at each receiver.
    """

    noise: np.ndarray
    scatter: np.ndarray
    coda: np.ndarray
    energy: np.ndarray
    noise_energy: np.ndarray
    paths: np.ndarray | None = None

    def roots(
        self, scatter: float, coda: float, holes: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what whitens each record at levels, and the log determinant of its covariance.

        Parameters
        ----------
        scatter, coda : float
            Levels, in shares of the energy of each channel.
        holes : float
            Level of what varies from hole to hole, log amplitude.

        Returns
        -------
        (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, s/m
            Inverse Cholesky factors; see `applied`.
        (n_blasts, n_receivers) float64
        """
        roots = np.linalg.cholesky(self._total(scatter, coda, holes))
        logarithm = 2.0 * np.sum(np.log(np.diagonal(roots, axis1=-2, axis2=-1)), axis=-1)
        return _inverse(roots), logarithm

    def of(self, blasts: Sequence[int], receivers: Sequence[int]) -> "RecordBlocks":
        """Return the covariance of the records of some blasts at some receivers."""
        part = np.ix_(blasts, receivers)
        chosen = (getattr(self, each.name) for each in fields(self))
        return RecordBlocks(*(None if own is None else own[part] for own in chosen))

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
        """Draw errors (n, n_blasts, n_receivers, 3 n_functions), m/s, at levels as of `roots`."""
        roots = np.linalg.cholesky(self._total(*shares))
        return applied(roots, rng.standard_normal((n, *roots.shape[:3])))

    def _total(self, scatter, coda, holes=0.0):
        """Return the covariance of each record, of the shape of the noise."""
        n = self.scatter.shape[-1]
        errors = scatter * self.scatter + coda * self.coda
        total = self.noise.copy()
        if holes and self.paths is not None:
            total += holes**2 * self.paths
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
    held, recorded = band.project(motion), band.project(records.motion)
    noise, energy = noise_blocks(records.noise, band, motion.shape[0]), np.sum(held**2, axis=-1)
    power = np.diagonal(noise, axis1=-2, axis2=-1)
    return RecordBlocks(
        noise + np.where(power > 0.0, 0.0, 1.0)[..., None] * np.eye(power.shape[-1]),
        _of_energy(scattering(motion, band), energy),
        _of_energy(scattering(motion, band, MEMORY), energy),
        np.sum(recorded**2, axis=(-2, -1)),
        np.sum(power, axis=-1),
    )


def noise_blocks(noise: Noise, band: Band, n_blasts: int) -> np.ndarray:
    """Return the covariance of the noise of each record, (m/s)2.

    (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64; zero where functions are lost.
    """
    shape = n_blasts, len(noise.variance)
    return np.array([
        [noise.covariance(band, b, r) for r in range(shape[1])] for b in range(shape[0])
    ])  # fmt: skip


def _inverse(roots):
    """Return the inverses of lower triangular matrices (n_blasts, n_receivers, n, n)."""
    inverse = np.empty_like(roots)
    for index in np.ndindex(roots.shape[:2]):
        inverse[index] = lapack.dtrtri(roots[index].T, lower=0)[0].T  # as Fortran stores them
    return inverse


def _of_energy(blocks, energy):
    """Return covariances of channels with an energy."""
    trace = np.trace(blocks, axis1=-2, axis2=-1)
    return blocks * (energy / np.maximum(trace, np.finfo(float).tiny))[..., None, None]
