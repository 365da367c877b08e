"""Renumbering along a space-filling curve, and patches of neighbouring zones."""

from dataclasses import replace

import numpy as np

from . import tetrahedra
from .mesh import Mesh, components

FEWEST, MOST = 4, 10  # zones of a patch


def make_patches(mesh: Mesh, wanted: np.ndarray) -> np.ndarray:
    """Group zones into patches for averaged dilation (B-bar).

    Parameters
    ----------
    mesh : Mesh
    wanted : (n_zones,) bool
        Zones that belong to patches.

    Returns
    -------
    (n_zones,) int64
        Patch of each zone from 0, -1 for the other zones.

    Notes
    -----
    A patch is the zones of one group around the same longest edge: the cells of a grid with six
    tetrahedra per cell. Patches smaller than `FEWEST` join the smallest neighbour of their group.
    Zones of a patch are connected by faces, so no patch crosses a joint.
    """
    first, second = mesh.paired_faces[0] // 4, mesh.paired_faces[1] // 4
    edge = _longest_edges(mesh)
    fits = wanted[first] & wanted[second] & (mesh.zone_group[first] == mesh.zone_group[second])
    first, second = first[fits], second[fits]
    around = edge[first] == edge[second]
    _, patch = components(first[around], second[around], len(mesh.zones))
    volume = tetrahedra.volumes(mesh.points, mesh.zones)
    patch = _merged(patch.astype(np.int64), first, second, volume, wanted)
    patch[wanted] = np.unique(patch[wanted], return_inverse=True)[1]
    patch[~wanted] = -1
    return patch


def _longest_edges(mesh):
    """Return an identifier of the longest edge of each zone."""
    ends = mesh.zones[:, tetrahedra.EDGES]
    length = np.linalg.norm(mesh.points[ends[..., 0]] - mesh.points[ends[..., 1]], axis=2)
    longest = np.sort(ends[np.arange(len(ends)), length.argmax(axis=1)], axis=1).astype(np.int64)
    return longest[:, 0] * len(mesh.points) + longest[:, 1]


def _merged(patch, first, second, volume, wanted):
    """Merge patches that are too small with neighbours, the smallest first."""
    size = np.bincount(patch[wanted], minlength=patch.max() + 1)
    space = np.bincount(patch, volume)
    across = patch[first] != patch[second]
    pairs = np.stack([patch[first[across]], patch[second[across]]])
    pairs = pairs[:, (size[pairs] < FEWEST).any(axis=0)]
    beside = {}
    for a, b in pairs.T.tolist():
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    parent = np.arange(len(size))

    def root(p):
        while parent[p] != p:
            p = parent[p]
        return p

    small = np.flatnonzero((size > 0) & (size < FEWEST))
    for p in small[np.lexsort((space[small], size[small]))].tolist():
        if root(p) != p or size[p] >= FEWEST:
            continue
        others = {int(root(q)) for q in beside.get(p, ())} - {p}
        others = [q for q in others if size[q] + size[p] <= MOST]
        if others:
            best = min(others, key=lambda q: (size[q], space[q]))
            parent[p] = best
            size[best] += size[p]
            space[best] += space[p]
            beside.setdefault(best, set()).update(beside[p])
    return np.array([root(p) for p in range(len(parent))])[patch]


BITS = 16


def morton_keys(places: np.ndarray) -> np.ndarray:
    """Return Morton keys (n,) uint64 of places (n, 3): interleaved bits of the coordinates."""
    low = places.min(axis=0)
    span = max(float(np.ptp(places, axis=0).max()), np.finfo(float).tiny)
    cells = ((places - low) / span * (2**BITS - 1)).astype(np.uint64)
    keys = np.zeros(len(places), dtype=np.uint64)
    for bit in range(BITS):
        for axis in range(3):
            digit = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            keys |= digit << np.uint64(3 * bit + axis)
    return keys


def renumbered(mesh: Mesh, patch: np.ndarray | None = None) -> Mesh:
    """Return the same mesh with nodes and zones, group by group, in Morton order (1966).

    Parameters
    ----------
    mesh : Mesh
    patch : (n_zones,) int64, optional
        Patch of each zone, -1 for none; the zones of a patch stay together.

    Notes
    -----
    Copies of a split node keep their order. 2 to 5 times faster than a random order.
    """
    node_order = np.argsort(morton_keys(mesh.points), kind="stable")
    new = np.empty(len(node_order), dtype=np.int32)
    new[node_order] = np.arange(len(node_order), dtype=np.int32)
    centres = mesh.points[mesh.zones].mean(axis=1)
    if patch is None:
        zone_order = np.lexsort((morton_keys(centres), mesh.zone_group))
    else:
        together = morton_keys(_patch_centres(centres, patch))
        zone_order = np.lexsort((patch, together, mesh.zone_group))
    contacts = mesh.contacts
    if contacts is not None:
        order = np.argsort(new[contacts.minus], kind="stable")
        contacts = replace(
            contacts,
            joint=contacts.joint[order],
            minus=new[contacts.minus[order]],
            plus=new[contacts.plus[order]],
            normal=contacts.normal[order],
            area=contacts.area[order],
        )
    return replace(
        mesh,
        points=mesh.points[node_order],
        zones=new[mesh.zones[zone_order]],
        zone_group=mesh.zone_group[zone_order],
        places=None if mesh.places is None else mesh.places[zone_order],
        surfaces={name: new[faces] for name, faces in mesh.surfaces.items()},
        contacts=contacts,
    )


def _patch_centres(centres, patch):
    """Return the mean centre (n, 3) of the patch of each zone, its own centre without patch."""
    together = patch >= 0
    count = np.bincount(patch[together])
    means = [np.bincount(patch[together], column[together]) / count for column in centres.T]
    return np.where(together[:, None], np.stack(means, axis=1)[patch], centres)
