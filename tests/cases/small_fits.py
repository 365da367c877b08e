"""Fits of two effects to records of the small site, which tests of decisions share."""

from dataclasses import replace
from functools import cache

import numpy as np
from small_site import recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.fitting import fit

SLOW = Effect("clock_error", "R2", ((0.0,),))
LOUD = Effect("misfire_or_charge_error/blast", "B1", ((1.0,),))


def late_and_loud(motion):
    """Let the clock of R2 be 16 ms slow, and blast B1 be twice as large as its charge."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 4, axis=-1)
    motion[1] *= 2.0
    return motion


def with_holes(scene):
    """Return a scene whose first hole sends all of each blast."""
    motion = scene.baseline.motion
    nothing = 0.0 * motion[1]
    return replace(scene, holes={"S1": motion[:1], "B1": np.stack([motion[1], nothing, nothing])})


@cache
def fits():
    """Return a scene with two effects, and the fits of none, of each and of both."""
    here = scene_of(recorded(small_site(), change=late_and_loud))
    here = with_holes(here)
    return here, *(fit(here, some) for some in ((), (SLOW,), (LOUD,), (SLOW, LOUD)))
