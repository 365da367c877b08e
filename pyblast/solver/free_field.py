"""Free-field boundaries: viscous sides coupled to columns of the ground beside the model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..mesh.grid import Layer, structured_box
from ..mesh.mesh import surface_areas, surface_zones
from ..model.boundary import Boundary, Fixed, FreeField, StressInput, VelocityInput, Viscous
from ..model.material import Damping, relative_modulus
from ..model.model import Model, Receiver
from ..model.source import TimeFunction
from ..signals.seismogram import Seismogram
from .assembly import geometry_arrays
from .loads import surface_impedance

FIXED = (
    ("north", "vertical"),
    ("east", "vertical"),
    ("east", "north"),
)  # fixed components while one axis moves
SPARE_STEPS = 4  # beyond the end of the run


@dataclass(frozen=True)
class GroundColumn:
    """Ground column beside the model.

    Parameters
    ----------
    levels : tuple of float, m
        Heights of its nodes, ascending.
    cells : tuple of (str, float)
        Group of each cell between them, and the factor on its wave speeds.
    """

    levels: tuple[float, ...]
    cells: tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False)
class Shaking:
    """Motion of a column, by axis (0 east, 1 north, 2 vertical) that moves.

    Parameters
    ----------
    velocity : dict of int to list of TimeFunction, m/s
        At each level.
    stress : dict of int to list of TimeFunction, Pa
        In each cell, on a vertical side: shear stress for axes 0 and 1, normal stress for axis 2.
    """

    velocity: dict[int, list[TimeFunction]]
    stress: dict[int, list[TimeFunction]]


def shake(
    model: Model,
    column: GroundColumn,
    inputs: Sequence[StressInput | VelocityInput],
    dt: float,
    duration: float,
    run: Callable,
) -> Shaking:
    """Run a column under the input of a model, once for each axis that moves.

    Parameters
    ----------
    model : Model
        The model beside the column.
    column : GroundColumn
    inputs : sequence of StressInput or VelocityInput
        Through the level base of the model.
    dt : float, s
        Time step of the model, used by the column if stable.
    duration : float, s
    run : callable
        Model and duration to motion (n_steps, n_receivers, 3) and the kernel's constants.

    Returns
    -------
    Shaking
    """
    alone = _column_model(model, column, inputs)
    own = geometry_arrays(alone)[0]["dt"]
    alone = replace(alone, step_factor=alone.step_factor * min(1.0, dt / own))
    velocity, stress = {}, {}
    for axis, held in enumerate(FIXED):
        if not any(np.abs(side.seismogram.velocity[:, axis]).max() > 0.0 for side in inputs):
            continue
        sides = [Fixed(side, held) for side in ("west", "east", "south", "north")]
        moved = [_one_axis(b, axis) for b in alone.boundaries]
        motion, constants = run(
            replace(alone, boundaries=[*sides, *moved]), duration + SPARE_STEPS * dt
        )
        velocity[axis], stress[axis] = _histories(motion[:, :, axis], alone.mesh.points, constants)
    if 2 in stress:
        stress[2] = [
            _across(model, group, history)
            for (group, _), history in zip(column.cells, stress[2], strict=True)
        ]
    return Shaking(velocity, stress)


def _column_model(model, column, inputs):
    """Return the model of a column without side constraints; every cell is a group."""
    names = [str(number) for number in range(len(column.cells))]
    levels = np.array(column.levels)
    thickness = np.diff(levels)[::-1]
    layers = [Layer(n, t) for n, t in zip(names[::-1], thickness[:-1], strict=False)]
    layers.append(Layer(names[0]))
    across = np.array([0.0, thickness.min()])
    materials, damping, media = {}, {}, {}
    base = [b for b in model.boundaries if b.surface == inputs[0].surface]
    known = next((b.media for b in base if isinstance(b, Viscous)), {})
    for name, (group, factor) in zip(names, column.cells, strict=True):
        rock = model.materials[group]
        materials[name] = replace(rock, bulk=rock.bulk * factor**2, shear=rock.shear * factor**2)
        by_group = isinstance(model.damping, dict)
        damping[name] = model.damping[group] if by_group else model.damping or Damping(0.0, 1.0)
        if group in known:
            media[name] = known[group]
    ends: list[Boundary] = []
    for boundary in inputs:
        end = replace(boundary, surface="bottom")
        if isinstance(end, StressInput) and isinstance(boundary, StressInput):
            end = replace(end, doubled=model.doubles(boundary))
        ends.append(end)
    if any(isinstance(b, Viscous) for b in base):
        ends.append(Viscous("bottom", media))
    mesh = structured_box(across, across, levels, layers=layers)
    alone = Model(mesh, materials, boundaries=tuple(ends), damping=damping)
    places = [Receiver(str(n), tuple(p)) for n, p in enumerate(alone.mesh.points)]
    return replace(alone, receivers=places)


def _one_axis(boundary, axis):
    """Return a boundary with the input of one axis only."""
    if not isinstance(boundary, (StressInput, VelocityInput)):
        return boundary
    given = boundary.seismogram
    velocity = np.zeros_like(given.velocity)
    velocity[:, axis] = given.velocity[:, axis]
    return replace(boundary, seismogram=Seismogram(velocity, given.dt, given.start))


def _histories(motion, points, constants):
    """Return velocities and stresses at full steps from velocities (n_steps, n_nodes).

    The stress in a cell balances the inertia above it, for any law: theory.md (4.12).
    """
    dt, area = constants["dt"], np.ptp(points[:, 0]) * np.ptp(points[:, 1])
    level = np.unique(points[:, 2], return_inverse=True)[1]
    share = (level[:, None] == np.arange(level.max() + 1)) * constants["node_mass"][:, None]
    mass, drag = share.sum(axis=0), constants["node_alpha"] @ share
    velocity = motion @ (share / mass)
    before = np.vstack([np.zeros_like(velocity[:1]), velocity[:-1]])
    mean = 0.5 * (before + velocity)
    force = mass * (velocity - before) / dt + drag * mean
    above = np.cumsum(force[:, ::-1], axis=1)[:, ::-1]
    stress = -above[:, 1:] / area
    return [TimeFunction(v, dt) for v in mean.T], [TimeFunction(s, dt) for s in stress.T]


def _across(model, group, history):
    """Return the lateral normal stress of a laterally confined column from its axial stress.

    In attenuating ground the ratio depends on frequency: theory.md (4.13).
    """
    branches = model.branches(group)
    lame, shear = model.law(group).moduli(model.materials[group])
    if not branches:
        return replace(history, values=lame / (lame + 2.0 * shear) * history.values)
    n_padded = 2 * len(history.values)
    frequency = np.fft.rfftfreq(n_padded, history.dt)
    along = (lame + 2.0 * shear) * relative_modulus(branches, frequency, "compression")
    ratio = 1.0 - 2.0 * shear * relative_modulus(branches, frequency) / along
    spectrum = np.fft.rfft(history.values, n_padded) * ratio.conj()
    return replace(history, values=np.fft.irfft(spectrum, n_padded)[: len(history.values)])


LEVEL = 1e-6  # geometric tolerance, relative to the size of the model


def side_loads(
    model: Model, dt: float, duration: float, run: Callable
) -> list[tuple[np.ndarray, np.ndarray, TimeFunction]]:
    """Return the loads of the free-field sides of a model.

    Parameters
    ----------
    model : Model
    dt, duration : float, s
        Step and length of the run.
    run : callable
        See `shake`.

    Returns
    -------
    list of (nodes (n,), forces (n, 3) per unit of a history, TimeFunction)

    Raises
    ------
    InputError
        If there is no input from below, or a side can't have columns.

    Notes
    -----
    theory.md (4.8), (4.12), (4.13).
    """
    sides = [b.surface for b in model.boundaries if isinstance(b, FreeField)]
    if not sides:
        return []
    inputs = _inputs_from_below(model)
    _refuse_ground(model, sides)
    motions, side_forces = {}, []
    for surface in sides:
        side = _Side(model, surface)
        for column in side.columns:
            if column not in motions:
                motions[column] = shake(model, column, inputs, dt, duration, run)
        side_forces += side.loads(surface_impedance(model, surface), motions)
    return side_forces


class _Side:
    """Vertical side with its columns."""

    def __init__(self, model, surface):
        """Place columns along the side, about as far apart as its nodes."""
        self.model, self.surface, mesh = model, surface, model.mesh
        self.corner, self.area, normals = surface_areas(mesh, surface)
        self.normal = self._upright(normals)
        self.along = mesh.points @ np.cross(self.normal, [0.0, 0.0, 1.0])
        self.zone = surface_zones(mesh, surface)
        self.corners = np.stack([self.along, mesh.points[:, 2]], axis=1)[mesh.surfaces[surface]]
        self.factor = np.broadcast_to(model.speed_factor, len(mesh.zones))
        self.base = mesh.points[:, 2].min()
        first, last = self.corners[..., 0].min(), self.corners[..., 0].max()
        apart = np.ptp(self.corners[..., 0], axis=1).mean()
        self.places = np.linspace(first, last, max(1, round((last - first) / apart)) + 1)
        nudge = LEVEL * (last - first)
        inside = np.clip(self.places + nudge, first + nudge, last - nudge)
        tall, group = np.ptp(self.corners[..., 1], axis=1), mesh.zone_group[self.zone]
        self.cell = {
            g: np.average(tall[group == g], weights=self.area[::3][group == g])
            for g in np.unique(group)
        }
        self.columns = [self._column(position) for position in inside]

    def _upright(self, normals):
        """Return the horizontal normal of the side; raise InputError if it is not vertical."""
        if np.ptp(normals, axis=0).max() > LEVEL or abs(normals[0, 2]) > LEVEL:
            raise InputError(
                f"boundaries.free_field: {self.surface!r} must be a vertical plane, so that "
                "columns of ground can stand beside it; make it one, or leave it viscous"
            )
        return normals.mean(axis=0)

    def _column(self, position):
        """Return the column of a vertical line on the side: groups, factors and levels of cells."""
        low, high = _crossed(self.corners, position)
        met = np.flatnonzero(high > low)
        met = met[np.argsort(low[met], kind="stable")]
        low, high, zone = low[met], high[met], self.zone[met]
        if low[0] - self.base > LEVEL * np.ptp(self.model.mesh.points[:, 2]):
            raise InputError(
                f"boundaries.free_field: {self.surface!r} must reach down to the level of the "
                f"input at {self.base:g} m, it ends at {low[0]:g} m"
            )
        group = self.model.mesh.zone_group[zone]
        starts = np.flatnonzero(np.diff(group, prepend=-1))
        limits = [*low[starts], high[-1]]
        levels, cells = [round(float(self.base), 6)], []
        for layer, (start, stop) in enumerate(zip(starts, [*starts[1:], len(met)], strict=True)):
            part = slice(start, stop)
            height = limits[layer + 1] - limits[layer]
            count = max(1, round(height / self.cell[group[start]]))
            tops = np.linspace(limits[layer], limits[layer + 1], count + 1)
            middles = 0.5 * (tops[1:] + tops[:-1])
            inside = np.searchsorted(low[part], middles) - 1 + start
            name = self.model.mesh.groups[group[start]]
            cells += [(name, round(float(self.factor[z]), 9)) for z in zone[inside]]
            levels += [round(float(top), 6) for top in tops[1:]]
        return GroundColumn(tuple(levels), tuple(cells))

    def loads(self, impedance, motions):
        """Return Z v_f + A sigma_f n as nodal forces by history; `impedance` by node."""
        points = self.model.mesh.points
        nodes = np.fromiter(impedance, dtype=int)
        matrices = np.stack(list(impedance.values()))
        forces = {}
        for number, column in enumerate(self.columns):
            share, height = self._interpolated(number, nodes, points[nodes, 2])
            for axis, histories in motions[column].velocity.items():
                weight = _between(np.array(column.levels), height) * share[:, None]
                for level, history in enumerate(histories):
                    _collect(forces, history, nodes, weight[:, level, None] * matrices[:, :, axis])
            middle = np.repeat(self.corners.mean(axis=1), 3, axis=0)
            share, height = self._interpolated(number, None, middle[:, 1], middle[:, 0])
            cell = np.searchsorted(column.levels, height, side="right") - 1
            cell = np.clip(cell, 0, len(column.cells) - 1)
            for axis, histories in motions[column].stress.items():
                traction = np.outer(share * self.area, self._across(axis))
                for k, history in enumerate(histories):
                    _collect(forces, history, self.corner, (cell == k)[:, None] * traction)
        return [(*_summed(parts), history) for history, parts in forces.values()]

    def _across(self, axis):
        """Return the traction (3,) on the side per unit stress of an axis."""
        east, north, _ = self.normal
        return np.array([[0.0, 0.0, east], [0.0, 0.0, north], [east, north, 0.0]][axis])

    def _interpolated(self, number, nodes, height, along=None):
        """Return the interpolation weight of a column at places, and their height in it."""
        along = self.along[nodes] if along is None else along
        weights = _between(self.places, along)
        tops = np.array([column.levels[-1] for column in self.columns])
        relative = (height - self.base) / (weights @ tops - self.base)
        return weights[:, number], self.base + relative * (tops[number] - self.base)


def _crossed(corners, position):
    """Return the lowest and highest point (n,) of triangles (n, 3, 2) on a vertical line."""
    low, high = np.full(len(corners), np.inf), np.full(len(corners), -np.inf)
    for k in range(3):
        (s0, z0), (s1, z1) = corners[:, k].T, corners[:, k - 1].T
        crosses = (s0 - position) * (s1 - position) < 0.0
        share = np.where(crosses, (position - s0) / np.where(crosses, s1 - s0, 1.0), 0.0)
        z = z0 + share * (z1 - z0)
        low = np.where(crosses, np.minimum(low, z), low)
        high = np.where(crosses, np.maximum(high, z), high)
    return low, high


def _between(knots, values):
    """Return the weights (n_values, n_knots) of linear interpolation, constant beyond the ends."""
    at = np.clip(np.searchsorted(knots, values, side="right") - 1, 0, len(knots) - 2)
    share = np.clip((values - knots[at]) / (knots[at + 1] - knots[at]), 0.0, 1.0)
    share = np.where(np.minimum(share, 1.0 - share) < LEVEL, np.round(share), share)
    weights, rows = np.zeros((len(values), len(knots))), np.arange(len(values))
    weights[rows, at], weights[rows, at + 1] = 1.0 - share, share
    return weights


def _collect(forces, history, nodes, vectors):
    """Add nonzero forces (n, 3) at nodes to those of a history."""
    nonzero = vectors.any(axis=1)
    if nonzero.any():
        forces.setdefault(id(history), (history, []))[1].append((nodes[nonzero], vectors[nonzero]))


def _summed(parts):
    """Return unique nodes and the sum of their forces."""
    nodes, index = np.unique(np.concatenate([n for n, _ in parts]), return_inverse=True)
    forces = np.zeros((len(nodes), 3))
    np.add.at(forces, index, np.concatenate([v for _, v in parts]))
    return nodes, forces


def _inputs_from_below(model):
    """Return the inputs; raise InputError unless all enter at the base of the model."""
    inputs = [b for b in model.boundaries if isinstance(b, (StressInput, VelocityInput))]
    if not inputs:
        raise InputError(
            "boundaries.free_field: nothing enters from below; columns need StressInput or "
            "VelocityInput on the bottom (sources inside need viscous sides only)"
        )
    size = np.ptp(model.mesh.points[:, 2])
    for side in inputs:
        height = model.mesh.points[model.mesh.surfaces[side.surface]][..., 2]
        if height.max() - model.mesh.points[:, 2].min() > LEVEL * size:
            raise InputError(
                f"boundaries.free_field: columns follow input from below only, got input through "
                f"{side.surface!r}; in one medium use PlaneWave, else viscous sides"
            )
    return inputs


def _refuse_ground(model, sides):
    """Raise InputError for ground beside the sides that columns can't represent."""
    mesh = model.mesh
    if model.quadratic:
        raise InputError(
            "boundaries.free_field: columns need zones of constant strain; leave quadratic out"
        )
    if model.sponge is not None or model.local_damping:
        raise InputError(
            "boundaries.free_field: a sponge layer or local damping would damp the ground that the "
            "columns "
            "stand for; leave it out"
        )
    for surface in sides:
        for group in np.unique(mesh.zone_group[surface_zones(mesh, surface)]):
            law = model.law(mesh.groups[group]).name
            if law != "elastic":
                raise InputError(
                    f"boundaries.free_field: columns can't follow the law '{law}' of "
                    f"{mesh.groups[group]!r} at {surface!r}; put elastic ground before the side"
                )
        if mesh.contacts is None:
            continue
        both = np.stack([mesh.contacts.minus, mesh.contacts.plus])
        reached = np.isin(both, mesh.surfaces[surface]).any(axis=0)
        if reached.any():
            joint = mesh.contacts.names[mesh.contacts.joint[reached.argmax()]]
            raise InputError(
                f"boundaries.free_field: the joint {joint!r} reaches the side {surface!r}, and "
                "columns know no joints; end it before the side, or leave the side viscous"
            )
