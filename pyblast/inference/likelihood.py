"""Likelihood of records: Gaussian and Student-t densities over one covariance."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy import signal
from scipy.special import logsumexp

from .covariance import SCATTER, Whitener, infer_levels, usual_whitener, whitener
from .records import Records

ENERGY_SHARE = 0.01  # of a record's energy: positions, clocks and small heterogeneity
MESH_SHARE = 0.28  # of the energy that a finer mesh changes: its own error
DOUBT = 4.0  # degrees of freedom behind these shares: they may well be three times as large
LARGER = np.geomspace(1.0, 100.0, 41)  # factors on the energy of all errors


class ModelError(Protocol):
    """What a model of the ground has wrong, as a covariance of motion beside the noise."""

    def covariance(self, records: Records, simulated=None, mesh_changes=()) -> Whitener:
        """Return the covariance of noise and model error in records.

        Parameters
        ----------
        records : Records
        simulated : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
            A simulation that nearly fits; the records themselves by default.
        mesh_changes : sequence of the same shape, m/s
            What other meshes change.
        """
        ...


@dataclass(frozen=True)
class EnergyShares:
    """Model error that is white in each record, its energy a share of what is recorded.

    Independent of a simulation, and between records, so that residuals can be permuted between
    receivers. The level is fixed: theory.md (14.1).

    Parameters
    ----------
    energy : float
        Of the energy of a record above its noise.
    mesh : float
        Of the energy that a finer mesh changes.
    """

    energy: float = ENERGY_SHARE
    mesh: float = MESH_SHARE

    def covariance(self, records, simulated=None, mesh_changes=()) -> Whitener:
        """Return the covariance of noise and model error; see `ModelError`."""
        band, motion = records.band, records.motion if simulated is None else simulated
        held = band.project(motion)
        changed = sum((band.project(one) ** 2 for one in mesh_changes), np.zeros_like(held))
        blocks = np.zeros((*held.shape, band.n_functions))
        for b, r in np.ndindex(held.shape[:2]):
            noise = np.diag(records.noise.covariance(band, b, r)).reshape(held.shape[2:])
            energy = max(np.sum(held[b, r] ** 2) - np.sum(noise), 0.0)
            error = self.energy * energy + self.mesh * np.sum(changed[b, r])
            share = error / max(1, np.count_nonzero(noise))
            blocks[b, r] = np.where(noise > 0.0, share, 0.0)[..., None] * np.eye(band.n_functions)
        return whitener(records.noise, band, len(held), scattering=blocks, levels={SCATTER: 1.0})


@dataclass(frozen=True)
class InferredLevels:
    """Model error as delays, gains, rotations, source spectra, scattering and mesh error.

    Shaped by a simulation, with levels inferred from its residual: theory.md (7.13) to (7.19).
    Shaped by the records, the levels are those of reference.

    Parameters
    ----------
    fitted : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        Changes by one prior standard deviation of each parameter that was fitted to the records.
    """

    fitted: np.ndarray | tuple = field(default=())

    def covariance(self, records, simulated=None, mesh_changes=()) -> Whitener:
        """Return the covariance of noise and model error; see `ModelError`."""
        motion = records.motion if simulated is None else simulated
        shaped = usual_whitener(motion, records.noise, records.band, mesh_changes)
        if simulated is None:
            return shaped
        return infer_levels(shaped, records.motion - simulated, fitted=self.fitted).whitener


class Counts(NamedTuple):
    """How many numbers each record holds, (n_blasts, n_receivers)."""

    data: np.ndarray
    effective: np.ndarray


@dataclass(frozen=True)
class Gaussian:
    """Normal density: the covariance is known."""

    def misfit(self, chi_square, counts: Counts):
        """Return -2 ln L of each record, but for a constant."""
        return counts.data * chi_square

    def weights(self, chi_square, counts: Counts):
        """Return the weights of squares that give the gradient of the misfit."""
        return np.minimum(counts.data, np.ones_like(chi_square))


@dataclass(frozen=True)
class StudentT:
    """Student's density of each record: the size of its errors is uncertain, theory.md (14.1).

    Parameters
    ----------
    degrees : float
        Of freedom.
    """

    degrees: float = DOUBT

    def misfit(self, chi_square, counts: Counts):
        """Return -2 ln L of each record, but for a constant."""
        n, degrees = counts.effective, self.degrees
        return (n + degrees) * np.log1p(n * chi_square / degrees)

    def weights(self, chi_square, counts: Counts):
        """Return the weights of squares that give the gradient of the misfit."""
        n, degrees = counts.effective, self.degrees
        return n / np.maximum(counts.data, 1) * (n + degrees) / (degrees + n * chi_square)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Density of the residuals of records.

    Parameters
    ----------
    records : Records
    covariance : Whitener
        Of noise and model error.
    density : Gaussian or StudentT
    """

    records: Records
    covariance: Whitener
    density: Gaussian | StudentT

    @property
    def n_data(self) -> np.ndarray:
        """Coefficients of each record that carry data, (n_blasts, n_receivers)."""
        return self.covariance.n_data_each

    @cached_property
    def n_effective(self) -> np.ndarray:
        """Independent numbers in each record: duration times bandwidth, (n_blasts, n_receivers)."""
        band = self.records.band
        return effective_numbers(band.restore(band.project(self.records.motion)), self.records.dt)

    @property
    def _counts(self):
        """Coefficients and independent numbers of each record."""
        return Counts(self.n_data, self.n_effective)

    @property
    def noise_share(self) -> np.ndarray:
        """Mean square of whitened noise alone: its share of what is expected."""
        return self.covariance.noise_share

    def whiten(self, motion) -> np.ndarray:
        """Return whitened coefficients (..., n_blasts, n_receivers, m) of motion in m/s."""
        white = self.covariance.apply(motion)
        return white.reshape(*white.shape[:-2], -1)

    def residual(self, motion) -> np.ndarray:
        """Return the whitened records less a motion; see `whiten`."""
        return self.whiten(self.records.residual(motion))

    def chi_square(self, white) -> np.ndarray:
        """Return the reduced chi-square of each record, (..., n_blasts, n_receivers)."""
        return np.sum(white**2, axis=-1) / np.maximum(self.n_data, 1)

    def at_double_error(self, chi_square) -> np.ndarray:
        """Return reduced chi-squares as they are at twice the model error."""
        return chi_square / (self.noise_share + 4.0 * (1.0 - self.noise_share))

    def misfit(self, white, blasts=None):
        """Return -2 ln L of a whitened residual, of some blasts if indices are given."""
        return self.misfit_of(self.chi_square(white), blasts)

    def misfit_of(self, chi_square, blasts=None):
        """Return -2 ln L of reduced chi-squares (..., n_blasts, n_receivers)."""
        each = self.misfit_each(chi_square)
        return np.sum(each if blasts is None else each[..., list(blasts), :], axis=(-2, -1))

    def misfit_each(self, chi_square):
        """Return -2 ln L of each record of reduced chi-squares (..., n_blasts, n_receivers)."""
        return self.density.misfit(chi_square, self._counts)

    def weights(self, chi_square):
        """Return the weights of squared coefficients that give the gradient of -2 ln L."""
        return self.density.weights(chi_square, self._counts)

    def log_gain_of_larger_errors(self, chi_square) -> float:
        """Return the log Bayes factor of errors that are larger by one factor.

        Of all records, of one blast or of one receiver, each with a prior of one third, and each
        blast, receiver and factor of `LARGER` as likely as the others.
        """
        density, n = self.density, self.n_effective
        widened = [n * np.log(k) + density.misfit(chi_square / k, self._counts) for k in LARGER]
        each = np.where(self.n_data > 0, np.array(widened) - widened[0], 0.0)
        thirds = each.sum(axis=(1, 2)), each.sum(axis=2), each.sum(axis=1)
        return float(logsumexp([logsumexp(-0.5 * one) - np.log(3.0 * one.size) for one in thirds]))

    def excess(self, chi_square, blasts=None) -> float:
        """Return the sum of chi-squares above one: what noise and model error do not explain.

        Records below one do not make up for others.
        """
        each = np.maximum(chi_square - 1.0, 0.0)
        return float(np.sum(each if blasts is None else each[list(blasts)]))

    def explained_share(self, before, after, blasts=None) -> float:
        """Return the share of all excess that is gone with other chi-squares of some blasts."""
        total = self.excess(before)
        gone = self.excess(before, blasts) - self.excess(after, blasts)
        return gone / total if total > 0.0 else 0.0


def effective_numbers(motion, dt) -> np.ndarray:
    """Return the independent numbers (n_blasts, n_receivers) of records: 2 B T of each component.

    Bandwidth, duration and the number of components are those that a flat one would have with the
    same mean square: participation numbers.
    """
    power = np.sum(np.abs(np.fft.rfft(motion)) ** 2, axis=2)
    envelope = np.sum(np.abs(signal.hilbert(motion)) ** 2, axis=2)
    frequency = 1.0 / (motion.shape[-1] * dt)
    band = _participation(power) * frequency
    duration = _participation(envelope) * dt
    return 2.0 * band * duration * _participation(np.sum(motion**2, axis=-1))


def _participation(parts):
    """Return the participation number along the last axis."""
    squares = np.sum(parts**2, axis=-1)
    return np.divide(np.sum(parts, axis=-1) ** 2, squares, out=np.zeros_like(squares),
                     where=squares > 0.0)  # fmt: skip
