"""Physics that a site may lack: one decorated function each, and nothing else to touch.

A hypothesis puts one effect back, with knobs. Its first docstring line is the claim of the report.
What it changes decides how it is called and what it costs:

- ``on="site"``: ``(site, target, **knobs) -> Site``; a run of every blast at each trial;
- ``on="holes"``: ``(holes, target, **knobs) -> (delays, scales)`` of one blast; no runs;
- ``on="motion"``: ``(scene, motion, target, **knobs) -> motion``; no runs.

``None`` in place of a result says that the effect is there already or can't be. Ways of one effect
that need other knobs are forms of one label.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .needs import TO_HOLD_OUT, charges_apart
from .targets import TARGETS

FAMILIES = ("source", "path", "receiver", "instrument")
PLACES = ("site", "holes", "motion")
AXES = ("receivers", "blasts", "both")


@dataclass(frozen=True)
class Knob:
    """One number of a hypothesis, Gaussian before the records are seen.

    Parameters
    ----------
    name : str
        Of the argument.
    centre, sigma : float
        In the unit, or of the natural logarithm if ``log``; ``centre`` is always in the unit.
    unit : str
        SI; empty for a ratio.
    log : bool
        Whether it is positive and known by factors.
    starts : tuple of float
        Values in the unit that the search begins at.
    low, high : float
        In the unit; the search stays within.
    per_hole : bool
        One value for each hole of the blast.
    nothing : float, optional
        Value in the unit at which the effect vanishes: from there it is told how small an effect
        records would have shown. Not for effects on the site, which need runs.
    """

    name: str
    centre: float
    sigma: float
    unit: str = ""
    log: bool = False
    starts: tuple[float, ...] = ()
    low: float = -np.inf
    high: float = np.inf
    per_hole: bool = False
    nothing: float | None = None

    def coordinate(self, value):
        """Return a value as the search sees it: in sigmas from the centre."""
        if self.log:
            return np.log(value / self.centre) / self.sigma
        return (value - self.centre) / self.sigma

    def value(self, coordinate):
        """Return the value in the unit of a coordinate."""
        if self.log:
            return self.centre * np.exp(self.sigma * coordinate)
        return self.centre + self.sigma * coordinate


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
    knobs : tuple of Knob
    apply : callable
    bare : callable or None
        ``(site, target, **knobs) -> Site``: cut into zones as with the effect, but without it. Of
        effects on the site that change its geometry, so that no mesh is taken for physics.
    linear : bool
        Whether a larger blast is changed by the same share. Others are screened on two blasts.
    settled_by : str
        What to measure where it can't be told from others.
    needs : tuple of callable
        ``(case) -> str``: why records can't test it, empty where they can.
    single : bool
        Whether it is claimed of one target at a time, the best, however many would pay.
    begins : callable or None
        ``(scene) -> tuple of values``, one of each knob: where the search begins, too, read from
        what the records miss.
    """

    label: str
    form: str
    claim: str
    family: str
    on: str
    target: str
    targets: Callable
    axis: str
    knobs: tuple[Knob, ...]
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
    label, *, family, on, target, axis, knobs, form="", targets=None, bare=None, linear=True,
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
            label, form, " ".join(claim.split()), family, on, target, targets, axis, tuple(knobs),
            function, bare, linear, settled_by, needs, single, begins,
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
