"""A further blast at a site that was diagnosed."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..blasts.blast import Blast
from ..project.site import Site
from . import library  # noqa: F401  fills the library
from .calibration import unknowns_of, with_values
from .case import Case
from .effects import Effect, with_motion_effects
from .forward import Forward, surroundings

NEW = "further blast"


def site_of(site: Site, values, effects) -> Site:
    """Return a site with factors on its values and with the effects that change it.

    Parameters
    ----------
    site : Site
        As it is believed to be.
    values : (n_unknowns,) float
    effects : sequence of Effect
    """
    site = with_values(site, unknowns_of(site), values)
    for effect in effects:
        if effect.hypothesis.on == "site":
            site = effect.hypothesis.apply(site, effect.target, **effect.parameters)
    return site


def predict(case: Case, cut, blast: Blast, values, effects=(), folder=None) -> np.ndarray:
    """Foretell what the receivers of a case record of a further blast.

    Parameters
    ----------
    case : Case
    cut : Cut
        Of the ground; one run is made.
    blast : Blast
    values : (n_unknowns,) float
        Of a diagnosis.
    effects : sequence of Effect
        Those on holes belong to their own blast, and have no part in another one.
    folder : path, optional
        Where runs are kept and found.

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s
        From the first hole on.
    """
    answered = site_of(case.site, values, effects)
    believed, site = (replace(one, blasts={NEW: blast}) for one in (case.site, answered))
    forward = Forward(replace(case, site=believed, blasts=(NEW,)), cut, folder)
    return with_motion_effects(Place(forward, site), forward.motion(site), effects)[0]


@dataclass(eq=False)
class Place:
    """What effects on motion ask of a scene: receivers and blasts of a case, and motion nearby.

    Parameters
    ----------
    forward : Forward
    site : Site
        With the further blast, as it was diagnosed.
    """

    forward: Forward
    site: Site

    @property
    def case(self):
        """The receivers and the further blast, on the ground that effects were fitted on."""
        return self.forward.case

    @cached_property
    def surroundings(self):
        """What is sent around the receivers."""
        return surroundings(self.forward, self.site)


def effects_of(table) -> tuple[Effect, ...]:
    """Return the effects of the entry ``model`` of ``diagnosis.json``."""
    return tuple(
        Effect(one["name"], one["target"], tuple(map(tuple, one["values"])))
        for one in table["effects"]
    )
