"""Implicit zones: the smallest zones and contacts by the trapezoidal rule, factored once."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import bsr_array, coo_array, csc_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from ..mesh.mesh import Contacts, Mesh
from ..mesh.nodes import Nodes
from ..model.boundary import VelocityInput
from ..model.model import Model

SYMMETRIC = ([0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1])  # xx yy zz yz zx xy
IN_ORDER = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}


def no_implicit_zones() -> dict[str, np.ndarray]:
    """Return the kernel arrays of a model without implicit zones: one node in no cluster."""
    return {
        "cluster_start": np.zeros(1, dtype=np.int32),
        "implicit_node": np.zeros(1, dtype=np.int32),
        "column_start": np.zeros(2, dtype=np.int32),
        "block_row": np.zeros(1, dtype=np.int32),
        "block_factor": np.zeros((1, 9)),
        **{f"implicit_{name}": np.zeros((1, 6)) for name in ("inverse", "inertia", "drag")},
    }


@dataclass(frozen=True, eq=False)
class Implicit:
    """Zones (n_zones,) bool and contacts (n_contacts,) bool that a run takes implicitly."""

    zones: np.ndarray
    contacts: np.ndarray

    def __or__(self, other: "Implicit") -> "Implicit":
        """Return the zones and contacts that are implicit in either."""
        return Implicit(self.zones | other.zones, self.contacts | other.contacts)

    def nodes(self, nodes: Nodes) -> tuple[np.ndarray, np.ndarray]:
        """Return the nodes of the zones (n, k) and those of the contacts (m, 2)."""
        return nodes.zone_nodes[self.zones], contact_pairs(nodes.contacts)[self.contacts]


def contact_pairs(contacts: Contacts | None) -> np.ndarray:
    """Return the nodes (n_contacts, 2) of contacts, minus and plus."""
    if contacts is None:
        return np.zeros((0, 2), dtype=np.int32)
    return np.stack([contacts.minus, contacts.plus], axis=1)


def moved_nodes(model: Model) -> np.ndarray:
    """Return whether a velocity is prescribed at each node, (n_nodes,) bool."""
    moved = np.zeros(len(model.nodes.points), dtype=bool)
    for boundary in model.boundaries:
        if isinstance(boundary, VelocityInput):
            moved[model.nodes.surfaces[boundary.surface]] = True
    return moved


def clusters_of(*groups: np.ndarray) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Return clusters of nodes, which groups (n, k) of nodes of zones and contacts connect.

    Namely the nodes (n_implicit,), the groups as indices into them, and the cluster of each node,
    the largest first.
    """
    node, numbers = np.unique(np.concatenate([g.ravel() for g in groups]), return_inverse=True)
    ends = np.cumsum([g.size for g in groups])[:-1]
    local = [part.reshape(g.shape) for part, g in zip(np.split(numbers, ends), groups, strict=True)]
    n = len(node)
    first = np.concatenate([np.broadcast_to(g[:, :1], g[:, 1:].shape).ravel() for g in local])
    other = np.concatenate([g[:, 1:].ravel() for g in local])
    links = coo_array((np.ones(len(first)), (first, other)), shape=(n, n))
    count, cluster = connected_components(links, directed=False)
    rank = np.empty(count, dtype=np.int32)
    rank[np.argsort(-np.bincount(cluster, minlength=count), kind="stable")] = np.arange(count)
    return node, local, rank[cluster]


@dataclass(frozen=True, eq=False)
class _Sampled:
    """Ground field with a given factor of every zone, (n_zones,)."""

    values: np.ndarray

    def factor(self, _places, _edges):
        """Return the factors."""
        return self.values


def zone_stiffness(model: Model, zones: np.ndarray, product_of: Callable) -> np.ndarray:
    """Return the elastic stiffness (n, k, 3, k, 3) of zones in N/m, by node and component.

    Springs that relax act in full; ground that may yield counts as elastic, without patches.
    ``product_of`` is `assembly.zone_product`: it multiplies unit motions of zones that share no
    node.
    """
    mesh = model.mesh
    apart = replace(
        model,
        mesh=Mesh(
            mesh.points[mesh.zones[zones]].reshape(-1, 3), np.arange(4 * len(zones)).reshape(-1, 4),
            mesh.zone_group[zones], mesh.groups, {},
        ),
        ground=(_Sampled(np.broadcast_to(model.speed_factor, len(mesh.zones))[zones]),),
        joints=(), boundaries=(), sources=(), receivers=(), insitu=None,
    )  # fmt: skip
    nodes = apart.nodes
    k = nodes.zone_nodes.shape[1]
    product = product_of(apart, np.ones(len(nodes.points)))
    stiffness = np.empty((len(zones), k, 3, k, 3))
    for node in range(k):
        for axis in range(3):
            motion = np.zeros_like(nodes.points)
            motion[nodes.zone_nodes[:, node], axis] = 1.0
            stiffness[..., node, axis] = product(motion)[nodes.zone_nodes]
    return stiffness


def explicit_product(
    model: Model, implicit: Implicit, mass: np.ndarray, product_of: Callable
) -> Callable:
    """Return the product of the explicit zones of a model, as `assembly.zone_product` of all.

    ``mass`` (n_nodes,) in kg.
    """
    product, zones = product_of(model, mass), np.flatnonzero(implicit.zones)
    if not len(zones):
        return product
    stiffness = zone_stiffness(model, zones, product_of)
    lag = model.zone_damping("beta")[zones, None, None, None, None]
    local = [model.nodes.zone_nodes[zones]]
    at_once, damped = (
        _assembled([part], local, len(mass)) for part in (stiffness, lag * stiffness)
    )

    def explicit(motion, rate=0.0):
        own = (at_once + rate * damped) @ motion.ravel()
        return product(motion, rate) - own.reshape(-1, 3) / mass[:, None]

    return explicit


def _assembled(stiffness, local, n_nodes):
    """Return stiffnesses (n, k, 3, k, 3) over nodes numbered (n, k), as one sparse matrix."""
    rows, columns = [], []
    for part, numbers in zip(stiffness, local, strict=True):
        of = 3 * numbers[:, :, None] + np.arange(3)
        rows.append(np.broadcast_to(of[:, :, :, None, None], part.shape).ravel())
        columns.append(np.broadcast_to(of[:, None, None], part.shape).ravel())
    places = (np.concatenate(rows), np.concatenate(columns))
    values = np.concatenate([part.ravel() for part in stiffness])
    return coo_array((values, places), shape=(3 * n_nodes, 3 * n_nodes)).tocsr()


def implicit_arrays(
    model: Model,
    constants: dict[str, Any],
    implicit: Implicit,
    springs: np.ndarray,
    product_of: Callable,
) -> dict[str, np.ndarray]:
    """Return the factored matrix of implicit zones and contacts as kernel arrays; theory.md (2.53).

    ``constants`` hold masses, mass damping, dashpots and prescribed directions; ``springs``
    (2, n_contacts) are the largest stiffness in N/m and viscosity in N s/m of the contacts.
    """
    zones = np.flatnonzero(implicit.zones)
    if not len(zones):
        return no_implicit_zones()
    dt = constants["dt"]
    node, local, cluster = clusters_of(*implicit.nodes(model.tetrahedral))
    share = 0.25 * dt**2 + 0.5 * dt * model.zone_damping("beta")[zones]
    spring = (np.array([0.25 * dt**2, 0.5 * dt]) @ springs)[implicit.contacts]
    parts = [
        np.einsum("z,zaibj->zaibj", share, zone_stiffness(model, zones, product_of)),
        np.einsum("c,ab,ij->caibj", spring, [[1.0, -1.0], [-1.0, 1.0]], np.eye(3)),
    ]
    return cluster_arrays(constants, parts, local, node, cluster)


def cluster_arrays(
    constants: dict[str, Any],
    parts: list[np.ndarray],
    local: list[np.ndarray],
    node: np.ndarray,
    cluster: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the factored matrix of clusters as kernel arrays.

    Parameters
    ----------
    constants : dict
        Kernel arrays with masses, mass damping, dashpots and prescribed directions.
    parts : list of (n, k, 3, k, 3) float64, kg
        What is added to the inertia, of groups of nodes.
    local, node, cluster
        The groups as indices into the nodes, these and their clusters, as `clusters_of` gives them.
    """
    order = np.lexsort((_elimination(local, len(node)), cluster))
    turn, node = np.argsort(order), node[order]
    where = np.full(len(constants["node_mass"]), -1)
    where[node] = np.arange(len(node))
    inertia, drag = _inertia(constants, node, where)
    matrix = _assembled(parts, [turn[numbers] for numbers in local], len(node))
    start, row, blocks, inverse = _factors(
        _held(matrix + _diagonal(inertia), constants, node, where)
    )
    return {
        "cluster_start": np.append(0, np.cumsum(np.bincount(cluster))).astype(np.int32),
        "implicit_node": node.astype(np.int32),
        "column_start": start,
        "block_row": row,
        "block_factor": np.ascontiguousarray(blocks.transpose(0, 2, 1).reshape(-1, 9)),
        "implicit_inverse": inverse[:, *SYMMETRIC],
        "implicit_inertia": inertia[:, *SYMMETRIC],
        "implicit_drag": drag[:, *SYMMETRIC],
    }


def _elimination(local, n):
    """Return the turn (n,) of each node in an order with little fill (minimum degree)."""
    rows = np.concatenate([np.repeat(g, g.shape[1], axis=1).ravel() for g in local])
    columns = np.concatenate([np.tile(g, (1, g.shape[1])).ravel() for g in local])
    graph = coo_array((np.full(len(rows), -1.0), (rows, columns)), shape=(n, n)).tocsc()
    graph.data[:] = -1.0
    graph += csc_array(_diagonal(np.full((n, 1, 1), 4.0 * n)))
    return splu(graph, permc_spec="MMD_AT_PLUS_A", **IN_ORDER).perm_c


def _diagonal(blocks):
    """Return blocks (n, k, k) on the diagonal of a sparse matrix."""
    n, k = blocks.shape[:2]
    return bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(n * k, n * k)).tocsr()


def _inertia(constants, node, where):
    """Return D = m (1 + alpha dt/2) I + Z dt/2 in kg and R = m alpha I + Z of nodes (n, 3, 3)."""
    half, eye = 0.5 * constants["dt"], np.eye(3)
    mass, alpha = (constants[name][node] for name in ("node_mass", "node_alpha"))
    drag = (mass * alpha)[:, None, None] * eye
    dashpot = where[constants["dashpot_node"]]
    inside = dashpot >= 0
    drag[dashpot[inside]] += constants["dashpot_impedance"][inside]
    return mass[:, None, None] * eye + half * drag, drag


def _held(matrix, constants, node, where):
    """Return the matrix without the coupling of directions that are at rest."""
    at = where[constants["fixed_node"]]
    free = np.tile(np.eye(3), (len(node), 1, 1))
    for row in np.flatnonzero((at >= 0) & constants["fixed_direction"].any(axis=1)):
        direction = constants["fixed_direction"][row]
        free[at[row]] -= np.outer(direction, direction)
    if (free == np.eye(3)).all():
        return matrix
    inertia = constants["node_mass"][node][:, None, None] * (np.eye(3) - free)
    return _diagonal(free) @ matrix @ _diagonal(free) + _diagonal(inertia)


def _factors(matrix):
    """Return L, unit and lower, in blocks below the diagonal, and the inverse of B: L B L^T.

    Returns
    -------
    start : (n + 1,) int32
        First block of each column of blocks.
    row : (n_blocks,) int32
    blocks : (n_blocks, 3, 3) float64
    inverse : (n, 3, 3) float64, 1/kg
    """
    n = matrix.shape[0] // 3
    factor = splu(matrix.tocsc(), permc_spec="NATURAL", **IN_ORDER)
    lower = factor.L.tobsr(blocksize=(3, 3))
    row = np.repeat(np.arange(n), np.diff(lower.indptr))
    diagonal = lower.data[np.argsort(row != lower.indices, kind="stable")[:n]]
    pivots = factor.U.diagonal().reshape(n, 3)
    inverse = np.linalg.inv(np.einsum("nij,nj,nkj->nik", diagonal, pivots, diagonal))
    below = row > lower.indices
    row, column, blocks = row[below], lower.indices[below], lower.data[below]
    order = np.lexsort((row, column))
    row, column = row[order], column[order]
    blocks = blocks[order] @ np.linalg.inv(diagonal)[column]
    start = np.searchsorted(column, np.arange(n + 1)).astype(np.int32)
    return start, row.astype(np.int32), blocks, inverse
