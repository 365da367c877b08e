"""Meshes of the suite that are no boxes."""

import numpy as np

from pyblast.mesh.faces import zone_faces
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.tetrahedra import volumes


def ball_octant(n_edges, radii):
    """Mesh an eighth of a thick spherical shell, ``n_edges`` along each quarter of a circle.

    Parameters
    ----------
    n_edges : int
    radii : (n,) float, m
        Ascending; every one becomes a shell of nodes.

    Returns
    -------
    Mesh
        Outer surfaces cavity, outside, and the planes west, south, bottom at x, y, z = 0.
    """
    corners, triangles = _sphere_octant(n_edges)
    layers = len(radii) - 1
    points = (np.asarray(radii)[:, None, None] * corners).reshape(-1, 3)
    low = np.sort(triangles, axis=1)[None] + len(corners) * np.arange(layers)[:, None, None]
    a, b, c = np.moveaxis(low, -1, 0)
    d, e, f = (each + len(corners) for each in (a, b, c))
    prism = ((a, b, c, f), (a, b, e, f), (a, d, e, f))
    zones = np.concatenate([np.stack(four, axis=-1).reshape(-1, 4) for four in prism])
    turned = volumes(points, zones) < 0.0
    zones[turned] = zones[turned][:, [0, 2, 1, 3]]
    unsplit = Mesh(points, zones, np.zeros(len(zones), int), ("rock",), {})
    faces = _single_faces(unsplit)
    surfaces = {"cavity": triangles, "outside": triangles + layers * len(corners)}
    for axis, name in enumerate(("west", "south", "bottom")):
        surfaces[name] = faces[(points[faces][:, :, axis] < 1e-9 * radii[0]).all(axis=1)]
    return Mesh(points, zones, unsplit.zone_group, unsplit.groups, surfaces)


def _single_faces(mesh):
    """Return the faces (n, 3) that belong to one zone only."""
    return zone_faces(mesh.zones)[mesh.paired_faces[2]]


def _sphere_octant(n_edges):
    """Return unit vectors (n, 3) and triangles of an eighth of a sphere, evenly divided."""
    number = {}
    for i in range(n_edges + 1):
        for j in range(n_edges + 1 - i):
            number[i, j] = len(number)
    weights = np.array([(i, j, n_edges - i - j) for i, j in number], dtype=float) / n_edges
    corners = np.sin(0.5 * np.pi * weights)
    corners /= np.linalg.norm(corners, axis=1)[:, None]
    triangles = []
    for i, j in number:
        if i + j < n_edges:
            triangles.append((number[i, j], number[i + 1, j], number[i, j + 1]))
        if i + j < n_edges - 1:
            triangles.append((number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]))
    return corners, np.array(triangles)
