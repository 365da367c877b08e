"""Boundary conditions of a model: fixed, viscous, free field, input, absorbing layer."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ..errors import InputError
from ..mesh.mesh import Mesh, inner_facets
from ..signals.seismogram import GEOGRAPHIC, Seismogram
from .material import Material


@dataclass(frozen=True)
class Viscous:
    """Viscous boundary: dashpots with the impedances of P and S waves.

    It rests on rollers in the static stage; in the dynamic stage the static reactions remain.

    Parameters
    ----------
    surface : str
    media : dict of str to Material
        Medium beyond the boundary by group, where it differs from the material of the group: rock
        with meshed joints has the impedance of the effective medium, `jointed`. Stress input
        through the surface uses the same impedance.

    Notes
    -----
    Lysmer & Kuhlemeyer (1969); theory.md (4.1).
    """

    surface: str
    media: dict[str, Material] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class Roller:
    """Roller boundary: no motion normal to a surface.

    Parameters
    ----------
    surface : str
    dynamic : bool
        Whether it also holds in the dynamic stage. With `Viscous` on the same surface the normal
        dashpots then have no effect.
    """

    surface: str
    dynamic: bool = True


@dataclass(frozen=True)
class Fixed:
    """Fixed boundary: no motion of a surface, in both stages.

    Parameters
    ----------
    surface : str
    components : tuple of str
        Fixed components, of east, north, vertical. Sides that fix all but one horizontal component
        guide S waves along a column.

    Raises
    ------
    InputError
        If a component is unknown or none is named.
    """

    surface: str
    components: tuple[str, ...] = GEOGRAPHIC

    def __post_init__(self) -> None:
        """Check the components."""
        object.__setattr__(self, "components", tuple(self.components))
        if not self.components or not set(self.components) <= set(GEOGRAPHIC):
            raise InputError(
                f"boundaries.{self.surface}.components: must be some of {', '.join(GEOGRAPHIC)}, "
                f"got {', '.join(map(str, self.components)) or 'none'}"
            )


@dataclass(frozen=True)
class FreeField:
    """Free-field boundary: a viscous side coupled to ground columns beside the model.

    For input from below: each column has the layers and the height of the ground at its position
    and is integrated before the model. The surface must be a vertical plane and also `Viscous`.

    Parameters
    ----------
    surface : str

    Notes
    -----
    theory.md (4.8), (4.12), (4.13).
    """

    surface: str


@dataclass(frozen=True, eq=False)
class WaveFronts:
    """Wave fronts of holes on a face: amplitude and delay of a seismogram at each point.

    Parameters
    ----------
    positions : (n_holes, 3) float64, m
    times, scales : (n_holes,) float64, s and -
        Firing times, and scales relative to the hole of the seismogram.
    distance : float, m
        At which the seismogram holds.
    exponent : float
        Amplitudes fall as ``(distance/r)^exponent``.
    speed : float, m/s
        Delays are ``time + (r - distance)/speed``.
    axis : (3,) float64, unit, horizontal
        Path of the seismogram; its horizontal motion is turned into the path of each point.

    Notes
    -----
    theory.md (5.18).
    """

    positions: np.ndarray
    times: np.ndarray
    scales: np.ndarray
    distance: float
    exponent: float
    speed: float
    axis: np.ndarray

    def at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return amplitudes, delays in s, both (n_holes, n), and rotations (n_holes, n, 3, 3)."""
        path = np.asarray(points)[None] - self.positions[:, None]
        away = np.linalg.norm(path, axis=2)
        amplitude = self.scales[:, None] * (self.distance / away) ** self.exponent
        delay = self.times[:, None] + (away - self.distance) / self.speed
        flat = path[..., :2] / np.maximum(np.linalg.norm(path[..., :2], axis=2), 1e-9)[..., None]
        cosine = flat @ self.axis[:2]
        sine = self.axis[0] * flat[..., 1] - self.axis[1] * flat[..., 0]
        turn = np.zeros((*away.shape, 3, 3))
        turn[..., 0, 0] = turn[..., 1, 1] = cosine
        turn[..., 0, 1], turn[..., 1, 0] = -sine, sine
        turn[..., 2, 2] = 1.0
        return amplitude, delay, turn


@dataclass(frozen=True, eq=False)
class StressInput:
    """Stress input: traction on a surface from the particle velocity of the incident wave.

    Parameters
    ----------
    surface : str
    seismogram : Seismogram
        East, north and vertical particle velocity, m/s.
    doubled : bool or None
        Traction ``2 rho c v`` instead of ``rho c v``, because the dashpots of the same surface
        absorb one half. None: doubled if the surface is also viscous.
    fronts : WaveFronts, optional
        Of the holes whose single seismogram is given; without, it enters alike everywhere.

    Notes
    -----
    Eq. (6), (7) of Babanouri et al. (2013); theory.md (4.3).
    """

    surface: str
    seismogram: Seismogram
    doubled: bool | None = None
    fronts: WaveFronts | None = None


@dataclass(frozen=True, eq=False)
class VelocityInput:
    """Velocity input: particle velocity prescribed on a surface.

    The surface must not be viscous. Two surfaces with common nodes must have the same seismogram.

    Parameters
    ----------
    surface : str
    seismogram : Seismogram
        East, north and vertical particle velocity, m/s.
    """

    surface: str
    seismogram: Seismogram


Boundary = Viscous | Roller | Fixed | FreeField | StressInput | VelocityInput


def kinds_of(boundaries: Sequence[Boundary]) -> dict[str, str]:
    """Return what holds each surface, in words: the kinds of its boundary conditions."""
    words = {}
    for boundary in boundaries:
        name = type(boundary).__name__
        kind = "".join(f" {c.lower()}" if c.isupper() else c for c in name).strip()
        words.setdefault(boundary.surface, []).append(kind)
    return {surface: ", ".join(kinds) for surface, kinds in words.items()}


def check_boundaries(boundaries: Sequence[Boundary], mesh: Mesh) -> None:
    """Raise InputError for boundaries on unknown or inner surfaces, and for incompatible ones.

    Parameters
    ----------
    boundaries : sequence of boundary conditions
    mesh : Mesh
    """
    surfaces = mesh.surfaces
    viscous = {b.surface for b in boundaries if isinstance(b, Viscous)}
    for boundary in boundaries:
        kind, surface = type(boundary).__name__, boundary.surface
        if surface not in surfaces:
            raise InputError(
                f"boundaries.{surface}: no such surface; there are {', '.join(surfaces)}"
            )
        _refuse_inner(surface, mesh)
        if isinstance(boundary, VelocityInput) and surface in viscous:
            raise InputError(
                f"boundaries.{surface}: a velocity can't be prescribed on a viscous surface: its "
                "dashpots would act on a motion that is fixed anyway and reflect waves; "
                'use StressInput (input.enters_as = "stress"), which turns it into stress'
            )
        if isinstance(boundary, FreeField) and surface not in viscous:
            raise InputError(
                f"boundaries.{surface}: FreeField needs the dashpots of a viscous surface; add "
                f"Viscous({surface!r})"
            )
        if isinstance(boundary, Fixed) and surface in viscous:
            raise InputError(f"boundaries.{surface}: {kind} and Viscous exclude one another")
    prescribed = [b for b in boundaries if isinstance(b, VelocityInput)]
    for first, second in combinations(prescribed, 2):
        shared = np.intersect1d(surfaces[first.surface], surfaces[second.surface])
        if len(shared) and not _equal(first.seismogram, second.seismogram):
            raise InputError(
                f"boundaries.{second.surface}: meets '{first.surface}' at {len(shared)} nodes, "
                "which would have to follow two velocities; give both surfaces the same seismogram "
                "or one of them no velocity"
            )


def _refuse_inner(surface, mesh):
    """Raise InputError for a boundary on a joint, or on facets between two zones."""
    if mesh.contacts is not None and surface in mesh.contacts.names:
        raise InputError(f"boundaries.{surface}: is a joint; only outer sides take a condition")
    inner, _ = inner_facets(mesh, surface)
    if inner.any():
        raise InputError(
            f"boundaries.{surface}: {np.count_nonzero(inner)} of its {len(inner)} facets lie "
            "between two zones; only outer sides absorb, are held or are moved"
        )


def _equal(first, second):
    """Return whether two seismograms are equal."""
    return (first.dt, first.start) == (second.dt, second.start) and np.array_equal(
        first.velocity, second.velocity
    )


DAMPING = 3.0  # times cs/width: an S wave loses a factor e on its way through and back
NARROW, STEEP = 0.5, 4  # S waves of the lowest frequency in the width, below which damping falls
SLICES = 60  # of the layer, to which its reflection is integrated


@dataclass(frozen=True)
class SpongeLayer:
    """Sponge layer: damped ground around a box that absorbs waves of sources inside.

    Parameters
    ----------
    box : ((x0, x1), (y0, y1), (z0, z1)), m
        Undamped region; the ground above the box is not damped either.
    width : float, m
        From the box to the end of the mesh.
    lowest : float, Hz, optional
        Lowest frequency to be absorbed. A layer thinner than half of its S wavelength would
        reflect more than bare dashpots: its damping falls with the fourth power of the width.

    Notes
    -----
    Mass damping ``3 cs/width (d/width)^2`` at distance d: an S wave loses a factor e on its way
    through the layer and back; theory.md (4.5).

    Raises
    ------
    InputError
        If width or frequency is not positive or a limit of the box is not ascending.
    """

    box: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    width: float
    lowest: float | None = None

    def __post_init__(self) -> None:
        """Check box, width and frequency."""
        box = np.asarray(self.box, dtype=float)
        if box.shape != (3, 2) or not (box[:, 0] < box[:, 1]).all():
            raise InputError(f"sponge.box: must be three ascending pairs, got {self.box}")
        if not 0.0 < self.width < np.inf:
            raise InputError(f"sponge.width: must be positive, got {self.width:g} m")
        if self.lowest is not None and not 0.0 < self.lowest < np.inf:
            raise InputError(f"sponge.lowest: must be positive, got {self.lowest:g} Hz")

    def alpha(self, places: np.ndarray, speed: float | np.ndarray) -> np.ndarray:
        """Return the mass damping (n,) in 1/s at places (n, 3) with S speeds (n,)."""
        low, high = np.asarray(self.box, dtype=float).T
        outside = np.maximum(0.0, np.maximum(low - places, places - high))
        outside[:, 2] = np.maximum(0.0, low[2] - places[:, 2])
        depth = np.minimum(1.0, np.linalg.norm(outside, axis=1) / self.width)
        return self._most(speed) * depth**2

    def _most(self, speed):
        """Return the mass damping (n,) in 1/s at the end of the layer, at S speeds (n,)."""
        most = DAMPING * speed / self.width
        if self.lowest is not None:
            waves = self.width * self.lowest / (NARROW * speed)
            most = most * np.minimum(1.0, waves**STEEP)
        return most

    def reflection(self, cosine: np.ndarray, frequency: float, speed: float) -> np.ndarray:
        """Return the share (n,) of plane SH waves that layer and dashpots at its end reflect.

        Parameters
        ----------
        cosine : (n,) float64
            Of the angle of incidence.
        frequency : float, Hz
        speed : float, m/s, of S waves

        Notes
        -----
        theory.md (4.5b): the ratio of stress and velocity, over that of a wave straight on, goes
        from slice to slice, back from 1 at the dashpots.
        """
        turned, deep = 2.0 * np.pi * frequency, (np.arange(SLICES)[::-1] + 0.5) / SLICES
        density = 1.0 + 1j * self._most(speed) * deep**2 / turned
        ratio = np.ones(len(cosine), dtype=complex)
        for each in density:
            own = np.sqrt(each - 1.0 + cosine**2)
            turn = 1j * np.tan(own * turned * self.width / (SLICES * speed))
            ratio = own * (ratio - own * turn) / (own - ratio * turn)
        return np.abs((cosine - ratio) / (cosine + ratio))
