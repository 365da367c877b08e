"""True ground of a case: layers below a surface, bodies, a smooth random field, attenuation."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

VOID = 0.0  # factor of a body that is not there


@dataclass(frozen=True)
class Rock:
    """An isotropic elastic material: density in kg/m³, P and S speed in m/s."""

    density: float
    cp: float
    cs: float

    def scaled(self, density=1.0, cp=1.0, cs=1.0):
        """Return the material with factors on its three values."""
        return Rock(self.density * density, self.cp * cp, self.cs * cs)


@dataclass(frozen=True)
class Body:
    """A box of other ground.

    Parameters
    ----------
    limits : tuple of 3 (low, high), m
        In x, y and in height over the flat ground; below a hill it bends with the ground.
    factor : float
        Of both wave speeds; `VOID` leaves a cavity with free walls.
    """

    limits: tuple[tuple[float, float], ...]
    factor: float

    def holds(self, places):
        """Tell for places (n, 3) whether they are inside."""
        low, high = np.array(self.limits).T
        return ((places > low) & (places < high)).all(axis=1)


@dataclass(frozen=True)
class Field:
    """A smooth random field: a sum of plane cosines with a Gaussian spectrum.

    Parameters
    ----------
    deviation : float
        Standard deviation of the factor on both speeds.
    length : float, m
        Of correlation: exp(-r² / 2 length²).
    seed : int
    """

    deviation: float
    length: float
    seed: int
    waves: int = 200

    def factor(self, places):
        """Return the factor (n,) on both speeds at places (n, 3)."""
        rng = np.random.default_rng(self.seed)
        numbers = rng.normal(0.0, 1.0 / self.length, (3, self.waves))
        phases = places @ numbers + rng.uniform(0.0, 2.0 * np.pi, self.waves)
        return 1.0 + self.deviation * np.sqrt(2.0 / self.waves) * np.cos(phases).sum(axis=1)


@dataclass(frozen=True)
class Ground:
    """Ground of a site.

    Parameters
    ----------
    layers : tuple of (thickness m or None, Rock)
        From the top down; the last has no end.
    height : callable, optional
        ``(x, y) -> z`` of the surface in m, of arrays; flat at zero without it.
    bodies : tuple of Body
    field : Field, optional
    q : float, optional
        Quality factor of S waves; P waves have `P_OVER_S` of it.
    """

    layers: tuple[tuple[float | None, Rock], ...]
    height: Callable | None = None
    bodies: tuple[Body, ...] = ()
    field: Field | None = None
    q: float | None = None

    def tops(self):
        """Return the heights in m of the tops of all layers but the first."""
        return -np.cumsum([thickness for thickness, _ in self.layers[:-1]])

    def layer_of(self, z):
        """Return the number (n,) of the layer at heights (n,) over the flat ground."""
        return np.searchsorted(-self.tops(), -np.asarray(z))

    def surface(self, x, y):
        """Return the height in m of the surface at x, y."""
        x = np.asarray(x, float)
        return np.zeros_like(x) if self.height is None else self.height(x, np.asarray(y, float))
