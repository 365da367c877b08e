"""Line-implicit layers: thin layers of hexahedra, implicit along their lines of nodes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..mesh import hexahedra
from ..mesh.mesh import Mesh
from ..model.material import Material
from ..model.model import Model
from .hexahedra import ACROSS, in_layer, layer_lags, without_layer
from .implicit_zones import cluster_arrays, clusters_of, moved_nodes, no_implicit_zones

WEIGHT = 2.0  # of the stiffness along lines, over that of the trapezoidal rule
SHARE = 0.7  # of the mass of line-implicit zones, for their stiffness across the lines
NODE_COST = 0.5  # of a line's node over that of an explicit zone's node, in a step
LEAST_GAIN = 1.3  # of the cost of a run, for a layer to become implicit
MOST_NODES = 200  # in one line
APART = 2.0  # step of other zones of a group over that of its flat ones, for these to be a part


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of nodes across thin zones, with the part of the stiffness that acts along them.

    Parameters
    ----------
    nodes : (n, order + 1) int
        One row for each line of a zone.
    stiffness : (n, order + 1, 3, order + 1, 3) float64, N/m
        At unrelaxed moduli.
    lag : (n,) float64, s
        Viscosity over stiffness.
    """

    nodes: np.ndarray
    stiffness: np.ndarray
    lag: np.ndarray


def largest_on_line(order: int) -> float:
    """Return the largest eigenvalue of a line of Gauss-Lobatto nodes on [-1, 1] of unit ground.

    An infinite row of such elements has the same.

    Examples
    --------
    >>> [round(largest_on_line(order), 1) for order in (3, 4, 5)]
    [18.6, 45.8, 98.0]
    """
    _, weight = hexahedra.lobatto(order)
    slope = hexahedra.slopes_on_line(order)
    stiffness = np.einsum("qa,q,qb->ab", slope, weight, slope)
    root = np.sqrt(weight)
    return float(np.linalg.eigvalsh(stiffness / np.outer(root, root))[-1])


def _gradients(mesh, zones=slice(None)):
    """Return the lengths (n, 3) of the gradients of the coordinates of zones in 1/m, the most."""
    if mesh.places is None:  # straight edges: the corners have the extremes
        jacobian = hexahedra.jacobians(mesh.points[mesh.zones[zones]], 1)
    else:
        jacobian = hexahedra.jacobians(mesh.places[zones], mesh.order)
    return np.linalg.norm(np.linalg.inv(jacobian), axis=-1).max(axis=1)


def steps_of_zones(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return the bounds `steps_of_gradients` of all zones of a model, (n_zones,) s."""
    moduli, density = model.stiffest_moduli(), model.zone_values("density")
    return steps_of_gradients(_gradients(model.mesh), moduli, density, model.mesh.order)


def steps_of_gradients(
    gradients: np.ndarray, moduli: tuple[np.ndarray, np.ndarray], density: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return bounds of the critical step of zones alone, explicit and line-implicit, (n,) s.

    Without damping; exact for no zone, safe for bricks: theory.md (2.57).

    Parameters
    ----------
    gradients : (n, 3) float64, 1/m
        Lengths of the gradients of the coordinates, two over the edges of bricks.
    moduli : tuple of 2 (n,) float64, Pa
        Lame moduli.
    density : (n,) float64, kg/m3
    order : int

    Examples
    --------
    >>> cube, speeds = np.full((1, 3), 2.0 / 10.0), (np.array([1e10]), np.array([1e10]))
    >>> [round(1e3 * float(step[0]), 3) for step in steps_of_gradients(cube, speeds, 2500.0, 4)]
    [0.246, 0.154]
    """
    lame, shear = moduli
    squares = np.sort(gradients**2, axis=1) * largest_on_line(order)
    whole = (lame + 2.0 * shear) / density * squares.sum(axis=1)
    across = 2.0 * WEIGHT * (lame + shear) / density * squares[:, :2].sum(axis=1)
    return 2.0 / np.sqrt(whole), 2.0 / np.sqrt(across / SHARE)


def work_of_ground(
    mesh: Mesh, grounds: dict[str, Material], whole: Callable[[np.ndarray], bool]
) -> float:
    """Return the work of a run in 1/s: nodes over the step, which line-implicit layers do not set.

    Parameters
    ----------
    mesh : Mesh
        Hexahedra, not split.
    grounds : dict of str to Material
        By group.
    whole : callable
        ``(numbers of groups) -> bool``: whether lines across these serve.
    """
    rocks = [grounds[name] for name in mesh.groups]
    bounds = steps_of_gradients(
        _gradients(mesh), moduli_of(rocks)[:, mesh.zone_group],
        np.array([rock.density for rock in rocks])[mesh.zone_group], mesh.order,
    )  # fmt: skip
    part, group = parts_of_groups(bounds, mesh.zone_group)
    least, count = least_of_parts(bounds, part), np.bincount(part)
    chosen = line_parts(*least, count, lambda more: whole(group[more]))
    more = 1.0 + NODE_COST * count[chosen].sum() / count.sum()
    return more * len(mesh.zones) * mesh.order**3 / step_with_lines(least, chosen)


def moduli_of(rocks: Sequence[Material]) -> np.ndarray:
    """Return the stiffest Lame moduli (2, n) in Pa of grounds, as far as their Q changes them."""
    stiff = [1.0 + sum(branch.compression for branch in rock.law.branches) for rock in rocks]
    return np.array([rock.law.moduli(rock) for rock in rocks]).T * stiff


def step_with_lines(least: np.ndarray, chosen: np.ndarray) -> float:
    """Return the least step in s of parts of ground of which some are line-implicit.

    ``least`` (2, n_parts) are those of `line_parts`, ``chosen`` (n_parts,) bool.
    """
    return float(min(least[0][~chosen].min(), least[1][chosen].min(initial=np.inf)))


def least_of_parts(bounds: Sequence[np.ndarray], part: np.ndarray) -> np.ndarray:
    """Return the least (2, n_parts) of two bounds (n_zones,) of zones by their parts."""
    least = np.full((2, int(part.max()) + 1), np.inf)
    for row, steps in zip(least, bounds, strict=True):
        np.minimum.at(row, part, steps)
    return least


def parts_of_groups(
    bounds: tuple[np.ndarray, np.ndarray], group: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts (n_zones,) that are line-implicit as a whole, and their groups (n_parts,).

    A group is one part. Its zones that gain by lines are another where they are so much flatter
    than the rest, such as rock beside a fill, that their step is less than half.

    Parameters
    ----------
    bounds : tuple of 2 (n_zones,) float64, s
        Of `steps_of_gradients`.
    group : (n_zones,) int

    Examples
    --------
    >>> bounds = np.array([1.0, 5.0, 5.0]), np.array([9.0, 2.0, 9.0])
    >>> [part.tolist() for part in parts_of_groups(bounds, np.array([0, 0, 1]))]
    [[2, 0, 1], [0, 1, 0]]
    """
    flat, count = bounds[1] > bounds[0], int(group.max()) + 1
    least = np.full((2, count), np.inf)
    np.minimum.at(least, (flat.astype(int), group), bounds[0])
    apart = np.isfinite(least).all(axis=0) & (least[0] > APART * least[1])
    owner, part = np.unique(group + count * (flat & apart[group]), return_inverse=True)
    return part, owner % count


def line_zones(model: Model, bounds: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """Return which zones a run takes implicitly along their lines, (n_zones,) bool.

    ``bounds`` are the `steps_of_zones`.
    """
    part, _ = parts_of_groups(bounds, model.mesh.zone_group)
    least, count = least_of_parts(bounds, part), np.bincount(part)
    return line_parts(*least, count, lambda chosen: _upright(model, chosen[part]))[part]


def line_parts(
    explicit: np.ndarray,
    implicit: np.ndarray,
    count: np.ndarray,
    upright: Callable[[np.ndarray], bool],
) -> np.ndarray:
    """Return which parts a run takes implicitly along their lines of nodes, (n_parts,) bool.

    Those without which the step is so much longer that the run is cheaper by `LEAST_GAIN`: none in
    most grounds.

    Parameters
    ----------
    explicit, implicit : (n_parts,) float64, s
        Least steps of `steps_of_gradients`.
    count : (n_parts,) int
        Zones.
    upright : callable
        ``(parts) -> bool``: whether lines across these serve.
    """
    best, chosen = explicit.min() / LEAST_GAIN, np.zeros(len(count), dtype=bool)
    for number in np.argsort(explicit)[:-1]:
        more = chosen.copy()
        more[number] = True
        step = step_with_lines(np.array([explicit, implicit]), more)
        gain = step / (1.0 + NODE_COST * count[more].sum() / count.sum())
        if gain <= best or not upright(more):
            break
        best, chosen = gain, more
    return chosen


def _upright(model, zones):
    """Return whether lines of nodes across zones stand apart, are free and see one stretch."""
    nodes = _line_nodes(model, zones)[0]
    if moved_nodes(model)[nodes].any():
        return False
    if np.bincount(clusters_of(nodes)[2]).max() > MOST_NODES:
        return False
    layer = model.mesh.layer
    if layer is None or not in_layer(model)[zones].any():
        return True
    return bool(np.ptp(layer.depths(model.spectral.points[nodes]), axis=1).max() <= ACROSS)


def _line_nodes(model, zones):
    """Return the nodes (n, order + 1) of lines across zones, and what turns each zone to them.

    Namely the numbers (n_zones, n) of its nodes, line after line, and its thin axis (n_zones,).
    """
    size = model.mesh.order + 1
    thin = _gradients(model.mesh, zones).argmax(axis=1)
    number = np.arange(size**3).reshape(size, size, size)
    turns = np.array([np.moveaxis(number, 2 - axis, 2).ravel() for axis in range(3)])[thin]
    nodes = np.take_along_axis(model.spectral.zone_nodes[zones], turns, axis=1)
    return nodes.reshape(-1, size), turns, thin


def node_lines(model: Model, zones: np.ndarray) -> Lines:
    """Return the lines of nodes across zones, with the stiffness along them.

    Parameters
    ----------
    model : Model
    zones : (n_zones,) bool

    Notes
    -----
    Of the gradient of a motion, the part along the coordinate t of the line:
    ``integral of (l_a' l_b') [(lambda + mu) g g^T + mu |g|^2 1]`` with g = grad t;
    theory.md (2.55).
    """
    numbers, size = np.flatnonzero(zones), model.mesh.order + 1
    nodes, turns, thin = _line_nodes(model, zones)
    inverse = np.linalg.inv(model.spectral.jacobian[numbers])
    along = np.take_along_axis(inverse, thin[:, None, None, None], axis=2)[:, :, 0]
    lame, shear = _moduli(model, numbers)
    acoustic = np.einsum("zq,zqi,zqj->zqij", lame + shear, along, along)
    acoustic += np.einsum("zq,zqk,zqk,ij->zqij", shear, along, along, np.eye(3))
    acoustic *= model.spectral.volumes[numbers][..., None, None]
    acoustic = np.take_along_axis(acoustic, turns[..., None, None], axis=1)
    slope = hexahedra.slopes_on_line(model.mesh.order)
    stiffness = np.einsum(
        "nqij,qa,qb->naibj", acoustic.reshape(-1, size, 3, 3), slope, slope, optimize=True
    )
    lag = layer_lags(model, numbers) + model.zone_damping("beta")[numbers]
    return Lines(nodes, stiffness, np.repeat(lag, size * size))


def _moduli(model, zones):
    """Return the unrelaxed Lame moduli (n, n_nodes) at the nodes of zones, in Pa."""
    relaxed, stiffest = model.zone_moduli(), model.stiffest_moduli()
    lame, shear = (values[zones] for values in model.node_moduli())
    of_s = (stiffest[1] / relaxed[1])[zones, None]
    of_p = (stiffest[0] + 2.0 * stiffest[1]) / (relaxed[0] + 2.0 * relaxed[1])
    of_p = of_p[zones, None] * (lame + 2.0 * shear)
    return of_p - 2.0 * of_s * shear, of_s * shear


def line_arrays(model: Model, constants: dict[str, Any], zones: np.ndarray) -> dict[str, Any]:
    """Return the factored matrix of line-implicit zones as kernel arrays; theory.md (2.56).

    ``constants`` hold masses, mass damping, dashpots and directions at rest; ``zones``
    (n_zones,) bool.
    """
    if not zones.any():
        return no_implicit_zones()
    lines, dt = node_lines(model, zones), constants["dt"]
    node, local, cluster = clusters_of(lines.nodes)
    stretch = (constants["node_mass"] / without_layer(constants)["node_mass"])[lines.nodes[:, 0]]
    share = WEIGHT * stretch * (0.25 * dt**2 + 0.5 * dt * lines.lag)
    stiffness = np.einsum("n,naibj->naibj", share, lines.stiffness)
    return cluster_arrays(constants, [stiffness], local, node, cluster)
