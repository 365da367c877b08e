"""What a fit foretells of records that were left out of it, as motion."""

import numpy as np

from .fitting import Fit
from .folds import step_without
from .scene import Scene

ROUNDING = 1e-8  # of the largest singular value: what a whitener has lost for good


def foretold(scene: Scene, fit: Fit, out) -> np.ndarray:
    """Return what a fit sends when some records have no part in it.

    Parameters
    ----------
    scene : Scene
    fit : Fit
        To all records.
    out : (n_blasts, n_receivers) bool
        Records that are left out.

    Returns
    -------
    (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Within the band of the records. The fit is moved by one linear step, as for
        the folds: theory.md (14.5).
    """
    likelihood = scene.baseline.likelihood
    band = likelihood.case.band
    move, _ = step_without(scene, fit, out)
    change = np.tensordot(move, fit.columns, 1)
    coloured = np.linalg.pinv(likelihood.roots, rcond=ROUNDING, hermitian=True)
    change = np.einsum("brij,brj->bri", coloured, change).reshape(*out.shape, 3, -1)
    return band.restore(band.project(fit.motion) + change)
