"""Hypotheses: physics that a model may lack, their targets and needs, one function each."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..inference.parameter import Parameter
from .case import Case

APART = 3.0  # largest charge over the smallest that shows what depends on amplitude
SECTORS = 6  # of half a turn, in which paths may lie
DIRECTIONS = 3  # of them that tell waves along from waves across


def two_receivers(case: Case) -> str:
    """Ask for a second receiver: one alone can't foretell, and chance has nothing to shuffle."""
    if np.count_nonzero(np.any(case.valid, axis=(0, 2, 3))) > 1:
        return ""
    return "there is one receiver: no other that it would have to foretell"


def two_blasts(case: Case) -> str:
    """Ask for a second blast, which an effect of a receiver must foretell."""
    if np.count_nonzero(np.any(case.valid, axis=(1, 2, 3))) > 1:
        return ""
    return "there is one blast: no other that it would have to foretell"


def charges_apart(case: Case) -> str:
    """Ask for blasts of small and of large charge, by what fires within 8 ms."""
    if len(case.blasts) < 2:
        return f"there is one blast: what grows with charge needs two, {APART:g} to one"
    most = [case.site.blasts[name].charge_per_window() for name in case.blasts]
    ratio = max(most) / min(most)
    if ratio >= APART:
        return ""
    return (
        f"the charges of the blasts are {ratio:.2g} to one: what grows with charge needs "
        f"{APART:g} to one"
    )


def three_directions(case: Case) -> str:
    """Ask for paths in three directions, a sixth of half a turn each."""
    heard = [r.position[:2] for r in case.site.receivers if r.name in case.receivers]
    fired = [case.site.blasts[name].centres[:, :2].mean(axis=0) for name in case.blasts]
    ways = (np.array(heard)[:, None] - np.array(fired)).reshape(-1, 2)
    turns = np.arctan2(ways[:, 1], ways[:, 0]) % np.pi
    there = len(set((turns * SECTORS / np.pi).astype(int) % SECTORS))
    if there >= DIRECTIONS:
        return ""
    return f"paths lie in {there} of {SECTORS} directions: {DIRECTIONS} tell along from across"


def unknown_quality(case: Case) -> str:
    """Ask for ground of which nobody has said how it fades waves."""
    if case.site.quality is None:
        return ""
    p, s = case.site.quality
    return f"the site gives it, Qp {p:.3g} and Qs {s:.3g}, and every run has it"


def ground_without_loss(case: Case) -> str:
    """Ask for ground that does not fade waves: with a grain as well, it is not simulated."""
    if case.site.quality is None:
        return ""
    return "the site gives quality factors, and ground with them and a grain is not simulated"


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
    """Return the names of the listed joints."""
    return tuple(j.joint.surface for j in case.site.joints)


def blasts(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts that are looked at."""
    return case.blasts


def blasts_of_many_holes(case: Case) -> tuple[str, ...]:
    """Return the names of the blasts in which holes can differ."""
    return tuple(name for name in case.blasts if len(case.site.blasts[name].charge) > 1)


def holes(case: Case) -> tuple[str, ...]:
    """Return each hole of the blasts of many holes, with its blast."""
    return tuple(
        dict.fromkeys(
            f"{hole}{OF_BLAST}{name}"
            for name in blasts_of_many_holes(case)
            for hole in case.site.blasts[name].hole_ids
        )
    )


def blast_and_hole(target: str) -> tuple[str, str]:
    """Return the blast of a target, and its hole where it is a hole of a blast."""
    hole, _, blast = target.rpartition(OF_BLAST)
    return blast, hole


def receivers(case: Case) -> tuple[str, ...]:
    """Return the names of the receivers with records."""
    return case.receivers


TARGETS = {"site": whole_site, "joint": joints, "blast": blasts, "receiver": receivers}


FAMILIES = ("source", "path", "receiver", "instrument")
PLACES = ("site", "holes", "motion")
AXES = ("receivers", "blasts", "both")


@dataclass(frozen=True)
class Hypothesis:
    """Physics that may have been left out.

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
        ``(site, target, **parameters) -> Site``: cut into zones as with the effect, but without
        it. Of effects on the site that change its geometry, so that no mesh is taken for physics.
    linear : bool
        Whether a larger blast is changed by the same share. Others are screened on two blasts.
    settled_by : str
        What to measure where it can't be told from others.
    needs : tuple of callable
        ``(case) -> str``: why records can't test it, empty where they can.
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
    single: bool = False
    begins: Callable | None = None

    @property
    def name(self):
        """Its key in the library: the label, with its form after a slash."""
        return f"{self.label}/{self.form}" if self.form else self.label

    def untestable(self, case) -> str:
        """Return why the records of a case can't test it, whatever they show; empty if they can."""
        if not self.targets(case):
            return f"this site has no {self.target} that it could belong to"
        return next(filter(None, (need(case) for need in self.needs)), "")


LIBRARY: dict[str, Hypothesis] = {}


def hypothesis(
    label, *, family, on, target, axis, parameters, form="", targets=None, bare=None, linear=True,
    settled_by="", needs=(), single=False, begins=None,
):  # fmt: skip
    """Enter the decorated function into the library.

    ``targets`` lists what ``target`` names; it may be left out for words of `TARGETS`. What its
    axis asks for, and charges apart where it is not linear, come before its own ``needs``.

    Raises
    ------
    InputError
        If a word is not one of the lists above, the name is taken, or there is no claim.
    """
    listed = TARGETS if targets is None else (target,)
    for word, allowed in ((family, FAMILIES), (on, PLACES), (target, listed), (axis, AXES)):
        if word not in allowed:
            raise InputError(f"hypothesis {label}: need one of {', '.join(allowed)}, got {word!r}")
    targets = targets or TARGETS[target]
    needs = (*TO_HOLD_OUT[axis], *(() if linear else (charges_apart,)), *needs)

    def enter(function):
        claim = (function.__doc__ or "").strip().split("\n\n")[0]
        one = Hypothesis(
            label, form, " ".join(claim.split()), family, on, target, targets, axis,
            tuple(parameters), function, bare, linear, settled_by, needs, single, begins,
        )  # fmt: skip
        if one.name in LIBRARY:
            raise InputError(f"hypothesis {one.name}: is in the library already")
        if not claim:
            raise InputError(f"hypothesis {one.name}: needs a docstring that says its claim")
        LIBRARY[one.name] = one
        return function

    return enter


def untestable_labels(case) -> dict[str, str]:
    """Return the labels of which no form can be tested by the records of a case, with the reason.

    Parameters
    ----------
    case : Case
        It says so by what is there, before any search.
    """
    told = {}
    for label in dict.fromkeys(one.label for one in LIBRARY.values()):
        reasons = [one.untestable(case) for one in LIBRARY.values() if one.label == label]
        if all(reasons):
            told[label] = reasons[0]
    return told
