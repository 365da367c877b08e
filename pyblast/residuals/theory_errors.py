"""What residuals are worth beside one simulation: its errors, with levels that the records tell."""

import numpy as np

from .band import Band
from .levels import infer_levels
from .noise import Noise
from .nuisances import Nuisances, mesh_columns, nuisances
from .scattering import scattering
from .whitening import Whitener, whitener


def usual_whitener(motion, noise: Noise, band: Band, mesh_errors=()) -> Whitener:
    """Return the covariance of residuals with errors shaped as some motion, at the usual levels.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    noise : Noise
    band : Band
    mesh_errors : sequence of the same shape as the motion, m/s
        What meshes may do to the simulation, as of `mesh_error`; of each receiver on their own.
    """
    parts, spread = error_columns(motion, band, mesh_errors), scattering(motion, band)
    return whitener(noise, band, len(motion), nuisances=parts, scattering=spread)


def error_columns(motion, band: Band, mesh_errors=()) -> Nuisances:
    """Return the small errors of a motion, those of its mesh included; as `usual_whitener`."""
    parts = nuisances(motion, band)
    if len(mesh_errors):
        errors = np.asarray(mesh_errors, dtype=np.float64)
        alone = np.eye(errors.shape[2])[:, None, None, :, None, None] * errors
        alone = alone.reshape(-1, *errors.shape[1:])
        parts += mesh_columns(alone[np.any(alone, axis=(1, 2, 3, 4))], band)
    return parts


def whitener_beside(
    recorded, simulated, noise: Noise, band: Band, mesh_errors=(), fitted=()
) -> Whitener:
    """Return the covariance of residuals beside a simulation that nearly fits.

    Parameters
    ----------
    recorded, simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    noise : Noise
    band : Band
    mesh_errors : sequence of the same shape, m/s
        As of `usual_whitener`.
    fitted : (n, n_blasts, n_receivers, 3, n_samples) float, m/s
        As of `infer_levels`: the simulation was fitted by so many unknowns.

    Returns
    -------
    Whitener
        With inferred levels.

    Notes
    -----
    theory.md (7.13) to (7.19). Shapes must be those of the simulation: those of the record hold
    its noise, which then explains itself for the price of a level, and what damps the simulation
    is taken for likely.
    """
    made = usual_whitener(simulated, noise, band, mesh_errors)
    return infer_levels(made, np.asarray(recorded) - simulated, fitted=fitted).whitener
