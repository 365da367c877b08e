"""Loads and boundary conditions as arrays: nodal forces, dashpots, prescribed directions."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..mesh.mesh import locate_in_zones, surface_areas, surface_zones
from ..model.anisotropy import impedance, stiffness_of
from ..model.boundary import Fixed, Roller, StressInput, VelocityInput, Viscous
from ..model.model import Model
from ..model.plane_wave import PlaneWave, add_plane_wave
from ..model.source import AirBlast, Column, Hole, MomentTensor, PointForce, Pressure, TimeFunction
from ..signals.seismogram import GEOGRAPHIC
from .moment_density import (
    FEWEST_POINTS,
    POINTS_IN_RADIUS,
    deconvolved,
    moment_forces,
    source_radius,
)

ROUNDED = 1e-12  # part of a moment tensor that is rounding
PRESSURE_CUTS = 3  # subdivisions of each edge of a face for a travelling pressure
# Arrival of a travelling pressure at a node: Gauss-Hermite weights and standard deviations.
PASSING = ((1.0 / 6.0, -np.sqrt(3.0)), (2.0 / 3.0, 0.0), (1.0 / 6.0, np.sqrt(3.0)))


class Loads:
    """Collector of nodal loads and of their histories."""

    def __init__(self) -> None:
        """Start without loads."""
        self.widths = []
        self._nodes, self._vectors, self._numbers, self._histories = [], [], [], []
        self._delays = []

    def add_history(self, function: TimeFunction, offset: float = 0.0, width: float = 0.0) -> int:
        """Add a function of time, at step times plus an offset in s; return its number.

        ``widths`` lists the width R/cp in s of the sphere whose response a moment is divided by.
        """
        self._histories.append((function, offset))
        self.widths.append(width)
        return len(self._histories) - 1

    def add(
        self, nodes: ArrayLike, vectors: ArrayLike, number: int, delays: ArrayLike = 0.0
    ) -> None:
        """Add forces ``vectors`` (n, 3) per unit of a history at ``nodes`` (n,), delays in s."""
        nodes = np.asarray(nodes)
        self._nodes.append(nodes)
        self._vectors.append(np.asarray(vectors, dtype=float))
        self._numbers.append(np.full(len(nodes), number))
        self._delays.append(np.broadcast_to(np.asarray(delays, dtype=float), len(nodes)))

    def arrays(self, times: np.ndarray) -> dict[str, np.ndarray]:
        """Return the kernel arrays, with histories evaluated at ``times`` (n_total,)."""
        none = np.zeros(0)
        amplitude = [function(times + offset) for function, offset in self._histories]
        dt = times[1] - times[0]
        node = np.concatenate([none, *self._nodes]).astype(np.int32)
        by_node = np.argsort(node, kind="stable")
        return {
            "load_node": node[by_node],
            "load_vector": np.concatenate([np.zeros((0, 3)), *self._vectors])[by_node],
            "load_history": np.concatenate([none, *self._numbers]).astype(np.int32)[by_node],
            "load_delay": np.concatenate([none, *self._delays])[by_node] / dt,
            "load_member": np.full(sum(map(len, self._nodes)), -1, dtype=np.int32),
            "history": np.stack(amplitude or [np.zeros(len(times))], axis=1),
        }


def point_loads(node: np.ndarray, history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the load arrays of force histories (n_total, n, 3) in N at nodes (n,)."""
    n_total, n = history.shape[:2]
    return {
        "load_node": np.repeat(node, 3).astype(np.int32),
        "load_vector": np.tile(np.eye(3), (n, 1)),
        "load_history": np.arange(3 * n, dtype=np.int32),
        "load_delay": np.zeros(3 * n),
        "load_member": np.full(3 * n, -1, dtype=np.int32),
        "history": np.ascontiguousarray(history.reshape(n_total, 3 * n)),
    }


def joined_loads(first: dict[str, np.ndarray], second: dict[str, np.ndarray]) -> dict:
    """Return the load arrays of two sets of loads of one run."""
    n = first["history"].shape[1]
    later = {**second, "load_history": (second["load_history"] + n).astype(np.int32)}
    names = (name for name in second if name != "history")
    together = {name: np.concatenate([first[name], later[name]]) for name in names}
    return {**first, **together, "history": np.hstack([first["history"], second["history"]])}


def model_loads(
    model: Model,
    impedance: Callable[[str], dict[int, np.ndarray]],
    injected: tuple[int, ...] = (),
) -> Loads:
    """Collect the loads of stress inputs and sources.

    Parameters
    ----------
    model : Model
    impedance : callable
        Surface name to dict of node to (3, 3) impedance in N s/m.
    injected : tuple of int
        Numbers of sources that enter otherwise.

    Returns
    -------
    Loads
    """
    loads = Loads()
    for boundary in model.boundaries:
        if isinstance(boundary, StressInput):
            matrices = impedance(boundary.surface)
            nodes = np.fromiter(matrices, dtype=int)
            stack = np.stack(list(matrices.values())) * (2.0 if model.doubles(boundary) else 1.0)
            _add_input(loads, boundary, nodes, stack, model.nodes.points[nodes])
    for number, source in enumerate(model.sources):
        if number in injected:
            continue
        if isinstance(source, PlaneWave):
            add_plane_wave(loads, model, source, impedance)
        else:
            ADDERS[type(source)](loads, model, source)
    return loads


def _add_input(loads, boundary, nodes, stack, points):
    """Add the tractions of a stress input, impedances ``stack`` (n, 3, 3) in N s/m at nodes (n,).

    theory.md (4.3), (5.18).
    """
    functions = components(boundary)
    if boundary.fronts is None:
        for axis, function in enumerate(functions):
            loads.add(nodes, stack[:, :, axis], loads.add_history(function))
        return
    amplitude, delay, turn = boundary.fronts.at(points)
    earliest = min(0.0, float(delay.min()))  # delays are not negative
    numbers = [loads.add_history(function, -earliest) for function in functions]
    for size, late, rotation in zip(amplitude, delay - earliest, turn, strict=True):
        vectors = size[:, None, None] * (stack @ rotation)
        for axis, number in enumerate(numbers):
            loads.add(nodes, vectors[:, :, axis], number, late)


def components(boundary: StressInput | VelocityInput) -> list[TimeFunction]:
    """Return the three components of an input's seismogram as functions of time.

    Raises
    ------
    InputError
        If the seismogram is not east, north, vertical or lacks a component.
    """
    record = boundary.seismogram
    where = f"boundaries.{boundary.surface}.seismogram"
    if tuple(record.components) != GEOGRAPHIC:
        raise InputError(
            f"{where}: needs components {', '.join(GEOGRAPHIC)}, got "
            f"{', '.join(record.components)}; rotate it first"
        )
    if not record.present.all():
        missing = record.components[int(record.present.argmin())]
        raise InputError(f"{where}: component {missing} was not recorded; give all three")
    return [TimeFunction(record.velocity[:, k], record.dt, record.start) for k in range(3)]


def add_velocity_input(loads: Loads, boundary: VelocityInput, dt: float) -> list[int]:
    """Add the histories of a prescribed velocity; it is that of the end of each step."""
    return [loads.add_history(function, 0.5 * dt) for function in components(boundary)]


def _add_force(loads, model, source):
    """Add a point force, distributed to the nodes of its zone; theory.md (5.3)."""
    nodes = model.nodes
    zone, weight = locate_in_zones(model.mesh, source.position)
    vectors = nodes.shapes(weight)[0][:, None] * np.asarray(source.direction, dtype=float)
    loads.add(nodes.zone_nodes[zone[0]], vectors, loads.add_history(source.history))


def _add_hole(loads, model, hole):
    """Add a hole as an isotropic moment; theory.md (5.2)."""
    tensor = hole.charge**hole.exponent * np.eye(3)
    _add_moments(loads, model, hole, [hole.position], tensor, hole.spread)


def _add_tensor(loads, model, source):
    """Add a moment tensor; theory.md (5.8)."""
    _add_moments(loads, model, source, [source.position], source.tensor, source.spread)


def _add_column(loads, model, column):
    """Add the points of a column, with detonation delays; theory.md (5.9)."""
    middle, _ = column.points(1)
    zone, _ = locate_in_zones(model.mesh, middle)
    material = model.materials[model.mesh.groups[model.mesh.zone_group[zone[0]]]]
    radius = source_radius(model.nodes, int(zone[0]), middle[0])
    length = np.linalg.norm(np.subtract(column.end, column.primed))
    count = column.sources or max(FEWEST_POINTS, int(np.ceil(POINTS_IN_RADIUS * length / radius)))
    tensor = column.charge**column.exponent / count * column.tensor(material)
    positions, delays = column.points(count)
    _add_moments(loads, model, column, positions, tensor, None, delays)


def _add_moments(loads, model, source, positions, tensor, given, delays=(0.0,)):
    """Add a moment tensor at positions: the isotropic part, and the rest by a flat density."""
    nodes, positions = model.nodes, np.asarray(positions, dtype=float)
    zones, _ = locate_in_zones(nodes.mesh, positions)
    radii = [source_radius(nodes, *each, given) for each in zip(zones, positions, strict=True)]
    # One width for all: the far field sees the mean square of the radii.
    width = np.sqrt(np.mean(np.square(radii))) / model.zone_values("cp")[zones].mean()
    isotropic = np.trace(tensor) / 3.0 * np.eye(3)
    rest = tensor - isotropic
    if np.abs(rest).max() <= ROUNDED * np.abs(tensor).max():
        rest = np.zeros((3, 3))
    moment = source.moment_rate.integral()
    for part, history, own in (
        (isotropic, deconvolved(moment, width), width), (rest, moment, 0.0),
    ):  # fmt: skip
        if not part.any():
            continue
        number = loads.add_history(history, -source.time, own)
        for zone, position, radius, delay in zip(zones, positions, radii, delays, strict=True):
            flat = part is rest
            forces = moment_forces(nodes, zone, position, part, radius, flat)
            loads.add(*forces, number, delay)


def _add_pressure(loads, model, source):
    """Add a travelling pressure on a surface; theory.md (5.10), (5.11), (5.13)."""
    if model.nodes.quadratic:
        nodes, area, normal = model.nodes.surface_areas(source.surface)
        share, delay = source.at(model.nodes.points[nodes])
        force = -(share * area)[:, None] * normal
        loads.add(nodes, force, loads.add_history(source.history), delay)
        return
    mesh, inner = model.mesh, _inner_points(PRESSURE_CUTS)
    triangles = mesh.surfaces[source.surface]
    _, area, normal = surface_areas(mesh, source.surface)
    places = np.einsum("qc,tcx->tqx", inner, mesh.points[triangles])
    share, delay = (a.reshape(places.shape[:2]) for a in source.at(places.reshape(-1, 3)))
    weight = np.einsum("tq,qc->tqc", share, inner) * (3.0 * area[::3, None, None] / len(inner))
    nodes, index = np.unique(triangles.ravel(), return_inverse=True)

    def summed(values):
        return np.bincount(index, values.ravel(), len(nodes))

    size = summed(weight.sum(axis=1))
    mean = summed(np.einsum("tqc,tq->tc", weight, delay)) / size
    square = summed(np.einsum("tqc,tq->tc", weight, delay**2)) / size
    spread = np.sqrt(np.maximum(square - mean**2, 0.0))
    force = weight.sum(axis=1).reshape(-1, 1) * normal
    vectors = -np.stack([summed(force[:, axis]) for axis in range(3)], axis=1)
    number = loads.add_history(source.history)
    for part, beside in PASSING if spread.any() else ((1.0, 0.0),):
        loads.add(nodes, part * vectors, number, np.maximum(mean + beside * spread, 0.0))


def _inner_points(cuts):
    """Return the barycentric centroids (n, 3) of the parts of a subdivided triangle."""
    step = 1.0 / (3 * cuts)
    upright = [(3 * i + 1, 3 * j + 1) for i in range(cuts) for j in range(cuts - i)]
    turned = [(3 * i + 2, 3 * j + 2) for i in range(cuts - 1) for j in range(cuts - 1 - i)]
    first = step * np.array(upright + turned)
    return np.column_stack([first, 1.0 - first.sum(axis=1)])


ADDERS = {
    Hole: _add_hole,
    PointForce: _add_force,
    MomentTensor: _add_tensor,
    Column: _add_column,
    Pressure: _add_pressure,
    AirBlast: _add_pressure,
}


def surface_impedance(model: Model, surface: str) -> dict[int, np.ndarray]:
    """Return the impedance of the nodes of a surface: area (rho cp n n + rho cs (I - n n)).

    Anisotropic ground, or an anisotropic medium behind it, has the impedance of (2.23).

    Returns
    -------
    dict of int to (3, 3) float64, N s/m

    Notes
    -----
    Lysmer & Kuhlemeyer (1969); theory.md (4.1), (2.23).
    """
    nodes, area, normal = model.nodes.surface_areas(surface)
    behind = surface_zones(model.mesh, surface)
    zone = np.repeat(behind, len(nodes) // len(behind))
    density = model.zone_values("density")[zone]
    faster = model.speed_factor_at(model.nodes.points[nodes], zone)
    speeds = (
        np.array([getattr(model.materials[group], speed) for group in model.mesh.groups])
        for speed in ("cp", "cs")
    )
    group = model.mesh.zone_group[zone]
    z_p, z_s = (area * density * faster * speed[group] for speed in speeds)
    outer = normal[:, :, None] * normal[:, None, :]
    each = (z_p - z_s)[:, None, None] * outer + z_s[:, None, None] * np.eye(3)
    media = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Viscous) and boundary.surface == surface:
            media = boundary.media
    for number, name in enumerate(model.mesh.groups):
        medium = media.get(name, model.materials[name])
        if medium.law.name == "anisotropic":
            here = group == number
            factor = area[here] * faster[here]
            wave = impedance(density[here], stiffness_of(medium), normal[here])
            each[here] = factor[:, None, None] * wave
    unique, index = np.unique(nodes, return_inverse=True)
    summed = np.zeros((len(unique), 3, 3))
    np.add.at(summed, index, each)
    return {int(node): matrix for node, matrix in zip(unique, summed, strict=True)}


def dynamic_conditions(
    model: Model, geometry: dict[str, Any], loads: Loads
) -> dict[str, np.ndarray]:
    """Return dashpots and prescribed motion of the dynamic stage as kernel arrays."""
    fixed = {}
    for boundary in model.boundaries:
        if isinstance(boundary, VelocityInput):
            _move_all(model, boundary, fixed, add_velocity_input(loads, boundary, geometry["dt"]))
    for boundary in model.boundaries:
        if isinstance(boundary, Fixed):
            _fix_axes(model, boundary, fixed)
        elif isinstance(boundary, Roller) and boundary.dynamic:
            _fix_normal(model, boundary, fixed)
    viscous = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Viscous):
            for node, matrix in surface_impedance(model, boundary.surface).items():
                viscous[node] = viscous.get(node, 0.0) + matrix
    return {**_dashpot_arrays(viscous, fixed, geometry), **_fixed_arrays(fixed)}


def no_conditions() -> dict[str, np.ndarray]:
    """Return the arrays of a model without dashpots and prescribed motion."""
    none = {"dt": 0.0, "node_mass": np.ones(1), "node_alpha": np.zeros(1)}
    return {**_dashpot_arrays({}, {}, none), **_fixed_arrays({})}


def static_conditions(model: Model, geometry: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the supports of the static stage; viscous surfaces are on rollers."""
    fixed = {}
    for boundary in model.boundaries:
        if isinstance(boundary, Fixed):
            _fix_axes(model, boundary, fixed)
        elif isinstance(boundary, (Roller, Viscous)):
            _fix_normal(model, boundary, fixed)
    return {**_dashpot_arrays({}, fixed, geometry), **_fixed_arrays(fixed)}


def _move_all(model, boundary, fixed, histories):
    """Prescribe all three components at the nodes of a surface."""
    for node in np.unique(model.nodes.surfaces[boundary.surface]):
        if int(node) not in fixed:
            fixed[int(node)] = list(zip(np.eye(3), histories, strict=True))


def _fix_axes(model, boundary, fixed):
    """Fix components at the nodes of a surface."""
    axes = [np.eye(3)[GEOGRAPHIC.index(name)] for name in boundary.components]
    for node in np.unique(model.nodes.surfaces[boundary.surface]):
        for axis in axes:
            _hold(fixed, int(node), axis)


def _fix_normal(model, boundary, fixed):
    """Fix the normal component at the nodes of a surface."""
    nodes, area, normal = model.nodes.surface_areas(boundary.surface)
    unique, index = np.unique(nodes, return_inverse=True)
    mean = np.zeros((len(unique), 3))
    np.add.at(mean, index, area[:, None] * normal)
    for node, direction in zip(unique, mean / np.linalg.norm(mean, axis=1)[:, None], strict=True):
        _hold(fixed, int(node), direction)


def _hold(fixed, node, direction):
    """Fix a node along a direction, made orthogonal to its prescribed directions."""
    known = fixed.setdefault(node, [])
    for other, _ in known:
        direction = direction - (direction @ other) * other
    if np.linalg.norm(direction) > 1e-6:
        known.append((direction / np.linalg.norm(direction), -1))


def _dashpot_arrays(viscous, fixed, geometry):
    """Return the arrays of dashpots, which act along free directions only."""
    nodes = np.array(sorted(viscous), dtype=np.int32)
    stack = np.zeros((len(nodes), 3, 3))
    for row, node in enumerate(nodes):
        free = np.eye(3)
        for direction, _ in fixed.get(int(node), ()):
            free = free - np.outer(direction, direction)
        stack[row] = free @ viscous[int(node)] @ free
    half = 0.5 * geometry["dt"]
    inertia = geometry["node_mass"][nodes] * (1.0 + half * geometry["node_alpha"][nodes])
    return {
        "dashpot_node": nodes,
        "dashpot_impedance": stack,
        "dashpot_inverse": np.linalg.inv(inertia[:, None, None] * np.eye(3) + half * stack),
    }


def _fixed_arrays(fixed):
    """Return the prescribed directions of all nodes; one of zero length if there is none."""
    rows = [(n, d, h) for n in sorted(fixed) for d, h in fixed[n]] or [(0, np.zeros(3), -1)]
    return {
        "fixed_node": np.array([n for n, _, _ in rows], dtype=np.int32),
        "fixed_direction": np.array([d for _, d, _ in rows]).reshape(-1, 3),
        "fixed_history": np.array([h for _, _, h in rows], dtype=np.int32),
    }
