"""Parameter: a number to be inferred, with its prior, its scale and its bounds."""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError


@dataclass(frozen=True)
class Parameter:
    """A number to be inferred.

    Its prior is Gaussian around ``mean`` where ``sigma`` is given, else uniform over the range.

    Parameters
    ----------
    name : str
        Dotted path of a number in the project file (``joints.fault.kn_gpa_per_m``,
        ``damping.ratio``, ``signature.scale``), or the argument of a hypothesis.
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
        Values in the unit that a search begins at.
    per_hole : bool
        One value for each hole of a blast.
    null : float, optional
        Value in the unit at which the effect of a hypothesis vanishes; the detection limit is
        measured from there. Not for effects that need runs.
    laboratory : (low, high), optional
        Range of samples, to compare the result with; no part of the inference.

    Raises
    ------
    InputError
        If the bounds, the prior or the range of the laboratory are not valid.
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
                    f"{self.name}: a logarithmic range must be positive, got {self.low:g}; leave "
                    "out log or raise low"
                )
        elif not self.sigma > 0.0 or (self.log and not self.mean > 0.0):
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
