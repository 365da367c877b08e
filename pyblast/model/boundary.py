"""Boundary conditions of a model: fixed, viscous, free field, input, absorbing layer."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from ..errors import InputError
from ..signals.seismogram import GEOGRAPHIC, Seismogram
from .material import Material


@dataclass(frozen=True)
class Viscous:
    """Quiet surface: dashpots with the impedances of P and S waves; Lysmer & Kuhlemeyer (1969).

    In the static stage it stands on rollers; in the dynamic stage the static reactions remain.

    Parameters
    ----------
    surface : str
    media : dict of str to Material
        What waves meet behind the zones of a group, where it is not their own material: rock with
        meshed joints is a softer medium, `jointed`. Stress input through the surface takes it too.
    """

    surface: str
    media: dict[str, Material] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class Roller:
    """No motion along the normal of a surface.

    Parameters
    ----------
    surface : str
    dynamic : bool
        Also in the dynamic stage. Together with `Viscous` on the same surface this is the literal
        reading of "viscous and fixed in normal direction": the normal dashpot then does nothing.
    """

    surface: str
    dynamic: bool = True


@dataclass(frozen=True)
class Fixed:
    """No motion on a surface, in both stages.

    Parameters
    ----------
    surface : str
    components : tuple of str
        Which of east, north, vertical are held; a column that holds all but one carries S waves.

    Raises
    ------
    InputError
        If a component is unknown or none is named.
    """

    surface: str
    components: tuple[str, ...] = GEOGRAPHIC

    def __post_init__(self) -> None:
        """Refuse components that are none."""
        object.__setattr__(self, "components", tuple(self.components))
        if not self.components or not set(self.components) <= set(GEOGRAPHIC):
            raise InputError(
                f"boundaries.{self.surface}.components: must be some of {', '.join(GEOGRAPHIC)}, "
                f"got {', '.join(map(str, self.components)) or 'none'}"
            )


@dataclass(frozen=True)
class FreeField:
    """A viscous side that sees columns of the ground beside the model move; theory.md (4.8).

    For input from below: each column has the layers and the height of the ground where it stands
    and is marched before the model. The surface is a vertical plane and also `Viscous`.

    Parameters
    ----------
    surface : str
    """

    surface: str


@dataclass(frozen=True, eq=False)
class StressInput:
    """Traction history on a surface, from the particle velocity that is wanted behind it.

    Parameters
    ----------
    surface : str
    seismogram : Seismogram
        East, north and vertical particle velocity, m/s.
    doubled : bool or None
        Traction ``2 rho c v`` instead of ``rho c v``, because dashpots of the same surface take
        one half. None: doubled where the surface is also viscous. Eq. (6), (7) of Babanouri et
        al. (2013); theory.md (4.3).
    """

    surface: str
    seismogram: Seismogram
    doubled: bool | None = None


@dataclass(frozen=True, eq=False)
class VelocityInput:
    """Particle velocity prescribed on a surface; refused where the surface is viscous.

    Two surfaces that meet take one seismogram, or their common nodes had two velocities.

    Parameters
    ----------
    surface : str
    seismogram : Seismogram
        East, north and vertical particle velocity, m/s.
    """

    surface: str
    seismogram: Seismogram


Boundary = Viscous | Roller | Fixed | FreeField | StressInput | VelocityInput


def check_boundaries(boundaries: Sequence[Boundary], surfaces: dict[str, np.ndarray]) -> None:
    """Refuse boundaries on unknown surfaces and those that exclude one another.

    Parameters
    ----------
    boundaries : sequence of boundary conditions
    surfaces : dict of str to (n, 3) int
        Triangles by node.

    Raises
    ------
    InputError
    """
    viscous = {b.surface for b in boundaries if isinstance(b, Viscous)}
    for boundary in boundaries:
        kind, surface = type(boundary).__name__, boundary.surface
        if surface not in surfaces:
            raise InputError(
                f"boundaries.{surface}: no such surface; there are {', '.join(surfaces)}"
            )
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
    moved = [b for b in boundaries if isinstance(b, VelocityInput)]
    for first, second in combinations(moved, 2):
        shared = np.intersect1d(surfaces[first.surface], surfaces[second.surface])
        if len(shared) and not _alike(first.seismogram, second.seismogram):
            raise InputError(
                f"boundaries.{second.surface}: meets '{first.surface}' at {len(shared)} nodes, "
                "which would have to follow two velocities; give both surfaces the same seismogram "
                "or one of them no velocity"
            )


def _alike(first, second):
    """Tell whether two seismograms move a node alike."""
    return (first.dt, first.start) == (second.dt, second.start) and np.array_equal(
        first.velocity, second.velocity
    )


CROSSED = 3.0  # of cs/width: an S wave that crosses the rim and comes back loses a factor e
DRAG = 2.5  # of the lowest angular frequency and widths in S waves: more turns it back


@dataclass(frozen=True)
class Rim:
    """Ground outside a box that damps what leaves it, for sources inside the model.

    Parameters
    ----------
    box : ((x0, x1), (y0, y1), (z0, z1)), m
        What lies inside is not touched; above the box nothing is.
    width : float, m
        From the box to the end of the mesh.
    lowest : float, Hz, optional
        Lowest frequency that shall leave. A rim of less than half its S wave would turn it back:
        it damps the less the narrower it is.

    Notes
    -----
    Mass damping ``3 cs/width (d/width)^2`` at distance d: an S wave that crosses the rim and comes
    back loses a factor e; theory.md (4.5).

    Raises
    ------
    InputError
        If width or frequency is not positive or the box ends before it begins.
    """

    box: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
    width: float
    lowest: float | None = None

    def __post_init__(self) -> None:
        """Refuse what is no rim."""
        box = np.asarray(self.box, dtype=float)
        if box.shape != (3, 2) or not (box[:, 0] < box[:, 1]).all():
            raise InputError(f"rim.box: must be three ascending pairs, got {self.box}")
        if not 0.0 < self.width < np.inf:
            raise InputError(f"rim.width: must be positive, got {self.width:g} m")
        if self.lowest is not None and not 0.0 < self.lowest < np.inf:
            raise InputError(f"rim.lowest: must be positive, got {self.lowest:g} Hz")

    def alpha(self, places: np.ndarray, speed: float | np.ndarray) -> np.ndarray:
        """Return the mass damping (n,) in 1/s at places (n, 3) with S speeds (n,)."""
        low, high = np.asarray(self.box, dtype=float).T
        outside = np.maximum(0.0, np.maximum(low - places, places - high))
        outside[:, 2] = np.maximum(0.0, low[2] - places[:, 2])
        depth = np.minimum(1.0, np.linalg.norm(outside, axis=1) / self.width)
        most = CROSSED * speed / self.width
        if self.lowest is not None:
            waves = self.width * self.lowest / speed
            most = np.minimum(most, DRAG * waves * 2.0 * np.pi * self.lowest)
        return most * depth**2
