"""Order of nodes and zones along a space-filling curve: near in space, near in memory."""

from dataclasses import replace

import numpy as np

BITS = 16


def morton_keys(places):
    """Return one key (n,) uint64 for each place (n, 3): the interleaved bits of its coordinates."""
    low = places.min(axis=0)
    span = max(float(np.ptp(places, axis=0).max()), np.finfo(float).tiny)
    cells = ((places - low) / span * (2**BITS - 1)).astype(np.uint64)
    keys = np.zeros(len(places), dtype=np.uint64)
    for bit in range(BITS):
        for axis in range(3):
            digit = (cells[:, axis] >> np.uint64(bit)) & np.uint64(1)
            keys |= digit << np.uint64(3 * bit + axis)
    return keys


def renumbered(mesh, patch=None):
    """Return the same mesh with nodes and zones, group by group, in Morton order (1966).

    Parameters
    ----------
    mesh : Mesh
    patch : (n_zones,) int64, optional
        Patch of each zone, -1 where there is none; the zones of a patch stay together.

    Notes
    -----
    Copies of a split node keep their order. Worth 2 to 5 times the speed of a random order.
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
        surfaces={name: new[faces] for name, faces in mesh.surfaces.items()},
        contacts=contacts,
    )


def _patch_centres(centres, patch):
    """Return for each zone the mean centre (n, 3) of its patch, its own where there is none."""
    together = patch >= 0
    count = np.bincount(patch[together])
    means = [np.bincount(patch[together], column[together]) / count for column in centres.T]
    return np.where(together[:, None], np.stack(means, axis=1)[patch], centres)
