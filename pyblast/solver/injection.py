"""Injection: the scattered field in the elements around a source, the field of the source apart.

Elements around the sources hold what is left of the motion without the field of these sources in a
half-space, all others hold the whole motion: the domain reduction method (Bielak et al. 2003) with
inside and outside exchanged. So elements need not carry the near field.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from ..mesh import hexahedra
from ..mesh.faces import zone_of_face
from ..mesh.mesh import locate_in_zones, zone_edge_lengths
from ..mesh.quality import explicit_work
from ..model.full_space import force_motion, moment_motion
from ..model.half_space import EXPLOSION, direct_wave, radiations, reflected_waves
from ..model.material import Material
from ..model.model import Model
from ..model.source import Column, Hole, MomentTensor, PointForce, TimeFunction, isotropic_moment
from .loads import FEWEST_POINTS, point_loads
from .moment_density import NearReceiver, beside_sources, near_sources

LOWEST_ORDER = 4  # order 3 spoils the motion by up to 15 %, order 2 by more than itself
BESIDE = 0.15  # of an edge: zones nearer to a source count as its own
FLAT = 1e-6  # of an edge: heights that count as equal
UNIFORM = 1e-6  # relative difference of moduli that count as equal
LOST = 0.02  # largest part of the motion that attenuation may take over one element
MOST_BYTES = 3e9  # of the motion around sources
MOST_LEVELS = 100  # depths of nodes around a source
PASSED, STOPPED = 1.25, 2.5  # of the carried frequency: from and to which sources are tapered off
OF_WAVE, OF_PATH = 4.0, 3.0  # spacings of the table in the shortest wave, in the shortest path
DEGREE = 5  # of the spline over the table
SLOWEST = 0.8  # of the S speed, of the last waves
NEAREST = 0.02  # of an edge: points nearer to a source have the motion there
OF_COLUMN = 0.008  # of an edge: distance of the points of a column
COLUMN_PLACES = 9  # on a column, of which the zones are its own
MARGIN = 4  # time steps around a table
STEP = 0.4  # time step over the travel time of P waves between the nearest nodes
BYTES_PER_NUMBER = 30.0  # of the motion of nodes, at the peak


@dataclass(frozen=True, eq=False)
class Patch:
    """Zones around sources that hold the motion without the field of these sources.

    Parameters
    ----------
    sources : tuple of int
        Numbers of the sources in the model.
    zones : (n,) int64
    boundary : (m,) int64
        Those at the boundary of the patch, where the fields are exchanged.
    whole : (n_nodes,) bool
        Nodes of the patch that hold the whole motion: those of its boundary.
    top : float or None, m
        Height of the free surface above, None where the patch does not reach it.
    rock : Material
    """

    sources: tuple[int, ...]
    zones: np.ndarray
    boundary: np.ndarray
    whole: np.ndarray
    top: float | None
    rock: Material


@dataclass(frozen=True, eq=False)
class Injection:
    """Loads by which sources are injected, and their own field inside of the patch.

    Parameters
    ----------
    loads : dict
        Arrays of `point_loads`.
    motion : (n_steps, n_receivers, 3) float64, m/s
        To be added to the motion of the receivers.
    nodes : (n,) int64
        Nodes inside of the patch.
    velocity : (n_steps, n, 3) float32, m/s
        To be added to theirs.
    """

    loads: dict
    motion: np.ndarray
    nodes: np.ndarray
    velocity: np.ndarray


def patch_of(model: Model) -> Patch | str:
    """Return the patch around the point sources of a model, or why there is none.

    It holds the zones of the sources and those that share a node with them. None of the former may
    lie at its boundary: outer faces but a flat free surface, joints, zones beyond. Below a free
    surface no source on it and no column that leans is injected; theory.md (5.25), (5.26).
    """
    if not model.mesh.hexahedral:
        return "the elements are tetrahedra"
    if model.mesh.order < LOWEST_ORDER:
        return f"elements of order {model.mesh.order} carry the field of a source too coarsely"
    sources = _point_sources(model)
    if not sources:
        return "no source is at a point or along a column, without a given radius"
    patch = _patch_around(model, sources)
    top = None if isinstance(patch, str) else patch.top
    if top is not None:
        edge = float(zone_edge_lengths(model.mesh)[patch.zones].min())
        below = {k: each for k, each in sources.items() if _is_below(each, top, NEAREST * edge)}
        if not below:
            return "sources on a free surface and columns that lean under one are not injected"
        if len(below) < len(sources):
            return _patch_around(model, below)
    return patch


def _is_below(source, top, least):
    """Return whether a source is an explosion, or its points lie above one another below a top."""
    points = _points_of(source)
    upright = np.ptp(points[:, :2], axis=0).max() < least
    return _isotropic(source) or bool(upright and (points[:, 2] < top - least).all())


def _patch_around(model, injected):
    """Return the patch around sources by their numbers, or why there is none."""
    mesh, zone_nodes = model.mesh, model.nodes.zone_nodes
    own = np.zeros(len(mesh.zones), dtype=bool)
    low, high = mesh.zone_limits
    reach = BESIDE * (high - low)
    for at in np.concatenate([_points_of(source) for source in injected.values()]):
        near = np.flatnonzero(((at >= low - reach) & (at <= high + reach)).all(axis=1))
        points = np.broadcast_to(at, (len(near), 3))  # leaning zones are less than their limits
        beyond = hexahedra.reference_coordinates(mesh.node_places[near], mesh.order, points)[1]
        own[near[beyond <= 2.0 * BESIDE]] = True
    touched = np.zeros(len(model.nodes.points), dtype=bool)
    touched[zone_nodes[own]] = True
    inside = touched[zone_nodes].any(axis=1)
    zones = np.flatnonzero(inside)
    rock = _rock(model, zones)
    if isinstance(rock, str):
        return rock
    whole, top = _boundary_nodes(model, inside)
    boundary = zones[whole[zone_nodes[zones]].any(axis=1)]
    if own[boundary].any():
        return "a side, a joint or ground that is not flat lies less than an element from a source"
    depths = np.unique(np.round(model.nodes.points[zone_nodes[zones], 2], 6))
    if top is not None and len(depths) > MOST_LEVELS:
        return "the elements around the sources stand at too many depths"
    return Patch(tuple(injected), zones, boundary, whole, top, rock)


def _point_sources(model):
    """Return the sources at points and along columns by their numbers; none of a given radius."""
    return {
        number: source for number, source in enumerate(model.sources)
        if isinstance(source, Column)
        or (isinstance(source, PointForce) and not source.history.held)
        or (isinstance(source, (Hole, MomentTensor)) and source.spread is None)
    }  # fmt: skip


def _isotropic(source):
    """Return whether a source is an explosion."""
    return isinstance(source, (Hole, MomentTensor)) and bool(isotropic_moment(source))


def _points_of(source):
    """Return the ends of a column and its middle, or the place of another source, (n, 3) in m."""
    if isinstance(source, Column):
        return np.linspace(source.primed, source.end, COLUMN_PLACES)
    return np.asarray(source.position, dtype=float)[None]


def injection_bytes(model: Model, patch: Patch, n_steps: int) -> float:
    """Return the memory in bytes that the injection into a patch needs at most."""
    nodes = patch.zones.size * model.nodes.zone_nodes.shape[1]  # shared ones twice and more
    return BYTES_PER_NUMBER * 3.0 * nodes * n_steps


def injected_sources(model: Model) -> tuple[int, ...]:
    """Return the numbers of the sources that a model injects."""
    patch = patch_of(model) if model.injected else ""
    return () if isinstance(patch, str) else patch.sources


def near_receivers(model: Model) -> tuple[NearReceiver, ...]:
    """Return the receivers near sources that are not injected; see `near_sources`."""
    return near_sources(model, injected_sources(model))


def receivers_beside(model: Model) -> tuple[NearReceiver, ...]:
    """Return all receivers beside sources that are not injected; see `beside_sources`."""
    return beside_sources(model, injected_sources(model))


def with_injection(model: Model, duration: float) -> Model:
    """Return a model whose sources are injected, if a receiver is near and the ground allows it.

    The loads of a run of some duration in s have to fit into the memory.
    """
    if not near_sources(model) or refusal(model, duration):
        return model
    return replace(model, injected=True)


def refusal(model: Model, duration: float) -> str:
    """Return why the sources of a model can't be injected; empty where they can."""
    patch = patch_of(model)
    if isinstance(patch, str):
        return patch
    shortest = len(model.nodes.points) / explicit_work(model.mesh)
    fastest = max(float(rock.cp) for rock in model.materials.values())
    n_steps = int(duration * fastest / (STEP * shortest))
    if injection_bytes(model, patch, n_steps) > MOST_BYTES:
        return f"their motion over {duration:.3g} s does not fit into memory"
    return ""


def _rock(model, zones):
    """Return the one material of zones (n,), or what stands against one."""
    mesh = model.mesh
    if mesh.layer is not None:
        centres = mesh.points[mesh.zones[zones]].mean(axis=1)
        if mesh.layer.depths(centres).any():
            return "the absorbing layer lies less than an element from a source"
    groups = np.unique(mesh.zone_group[zones])
    if len(groups) > 1:
        return "other ground lies less than an element from a source"
    name = mesh.groups[groups[0]]
    rock = model.materials[name]
    places = mesh.node_places[zones].reshape(-1, 3)
    factor = model.speed_factor_at(places, np.repeat(zones, mesh.node_places.shape[1]))
    if np.ptp(factor) > UNIFORM:
        return "the speeds vary within an element of a source"
    edge = float(zone_edge_lengths(mesh)[zones].max())
    omega = np.pi * rock.cs / (model.edges_per_wavelength * edge)  # half of what is carried
    loss = model.group_damping("alpha")[groups[0]] / omega
    loss += model.group_damping("beta")[groups[0]] * omega
    for branch in model.branches(name):
        loss += branch.shear * omega * branch.rate / (omega**2 + branch.rate**2)
    if 0.5 * loss * omega * edge / rock.cs > LOST:
        return f"{name!r} takes more than {100 * LOST:g} % of the motion over an element"
    speeds = (float(factor.flat[0]) * speed for speed in (rock.cp, rock.cs))
    return Material.from_speeds(rock.density, *speeds)


def _boundary_nodes(model, inside):
    """Return which nodes (n_nodes,) of a patch are of its boundary, and the height of its top."""
    mesh, nodes = model.mesh, model.nodes
    beyond = np.zeros(len(nodes.points), dtype=bool)
    beyond[nodes.zone_nodes[~inside]] = True
    held = [model.nodes.surfaces[each.surface].ravel() for each in model.boundaries]
    if nodes.contacts is not None:
        held += [nodes.contacts.minus, nodes.contacts.plus]
    bound = np.zeros(len(nodes.points), dtype=bool)
    bound[np.concatenate([np.zeros(0, dtype=int), *held])] = True
    faces = mesh.paired_faces[2]
    zone, local = zone_of_face(mesh.zones, faces)
    zone, local = zone[inside[zone]], local[inside[zone]]
    table = hexahedra.face_nodes(mesh.order).reshape(hexahedra.N_FACES, -1)
    ends = nodes.zone_nodes[zone[:, None], table[local]]
    heights = nodes.points[ends, 2]
    highest = nodes.points[nodes.zone_nodes[inside], 2].max()
    edge = float(zone_edge_lengths(mesh)[inside].min())
    free = (np.abs(heights - highest) <= FLAT * edge).all(axis=1) & ~bound[ends].any(axis=1)
    whole = np.zeros(len(nodes.points), dtype=bool)
    whole[nodes.zone_nodes[inside]] = True
    beyond[ends[~free]] = True
    return whole & (beyond | bound), float(highest) if free.any() else None


def carried(model: Model, patch: Patch) -> float:
    """Return the frequency in Hz that the zones of a patch carry."""
    edge = float(zone_edge_lengths(model.mesh)[patch.zones].max())
    return patch.rock.cs / (model.edges_per_wavelength * edge)


def tapered(rate: TimeFunction, highest: float) -> TimeFunction:
    """Return a moment rate tapered off between 1.25 and 2.5 times a frequency in Hz."""
    quiet = int(np.ceil(2.0 / (highest * rate.dt)))
    values = np.pad(rate.values, quiet)
    frequency = np.fft.rfftfreq(2 * len(values), rate.dt) / highest
    share = np.clip((frequency - PASSED) / (STOPPED - PASSED), 0.0, 1.0)
    spectrum = np.fft.rfft(values, 2 * len(values)) * (0.5 + 0.5 * np.cos(np.pi * share))
    smooth = np.fft.irfft(spectrum, 2 * len(values))[: len(values)]
    return TimeFunction(smooth, rate.dt, rate.start - quiet * rate.dt)


def inject(model: Model, patch: Patch, dt: float, n_steps: int) -> Injection:
    """Return the loads at the boundary of a patch, and the field to be added inside of it.

    ``f_T = -K_TS u0_S`` and ``f_S = K_ST u0_T``: S are the nodes inside of the patch, T those of
    its boundary, K the stiffness of its zones there; theory.md (5.25). The mass is lumped and adds
    nothing.
    """
    field = _Field(model, patch, dt, n_steps)
    nodes = np.unique(model.nodes.zone_nodes[patch.zones])
    velocity = field.at(model.nodes.points[nodes])
    number = np.full(len(model.nodes.points), -1)
    number[nodes] = np.arange(len(nodes))
    moved = np.zeros_like(velocity)  # at the steps, velocities lie between
    np.cumsum(dt * velocity[:, :-1], axis=1, out=moved[:, 1:])
    force = np.zeros_like(velocity)
    for zone in patch.boundary:
        at = model.nodes.zone_nodes[zone]
        outer, inner = np.flatnonzero(patch.whole[at]), np.flatnonzero(~patch.whole[at])
        stiffness = _stiffness(model, patch.rock, zone, outer, inner)
        outer, inner = number[at[outer]], number[at[inner]]
        force[outer] -= _product(stiffness, moved[inner])
        force[inner] += _product(stiffness.T, moved[outer])
    loaded = np.flatnonzero(force.any(axis=(1, 2)))
    loads = point_loads(nodes[loaded], np.ascontiguousarray(force[loaded].swapaxes(0, 1)))
    inner = ~patch.whole[nodes]
    shown = velocity[inner].swapaxes(0, 1).astype(np.float32)
    motion = _of_receivers(model, patch, field, velocity, number)
    return Injection(loads, motion, nodes[inner], shown)


def _product(matrix, motion):
    """Return a matrix (3 m, 3 n) times motion (n, n_steps, 3), as (m, n_steps, 3)."""
    n_steps = motion.shape[1]
    flat = np.ascontiguousarray(motion.swapaxes(1, 2)).reshape(-1, n_steps)
    return (matrix @ flat).reshape(-1, 3, n_steps).swapaxes(1, 2)


def _stiffness(model, rock, zone, rows, columns):
    """Return the stiffness (3 n_rows, 3 n_columns) in N/m of a zone between its nodes."""
    order, nodes = model.mesh.order, model.nodes
    slopes = hexahedra.shape_slopes(order, hexahedra.reference_nodes(order))
    slopes = slopes @ np.linalg.inv(nodes.jacobian[zone])
    weight, parts = nodes.volumes[zone], [slopes[:, part] for part in (rows, columns)]
    first, second = (part.reshape(len(weight), -1) for part in parts)
    product = (weight[:, None] * first).T @ second
    product = product.reshape(len(rows), 3, len(columns), 3)
    shear = rock.density * rock.cs**2
    lame = rock.density * rock.cp**2 - 2.0 * shear
    whole = lame * product + shear * product.swapaxes(1, 3)
    trace = shear * np.einsum("akbk->ab", product)
    for axis in range(3):
        whole[:, axis, :, axis] += trace
    return whole.reshape(3 * len(rows), 3 * len(columns))


def _of_receivers(model, patch, field, velocity, number):
    """Return the motion (n_steps, n_receivers, 3) in m/s to be added at the receivers."""
    motion = np.zeros((velocity.shape[1], len(model.receivers), 3))
    if not model.receivers:
        return motion
    places = np.array([receiver.position for receiver in model.receivers], dtype=float)
    zone, local = locate_in_zones(model.mesh, places)
    near = np.flatnonzero(np.isin(zone, patch.zones))
    if not len(near):
        return motion
    motion[:, near] = field.at(places[near]).swapaxes(0, 1)
    for receiver, shares in zip(near, model.nodes.shapes(local[near]), strict=True):
        at = model.nodes.zone_nodes[zone[receiver]]
        whole = patch.whole[at]
        motion[:, receiver] -= np.einsum("a,atx->tx", shares[whole], velocity[number[at[whole]]])
    return motion


class _Field:
    """Velocity of the injected sources in their half-space, or in unbounded rock."""

    def __init__(self, model, patch, dt, n_steps):
        """Group the explosions by moment rate, and what a free surface reflects by its tables."""
        self.patch, self.dt, self.n_steps = patch, dt, n_steps
        self.edge = float(zone_edge_lengths(model.mesh)[patch.zones].min())
        self.highest = carried(model, patch)
        self.rates, self.explosions, self.others, self.reflected = {}, [], [], {}
        for source in (model.sources[number] for number in patch.sources):
            (self.explosions if _isotropic(source) else self.others).append(source)
            if patch.top is not None:
                self._enter(source)

    def _rate(self, source):
        """Return the tapered moment rate or force of a source, and its key."""
        function = source.history if isinstance(source, PointForce) else source.moment_rate
        if id(function) not in self.rates:
            self.rates[id(function)] = tapered(function, self.highest)
        return self.rates[id(function)], id(function)

    def _enter(self, source):
        """Enter what the surface reflects of a source: table, place, firing time, amplitudes."""
        rate, key = self._rate(source)
        time = 0.0 if isinstance(source, PointForce) else source.time
        points, delays = _points_of(source)[:1], (0.0,)
        if _isotropic(source):
            parts = [(EXPLOSION, isotropic_moment(source), 0.0)]
        elif isinstance(source, PointForce):
            rate = TimeFunction(np.gradient(rate.values, rate.dt), rate.dt, rate.start)
            parts = radiations(force=source.direction)
        elif isinstance(source, Column):
            places, times, tensors = zip(*self._along(source), strict=True)
            points, delays = np.array(places), tuple(np.subtract(times, time).tolist())
            parts = radiations(np.sum(tensors, axis=0))
        else:
            parts = radiations(source.tensor)
        depths = tuple(np.round(self.patch.top - points[:, 2], 3).tolist())
        for radiation, *amplitudes in parts:
            table = self.reflected.setdefault((key, depths, delays, radiation), (rate, []))
            table[1].append((points[0, :2], time, amplitudes))

    def at(self, points):
        """Return the velocity (n, n_steps, 3) in m/s between the steps at points (n, 3)."""
        total = np.zeros((len(points), self.n_steps, 3))
        for source in self.others:
            self._add_unbounded(total, source, points)
        for source in self.explosions:
            distance, ray = _horizontal(points, source.position)
            first, motion = self._direct(self._rate(source)[0], source, distance, points[:, 2])
            _add(total, first, isotropic_moment(source) * motion, ray)
        for (_, depths, delays, radiation), (rate, members) in self.reflected.items():
            plans = [plan for plan, _, _ in members]
            table = self._table(rate, depths, delays, radiation, plans, points)
            for plan, time, amplitudes in members:
                distance, ray = _horizontal(points, plan)
                first, motion = self._reflected(table, time, distance)
                _add_by_azimuth(total, first, motion, ray, radiation.order, *amplitudes)
        return total

    def _add_unbounded(self, total, source, points):
        """Add the motion of a force, a tensor or the points of a column in unbounded rock."""
        rock = self.patch.rock
        if isinstance(source, PointForce):
            parts, motion_of = [(source.position, 0.0, source.direction)], force_motion
        else:
            motion_of = moment_motion
            parts = [(source.position, source.time, source.tensor)] if not isinstance(
                source, Column
            ) else self._along(source)  # fmt: skip
        rate, _ = self._rate(source)
        for position, time, strength in parts:
            away = points - np.asarray(position, dtype=float)
            path = np.linalg.norm(away, axis=1)
            away[path < NEAREST * self.edge] = NEAREST * self.edge, 0.0, 0.0
            first, last = self._steps(rate, time, float(path.max()) / rock.cs)
            times = self.dt * (np.arange(first, last) + 0.5) - time
            total[:, first:last] += motion_of(rate, strength, away, times, rock)

    def _along(self, column):
        """Return position, firing time and tensor of each point of a column."""
        length = float(np.linalg.norm(np.subtract(column.end, column.primed)))
        needed = int(np.ceil(length / (OF_COLUMN * self.edge)))
        count = column.sources or max(FEWEST_POINTS, needed)
        tensor = column.charge**column.exponent / count * column.tensor(self.patch.rock)
        places, delays = column.points(count)
        return [(at, column.time + late, tensor) for at, late in zip(places, delays, strict=True)]

    def _steps(self, rate, time, late):
        """Return the first step of a motion, and the one after its last."""
        end = time + rate.start + rate.dt * len(rate.values) + late
        first = min(max(0, int((time + rate.start) / self.dt) - 1), self.n_steps)
        return first, min(self.n_steps, max(first, int(end / self.dt) + 2))

    def _direct(self, rate, source, distance, heights):
        """Return the first step and the direct waves (n, n_own, 2) of a source."""
        below = float(source.position[2]) - heights
        path = np.hypot(distance, below)
        distance = np.where(path < NEAREST * self.edge, NEAREST * self.edge, distance)
        first, last = self._steps(rate, source.time, float(path.max()) / self.patch.rock.cp)
        times = self.dt * (np.arange(first, last) + 0.5) - source.time
        return first, direct_wave(rate, distance, below, times, self.patch.rock)

    def _table(self, rate, depths, delays, radiation, plans, points):
        """Return the start, coefficients and design of a table of reflected waves."""
        rock = self.patch.rock
        levels, level = np.unique(np.round(self.patch.top - points[:, 2], 6), return_inverse=True)
        distances = np.linalg.norm(points[None, :, :2] - np.array(plans)[:, None], axis=2)
        low, high = float(distances.min()), float(distances.max())
        shortest = np.hypot(low, min(depths) + levels[0])
        spacing = min(rock.cs / (STOPPED * self.highest) / OF_WAVE, shortest / OF_PATH)
        count = max(DEGREE + 3, int(np.ceil((high - low) / spacing)) + 1)
        grid = np.linspace(max(0.0, low - spacing), high + spacing, count)
        end = rate.start + rate.dt * len(rate.values) + max(delays)
        end += np.hypot(high, max(depths) + levels[-1]) / (SLOWEST * rock.cs)
        start = rate.start - MARGIN * self.dt
        times = start + self.dt * np.arange(int((end - start) / self.dt) + MARGIN)
        motion = reflected_waves(rate, depths, grid, levels, times, rock, radiation, delays)
        spline = make_interp_spline(grid, motion, k=DEGREE)
        return start, spline.t, spline.c, level.ravel()

    def _reflected(self, table, time, distance):
        """Return the first step and the reflected waves (n, n_own, 2 or 3) of a source."""
        start, knots, coefficients, level = table
        design = BSpline.design_matrix(distance, knots, DEGREE)
        n_times = coefficients.shape[2]
        motion = np.empty((len(distance), *coefficients.shape[2:]))
        for number in range(coefficients.shape[1]):
            here = np.flatnonzero(level == number)
            flat = np.ascontiguousarray(coefficients[:, number]).reshape(len(coefficients), -1)
            motion[here] = (design[here] @ flat).reshape(len(here), *coefficients.shape[2:])
        # Step k lies at place k + shift of the table: cubic interpolation with equal weights.
        shift = 0.5 - (time + start) / self.dt
        behind = int(np.floor(shift))
        x = shift - behind
        weights = (-x * (x - 1.0) * (x - 2.0) / 6.0, (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
                   -(x + 1.0) * x * (x - 2.0) / 2.0, (x + 1.0) * x * (x - 1.0) / 6.0)  # fmt: skip
        first = max(0, 1 - behind)
        last = max(first, min(self.n_steps, n_times - 2 - behind))
        low = first + behind - 1
        size = last - first
        moved = sum(w * motion[:, low + k : low + k + size] for k, w in enumerate(weights))
        return first, moved


def _add(total, first, motion, ray):
    """Add motion (n, n_own, 2) away from a source along rays (n, 2), and up, from a step on."""
    part = total[:, first : first + motion.shape[1]]
    part[..., :2] += motion[..., :1] * ray[:, None]
    part[..., 2] += motion[..., 1]


def _horizontal(points, origin):
    """Return the distances (n,) of points from an origin in plan, and the rays (n, 2) to them."""
    away = points[:, :2] - np.asarray(origin, dtype=float)[:2]
    distance = np.hypot(*away.T)
    return distance, away / np.maximum(distance, 1e-9)[:, None]


def _add_by_azimuth(total, first, motion, ray, order, cosine, sine):
    """Add motion away, up and across that varies with azimuth by an order, from a step on."""
    turn = order * np.arctan2(ray[:, 1], ray[:, 0])
    share = (cosine * np.cos(turn) + sine * np.sin(turn))[:, None, None]
    _add(total, first, share * motion[..., :2], ray)
    if order:
        across = (sine * np.cos(turn) - cosine * np.sin(turn))[:, None] * motion[..., 2]
        turned = np.stack([-ray[:, 1], ray[:, 0]], axis=-1)
        total[:, first : first + motion.shape[1], :2] += across[..., None] * turned[:, None]
