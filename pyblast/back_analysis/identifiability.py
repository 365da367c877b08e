"""Identifiability of parameters: Fisher information, and strengths of joints that never slip."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..ground.tables import joint_of_surface
from ..inference.covariance import RecordBlocks, noise_blocks
from ..inference.error_model import NORMAL_95, Change, ErrorModel, Levels
from ..inference.misfits import signed_residuals
from ..inference.nuisances import SCATTER, design_nuisances, scattering
from ..inference.parameter import set_all
from ..inference.records import Band, Noise
from ..solver.slip import STRENGTH
from ..units import split_key

UNIFORM = 1.0 / np.sqrt(12.0)  # standard deviation of a uniform prior, as a share of its range
LEAST_SENSITIVITY = 0.1  # change of the data by a prior deviation, in units of their error
PEAK_ERRORS = (15.0, 10.0)  # %, of PPV and dominant frequency: what the paper calls a good fit
PEAK_STEP = 0.002  # of a range, for derivatives of peaks; with larger ones frequencies may jump


@dataclass(frozen=True, eq=False)
class FisherInformation:
    """Fisher information of data about n parameters with uniform priors.

    Parameters
    ----------
    matrix : (n, n) float64
        ``J^T J`` of whitened changes of the data by one prior standard deviation of each
        parameter; theory.md (12.3).
    """

    matrix: np.ndarray

    @property
    def covariance(self):
        """Posterior covariance of the parameters in prior standard deviations, (n, n)."""
        return np.linalg.inv(np.eye(len(self.matrix)) + self.matrix)

    @property
    def ratios(self):
        """Ratio of posterior to prior standard deviation of each parameter, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sensitive(self):
        """Whether the data are sensitive to each parameter alone, (n,) bool."""
        return np.sqrt(np.maximum(np.diag(self.matrix), 0.0)) >= LEAST_SENSITIVITY

    @property
    def log_determinant(self):
        """Log determinant of the posterior covariance: the criterion of D-optimal designs."""
        return -float(np.linalg.slogdet(np.eye(len(self.matrix)) + self.matrix)[1])

    def trade_offs(self, least=0.5) -> list[tuple[int, int, float]]:
        """Return pairs of parameters with their posterior correlation, strongest first."""
        ratio, covariance = self.ratios, self.covariance
        correlation = covariance / np.outer(ratio, ratio)
        rows, columns = np.triu_indices(len(ratio), 1)
        pairs = [(int(i), int(j), float(correlation[i, j])) for i, j in zip(rows, columns,
                 strict=True)]  # fmt: skip
        strong = [pair for pair in pairs if abs(pair[2]) >= least]
        return sorted(strong, key=lambda pair: -abs(pair[2]))


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Sensitivity of the motion at a point to the parameters.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    changes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By the whole range of each parameter.
    band : Band
    noise : Noise
        Of each receiver.
    levels : dict of str to float
        Of the model error, see `DESIGN_LEVELS`.
    peaks_only : bool
        Whether the data are PPV and dominant frequency instead of waveforms.
    mesh_errors : (n_errors, n_blasts, n_receivers, 3, n_samples) float64, m/s
        As of `design_nuisances`.
    """

    motion: np.ndarray
    changes: np.ndarray
    band: Band
    noise: Noise
    levels: dict[str, float]
    peaks_only: bool = False
    mesh_errors: np.ndarray | Sequence[np.ndarray] = ()

    @cached_property
    def _blocks(self):
        """Covariance of noise and scattered motion of all records."""
        noise = noise_blocks(self.noise, self.band, len(self.motion))
        spread, none = scattering(self.motion, self.band), np.zeros(self.motion.shape[:2])
        return RecordBlocks(noise, spread, 0.0 * spread, none, none)

    def information(self, blasts, receivers) -> FisherInformation:
        """Return the Fisher information of the records of some blasts at some receivers.

        Parameters
        ----------
        blasts, receivers : sequence of int

        Notes
        -----
        theory.md (12.3): the model error is that of (7.13), independent between receivers but for
        the source spectrum of a blast and the gain of a receiver.
        """
        blasts, receivers = list(blasts), list(receivers)
        part = np.ix_(blasts, receivers)
        motion = self.motion[part]
        if not np.any(motion):
            return FisherInformation(np.zeros((len(self.changes), len(self.changes))))
        if self.peaks_only:
            return self._of_peaks(receivers, motion, self.changes[:, *part])
        errors = [error[part] for error in self.mesh_errors]
        error = ErrorModel(
            self._blocks.of(blasts, receivers),
            design_nuisances(motion, self.band, errors, self.levels),
            Levels(scatter=(self.levels[SCATTER] ** 2,)),
        )
        changes = UNIFORM * self.band.project(self.changes[:, *part])
        return FisherInformation(error.scores(0.0 * changes[:1], [Change(changes)]).length[0])

    def _of_peaks(self, receivers, motion, changes):
        """Return the information of PPV and dominant frequency, with `PEAK_ERRORS` and noise."""
        band = self.band.low, self.band.high
        residuals = signed_residuals("paper", motion, self.band.dt, band=band)
        columns = np.array([residuals(motion + PEAK_STEP * change) for change in changes])
        columns /= PEAK_STEP
        frequency = np.linspace(self.band.low, self.band.high, 64)
        density = self.noise.density(frequency)[receivers].mean(axis=-1)
        noise = np.sqrt(2.0 * (self.band.high - self.band.low) * density)
        ppv = np.max(np.abs(motion), axis=-1)
        # PPV of the components that move, then their frequencies, by blast and receiver
        errors = [
            np.hypot(error, 100.0 * noise[r][moves] / ppv[b, r][moves])
            for b, r in np.ndindex(ppv.shape[:2])
            for moves in [ppv[b, r] > 0.0]
            for error in PEAK_ERRORS
        ]
        columns *= UNIFORM / np.concatenate(errors)
        return FisherInformation(columns @ columns.T)


def centre(unit, information):
    """Return the posterior mean in the unit cube where the data alone estimate ``unit``, (n,).

    Where the data constrain little, the uniform prior shrinks it to the middle; theory.md (12.4).
    """
    shrinkage = information.covariance @ information.matrix
    return np.clip(0.5 + shrinkage @ (np.asarray(unit) - 0.5), 0.0, 1.0)


def posterior_intervals(unit, information):
    """Return the 90 % posterior intervals, (n, 2) in the unit cube, clipped at its faces."""
    half, middle = NORMAL_95 * UNIFORM * information.ratios, centre(unit, information)
    return np.clip(np.stack([middle - half, middle + half], axis=-1), 0.0, 1.0)


def is_strength(parameter) -> bool:
    """Tell whether a parameter is a strength of a joint."""
    table, *_, key = parameter.name.split(".")
    return table == "joints" and split_key(key)[0].removesuffix("_residual") in STRENGTH


def weakest(project, parameters, values):
    """Return the joints with the lowest strengths of the ranges, the rest as given."""
    lowest = [
        parameter.low if is_strength(parameter) else value
        for parameter, value in zip(parameters, values, strict=True)
    ]
    return set_all(project, parameters, lowest).joints


def reason_without_slip(parameter, projects, strengths) -> str:
    """Return why a strength is not identifiable: nothing slipped in any blast; else nothing.

    Parameters
    ----------
    parameter : Parameter
    projects : sequence of Project
        One for each blast.
    strengths : sequence of dict of str to JointSlip
        For each blast by joint surface.
    """
    if not is_strength(parameter):
        return ""
    entry = parameter.name.split(".")[1]
    chosen = [
        strength[surface]
        for project, strength in zip(projects, strengths, strict=True)
        for surface in surfaces_of(project, entry)
        if surface in strength
    ]
    if not chosen or any(strength.failed for strength in chosen):
        return ""
    least = min(strength.weakest_factor for strength in chosen)
    over = "whatever its value in the range" if least > 1.0 else "though lower values would slip"
    return f"no contact of '{entry}' slipped or opened, {over}"


def surfaces_of(project, entry) -> list[str]:
    """Return the joint surfaces of an entry of ``[joints]``."""
    return [name for name, joint in joint_of_surface(project.config.mesh).items() if joint == entry]
