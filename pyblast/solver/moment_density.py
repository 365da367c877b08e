"""Moment density: nodal forces of moment tensors over a sphere in place of a point."""

from dataclasses import dataclass
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np

from ..mesh import hexahedra, tetrahedra
from ..mesh.faces import zone_of_face
from ..mesh.mesh import Mesh, locate_in_zones, zone_edge_lengths
from ..mesh.nodes import Nodes
from ..mesh.spectral_nodes import SpectralNodes
from ..model.model import Model
from ..model.source import Column, Hole, MomentTensor, PointForce, TimeFunction

MOST_SPHERES = 500  # holes and points of columns
_AVERAGES: WeakKeyDictionary = WeakKeyDictionary()  # of spheres, by mesh
# Radius, where nothing is near, and least radius, beyond nearer faces the density is cut off: over
# the shortest edge of hexahedra, over the mean edge of quadratic and linear tetrahedra.
RADII = {"hexahedra": (0.6, 0.1), "quadratic": (0.8, 0.4), "linear": (1.0, 1.0)}
# Largest error measured at distances over the edge, of spheres and of those that a near surface
# clips below 0.4 edges, off or on faces of elements: python -m verification.near_source. Beyond the
# last, of 1 %, a bound that falls as the square of the distance: docs/decisions.md.
SMALLEST = 0.1  # the same of a radius that is given
ERRORS = {
    "hexahedra": ((0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 1.0, 1.25, 1.5),
        (1.0, 0.93, 0.6, 0.2, 0.06, 0.05, 0.03, 0.015, 0.01)),
    "hexahedra, column": ((0.0, 0.3, 0.45, 0.6, 0.76, 0.98, 1.21, 1.5),
        (1.0, 0.62, 0.45, 0.12, 0.12, 0.05, 0.02, 0.01)),
    "hexahedra, shear": ((0.0, 0.31, 0.45, 0.76, 0.98, 1.21, 1.5),
        (1.3, 1.3, 1.0, 0.49, 0.19, 0.05, 0.01)),
    "hexahedra, point": ((0.0, 0.14, 0.33, 0.47, 0.62, 0.77, 0.98, 1.25, 1.5),
        (0.6, 0.5, 0.5, 0.75, 0.75, 0.2, 0.04, 0.03, 0.01)),
    "hexahedra, on a face": ((0.0, 0.14, 0.33, 0.47, 0.77, 0.99, 1.22, 1.5),
        (0.6, 0.5, 0.5, 0.65, 0.95, 0.53, 0.05, 0.01)),
    "hexahedra, force": ((0.0, 0.08, 0.45, 0.6, 0.75, 0.97), (1.0, 0.52, 0.28, 0.085, 0.02, 0.01)),
    "hexahedra, force on a face": ((0.0, 0.08, 0.45, 0.75, 0.97, 1.2, 1.42),
        (1.0, 0.95, 0.95, 0.95, 0.45, 0.015, 0.01)),
    "quadratic": ((0.0, 0.3, 0.6, 0.8, 1.1, 1.6, 2.5), (1.0, 0.88, 0.38, 0.15, 0.06, 0.04, 0.01)),
    "quadratic, point": ((0.0, 0.5, 1.0, 1.6, 2.5), (1.0, 0.8, 0.2, 0.06, 0.01)),
    "linear": ((0.0, 0.9, 1.8, 2.7, 3.6, 5.0), (1.0, 0.4, 0.2, 0.1, 0.05, 0.01)),
}  # fmt: skip
MOST_JUDGED = 20  # points of sources of which the widest sphere is taken
CLIPPED = 0.4  # radius over the edge, below which elements resolve it no better than a point
WANTED = 0.05  # error for which edges are shortened
# Distance over edge for it, of explosions whose sphere nothing clips and of any source.
FOR_FIVE_PER_CENT, ANY_FOR_FIVE = 0.75, 1.25
ISOTROPIC = "hexahedra", "hexahedra, point", "hexahedra, on a face"
ON_FACE = 0.9  # reference coordinate from which on a source counts as on a face
SMALL, TRUSTED = 0.01, 0.2  # errors that are not named, and that count as right
FEWEST_POINTS, POINTS_IN_RADIUS = 4, 4  # of a column, where it does not say how many
SHELLS, RINGS, MERIDIANS = 8, 8, 16  # of the quadrature over a sphere
PASSED, STOPPED = 2.6, 5.2  # omega R/cp up to which, and from which on not, F is divided by
RINGING = 8.0  # R/cp, after which the inverse of F has died away
PLANE = 1e8  # condition of the moments of positions that lie in a plane
INSIDE = 1e-9  # reference coordinates beyond a zone that still count as inside


def source_radius(
    nodes: Nodes | SpectralNodes, zone: int, position: np.ndarray, given: float | None = None
) -> float:
    """Return the radius in m of the sphere over which a moment at a position is distributed.

    Parameters
    ----------
    nodes : Nodes or SpectralNodes
        Of a mesh that is split along its joints.
    zone : int
        That holds the position.
    position : (3,) float64, m
    given : float, m, optional
        In place of 0.6 of the shortest edge of hexahedra, 0.8 or 1 of the mean edge of quadratic
        or linear tetrahedra.

    Returns
    -------
    float, m
        At most the distance to free surfaces, joints and other ground. At least 0.1 of the edge of
        hexahedra, 0.4 or 1 of the mean edge of quadratic or linear tetrahedra; a given one may be
        as small as 0.1.
    """
    mesh = nodes.mesh
    edge = edge_at(mesh, zone)
    usual, least = RADII[element_kind(nodes)]
    if given is not None:
        linear = not (mesh.hexahedral or nodes.quadratic)  # whose gradients are those of centroids
        usual, least = given / edge, max(SMALLEST, min(given / edge, least) if linear else 0.0)
    radius = usual * edge
    return float(max(min(radius, clearance(mesh, position, radius)), least * edge))


def element_kind(nodes: Nodes | SpectralNodes) -> str:
    """Return the kind of elements by which radii and errors are listed."""
    if nodes.mesh.hexahedral:
        return "hexahedra"
    return "quadratic" if nodes.quadratic else "linear"


def source_radii(model: Model) -> list[float] | None:
    """Return the least and the greatest radius in m of the holes of a model that are no columns."""
    holes = [source for source in model.sources if isinstance(source, Hole)]
    if not holes:
        return None
    zones, _ = locate_in_zones(model.mesh, [hole.position for hole in holes])
    radii = [
        source_radius(model.nodes, zone, hole.position, hole.spread)
        for zone, hole in zip(zones, holes, strict=True)
    ]
    return [min(radii), max(radii)]


@dataclass(frozen=True)
class NearReceiver:
    """Receiver so near to a source that elements do not resolve the motion there.

    Parameters
    ----------
    receiver : str
    source : int
        Number of the source in the model.
    distance : float, m
    edge : float, m
        Longest edge of hexahedra at the source, mean edge of tetrahedra.
    error : float
        To expect, relative to the motion: what was measured in the worst of 26 directions.
    edge_needed : float, m
        For an error of 1 %, by the table of its kind of source.
    """

    receiver: str
    source: int
    distance: float
    edge: float
    error: float
    edge_needed: float

    @property
    def named(self) -> bool:
        """Whether the error to expect is above `SMALL`."""
        return self.error > SMALL

    @property
    def trusted(self) -> bool:
        """Whether the error to expect is at most `TRUSTED`."""
        return self.error <= TRUSTED

    @property
    def work(self) -> float:
        """Factor on the work of a run with edges of ``edge_needed`` throughout."""
        return (self.edge / self.edge_needed) ** 4


def near_sources(model: Model, resolved: tuple[int, ...] = ()) -> tuple[NearReceiver, ...]:
    """Return the receivers where the distance to a source makes an error above 1 %.

    Parameters
    ----------
    model : Model
    resolved : tuple of int
        Numbers of sources that make none.

    Notes
    -----
    Inside of the sphere of a source the motion is too small, beside it the elements do not carry
    its near field: docs/decisions.md, "Moments over a sphere". By the nearest source each.
    """
    return tuple(row for row in beside_sources(model, resolved) if row.named)


def beside_sources(model: Model, resolved: tuple[int, ...] = ()) -> tuple[NearReceiver, ...]:
    """Return what `near_sources` says of all receivers, whatever their error."""
    points, numbers = _source_points(model, resolved)
    if not len(points) or not model.receivers:
        return ()
    mesh, rows = model.mesh, []
    zones, local = locate_in_zones(mesh, points)
    edges = zone_edge_lengths(mesh)[zones]
    edges = edges.max(axis=1) if mesh.hexahedral else edges.mean(axis=1)
    for receiver in model.receivers:
        away = np.linalg.norm(points - np.asarray(receiver.position, dtype=float), axis=1)
        at = int(np.argmin(away / edges))
        source = model.sources[numbers[at]]
        kind = _kind_of_error(model.nodes, source, zones[at], points[at], edges[at], local[at])
        last, ratio = ERRORS[kind][0][-1], float(away[at] / edges[at])
        error = float(np.interp(ratio, *ERRORS[kind])) * min(1.0, (last / max(ratio, last)) ** 2)
        row = receiver.name, numbers[at], float(away[at]), float(edges[at]), error
        rows.append(NearReceiver(*row, float(away[at]) / last))
    return tuple(rows)


def sheared_width(model: Model, resolved: tuple[int, ...] = ()) -> float:
    """Return R/cs in s of the widest sphere whose source radiates S waves by itself; 0 without.

    Of up to 20 points of sources.

    Parameters
    ----------
    model : Model
    resolved : tuple of int
        Numbers of sources that have no sphere.
    """
    points, numbers = _source_points(model, resolved)
    sheared = [n for n, number in enumerate(numbers) if _is_sheared(model.sources[number])]
    if not sheared:
        return 0.0
    sheared = sheared[:: -(-len(sheared) // MOST_JUDGED)]
    zones, cs = locate_in_zones(model.mesh, points[sheared])[0], model.zone_values("cs")
    spread = [getattr(model.sources[numbers[n]], "spread", None) for n in sheared]
    return max(
        source_radius(model.nodes, zone, point, given) / float(cs[zone])
        for zone, point, given in zip(zones, points[sheared], spread, strict=True)
    )


def _is_sheared(source):
    """Tell whether a source is a column, or a tensor that is not isotropic."""
    if not isinstance(source, MomentTensor):
        return isinstance(source, Column)
    rest = source.tensor - np.trace(source.tensor) / 3.0 * np.eye(3)
    return bool(np.abs(rest).max() > 0.1 * np.abs(source.tensor).max())


def edges_near(model: Model, resolved: tuple[int, ...] = ()) -> dict[int, np.ndarray]:
    """Return the edges (n,) in m of hexahedra by source, for errors of 5 % at n receivers near it.

    Of sources and receivers where the error is larger, without `resolved` sources as in
    `near_sources`: 1.33 times the distance of explosions if that is 2.5 times their distance from
    the end of their ground at most, else 0.8 times.
    """
    points, numbers = _source_points(model, resolved)
    places = np.array([receiver.position for receiver in model.receivers], dtype=float)
    if not len(points) or not len(places):
        return {}
    zones, local = locate_in_zones(model.mesh, points)
    edges = zone_edge_lengths(model.mesh)[zones].max(axis=1)
    wanted = {}
    for point, number, zone, edge, at in zip(points, numbers, zones, edges, local, strict=True):
        kind = _kind_of_error(model.nodes, model.sources[number], zone, point, edge, at)
        away = np.linalg.norm(places - point, axis=1)
        away = away[np.interp(away / edge, *ERRORS[kind]) > WANTED]
        if not len(away):
            continue
        needed = away / ANY_FOR_FIVE
        if kind in ISOTROPIC:
            clear = clearance(model.mesh, point, float(away.max())) / CLIPPED
            needed = np.maximum(needed, np.minimum(away / FOR_FIVE_PER_CENT, clear))
        wanted[number] = np.append(wanted.get(number, np.zeros(0)), needed)
    return wanted


def _kind_of_error(nodes, source, zone, point, edge, local):
    """Return the name of a table of errors, of a source by the radius of its sphere."""
    kind = element_kind(nodes)
    on_face = kind == "hexahedra" and np.abs(local).max() > ON_FACE
    if isinstance(source, PointForce):
        if kind != "hexahedra":
            return kind
        return "hexahedra, force on a face" if on_face else "hexahedra, force"
    if kind == "linear":
        return kind
    if source_radius(nodes, zone, point, getattr(source, "spread", None)) < CLIPPED * edge:
        return f"{kind}, on a face" if on_face else f"{kind}, point"
    if kind == "hexahedra" and isinstance(source, Column):
        return "hexahedra, column"
    if kind == "hexahedra" and _is_sheared(source):
        return "hexahedra, shear"
    return kind


def _source_points(model, resolved):
    """Return the positions (n, 3) of the points of sources, and the number of their source."""
    points, numbers = [], []
    for number, source in enumerate(model.sources):
        if number in resolved:
            continue
        if isinstance(source, Column):
            own = source.points(FEWEST_POINTS)[0]
        elif isinstance(source, (Hole, MomentTensor, PointForce)):
            own = np.reshape(np.asarray(source.position, dtype=float), (1, 3))
        else:
            continue
        points.append(own)
        numbers += [number] * len(own)
    return np.concatenate([np.empty((0, 3)), *points]), numbers


def edge_at(mesh: Mesh, zone: int) -> float:
    """Return the edge in m that measures a zone: shortest of hexahedra, mean of tetrahedra."""
    element = hexahedra if mesh.hexahedral else tetrahedra
    edges = element.edge_lengths(mesh.points, mesh.zones[[zone]])
    return float(edges.min() if mesh.hexahedral else edges.mean())


def clearance(mesh: Mesh, position: np.ndarray, within: float) -> float:
    """Return the distance in m of a position to the end of its ground, at most ``within``.

    Its ground ends at outer faces, joints, faces between groups and the absorbing layer.
    """
    corners = mesh.points[mesh.walls[1]]
    centre = corners.mean(axis=1)
    reach = 1.5 * np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1, initial=0.0)
    near = np.linalg.norm(centre - position, axis=1) - reach < within
    triangles = _triangles(mesh, mesh.walls[0][near], corners[near])
    distance = _distances(triangles, position).min(initial=within)
    if mesh.layer is not None:
        along = position @ np.array(mesh.layer.frame, dtype=float).T
        inner = np.array(mesh.layer.inner, dtype=float)
        distance = min(distance, np.abs(inner - along[:, None]).min())
    return float(distance)


def _triangles(mesh, faces, corners):
    """Return the triangles (n, 3, 3) in m of faces (n,) with corners (n, 3 or 4, 3)."""
    if not mesh.hexahedral or not len(faces):
        return corners[:, :3]
    zone, local = zone_of_face(mesh.zones, faces)
    grid = mesh.node_places[zone[:, None, None], hexahedra.face_nodes(mesh.order)[local]]
    a, b, c, d = grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, 1:, 1:], grid[:, :-1, 1:]
    halves = [np.stack(three, axis=3) for three in ((a, b, c), (a, c, d))]
    return np.concatenate([half.reshape(-1, 3, 3) for half in halves])


def _distances(triangles, position):
    """Return the distance (n,) in m of a position to triangles (n, 3, 3)."""
    corner, ends = triangles - position, np.roll(triangles, -1, axis=1) - position
    side = ends - corner
    along = -np.einsum("tkx,tkx->tk", corner, side)
    share = np.clip(along / np.maximum(np.einsum("tkx,tkx->tk", side, side), 1e-300), 0.0, 1.0)
    edge = np.linalg.norm(corner + share[..., None] * side, axis=2).min(axis=1)
    normal = np.cross(side[:, 0], side[:, 1])
    above = (np.cross(corner, ends) @ normal[:, :, None])[..., 0].min(axis=1) >= 0.0
    height = np.abs(np.einsum("tx,tx->t", corner[:, 0], normal))
    return np.where(above, height / np.maximum(np.linalg.norm(normal, axis=1), 1e-300), edge)


@cache
def sphere_rule(flat: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, 3) in the unit sphere and weights (n,) of a density; their sum is 1.

    The density is ``(1 - r^2)^2``; flat: times ``1 - q r^2``, of second moment zero, so that the
    static field outside is that of a point.
    """
    radius, share = np.polynomial.legendre.leggauss(SHELLS)
    radius, share = 0.5 * (radius + 1.0), 0.5 * share
    density = (1.0 - radius**2) ** 2
    if flat:
        second, fourth = (share * density * radius**power for power in (4, 6))
        density = density * (1.0 - second.sum() / fourth.sum() * radius**2)
    share = share * radius**2 * density
    height, ring = np.polynomial.legendre.leggauss(RINGS)
    angle = 2.0 * np.pi * (np.arange(MERIDIANS) + 0.5) / MERIDIANS
    r, z, phi = (a.ravel() for a in np.meshgrid(radius, height, angle, indexing="ij"))
    across = r * np.sqrt(1.0 - z**2)
    weight = np.einsum("r,z,p->rzp", share / share.sum(), 0.5 * ring, np.full(MERIDIANS, 1.0))
    positions = np.column_stack([across * np.cos(phi), across * np.sin(phi), r * z])
    return positions, weight.ravel() / MERIDIANS


def moment_forces(
    nodes: Nodes | SpectralNodes,
    zone: int,
    position: np.ndarray,
    tensor: np.ndarray,
    radius: float,
    flat: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodal forces ``M grad N_a``, averaged over a sphere, of a moment tensor.

    Parameters
    ----------
    nodes : Nodes or SpectralNodes
    zone : int
        That holds the position.
    position : (3,) float64, m
    tensor : (3, 3) float64
    radius : float, m
        `source_radius`.
    flat : bool
        Density of second moment zero, see `sphere_rule`.

    Returns
    -------
    nodes : (n,) int
    forces : (n, 3) float64
        Per m; without sum and torque. Only nodes of the zone's own ground.

    Notes
    -----
    theory.md (5.15), (5.16). Where the sphere is cut off by the end of its ground, the weights are
    corrected to a sum of one and a first moment at the position.
    """
    used, gradients = _averaged_slopes(nodes, zone, position, radius, flat)
    return nodes.zone_nodes[used].ravel(), (gradients @ tensor).reshape(-1, 3)


def _averaged_slopes(nodes, *sphere):
    """Return zones (n,) and the averages over a sphere of the slopes of their shape functions.

    Those of `MOST_SPHERES` are kept beside the mesh, which the models of a fit share.
    """
    known = _AVERAGES.setdefault(nodes.mesh, {})
    zone, position, radius, flat = sphere
    key = nodes.quadratic, int(zone), *map(float, position), float(radius), flat
    if key not in known:
        if len(known) >= MOST_SPHERES:
            known.clear()
        known[key] = _average(nodes, *sphere)
    return known[key]


def _average(nodes, zone, position, radius, flat):
    """Return what `_averaged_slopes` keeps."""
    mesh, position = nodes.mesh, np.asarray(position, dtype=float)
    offsets, weight = sphere_rule(flat)
    own = _own_ground(mesh, zone, position, radius)
    zones, local, inside = _inside(mesh, own, position, position + radius * offsets)
    offsets, weight = offsets[inside], weight[inside]
    smooth = sphere_rule(False)[1][inside]
    if not (mesh.hexahedral or nodes.quadratic):  # their gradients are those of their centroids
        offsets = (mesh.points[mesh.zones[zones]].mean(axis=1) - position) / radius
        inside = np.zeros(1, dtype=bool)
    if not inside.all():
        weight = _corrected(weight, smooth, offsets)
    each = weight[:, None, None] * nodes.slopes(zones, local)
    order = np.argsort(zones, kind="stable")
    used, first = np.unique(zones[order], return_index=True)
    return used, np.add.reduceat(each[order], first)


def _corrected(weight, smooth, offsets):
    """Return weights (n,) of sum one and first moment zero about offsets (n, 3) from a centre.

    Corrected by a linear function times smooth weights (n,); where the offsets lie in a plane, to
    a sum of one alone.
    """
    basis = np.column_stack([np.ones(len(offsets)), offsets])
    moments = basis.T @ (smooth[:, None] * basis)
    if np.linalg.cond(moments) > PLANE:
        return weight + (1.0 - weight.sum()) * smooth / smooth.sum()
    lacking = np.array([1.0, 0.0, 0.0, 0.0]) - weight @ basis
    return weight + smooth * (basis @ np.linalg.solve(moments, lacking))


def _inside(mesh, own, position, points):
    """Return zone and local coordinates of the points (n, 3) inside of zones, nearest zone first.

    The third array (n,) tells which points these are.
    """
    zone, local = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 4))
    inside = np.zeros(len(points), dtype=bool)
    low, high = _limits(mesh, own)
    for near in np.argsort(np.abs(0.5 * (low + high) - position).max(axis=1), kind="stable"):
        margin = INSIDE * (high[near] - low[near])
        boxed = (points >= low[near] - margin) & (points <= high[near] + margin)
        at = np.flatnonzero(boxed.all(axis=1) & ~inside)
        if not len(at):
            continue
        coordinates, within = _coordinates(mesh, own[near], points[at])
        at, coordinates = at[within], coordinates[within]
        zone[at], local[at, : coordinates.shape[1]], inside[at] = own[near], coordinates, True
    width = 3 if mesh.hexahedral else 4
    return zone[inside], local[inside, :width], inside


def _own_ground(mesh, zone, position, radius):
    """Return the zones that a sphere meets, of the group of a zone and on its side of joints."""
    alike = np.flatnonzero(mesh.zone_group == mesh.zone_group[zone])
    low, high = _limits(mesh, alike)
    beside = np.maximum(np.maximum(low - position, position - high), 0.0)
    near = np.union1d(alike[np.linalg.norm(beside, axis=1) <= radius], zone)
    part = mesh.blocks(near)
    return near[part == part[np.searchsorted(near, zone)]]


def _limits(mesh, zones):
    """Return the lowest and highest coordinates (n, 3) in m of zones (n,)."""
    if mesh.hexahedral:
        return mesh.zone_limits[0][zones], mesh.zone_limits[1][zones]
    corners = mesh.points[mesh.zones[zones]]
    return corners.min(axis=1), corners.max(axis=1)


def _coordinates(mesh, zone, points):
    """Return local coordinates of points (n, 3) in a zone, and which of them it holds."""
    if not mesh.hexahedral:
        weight = tetrahedra.barycentric(mesh.points[mesh.zones[zone]][None], points)
        within = weight.min(axis=1) >= -INSIDE
        return np.maximum(weight, 0.0), within
    order, places = 1, mesh.points[mesh.zones[zone]]
    if mesh.places is not None:
        order, places = mesh.order, mesh.places[zone]
    places = np.broadcast_to(places, (len(points), *places.shape))
    local, excess = hexahedra.reference_coordinates(places, order, points)
    return np.clip(local, -1.0, 1.0), excess <= INSIDE


def response(omega_r: np.ndarray) -> np.ndarray:
    """Return ``F(x) = 105 j3(x)/x^3``, what the density leaves of a wave with x = omega R/c."""
    x = np.maximum(np.abs(omega_r), 0.1)
    first = (15.0 / x**3 - 6.0 / x) * np.sin(x) / x - (15.0 / x**2 - 1.0) * np.cos(x) / x
    series = 1.0 - omega_r**2 / 18.0 + omega_r**4 / 792.0
    return np.where(np.abs(omega_r) > 0.1, 105.0 * first / x**3, series)


def flat_response(omega_r: np.ndarray) -> np.ndarray:
    """Return what the density of second moment zero leaves of a wave with x = omega R/c."""
    offsets, weight = sphere_rule(True)
    radius, first = np.unique(np.linalg.norm(offsets, axis=1).round(12), return_inverse=True)
    share = np.bincount(first, weight)
    return np.sinc(np.multiply.outer(omega_r, radius) / np.pi) @ share


def deconvolved(moment: TimeFunction, width: float) -> TimeFunction:
    """Divide an isotropic moment by the response of its sphere of radius R for P waves.

    Parameters
    ----------
    moment : TimeFunction
        Held at its end.
    width : float, s
        R/cp; 0: none.

    Returns
    -------
    TimeFunction
        Begins earlier by some R/cp, as the sphere is nearer to what it moves than its centre.

    Notes
    -----
    Outside of the sphere the motion is then that of a point, reflections included: theory.md
    (5.16). Beyond omega R/cp of 2.6 the division is tapered off, to none at 5.2, where waves are
    too short for the elements that R is measured by.
    """
    if width == 0.0:
        return moment
    quiet = 4 + int(np.ceil(RINGING * width / moment.dt))
    steps = np.pad(np.diff(moment.values), quiet)
    size = 2 * len(steps)
    x = 2.0 * np.pi * np.fft.rfftfreq(size, moment.dt) * width
    share = 0.5 + 0.5 * np.cos(np.pi * np.clip((x - PASSED) / (STOPPED - PASSED), 0.0, 1.0))
    gain = 1.0 + share * (1.0 / np.where(share > 0.0, response(x), 1.0) - 1.0)
    steps = np.fft.irfft(np.fft.rfft(steps, size) * gain, size)[: len(steps)]
    values = moment.values[0] + np.append(0.0, np.cumsum(steps))
    return TimeFunction(values, moment.dt, moment.start - quiet * moment.dt, held=True)
