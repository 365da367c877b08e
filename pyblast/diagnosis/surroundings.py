"""Motion around each receiver, by one run of each blast: what it would record elsewhere."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ..projects.site import Site
from .forward import Forward

STEPS = 3  # on either side of a receiver
STEPS_PER_WAVE = 6.0  # of the shortest S wave at the surface


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Motion on a square grid around each receiver, as high as it stands.

    Parameters
    ----------
    ways : (n,) float64, m
        Of the grid, to the east and to the north.
    motion : (n_blasts, n_receivers, n, n, 3, n_samples) float64, m/s
    """

    ways: np.ndarray
    motion: np.ndarray

    def change(self, receiver: int, east: float, north: float):
        """Return what else one receiver would record elsewhere, (n_blasts, 3, n_samples) m/s.

        By cubic splines; beyond the grid as at its rim.
        """
        cardinal = make_interp_spline(self.ways, np.eye(len(self.ways)), 3)
        way = np.clip((east, north), self.ways[0], self.ways[-1])
        here, there = (np.multiply.outer(*cardinal(one)) for one in (np.zeros(2), way))
        return np.tensordot(there - here, self.motion[:, receiver], ([0, 1], [1, 2]))


def surroundings(forward: Forward, site: Site) -> Surroundings:
    """Run every blast of a case with listening points around all receivers."""
    case = forward.case
    slowest = min(material.cs for _, _, material in site.layers)
    ways = np.arange(-STEPS, STEPS + 1) * slowest / (STEPS_PER_WAVE * case.band.high)
    grid = [(x, y) for x in ways for y in ways]
    there = {r.name: r for r in site.receivers}
    points = tuple(
        replace(there[name], name=f"{name} {k}", position=np.add(there[name].position, (x, y, 0.0)))
        for name in case.receivers
        for k, (x, y) in enumerate(grid)
    )
    models = [replace(forward.model(site, blast), receivers=points) for blast in case.blasts]
    done = forward.made(models)
    motion = np.stack(
        [
            [run.seismograms[one.name].sampled(0.0, case.dt, case.n_samples).velocity.T
             for one in points]
            for run in done
        ]
    )  # fmt: skip
    n = len(ways)
    return Surroundings(ways, motion.reshape(len(models), -1, n, n, *motion.shape[2:]))
