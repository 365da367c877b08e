"""Absorbing layer around a model of hexahedra: its limits, and how deep a place lies in it."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError

LOWEST = 3.0  # Hz, that an absorbing layer is made for


@dataclass(frozen=True, eq=False)
class AbsorbingLayer:
    """Absorbing layer: ground around a model of hexahedra that sends back next to nothing.

    A matched layer with complex frequency-shifted stretch in second-order form: below 0.5 % of the
    energy up to 80 degrees from the normal, at all frequencies. Two elements are wide enough, three
    where cp/cs exceeds 4. Behind it the sides are viscous, for motion that never ends.

    Parameters
    ----------
    inner : ((x0, x1), (y0, y1), (z0, z1)), m
        The model without the layer, along the axes of ``frame``; infinite where there is no layer.
    width : ((x0, x1), (y0, y1), (z0, z1)), m
        Of the layer at these sides.
    frame : (3, 3) float64
        Unit vectors of the axes, row by row.
    lowest : float, Hz
        Lowest frequency of interest.

    Raises
    ------
    InputError
        If a limit does not ascend, a width is not positive, or the frame is not orthonormal.

    Notes
    -----
    theory.md (4.14) to (4.18).
    """

    inner: tuple[tuple[float, float], ...]
    width: tuple[tuple[float, float], ...]
    frame: tuple[tuple[float, float, float], ...] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    lowest: float = LOWEST

    def __post_init__(self) -> None:
        """Check limits, widths, frame and frequency."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        frame = np.array(self.frame, dtype=float)
        if inner.shape != (3, 2) or not (inner[:, 0] < inner[:, 1]).all():
            raise InputError(f"layer.inner: must be three ascending pairs, got {self.inner}")
        if width.shape != (3, 2) or not (width > 0.0).all():
            raise InputError(f"layer.width: must be three positive pairs, got {self.width}")
        if frame.shape != (3, 3) or np.abs(frame @ frame.T - np.eye(3)).max() > 1e-9:
            raise InputError(f"layer.frame: must be orthogonal unit vectors, got {self.frame}")
        if not 0.0 < self.lowest < np.inf:
            raise InputError(f"layer.lowest: must be positive, got {self.lowest:g} Hz")

    def depths(self, places: np.ndarray) -> np.ndarray:
        """Return the depth (..., 3) of places (..., 3) in the layer over its width, by axis."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        along = places @ np.array(self.frame, dtype=float).T
        below, above = (inner[:, 0] - along) / width[:, 0], (along - inner[:, 1]) / width[:, 1]
        return np.clip(np.maximum(below, above), 0.0, 1.0)

    def widths(self, places: np.ndarray) -> np.ndarray:
        """Return the width (..., 3) in m of the layer on the side of places (..., 3), by axis."""
        inner, width = np.array(self.inner, dtype=float), np.array(self.width, dtype=float)
        along = places @ np.array(self.frame, dtype=float).T
        return np.where(along < inner[:, 0], width[:, 0], width[:, 1])
