"""Spectral hexahedra and their absorbing layer as kernel arrays."""

from typing import Any

import numpy as np

from .. import core
from ..errors import InputError
from ..mesh import hexahedra
from ..mesh.hexahedra import AbsorbingLayer
from ..model.model import Model

REFLECTION = 1e-7  # amplitude that a wave of normal incidence would keep
STRENGTH = 7.0  # real stretch at the outer edge
VISCOSITY = 0.005  # times edge over cs: of the zones, against waves that the grid does not carry
DIGITS = 12  # of depths, so that nodes side by side share their stretch
ACROSS = 1e-6  # of its width: largest change of depth across the axis of a zone of the layer
PARALLEL = 0.5  # |cosine| of normal and axis above which a joint is not stretched along the axis
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
    model: Model,
    contact_node: np.ndarray,
    layered: bool = True,
) -> tuple[dict[str, Any], np.ndarray]:
    """Return the kernel arrays of the hexahedra of a model; theory.md (2.44) to (2.47).

    Parameters
    ----------
    model : Model
    contact_node : (n_contacts, 2) int32
    layered : bool
        Whether zones of an absorbing layer are such, not plain ground.

    Returns
    -------
    arrays : dict
        Packs of zones, the parts of nodal forces, and empty tables of tetrahedra.
    member : (n_packs, width) int64
        Zones of each pack.
    """
    mesh, nodes, width = model.mesh, model.spectral, core.HEX_WIDTH[model.single]
    order, size = mesh.order, nodes.zone_nodes.shape[1]
    layer = in_layer(model) & layered
    inverse = np.linalg.inv(nodes.jacobian)
    if mesh.layer is not None and layered:
        turned = inverse @ np.array(mesh.layer.frame, dtype=float).T
        inverse = np.where(np.any(layer, axis=1, keepdims=True)[..., None, None], turned, inverse)
    brick = np.zeros(len(inverse), dtype=bool) if model.ground else _bricks(inverse)
    # Packs are of one form, stretched along the same axes, and of one group.
    kind = (layer @ [1, 2, 4] + 8 * brick) * len(mesh.groups) + mesh.zone_group
    # Zones side by side in space lie side by side in memory, as their nodes do.
    along = np.argsort(nodes.zone_nodes.mean(axis=1), kind="stable")
    packs, n_mapped = [], 0
    for number in np.unique(kind):
        zones = along[kind[along] == number]
        packs += [zones[k : k + width] for k in range(0, len(zones), width)]
        n_mapped = n_mapped if brick[zones[0]] else len(packs)
    member = np.array([np.resize(zones, width) for zones in packs])
    real = np.array([np.arange(width) < len(zones) for zones in packs])
    lame, shear = model.node_moduli()
    metric = np.zeros((n_mapped, size, 11, width))
    bricks = np.zeros((len(packs) - n_mapped, 5, width))
    for number in range(n_mapped):
        zones, full = member[number], real[number]
        metric[number, :, :9] = np.einsum(
            "zarc,za,z->arcz", inverse[zones], nodes.volumes[zones], full
        ).reshape(size, 9, width)
        metric[number, :, 9] = (full[:, None] * lame[zones] / nodes.volumes[zones]).T
        metric[number, :, 10] = (full[:, None] * shear[zones] / nodes.volumes[zones]).T
    of_bricks = member[n_mapped:]
    eighth = real[n_mapped:] * nodes.volumes.sum(axis=1)[of_bricks] / 8.0
    bricks[:, :3] = np.einsum("zcc->zc", inverse[:, 0])[of_bricks].transpose(0, 2, 1)
    bricks[:, 3], bricks[:, 4] = lame[of_bricks, 0] * eighth, shear[of_bricks, 0] * eighth
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


def stiff_alone(
    arrays: dict[str, Any], member: np.ndarray, active: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the tables of `pack_arrays` without the stiffness of zones not ``active``."""
    stiff, n_mapped = active[member][:, None, :], arrays["n_mapped"]
    return {
        "pack_metric": arrays["pack_metric"] * stiff[:n_mapped, None],
        "pack_brick": arrays["pack_brick"] * stiff[n_mapped:],
    }


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


def no_layer(single: bool, n_packs: int, n_line: int) -> dict[str, Any]:
    """Return the kernel arrays of a model without absorbing layer; ``n_line``: order + 1."""
    width = core.HEX_WIDTH[single]
    return {
        "n_slabs": 0,
        "slab_start": np.zeros(n_packs + 1, dtype=np.int32),
        "slab_axis": np.zeros(1, dtype=np.int32),
        "slab_stretch": np.zeros((1, n_line, 5, width)),
        "slab_lag": np.zeros((1, width)),
        "layer_frame": np.eye(3),
        "layer_node": np.zeros(1, dtype=np.int32),
        "layer_mass": np.zeros(1),
        "stretch_start": np.zeros(2, dtype=np.int32),
        "stretch_row": np.zeros(1, dtype=np.int32),
        "node_stretch": np.zeros((1, 5)),
        "crossing_part": np.zeros(1, dtype=np.int32),
        "crossing_stretch": np.zeros((1, 3, 5)),
    }


def without_layer(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return what differs in kernel arrays of a model if its absorbing layer is plain ground."""
    mass = arrays["node_mass"].copy()
    if arrays["n_slabs"]:
        mass[arrays["layer_node"]] = arrays["layer_mass"]
    return {"n_slabs": 0, "node_mass": mass}


def in_layer(model: Model) -> np.ndarray:
    """Return along which axes each zone of a model is stretched, (n_zones, 3) bool."""
    if model.mesh.layer is None:
        return np.zeros((len(model.mesh.zones), 3), dtype=bool)
    return model.mesh.layer.depths(model.mesh.node_places.mean(axis=1)) > 0.0


def axis_stretches(
    layer: AbsorbingLayer, places: np.ndarray, fastest: float, dt: float
) -> np.ndarray:
    """Return the stretch of the axes at places; theory.md (4.15), (4.16).

    Parameters
    ----------
    layer : AbsorbingLayer
    places : (..., 3) float64, m
    fastest : float, m/s
        P speed of the fastest ground of the layer.
    dt : float, s

    Returns
    -------
    (..., 3, 5) float64
        kappa, d in 1/s, z in s, b, and 1/(kappa + d z).
    """
    depth = np.round(layer.depths(places), DIGITS)
    loss = 2.0 * fastest * np.log(1.0 / REFLECTION) / layer.widths(places) * depth**3
    shift = 2.0 * np.pi * layer.lowest / 6.0 * (1.0 - depth)
    half = 0.5 * dt
    real = 1.0 + (STRENGTH - 1.0) * depth**3
    share = half / (1.0 + half * shift)
    keeps = (1.0 - half * shift) / (1.0 + half * shift)
    return np.stack([real, loss, share, keeps, 1.0 / (real + loss * share)], axis=-1)


def layer_arrays(model: Model, arrays: dict[str, Any], member: np.ndarray) -> dict[str, Any]:
    """Return the kernel arrays of the absorbing layer, and the mass of nodes with its stretch.

    Parameters
    ----------
    model : Model
    arrays : dict
        Kernel arrays of hexahedra and nodes.
    member : (n_packs, width) int64
        Zones of each pack.
    """
    n_line, layer = model.mesh.order + 1, model.mesh.layer
    if layer is None:
        return no_layer(model.single, len(member), n_line)
    mesh, nodes, dt = model.mesh, model.spectral, arrays["dt"]
    inside = in_layer(model)
    own = inside.any(axis=1)
    fastest = float((model.zone_values("cp") * np.sqrt(_stiffer(model)))[own].max())
    axes = [np.flatnonzero(inside[zones[0]]) for zones in member]
    slab_start = np.concatenate([[0], np.cumsum([len(part) for part in axes])])
    of_pack = np.repeat(np.arange(len(member)), [len(part) for part in axes])
    slab_axis = np.concatenate([np.zeros(0, dtype=int), *axes])
    zones = member[of_pack]
    corner = n_line ** np.arange(3)  # number of the nodes along the three axes of a zone
    line = corner[slab_axis][:, None] * np.arange(n_line)
    places = mesh.node_places[zones[:, :, None], line[:, None, :]]
    depths = layer.depths(mesh.node_places[zones]).reshape(-1, member.shape[1], *[n_line] * 3, 3)
    for depth, axis in zip(depths, slab_axis, strict=True):
        lines = np.moveaxis(depth[..., axis], 3 - axis, 1).reshape(member.shape[1], n_line, -1)
        if np.ptp(lines, axis=2).max() > ACROSS:
            raise InputError("layer: its axes must be those of the zones in it, as in a grid")
    at = axis_stretches(layer, places, fastest, dt)
    picked = np.take_along_axis(at, slab_axis[:, None, None, None, None], axis=3)[:, :, :, 0]
    at_nodes = axis_stretches(layer, nodes.points, fastest, dt)
    stretched = at_nodes[:, ::-1, 1] > 0.0  # the third axis first, it is the innermost
    layer_node = np.flatnonzero(stretched.any(axis=1))
    acts = stretched[layer_node]
    stretch, row = np.unique(at_nodes[layer_node][:, ::-1][acts], axis=0, return_inverse=True)
    at_once = at_nodes[..., 0] + at_nodes[..., 1] * at_nodes[..., 2]
    mass = arrays["node_mass"]
    return {
        "n_slabs": len(slab_axis),
        "slab_start": slab_start.astype(np.int32),
        "slab_axis": slab_axis.astype(np.int32),
        "slab_stretch": np.ascontiguousarray(picked.transpose(0, 2, 3, 1)),
        "slab_lag": layer_lags(model, zones),
        "layer_frame": np.array(layer.frame, dtype=float),
        "layer_node": layer_node.astype(np.int32),
        "layer_mass": mass[layer_node],
        "stretch_start": np.concatenate([[0], np.cumsum(acts.sum(axis=1))]).astype(np.int32),
        "stretch_row": row.ravel().astype(np.int32),
        "node_stretch": stretch,
        "node_mass": mass * at_once.prod(axis=1),
        **_crossings(model, fastest, dt),
    }


def layer_lags(model: Model, zones: np.ndarray) -> np.ndarray:
    """Return the viscosity over the moduli of zones (...) of the layer, in s; theory.md (4.18)."""
    layer, places = model.mesh.layer, model.mesh.node_places[zones]
    if layer is None:
        return np.zeros(np.shape(zones))
    depth = layer.depths(places).max(axis=-1)
    edge = model.spectral.volumes.sum(axis=1)[zones] ** (1.0 / 3.0)
    return VISCOSITY * edge / model.zone_values("cs")[zones] * (depth**3).mean(axis=-1)


def _stiffer(model):
    """Return the unrelaxed over the relaxed modulus of P waves of each zone."""
    relaxed, stiffest = model.zone_moduli(), model.stiffest_moduli()
    return (stiffest[0] + 2.0 * stiffest[1]) / (relaxed[0] + 2.0 * relaxed[1])


def _crossings(model, fastest, dt):
    """Return the stretch of the contacts of joints that cross the layer."""
    contacts, layer = model.spectral.contacts, model.mesh.layer
    none = {"crossing_part": np.zeros(1, dtype=np.int32), "crossing_stretch": _no_stretch(1)}
    if contacts is None:
        return none
    places = model.spectral.points[contacts.minus]
    within = np.flatnonzero((layer.depths(places) > 0.0).any(axis=1))
    if not len(within):
        return none
    stretch = axis_stretches(layer, places[within], fastest, dt)
    across = np.abs(contacts.normal[within] @ np.array(layer.frame, dtype=float).T) > PARALLEL
    stretch[across] = _no_stretch(1)[0, 0]
    return {"crossing_part": within.astype(np.int32), "crossing_stretch": stretch}


def _no_stretch(n):
    """Return stretches (n, 3, 5) of one."""
    return np.tile([1.0, 0.0, 0.0, 0.0, 1.0], (n, 3, 1))
