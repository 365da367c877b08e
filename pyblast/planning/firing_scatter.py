"""Random times and strengths of the holes of a planned blast."""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import InputError

FARTHEST = 4.0  # standard deviations; what lies beyond, 6 in 10^5, is put there


@dataclass(frozen=True)
class FiringScatter:
    """How holes differ from their plan, and how well that is known.

    Parameters
    ----------
    delay : float, s
        Standard deviation of each time: below 0.1 ms for electronic detonators.
    delay_share : float
        The same as a share of the planned time: 0.01 to 0.03 for pyrotechnic ones.
    charge : float
        Standard deviation of the logarithm of the strength of each hole.
    blast : float
        The same of a factor that all holes of a blast share.
    doubt : float
        Standard deviation of the logarithm of the first three, drawn anew for each blast: 0 where
        they were measured, 0.5 where only their order is known.
    """

    delay: float = 0.0
    delay_share: float = 0.0
    charge: float = 0.0
    blast: float = 0.0
    doubt: float = 0.0

    def __post_init__(self):
        """Check the fields once."""
        for name, value in vars(self).items():
            if not 0.0 <= value < math.inf:
                raise InputError(f"firing scatter: {name} must not be negative, got {value:g}")

    def drawn(self, times, n_blasts: int, seed, scales=1.0):
        """Draw blasts around a plan; theory.md (13.6).

        Parameters
        ----------
        times : (n_holes,) float, s
        n_blasts : int
        seed : int
            The same seed draws the same deviations for any plan.
        scales : float or (n_holes,) float

        Returns
        -------
        times, scales : (n_blasts, n_holes) float64
        """
        generator, times = np.random.default_rng(seed), np.asarray(times, dtype=float)
        deviations = generator.standard_normal((n_blasts, 2 * len(times) + 3))
        deviations = np.clip(deviations, -FARTHEST, FARTHEST)
        late, strong = np.split(deviations[:, 3:], 2, axis=1)
        unsure = np.exp(self.doubt * deviations[:, :2])
        sigma = unsure[:, :1] * np.hypot(self.delay, self.delay_share * times)
        factor = unsure[:, 1:] * self.charge * strong + self.blast * deviations[:, 2:3]
        return times + sigma * late, np.asarray(scales) * np.exp(factor)

    def reach(self, times) -> tuple[float, float]:
        """Return the earliest and the latest time in s that can be drawn for a plan."""
        times = np.asarray(times, dtype=float)
        most = math.exp(FARTHEST * self.doubt) * FARTHEST
        far = most * np.hypot(self.delay, self.delay_share * times)
        return float(np.min(times - far)), float(np.max(times + far))
