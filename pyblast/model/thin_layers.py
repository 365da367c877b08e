"""Thin layers: how wide hexahedra of soil may be beside those of the rock beneath."""

import numpy as np
from scipy.spatial import KDTree

from ..mesh.mesh import Mesh, graph_components, zone_edge_lengths, zone_volumes
from .material import ConstantQ, Material

# Edges of thin ground over those of the rock beneath, by the periods in which an S wave passes it.
WIDTHS = {0.25: 1.0, 1.0: 0.5}
DECAYS = 3.0  # times 4QH/pi, beyond which trapped waves count no more


def share_of_edge(periods: float, beyond: bool = False) -> float:
    """Return how wide thin ground may be, as a share of the edges of the rock beneath; zero: not.

    Parameters
    ----------
    periods : float
        In which an S wave passes it, at the highest frequency.
    beyond : bool
        Whether all receivers stand beyond its trapped waves (`reach_of_trapped_waves`).

    Notes
    -----
    Ground that an S wave of the highest frequency passes within a quarter of its period moves with
    the rock. Up to a period it traps waves that are shorter than those of the rock and die away
    within a few thicknesses times Q: decisions.md has the errors by width.

    Examples
    --------
    >>> [share_of_edge(periods) for periods in (0.2, 0.5, 1.5)]
    [1.0, 0.5, 0.0]
    >>> share_of_edge(0.5, beyond=True)
    1.0
    """
    share = next((share for most, share in WIDTHS.items() if periods <= most), 0.0)
    return max(WIDTHS.values()) if beyond and share else share


def reach_of_trapped_waves(thickness: float, grounds: list[Material]) -> float:
    """Return the distance in m from sources at which waves trapped by thin layers have died away.

    Parameters
    ----------
    thickness : float, m
        Of all layers.
    grounds : list of Material
        Of the layers.

    Notes
    -----
    At their lowest frequency cs/4H they decay as exp(-pi r / (4 Q H)). Infinite in elastic ground.
    """
    laws = [ground.law for ground in grounds]
    quality = max(law.qs if isinstance(law, ConstantQ) else np.inf for law in laws)
    return DECAYS * 4.0 * quality * thickness / np.pi


def nearest_receiver(sources: list[np.ndarray], receivers: list[np.ndarray]) -> float:
    """Return the least horizontal distance in m of sources and receivers, zero without either."""
    if not len(sources) or not len(receivers):
        return 0.0
    starts, ends = (np.array([each[:2] for each in part], float) for part in (sources, receivers))
    return float(KDTree(starts).query(ends)[0].min())


def carried_by_thin_layers(
    mesh: Mesh, grounds: dict[str, Material], edges_per_wavelength: float, away: float = 0.0
) -> dict[str, float]:
    """Return the highest frequency in Hz that flat hexahedra of thin layers at the top carry.

    Parameters
    ----------
    mesh : Mesh
    grounds : dict of str to Material
        By group.
    edges_per_wavelength : float
        Of zones as wide as high.
    away : float, m
        Least distance of receivers from sources.

    Notes
    -----
    The highest frequency whose rule of widths the zones obey, and whose waves along the upright
    edges they resolve. Groups whose zones do not lie in layers have none.
    """
    if not mesh.hexahedral:
        return {}
    order, carried = _from_the_top(mesh), {}
    lengths, volumes = zone_edge_lengths(mesh), zone_volumes(mesh)
    crossing = thickness = 0.0
    for count, number in enumerate(order[:-1], start=1):
        height = _thickness(mesh, number)
        if height is None:
            break
        thickness += height
        crossing += height / grounds[mesh.groups[number]].cs
        slowest = min(grounds[mesh.groups[below]].cs for below in order[count:])
        names = [mesh.groups[above] for above in order[:count]]
        beyond = away > reach_of_trapped_waves(thickness, [grounds[name] for name in names])
        for name in names:
            own = mesh.zone_group == mesh.groups.index(name)
            wide, high = (
                np.average(edge[own], weights=volumes[own])
                for edge in (lengths.max(axis=1), lengths.min(axis=1))
            )
            across = slowest / (edges_per_wavelength * wide)
            along = max(
                min(share_of_edge(most, beyond) * across, most / crossing) for most in WIDTHS
            )
            upright = grounds[name].cs / (edges_per_wavelength * high)
            carried[name] = max(carried.get(name, 0.0), float(min(along, upright)))
    return carried


def _from_the_top(mesh):
    """Return the numbers of the groups of a mesh, the highest ground first."""
    middle = mesh.points[mesh.zones, 2].mean(axis=1)
    count = np.bincount(mesh.zone_group, minlength=len(mesh.groups))
    heights = np.bincount(mesh.zone_group, middle, minlength=len(mesh.groups))
    return np.argsort(-heights / np.maximum(count, 1), kind="stable")


def _thickness(mesh, number):
    """Return the largest thickness in m of a group over its lines of corners from foot to top.

    None where these have not the same number of corners: zones are not in layers then.
    """
    zones = mesh.zones[mesh.zone_group == number]
    if not len(zones):
        return None
    corner = np.arange(8)
    lower = np.array([corner[corner >> axis & 1 == 0] for axis in range(3)])  # ends of edges
    ends = zones[:, lower], zones[:, lower + (1 << np.arange(3))[:, None]]
    along = (mesh.points[ends[1]] - mesh.points[ends[0]]).mean(axis=2)
    up = np.argmax(np.abs(along[..., 2]) / np.linalg.norm(along, axis=-1), axis=1)
    first, second = (end[np.arange(len(zones)), up].ravel() for end in ends)
    _, line = graph_components(first, second, len(mesh.points))
    node, line = np.unique(zones), line[np.unique(zones)]
    _, line, count = np.unique(line, return_inverse=True, return_counts=True)
    if np.ptp(count):
        return None
    low, high = np.full(len(count), np.inf), np.full(len(count), -np.inf)
    np.minimum.at(low, line, mesh.points[node, 2])
    np.maximum.at(high, line, mesh.points[node, 2])
    return float((high - low).max())
