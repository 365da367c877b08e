"""Verification suite: cases with known answers, observed order of convergence, pass or fail.

A case measures on one mesh and returns readings and curves. The suite runs it on its meshes,
computes the observed order, and compares the errors with the tolerances of the case.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .asked import asked_of

CASES = {}
ROUNDING = 1e-12


@dataclass(frozen=True)
class Reading:
    """One quantity on one mesh.

    Parameters
    ----------
    quantity : str
    expected, measured : float
        SI, or a share.
    error : float
        Signed, in the unit of the tolerance; usually ``(measured - expected)/expected``.
    """

    quantity: str
    expected: float
    measured: float
    error: float

    @classmethod
    def relative(cls, quantity, expected, measured):
        """Return a reading whose error is relative to the expected value."""
        return cls(quantity, float(expected), float(measured), float(measured / expected - 1.0))

    @classmethod
    def absolute(cls, quantity, expected, measured):
        """Return a reading whose error is the difference."""
        return cls(quantity, float(expected), float(measured), float(measured - expected))

    @classmethod
    def norm(cls, quantity, expected, measured):
        """Return a reading of two curves: L2 norm of the difference over that of the first."""
        scale = np.linalg.norm(expected)
        error = float(np.linalg.norm(np.asarray(measured) - expected) / scale)
        return cls(quantity, 0.0, error, error)


@dataclass(frozen=True, eq=False)
class Curve:
    """Expected and measured curve over one axis, for the figure of a case.

    Parameters
    ----------
    label : str
    x, expected, measured : (n,) float64
    x_label, y_label : str
        With units.
    """

    label: str
    x: np.ndarray
    expected: np.ndarray
    measured: np.ndarray
    x_label: str
    y_label: str


@dataclass(frozen=True)
class Case:
    """Verification case: a problem with a known answer.

    Parameters
    ----------
    number : str
        "1" to "36", or "L1" and on for law checks.
    title : str
    source : str
        Where the expected answer comes from.
    gate : str
        "R" blocks a release, "E" gates the diagnosis, "C" comes before a claim.
    tolerance : dict of str to float
        By quantity: largest absolute error on the finest mesh.
    measure : callable
        ``measure(n)`` for a mesh of ``n`` (edges per wavelength, or what ``unit`` says), or
        ``measure()`` where no mesh is involved; returns a list of `Reading` and a list of `Curve`.
    meshes : tuple of float
    unit : str
        What the numbers in ``meshes`` count.
    order : float or None
        Least observed order of convergence; None for cases without a mesh and for exact ones.
    ordered : tuple of str
        Quantities whose order is judged; empty: all that have a tolerance.
    quick : bool
        Whether `./dev test` runs it, on its first mesh.
    note : str
        Shown below the table: which mesh meets the tolerance and why.
    """

    number: str
    title: str
    source: str
    gate: str
    tolerance: dict[str, float]
    measure: Callable = field(repr=False)
    meshes: tuple[float, ...] = ()
    unit: str = "edges per wavelength"
    order: float | None = None
    ordered: tuple[str, ...] = ()
    quick: bool = False
    note: str = ""


def case(number, title, **about):
    """Register a function as the measurement of a case; keywords are those of `Case`."""

    def register(measure):
        CASES[number] = Case(number, title, measure=measure, **about)
        return measure

    return register


def observed_order(meshes, errors):
    """Return the slope of log error over log mesh by least squares, nan where an error is zero."""
    errors = np.abs(errors)
    if len(errors) < 2 or not (errors > 0.0).all():
        return float("nan")
    return float(-np.polyfit(np.log(meshes), np.log(errors), 1)[0])


def meshes_asked(problem):
    """Return the meshes, coarsest first, that are asked for but not among those of a case."""
    asked = [asked_of(problem.number, quantity) for quantity in problem.tolerance]
    return sorted({one.mesh for one in asked if one and one.mesh} - {*problem.meshes})


def judge(problem, readings, beside=None):
    """Compare the readings of a case on each mesh with its tolerances and with those asked for.

    Parameters
    ----------
    problem : Case
    readings : list of list of Reading
        One list for each mesh, or one list where there is no mesh.
    beside : dict of float to list of Reading, optional
        On the meshes of `meshes_asked`, by mesh; the order is not taken from them.

    Returns
    -------
    list of dict
        One row for each quantity that has a tolerance.
    """
    rows = []
    for quantity, tolerance in problem.tolerance.items():
        measured = [next(r for r in mesh if r.quantity == quantity) for mesh in readings]
        errors = [r.error for r in measured]
        within = [bool(abs(error) <= tolerance) for error in errors]
        order = observed_order(problem.meshes, errors) if len(errors) > 1 else float("nan")
        rows.append({
            "quantity": quantity, "expected": measured[-1].expected,
            "measured": measured[-1].measured,
            "error": errors, "tolerance": tolerance,
            "order": None if np.isnan(order) else round(order, 2),
            "met_on": _first_that_lasts(problem.meshes or (None,), within),
            "pass": within[-1] and _order_is_good(problem, quantity, tolerance, errors, order),
            **_against_asked(problem, quantity, measured, beside or {}),
        })  # fmt: skip
    return rows


def _against_asked(problem, quantity, measured, beside):
    """Return what was asked of a quantity, what it is judged by, and whether it is as asked."""
    judged = {
        "tolerance": problem.tolerance[quantity],
        "mesh": problem.meshes[-1] if problem.meshes else None,
    }
    asked = asked_of(problem.number, quantity)
    if asked is None:
        return {"asked": None, "judged": judged, "as_asked": None,
                "reason": "beside what was asked for"}  # fmt: skip
    errors = dict(zip(problem.meshes or (None,), (r.error for r in measured), strict=False))
    for mesh, readings in beside.items():
        errors[mesh] = next(r.error for r in readings if r.quantity == quantity)
    meshes = sorted(errors, key=lambda mesh: mesh or 0.0)
    met = [abs(errors[mesh]) <= asked.tolerance + ROUNDING for mesh in meshes]
    at = asked.mesh if asked.mesh in errors else meshes[-1]
    good = bool(abs(errors[at]) <= asked.tolerance + ROUNDING)
    same = asked.tolerance == judged["tolerance"] and asked.mesh in (None, judged["mesh"])
    order = "the order is taken over several meshes" if good else "not met on the mesh asked for"
    return {
        "asked": {"tolerance": asked.tolerance, "mesh": asked.mesh, "error": errors[at],
                  "met_on": _first_that_lasts(meshes, met)},
        "judged": judged,
        "as_asked": good,
        "reason": "" if same and good else asked.reason or order,
    }  # fmt: skip


def _first_that_lasts(meshes, within):
    """Return the first mesh from which on all are within the tolerance, or None."""
    met = None
    for mesh, good in zip(reversed(meshes), reversed(within), strict=False):
        if not good:
            break
        met = mesh
    return met


def _order_is_good(problem, quantity, tolerance, errors, order):
    """Return whether the observed order is high enough, or the errors too small to tell."""
    if (
        problem.order is None
        or len(errors) < 2
        or (problem.ordered and quantity not in problem.ordered)
    ):
        return True
    if max(map(abs, errors)) <= max(0.1 * tolerance, 1e-12):
        return True
    return bool(order >= problem.order)
