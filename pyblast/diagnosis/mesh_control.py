"""The numerical control of an answer: whether a finer mesh would give another one."""

from .fitting import Fit
from .forward import Forward
from .scene import Scene

RESOLUTION = "numerical_resolution"  # a label as those of the library, but for having no knob
CLAIM = "A finer mesh changes this answer as much as all small errors of the theory do."
SETTLED_BY = "shorter zones (`cuts` of `pyblast.diagnose`) until the answer stays"


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
    site, likelihood = scene.site(fit.values, fit.effects), scene.baseline.likelihood
    if site.fabric is not None:
        return None
    (sent,) = scene.sent([(fit.values, fit.effects)])
    return likelihood.size(likelihood.white(fine.motion(site) - sent))
