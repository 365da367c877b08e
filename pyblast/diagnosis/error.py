"""Error of a prediction of a case: that which is learned, and that which records usually show."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..inference.covariance import record_blocks
from ..inference.error_model import ErrorModel, Levels
from ..inference.fit import FitState
from ..inference.nuisances import Linearised, Nuisances, moving_columns, nuisances_of
from ..inference.parameter import STIFFNESS, Parameter, kind_of_key
from ..project.places import firings_of
from .case import Case
from .thresholds import ENERGY_SHARE, MESH_SHARE

LEVELS = Levels(
    scatter=(5e-3, 2e-2, 8e-2, 0.3, 1.0), transfer=(2e-3, 1e-2, 5e-2, 0.3), nuisance=(1.0, 2.0)
)
CALIBRATED = "calibrated"  # group of nuisances


def usual_energy(case: Case, correction=0.0) -> np.ndarray:
    """Return the energy of each record that noise, good ground and a good mesh leave.

    Parameters
    ----------
    case : Case
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        Change of the motion by a finer mesh.

    Returns
    -------
    (n_blasts, n_receivers) float64, (m/s)2
        In the band; zero where nothing was recorded.
    """
    band = case.band
    recorded = np.sum(band.project(case.residual(0.0)) ** 2, axis=(-2, -1))
    noise = noise_energy(case)
    share = ENERGY_SHARE if case.share is None else case.share
    changed = np.sum(band.project(case.valid * correction) ** 2, axis=(-2, -1))
    usual = noise + share * np.maximum(recorded - noise, 0.0) + MESH_SHARE * changed
    return np.where(recorded > 0.0, usual, 0.0)


def noise_energy(case: Case) -> np.ndarray:
    """Return the energy of the noise of each record in the band, (n_blasts, n_receivers)."""
    shape = case.motion.shape[:2]
    each = [np.trace(case.noise.covariance(case.band, b, r)) for b, r in np.ndindex(shape)]
    return np.reshape(each, shape)


def learned_error(
    case: Case,
    parameters: Sequence[Parameter],
    around: tuple[np.ndarray, ...],
    late_holes: Mapping[int, np.ndarray] | None = None,
) -> ErrorModel:
    """Build the error of a prediction of a case around a motion, but for what is calibrated.

    Parameters
    ----------
    case : Case
    parameters : sequence of n Parameter
        Of the calibration.
    around : tuple of 4 arrays
        Motion (n_blasts, n_receivers, 3, n_samples) in m/s, its slopes (n, ...) by the logarithms
        of these parameters, its slopes (2, ...) in 1/s by receivers that are moved east and north,
        and its change by the better mesh.
    late_holes : mapping of int to (n_holes, ...) float64, optional
        Columns of late firing times of the holes of a blast, by its number.

    Notes
    -----
    Theory.md (12.5), (12.6), (14.10). Standard deviations are those of the table [priors].
    """
    motion, slopes, aside, correction = around
    band, priors = case.band, case.project.config.priors
    kinds = tuple(kind_of_key(parameter.name) for parameter in parameters)
    firings = [firings_of(case.project.of(name), case.receivers) for name in case.blasts]
    shared, lost = nuisances_of(
        Linearised(motion, slopes, kinds, aside, correction), firings, band, priors,
        late_holes or {},
    )  # fmt: skip
    held, simulated = band.project(slopes), band.project(motion)
    stiff = [n for n, kind in enumerate(kinds) if kind == STIFFNESS]
    density = -held[stiff].sum(axis=0) - (case.project.config.signature is None) * simulated
    parts = {
        "density": [0.01 * priors.density_percent * density],
        "amplitude": [0.01 * priors.amplitude_percent * simulated],
        "attenuation": [priors.inverse_q * lost],
    }
    own = moving_columns(parts, simulated.shape)
    return ErrorModel(record_blocks(case, motion), own + shared, LEVELS)


def gained(error: ErrorModel, case: Case, before: FitState, after: FitState) -> float:
    """Return the log of how much more probable a state is than another, priors included."""
    both = np.array([case.residual(each.motion) for each in (before, after)])
    evidence = error.scores(case.band.project(both)).log_evidence
    first, second = evidence - 0.5 * np.array([each.x @ each.x for each in (before, after)])
    return float(second - first)


def with_calibrated(error: ErrorModel, columns: Sequence[np.ndarray]) -> ErrorModel:
    """Return an error with columns of calibrated values, of one prior deviation each."""
    shape = error.nuisances.columns.shape[1:]
    added = moving_columns({CALIBRATED: list(columns)}, shape)
    together: Nuisances = added + error.nuisances
    return replace(error, nuisances=together)
