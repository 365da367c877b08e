"""The numerical control of an answer: what a finer mesh makes of it."""

from collections.abc import Callable

import numpy as np

from .fitting import Fit, corrected
from .forward import Forward
from .scene import Scene
from .search import worst

RESOLUTION = "numerical_resolution"  # a label as those of the library, but for having no knob
CLAIM = "On a finer mesh this answer has no more evidence than chance would find."
SETTLED_BY = "shorter zones (`cuts` of `pyblast.diagnose`) until the answer stays"
COARSE = 1.0  # what a finer mesh may change of an answer that stands, in errors of the theory


def on_finer_mesh(
    scene: Scene, fine: Forward, fit: Fit, tell: Callable = lambda *_: None
) -> tuple[Fit, float | None]:
    """Run a fitted site on the finer mesh, and correct the fit if that changes it.

    Parameters
    ----------
    scene : Scene
    fine : Forward
        With the finer mesh.
    fit : Fit
        Its effects on the site and values of the site count; all holes fire as planned.
    tell : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    fit : Fit
        The same where the change is less than `COARSE`, first in the blast that the effects change
        most, then in all.
    change : float or None
        Beyond what corrects all runs, at the worst receiver or blast: mean square in errors of
        the theory and noise. None where nothing else is sent than from the calibrated site, and
        for anisotropic ground, which has zones of its own.
    """
    site, likelihood = scene.site(fit.values, fit.effects), scene.baseline.likelihood
    if site.fabric is not None or all(e.hypothesis.on != "site" for e in fit.effects):
        return fit, None
    (sent,) = scene.sent([(fit.values, fit.effects)])
    each = likelihood.size(likelihood.white(sent - scene.baseline.believed)).sum(axis=1)
    most, *others = (int(b) for b in np.argsort(-each, kind="stable"))
    shift = np.zeros_like(sent)
    for done, blasts in enumerate(([most], others)):
        tell("a finer mesh", done, len(shift))
        heard = fine.heard([(site, scene.case.blasts[b]) for b in blasts])
        for b, motion in zip(blasts, heard, strict=True):
            shift[b] = motion - sent[b]
        change = worst(likelihood.size(likelihood.white(shift)))
        if change < COARSE:
            return fit, change
    return corrected(scene, fit, shift), change
