"""Ground outside a box that damps what leaves it."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

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

    box: tuple
    width: float
    lowest: float | None = None

    def __post_init__(self):
        """Refuse what is no rim."""
        box = np.asarray(self.box, dtype=float)
        if box.shape != (3, 2) or not (box[:, 0] < box[:, 1]).all():
            raise InputError(f"rim.box: must be three ascending pairs, got {self.box}")
        if not 0.0 < self.width < np.inf:
            raise InputError(f"rim.width: must be positive, got {self.width:g} m")
        if self.lowest is not None and not 0.0 < self.lowest < np.inf:
            raise InputError(f"rim.lowest: must be positive, got {self.lowest:g} Hz")

    def alpha(self, places, speed):
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
