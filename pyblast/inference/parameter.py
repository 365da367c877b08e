"""Parameters with priors, and the search problem over their ranges."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..errors import InputError
from ..units import split_key

SPEED, STIFFNESS, OTHER = "speed", "stiffness", "other"
DENSITY, GEOMETRY = "density", "geometry"  # kinds that a search holds
_KINDS = {"cp": SPEED, "cs": SPEED, "kn": STIFFNESS, "ks": STIFFNESS}


def kind_of_key(path: str) -> str:
    """Return whether a number of a project is a wave speed, a joint stiffness or another."""
    return _KINDS.get(split_key(path.rpartition(".")[-1])[0], OTHER)


@dataclass(frozen=True)
class Parameter:
    """Parameter: a number to be inferred, with its prior, scale and bounds.

    The prior is Gaussian around ``mean`` where ``sigma`` is given, else uniform over the range.

    Parameters
    ----------
    name : str
        Dotted path of a number in the project file (``joints.fault.kn_gpa_per_m``,
        ``damping.ratio``, ``signature.scale``), a factor on one such as ``rock.cp``, or the
        argument of a hypothesis.
    low, high : float
        Bounds in the unit; a search stays within. Finite for a uniform prior.
    log : bool
        Whether search and prior are on a logarithmic scale.
    unit : str
        SI for a Gaussian prior, empty for a ratio; the key names that of a project file.
    mean : float, optional
        Of the prior, in the unit, also where ``log`` is set.
    sigma : float, optional
        Standard deviation of the prior, in the unit, or of the natural logarithm if ``log``.
    starts : tuple of float
        Starting values of a search, in the unit.
    per_hole : bool
        One value for each hole of a blast.
    null : float, optional
        Value in the unit at which the effect of a hypothesis vanishes, may be infinite; the
        detection limit is measured from there.
    laboratory : (low, high), optional
        Range of laboratory samples, to compare the result with; not part of the inference.
    kind : str
        Of the number: wave speed, stiffness, density, geometry or other.
    step : float
        Of the coordinate, for a derivative.
    act : callable, optional
        ``(project, value) -> project``; by default the key ``name`` of the project is set.

    Raises
    ------
    InputError
        If the bounds, the prior or the laboratory range are not valid.
    """

    name: str
    low: float = -math.inf
    high: float = math.inf
    log: bool = False
    unit: str = ""
    mean: float | None = None
    sigma: float | None = None
    starts: tuple[float, ...] = ()
    per_hole: bool = False
    null: float | None = None
    laboratory: tuple[float, float] | None = None
    kind: str = OTHER
    step: float = 0.0
    act: Callable[[Any, float], Any] | None = field(default=None, compare=False)

    def __post_init__(self):
        """Check bounds and prior."""
        if (self.mean is None) != (self.sigma is None):
            raise InputError(f"{self.name}: a Gaussian prior needs both mean and sigma")
        if self.sigma is None:
            for end in ("low", "high"):
                if not math.isfinite(getattr(self, end)):
                    raise InputError(f"{self.name}: {end} must be finite, got {getattr(self, end)}")
            if self.log and not self.low > 0.0:
                raise InputError(
                    f"{self.name}: a logarithmic range must be positive, got {self.low:g}; omit "
                    "log or raise low"
                )
        elif self.mean is not None and (not self.sigma > 0.0 or (self.log and not self.mean > 0.0)):
            raise InputError(
                f"{self.name}: sigma must be positive, and mean too if log is set, got "
                f"{self.mean:g} and {self.sigma:g}"
            )
        if not self.low < self.high:
            raise InputError(
                f"{self.name}: low must be below high, got {self.low:g} and {self.high:g}"
            )
        if self.laboratory is not None:
            object.__setattr__(self, "laboratory", tuple(self.laboratory))
            if not self.laboratory[0] <= self.laboratory[1]:
                raise InputError(f"{self.name}: laboratory must rise, got {self.laboratory}")

    def standardised(self, value):
        """Return a value in standard deviations of the Gaussian prior from its mean."""
        if self.log:
            return np.log(value / self.mean) / self.sigma
        return (value - self.mean) / self.sigma

    def value(self, standardised):
        """Return the value in the unit; the inverse of `standardised`."""
        if self.log:
            return self.mean * np.exp(self.sigma * standardised)
        return self.mean + self.sigma * standardised

    @property
    def uniform(self) -> bool:
        """Whether the prior is uniform over the range."""
        return self.sigma is None

    @property
    def relative(self) -> bool:
        """Whether the coordinate is the logarithm of a factor."""
        return self.log or self.low > 0.0

    @property
    def moves(self) -> bool:
        """Whether a search runs other values of it; derivatives are taken of all."""
        return self.kind not in (DENSITY, GEOMETRY)

    @property
    def start(self) -> float:
        """Value at coordinate zero: the first starting value, or the mean of a Gaussian prior."""
        return self.starts[0] if self.mean is None else self.mean

    def at(self, coordinate):
        """Return the value at a coordinate.

        Coordinates are logarithms of factors on `start` where values are positive, else
        differences from it, as shares of a range.
        """
        if self.relative:
            return self.start * np.exp(coordinate)
        return self.start + coordinate * (self.high - self.low if self.uniform else 1.0)

    def coordinate(self, value):
        """Return the coordinate of a value; the inverse of `at`."""
        if self.relative:
            return np.log(value / self.start)
        return (value - self.start) / (self.high - self.low if self.uniform else 1.0)

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of the coordinate, (2,)."""
        if self.sigma is not None:
            return 0.0, self.sigma
        low, high = self.coordinate(self.low), self.coordinate(self.high)
        return float(0.5 * (low + high)), float(high - low) / math.sqrt(12.0)

    @property
    def range(self) -> tuple[float, float]:
        """Coordinates of the bounds, (2,); infinite where the prior is Gaussian."""
        if not self.uniform:
            return -math.inf, math.inf
        return float(self.coordinate(self.low)), float(self.coordinate(self.high))

    def set(self, state, value: float):
        """Return a state, such as a `Project`, with a value of the parameter in its unit."""
        return state.set({self.name: value}) if self.act is None else self.act(state, value)


def set_all(state, parameters: Sequence[Parameter], values):
    """Return a state with values (n,) of parameters: keys of its file at once, then the others.

    Where those are at their start they change nothing.

    Raises
    ------
    InputError
        If a key names no number, or a value breaks a rule of the project file.
    """
    pairs = list(zip(parameters, np.asarray(values, dtype=np.float64).tolist(), strict=True))
    keys = {parameter.name: value for parameter, value in pairs if parameter.act is None}
    state = state.set(keys) if keys else state
    for parameter, value in pairs:
        if parameter.act is not None and value != parameter.start:
            state = parameter.act(state, value)
    return state


@dataclass(frozen=True, eq=False)
class Problem:
    """Search problem: a misfit over a box of parameters.

    Parameters
    ----------
    low, high : (n,) float64
        Bounds, in the units of the parameters.
    log : (n,) bool
        Whether a parameter is searched on a logarithmic scale.
    evaluate : callable
        ``(m, n) -> (m,)`` misfits of points within the bounds, in their order, infinite where the
        evaluation fails. The m evaluations run in batches, so a method should pass many at once.
        The same point always has the same misfit.
    vectors : callable, optional
        ``(m, n) -> (m,), (m, k)``: misfits as before, and residuals whose sum of squares decreases
        with the misfit. Costs as much as the misfits.
    """

    low: np.ndarray
    high: np.ndarray
    log: np.ndarray
    evaluate: Callable[[np.ndarray], np.ndarray]
    vectors: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None

    def __post_init__(self):
        for name, kind in (("low", np.float64), ("high", np.float64), ("log", bool)):
            object.__setattr__(self, name, np.array(getattr(self, name), kind, ndmin=1))
        if not self.low.shape == self.high.shape == self.log.shape:
            raise InputError("problem: low, high and log must have one value for each parameter")
        if not np.all(self.low < self.high):
            raise InputError(f"problem.low: must be below high, got {self.low} and {self.high}")
        if np.any(self.log & (self.low <= 0.0)):
            raise InputError(f"problem.low: must be positive where log is set, got {self.low}")

    @property
    def n_parameters(self) -> int:
        """Number of parameters."""
        return len(self.low)

    def points(self, unit) -> np.ndarray:
        """Return the points (..., n) at coordinates in the unit cube (..., n)."""
        unit = np.asarray(unit, dtype=np.float64)
        low, high = self._scaled(self.low), self._scaled(self.high)
        values = low + np.clip(unit, 0.0, 1.0) * (high - low)
        values = np.where(self.log, np.exp(np.where(self.log, values, 0.0)), values)
        values = np.where(unit <= 0.0, self.low, np.where(unit >= 1.0, self.high, values))
        return np.clip(values, self.low, self.high)

    def unit(self, points) -> np.ndarray:
        """Return the coordinates in the unit cube (..., n) of points (..., n)."""
        low, high = self._scaled(self.low), self._scaled(self.high)
        return (self._scaled(np.asarray(points, dtype=np.float64)) - low) / (high - low)

    def _scaled(self, values):
        """Return values, or their logarithms where ``log`` is set."""
        return np.where(self.log, np.log(np.where(self.log, values, 1.0)), values)


def problem_of(
    parameters: Sequence[Parameter], evaluate: Callable, vectors: Callable | None = None
) -> Problem:
    """Return the search problem over the ranges of parameters."""
    low, high, log = ([getattr(row, name) for row in parameters] for name in ("low", "high", "log"))
    return Problem(np.array(low), np.array(high), np.array(log), evaluate, vectors)


@dataclass(frozen=True, eq=False)
class Trace:
    """Trace of a search: all evaluations in their order.

    Parameters
    ----------
    points : (m, n) float64
    misfits : (m,) float64
    accepted : (m,) bool
        Whether the search accepted the point; for methods without that step, whether it was the
        best so far.
    """

    points: np.ndarray
    misfits: np.ndarray
    accepted: np.ndarray

    @property
    def best(self) -> int:
        """Row of the lowest misfit, the first of several."""
        return int(np.argmin(self.misfits))


class SearchMethod(Protocol):
    """Search method: a function of a problem, a number of evaluations and a seed."""

    def __call__(self, problem: Problem, budget: int, seed: int) -> Trace:
        """Evaluate at most ``budget`` points; the same seed gives the same trace."""
        ...


class Spent(Exception):
    """The evaluation budget is used up."""


class Evaluations:
    """Evaluations of one search at coordinates in the unit cube, within a budget.

    Parameters
    ----------
    problem : Problem
    budget : int
        Evaluations allowed.

    Attributes
    ----------
    remaining : int
        Evaluations that the budget still allows.
    misfits : list of float
        In the order of the trace.
    steps : set of int or None
        Rows that the search accepted; None for a method without that step.

    Raises
    ------
    InputError
        If the budget is below one.
    """

    def __init__(self, problem: Problem, budget: int):
        if budget < 1:
            raise InputError(f"search.budget: must be at least 1 evaluation, got {budget}")
        self.problem, self.remaining = problem, budget
        self.points: list[np.ndarray] = []
        self.misfits: list[float] = []
        self.steps: set[int] | None = None

    def at(self, unit) -> np.ndarray:
        """Return the misfits (m,) at coordinates (m, n) in the unit cube.

        Raises
        ------
        Spent
            After as many of the first points as the budget allows.
        """
        return self._evaluate(unit, lambda points: (self.problem.evaluate(points),))[0]

    def vectors(self, unit) -> tuple[np.ndarray, np.ndarray]:
        """Return misfits (m,) and residuals (m, k) at coordinates (m, n); raises as `at`."""
        return self._evaluate(unit, self.problem.vectors)

    def trace(self) -> Trace:
        """Return the trace of all evaluations."""
        misfits = np.array(self.misfits)
        if self.steps is None:
            before = np.minimum.accumulate(np.concatenate([[np.inf], misfits[:-1]]))
            accepted = misfits < before
        else:
            accepted = np.isin(np.arange(len(misfits)), list(self.steps))
        return Trace(np.array(self.points), misfits, accepted)

    def _evaluate(self, unit, evaluate):
        """Evaluate as many of some points as the budget allows, and record them."""
        points = self.problem.points(unit)
        allowed = points[: self.remaining]
        if len(allowed):
            answer = evaluate(allowed)
            self.remaining -= len(allowed)
            self.points.extend(allowed)
            self.misfits.extend(answer[0].tolist())
        if len(allowed) < len(points):
            raise Spent
        return answer
