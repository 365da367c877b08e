"""Thin layers: how wide hexahedra of soil may be beside those of the rock beneath."""

import numpy as np

from ..mesh.mesh import Mesh, zone_edge_lengths, zone_volumes

# Edges of thin ground over those of the rock beneath, by the periods in which an S wave passes it.
WIDTHS = {0.25: 1.0, 1.0: 0.5}


def share_of_edge(periods: float) -> float:
    """Return how wide thin ground may be, as a share of the edges of the rock beneath; zero: not.

    Notes
    -----
    Ground that an S wave of the highest frequency passes within a quarter of its period moves with
    the rock. Up to a period it traps waves that are shorter than those of the rock and die away
    within a few thicknesses times Q: decisions.md has the errors by width.

    Examples
    --------
    >>> [share_of_edge(periods) for periods in (0.2, 0.5, 1.5)]
    [1.0, 0.5, 0.0]
    """
    return next((share for most, share in WIDTHS.items() if periods <= most), 0.0)


def carried_by_thin_layers(
    mesh: Mesh, speeds: dict[str, float], edges_per_wavelength: float
) -> dict[str, float]:
    """Return the highest frequency in Hz that flat hexahedra of thin layers at the top carry.

    Parameters
    ----------
    mesh : Mesh
    speeds : dict of str to float, m/s
        S speed by group.
    edges_per_wavelength : float
        Of zones as wide as high.

    Notes
    -----
    The highest frequency whose rule of widths the zones obey, and whose waves along the upright
    edges they resolve. Groups whose nodes do not stand above one another have none.
    """
    if not mesh.hexahedral:
        return {}
    order, carried = _from_the_top(mesh), {}
    lengths, volumes = zone_edge_lengths(mesh), zone_volumes(mesh)
    crossing = 0.0
    for count, number in enumerate(order[:-1], start=1):
        height = _thickness(mesh, number)
        if height is None:
            break
        crossing += height / speeds[mesh.groups[number]]
        slowest = min(speeds[mesh.groups[below]] for below in order[count:])
        for name in (mesh.groups[above] for above in order[:count]):
            own = mesh.zone_group == mesh.groups.index(name)
            wide, high = (
                np.average(edge[own], weights=volumes[own])
                for edge in (lengths.max(axis=1), lengths.min(axis=1))
            )
            across = slowest / (edges_per_wavelength * wide)
            along = max(min(share * across, most / crossing) for most, share in WIDTHS.items())
            upright = speeds[name] / (edges_per_wavelength * high)
            carried[name] = max(carried.get(name, 0.0), float(min(along, upright)))
    return carried


def _from_the_top(mesh):
    """Return the numbers of the groups of a mesh, the highest ground first."""
    middle = mesh.points[mesh.zones, 2].mean(axis=1)
    count = np.bincount(mesh.zone_group, minlength=len(mesh.groups))
    heights = np.bincount(mesh.zone_group, middle, minlength=len(mesh.groups))
    return np.argsort(-heights / np.maximum(count, 1), kind="stable")


def _thickness(mesh, number):
    """Return the largest thickness in m of a group over its upright lines, None without these."""
    node = np.unique(mesh.zones[mesh.zone_group == number])
    if not len(node):
        return None
    x, y, z = mesh.points[node].T
    reach = 1e-7 * np.ptp(mesh.points, axis=0).max()
    position = np.round(x / reach) + 1j * np.round(y / reach)
    _, line = np.unique(position, return_inverse=True)
    low, high = np.full(line.max() + 1, np.inf), np.full(line.max() + 1, -np.inf)
    np.minimum.at(low, line, z)
    np.maximum.at(high, line, z)
    thick = high - low
    return float(thick.max()) if thick.min() > 0.0 else None
