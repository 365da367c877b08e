"""Patches in the arrays of a run: how they swell with the motion of their nodes."""

import numpy as np

from ..meshing.tetrahedra import shape_gradients, volumes


def patch_arrays(nodes, arrays):
    """Return the patches of all domains with their nodes; theory.md (2.41).

    Parameters
    ----------
    nodes : Nodes
    arrays : dict
        Kernel arrays of domains and zones.

    Returns
    -------
    dict
        Kernel arrays: of each patch its bulk modulus times volume in J, and of each of its nodes
        the slot and the dilation over motion in 1/m.
    """
    starts = arrays["domain_zone_start"]
    zones = np.flatnonzero(arrays["zone_patch"] >= 0)
    domain = np.searchsorted(starts, zones, side="right") - 1
    _, first, patch = np.unique(
        domain * (len(arrays["zone_patch"]) + 1) + arrays["zone_patch"][zones],
        return_index=True, return_inverse=True,
    )  # fmt: skip
    count = max(1, len(first))
    corners = nodes.zone_nodes[zones][:, :4]
    volume = volumes(nodes.points, corners)
    slot = arrays["zone_slot"].T[zones][:, :4]
    n_slots = np.int64(slot.max(initial=0) + 1)
    keys, end = np.unique(patch[:, None] * n_slots + slot, return_inverse=True)
    inner = shape_gradients(nodes.points, corners)
    area = volume[:, None, None] * np.concatenate(
        [-inner.sum(axis=1, keepdims=True), inner], axis=1
    )
    whole = np.bincount(patch, volume, minlength=count)
    sums = [
        np.bincount(end.ravel(), a.ravel(), minlength=len(keys)) for a in np.moveaxis(area, 2, 0)
    ]
    of = keys // n_slots
    bulk = arrays["zone_lambda"][zones] + 2.0 / 3.0 * arrays["zone_shear"][zones]
    return {
        "domain_patch_start": np.searchsorted(domain[first], np.arange(len(starts))).astype(
            np.int32
        ),
        "patch_start": np.searchsorted(of, np.arange(count + 1)).astype(np.int32),
        "patch_slot": (keys % n_slots).astype(np.int32),
        "patch_gradient": np.stack(sums, axis=1) / whole[of][:, None],
        "patch_bulk": np.bincount(patch, bulk * volume, minlength=count).astype(float),
    }
