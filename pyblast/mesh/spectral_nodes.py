"""Nodes of spectral hexahedra: numbering across zones and joints, lumping, shape functions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from . import hexahedra
from .faces import face_keys, face_table, pair_faces, zone_faces, zone_of_face
from .grid import kuhn_zones
from .mesh import Contacts, Mesh, graph_components, merge_pairs, surface_faces
from .nodes import morton_keys, stored


@dataclass(frozen=True, eq=False)
class SpectralNodes:
    """Gauss-Lobatto-Legendre nodes of hexahedra, with lumping, areas and shape functions.

    Zones share the nodes of a face that is not a joint; each side of a joint has its own.

    Parameters
    ----------
    mesh : Mesh
    points : (n_nodes, 3) float64, m
    zone_nodes : (n_zones, (order + 1)^3) int32
    surfaces : dict of str to (n_faces, (order + 1)^2) int32
        Of joints, the minus side.
    contacts : Contacts or None
        Pairs of nodes.
    """

    mesh: Mesh
    points: np.ndarray
    zone_nodes: np.ndarray
    surfaces: dict[str, np.ndarray]
    contacts: Contacts | None

    quadratic = True  # or higher: sources act at points, pressures at nodes

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Derivatives dx/d(reference) (n_zones, (order + 1)^3, 3, 3) at the nodes; m."""
        return hexahedra.jacobians(self.mesh.node_places, self.mesh.order)

    @cached_property
    def volumes(self) -> np.ndarray:
        """Volumes (n_zones, (order + 1)^3) in m3 that the quadrature gives the nodes of zones."""
        return np.linalg.det(self.jacobian) * hexahedra.node_weights(self.mesh.order)

    def sums(self, values: np.ndarray) -> np.ndarray:
        """Distribute zone values (n_zones,) to the nodes as lumped mass, (n_nodes,)."""
        whole = self.volumes.sum(axis=1, keepdims=True)
        parts = np.asarray(values)[:, None] * (self.volumes / whole)
        return np.bincount(self.zone_nodes.ravel(), parts.ravel(), minlength=len(self.points))

    def surface_areas(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the tributary areas of the nodes of a surface.

        Returns
        -------
        nodes : (n,) int32
            Face by face.
        area : (n,) float64, m2
        normal : (n, 3) float64
            Unit, out of the zone behind.
        """
        nodes, vectors = self.face_areas(surface_faces(self.mesh, name))
        area = np.linalg.norm(vectors, axis=-1)
        return nodes.ravel(), area.ravel(), (vectors / area[..., None]).reshape(-1, 3)

    def face_areas(self, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return nodes (n, (order + 1)^2) and outward area vectors (n, ..., 3) in m2 of faces."""
        order = self.mesh.order
        zone, local = zone_of_face(self.mesh.zones, faces)
        at = hexahedra.face_nodes(order).reshape(hexahedra.N_FACES, -1)[local]
        jacobian = self.jacobian[zone[:, None], at]
        axis, upper = np.divmod(local, 2)
        # The face of a reference axis has the area det(J) J^-T of that axis.
        cofactor = np.linalg.det(jacobian)[..., None, None] * np.linalg.inv(jacobian)
        row = np.take_along_axis(cofactor, axis[:, None, None, None], axis=2)[:, :, 0]
        _, w = hexahedra.lobatto(order)
        weight = np.outer(w, w).ravel() * np.where(upper, 1.0, -1.0)[:, None]
        return self.zone_nodes[zone[:, None], at], row * weight[..., None]

    def stress_forces(self, stress: np.ndarray, zones: np.ndarray | slice = np.s_[:]) -> np.ndarray:
        """Return the nodal forces (n_zones, n, 3) in N of stresses (n_zones, n, 3, 3) at nodes."""
        n, slope = self.mesh.order + 1, hexahedra.slopes_on_line(self.mesh.order)
        flux = np.einsum("zaij,zarj->zair", stress, np.linalg.inv(self.jacobian[zones]))
        flux = (self.volumes[zones][..., None, None] * flux).reshape(-1, n, n, n, 3, 3)
        force = np.einsum("qi,zkjqc->zkjic", slope, flux[..., 0])
        force += np.einsum("qj,zkqic->zkjic", slope, flux[..., 1])
        force += np.einsum("qk,zqjic->zkjic", slope, flux[..., 2])
        return -force.reshape(len(stress), n**3, 3)

    def shapes(self, places: np.ndarray) -> np.ndarray:
        """Return the shape functions (n, (order + 1)^3) at reference coordinates (n, 3)."""
        return hexahedra.shape_values(self.mesh.order, places)

    def slopes(self, zone: np.ndarray, places: np.ndarray) -> np.ndarray:
        """Return the gradients (n, (order + 1)^3, 3) in 1/m of shape functions at given places."""
        by_reference = hexahedra.shape_slopes(self.mesh.order, places)
        jacobian = np.einsum("nac,nar->ncr", self.mesh.node_places[zone], by_reference)
        return np.einsum("nar,nrc->nac", by_reference, np.linalg.inv(jacobian))


@dataclass(frozen=True, eq=False)
class View:
    """Tetrahedra that show a mesh in figures and files: of hexahedra, six in each by its corners.

    Parameters
    ----------
    mesh : Mesh
    node : (n_points,) int64
        Node of the model at each point.
    zone : (n_zones,) int64
        Zone of the model that each tetrahedron lies in.
    """

    mesh: Mesh
    node: np.ndarray
    zone: np.ndarray


def view(mesh: Mesh, zone_nodes: np.ndarray) -> View:
    """Return the tetrahedra that show a mesh whose zones have nodes (n_zones, n)."""
    if not mesh.hexahedral:
        return View(mesh, np.arange(len(mesh.points)), np.arange(len(mesh.zones)))
    zones = mesh.zones[:, kuhn_zones()].reshape(-1, 4)
    surfaces = {
        name: np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
        for name, faces in mesh.surfaces.items()
    }
    line = np.array([0, mesh.order])
    n = mesh.order + 1
    local = (line[:, None, None] * n + line[:, None]) * n + line
    node = np.empty(len(mesh.points), dtype=np.int64)
    node[mesh.zones] = zone_nodes[:, local.ravel()]
    group = mesh.zone_group.repeat(6)
    shown = Mesh(mesh.points, zones, group, mesh.groups, surfaces, mesh.contacts)
    return View(shown, node, np.arange(len(mesh.zones)).repeat(6))


def spectral_nodes(mesh: Mesh) -> SpectralNodes:
    """Return the nodes of a mesh of hexahedra, numbered along a space-filling curve.

    Parameters
    ----------
    mesh : Mesh
        Split or without joints.
    """
    points, zone_nodes, surfaces, contacts = _numbered(mesh)
    return SpectralNodes(mesh, points, zone_nodes, surfaces, contacts)


@stored
def _numbered(mesh: Mesh) -> tuple:
    """Return points, nodes of zones, nodes of surfaces and contacts."""
    first, second, joint, names = _shared_faces(mesh)
    grids = hexahedra.face_nodes(mesh.order)
    size = (mesh.order + 1) ** 3
    label = _corner_labels(mesh)
    sides = [_in_common_order(mesh, label, faces, grids) for faces in (first, second)]
    welded = joint < 0
    ends = [side[welded].ravel() for side in sides]
    count, number = graph_components(ends[0], ends[1], size * len(mesh.zones))
    places = mesh.node_places.reshape(-1, 3)
    points = np.empty((count, 3))
    points[number[::-1]] = places[::-1]  # the first zone of a node places it
    centres = mesh.node_places.mean(axis=1)
    inside = np.zeros(centres.shape) if mesh.layer is None else mesh.layer.depths(centres)
    along = np.lexsort((morton_keys(centres), mesh.zone_group, (inside > 0.0) @ [1, 2, 4]))
    met, first_met = np.unique(number.reshape(-1, size)[along].ravel(), return_index=True)
    order = met[np.argsort(first_met)]
    rank = np.empty(count, dtype=np.int32)
    rank[order] = np.arange(count, dtype=np.int32)
    zone_nodes = rank[number].reshape(-1, size)
    surfaces = {}
    for name in mesh.surfaces:
        zone, local = zone_of_face(mesh.zones, surface_faces(mesh, name))
        surfaces[name] = zone_nodes[zone[:, None], grids.reshape(hexahedra.N_FACES, -1)[local]]
    if mesh.contacts is None or not names:
        return points[order], zone_nodes, surfaces, mesh.contacts
    nodes = SpectralNodes(mesh, points[order], zone_nodes, surfaces, None)
    split = ~welded
    pair = [zone_nodes.ravel()[side[split].reshape(np.count_nonzero(split), -1)] for side in sides]
    contacts = _contacts(nodes, names, joint[split], first[split], sides[0][split], pair)
    return points[order], zone_nodes, surfaces, contacts


def _corner_labels(mesh):
    """Return a label of each corner node, equal for the copies of a split node."""
    if mesh.contacts is None:
        return np.arange(len(mesh.points))
    return graph_components(mesh.contacts.minus, mesh.contacts.plus, len(mesh.points))[1]


def _shared_faces(mesh):
    """Return the faces shared by two zones, minus side first, and their joint, -1 for none."""
    n_nodes, contacts = len(mesh.points), mesh.contacts
    if contacts is None:
        first, second, _, _ = mesh.paired_faces
        return first, second, np.full(len(first), -1), ()
    first, second, _, _ = pair_faces(_corner_labels(mesh)[mesh.zones], n_nodes)
    keys = face_keys(zone_faces(mesh.zones), n_nodes)
    joint = np.full(len(first), -1)
    for number, name in enumerate(contacts.names):
        minus = face_keys(mesh.surfaces[name], n_nodes)
        turned = np.isin(keys[second], minus) & (keys[second] != keys[first])
        first, second = np.where(turned, second, first), np.where(turned, first, second)
        joint[np.isin(keys[first], minus)] = number
    return first, second, joint, contacts.names


def _in_common_order(mesh, label, faces, grids):
    """Return the nodes (n, order + 1, order + 1), numbered in all zones, of faces.

    They run from the corner of the lowest label towards its neighbour of the lower label, so that
    both zones of a face list the same places.
    """
    zone, local = zone_of_face(mesh.zones, faces)
    corner = label[mesh.zones[zone[:, None], face_table(mesh.zones)[local]]]
    start = corner.argmin(axis=1)
    rows = np.arange(len(faces))
    ahead, behind = (corner[rows, (start + step) % 4] for step in (1, 3))
    grid = grids[local]
    turned = np.empty_like(grid)
    for quarter in range(4):
        here = start == quarter
        turned[here] = np.rot90(grid[here], quarter, axes=(2, 1))
    flip = behind < ahead
    turned[flip] = turned[flip].transpose(0, 2, 1)
    return turned + (mesh.order + 1) ** 3 * zone[:, None, None]


def _contacts(nodes, names, joint, minus, grid, pair):
    """Return the contacts of the nodes of facing faces, with their tributary areas."""
    size = (nodes.mesh.order + 1) ** 3
    zone, local = zone_of_face(nodes.mesh.zones, minus)
    _, vectors = nodes.face_areas(minus)
    own = hexahedra.face_nodes(nodes.mesh.order).reshape(hexahedra.N_FACES, -1)[local]
    wanted = grid.reshape(len(minus), -1) - size * zone[:, None]
    order = np.argsort(own, axis=1)
    rank = np.take_along_axis(order, np.argsort(np.argsort(wanted, axis=1), axis=1), axis=1)
    vectors = np.take_along_axis(vectors, rank[..., None], axis=1).reshape(-1, 3)
    keys = np.column_stack([joint.repeat(own.shape[1]), *(side.ravel() for side in pair)])
    apart = keys[:, 1] != keys[:, 2]
    keys, area, normal = merge_pairs(keys[apart], vectors[apart])
    owner, minus_node, plus_node = keys.astype(np.int32).T
    return Contacts(owner, names, minus_node, plus_node, normal, area)
