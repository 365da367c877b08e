"""Where receivers and sources stand: on the ground, inside the mesh, outside of the rim."""

import numpy as np

from ..errors import InputError
from ..meshing.mesh import locate
from ..solving.model import Receiver, Rim
from .config_section import named_error


def place_receivers(parts, mesh) -> tuple[Receiver, ...]:
    """Turn a list of `ReceiverConfig` into receivers; those without height stand on the surface.

    Raises
    ------
    InputError
        If one lies outside of the mesh; it is named.
    """
    found = []
    for part in parts:
        with named_error(f"receivers.{part.name}"):
            place = tuple(on_ground(mesh, part.position_m))
        azimuth = None if part.azimuth_deg is None else float(np.radians(part.azimuth_deg))
        found.append(Receiver(part.name, place, azimuth))
    refuse_outside(mesh, {f"receivers.{part.name}": part.position for part in found})
    return tuple(found)


def on_ground(mesh, place):
    """Return a place (3,) in m, on the surface "top" where no height is given.

    Raises
    ------
    InputError
        If the mesh has no surface "top", or the place lies outside of it.
    """
    if len(place) == 3:
        return [float(value) for value in place]
    if "top" not in mesh.surfaces:
        raise InputError("position_m: needs a height, the mesh has no surface 'top'")
    return [float(place[0]), float(place[1]), _height(mesh, np.array(place, dtype=float))]


def _height(mesh, place):
    """Return the height of the surface "top" at a place (2,)."""
    corners = mesh.points[mesh.surfaces["top"]]
    a, b, c = (corners[:, k, :2] for k in range(3))
    area = _cross(b - a, c - a)
    u = _cross(place - a, c - a) / area
    v = _cross(b - a, place - a) / area
    inside = np.flatnonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9))
    if not len(inside):
        raise InputError(f"position_m: ({place[0]:g}, {place[1]:g}) m lies outside of the ground")
    k = inside[0]
    heights = corners[k, :, 2]
    return float(heights @ [1.0 - u[k] - v[k], u[k], v[k]])


def _cross(a, b):
    """Return the cross product of plane vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def refuse_outside(mesh, places):
    """Refuse places that lie outside of the mesh.

    Parameters
    ----------
    mesh : Mesh
    places : dict of str to (3,) float, m
        By the name that the message gives.

    Raises
    ------
    InputError
        It names the first place.
    """
    if not places:
        return
    try:
        locate(mesh, np.reshape(list(places.values()), (-1, 3)))
    except InputError:
        for name, place in places.items():
            with named_error(name):
                locate(mesh, place)


def make_rim(config):
    """Return the rim of a `Config`: its own, or the padding around sources inside, or None."""
    if config.rim is not None:
        rim = config.rim
        return Rim(tuple(map(tuple, rim.box_m)), rim.width_m, rim.lowest_hz)
    mesh = config.mesh
    inside = config.holes_inside or config.point_forces or config.moment_tensors
    if mesh.padding_m is None or not inside:
        return None
    ends = zip(mesh.origin_m, mesh.size_m, strict=True)
    return Rim(tuple((low, low + size) for low, size in ends), mesh.padding_m)


def check_rim(rim, mesh, places):
    """Refuse a rim that holds nothing, or places (dict of str to (3,) m) inside of it.

    Raises
    ------
    InputError
    """
    centres = mesh.points[mesh.zones].mean(axis=1)
    if not rim.alpha(centres, 1.0).any():
        raise InputError("rim.box_m: holds the whole ground; leave some of it to the rim")
    for name, place in places.items():
        if rim.alpha(np.array([place], dtype=float), 1.0).any():
            raise InputError(f"{name}: lies in the rim, which damps motion; move it into the box")
