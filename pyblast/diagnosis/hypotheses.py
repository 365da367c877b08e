"""Hypotheses: physics that a model may lack, with targets and needs, one function each."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..inference.parameter import Parameter
from ..project.flat_box import not_flat, quality_of
from .case import Case
from .forward import not_superposed, places_around, steps_around
from .thresholds import CHARGE_RATIO, DIRECTIONS, SECTORS


def two_receivers(case: Case) -> str:
    """Ask for a second receiver, which cross-validation and the null distribution need."""
    if np.count_nonzero(np.any(case.valid, axis=(0, 2, 3))) > 1:
        return ""
    return "there is one receiver: no other that it would have to predict"


def two_blasts(case: Case) -> str:
    """Ask for a second blast, which an effect of a receiver must predict."""
    if np.count_nonzero(np.any(case.valid, axis=(1, 2, 3))) > 1:
        return ""
    return "there is one blast: no other that it would have to predict"


def charges_apart(case: Case) -> str:
    """Ask for blasts of small and of large charge, by what fires within 8 ms."""
    if len(case.blasts) < 2:
        return f"there is one blast: what grows with charge needs two, {CHARGE_RATIO:g} to one"
    every = [case.project.blasts[name] for name in case.blasts]
    if any(np.isnan(one.charge).any() for one in every):
        return "a charge is missing: what grows with charge needs all of them in kg"
    most = [one.charge_per_window() for one in every]
    ratio = max(most) / min(most)
    if ratio >= CHARGE_RATIO:
        return ""
    return (
        f"the charges of the blasts are {ratio:.2g} to one: what grows with charge needs "
        f"{CHARGE_RATIO:g} to one"
    )


def three_directions(case: Case) -> str:
    """Ask for paths in three directions, a sixth of half a turn each."""
    places = [r.position[:2] for r in case.project.receivers if r.name in case.receivers]
    fired = [case.project.blasts[name].centres[:, :2].mean(axis=0) for name in case.blasts]
    ways = (np.array(places)[:, None] - np.array(fired)).reshape(-1, 2)
    turns = np.arctan2(ways[:, 1], ways[:, 0]) % np.pi
    there = len(set((turns * SECTORS / np.pi).astype(int) % SECTORS))
    if there >= DIRECTIONS:
        return ""
    return f"paths lie in {there} of {SECTORS} directions: {DIRECTIONS} tell along from across"


def unknown_quality(case: Case) -> str:
    """Ask for ground whose quality factors are not given."""
    known = quality_of(case.project)
    if known is None:
        return ""
    return f"the site gives it, Qp {known[0]:.3g} and Qs {known[1]:.3g}, and every run has it"


def ground_without_loss(case: Case) -> str:
    """Ask for ground without quality factors: anisotropy with attenuation is not simulated."""
    if quality_of(case.project) is None:
        return ""
    return "the site gives quality factors, and anisotropic ground with them is not simulated"


def flat_layers(case: Case) -> str:
    """Ask for a flat box with holes inside, whose mesh follows what such effects change."""
    why = not_flat(case.project)
    if not why:
        return ""
    return (
        f"{why}: it is simulated in flat layers with upright elastic joints along x or y and holes "
        "inside; try it in a project of that kind"
    )


def holes_inside(case: Case) -> str:
    """Ask for holes as sources inside the model."""
    if all(one.config.holes_inside for one in (case.project, *case.project.further)):
        return ""
    return "no hole is a source inside the model: give [holes_inside] in place of what enters"


def superposed(case: Case) -> str:
    """Ask for holes whose motions add up, so that one of them can be changed."""
    return not_superposed(case)


def elastic_joints(case: Case) -> str:
    """Ask for a joint whose law is elastic, where joints are there at all."""
    laws = {joint.surface: joint.law for joint in case.project.joints}
    if not laws or "elastic" in laws.values():
        return ""
    name, law = next(iter(laws.items()))
    return (
        f"no joint has the law 'elastic' ({name} has {law!r}): give the one in doubt kn and ks "
        "alone"
    )


def air_over_layers(case: Case) -> str:
    """Ask for holes with charges, flat layers below the receivers, and no air blast in the model.

    What air pressure does to the ground is computed for flat layers.
    """
    for one in (case.project, *case.project.further):
        config = one.config
        if config.air_blast is not None:
            return "the project has [air_blast], and every run has it"
        if config.blast is None or np.isnan(one.blast.charge).any():
            return "there is no [blast] with a charge for each hole"
        if not config.mesh.layers or config.mesh.surface_file is not None:
            return "the ground is not flat: give flat [[mesh.layers]]"
    return ""


def room_around_receivers(case: Case) -> str:
    """Ask for ground around a receiver, where it may have stood instead."""
    if receivers_with_room(case):
        return ""
    ways = steps_around(case, case.project)
    return f"no receiver has {ways[-1]:.3g} m of ground on all sides: give a wider model"


# What must be there to hold out, by the axis of an effect.
TO_HOLD_OUT = {
    "receivers": (two_receivers,),
    "blasts": (two_receivers, two_blasts),
    "both": (two_receivers,),
}


OF_BLAST = " of blast "


def whole_site(case: Case) -> tuple[str, ...]:
    """Return the one target of effects that belong to nothing smaller."""
    del case
    return ("",)


def joints(case: Case) -> tuple[str, ...]:
    """Return the names of the elastic joints."""
    return tuple(joint.surface for joint in case.project.joints if joint.law == "elastic")


def blasts(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts that are looked at."""
    return case.blasts


def blasts_of_many_holes(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts in which holes can differ."""
    return tuple(name for name in case.blasts if len(case.project.blasts[name].charge) > 1)


def holes(case: Case) -> tuple[str, ...]:
    """Return each hole of the blasts of many holes, with its blast."""
    return tuple(
        dict.fromkeys(
            f"{hole}{OF_BLAST}{name}"
            for name in blasts_of_many_holes(case)
            for hole in case.project.blasts[name].hole_ids
        )
    )


def blast_and_hole(target: str) -> tuple[str, str]:
    """Return the blast of a target, and its hole where it is a hole of a blast."""
    hole, _, blast = target.rpartition(OF_BLAST)
    return blast, hole


def receivers(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with records."""
    return case.receivers


def receivers_with_room(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with ground on all sides."""
    ways, there = steps_around(case, case.project), {r.name: r for r in case.project.receivers}
    return tuple(n for n in case.receivers if places_around(case, there[n], ways) is not None)


def receivers_with_axes(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers whose records are east and north."""
    turned = {r.name for r in case.project.receivers if r.azimuth is not None}
    return tuple(name for name in case.receivers if name not in turned)


TARGETS = {"site": whole_site, "joint": joints, "blast": blasts, "receiver": receivers}


FAMILIES = ("source", "path", "receiver", "instrument")
PLACES = ("site", "holes", "motion")
AXES = ("receivers", "blasts", "both")


@dataclass(frozen=True)
class Hypothesis:
    """Hypothesis: physics that the model may lack.

    Parameters
    ----------
    label : str
        Its name in results.
    form : str
        Tells hypotheses of one label apart; empty where there is one.
    claim : str
        What it says, one sentence.
    family : str
        Of `FAMILIES`.
    on : str
        What it changes, of `PLACES`.
    target : str
        What it belongs to, in a word.
    targets : callable
        ``(case) -> tuple of str``: all of them; the search tries each.
    axis : str
        What is held out to test it, of `AXES`.
    parameters : tuple of Parameter
    apply : callable
    bare : callable or None
        ``(project, target, **parameters) -> Project``: meshed as with the effect, but without
        it. Of effects on the site that change its geometry, so that no mesh is taken for physics.
    linear : bool
        Whether a larger blast is changed by the same share. Others are screened on two blasts.
    settled_by : str
        What to measure where it can't be told from others.
    needs : tuple of callable
        ``(case) -> str``: why records can't test it, empty where they can.
    simulated : tuple of callable
        ``(case) -> str``: why it can't be simulated in a project, empty where it can. It has no
        targets then.
    single : bool
        Whether it is claimed of one target at a time, the best, however many would pay.
    begins : callable or None
        ``(scene) -> tuple of values``, one of each parameter: where the search begins, too, read
        from what the records miss.
    """

    label: str
    form: str
    claim: str
    family: str
    on: str
    target: str
    targets: Callable
    axis: str
    parameters: tuple[Parameter, ...]
    apply: Callable
    bare: Callable | None = None
    linear: bool = True
    settled_by: str = ""
    needs: tuple[Callable, ...] = ()
    simulated: tuple[Callable, ...] = ()
    single: bool = False
    begins: Callable | None = None

    @property
    def name(self):
        """Its key in the library: the label, with its form after a slash."""
        return f"{self.label}/{self.form}" if self.form else self.label

    def untestable(self, case) -> str:
        """Return why the records of a case can't test it, whatever they show; empty if they can."""
        why = next(filter(None, (need(case) for need in self.simulated)), "")
        if why:
            return why
        if not self.targets(case):
            return f"this site has no {self.target} that it could belong to"
        return next(filter(None, (need(case) for need in self.needs)), "")


LIBRARY: dict[str, Hypothesis] = {}


def hypothesis(
    label, *, family, on, target, axis, parameters, form="", targets=None, bare=None, linear=True,
    settled_by="", needs=(), simulated=(), single=False, begins=None,
):  # fmt: skip
    """Enter the decorated function into the library.

    ``targets`` lists what ``target`` names; it may be left out for words of `TARGETS`. What its
    axis asks for, and charges apart where it is not linear, come before its own ``needs``. An
    effect that can't be ``simulated`` in a project has no targets there.

    Raises
    ------
    InputError
        If a word is not one of the lists above, the name is taken, or there is no claim.
    """
    listed = TARGETS if targets is None else (target,)
    for word, allowed in ((family, FAMILIES), (on, PLACES), (target, listed), (axis, AXES)):
        if word not in allowed:
            raise InputError(f"hypothesis {label}: need one of {', '.join(allowed)}, got {word!r}")
    possible = _where_simulated(targets or TARGETS[target], simulated)
    needs = (*TO_HOLD_OUT[axis], *(() if linear else (charges_apart,)), *needs)

    def enter(function):
        claim = (function.__doc__ or "").strip().split("\n\n")[0]
        one = Hypothesis(
            label, form, " ".join(claim.split()), family, on, target, possible, axis,
            tuple(parameters), function, bare, linear, settled_by, needs, simulated, single, begins,
        )  # fmt: skip
        if one.name in LIBRARY:
            raise InputError(f"hypothesis {one.name}: is in the library already")
        if not claim:
            raise InputError(f"hypothesis {one.name}: needs a docstring that says its claim")
        LIBRARY[one.name] = one
        return function

    return enter


def _where_simulated(targets, simulated):
    """Return a function that lists targets only where an effect can be simulated."""
    if not simulated:
        return targets

    def possible(case):
        return () if any(need(case) for need in simulated) else targets(case)

    return possible


def untestable_labels(case) -> dict[str, str]:
    """Return the labels of which no form can be tested by the records of a case, with the reason.

    Parameters
    ----------
    case : Case
        It says so by what is there, before any search.
    """
    reasons_of = {}
    for label in dict.fromkeys(one.label for one in LIBRARY.values()):
        reasons = [one.untestable(case) for one in LIBRARY.values() if one.label == label]
        if all(reasons):
            reasons_of[label] = reasons[0]
    return reasons_of
