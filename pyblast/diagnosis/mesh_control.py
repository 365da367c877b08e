"""The numerical control of an answer: whether a finer mesh would give another one."""

from .fitting import Fit
from .forward import Forward
from .prediction import site_of
from .scene import Scene


def changed_by_mesh(scene: Scene, fine: Forward, fit: Fit):
    """Return what a finer mesh changes of a fitted site, beyond what corrects all runs.

    Parameters
    ----------
    scene : Scene
    fine : Forward
        With the finer mesh.
    fit : Fit
        Its effects on the site and values of the site count; all holes fire as planned.

    Returns
    -------
    (n_blasts, n_receivers) float64 or None
        Mean squares, in errors of the theory and noise, as sizes of residuals are. None for
        anisotropic ground, which has zones of its own.
    """
    site = site_of(scene.case.site, fit.values, fit.effects)
    if site.fabric is not None:
        return None
    likelihood, baseline = scene.baseline.likelihood, scene.baseline
    changed = fine.motion(site) - scene.forward.motion(site) - baseline.correction
    return likelihood.size(likelihood.white(changed))
