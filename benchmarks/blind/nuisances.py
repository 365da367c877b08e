"""Harmless errors: how a true site differs from what is believed of it where nothing is missing."""

from dataclasses import dataclass, replace

import numpy as np

from pyblast.model.ground_fields import EDGES_PER_LENGTH, Heterogeneity
from pyblast.model.material import Material

from .sites import SIZE

EARLY = 0.2e-3  # s, of hole times and clocks, either way
LEAD = 0.04  # s, by which all true holes fire later, so that none fires before a run begins


@dataclass(frozen=True)
class Level:
    """How large harmless errors are.

    Parameters
    ----------
    speed : float
        Share of wave speeds and densities, either way.
    stiffness : float
        Factor on joint stiffness, either way.
    place : float, m
        Of receivers, along each axis, either way.
    deviation : tuple of 2 float
        Range of the standard deviation of heterogeneity.
    """

    speed: float
    stiffness: float
    place: float
    deviation: tuple[float, float]

    def twice(self):
        """Return the level with all errors twice as large."""
        low, high = self.deviation
        return Level(2 * self.speed, self.stiffness**2, 2 * self.place, (2 * low, 2 * high))


_SECOND = Level(0.05, 1.5, 1.0, (0.01, 0.03))
LEVELS = {1: Level(0.02, 1.2, 0.5, (0.005, 0.015)), 2: _SECOND, 3: _SECOND.twice()}


def shaken(site, level: int, rng):
    """Return the true site, all holes `LEAD` late, and lags of clocks in s by blast, receiver."""
    size = LEVELS[level]

    def near(share):
        return float(1.0 + rng.uniform(-share, share))

    layers = tuple(
        (name, thickness,
         Material.from_speeds(m.density * near(0.02), m.cp * near(size.speed),
                              m.cs * near(size.speed)))
        for name, thickness, m in site.layers
    )  # fmt: skip
    limit = np.log(size.stiffness)
    joints = tuple(
        replace(
            j, joint=replace(j.joint, properties={
                key: value * float(np.exp(rng.uniform(-limit, limit)))
                for key, value in j.joint.properties.items()
            })
        )
        for j in site.joints
    )  # fmt: skip
    receivers = tuple(replace(r, position=_moved(r.position, size.place, rng))
                      for r in site.receivers)  # fmt: skip
    blasts = {
        name: replace(b, times=LEAD + b.times + rng.uniform(-EARLY, EARLY, len(b.times)))
        for name, b in site.blasts.items()
    }
    ground = Uneven(
        float(rng.uniform(*size.deviation)), float(rng.uniform(26.0, 50.0)),
        int(rng.integers(2**31)),
    )  # fmt: skip
    lags = {b: {r.name: float(rng.uniform(-EARLY, EARLY)) for r in receivers} for b in blasts}
    site = replace(site, layers=layers, joints=joints, receivers=receivers, blasts=blasts,
                   ground=(ground,))  # fmt: skip
    return site, lags


class Uneven(Heterogeneity):
    """Heterogeneity no finer than what zones inside the box carry; the sponge layer may not."""

    def factor(self, places, edges):
        """Return the factor (n,) at places (n, 3) of a mesh with edges (n,) in m."""
        low, high = np.zeros(3) - (0.0, 0.0, SIZE[2]), np.array(SIZE)
        inside = ((places > low) & (places < high)).all(axis=1)
        finest = EDGES_PER_LENGTH * np.median(edges[inside])
        field = Heterogeneity(self.deviation, max(self.length, float(finest)), self.seed)
        return field.factor(places, edges[inside])


def _moved(place, reach, rng):
    """Return a place somewhere near; what is on the ground stays on it."""
    x, y, z = (float(value + rng.uniform(-reach, reach)) for value in place)
    return x, y, z if place[2] < 0.0 else place[2]
