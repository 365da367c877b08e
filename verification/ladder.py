"""The ladder: what a rung is, and how it is judged.

A rung measures on one mesh and returns readings and curves; the ladder runs it on its meshes,
finds the observed order, and compares with the tolerances that the rung states.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

RUNGS = {}


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
        """Make a reading whose error is relative to what is expected."""
        return cls(quantity, float(expected), float(measured), float(measured / expected - 1.0))

    @classmethod
    def absolute(cls, quantity, expected, measured):
        """Make a reading whose error is the difference."""
        return cls(quantity, float(expected), float(measured), float(measured - expected))

    @classmethod
    def norm(cls, quantity, expected, measured):
        """Make a reading from two curves: the L2 norm of the difference over that of the first."""
        scale = np.linalg.norm(expected)
        error = float(np.linalg.norm(np.asarray(measured) - expected) / scale)
        return cls(quantity, 0.0, error, error)


@dataclass(frozen=True, eq=False)
class Curve:
    """What the figure of a rung shows: what is expected and what was measured, over one axis.

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
class Rung:
    """A problem with a known answer.

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
        By quantity: the largest absolute error on the mesh that the rung names.
    measure : callable
        ``measure(n)`` for a mesh of ``n`` (edges per wavelength, or what ``unit`` says), or
        ``measure()`` where no mesh is involved; returns a list of `Reading` and a list of `Curve`.
    meshes : tuple of float
    unit : str
        What the numbers in ``meshes`` count.
    order : float or None
        Least observed order of convergence; None for rungs without a mesh and for exact ones.
    ordered : tuple of str
        Quantities whose order is judged; empty: all that have a tolerance.
    quick : bool
        Whether `./dev test` runs it, on its first mesh.
    note : str
        What the reader of the table should know: which mesh meets the tolerance and why.
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


def rung(number, title, **about):
    """Register a function as the measurement of a rung; keywords are those of `Rung`."""

    def register(measure):
        RUNGS[number] = Rung(number, title, measure=measure, **about)
        return measure

    return register


def observed_order(meshes, errors):
    """Return the slope of log error over log mesh by least squares, nan where an error is zero."""
    errors = np.abs(errors)
    if len(errors) < 2 or not (errors > 0.0).all():
        return float("nan")
    return float(-np.polyfit(np.log(meshes), np.log(errors), 1)[0])


def judged(one, readings):
    """Judge a rung from its readings on each mesh.

    Parameters
    ----------
    one : Rung
    readings : list of list of Reading
        One list for each mesh, or one list where there is no mesh.

    Returns
    -------
    list of dict
        One row for each quantity that has a tolerance.
    """
    rows = []
    for quantity, tolerance in one.tolerance.items():
        found = [next(r for r in mesh if r.quantity == quantity) for mesh in readings]
        errors = [r.error for r in found]
        within = [bool(abs(error) <= tolerance) for error in errors]
        order = observed_order(one.meshes, errors) if len(errors) > 1 else float("nan")
        rows.append({
            "quantity": quantity, "expected": found[-1].expected, "measured": found[-1].measured,
            "error": errors, "tolerance": tolerance,
            "order": None if np.isnan(order) else round(order, 2),
            "met_on": _first_that_lasts(one.meshes or (None,), within),
            "pass": within[-1] and _order_is_good(one, quantity, tolerance, errors, order),
        })  # fmt: skip
    return rows


def _first_that_lasts(meshes, within):
    """Return the first mesh from which on all are within the tolerance, or None."""
    met = None
    for mesh, good in zip(reversed(meshes), reversed(within), strict=False):
        if not good:
            break
        met = mesh
    return met


def _order_is_good(one, quantity, tolerance, errors, order):
    """Tell whether errors fall as fast as they should, or are too small for it to matter."""
    if one.order is None or len(errors) < 2 or (one.ordered and quantity not in one.ordered):
        return True
    if max(map(abs, errors)) <= max(0.1 * tolerance, 1e-12):
        return True
    return bool(order >= one.order)
