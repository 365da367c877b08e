"""The small site as effects of the library are tried on it."""

from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
from small_site import recorded, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.effects import Scene
from pyblast.diagnosis.forward import hole_motion, simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY


@cache
def scene():
    """Return the small site, believed and true alike, and what its holes send."""
    case = recorded(small_site())
    simulation = simulation_of(case)
    motion = simulation.motion(small_site())
    baseline = SimpleNamespace(case=case, project=small_site(), motion=motion)
    there = object.__new__(Scene)  # without the memory of a calibration
    there.simulation, there.baseline = simulation, baseline
    there.holes, there.failures = hole_motion(simulation, case, small_site()), {}
    return there


def applied(name, target, site=None, **knobs):
    """Return the small site with an effect."""
    return LIBRARY[name].apply(site or small_site(), target, **knobs)


@cache
def first():
    """Return the simulation of the first blast alone."""
    return simulation_of(replace(scene().case, blasts=("S1",)))


def sent(site):
    """Return what the first blast of a site sends, (1, n_receivers, 3, n_samples) m/s."""
    return first().motion(site)


def received(name, target, **knobs):
    """Return what is received of the small site with an effect that needs no runs."""
    return LIBRARY[name].apply(scene(), scene().baseline.motion, target, **knobs)


def shared(one, other):
    """Return the rms of a difference over that of the other."""
    return np.sqrt(np.mean((one - other) ** 2) / np.mean(other**2))


@contextmanager
def library_of(names):
    """Leave hypotheses of some names in the library, and restore all in their order."""
    whole = dict(LIBRARY)
    for name in set(whole) - set(names):
        del LIBRARY[name]
    try:
        yield
    finally:
        LIBRARY.clear()
        LIBRARY.update(whole)
