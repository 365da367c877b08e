"""Verification suite: cases with known answers, observed order of convergence, pass or fail.

A case measures on one mesh and returns readings and curves. The suite runs it on its meshes,
computes the observed order, and compares the errors with the tolerances of the case.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .asked import asked_of

CASES = {}
SMALL, SMALLEST = 0.1, 1e-12  # of a tolerance; errors below either need no order


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
    ordered : tuple of str, or dict of str to float
        Quantities whose order is judged, or their own least orders; empty: all with a tolerance.
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
    ordered: tuple[str, ...] | dict[str, float] = ()
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
    for quantity in problem.tolerance:
        measured = [_of(mesh, quantity) for mesh in readings]
        row = {
            "quantity": quantity, "expected": measured[-1].expected,
            "measured": measured[-1].measured, "error": [r.error for r in measured],
        }  # fmt: skip
        others = {mesh: _of(found, quantity).error for mesh, found in (beside or {}).items()}
        rows.append(verdict(problem, row, others))
    return rows


def verdict(problem, row, beside=None):
    """Return a row with what was asked, what it is judged by, and whether its errors meet both.

    Parameters
    ----------
    problem : Case
    row : dict
        ``quantity`` and ``error``, one for each mesh; a stored row is judged anew.
    beside : dict of float to float, optional
        Errors on further meshes, by mesh; by default that of the row on the mesh asked for.

    Returns
    -------
    dict
        ``least_order`` is None where no order is judged; ``unordered`` says why.
    """
    quantity, errors = row["quantity"], row["error"]
    tolerance, meshes = problem.tolerance[quantity], problem.meshes[: len(errors)] or (None,)
    order = observed_order(meshes, errors) if len(errors) > 1 else float("nan")
    least, unordered = _least_order(problem, quantity, errors)
    within = [bool(abs(error) <= tolerance) for error in errors]
    asked = asked_of(problem.number, quantity)
    if beside is None:
        kept = row["asked"] or {"mesh": None}
        beside = {} if kept["mesh"] is None else {kept["mesh"]: kept["error"]}
    every = {**dict(zip(meshes, errors, strict=True)), **beside}
    return {
        "quantity": quantity, "expected": row["expected"], "measured": row["measured"],
        "error": errors, "tolerance": tolerance,
        "order": None if np.isnan(order) else order, "least_order": least, "unordered": unordered,
        "met_on": _first_that_lasts(meshes, within),
        "pass": within[-1] and (least is None or bool(order >= least)),
        "judged": {"tolerance": tolerance, "mesh": meshes[-1]},
        **_against_asked(asked, every, order),
    }  # fmt: skip


def _of(readings, quantity):
    """Return the reading of a quantity."""
    return next(r for r in readings if r.quantity == quantity)


def _least_order(problem, quantity, errors):
    """Return the order that errors must fall with, or None and why none is judged."""
    if len(errors) < 2:
        return None, ""
    if max(map(abs, errors)) <= small(problem.tolerance[quantity]):
        return None, "small"
    if problem.order is None or (problem.ordered and quantity not in problem.ordered):
        return None, "not judged"
    own = problem.ordered if isinstance(problem.ordered, dict) else {}
    return own.get(quantity, problem.order), ""


def small(tolerance):
    """Return the error below which, on every mesh, an order tells nothing."""
    return max(SMALL * tolerance, SMALLEST)


def _against_asked(asked, errors, order):
    """Return what was asked of a quantity, whether its errors by mesh meet it, and what lacks."""
    if asked is None:
        return {"asked": None, "as_asked": None, "reason": ""}
    meshes = sorted(errors, key=lambda mesh: mesh or 0.0)
    at = asked.mesh if asked.mesh in errors else meshes[-1]
    over = abs(errors[at]) / asked.tolerance
    met = [abs(errors[mesh]) <= asked.tolerance for mesh in meshes]
    return {
        "asked": {"tolerance": asked.tolerance, "mesh": asked.mesh, "error": errors[at],
                  "met_on": _first_that_lasts(meshes, met)},
        "as_asked": bool(abs(errors[at]) <= asked.tolerance),
        "reason": "" if abs(errors[at]) <= asked.tolerance else lacking(over, at, order),
    }  # fmt: skip


def lacking(over, mesh, order):
    """Say what a miss of ``over`` times the tolerance lacks: a mesh, by the observed order."""
    if mesh is None:
        return f"{over:.3g} times as much as asked"
    if not order > 0.0:
        return "the error does not fall with the mesh"
    return f"order {order:.2g}: asks for {mesh * over ** (1.0 / order):.3g}"


def _first_that_lasts(meshes, within):
    """Return the first mesh from which on all are within the tolerance, or None."""
    met = None
    for mesh, good in zip(reversed(meshes), reversed(within), strict=False):
        if not good:
            break
        met = mesh
    return met
