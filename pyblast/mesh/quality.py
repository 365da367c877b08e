"""Mesh quality: defects, removable blocks, joint spacing, available memory."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy

from ..errors import InputError
from . import hexahedra
from .faces import face_keys, face_vectors, pair_faces, zone_faces, zone_of_face
from .mesh import Mesh, graph_components, zone_edge_lengths, zone_volumes

# Measured memory per zone: gmsh with its mesh, and a structured grid.
MESHING_BYTES, GRID_BYTES = 1900.0, 300.0
LEAST_OUTWARD = 1e-6  # of the area of a free surface, of its sum as vectors, unless it is closed
ZONES_PER_CUBE = 11.0  # zones in a volume of one mean edge cubed
_GROUPS = Path("/sys/fs/cgroup")
_LIMITS = (
    (_GROUPS / "memory.max", _GROUPS / "memory.current"),
    (_GROUPS / "memory/memory.limit_in_bytes", _GROUPS / "memory/memory.usage_in_bytes"),
)


def available() -> float:
    """Return the available memory in bytes, within the limit of a container.

    Infinite if the system gives no information.
    """
    free = [_left(*files) for files in _LIMITS]
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        known = dict(line.split(":", 1) for line in lines if ":" in line)
        free.append(1024.0 * float(known["MemAvailable"].split()[0]))
    except (OSError, KeyError, ValueError):
        free.append(_pages())
    return min(free)


def _left(limit, used):
    """Return the memory left within the limit of a container, infinite without limit."""
    try:
        return float(limit.read_text()) - float(used.read_text())
    except (OSError, ValueError):
        return float("inf")


def _pages():
    """Return the memory of a system without /proc, infinite if unknown."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float("inf")


REMEDY = "longer edges, fewer receivers or a shorter duration"


def refuse_beyond_memory(what: str, needed: float, remedy: str = REMEDY) -> None:
    """Raise InputError if more memory is needed than is available.

    Raises
    ------
    InputError
        With both amounts.
    """
    free = available()
    if needed > free:
        raise InputError(
            f"{what} needs about {needed / 1e9:.3g} GB of memory, the machine has "
            f"{free / 1e9:.3g} GB left; take {remedy}"
        )


def explicit_work(mesh: Mesh) -> float:
    """Return the work in 1/m of an explicit run on hexahedra: nodes over the shortest distance.

    The distance of two neighbours along a line of nodes, under the least stretch of the mapping
    (smallest singular value of its Jacobian), sets the time step. Infinite for inverted zones.
    """
    if mesh.places is None:  # straight edges: the corners have the extremes
        ends = mesh.points[hexahedra.corner_neighbours(mesh.zones)]
        jacobian = 0.5 * (ends[:, 1:] - ends[:, :1]).transpose(0, 2, 1)
    else:
        jacobian = hexahedra.jacobians(mesh.places, mesh.order)
    if not np.linalg.det(jacobian).min() > 0.0:
        return float("inf")
    points, _ = hexahedra.lobatto(mesh.order)
    stretch = least_stretch(jacobian).reshape(len(mesh.zones), -1).min(axis=1)
    return float(len(mesh.zones) * mesh.order**3 / ((points[1] - points[0]) * stretch.min()))


def least_stretch(jacobian: np.ndarray) -> np.ndarray:
    """Return the smallest singular value (...) of matrices (..., 3, 3), to 1e-8 of the largest.

    Notes
    -----
    From the characteristic equation of the symmetric square; Smith (1961), Commun. ACM 4, 168.
    """
    columns = np.moveaxis(jacobian, (-2, -1), (1, 0))
    xx, yy, zz, yz, zx, xy = (
        sum(columns[i, k] * columns[j, k] for k in range(3))
        for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
    )
    mean = (xx + yy + zz) / 3.0
    xx, yy, zz, shear = xx - mean, yy - mean, zz - mean, yz**2 + zx**2 + xy**2
    spread = np.sqrt((xx**2 + yy**2 + zz**2 + 2.0 * shear) / 6.0)
    third = xx * (yy * zz - yz**2) - xy * (xy * zz - yz * zx) + zx * (xy * yz - yy * zx)
    cubed = np.where(spread > 0.0, spread, 1.0) ** 3
    angle = np.arccos(np.clip(0.5 * third / cubed, -1.0, 1.0)) / 3.0
    least = mean + 2.0 * spread * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.sqrt(np.maximum(least, 0.0))


# Smallest volume of a zone over its longest edge cubed, as in gmsh.
_FLAT = 1e-9
_COINCIDENT = 1e-9


@dataclass(frozen=True, eq=False)
class BlockCounts:
    """Blocks of a split mesh: volumes, free surface and removability.

    Parameters
    ----------
    volumes : (n_blocks,) float64, m3
    free : (n_blocks,) bool, touches the free surface
    removable : (n_blocks,) bool
        Touches the free surface and no other side, and can move out in some direction without
        closing any of its joints.
    """

    volumes: np.ndarray
    free: np.ndarray
    removable: np.ndarray


def validate(mesh: Mesh) -> None:
    """Raise InputError for the first defect of a mesh.

    Raises
    ------
    InputError
        For duplicate zones, repeated nodes of a zone, flat or inverted zones, coincident nodes
        without contact, faces of more than two zones, or parts not connected by faces.
    """
    ordered = np.sort(mesh.zones, axis=1)
    _refuse(mesh, (np.diff(ordered, axis=1) == 0).any(axis=1), "name a node twice")
    _, first, counts = np.unique(ordered, axis=0, return_index=True, return_counts=True)
    doubled = np.zeros(len(mesh.zones), dtype=bool)
    doubled[first[counts > 1]] = True
    _refuse(mesh, doubled, "stand in the mesh twice")
    share = zone_volumes(mesh) / zone_edge_lengths(mesh).max(axis=1) ** 3
    _refuse(mesh, np.abs(share) < _FLAT, "are flat")
    _refuse(mesh, share < 0.0, "are inverted (negative volume)")
    excess = np.zeros(len(mesh.zones), dtype=bool)
    excess[zone_of_face(mesh.zones, mesh.paired_faces[3])[0]] = True
    _refuse(mesh, excess, "share a face that two others share already (not manifold)")
    _refuse_coincident(mesh)
    _refuse_parts(mesh)


def _refuse(mesh, wrong, what):
    """Raise InputError with the number of wrong zones and the position of the first."""
    if wrong.any():
        zone = np.argmax(wrong)
        x, y, z = mesh.points[mesh.zones[zone]].mean(axis=0)
        raise InputError(
            f"mesh: {np.count_nonzero(wrong)} zones {what}, the first is zone {zone} of "
            f"{mesh.groups[mesh.zone_group[zone]]!r} at ({x:g}, {y:g}, {z:g}); repair the mesh"
        )


def _welded(mesh):
    """Return one label (n_nodes,) for all copies of a node that was split."""
    if mesh.contacts is None:
        return np.arange(len(mesh.points))
    return graph_components(mesh.contacts.minus, mesh.contacts.plus, len(mesh.points))[1]


def _refuse_coincident(mesh):
    """Raise InputError for coincident nodes that are not a contact."""
    reach = _COINCIDENT * np.ptp(mesh.points, axis=0).max()
    pairs = scipy.spatial.KDTree(mesh.points, leafsize=16).query_pairs(reach, output_type="ndarray")
    label = _welded(mesh)
    pairs = pairs[label[pairs[:, 0]] != label[pairs[:, 1]]]
    if len(pairs):
        x, y, z = mesh.points[pairs[:, 0].min()]
        raise InputError(
            f"mesh: {len(pairs)} pairs of nodes lie at the same place, the first at "
            f"({x:g}, {y:g}, {z:g}); merge them, joints are split later"
        )


def _refuse_parts(mesh):
    """Raise InputError for a disconnected mesh."""
    first, second, _, _ = pair_faces(_welded(mesh)[mesh.zones], len(mesh.points))
    pairs = [zone_of_face(mesh.zones, side)[0] for side in (first, second)]
    count, label = graph_components(pairs[0], pairs[1], len(mesh.zones))
    if count > 1:
        sizes = np.bincount(label)
        x, y, z = mesh.points[mesh.zones[np.argmax(label == np.argmin(sizes))]].mean(axis=0)
        raise InputError(
            f"mesh: falls into {count} parts that share no face, the smallest with {sizes.min()} "
            f"zones at ({x:g}, {y:g}, {z:g}); connect or remove them"
        )


def count_blocks(mesh: Mesh, free: tuple[str, ...] = ("top",)) -> BlockCounts:
    """Return the blocks of a split mesh, with finiteness and removability.

    Parameters
    ----------
    mesh : Mesh, split
    free : sequence of str
        Free outer surfaces; all others are fixed.

    Notes
    -----
    Finiteness and removability after Goodman & Shi (1985): a block is removable when some
    direction has no negative component along any of its joint normals (into the block) and leads
    out through the free surface. Friction and weight are left out.
    """
    block = mesh.blocks()
    count = block.max() + 1
    faces = zone_faces(mesh.zones)
    single = mesh.paired_faces[2]
    owner = block[zone_of_face(mesh.zones, single)[0]]
    keys = face_keys(faces[single], len(mesh.points))
    on_free = np.zeros(len(single), dtype=bool)
    on_held = np.zeros(len(single), dtype=bool)
    joints = () if mesh.contacts is None else mesh.contacts.names
    for name, triangles in mesh.surfaces.items():
        if name not in joints:
            members = np.isin(keys, face_keys(triangles, len(mesh.points)))
            if name in free:
                on_free |= members
            else:
                on_held |= members
    is_free = np.bincount(owner[on_free], minlength=count) > 0
    is_held = np.bincount(owner[on_held], minlength=count) > 0
    removable = np.zeros(count, dtype=bool)
    outward = face_vectors(mesh.points, faces[single])
    for number in np.flatnonzero(is_free & ~is_held):
        mine = owner == number
        removable[number] = _can_leave(outward[mine & ~on_free], outward[mine & on_free])
    return BlockCounts(np.bincount(block, weights=zone_volumes(mesh)), is_free, removable)


def _can_leave(joints, surface):
    """Return whether a block can move out past its joints, outward vectors (n, 3).

    It leaves through its free surface as a whole or, where that looks to all sides, through one
    face of it. A body without joints is no block.
    """
    if not len(joints):
        return False
    joints = np.unique(_directions(joints), axis=0)
    out, size = surface.sum(axis=0), np.linalg.norm(surface, axis=1).sum()
    whole = np.linalg.norm(out) > LEAST_OUTWARD * size
    for direction in _directions(out[None]) if whole else np.unique(_directions(surface), axis=0):
        solution = scipy.optimize.linprog(
            -direction, A_ub=joints, b_ub=np.full(len(joints), 1e-9), bounds=[(-1.0, 1.0)] * 3
        )
        if solution.status == 0 and -solution.fun > 1e-3:
            return True
    return False


def _directions(vectors):
    """Return unit vectors (n, 3), rounded."""
    return (vectors / np.linalg.norm(vectors, axis=1)[:, None]).round(6)
