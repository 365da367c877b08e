"""Planes that cut a geometry, those of joint sets one by one."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...errors import InputError
from ..grid import Geometry

PARALLEL = 1e-7  # sine of the angle between directions that count as parallel
LEAST_AREA = 1e-3  # of the square of the spacing, of a joint that cuts a corner of the box


class NotMapped(InputError):
    """The ground can't be a mesh of this kind; the message says what stands in the way."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Plane of a geometry, or the rectangle of it that is open.

    Parameters
    ----------
    name : str
    normal : (3,) float64, unit, upward
    point : (3,) float64, m
        On it; the centre of its extent.
    strike : (3,) float64, unit, horizontal
    extent : tuple of 2 float or None, m
        Full length along strike and down dip.
    heights : tuple of 2 float, m
        Of the layers that it cuts.
    """

    name: str
    normal: np.ndarray
    point: np.ndarray
    strike: np.ndarray
    extent: tuple[float, float] | None = None
    heights: tuple[float, float] = (-np.inf, np.inf)

    @property
    def down(self) -> np.ndarray:
        """Unit vector (3,) down the dip."""
        return np.cross(self.normal, self.strike)

    def corners(self, reach: float) -> np.ndarray:
        """Return the corners (4, 3) in m of the extent, else of a square of half width `reach`."""
        a, b = (reach, reach) if self.extent is None else (0.5 * np.array(self.extent))
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return np.array([self.point + i * a * self.strike + j * b * self.down for i, j in signs])

    def area_in(self, box: np.ndarray) -> float:
        """Return the area in m2 inside a box (3, 2)."""
        corners = self.corners(2.0 * float(np.linalg.norm(np.ptp(box, axis=1))))
        for axis, sign in ((axis, sign) for axis in range(3) for sign in (-1, 1)):
            normal = sign * np.eye(3)[axis]
            corners = _below(corners, normal, sign * box[axis, (sign + 1) // 2])
        if len(corners) < 3:
            return 0.0
        parts = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0])
        return float(0.5 * np.linalg.norm(parts.sum(axis=0)))


def _below(corners, normal, offset):
    """Return the part of a convex polygon (n, 3) where normal · x <= offset."""
    height = corners @ normal - offset
    parts = []
    for a, b, ha, hb in zip(
        corners, np.roll(corners, -1, axis=0), height, np.roll(height, -1), strict=True
    ):
        parts += [a] if ha <= 0.0 else []
        parts += [a + (b - a) * ha / (ha - hb)] if ha * hb < 0.0 else []
    return np.array(parts).reshape(-1, 3)


def planes_of(geometry: Geometry) -> list[Plane]:
    """Return the planes that cut a geometry, those of sets one by one.

    Raises
    ------
    NotMapped
        If only round or scattered parts of a plane are open.
    InputError
        If a fault or a set does not cut the model.
    """
    box = geometry.box.copy()
    if geometry.surface is not None:
        box[2, 1] = max(box[2, 1], geometry.surface[..., 2].max())
    planes = []
    for fault in geometry.faults:
        if fault.radius is not None or fault.polygon is not None:
            raise NotMapped(f"{fault.name!r} is no rectangle")
        normal, point = fault.unit_normal, np.asarray(fault.point, dtype=float)
        plane = Plane(fault.name, normal, point, _strike(normal, fault), fault.extent)
        planes += [plane] if plane.area_in(box) > 0.0 else []
    for part in geometry.joint_sets:
        if part.persistence < 1.0:
            raise NotMapped(f"{part.name!r} has intact parts (persistence below 1)")
        planes += _planes_of_set(part, geometry, box)
    for part in (*geometry.faults, *geometry.joint_sets):
        if not any(plane.name == part.name for plane in planes):
            raise InputError(f"mesh: {part.name!r} does not cut the model")
    return planes


def _planes_of_set(part, geometry, box):
    """Return the planes of a joint set that cut a box, by the layers that they cut."""
    origin = geometry.box.mean(axis=1) if part.origin is None else np.array(part.origin, float)
    corners = np.array(np.meshgrid(*box)).reshape(3, -1).T
    reach = (corners - origin) @ part.normal / part.spacing
    # Without planes that only touch the box.
    numbers = range(int(np.ceil(reach.min() + 1e-6)), int(np.floor(reach.max() - 1e-6)) + 1)
    spans = [(-np.inf, np.inf)]
    if part.regions is not None:
        limits = geometry.limits.copy()
        limits[[0, -1]] = np.inf, -np.inf
        spans = [
            (low, high)
            for layer, (high, low) in zip(geometry.layers, pairwise(limits), strict=True)
            if layer.name in part.regions
        ]
    strike = _strike(part.normal, part)
    planes = [
        Plane(part.name, part.normal, origin + k * part.spacing * part.normal, strike)
        for k in numbers
    ]
    least = LEAST_AREA * part.spacing**2
    return [
        Plane(part.name, plane.normal, plane.point, strike, heights=span)
        for plane in planes
        if plane.area_in(box) > least
        for span in spans
    ]


def _strike(normal, part):
    """Return the horizontal unit vector (3,) in a plane, 90 degrees left of its dip direction."""
    flat = np.hypot(*normal[:2])
    if flat > PARALLEL:
        return np.array([-normal[1], normal[0], 0.0]) / flat
    towards = part.dip_direction or 0.0
    return np.array([-np.cos(towards), np.sin(towards), 0.0])
