"""Domains: neighbouring zones of one law that are computed together, with slots for their nodes."""

from itertools import pairwise

import numpy as np

from ..meshing.patches import MOST

DOMAIN_ZONES = 1024
QUADRATIC_ZONES = 128


def domain_arrays(nodes, patch, contact_node):
    """Cut the zones into domains and give each domain slots for its nodes.

    Parameters
    ----------
    nodes : Nodes
        Of a mesh whose zones are ordered group by group.
    patch : (n_zones,) int64
        Patch of each zone, -1 where there is none.
    contact_node : (n_contacts, 2) int32

    Returns
    -------
    dict
        Kernel arrays of domains, slots, zones and of the parts of the force of each node.
    """
    n_nodes, n_zones = len(nodes.points), len(nodes.zone_nodes)
    group, corners = nodes.mesh.zone_group, nodes.zone_nodes.shape[1]
    starts = _starts(group, patch, QUADRATIC_ZONES if nodes.quadratic else DOMAIN_ZONES)
    domain = np.searchsorted(starts, np.arange(n_zones), side="right") - 1
    keys = domain[:, None].astype(np.int64) * n_nodes + nodes.zone_nodes
    slots, place = np.unique(keys, return_inverse=True)
    slot_start = np.searchsorted(slots, np.arange(len(starts)) * n_nodes)
    slot_node = slots % n_nodes
    origin = np.repeat(nodes.points[slot_node[slot_start[:-1]]], np.diff(slot_start), axis=0)
    part_node = np.concatenate([slot_node, contact_node.ravel()])
    order = np.argsort(part_node, kind="stable")
    return {
        "domain_zone_start": starts.astype(np.int32),
        "domain_slot_start": slot_start.astype(np.int32),
        "domain_set": group[starts[:-1]].astype(np.int32),
        "slot_node": slot_node.astype(np.int32),
        "slot_place": nodes.points[slot_node] - origin,
        "zone_slot": (place.reshape(-1, corners) - slot_start[domain][:, None]).T.astype(np.int32),
        "zone_patch": _numbers(patch, starts),
        "node_part": order.astype(np.int32),
        "node_start": np.searchsorted(part_node[order], np.arange(n_nodes + 1)).astype(np.int32),
    }


def _starts(group, patch, size):
    """Cut where the group changes, and into like sizes, between patches where that is near."""
    ends = np.append(np.flatnonzero(np.diff(group)) + 1, len(group))
    cuts = []
    for low, high in pairwise(np.append(0, ends)):
        cuts.append(low)
        for cut in range(low + size, high, size):
            first = max(low, cut - MOST)
            within = np.count_nonzero(patch[first:cut] == patch[cut])
            cuts.append(cut - (within if patch[cut] >= 0 else 0))
    return np.append(cuts, len(group))


def _numbers(patch, starts):
    """Count the patches within each domain, -1 where there is none; a cut one becomes two."""
    numbers = np.full(len(patch), -1, dtype=np.int32)
    for low, high in pairwise(starts):
        there = low + np.flatnonzero(patch[low:high] >= 0)
        numbers[there] = np.unique(patch[there], return_inverse=True)[1]
    return numbers
