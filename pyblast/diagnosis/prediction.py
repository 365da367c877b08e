"""Prediction of a further blast in ground that was diagnosed."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..blasts.blast import Blast
from ..project.project import Project
from . import library  # noqa: F401  fills the library
from .calibration import unknowns_of, with_values
from .case import Case
from .effects import Effect, with_motion_effects
from .forward import Forward, surroundings

NEW = "further blast"


def diagnosed(project: Project, values, effects) -> Project:
    """Return a project with factors on its values and with the effects that change it.

    Parameters
    ----------
    project : Project
        The reference.
    values : (n_unknowns,) float
    effects : sequence of Effect
    """
    project = with_values(project, unknowns_of(project), values)
    for effect in effects:
        if effect.hypothesis.on == "site":
            project = effect.hypothesis.apply(project, effect.target, **effect.parameters)
    return project


def predict(case: Case, cut, blast: Blast, values, effects=(), folder=None) -> np.ndarray:
    """Predict what the receivers of a case record of a further blast.

    Parameters
    ----------
    case : Case
    cut : Discretization or None
        Discretization of a flat box, None for the mesh of the project; one run is made.
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
    answer = diagnosed(case.project, values, effects)
    reference, project = (firing(one, NEW, blast) for one in (case.project, answer))
    forward = Forward(replace(case, project=reference, blasts=(NEW,)), cut, folder)
    return with_motion_effects(Place(forward, project), forward.motion(project), effects)[0]


def firing(project: Project, name: str, blast: Blast) -> Project:
    """Return a project with one blast alone, in place of its own."""
    parts = {k: v for k, v in project.given.items() if k not in ("records", "inside")}
    alone = replace(project, name=name, further=(), given={**parts, "blast": blast})
    inside = replace(project.inside, firing=alone.firing)
    return replace(alone, given={**alone.given, "inside": inside})


@dataclass(eq=False)
class Place:
    """What effects on motion ask of a scene: receivers and blasts of a case, and motion nearby.

    Parameters
    ----------
    forward : Forward
    project : Project
        With the further blast, as it was diagnosed.
    """

    forward: Forward
    project: Project

    @property
    def case(self):
        """The receivers and the further blast, on the ground that effects were fitted on."""
        return self.forward.case

    @cached_property
    def surroundings(self):
        """Motion around the receivers."""
        return surroundings(self.forward, self.project)


def effects_of(table) -> tuple[Effect, ...]:
    """Return the effects of the entry ``model`` of ``diagnosis.json``."""
    return tuple(
        Effect(one["name"], one["target"], tuple(map(tuple, one["values"])))
        for one in table["effects"]
    )
