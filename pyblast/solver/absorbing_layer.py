"""Absorbing layer of hexahedra as kernel arrays: stretches of zones, nodes and joints."""

from typing import Any

import numpy as np

from .. import core
from ..errors import InputError
from ..mesh.hexahedra import AbsorbingLayer
from ..model.model import Model

REFLECTION = 1e-7  # amplitude that a wave of normal incidence would keep
STRENGTH = 7.0  # real stretch at the outer edge
VISCOSITY = 0.005  # times edge over cs: of the zones, against waves that the grid does not carry
ACROSS = 1e-6  # of its width: largest change of depth across the axis of a zone of the layer
PARALLEL = 0.5  # |cosine| of normal and axis above which a joint is not stretched along the axis


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


def stretches(layer: AbsorbingLayer, places: np.ndarray, fastest: float, dt: float) -> np.ndarray:
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
    depth = layer.depths(places)
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
    at = stretches(layer, places, fastest, dt)
    picked = np.take_along_axis(at, slab_axis[:, None, None, None, None], axis=3)[:, :, :, 0]
    at_nodes = stretches(layer, nodes.points, fastest, dt)
    layer_node = np.unique(nodes.zone_nodes[own])
    at_once = at_nodes[..., 0] + at_nodes[..., 1] * at_nodes[..., 2]
    mass = arrays["node_mass"]
    acts = at_nodes[layer_node][:, ::-1, 1] > 0.0  # the third axis first, it is the innermost
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
        "node_stretch": at_nodes[layer_node][:, ::-1][acts],
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
    stretch = stretches(layer, places[within], fastest, dt)
    across = np.abs(contacts.normal[within] @ np.array(layer.frame, dtype=float).T) > PARALLEL
    stretch[across] = _no_stretch(1)[0, 0]
    return {"crossing_part": within.astype(np.int32), "crossing_stretch": stretch}


def _no_stretch(n):
    """Return stretches (n, 3, 5) of one."""
    return np.tile([1.0, 0.0, 0.0, 0.0, 1.0], (n, 3, 1))
