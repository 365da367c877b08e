"""Spectral hexahedra as kernel arrays, and their critical time step."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .. import core
from ..mesh import hexahedra
from ..model.model import Model
from .absorbing_layer import in_layer, layer_lags, no_layer
from .largest_frequency import largest_eigenvalue, longest_step, with_joints
from .time_step import CriticalStep, contact_bounds

STRAIGHT = 1e-9  # of the mean slope: largest deviation of a brick


def no_packs(single: bool) -> dict[str, Any]:
    """Return the kernel arrays of hexahedra of a model that has none."""
    width = core.HEX_WIDTH[single]
    return {
        "hex_order": 0,
        "n_mapped": 0,
        "hex_slope": np.zeros((1, 1)),
        "hex_weight": np.zeros(1),
        "pack_node": np.zeros((1, 1, width), dtype=np.int32),
        "pack_set": np.zeros(1, dtype=np.int32),
        "pack_metric": np.zeros((1, 1, 11, width)),
        "pack_brick": np.zeros((1, 5, width)),
        **no_layer(single, 1, 1),
    }


def pack_arrays(
    model: Model, contact_node: np.ndarray, active: np.ndarray | None = None
) -> tuple[dict[str, Any], np.ndarray]:
    """Return the kernel arrays of the hexahedra of a model; theory.md (2.44) to (2.47).

    Parameters
    ----------
    model : Model
    contact_node : (n_contacts, 2) int32
    active : (n_zones,) bool, optional
        Zones that have their stiffness; the others have none.

    Returns
    -------
    arrays : dict
        Packs of zones, the parts of nodal forces, and empty tables of tetrahedra.
    member : (n_packs, width) int64
        Zones of each pack.
    """
    mesh, nodes, width = model.mesh, model.spectral, core.HEX_WIDTH[model.single]
    order, size = mesh.order, nodes.zone_nodes.shape[1]
    layer = in_layer(model)
    inverse = np.linalg.inv(nodes.jacobian)
    if mesh.layer is not None:
        turned = inverse @ np.array(mesh.layer.frame, dtype=float).T
        inverse = np.where(np.any(layer, axis=1, keepdims=True)[..., None, None], turned, inverse)
    brick = np.zeros(len(inverse), dtype=bool) if model.ground else _bricks(inverse)
    # Packs are of one form, stretched along the same axes, and of one group.
    kind = (layer @ [1, 2, 4] + 8 * brick) * len(mesh.groups) + mesh.zone_group
    packs, n_mapped = [], 0
    for number in np.unique(kind):
        zones = np.flatnonzero(kind == number)
        packs += [zones[k : k + width] for k in range(0, len(zones), width)]
        n_mapped = n_mapped if brick[zones[0]] else len(packs)
    member = np.array([np.resize(zones, width) for zones in packs])
    real = np.array([np.arange(width) < len(zones) for zones in packs])
    stiff = real if active is None else real & active[member]
    lame, shear = model.node_moduli()
    metric = np.zeros((n_mapped, size, 11, width))
    bricks = np.zeros((len(packs) - n_mapped, 5, width))
    for number in range(len(packs)):
        zones, full = member[number], stiff[number]
        if number < n_mapped:
            metric[number, :, :9] = np.einsum(
                "zarc,za,z->arcz", inverse[zones], nodes.volumes[zones], full
            ).reshape(size, 9, width)
            metric[number, :, 9] = (full[:, None] * lame[zones] / nodes.volumes[zones]).T
            metric[number, :, 10] = (full[:, None] * shear[zones] / nodes.volumes[zones]).T
        else:
            eighth = full * nodes.volumes[zones].sum(axis=1) / 8.0
            at = bricks[number - n_mapped]
            at[:3] = np.einsum("zcc->cz", inverse[zones, 0])
            at[3], at[4] = lame[zones, 0] * eighth, shear[zones, 0] * eighth
    arrays = {
        "hex_order": order,
        "n_mapped": n_mapped,
        "hex_slope": np.ascontiguousarray(hexahedra.slopes_on_line(order).T),
        "hex_weight": hexahedra.lobatto(order)[1],
        "pack_node": nodes.zone_nodes[member].transpose(0, 2, 1).astype(np.int32),
        "pack_set": mesh.zone_group[member[:, 0]].astype(np.int32),
        "pack_metric": metric,
        "pack_brick": bricks,
        **_parts(nodes, member, real, contact_node),
        **_no_tetrahedra(size, len(mesh.groups)),
    }
    return arrays, member


def _bricks(inverse):
    """Return whether each zone is a brick along the axes, (n_zones,) bool."""
    first = inverse[:, :1] * np.eye(3)
    scale = np.abs(first).max(axis=(1, 2, 3))
    return np.abs(inverse - first).max(axis=(1, 2, 3)) <= STRAIGHT * scale


def _parts(nodes, member, real, contact_node):
    """Return the parts of the force on each node: from its zones, then from sides of contacts."""
    size, width = nodes.zone_nodes.shape[1], member.shape[1]
    number = np.arange(len(member) * size * width).reshape(len(member), size, width)
    node = nodes.zone_nodes[member].transpose(0, 2, 1)
    used = np.broadcast_to(real[:, None, :], node.shape)
    part = np.concatenate([number[used], number.size + np.arange(contact_node.size)])
    part_node = np.concatenate([node[used], contact_node.ravel()])
    order = np.lexsort((part, part_node))
    n_nodes = len(nodes.points)
    return {
        "node_part": part[order].astype(np.int32),
        "node_start": np.searchsorted(part_node[order], np.arange(n_nodes + 1)).astype(np.int32),
    }


def _no_tetrahedra(size, n_sets):
    """Return tables of one tetrahedron in one domain, which no kernel reads."""
    none = np.zeros(1, dtype=np.int32)
    single = np.array([0, 1], dtype=np.int32)
    return {
        "domain_zone_start": single,
        "domain_slot_start": single,
        "domain_set": none,
        "slot_node": none,
        "slot_place": np.zeros((1, 3)),
        "zone_slot": np.zeros((size, 1), dtype=np.int32),
        "zone_lambda": np.zeros(1),
        "zone_shear": np.zeros(1),
        "zone_row": none - 1,
        "zone_patch": none - 1,
        "set_form": np.zeros(n_sets, dtype=np.int32),
        "edge_start": np.zeros(2, dtype=np.int32),
        "edge_slot": none,
        "edge_spring": np.zeros((1, 6)),
        "skew_start": np.zeros(2, dtype=np.int32),
        "skew_slot": np.zeros((1, 2), dtype=np.int32),
        "skew_spring": np.zeros((1, 3)),
        "domain_patch_start": np.zeros(2, dtype=np.int32),
        "patch_start": np.zeros(2, dtype=np.int32),
        "patch_slot": none,
        "patch_gradient": np.zeros((1, 3)),
        "patch_bulk": np.zeros(1),
    }


def critical_step_of_hexahedra(
    model: Model, mass: np.ndarray, product_of: Callable[..., Callable]
) -> CriticalStep:
    """Return the critical time step of a model of hexahedra, from its largest frequency.

    Parameters
    ----------
    model : Model
    mass : (n_nodes,) float64, kg
    product_of : callable
        Returns the function that multiplies a motion (n_nodes, 3) with the stiffness over the mass,
        of all zones or of those of a mask.

    Notes
    -----
    Lanczos on the assembled zones and joints, these with their stiffest springs: theory.md (2.48).
    The viscosity of the absorbing layer counts with the largest frequency of its own zones.
    """
    spring, viscosity = contact_bounds(model)
    squared = largest_eigenvalue(with_joints(model, product_of(), mass), mass)
    drag = float((2.0 * viscosity / mass).max())
    beta = float(model.group_damping("beta").max())
    dt = longest_step(squared, drag, beta)
    own = in_layer(model).any(axis=1)
    if own.any():
        lag = beta + float(layer_lags(model, np.flatnonzero(own)).max())
        dt = min(dt, longest_step(largest_eigenvalue(product_of(own), mass), drag, lag))
    part = "the shortest distance of nodes"
    if (spring / mass).max() > 0.5 * squared:
        part = "a contact of a joint"
    zones = np.zeros(len(model.mesh.zones))
    shares = dict.fromkeys(model.mesh.groups, 0.0)
    return CriticalStep(dt, longest_step(squared, drag), part, zones, shares, dt)
