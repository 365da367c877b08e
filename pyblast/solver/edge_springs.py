"""Edge springs: linear tetrahedra of one material as springs along mesh edges; memory estimate."""

from typing import Any

import numpy as np

from ..core import ZONE_LAWS
from ..mesh.nodes import Nodes
from ..mesh.tetrahedra import EDGES, shape_gradients, volumes
from ..model.model import Model

ALONE, SIDE_BY_SIDE = 2, 1  # where the edges of a set are used: in all marches, in batches only
MOST_SKEW = 0.7  # share of skew edges beyond which zones are as fast in a single run
LINEAR = ("elastic", "anisotropic", "mohr-coulomb")  # stress or its elastic part
ROUNDING = 1e-13
TOGETHER = 2**14  # zones whose springs are found at once
UPPER = np.triu_indices(6)
# Place of a stress or strain xy among xx yy zz yz zx xy.
PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
EDGE_ARRAYS = (
    "set_form", "edge_start", "edge_slot", "edge_spring", "skew_start", "skew_slot", "skew_spring",
)  # fmt: skip


def edge_arrays(nodes: Nodes, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Turn the zones of linear sets into springs along edges; theory.md (2.39), (2.40).

    Parameters
    ----------
    nodes : Nodes
    arrays : dict
        Kernel arrays of domains, zones and laws.

    Returns
    -------
    dict
        Kernel arrays; where a set is not linear, or its shear and its compression relax
        differently, it has no edges and its ``set_form`` is 0.
    """
    form = np.zeros(len(arrays["set_law"]), dtype=np.int32)
    domain = np.repeat(np.arange(len(arrays["domain_set"])), np.diff(arrays["domain_zone_start"]))
    own, found = arrays["domain_set"][domain], []
    for number in dict.fromkeys(arrays["domain_set"]):
        if nodes.quadratic or not _linear(arrays, number):
            continue
        zones = np.flatnonzero(own == number)
        ends, springs = _springs(nodes, arrays, number, zones, domain[zones])
        skew = np.abs(springs[:, 6:]).max(axis=1) > ROUNDING * np.abs(springs).max(axis=1)
        form[number] = ALONE if skew.mean() <= MOST_SKEW else SIDE_BY_SIDE
        found.append((ends, springs, skew))
    return {"set_form": form, **_tables(arrays, found)}


def without_edges(arrays: dict[str, Any]) -> dict[str, Any]:
    """Return kernel arrays whose zones are all computed by themselves."""
    form = np.zeros(len(arrays["set_law"]), dtype=np.int32)
    return {**arrays, "set_form": form, **_tables(arrays, [])}


def _linear(arrays, number):
    """Tell whether the stress of a set is linear in one field of motion."""
    law = list(ZONE_LAWS.values())[arrays["set_law"][number]]
    branch = arrays["set_branch"][number]
    return law.name in LINEAR and np.array_equal(branch[:, 0], branch[:, 1])


def _springs(nodes, arrays, number, zones, domain):
    """Return ends (n, 2), slots of the first domain that has them, and springs (n, 9) in N/m.

    Springs: symmetric xx yy zz yz zx xy, then the vector of the skew part.
    """
    start = arrays["domain_slot_start"][domain]
    slot = arrays["zone_slot"].T[zones] + start[:, None]
    ends = np.sort(slot[:, EDGES], axis=2)
    node = arrays["slot_node"]
    first, edge = _distinct(node[ends[..., 0]], node[ends[..., 1]], len(nodes.points))
    ends, springs = ends.reshape(-1, 2)[first], np.zeros((len(first), 9))
    for low in range(0, len(zones), TOGETHER):
        some = slice(low, low + TOGETHER)
        there, local = np.unique(edge[some], return_inverse=True)
        local = local.reshape(-1, len(EDGES))
        of_zones = _stiffness(nodes, arrays, number, zones[some])
        for e, (a, b) in enumerate(EDGES):
            parts = _parts(of_zones(a, b), slot[some, a] > slot[some, b])
            for k in range(9):
                springs[there, k] += np.bincount(local[:, e], parts[:, k], minlength=len(there))
    order = np.lexsort(ends.T[::-1])
    return ends[order], springs[order]


def _distinct(one, other, n_nodes):
    """Return where each pair of nodes stands first, and the number (n, 6) int32 of each pair.

    What ``np.unique`` finds, in half its memory, which here is most of what a model ever takes.
    """
    keys = one.astype(np.int64).ravel()
    keys *= n_nodes
    keys += other.ravel()
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    new = np.diff(keys, prepend=-1) > 0
    del keys
    edge = np.empty(len(order), dtype=np.int32)
    edge[order] = np.cumsum(new, dtype=np.int32) - np.int32(1)
    return order[new], edge.reshape(one.shape)


def _stiffness(nodes, arrays, number, zones):
    """Return a function of two corners that gives the blocks (n, 3, 3) of zones in N/m."""
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
        one, other = gradient[:, a], gradient[:, b]
        if anisotropic:
            return np.einsum("z,ijkl,zj,zl->zik", shear, elasticity, one, other, optimize=True)
        cross = one[:, :, None] * other[:, None, :]
        both = lame[:, None, None] * cross + shear[:, None, None] * cross.transpose(0, 2, 1)
        both[:, range(3), range(3)] += (shear * np.einsum("zi,zi->z", one, other))[:, None]
        return both

    return block


def _parts(blocks, turned):
    """Return minus the blocks as nine values: symmetric part and vector of the skew part."""
    x, y, z = range(3)
    mean = -0.5 * (blocks + blocks.transpose(0, 2, 1))
    skew = -0.5 * (blocks - blocks.transpose(0, 2, 1))
    skew[turned] *= -1.0
    even = [mean[:, i, j] for i, j in ((x, x), (y, y), (z, z), (y, z), (z, x), (x, y))]
    return np.stack([*even, skew[:, z, y], skew[:, x, z], skew[:, y, x]], axis=1)


def _tables(arrays, found):
    """Return edges in the order of their slots, and those with a skew part by domain."""
    none = (np.zeros((0, 2), dtype=np.int64), np.zeros((0, 9)), np.zeros(0, dtype=bool))
    ends, springs, skew = (np.concatenate(part) for part in zip(none, *found, strict=True))
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


# Measured: bytes for a zone, a node, a contact, while edges are numbered, while their springs are
# made, while patches are, and while a model marches; beside them what zones and nodes take that
# remember.
NUMBERED, SPRINGS = np.array([275.0, 850.0, 0.0]), np.array([215.0, 340.0, 0.0])
PATCHES = np.array([580.0, 380.0, 0.0])
WITHOUT_SPRINGS = 385.0  # of a zone that has no springs
HELD, HELD_QUADRATIC = np.array([115.0, 860.0, 280.0]), np.array([350.0, 445.0, 490.0])
YIELDING, YIELDING_HELD, RELAXING = 90.0, 340.0, 75.0  # each zone; node and further rate
STATIC = 215.0  # of each zone: springs of the static stage are made beside those that stay
ALWAYS, SHARED = 3e5, 512.0  # the latter of each of the zones whose springs are made together
SAMPLE_BYTES = 100.0  # of a receiver and step
HISTORY_BYTES = 25.0  # of a load's history and step


def marching_bytes(model: Model, n_samples: int = 0, n_loaded: int = 0) -> float:
    """Return what assembly and march of a model take beside its mesh, bytes.

    Parameters
    ----------
    model : Model
    n_samples : int
        Steps times receivers.
    n_loaded : int
        Steps times histories of loads.

    Notes
    -----
    Constant-strain zones take most while springs are made of them, others while they march.
    """
    nodes = model.nodes
    n_contacts = 0 if nodes.contacts is None else len(nodes.contacts.area)
    counts = np.array([len(nodes.zone_nodes), len(nodes.points), n_contacts])
    n_yielding = np.count_nonzero(model.yielding())
    rates = {one.rate for group in model.mesh.groups for one in model.branches(group)}
    held = (HELD_QUADRATIC if nodes.quadratic else HELD) @ counts + YIELDING_HELD * n_yielding
    held += RELAXING * len(nodes.points) * max(0, len(rates) - 1)
    own = ALWAYS + (held if nodes.quadratic else max(held, _made(model, counts, n_yielding)))
    return float(own) + SAMPLE_BYTES * n_samples + HISTORY_BYTES * n_loaded


def _made(model, counts, n_yielding):
    """Return the most that constant-strain zones take while they are turned into arrays, bytes."""
    made = WITHOUT_SPRINGS * counts[0]
    if any(_has_springs(model, group) for group in model.mesh.groups):
        shared = SHARED * min(counts[0], TOGETHER)
        most = max(NUMBERED @ counts, SPRINGS @ counts + shared)
        made = max(made, most + YIELDING * n_yielding)
    if n_yielding:
        made = max(made, PATCHES @ counts * n_yielding / counts[0])
    return made + (STATIC * counts[0] if model.insitu is not None else 0.0)


def _has_springs(model, group):
    """Tell whether the zones of a group are made into springs."""
    alike = all(one.shear == one.compression for one in model.branches(group))
    return alike and model.law(group).name in LINEAR
