"""Ground fields: gradients, damaged zones and random heterogeneity of the wave speeds.

A field is a factor on all wave speeds as a function of position; the density is unchanged.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import map_coordinates

from ..errors import InputError
from ..mesh.mesh import Mesh

EDGES_PER_LENGTH = 3.0
CELLS_PER_LENGTH = 5.0


@dataclass(frozen=True)
class Gradient:
    """Gradient of the wave speeds with depth: 1 - reduction exp(-depth/length); theory.md (1.7).

    Parameters
    ----------
    reduction : float
        Relative reduction at the top.
    length : float, m
    top : float, m
        Elevation of the ground surface.
    """

    reduction: float
    length: float
    top: float = 0.0

    def __post_init__(self) -> None:
        """Check reduction and length."""
        _check("gradient", self.reduction, self.length)

    def factor(self, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the factor (n,) at places (n, 3)."""
        del edges
        return 1.0 - self.reduction * np.exp(-np.maximum(self.top - places[:, 2], 0) / self.length)


@dataclass(frozen=True, eq=False)
class DamagedZone:
    """Blast-damaged zone around holes: factor 1 - reduction exp(-distance/length).

    Parameters
    ----------
    holes : (n, 2, 3) float64, m
        Both ends of each hole.
    reduction : float
    length : float, m
    """

    holes: np.ndarray
    reduction: float
    length: float

    def __post_init__(self) -> None:
        """Check reduction, length and holes."""
        _check("damaged zone", self.reduction, self.length)
        holes = np.asarray(self.holes, dtype=float)
        if holes.ndim != 3 or holes.shape[1:] != (2, 3):
            raise InputError(f"damaged zone.holes: must be n x 2 x 3 ends, got {holes.shape}")
        object.__setattr__(self, "holes", holes)

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Return the distance (n,) in m from places (n, 3) to the nearest hole."""
        nearest = np.full(len(places), np.inf)
        for start, end in self.holes:
            axis = end - start
            share = np.clip((places - start) @ axis / max(axis @ axis, 1e-12), 0.0, 1.0)
            foot = start + share[:, None] * axis
            nearest = np.minimum(nearest, np.linalg.norm(places - foot, axis=1))
        return nearest

    def factor(self, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the factor (n,) at places (n, 3)."""
        del edges
        return 1.0 - self.reduction * np.exp(-self.distance(places) / self.length)


@dataclass(frozen=True)
class Body:
    """Body of softer or stiffer rock: factor exp(change exp(-(distance/reach)^2/2)).

    Parameters
    ----------
    centre : tuple of 3 float, m
    change : float
        Of the logarithm of the speeds at the centre; negative where softer.
    reach : float, m

    Notes
    -----
    The logarithm is averaged over each zone as over a cube of its edges, to second order of these:
    a Gaussian as much wider and lower.
    """

    centre: tuple[float, float, float]
    change: float
    reach: float

    def factor(self, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the factor (n,) in zones of centres (n, 3) and mean edges (n,), m."""
        wide = self.reach**2 + np.asarray(edges) ** 2 / 12.0
        apart = np.sum((places - np.array(self.centre)) ** 2, axis=1)
        return np.exp(self.change * (self.reach**2 / wide) ** 1.5 * np.exp(-0.5 * apart / wide))


@dataclass(frozen=True)
class Heterogeneity:
    """Random heterogeneity: Gaussian field of the logarithm of the wave speeds; theory.md (1.8).

    Parameters
    ----------
    deviation : float
        Standard deviation of ln c.
    length : float, m
        Correlation length.
    seed : int
    hurst : float
        Hurst exponent of the von Karman correlation; 0.5 is the exponential correlation.

    Raises
    ------
    InputError
        If a value is out of range, or the mesh has fewer than three edges per correlation length.
    """

    deviation: float
    length: float
    seed: int
    hurst: float = 0.5

    def __post_init__(self) -> None:
        """Check deviation, length and Hurst exponent."""
        _check("heterogeneity", self.deviation, self.length)
        if not 0.0 < self.hurst <= 1.0:
            raise InputError(f"heterogeneity.hurst: must lie in 0 to 1, got {self.hurst:g}")

    def factor(self, places: np.ndarray, edges: np.ndarray) -> np.ndarray:
        """Return the factor (n,) at places (n, 3) of a mesh with edges (n,) in m."""
        if np.median(edges) * EDGES_PER_LENGTH > self.length:
            raise InputError(
                f"heterogeneity.length: {self.length:g} m has fewer than three edges of "
                f"{np.median(edges):.3g} m; take a finer mesh or a longer correlation"
            )
        cell = self.length / CELLS_PER_LENGTH
        low = places.min(axis=0) - 2.0 * self.length
        shape = np.ceil((np.ptp(places, axis=0) + 4.0 * self.length) / cell).astype(int) + 1
        field = self._grid(shape, cell)
        return np.exp(map_coordinates(field, ((places - low) / cell).T, order=1))

    def _grid(self, shape, cell):
        """Return the field on a grid by its spectrum."""
        wave = np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n, cell) for n in shape), indexing="ij")
        square = sum(w**2 for w in wave) * self.length**2
        amplitude = (1.0 + square) ** (-0.5 * (self.hurst + 1.5))
        amplitude *= self.deviation / np.sqrt(np.mean(amplitude**2))
        noise = np.random.default_rng(self.seed).normal(size=shape)
        return np.fft.ifftn(amplitude * np.fft.fftn(noise)).real


GroundField = Gradient | DamagedZone | Body | Heterogeneity


def damaged_group(mesh: Mesh, zone: DamagedZone, radius: float, name: str = "damaged") -> Mesh:
    """Return a mesh with the zones within a radius in m of the holes as a separate group.

    The group may exist already.
    """
    near = zone.distance(mesh.points[mesh.zones].mean(axis=1)) <= radius
    if not near.any():
        raise InputError(f"damaged zone.radius: no zone lies within {radius:g} m of a hole")
    groups = mesh.groups if name in mesh.groups else (*mesh.groups, name)
    group = np.where(near, groups.index(name), mesh.zone_group).astype(mesh.zone_group.dtype)
    return replace(mesh, zone_group=group, groups=groups)


def elastic_radius(moment: float, ratio: float, strength: dict[str, float], pressure: float):
    """Return the radius in m around a hole within which its closed form alone exceeds a strength.

    Parameters
    ----------
    moment : float, N m
        Largest isotropic moment.
    ratio : float
        Speed of S over that of P waves.
    strength : dict of str to float
        ``cohesion``, ``tension`` in Pa, ``friction`` as a tangent; or those of a Hoek-Brown law.
    pressure : float, Pa
        Of the ground before the blast, mean of three directions.

    Returns
    -------
    float
        Infinite where the ground has no strength at all.

    Notes
    -----
    Sharpe (1942): ``stress_r = -p0 - 2x, stress_t = -p0 + x, x = (cs/cp)^2 M/(2 pi r^3)`` reaches
    the surface of Mohr-Coulomb or its tension cut-off at x_y: theory.md (5.17).
    """
    if "sigci" in strength:
        m, s, a, size = (strength[key] for key in ("m", "s", "a", "sigci"))
        slope, crushed = 1.0 + a * m * s ** (a - 1.0), size * s**a
    else:
        friction = strength["friction"]
        slope = (np.hypot(1.0, friction) + friction) ** 2
        crushed = 2.0 * strength["cohesion"] * np.sqrt(slope)
    sheared = (crushed + (slope - 1.0) * pressure) / (slope + 2.0)
    most = min(sheared, strength["tension"] + pressure)
    if not most > 0.0:
        return np.inf
    return float((ratio**2 * moment / (2.0 * np.pi * most)) ** (1.0 / 3.0))


def near_groups(mesh: Mesh, near: np.ndarray, suffix: str) -> Mesh:
    """Return a mesh whose near zones, (n_zones,) bool, are groups of their own by a suffix."""
    groups, group = list(mesh.groups), mesh.zone_group.copy()
    for number in np.unique(mesh.zone_group[near]):
        group[near & (mesh.zone_group == number)] = len(groups)
        groups.append(mesh.groups[number] + suffix)
    return replace(mesh, zone_group=group, groups=tuple(groups))


def near_joints(mesh: Mesh, distance: Callable, suffix: str, names: Sequence[str]) -> Mesh:
    """Return a mesh whose contacts of named joints near the holes are joints of their own.

    Parameters
    ----------
    mesh : Mesh
    distance : callable
        Returns for positions (n, 3) in m how far beyond the radius they lie, negative inside.
    suffix : str
    names : sequence of str
        Joints that are parted.
    """
    contacts = mesh.contacts
    if contacts is None:
        return mesh
    surfaces, joint, known = dict(mesh.surfaces), contacts.joint.copy(), list(contacts.names)
    inside = distance(mesh.points[contacts.minus]) <= 0.0
    for number, name in enumerate(contacts.names):
        faces = mesh.surfaces[name]
        near = distance(mesh.points[faces].mean(axis=1)) <= 0.0
        own = inside & (contacts.joint == number)
        if name not in names or not near.any() or not own.any():
            continue
        surfaces[name], surfaces[name + suffix] = faces[~near], faces[near]
        joint[own] = len(known)
        known.append(name + suffix)
    parted = replace(contacts, joint=joint, names=tuple(known))
    return replace(mesh, surfaces=surfaces, contacts=parted)


def _check(what, share, length):
    """Raise InputError for a reduction outside 0 to 1 or a length that is not positive."""
    if not 0.0 <= share < 1.0:
        raise InputError(f"{what}: the share must lie in 0 to 1, got {share:g}")
    if not 0.0 < length < np.inf:
        raise InputError(f"{what}.length: must be positive, got {length:g} m")
