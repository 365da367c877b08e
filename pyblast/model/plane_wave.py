"""Plane waves through viscous boundaries, with their reflections at a plane free surface."""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np

from ..errors import InputError
from ..mesh.mesh import surface_areas, surface_zones
from .boundary import Viscous
from .model import Model
from .source import PlaneWave, TimeFunction


class NodalLoads(Protocol):
    """Collector of nodal forces (n, 3) that follow functions of time, with delays (n,) in s."""

    def add_history(self, function: TimeFunction) -> int: ...  # noqa: D102
    def add(  # noqa: D102
        self, nodes: np.ndarray, vectors: np.ndarray, number: int, delays: np.ndarray
    ) -> None: ...


SAME = 1e-6  # relative tolerance for equal media and planes


def add_plane_wave(
    loads: NodalLoads,
    model: Model,
    wave: PlaneWave,
    impedance: Callable[[str], dict[int, np.ndarray]],
) -> None:
    """Add the nodal forces of a plane wave and its reflections on viscous boundaries.

    Parameters
    ----------
    loads : Loads
    model : Model
    wave : PlaneWave
    impedance : callable
        Surface name to dict of node to (3, 3) impedance in N s/m.

    Raises
    ------
    InputError
        If a face is not viscous, media along the faces differ or are not isotropic and elastic,
        the free surface is not plane, or SV meets it beyond the critical angle.
    """
    surfaces = _faces(model, wave)
    density, cp, cs = _medium(model, surfaces)
    trains = _trains(model, wave, cp, cs)
    points = model.nodes.points
    first = (points @ trains[0][0]).min()
    number = loads.add_history(wave.history)
    lame, shear = density * (cp**2 - 2.0 * cs**2), density * cs**2
    for surface in surfaces:
        matrices = impedance(surface)
        nodes = np.fromiter(matrices, dtype=int)
        corner, area, normal = model.nodes.surface_areas(surface)
        at = np.searchsorted(nodes, corner)
        for slowness, motion, lag in trains:
            force = np.stack(list(matrices.values())) @ motion
            traction = normal @ stress_of(slowness, motion, lame, shear)
            np.add.at(force, at, area[:, None] * traction)
            delay = points[nodes] @ slowness + lag - first
            loads.add(nodes, force, number, delay)


def stress_of(slowness: np.ndarray, motion: np.ndarray, lame: float, shear: float) -> np.ndarray:
    """Return the stress (3, 3) of a wave ``v = motion f(t - slowness x)`` per ``f``; (4.9)."""
    both = np.outer(motion, slowness)
    return -(lame * (motion @ slowness) * np.eye(3) + shear * (both + both.T))


def reflected(
    slowness: np.ndarray, motion: np.ndarray, cp: float, cs: float, normal: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]] | None:
    """Return the reflections of a plane wave at a free surface.

    Parameters
    ----------
    slowness, motion : (3,) float64
        Slowness of the incident wave, s/m, and its amplitude.
    cp, cs : float, m/s
    normal : (3,) float64
        Unit, out of the ground.

    Returns
    -------
    list of (slowness (3,), motion (3,)), or None
        None beyond the critical angle of SV.

    Notes
    -----
    P and two polarisations of S whose tractions cancel that of the incident wave: theory.md (4.11);
    a single SH wave where the motion is parallel to the surface.
    """
    along = slowness - (slowness @ normal) * normal
    steep = 1.0 / np.array([cp, cs]) ** 2 - along @ along
    if max(abs(motion @ normal), abs(motion @ slowness) * cs) < SAME:  # SH
        return [(along - math.sqrt(steep[1]) * normal, motion)]
    if steep[0] < 0.0:
        return None
    p, s = (along - math.sqrt(value) * normal for value in steep)
    basis = np.linalg.svd(s[None, :])[2][1:]  # two unit vectors across the path of S
    units = [(p, p * cp), (s, basis[0]), (s, basis[1])]
    ratio = (cp / cs) ** 2 - 2.0
    tractions = [stress_of(slow, v, ratio, 1.0) @ normal for slow, v in units]
    given = stress_of(slowness, motion, ratio, 1.0) @ normal
    gain = np.linalg.solve(np.array(tractions).T, -given)
    return [(p, gain[0] * units[0][1]), (s, gain[1] * basis[0] + gain[2] * basis[1])]


def _trains(model, wave, cp, cs):
    """Return slowness, motion and lag in s of the incident and the reflected waves."""
    slowness = wave.direction / (cp if wave.wave == "P" else cs)
    incident = (slowness, wave.polarisation, 0.0)
    plane = _free_plane(model, wave)
    if plane is None:
        return [incident]
    origin, normal = plane
    if slowness @ normal <= SAME * np.linalg.norm(slowness):
        raise InputError(
            f"plane_wave.inclination: the wave does not run towards {wave.free_surface!r}, got "
            f"{math.degrees(wave.inclination):g} degrees; incline it less, or give free_surface "
            "None"
        )
    back = reflected(slowness, wave.polarisation, cp, cs, normal)
    if back is None:
        angle = math.degrees(math.acos(normal @ wave.direction))
        raise InputError(
            f"plane_wave.inclination: {wave.wave} meets {wave.free_surface!r} at {angle:.3g} "
            f"degrees, beyond its critical angle of {math.degrees(math.asin(cs / cp)):.3g}, where "
            "P is bound to the surface; incline it less"
        )
    return [incident, *((s, v, float((slowness - s) @ origin)) for s, v in back)]


def _faces(model, wave):
    """Return the viscous boundaries that a wave enters through."""
    viscous = [b.surface for b in model.boundaries if isinstance(b, Viscous)]
    for name in wave.surfaces:
        if name not in viscous:
            raise InputError(
                f"plane_wave.surfaces: {name!r} must be viscous, viscous are "
                f"{', '.join(viscous) or 'none'}; add Viscous({name!r})"
            )
    if not viscous:
        raise InputError("plane_wave.surfaces: no surface is viscous, so no wave can enter")
    return wave.surfaces or tuple(viscous)


def _medium(model, surfaces):
    """Return density, cp and cs of the ground behind the boundaries; it must be homogeneous."""
    zones = np.unique(np.concatenate([surface_zones(model.mesh, name) for name in surfaces]))
    if model.sponge is not None:
        raise InputError(
            "plane_wave: a sponge layer would damp the wave along its faces; leave it out"
        )
    media = {b.surface: b.media for b in model.boundaries if isinstance(b, Viscous)}
    for group in {model.mesh.groups[n] for n in model.mesh.zone_group[zones]}:
        for surface in surfaces:
            rock = media[surface].get(group) or model.materials[group]
            law = rock.law
            if not (rock.yields or law.name == "elastic") or law.branches:
                raise InputError(
                    f"plane_wave: needs ground behind {surface!r} that is isotropic and does not "
                    f"attenuate, got the law {type(law).__name__} of '{group}'"
                )
    values = []
    for name, unit in (("density", "kg/m3"), ("cp", "m/s"), ("cs", "m/s")):
        value = model.zone_values(name)[zones]
        if np.ptp(value) > SAME * value.max():
            raise InputError(
                f"plane_wave: needs one medium behind {', '.join(surfaces)}, got {name} from "
                f"{value.min():g} to {value.max():g} {unit}; give waves that run straight up "
                "through layers by StressInput on the bottom and FreeField on the sides"
            )
        values.append(float(value[0]))
    return values


def _free_plane(model, wave):
    """Return a point and the outward normal of the free surface, None if there is none."""
    name, mesh = wave.free_surface, model.mesh
    if name is None:
        return None
    if name not in mesh.surfaces:
        raise InputError(
            f"plane_wave.free_surface: no surface named {name!r}; there are "
            f"{', '.join(mesh.surfaces)}; None where no surface sends waves back"
        )
    conditions = [b for b in model.boundaries if b.surface == name]
    if any(isinstance(b, Viscous) for b in conditions):
        return None
    if conditions:
        raise InputError(
            f"plane_wave.free_surface: {name!r} must be free, it has {type(conditions[0]).__name__}"
        )
    corner, area, normals = surface_areas(mesh, name)
    viscous = [mesh.surfaces[b.surface].ravel() for b in model.boundaries if isinstance(b, Viscous)]
    # Only the edge along the viscous boundaries must be plane; hills inside do not matter.
    edge = np.intersect1d(corner, np.concatenate(viscous))
    places = mesh.points[edge] if _spread(mesh.points[edge]) else mesh.points[np.unique(corner)]
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    if sizes[2] > SAME * sizes[0]:
        raise InputError(
            f"plane_wave.free_surface: {name!r} must be plane where it meets the viscous "
            "surfaces; level it there, or give waves that run straight up by FreeField"
        )
    return middle, axes[2] * np.sign(axes[2] @ (area @ normals))


def _spread(places):
    """Return whether places (n, 3) span a plane."""
    if len(places) < 3:
        return False
    sizes = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
    return bool(sizes[1] > 1e-3 * sizes[0])
