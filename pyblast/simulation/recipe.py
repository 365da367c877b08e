"""Recipe of a mesh: its elements and edges; spectral hexahedra where the ground allows it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise

import numpy as np

from ..config.ground import LayerConfig, MeshConfig
from ..errors import InputError, named_error
from ..ground.ground import Ground
from ..ground.surface import make_fractures
from ..ground.tables import make_mesh, mean_edge
from ..mesh.as_built import OF_WAVE, Row, as_built, following
from ..mesh.builder import TOLERANCE_SHARE
from ..mesh.gmsh import MeshingError
from ..mesh.grid import SIDES
from ..mesh.hexahedral import mapped, subdivided, swept
from ..mesh.hexahedral.benches import Benches
from ..mesh.hexahedral.mapped import Builder, Fine, Surface
from ..mesh.hexahedral.planes import NotMapped
from ..mesh.mesh import Mesh, zone_edge_lengths
from ..mesh.quality import explicit_work
from ..model.material import ConstantQ
from ..model.model import HEX_NODES, Model
from ..model.thin_layers import reach_of_trapped_waves, share_of_edge
from ..solver.injection import LOWEST_ORDER, injected_sources
from ..solver.line_implicit import work_of_ground
from ..solver.moment_density import edges_near

ORDER = 5  # in a plain grid
ORDERS = (3, 4)  # tried first elsewhere; a node and step costs about the same in all
PLAIN, CUT = "in a plain grid", "of tetrahedra cut"
BUILDERS: dict[str, Builder] = {
    "between the planes": mapped.build_mapped,
    "swept along one direction": swept.build_swept,
}
# Nodes per shortest S wavelength for an error of 1 % over three wavelengths, by order; the error
# falls with the power below of their number: docs/quality/performance.md.
NODES_FOR_ONE_PER_CENT = {2: 9.0, 3: 5.9, 4: 4.6, 5: 4.3, 6: 4.0, 7: 4.0, 8: 4.1}
WAVELENGTHS = 3.0
OF_FITS, ORDER_OF_FITS = 0.015, 4  # by that rule: 0.1 to 1 % of the energy of a whole band
HARMONICS = 1.5  # times the highest frequency: carried where joints close or slip
BETTER = 0.04  # error of the better mesh over that of the working mesh
FINER_ERROR = 0.2  # of the mesh that estimates this error, over that of fits
LINEAR_EDGE = 0.6  # of linear zones where a law needs them, over that of quadratic ones
FINER_EDGE = 0.63  # the same for edges of tetrahedra
SOFT = 0.3  # S speed over that of the ground beneath: docs/quality/verification.md
NARROWER = 0.7, 0.5, 0.35, 0.25  # width of zones that follow a surface, over that of others
SHARP = 0.015  # of an edge: tolerance of tetrahedra where the usual one bends planes
SHARPER = 0.25  # of that, where facets of a set that nearly meets a fault are still missing
RELIEF = 0.5 * OF_WAVE  # of the shortest wavelength, of tetrahedra to a survey
BESIDE = 0.6  # of an edge: radius of the sphere of a source
RING = 2.2  # edges from a source to an open side, with which it can be injected
STEP = 0.67  # of the edge before, of the edges that are tried around sources
LISTED = 3  # rows of a survey in a sentence
SIZED = ("layers", "refinements")  # parts of the mesh with edges of their own
ROUGH = 1.15  # of a frequency, for edges of tetrahedra to carry it on any way
TETRAHEDRA = {True: 3.0, False: 10.0}  # edges per wavelength of quadratic and of linear ones


@dataclass(frozen=True, eq=False)
class Meshed:
    """Mesh of a ground, not split, and why it has these elements.

    Parameters
    ----------
    mesh : Mesh
    reason : str
        One sentence.
    rows : tuple of Row
        Survey of what was built beside what was asked for.
    cut : bool
        Whether the zones are hexahedra cut out of tetrahedra.
    """

    mesh: Mesh
    reason: str
    rows: tuple[Row, ...] = ()
    cut: bool = False


@dataclass(frozen=True, eq=False)
class Stations:
    """Stations: what of sources and receivers decides how a ground is cut.

    Parameters
    ----------
    positions : dict of str to (2 or 3,) float, m
        Of sources and receivers of all blasts, by name.
    reach : float, m
        Longest path between them.
    explosive : bool
        Whether some source has a moment.
    near : bool
        Whether receivers may stand near to sources inside.
    clearance : float, m
        Least horizontal distance of receivers from sources; zero where it is not known.
    """

    positions: dict[str, tuple[float, ...]]
    reach: float
    explosive: bool = False
    near: bool = False
    clearance: float = 0.0

    @property
    def lowest_order(self) -> int:
        """Lowest order of hexahedra that resolves the sources."""
        return LOWEST_ORDER if self.explosive else 2

    @property
    def highest_source(self) -> float:
        """Height in m of the highest source; infinite where one stands on the ground."""
        return max((at[2] if len(at) == 3 else np.inf for at in self._sources), default=-np.inf)

    @property
    def _sources(self):
        """Positions of the sources."""
        return [at for name, at in self.positions.items() if not name.startswith("receivers.")]

    def has_source_in(self, box: np.ndarray) -> bool:
        """Tell whether a source lies in a box (3, 2) in m, or on the ground over it."""
        return any(
            all(low <= x <= high for x, (low, high) in zip(at, box, strict=False))
            for at in self._sources
        )

    def least_depth(self, surface: Surface) -> float:
        """Return the least depth in m of a source under a surface, infinite without sources."""
        return min(
            (float(surface.height(np.array([at[:2]]))[0]) - at[2] if len(at) == 3 else 0.0
             for at in self._sources),
            default=np.inf,
        )  # fmt: skip


def convergence(order: int) -> float:
    """Return the power with which errors of hexahedra fall with the nodes per wavelength."""
    return 1.3 * (order + 1)


def nodes_per_wavelength(order: int, accuracy: float, waves: float) -> float:
    """Return the nodes per shortest S wavelength for an error after a path of some wavelengths.

    Examples
    --------
    >>> round(nodes_per_wavelength(4, 0.01, 3.0), 2), round(nodes_per_wavelength(4, 0.003, 3.0), 2)
    (4.6, 5.54)
    """
    factor = 0.01 / accuracy * max(waves, WAVELENGTHS) / WAVELENGTHS
    return NODES_FOR_ONE_PER_CENT[order] * factor ** (1.0 / convergence(order))


def mesh_ground(
    ground: Ground,
    stations: Stations,
    top: Callable[[], float | None],
    model_on: Callable[[Mesh], Model],
    uncut: bool = False,
) -> Meshed:
    """Build or read the mesh of a ground of the elements that it asks for.

    Parameters
    ----------
    ground : Ground
    stations : Stations
    top : callable
        ``() -> frequency``: what the blast asks a mesh to carry, in Hz, where no key says it.
    model_on : callable
        ``(mesh, not split) -> model``: what is placed in a mesh, to see which receivers stand too
        near to sources there.
    uncut : bool
        Whether ground of kind "auto" is refused where it needs tetrahedra, or hexahedra cut out of
        them: these cost ten seconds to build and hundreds of times the work to run.

    Raises
    ------
    InputError
        If the ground asks for hexahedra and they don't serve it.
    """
    sized = sized_by_blast(ground, top)
    meshed = _meshed(sized, stations, model_on, uncut and ground.mesh.kind == "auto")
    if sized is ground:
        return meshed
    words = f"; sized for the {sized.frequency:.3g} Hz of the blast"
    return replace(meshed, reason=meshed.reason + words)


def _meshed(ground, stations, model_on, uncut):
    """Build the mesh of a ground whose edges are known."""
    kind = ground.mesh.kind
    if ground.mesh.file is not None:
        mesh = make_mesh(ground.mesh, ground.materials, ground.folder, log=ground.log)
        return Meshed(mesh, "tetrahedra: the mesh is read from a file", as_built(mesh, None))
    asked, wave = ground.geometry, shortest_wave(ground)
    obstacle = obstacle_to_hexahedra(ground)
    if obstacle is None:
        if len(asked.depths):
            wave = shortest_wave(ground, frozenset(thin_layers(ground, stations)))
        try:
            build = partial(_hexahedra, ground, stations, wave=wave, uncut=uncut)
            meshed = build(asked)
            return _resolving(ground, stations, meshed, asked, model_on, build)
        except NotMapped as reason:
            obstacle = str(reason)
    if uncut:
        raise InputError(f"mesh: hexahedra between its planes do not serve this ground: {obstacle}")
    if kind == "hexahedra":
        raise InputError(
            f"mesh.kind: 'hexahedra' do not serve this ground: {obstacle}; take 'auto' or "
            "'tetrahedra'"
        )
    reason = f"tetrahedra: {obstacle}" if kind == "auto" else "tetrahedra, as mesh.kind asks for"
    return _tetrahedra(ground, stations, asked, wave, reason)


def sized_by_blast(ground: Ground, top: Callable[[], float | None]) -> Ground:
    """Return a ground whose mesh carries the blast, layer by layer, if no key says how fine."""
    mesh = ground.mesh
    parts = [mesh, *mesh.layers]
    sized = [mesh.file, mesh.grid_cells, ground.frequency]
    sized += [part.edge_m for part in parts] + [part.edges_per_wavelength for part in parts]
    if any(size is not None for size in sized):
        return ground
    highest = top()
    if highest is None:
        raise InputError(
            "mesh.edge_m: missing, and no blast says how fine the ground shall be; give edge_m, "
            "frequency_hz or grid_cells"
        )
    carrying = replace(ground, mesh=mesh.model_copy(update={"frequency_hz": highest}))
    if obstacle_to_hexahedra(carrying) is None:
        return carrying
    mesh = mesh.model_copy(update={"frequency_hz": ROUGH * highest})
    if mesh.padding_edge_m is not None:
        least = mesh.frequency_hz * TETRAHEDRA[mesh.quadratic]
        edges = [ground.materials[part.material].cs / least for part in mesh.layers]
        mesh = mesh.model_copy(update={"padding_edge_m": max(mesh.padding_edge_m, *edges)})
    return replace(ground, mesh=mesh)


def _resolving(ground, stations, meshed, asked, model_on, build):
    """Return a mesh that resolves the motion at receivers near to sources, as far as it may.

    The same mesh where it does; else one that goes on beyond its open sides until explosions can
    be injected; else one of shorter edges around the sources, as short as
    ``mesh.near_source_work`` allows.
    """
    if ground.mesh.near_source_work <= 1.0 or not stations.near:
        return meshed
    model = model_on(meshed.mesh)
    needed = edges_near(model, injected_sources(model))
    if not needed:
        return meshed
    boxes = {number: partial(_around, model.sources[number]) for number in needed}
    wider = _widened(ground, stations, meshed, asked, boxes, model_on, build)
    graded = wider or _graded(ground, stations, meshed, asked, boxes, needed, build)
    return graded or meshed


def _widened(ground, stations, meshed, asked, boxes, model_on, build):
    """Return a mesh whose open sides lie so far from the sources that these are injected."""
    reach = RING * float(zone_edge_lengths(meshed.mesh).max())
    around = [box(reach) for box in boxes.values()]
    box = asked.box.copy()
    for number, side in enumerate(SIDES):
        axis, end = divmod(number, 2)
        if side in asked.open_sides:
            ends = [each[axis, end] for each in around]
            box[axis, end] = max(box[axis, end], *ends) if end else min(box[axis, end], *ends)
    beyond = not np.array_equal(box[:2], asked.box[:2])
    if np.array_equal(box, asked.box) or (beyond and asked.surface is not None):
        return None
    middle = tuple(asked.box.mean(axis=1))  # where sets without an origin have a joint
    sets = [replace(part, origin=part.origin or middle) for part in asked.joint_sets]
    try:
        wider = build(replace(asked, box=box, joint_sets=tuple(sets)))
    except InputError:
        return None
    work = _work(ground, stations, wider.mesh) / _work(ground, stations, meshed.mesh)
    if work > ground.mesh.near_source_work:
        return None
    other = model_on(wider.mesh)
    if edges_near(other, injected_sources(other)):
        return None
    return replace(
        wider, reason=f"{wider.reason}; {work:.2g} times the work for room around the sources"
    )


def _graded(ground, stations, meshed, asked, boxes, needed, build):
    """Return a mesh of shorter edges around sources, for as many receivers as may be."""
    before, best = _work(ground, stations, meshed.mesh), None
    for least in _steps(np.concatenate([*needed.values()])):
        lines = []
        for number, edges in needed.items():
            if edges.max() >= least:
                edge = float(edges[edges >= least].min())
                lines.append(Fine(boxes[number](BESIDE * edge), edge))
        try:
            finer = build(asked, lines=lines)
        except InputError:  # not mapped any more, or beyond the memory
            break
        work = _work(ground, stations, finer.mesh) / before
        if work > ground.mesh.near_source_work:
            break
        words = f"edges from {least:.3g} m around the sources, {work:.2g} times the work"
        best = replace(finer, reason=f"{finer.reason}; {words}")
    return best


def _steps(edges):
    """Return some of the edges (n,) in m, the longest first, each shorter by a third at least."""
    steps = []
    for edge in sorted(edges, reverse=True):
        if not steps or edge < STEP * steps[-1]:
            steps.append(edge)
    return [*steps[:-1], edges.min()] if len(steps) > 1 else [edges.min()]


def _around(source, margin):
    """Return the box (3, 2) in m of a source and a margin."""
    ends = getattr(source, "position", None)
    ends = [source.primed, source.end] if ends is None else [ends]
    ends = np.array(ends, dtype=float)
    return np.column_stack([ends.min(axis=0) - margin, ends.max(axis=0) + margin])


def _tetrahedra(ground, stations, asked, wave, reason):
    """Return a mesh of tetrahedra, cut more sharply where the first cut bends planes."""
    if len(asked.depths) or asked.fills:
        key = "layers.follows_surface" if len(asked.depths) else "fills"
        raise InputError(
            f"mesh.{key}: asks for hexahedra between planes, here {reason}; leave it out, or what "
            "stands in the way"
        )
    materials, folder, parts = ground.materials, ground.folder, with_edges(ground)
    asked = replace(asked, faults=(*asked.faults, *make_fractures(parts, folder, ground.log)))
    sharp = SHARP * wave / TETRAHEDRA[parts.quadratic]
    edges = [layer.edge_m or parts.edge_m or 0.0 for layer in (parts, *parts.layers)]
    bends = TOLERANCE_SHARE * max(edges) > OF_WAVE * wave
    given = parts.tolerance_m is not None or parts.grid_cells is not None
    wrong, usual, failure = "", RELIEF * wave if bends else None, None
    for tolerance in (parts.tolerance_m,) if given else (usual, sharp, SHARPER * sharp):
        cut = parts.model_copy(update={"tolerance_m": tolerance})
        try:
            mesh = make_mesh(cut, materials, folder, ground.surface, relief=RELIEF * wave)
        except MeshingError as error:
            failure = error
            continue
        rows = as_built(mesh, asked, wave, stations.positions)
        wrong = differences(rows)
        if not wrong:
            return Meshed(mesh, reason, rows)
    if failure is not None and not wrong:
        raise failure
    raise InputError(
        f"mesh: the ground that is built differs from the one asked for: {wrong}; shorten edge_m "
        "or tolerance_m there, or move planes and sides that nearly meet"
    )


def differences(rows) -> str:
    """Return in words which rows of an as-built survey are beyond their tolerance, if any."""
    wrong = [str(row) for row in rows if not row.good]
    more = f" and {len(wrong) - LISTED} more" if len(wrong) > LISTED else ""
    return "; ".join(wrong[:LISTED]) + more


def shortest_wave(ground: Ground, apart: frozenset[str] = frozenset()) -> float:
    """Return the shortest S wavelength in m that a ground asks its mesh to carry.

    Of all materials but some: thin layers that follow a surface, as thick everywhere, move with
    the rock, whose waves say how closely the mesh shall follow it.
    """
    mesh, top, waves = ground.mesh, ground.frequency, []
    for part in (part for part in mesh.layers if part.material not in apart):
        rock = ground.materials.get(part.material)
        edge = None if rock is None else mean_edge(mesh, part, rock)
        if edge is not None:
            waves.append(TETRAHEDRA[mesh.quadratic] * edge)
        elif top is not None and rock is not None:
            waves.append(rock.cs / top)
    if mesh.grid_cells is not None:
        cells = np.array(mesh.size_m) / mesh.grid_cells
        waves.append(TETRAHEDRA[mesh.quadratic] * float(cells.min()))
    return min(waves, default=np.inf)


def with_edges(ground: Ground) -> MeshConfig:
    """Return the `MeshConfig` with edges of tetrahedra by frequency in layers without any."""
    mesh, top = ground.mesh, ground.frequency
    if mesh.grid_cells is not None or top is None:
        return mesh
    layers = []
    for part in mesh.layers:
        rock = ground.materials.get(part.material)
        if rock is not None and mean_edge(mesh, part, rock) is None:
            edge = rock.cs / (TETRAHEDRA[mesh.quadratic] * top)
            part = part.model_copy(update={"edge_m": edge})
        layers.append(part)
    return mesh.model_copy(update={"layers": layers})


def sizes_for_band(ground: Ground, highest: float, accuracy: float = OF_FITS) -> MeshConfig:
    """Return the `MeshConfig` by which a ground is fitted to records up to a frequency in Hz.

    Where the file leaves the elements to the program, edges of hexahedra follow from the frequency
    and an error (not from the edges of the file), in metres, so that a change of speeds changes no
    mesh; else it is the table of the file. A layer thinner than half its shortest S wavelength has
    hexahedra of its own height and as wide as elsewhere.
    """
    materials = ground.materials
    mesh = ground.mesh.model_copy(update={"near_source_work": 1.0})  # one mesh for all sources
    if mesh.kind != "auto" or mesh.file is not None or mesh.grid_cells is not None:
        return mesh
    parts = [(materials[part.material], part.thickness_m) for part in mesh.layers]
    waves = [(rock.cs / highest, thickness) for rock, thickness in parts]
    thick = [wave for wave, thickness in waves if thickness is None or thickness > 0.5 * wave]
    linear = all(rock.law.name == "elastic" for rock, _ in parts)
    edges = [max(wave, min(thick)) / TETRAHEDRA[linear] for wave, _ in waves]
    layers = [
        part.model_copy(update={"edge_m": edge, "edges_per_wavelength": None})
        for part, edge in zip(mesh.layers, edges, strict=True)
    ]
    sizes = {"edge_m": min(edges), "edges_per_wavelength": None, "frequency_hz": None}
    other = {**sizes, "layers": layers, "quadratic": linear, "accuracy": accuracy}
    other["order"] = mesh.order or ORDER_OF_FITS
    if mesh.padding_edge_m is not None:  # of tetrahedra, where a hypothesis needs them
        other["padding_edge_m"] = max(mesh.padding_edge_m, 2.0 * max(edges))
    return mesh.model_copy(update=other)


def with_laws(mesh, materials):
    """Return a `MeshConfig` whose quadratic zones are linear ones, if a law of layers needs them.

    Their edges are shorter, so that a run takes about as long.
    """
    laws = {materials[part.material].law.name for part in mesh.layers}
    if not mesh.quadratic or laws <= {"elastic"}:
        return mesh
    return scaled(mesh, LINEAR_EDGE, quadratic=False)


def scaled(mesh, factor, **other):
    """Return a `MeshConfig` with a factor on all edges, and with other values."""

    def resized(part):
        sizes = {key: getattr(part, key, None) for key in ("edge_m", "padding_edge_m")}
        sizes = {key: factor * value for key, value in sizes.items() if value is not None}
        if getattr(part, "edges_per_wavelength", None) is not None:
            sizes["edges_per_wavelength"] = part.edges_per_wavelength / factor
        return part.model_copy(update=sizes)

    parts = {key: [resized(part) for part in getattr(mesh, key)] for key in SIZED}
    return resized(mesh).model_copy(update={**parts, **other})


def sizes_for_error(
    ground: Ground, mesh_built: Mesh, frequency: float | None, error: float
) -> MeshConfig | None:
    """Return the `MeshConfig` with another error than that of a ground, None if there is none.

    Hexahedra become smaller (or larger) by their rule; edges of tetrahedra are scaled, and zones
    of a file or a regular grid become quadratic where a smaller error is asked for.

    Parameters
    ----------
    ground : Ground
    mesh_built : Mesh
        Its mesh.
    frequency : float, Hz, or None
        That sizes this mesh.
    error : float
        Over that of its mesh.
    """
    mesh = ground.mesh
    if mesh_built.hexahedral:
        return mesh.model_copy(update={"accuracy": mesh.accuracy * error})
    if mesh.file is not None or mesh.grid_cells is not None:
        laws = {ground.materials[name].law.name for name in mesh_built.groups}
        usable = error < 1.0 and laws == {"elastic"} and not mesh.quadratic
        return mesh.model_copy(update={"quadratic": True}) if usable else None
    factor = edge_factor(error)
    finer = scaled(mesh, factor)
    if frequency is None:
        return finer
    return finer.model_copy(update={"frequency_hz": frequency / factor})


def edge_factor(error: float) -> float:
    """Return the factor on the edges of tetrahedra for another error."""
    return max(error, FINER_ERROR) ** (math.log(FINER_EDGE) / math.log(FINER_ERROR))


def obstacle_to_hexahedra(ground: Ground) -> str | None:
    """Return what stands in the way of hexahedra before the planes are looked at, or None."""
    mesh, sides, materials = ground.mesh, ground.boundaries, ground.materials
    if mesh.kind == "tetrahedra":
        return "mesh.kind asks for tetrahedra"
    if mesh.file is not None:
        return "the mesh is read from a file"
    if mesh.fractures:
        return "fractures of limited extent are cut into the blocks of tetrahedra"
    if mesh.grid_cells is not None:
        return "mesh.grid_cells divides the box into tetrahedra"
    if mesh.refinements:
        return "mesh.refinements grade tetrahedra"
    if np.ndim(ground.surface) == 3 and mesh.layers[0].follows_surface:
        return "the ground surface is given as triangles"
    for layer in (*mesh.layers, *mesh.fills):
        law = materials[layer.material].law.name if layer.material in materials else "elastic"
        if law != "elastic":
            return f"the ground {layer.material!r} follows the law {law!r}"
    if sides.free_field:
        return "free-field sides stand beside tetrahedra only"
    if ground.of_one_blast:
        return "a damaged zone has a material of its own"
    if ground.absorbing_layer is not None:
        return "the table [absorbing_layer] damps ground of tetrahedra"
    if ground.entered == "plane_wave":
        return "a plane wave enters ground of tetrahedra only"
    return _soft_soil(ground) if sides.viscous and not ground.entered else None


def _soft_soil(ground):
    """Return which ground would take energy from an absorbing layer, or None; theory.md (4.18)."""
    layers = [part.material for part in ground.mesh.layers]
    beside = [(part.material, layers[-1]) for part in ground.mesh.fills]
    for upper, lower in [*pairwise(layers), *beside]:
        soil, rock = ground.materials[upper], ground.materials[lower]
        if soil.cs < SOFT * rock.cs and not isinstance(soil.law, ConstantQ):
            return (
                f"{upper!r} has {soil.cs / rock.cs:.2g} of the S speed of {lower!r} and no quality "
                "factors, and an absorbing layer would feed its motion; give it qp and qs"
            )
    return None


def _hexahedra(ground, stations, geometry, wave, uncut, lines=None):
    """Return a mesh of hexahedra: the first as asked for, of builders and orders by work.

    Where a surface alone is not as asked for, narrower zones follow it. Tetrahedra are cut into
    hexahedra where no other serves, then once more with half the edges, if they may.
    """
    order, reasons = ground.mesh.order, {}
    lowest = stations.lowest_order
    orders = [each for each in ORDERS if each >= lowest]
    plain = mapped.is_plain(geometry)
    builders = {PLAIN: mapped.build_mapped} if plain else BUILDERS

    def meshes(order, builders, factor: float | tuple[float, float] = 1.0):
        sizes = np.multiply(factor, layer_sizes(ground, stations, order))
        for how, build in builders.items():
            try:
                with named_error("mesh"):
                    mesh = build(geometry, sizes, order, lines)
            except (MeshingError, NotMapped) as reason:
                reasons.setdefault(str(reason).removeprefix("mesh: "))
                continue
            work = _work(ground, stations, mesh)
            if np.isfinite(work):
                yield work, how, mesh

    if plain and not thin_layers(ground, stations):
        trials = [*meshes(order or ORDER, builders)]
    elif order:
        trials = [*meshes(order, builders)]
    else:
        trials = [each for first in orders for each in meshes(first, builders)]
        if trials:  # the work has one minimum over the orders
            best = min(trials, key=lambda each: each[0])[2].order
            trials += meshes(max(lowest, best + (1 if best == max(ORDERS) else -1)), builders)
    trials.sort(key=lambda each: each[0])
    rough = []  # orders of meshes whose surface alone is not as asked for
    along = {"top", *following(geometry)}
    narrow = (
        each
        for factor in NARROWER
        for first in rough[:1]
        for each in meshes(first, builders, (factor, 1.0))
    )
    cut = {CUT: subdivided.build_subdivided}
    factors = () if uncut else (1.0, 0.5)
    last = (each for factor in factors for each in meshes(order or ORDERS[0], cut, factor))
    for _, how, mesh in chain(trials, narrow, last):
        rows = as_built(mesh, geometry, wave, stations.positions)
        wrong = differences(rows)
        if all(row.good or row.name in along for row in rows):
            rough.append(mesh.order)
        if not wrong:
            why = reasons if how == CUT else ()
            return Meshed(mesh, _sentence(mesh, how, why), rows, how == CUT)
        reasons.setdefault(f"hexahedra {how} would be other ground than asked for: {wrong}")
    raise NotMapped("; ".join(reasons) or "its hexahedra would be inverted")


def _sentence(mesh, how, reasons):
    """Return what hexahedra a mesh has, and why they are not in a grid."""
    ends = "no absorbing layer" if mesh.layer is None else "an absorbing layer"
    why = f", because {'; '.join(reasons)}" if reasons else ""
    longest = zone_edge_lengths(mesh).max()
    return (
        f"hexahedra of order {mesh.order} {how}, edges up to {longest:.3g} m, "
        f"{ends}: {len(mesh.zones)} zones{why}"
    )


def _work(ground, stations, mesh):
    """Return the work of a run: nodes over the step, which line-implicit layers do not set."""
    work = explicit_work(mesh)
    if not np.isfinite(work) or not thin_layers(ground, stations):
        return work
    whole = whole_layers(ground, mesh.groups)
    return work_of_ground(mesh, ground.materials, lambda groups: whole[groups].all())


def whole_layers(ground: Ground, names: Sequence[str]) -> np.ndarray:
    """Return which grounds no joint or fault cuts, (n,) bool."""
    cut = {name for part in ground.mesh.joint_sets for name in part.regions or names}
    cut |= set(names) if ground.mesh.faults else set()
    return np.array([name not in cut for name in names])


def thin_layers(ground: Ground, stations: Stations) -> dict[str, float]:
    """Return the materials of thin layers at the top, with their share of the edges beneath.

    Layers from the top on whose edges no key says, which S waves of the highest frequency pass
    within a period in all, and in which no source lies: `share_of_edge`.
    """
    mesh, top, periods, height, thin = ground.mesh, ground.frequency, 0.0, 0.0, []
    names = [part.material for part in mesh.layers]
    if top is None or not mesh.layers or mesh.file is not None:
        return {}
    following = mesh.layers[0].follows_surface
    surface, highest, shares = mesh.origin_m[2] + mesh.size_m[2], 0.0, {}
    source = surface - stations.highest_source
    if following:
        source = stations.least_depth(Surface(ground.geometry))
    elif ground.surface is not None:
        highest = max(0.0, float(np.asarray(ground.surface)[..., 2].max()) - surface)
    relief = highest
    for part in mesh.layers[:-1]:
        rock = ground.materials[part.material]
        level = part.follows_surface != following
        if part.thickness_m is None or level or mean_edge(mesh, part, rock) is not None:
            break
        height += part.thickness_m
        periods += top * (part.thickness_m + relief) / rock.cs
        grounds = [ground.materials[name] for name in (*thin, part.material)]
        beyond = stations.clearance > reach_of_trapped_waves(height + highest, grounds)
        relief, share = 0.0, share_of_edge(periods, beyond)
        if not share or source < height or names.count(part.material) > 1:
            break
        thin.append(part.material)
        shares = dict.fromkeys(thin, share)
    return shares | _thin_fills(ground, stations)


def _thin_fills(ground, stations):
    """Return the materials of thin fills at the top, as `thin_layers`."""
    shares, geometry = {}, ground.geometry
    benches = Benches(geometry, np.inf) if geometry.benches and geometry.fills else None
    for part in geometry.fills:
        corners = np.array(np.meshgrid(*part.box[:2])).reshape(2, -1).T
        top = geometry.box[2, 1] if benches is None else benches.ground(corners).max()
        if part.box[2, 1] < top:
            continue
        rock, height = ground.materials[part.name], float(top - part.box[2, 0])
        beyond = stations.clearance > reach_of_trapped_waves(height, [rock])
        share = share_of_edge(ground.frequency * height / rock.cs, beyond)
        if share and not stations.has_source_in(part.box):
            shares[part.name] = share
    return shares


def layer_sizes(ground: Ground, stations: Stations, order: int) -> np.ndarray:
    """Return width and height (n, 2) in m of the hexahedra of each layer, then of each fill.

    Thin ones are as wide as `Model.highest_frequency` asks for, too.
    """
    fills = [LayerConfig(material=part.material) for part in ground.mesh.fills]
    parts, thin = [*ground.mesh.layers, *fills], thin_layers(ground, stations)
    high = np.array([_size(ground, part, order, stations.reach) for part in parts])
    if not thin:
        return np.column_stack([high, high])
    share = np.array([thin.get(part.material, 0.0) for part in parts])
    speeds = np.array([ground.materials[part.material].cs for part in parts])
    known = order * speeds / (HEX_NODES * ground.frequency)
    across = np.minimum(high, known)[share == 0.0].min()
    return np.column_stack([np.maximum(high, share * across), high])


def _size(ground, part, order, reach):
    """Return the largest edge in m of the hexahedra of a layer."""
    mesh, material = ground.mesh, ground.materials[part.material]
    edge = mean_edge(mesh, part, material)
    carried = None if edge is None else material.cs / (TETRAHEDRA[mesh.quadratic] * edge)
    top = float(carried or ground.frequency or 0.0)
    nodes = nodes_per_wavelength(order, mesh.accuracy, reach * top / material.cs)
    return order * material.cs / (nodes * top)
