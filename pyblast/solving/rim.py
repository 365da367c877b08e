"""Ground outside a box that damps what leaves it."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError


@dataclass(frozen=True)
class Rim:
    """Ground outside a box that damps what leaves it, for sources inside the model.

    Parameters
    ----------
    box : ((x0, x1), (y0, y1), (z0, z1)), m
        What lies inside is not touched; above the box nothing is.
    width : float, m
        From the box to the end of the mesh.

    Notes
    -----
    Mass damping ``3 cs/width (d/width)^2`` at distance d: an S wave that crosses the rim and comes
    back loses a factor e; more would turn low frequencies back. theory.md (4.5).

    Raises
    ------
    InputError
        If the width is not positive or the box ends before it begins.
    """

    box: tuple
    width: float

    def __post_init__(self):
        """Refuse what is no rim."""
        box = np.asarray(self.box, dtype=float)
        if box.shape != (3, 2) or not (box[:, 0] < box[:, 1]).all():
            raise InputError(f"rim.box: must be three ascending pairs, got {self.box}")
        if not 0.0 < self.width < np.inf:
            raise InputError(f"rim.width: must be positive, got {self.width:g} m")

    def alpha(self, places, speed):
        """Return the mass damping (n,) in 1/s at places (n, 3) with S speeds (n,)."""
        low, high = np.asarray(self.box, dtype=float).T
        outside = np.maximum(0.0, np.maximum(low - places, places - high))
        outside[:, 2] = np.maximum(0.0, low[2] - places[:, 2])
        depth = np.minimum(1.0, np.linalg.norm(outside, axis=1) / self.width)
        return 3.0 * speed / self.width * depth**2
