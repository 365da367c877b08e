"""Layers, joint sets and faults, as a geologist maps them."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError


def upward_normal(dip, dip_direction):
    """Return the upward unit normal (3,) of a plane.

    Parameters
    ----------
    dip : float, rad, 0 to pi/2
    dip_direction : float, rad, clockwise from north (y)

    Notes
    -----
    ``n = (sin d sin a, sin d cos a, cos d)``.
    """
    steep = np.sin(dip)
    normal = [steep * np.sin(dip_direction), steep * np.cos(dip_direction), np.cos(dip)]
    # Rounding would tilt vertical planes by 1e-16 and cost exact grid coordinates.
    normal = np.where(np.abs(normal) < 1e-15, 0.0, normal)
    return normal / np.linalg.norm(normal)


def _refuse_dip(name, dip):
    """Raise an error where a dip is not an angle between flat and upright, in radians."""
    if dip is None or not 0.0 <= dip <= np.pi / 2.0 + 1e-12:
        raise InputError(f"{name}.dip: must lie between 0 and pi/2 rad, got {dip}")


@dataclass(frozen=True)
class Layer:
    """A layer of ground, listed from the top down.

    Parameters
    ----------
    name : str
    thickness : float or None, m
        None takes the rest down to the bottom.
    edge : float or None, m
        Mean edge of its zones; None takes that of the whole mesh.
    """

    name: str
    thickness: float | None = None
    edge: float | None = None

    def __post_init__(self):
        """Refuse sizes that are not positive."""
        for what in ("thickness", "edge"):
            value = getattr(self, what)
            if value is not None and not value > 0.0:
                raise InputError(f"layer {self.name!r}.{what}: must be positive, got {value:g} m")


@dataclass(frozen=True, eq=False)
class JointSet:
    """Parallel joints at equal spacing.

    Parameters
    ----------
    name : str
    dip, dip_direction : float, rad
    spacing : float, m, normal to the joints
    origin : (3,) float64, m
        A place on one of the joints; None takes the middle of the box.
    regions : sequence of str or None
        Layers that it cuts; None for all.
    persistence : float
        Share of the joint area that is open to slip; the rest is rock.
    """

    name: str
    dip: float
    dip_direction: float
    spacing: float
    origin: tuple[float, float, float] | None = None
    regions: tuple[str, ...] | None = None
    persistence: float = 1.0

    def __post_init__(self):
        """Refuse values out of range."""
        _refuse_dip(self.name, self.dip)
        if not self.spacing > 0.0:
            raise InputError(f"{self.name}.spacing: must be positive, got {self.spacing:g} m")
        if not 0.0 < self.persistence <= 1.0:
            raise InputError(
                f"{self.name}.persistence: must lie between 0 and 1, got {self.persistence:g}"
            )

    @property
    def normal(self) -> np.ndarray:
        """Return the upward unit normal (3,)."""
        return upward_normal(self.dip, self.dip_direction)


@dataclass(frozen=True, eq=False)
class Fault:
    """One plane that cuts everything, or everything within its extent.

    Parameters
    ----------
    name : str
    dip, dip_direction : float, rad
        Both or neither; then ``normal`` is given.
    point : (3,) float64, m
        A place on it, the middle of its extent.
    normal : (3,) float64
    extent : tuple of 2 float or None, m
        Whole length along strike and down dip; None for endless.
    radius : float or None, m
        Of a round fault, cut as a polygon of the same area; instead of ``extent``.
    """

    name: str
    dip: float | None = None
    dip_direction: float | None = None
    point: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal: tuple[float, float, float] | None = None
    extent: tuple[float, float] | None = None
    radius: float | None = None

    def __post_init__(self):
        """Refuse values out of range."""
        if self.normal is None:
            _refuse_dip(self.name, self.dip)
        elif not np.linalg.norm(self.normal) > 0.0:
            raise InputError(f"{self.name}.normal: must not be zero")
        if self.normal is None and self.dip_direction is None:
            raise InputError(f"{self.name}.dip_direction: missing; give it with dip, or a normal")
        if self.extent is not None and self.radius is not None:
            raise InputError(f"{self.name}: give extent or radius, not both")
        sizes = (*(self.extent or ()), *(() if self.radius is None else (self.radius,)))
        if any(not size > 0.0 for size in sizes):
            raise InputError(f"{self.name}: extent and radius must be positive, got {sizes} m")

    @property
    def unit_normal(self) -> np.ndarray:
        """Return the upward unit normal (3,)."""
        if self.normal is None:
            return upward_normal(self.dip, self.dip_direction)
        return np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)


def layer_limits(layers, top, bottom):
    """Return the heights (n_layers + 1,) between the layers, from the top down, in m."""
    limits = [top]
    for number, layer in enumerate(layers):
        last = number == len(layers) - 1
        if layer.thickness is None and not last:
            raise InputError(f"layer {layer.name!r}: only the last layer may take the rest")
        limits.append(bottom if last else limits[-1] - layer.thickness)
    if len(layers) and layers[-1].thickness is not None:
        rest = limits[-2] - bottom
        if abs(rest - layers[-1].thickness) > 1e-6 * (top - bottom):
            raise InputError(
                f"layer {layers[-1].name!r}.thickness: must reach the bottom, {rest:g} m are left, "
                f"got {layers[-1].thickness:g} m; leave it out to take the rest"
            )
    if min(-np.diff(limits)) <= 0.0:
        raise InputError(
            f"layers: must be thinner than the model together, {top - bottom:g} m, "
            f"but {top - limits[-2]:g} m lie above the last one"
        )
    return np.array(limits)
