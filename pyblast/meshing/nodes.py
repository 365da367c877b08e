"""Where the motion of a mesh is kept: at its corners, or at 15 nodes a zone."""

from dataclasses import dataclass

import numpy as np

from .elements import (
    AREA_SHARE,
    VOLUME_SHARE,
    corner_slopes,
    mean_slopes,
    shape_slopes,
    shape_values,
)
from .enrichment import enrich
from .mesh import Contacts, Mesh, surface_areas
from .tetrahedra import triangle_vectors


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a mesh, and what zones, faces and places make of them.

    Parameters
    ----------
    mesh : Mesh
        Its points are the first nodes.
    points : (n_nodes, 3) float64, m
    zone_nodes : (n_zones, 4 or 15) int32
    surfaces : dict of str to (n_faces, 3 or 7) int32
    contacts : Contacts or None
        Pairs of nodes.
    """

    mesh: Mesh
    points: np.ndarray
    zone_nodes: np.ndarray
    surfaces: dict[str, np.ndarray]
    contacts: Contacts | None

    @property
    def quadratic(self):
        """Whether zones have 15 nodes."""
        return self.zone_nodes.shape[1] > 4

    def sums(self, values):
        """Share a value of each zone (n_zones,) among its nodes as mass is lumped, (n_nodes,)."""
        share = VOLUME_SHARE if self.quadratic else np.full(4, 0.25)
        parts = np.asarray(values)[:, None] * share
        return np.bincount(self.zone_nodes.ravel(), parts.ravel(), minlength=len(self.points))

    def surface_areas(self, name):
        """Share the area of a surface among its nodes.

        Returns
        -------
        nodes : (n,) int32
            Face by face.
        area : (n,) float64, m2
        normal : (n, 3) float64
            Unit, out of the zone behind.
        """
        if not self.quadratic:
            return surface_areas(self.mesh, name)
        nodes = self.surfaces[name]
        vectors = triangle_vectors(self.points, nodes[:, :3])
        length = np.linalg.norm(vectors, axis=1)[:, None]
        area = (length * AREA_SHARE).ravel()
        return nodes.ravel(), area, (vectors / length).repeat(7, axis=0)

    def shapes(self, weights):
        """Return the shape functions (n, 4 or 15) at barycentric coordinates (n, 4)."""
        return shape_values(weights) if self.quadratic else weights

    def slopes(self, zone, weights):
        """Return the gradients (n, 4 or 15, 3) in 1/m of the shape functions at places."""
        by_coordinate = np.eye(4)[None] if not self.quadratic else shape_slopes(weights)
        return self._gradients(zone, by_coordinate)

    def mean_slopes(self, zone):
        """Return the mean gradients (n, 4 or 15, 3) in 1/m of the shape functions of zones."""
        return self._gradients(zone, mean_slopes() if self.quadratic else np.eye(4)[None])

    def corner_slopes(self, zone):
        """Return the means (4, n, 15, 3) in 1/m of each barycentric coordinate times gradients."""
        return np.stack([self._gradients(zone, table[None]) for table in corner_slopes()])

    def _gradients(self, zone, by_coordinate):
        """Turn slopes by barycentric coordinates into gradients."""
        corners = self.mesh.points[self.mesh.zones[zone]]
        inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
        return (by_coordinate[:, :, 1:] - by_coordinate[:, :, :1]) @ np.swapaxes(inverse, 1, 2)


def nodes_of(mesh, quadratic):
    """Return the nodes of a mesh, at corners only or 15 a zone."""
    if not quadratic:
        return Nodes(mesh, mesh.points, mesh.zones, mesh.surfaces, mesh.contacts)
    return Nodes(mesh, *enrich(mesh))
