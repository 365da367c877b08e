"""Edge springs: linear tetrahedra as springs along mesh edges; memory estimate of a run."""

from typing import Any

import numpy as np

from ..core import ZONE_LAWS
from ..mesh.nodes import Nodes
from ..mesh.tetrahedra import EDGES, shape_gradients, volumes
from ..model.model import Model

ALWAYS_USED, BATCH_ONLY = 2, 1  # use of the edges of a set: in all runs, in batches only
MOST_SKEW = 0.7  # fraction of skew edges above which zones are as fast in a single run
ROUNDING = 1e-13
CHUNK = 2**14  # zones whose springs are computed at once
UPPER = np.triu_indices(6)
# Position of component ij among xx yy zz yz zx xy.
PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
EDGE_ARRAYS = (
    "set_form", "edge_start", "edge_slot", "edge_spring", "skew_start", "skew_slot", "skew_spring",
)  # fmt: skip


def edge_arrays(nodes: Nodes, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the edge springs of zones of linear laws; theory.md (2.39), (2.40).

    Parameters
    ----------
    nodes : Nodes
    arrays : dict
        Kernel arrays of domains, zones and laws.

    Returns
    -------
    dict
        Kernel arrays; a set with a nonlinear law, or with different relaxation of shear and
        compression, has no edges and ``set_form`` 0.
    """
    form = np.zeros(len(arrays["set_law"]), dtype=np.int32)
    domain = np.repeat(np.arange(len(arrays["domain_set"])), np.diff(arrays["domain_zone_start"]))
    zone_set, parts = arrays["domain_set"][domain], []
    for number in dict.fromkeys(arrays["domain_set"]):
        if nodes.quadratic or not _linear(arrays, number):
            continue
        zones = np.flatnonzero(zone_set == number)
        ends, springs = _springs(nodes, arrays, number, zones, domain[zones])
        skew = np.abs(springs[:, 6:]).max(axis=1) > ROUNDING * np.abs(springs).max(axis=1)
        form[number] = ALWAYS_USED if skew.mean() <= MOST_SKEW else BATCH_ONLY
        parts.append((ends, springs, skew))
    return {"set_form": form, **_tables(arrays, parts)}


def without_edges(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return kernel arrays without edge springs: zone by zone."""
    form = np.zeros(len(arrays["set_law"]), dtype=np.int32)
    return {**arrays, "set_form": form, **_tables(arrays, [])}


def _linear(arrays, number):
    """Return whether the stress of a set, or its elastic part, is linear in one displacement."""
    law = list(ZONE_LAWS.values())[arrays["set_law"][number]]
    branch = arrays["set_branch"][number]
    return (law.linear or law.yields) and np.array_equal(branch[:, 0], branch[:, 1])


def _springs(nodes, arrays, number, zones, domain):
    """Return ends (n, 2), as slots of the first domain, and springs (n, 9) in N/m.

    Springs: symmetric part xx yy zz yz zx xy, then the axial vector of the skew part.
    """
    start = arrays["domain_slot_start"][domain]
    slot = arrays["zone_slot"].T[zones] + start[:, None]
    ends = np.sort(slot[:, EDGES], axis=2)
    node = arrays["slot_node"]
    first, edge = _distinct(node[ends[..., 0]], node[ends[..., 1]], len(nodes.points))
    ends, springs = ends.reshape(-1, 2)[first], np.zeros((len(first), 9))
    for low in range(0, len(zones), CHUNK):
        part = slice(low, low + CHUNK)
        members, local = np.unique(edge[part], return_inverse=True)
        local = local.reshape(-1, len(EDGES))
        of_zones = _stiffness(nodes, arrays, number, zones[part])
        for e, (a, b) in enumerate(EDGES):
            parts = _parts(of_zones(a, b), slot[part, a] > slot[part, b])
            for k in range(9):
                sums = np.bincount(local[:, e], parts[:, k], minlength=len(members))
                springs[members, k] += sums
    order = np.lexsort(ends.T[::-1])
    return ends[order], springs[order]


def _distinct(first, second, n_nodes):
    """Return the first position of each pair of nodes, and the number (n, 6) int32 of each pair.

    As ``np.unique``, with half of its memory, which is the peak memory of most models.
    """
    keys = first.astype(np.int64).ravel()
    keys *= n_nodes
    keys += second.ravel()
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    new = np.diff(keys, prepend=-1) > 0
    del keys
    edge = np.empty(len(order), dtype=np.int32)
    edge[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    return order[new], edge.reshape(first.shape)


def _stiffness(nodes, arrays, number, zones):
    """Return the stiffness blocks (n, 3, 3) of zones in N/m, as a function of two corners."""
    corners = nodes.zone_nodes[zones]
    volume = volumes(nodes.points, corners)
    inner = shape_gradients(nodes.points, corners)
    gradient = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    lame, shear = (volume * arrays[name][zones] for name in ("zone_lambda", "zone_shear"))
    lame = np.where(arrays["zone_patch"][zones] < 0, lame, -2.0 / 3.0 * shear)
    anisotropic = arrays["set_law"][number] == ZONE_LAWS["anisotropic"].number
    if anisotropic:
        six = np.zeros((6, 6))
        six[UPPER] = arrays["set_property"][number][:21]
        six = six + np.triu(six, 1).T
        elasticity = six[PLACE[:, :, None, None], PLACE]

    def block(a, b):
        first, second = gradient[:, a], gradient[:, b]
        if anisotropic:
            return np.einsum("z,ijkl,zj,zl->zik", shear, elasticity, first, second, optimize=True)
        cross = first[:, :, None] * second[:, None, :]
        total = lame[:, None, None] * cross + shear[:, None, None] * cross.transpose(0, 2, 1)
        total[:, range(3), range(3)] += (shear * np.einsum("zi,zi->z", first, second))[:, None]
        return total

    return block


def _parts(blocks, turned):
    """Return the negative blocks as nine values: symmetric part, axial vector of the rest."""
    x, y, z = range(3)
    mean = -0.5 * (blocks + blocks.transpose(0, 2, 1))
    skew = -0.5 * (blocks - blocks.transpose(0, 2, 1))
    skew[turned] *= -1.0
    even = [mean[:, i, j] for i, j in ((x, x), (y, y), (z, z), (y, z), (z, x), (x, y))]
    return np.stack([*even, skew[:, z, y], skew[:, x, z], skew[:, y, x]], axis=1)


def _tables(arrays, parts):
    """Return the edges sorted by slot, and those with a skew part by domain."""
    none = (np.zeros((0, 2), dtype=np.int64), np.zeros((0, 9)), np.zeros(0, dtype=bool))
    ends, springs, skew = (np.concatenate(part) for part in zip(none, *parts, strict=True))
    start = arrays["domain_slot_start"]
    domain = np.searchsorted(start, ends[:, 0], side="right") - 1
    within = (ends - start[domain][:, None]).astype(np.int32)
    count = np.arange(len(arrays["slot_node"]) + 1)
    return {
        "edge_start": np.searchsorted(ends[:, 0], count).astype(np.int32),
        "edge_slot": np.ascontiguousarray(within[:, 1]),
        "edge_spring": np.ascontiguousarray(springs[:, :6]),
        "skew_start": np.searchsorted(domain[skew], np.arange(len(start))).astype(np.int32),
        "skew_slot": within[skew],
        "skew_spring": np.ascontiguousarray(springs[skew, 6:]),
    }


# Measured bytes per zone, node and contact: during the numbering of edges, the computation of
# springs, that of patches, and during the run; below, additional bytes of plastic zones and of
# relaxing nodes.
NUMBERED, SPRINGS = np.array([275.0, 850.0, 0.0]), np.array([215.0, 340.0, 0.0])
PATCHES = np.array([580.0, 380.0, 0.0])
WITHOUT_SPRINGS = 385.0  # of a zone without springs
HELD, HELD_QUADRATIC = np.array([115.0, 860.0, 280.0]), np.array([390.0, 445.0, 490.0])
YIELDING, YIELDING_HELD, RELAXING = 90.0, 340.0, 65.0  # per zone; per node and further rate
STATIC, STATIC_SPRINGS = 40.0, 175.0  # of each zone; with springs of its own where ground relaxes
ALWAYS, SHARED = 3e5, 512.0  # fixed; per zone of a chunk
SAMPLE_BYTES = 100.0  # per receiver and step
HISTORY_BYTES = 25.0  # per load history and step


def run_bytes(model: Model, n_samples: int = 0, n_loaded: int = 0) -> float:
    """Return the memory estimate of a run, without its mesh, in bytes.

    Parameters
    ----------
    model : Model
    n_samples : int
        Steps times receivers.
    n_loaded : int
        Steps times histories of loads.

    Notes
    -----
    Models of linear zones need most during the assembly of springs, others during the run.
    """
    nodes = model.nodes
    n_contacts = 0 if nodes.contacts is None else len(nodes.contacts.area)
    counts = np.array([len(nodes.zone_nodes), len(nodes.points), n_contacts])
    n_yielding = np.count_nonzero(model.yielding())
    rates = {branch.rate for group in model.mesh.groups for branch in model.branches(group)}
    held = held_bytes(counts, nodes.quadratic, len(rates), n_yielding)
    total = ALWAYS + (
        held if nodes.quadratic else max(held, _assembly_bytes(model, counts, n_yielding))
    )
    return float(total) + SAMPLE_BYTES * n_samples + HISTORY_BYTES * n_loaded


def held_bytes(counts: np.ndarray, quadratic: bool, n_rates: int, n_yielding: float) -> float:
    """Return what a run holds in bytes.

    Parameters
    ----------
    counts : (3,) float64
        Of zones, nodes, contacts.
    quadratic : bool
        Whether zones are of order 2 or higher.
    n_rates : int
        Of relaxation.
    n_yielding : float
        Zones that may yield.
    """
    held = (HELD_QUADRATIC if quadratic else HELD) @ counts + YIELDING_HELD * n_yielding
    return float(held + RELAXING * counts[1] * max(0, n_rates - 1))


def _assembly_bytes(model, counts, n_yielding):
    """Return the peak memory of the assembly of linear zones in bytes."""
    peak = WITHOUT_SPRINGS * counts[0]
    if any(_has_springs(model, group) for group in model.mesh.groups):
        shared = SHARED * min(counts[0], CHUNK)
        springs = max(NUMBERED @ counts, SPRINGS @ counts + shared)
        peak = max(peak, springs + YIELDING * n_yielding)
    if n_yielding:
        peak = max(peak, PATCHES @ counts * n_yielding / counts[0])
    relaxes = any(model.branches(group) for group in model.mesh.groups)
    static = STATIC + STATIC_SPRINGS * relaxes if model.insitu is not None else 0.0
    return peak + static * counts[0]


def _has_springs(model, group):
    """Return whether the zones of a group become springs."""
    equal = all(branch.shear == branch.compression for branch in model.branches(group))
    law = ZONE_LAWS[model.law(group).name]
    return equal and (law.linear or law.yields)


def common_edges(constants):
    """Return the constants of models, without edge springs if these differ."""
    same = all(
        np.array_equal(constants[0][name], each[name]) for each in constants for name in EDGE_ARRAYS
    )
    return constants if same else [without_edges(each) for each in constants]
