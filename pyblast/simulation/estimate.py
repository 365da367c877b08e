"""Estimate: zones, steps, memory and minutes of a run, before its mesh is built."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from .. import core
from ..config.ground import MeshConfig
from ..errors import Finding
from ..ground.ground import Ground
from ..ground.tables import mean_edge
from ..mesh.grid import layer_limits
from ..mesh.hexahedral.mapped import grid_lines, in_a_grid, is_plain, layer_cells, least_edge
from ..mesh.hexahedral.planes import NotMapped
from ..mesh.hexahedral.subdivided import TWICE
from ..mesh.quality import ZONES_PER_CUBE, available
from ..model.model import Model
from ..signals.seismogram import Seismogram
from ..solver.assembly import time_step
from ..solver.edge_springs import SAMPLE_BYTES, held_bytes, run_bytes
from ..solver.hexahedra import in_layer
from ..solver.line_implicit import (
    least_of_parts,
    line_parts,
    moduli_of,
    parts_of_groups,
    step_with_lines,
    steps_of_gradients,
)
from ..units import in_minutes, plain_number
from .accuracy import held_shares
from .recipe import (
    CUT,
    ORDER,
    ORDERS,
    Stations,
    layer_sizes,
    obstacle_to_hexahedra,
    scaled,
    sized_by_blast,
    thin_layers,
    whole_layers,
    with_edges,
)

# Processor seconds of a step on one AMD EPYC: docs/decisions.md. Of a node of hexahedra
# of an order (higher ones as 4) in ground that is elastic and that relaxes, more in an absorbing
# layer; of a tetrahedron; more of one that may yield; of a contact.
NODE = {2: (3e-8, 40e-8), 3: (2.5e-8, 18e-8), 4: (2.5e-8, 18e-8)}
IN_LAYER = {2: 16e-8, 3: 11e-8, 4: 11e-8}
CACHED, BEYOND = 80_000, 30e-8  # relaxing nodes that caches hold; more of a node where more relax
ZONE = {"linear": (1.1e-8, 2e-8), "quadratic": (15e-8, 35e-8)}
YIELDING, CONTACT = 2e-8, 5e-8
NODES = {"linear": 0.2, "quadratic": 4.6}  # of a tetrahedron
CONTACTS = {"linear": 2.0, "quadratic": 9.0}  # on a joint, in the square of an edge
SHORTEST = {"linear": 0.16, "quadratic": 0.075}  # step over the time of a P wave along an edge
PER_CELL, OF_GRID = 6.0, 2.3  # tetrahedra in a cell of a grid; their step over that of others
MOST_LINES = 2000  # of a grid along an axis; of finer ones every so many is counted
MOST_PLANES = 200  # of joint sets that are placed one by one
SLIVERS = 7.5  # step of cubes over that of hexahedra that are cut out of tetrahedra of their edges
SAFE = 0.95  # step over its bound, which waves in soil alone may miss by some per cent
HALVINGS = 10  # of the range in which a frequency is looked for
LOWEST = 0.03  # of the frequency, or of one over the edges: the least that is offered
ACCURACIES = (0.02, 0.03, 0.05, 0.1)
LEAST_OF_ZONES = 0.5  # from which on ground is said to need them


@dataclass(frozen=True)
class Cost:
    """Cost of a run.

    Parameters
    ----------
    elements : str
        Hexahedra of an order, or tetrahedra.
    zones, nodes, steps : float
    memory : float, bytes
    seconds : float
        Of one processor.
    finest : str
        Ground with the most zones, where it has more than half of them; else empty.
    """

    elements: str
    zones: float
    nodes: float
    steps: float
    memory: float
    seconds: float
    finest: str = ""

    @property
    def minutes(self) -> float:
        """Minutes on the threads that a run here takes."""
        return self.seconds / 60.0 / (1 if self.nodes < core.LEAST_SHARED else core.n_threads())

    def __str__(self) -> str:
        """Return the numbers in words."""
        zones, nodes, steps = map(_in_words, (self.zones, self.nodes, self.steps))
        return (
            f"{self.elements}, about {zones} zones, {nodes} nodes, {steps} steps, "
            f"{plain_number(self.memory / 1e9, 2)} GB, {in_minutes(self.minutes)}"
        )


def _in_words(count):
    """Return a number in two digits, in millions where it is large."""
    return f"{plain_number(count / 1e6, 2)} million" if count > 1e6 else plain_number(count, 2)


@dataclass(frozen=True, eq=False)
class _Bricks:
    """Zones alike of one material: how many, whether in the absorbing layer, and their edges."""

    material: str
    zones: float
    in_layer: bool
    edges: np.ndarray  # (3,) m


@dataclass(frozen=True)
class _Counts:
    """What of a mesh takes time: kind of elements (an order, "linear" or "quadratic"), numbers."""

    kind: int | str
    zones: float
    nodes: float
    contacts: float
    relaxing: float  # share of the zones
    in_layer: float  # share of the zones
    yielding: float

    @property
    def elements(self) -> str:
        """The elements in words."""
        if isinstance(self.kind, int):
            return f"hexahedra of order {self.kind}"
        return f"{self.kind} tetrahedra"

    @property
    def seconds(self) -> float:
        """Processor time of a step."""
        more = YIELDING * self.yielding + CONTACT * self.contacts
        if isinstance(self.kind, int):
            elastic, relaxing = NODE[min(self.kind, max(NODE))]
            layer = IN_LAYER[min(self.kind, max(IN_LAYER))] * self.in_layer
            if self.relaxing * self.nodes > CACHED:
                relaxing += BEYOND
            per_node = elastic + self.relaxing * (relaxing - elastic) + layer
            return more + per_node * self.nodes
        elastic, relaxing = ZONE[self.kind]
        return more + (elastic + self.relaxing * (relaxing - elastic)) * self.zones


def cost_of(model: Model, duration: float, dt: float | None = None) -> Cost:
    """Return what a run of a model costs over a duration in s, at a given step or its own."""
    nodes, mesh = model.nodes, model.mesh
    n_steps = int(np.ceil(duration / (dt or time_step(model)[0])))
    count = np.bincount(mesh.zone_group, minlength=len(mesh.groups)) / len(mesh.zones)
    kind = mesh.order if mesh.hexahedral else "quadratic" if model.quadratic else "linear"
    counts = _Counts(
        kind, len(mesh.zones), len(nodes.points),
        0 if nodes.contacts is None else len(nodes.contacts.area),
        float(count @ [bool(model.branches(name)) for name in mesh.groups]),
        float(in_layer(model).any(axis=1).mean()) if mesh.hexahedral else 0.0,
        int(np.count_nonzero(model.yielding())),
    )  # fmt: skip
    memory = run_bytes(model, n_steps * (1 + len(model.receivers)))
    return Cost(counts.elements, counts.zones, counts.nodes, n_steps, memory,
                n_steps * counts.seconds)  # fmt: skip


def estimate(
    ground: Ground,
    stations: Stations,
    top: Callable[[], float | None],
    duration: float,
    step_factors: dict[bool, float],
) -> Cost | None:
    """Return what a run costs, None where the mesh is read from a file.

    Parameters
    ----------
    ground : Ground
    stations : Stations
    top : callable
        As of `mesh_ground`.
    duration : float, s
    step_factors : dict of bool to float
        Of hexahedra (True) and of tetrahedra.

    Raises
    ------
    InputError
        If the ground contradicts itself, or no key and no blast says how fine it shall be.

    Notes
    -----
    Hexahedra by the lines of their grid, tetrahedra by the volumes of layers. The step of hexahedra
    is a bound: theory.md (2.57).
    """
    ground = sized_by_blast(ground, top)
    if ground.mesh.file is not None:
        return None
    if obstacle_to_hexahedra(ground) is not None:
        return _of_tetrahedra(ground, stations, duration, step_factors[False])
    order = ground.mesh.order
    if order is None and is_plain(ground.geometry) and not thin_layers(ground, stations):
        order = ORDER
    if not in_a_grid(ground.geometry, layer_sizes(ground, stations, ORDERS[0])):
        return _of_cut(ground, stations, duration, step_factors[True])
    orders = range(stations.lowest_order, max(ORDERS) + 2) if order is None else [order]
    costs = [_of_hexahedra(ground, stations, n, duration, step_factors[True]) for n in orders]
    return min(costs, key=lambda cost: cost.seconds)


def _of_cut(ground, stations, duration, step_factor):
    """Return the cost of a run on hexahedra that are cut out of tetrahedra."""
    order = ground.mesh.order or ORDERS[0]
    sizes, geometry = layer_sizes(ground, stations, order), ground.geometry
    thick, names = np.diff(-geometry.limits), [part.name for part in geometry.layers]
    rocks = [ground.materials[name] for name in names]
    wide = np.array([least_edge([size], thick[k : k + 1]) for k, size in enumerate(sizes)])
    high = np.minimum(wide, thick / TWICE)
    around = TWICE * layer_cells(order) * wide.min()  # of the absorbing layer, on both sides
    area = np.prod(np.ptp(geometry.box[:2], axis=1) + around)
    zones = 4.0 * ZONES_PER_CUBE * area * thick / (TWICE**3 * wide**2 * high)
    steps = steps_of_gradients(
        2.0 / np.column_stack([wide, wide, high]), moduli_of(rocks),
        np.array([rock.density for rock in rocks]), order,
    )  # fmt: skip
    total, dt = float(zones.sum()), step_factor * float(steps[0].min()) / SLIVERS
    relaxing = float(zones @ [bool(rock.law.branches) for rock in rocks]) / total
    inner = np.prod(np.ptp(geometry.box[:2], axis=1)) / area
    counts = _Counts(order, total, total * order**3, 0.0, relaxing, 1.0 - inner, 0.0)
    rates = {branch.rate for rock in rocks for branch in rock.law.branches}
    cost = _cost(counts, stations, duration / dt, len(rates), names, zones / total)
    return replace(cost, elements=f"{cost.elements} {CUT}")


def _of_hexahedra(ground, stations, order, duration, step_factor):
    """Return the cost of a run on hexahedra of an order."""
    sizes = layer_sizes(ground, stations, order)
    bricks = _bricks(ground.geometry, sizes, order)
    every = (*ground.geometry.layers, *ground.geometry.fills)
    names = [*dict.fromkeys(part.name for part in every)]
    rocks = [ground.materials[name] for name in names]
    group = np.array([names.index(brick.material) for brick in bricks])
    steps = steps_of_gradients(
        2.0 / np.array([brick.edges for brick in bricks]), moduli_of(rocks)[:, group],
        np.array([rock.density for rock in rocks])[group], order,
    )  # fmt: skip
    part, owner = parts_of_groups(steps, group)
    least, zones = least_of_parts(steps, part), np.array([brick.zones for brick in bricks])
    whole = whole_layers(ground, names)
    chosen = line_parts(*least, np.bincount(part, zones), lambda more: whole[owner[more]].all())
    dt = SAFE * step_factor * step_with_lines(least, chosen)
    total, contacts = float(zones.sum()), _joint_area(ground) * order**2 / sizes[:, 0].min() ** 2
    shares = np.bincount(group, zones, len(names)) / total
    counts = _Counts(
        order, total, total * order**3, contacts,
        float(shares @ [bool(rock.law.branches) for rock in rocks]),
        sum(brick.zones for brick in bricks if brick.in_layer) / total, 0.0,
    )  # fmt: skip
    rates = {branch.rate for rock in rocks for branch in rock.law.branches}
    return _cost(counts, stations, duration / dt, len(rates), names, shares)


def _bricks(geometry, sizes, order):
    """Return the zones (list of `_Bricks`) between the lines of a grid, alike ones together.

    Of ground that no mapped grid serves, or with many planes, those of a grid without planes whose
    zones are no wider than joints are apart. Zones that are too many to list are counted in grids
    of larger ones.
    """
    extent, thick = np.ptp(geometry.box, axis=1), np.diff(-geometry.limits)
    spacing = min((part.spacing for part in geometry.joint_sets), default=np.inf)
    few = np.linalg.norm(extent) / spacing < MOST_PLANES
    flat = replace(geometry, surface=None)
    without = replace(flat, joint_sets=(), faults=(), benches=(), fills=())
    across = np.max(thick / sizes[: len(thick), 1])
    scale = max(1.0, extent[:2].max() / sizes[:, 0].min() / MOST_LINES, across / MOST_LINES)
    try:
        if scale > 1.0 or not few:
            raise NotMapped
        lines = grid_lines(flat, sizes, order)
    except NotMapped:
        lines = grid_lines(without, scale * np.minimum(sizes, spacing)[: len(thick)], order)
    bricks = []
    for kind in product(*(_kinds(line, geometry, axis) for axis, line in enumerate(lines))):
        steps, counts, inside, layers, *fills = np.array(kind).T
        name = geometry.layers[int(layers[2])].name
        for fill, within in zip(geometry.fills, fills, strict=True):
            name = fill.name if within.all() else name
        zones = float(counts.prod()) * scale**3
        bricks.append(_Bricks(name, zones, not inside.all(), steps / scale))
    return bricks


def _kinds(line, geometry, axis):
    """Return the cells of a line along an axis (n, 4 + n_fills), alike ones in one row.

    Length, how many, whether in the box, layer (along the third axis), whether in each fill.
    """
    middle = 0.5 * (line[1:] + line[:-1])
    layer = np.searchsorted(-geometry.limits[1:-1], -middle) if axis == 2 else np.zeros(len(middle))
    columns = [np.diff(line).round(6), _within(line, *geometry.box[axis]), layer]
    columns += [_within(line, *fill.box[axis]) for fill in geometry.fills]
    kinds, counts = np.unique(np.array(columns, dtype=float).T, axis=0, return_counts=True)
    return np.insert(kinds, 1, counts, axis=1)


def _within(line, low, high):
    """Return which cells of a line lie between two ends, (n,) bool."""
    middle = 0.5 * (line[1:] + line[:-1])
    return (middle > low) & (middle < high)


def _joint_area(ground):
    """Return the area in m2 of all joints, of faults at most that of the middle of the box."""
    size = np.array(ground.mesh.size_m)
    widest = float(np.prod(np.sort(size)[1:]))
    sets = sum(np.prod(size) / part.spacing_m for part in ground.mesh.joint_sets)
    own = [np.prod(part.extent_m) if part.extent_m else widest for part in ground.mesh.faults]
    return float(sets + np.minimum(own, widest).sum())


def _of_tetrahedra(ground, stations, duration, step_factor):
    """Return the cost of a run on tetrahedra."""
    mesh, kind = with_edges(ground), "quadratic" if ground.mesh.quadratic else "linear"
    size, pad = np.array(mesh.size_m, dtype=float), mesh.padding_m or 0.0
    rocks = [ground.materials[part.material] for part in mesh.layers]
    edges = np.array([mean_edge(mesh, *each) or mesh.edge_m or np.inf
                      for each in zip(mesh.layers, rocks, strict=True)])  # fmt: skip
    limits = layer_limits(ground.geometry.layers, size[2], 0.0)
    share = -np.diff(limits) / size[2]
    spacing = min((part.spacing_m for part in mesh.joint_sets), default=np.inf)
    if mesh.grid_cells is None:
        edges = np.minimum(edges, spacing)
        zones = ZONES_PER_CUBE * np.prod(size) * share / edges**3
        for part in mesh.refinements:
            zones += ZONES_PER_CUBE * np.prod(np.diff(part.box_m)) / part.edge_m**3 * share
        outside = np.prod(size + pad * np.array([2.0, 2.0, 1.0])) - np.prod(size)
        zones += ZONES_PER_CUBE * outside * share / np.maximum(edges, mesh.padding_edge_m or 0) ** 3
    else:
        zones = PER_CELL * np.prod(mesh.grid_cells) * share
        edges = np.full(len(rocks), (size / mesh.grid_cells).min())
        step_factor *= OF_GRID
    dt = step_factor * SHORTEST[kind] * float(np.min(edges / [rock.cp for rock in rocks]))
    total = float(zones.sum())
    counts = _Counts(
        kind, total, NODES[kind] * total, CONTACTS[kind] * _joint_area(ground) / edges.min() ** 2,
        float(zones @ [bool(rock.law.branches) for rock in rocks]) / total, 0.0,
        float(zones @ [rock.yields for rock in rocks]),
    )  # fmt: skip
    rates = {branch.rate for rock in rocks for branch in rock.law.branches}
    names = [part.material for part in mesh.layers]
    return _cost(counts, stations, duration / dt, len(rates), names, zones / total)


def _cost(counts, stations, n_steps, n_rates, names, shares):
    """Return the cost of a run of meshes of some counts; shares (n,) of zones by material."""
    received = sum(name.startswith("receivers.") for name in stations.positions)
    numbers = np.array([counts.zones, counts.nodes, counts.contacts])
    quadratic = counts.kind != "linear"
    memory = held_bytes(numbers, quadratic, n_rates, counts.yielding)
    memory += SAMPLE_BYTES * n_steps * (1 + received)
    most = int(np.argmax(shares))
    finest = names[most] if len(names) > 1 and shares[most] > LEAST_OF_ZONES else ""
    time = float(n_steps * counts.seconds)
    return Cost(
        counts.elements, counts.zones, counts.nodes, float(n_steps), float(memory), time, finest
    )


def beyond_budget(
    cost: Cost,
    ground: Ground,
    price: Callable[[MeshConfig], Cost | None],
    entering: Sequence[Seismogram],
) -> Finding | None:
    """D49: a run that takes longer than its budget or more memory than there is; what does not.

    Parameters
    ----------
    cost : Cost
    ground : Ground
        Whose ``mesh.minutes`` is the budget, sized by the blast where no key does it.
    price : callable
        ``(table of the mesh) -> cost``.
    entering : sequence of Seismogram
        What enters, before any low-pass.
    """
    mesh, free = ground.mesh, available()

    def affordable(table):
        other = price(table)
        return other if other.minutes <= mesh.minutes and other.memory <= free else None

    if cost.minutes <= mesh.minutes and cost.memory <= free:
        return None
    offers = [
        _coarser(ground, affordable, entering),
        *(_less_accurate(mesh, affordable) if "hexahedra" in cost.elements else ()),
        *(_quadratic(ground, affordable) if "linear" in cost.elements else ()),
    ]
    offers = [text for text in offers if text] or ["a smaller mesh.size_m"]
    if cost.memory <= free:
        offers.append(
            f"mesh.minutes = {plain_number(np.ceil(1.1 * cost.minutes), 3)} runs it as is"
        )
    why = f"{cost.finest!r} has most of the zones. " if cost.finest else ""
    obstacle = obstacle_to_hexahedra(ground)
    if obstacle is not None and mesh.kind == "auto":
        why += f"It has tetrahedra, since {obstacle}. "
    if CUT in cost.elements:
        why += (
            "A grid would serve benches whose lines are straight, level and parallel, or a surface "
            "of places in place of triangles. "
        )
    return Finding(
        "D49",
        "The run is beyond its budget",
        f"It has {cost}; mesh.minutes allows {in_minutes(mesh.minutes)}, the machine has "
        f"{plain_number(free / 1e9, 2)} GB left. {why}Within it: {'; '.join(offers)}.",
        failed=True,
        numbers={"minutes": cost.minutes, "allowed": mesh.minutes, "nodes": cost.nodes},
    )


def at_frequency(ground: Ground, share: float) -> MeshConfig:
    """Return the table of a mesh that carries a share of the frequency of that of a ground.

    By its frequency, by its edges where these are given, or by the cells of its grid.
    """
    mesh, top = ground.mesh, ground.frequency
    if mesh.grid_cells is not None:
        cells = [int(np.ceil(share * count)) for count in mesh.grid_cells]
        return mesh.model_copy(update={"grid_cells": cells})
    if top is None or any(part.edge_m is not None for part in (mesh, *mesh.layers)):
        return scaled(mesh, 1.0 / share)
    return mesh.model_copy(update={"frequency_hz": share * top})


def _coarser(ground, affordable, entering):
    """Return which edges or which frequency would be affordable, and what a run then holds."""
    mesh, low, high = ground.mesh, np.log(LOWEST), 0.0
    if mesh.grid_cells is not None or affordable(at_frequency(ground, LOWEST)) is None:
        return ""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        fits = affordable(at_frequency(ground, np.exp(middle))) is not None
        low, high = (middle, high) if fits else (low, middle)
    table = at_frequency(ground, np.exp(low))
    time = in_minutes(affordable(table).minutes)
    if table.frequency_hz == mesh.frequency_hz:
        return f"edges {plain_number(np.exp(-low), 2)} times as long ({time}; see D40 then)"
    digit = 10.0 ** (np.floor(np.log10(table.frequency_hz)) - 1.0)
    hz = float(np.floor(table.frequency_hz / digit) * digit)
    energy, peak = np.min([held_shares(each, each, hz) for each in entering], axis=0)
    return (
        f"mesh.frequency_hz = {plain_number(hz, 2)} in place of "
        f"{plain_number(mesh.frequency_hz or ground.frequency, 3)} ({time}; of what enters it "
        f"holds {100 * energy:.2g} % of the energy and {100 * peak:.2g} % of the peak)"
    )


def _less_accurate(mesh, affordable):
    """Yield which error of the waveform would be affordable on hexahedra."""
    for accuracy in (each for each in ACCURACIES if each > mesh.accuracy):
        other = affordable(mesh.model_copy(update={"accuracy": accuracy}))
        if other is not None:
            yield (
                f"mesh.accuracy = {accuracy:g} in place of {mesh.accuracy:g} "
                f"({in_minutes(other.minutes)}; waveforms {100 * accuracy:g} % off)"
            )
            return


def _quadratic(ground, affordable):
    """Yield whether quadratic tetrahedra would be affordable."""
    elastic = all(rock.law.name == "elastic" for rock in ground.materials.values())
    if not elastic or ground.mesh.grid_cells is not None:
        return
    other = affordable(ground.mesh.model_copy(update={"quadratic": True}))
    if other is not None:
        yield f"mesh.quadratic = true ({in_minutes(other.minutes)}; as accurate)"
