"""Straight benches: planes of their faces, heights of their floors, and what of a grid is air."""

import numpy as np

from ..grid import Geometry
from .planes import NotMapped, Plane


def face_normal(crest: np.ndarray, toe: np.ndarray) -> np.ndarray:
    """Return the upward unit normal (3,) of a face between two parallel lines (n, 3) in m.

    Examples
    --------
    >>> crest = np.array([[0.0, 0.0, 0.0], [0.0, 10.0, 0.0]])
    >>> face_normal(crest, crest + [5.0, 0.0, -5.0]).round(3).tolist()
    [0.707, 0.0, 0.707]
    """
    across = _right_of(crest)
    normal = np.append((crest[0, 2] - toe[0, 2]) * across, (toe[0, :2] - crest[0, :2]) @ across)
    return normal / np.linalg.norm(normal)


def _right_of(line):
    """Return the horizontal unit vector (2,) to the right of a line (n, 3)."""
    run = line[-1, :2] - line[0, :2]
    return np.array([run[1], 0.0 - run[0]]) / np.hypot(*run)


class Benches:
    """Benches of straight, level and parallel lines, whose ground has one profile.

    Attributes
    ----------
    faces : list of Plane
        Those that cut the box.
    heights : list of float, m
        Of their crests and toes.
    top : float, m
        Of the highest ground in the box.
    """

    def __init__(self, geometry: Geometry, tolerance: float) -> None:
        """Find the profile; NotMapped where lines bend, slope or run askew by a length in m."""
        self.across = _right_of(geometry.benches[0][0])
        lines = [line for bench in geometry.benches for line in bench]
        away = [line[:, :2] @ self.across for line in lines]
        uneven = max(map(np.ptp, [*away, *(line[:, 2] for line in lines)]))
        if uneven > tolerance:
            raise NotMapped(f"the lines of the benches bend, slope or run askew by {uneven:.3g} m")
        self.profile = np.array([[s.mean(), line[:, 2].mean()]
                                 for s, line in zip(away, lines, strict=True)])  # fmt: skip
        if np.diff(self.profile[:, 0]).min() < 0.0:
            raise NotMapped("a bench overhangs")
        corners = np.array(np.meshgrid(*geometry.box[:2])).reshape(2, -1).T
        self.top = float(self.ground(corners).max())
        if len(geometry.limits) > 2 and geometry.limits[1] >= self.top:
            raise NotMapped(f"a layer ends above the ground of the benches, {self.top:.4g} m")
        box = np.vstack([geometry.box[:2], [geometry.box[2, 0], self.top]])
        self.faces, self.heights = [], []
        along = np.array([-self.across[1], self.across[0], 0.0])
        middle = geometry.box.mean(axis=1) @ along * along
        for number, face in enumerate(self.profile.reshape(-1, 2, 2), start=1):
            crest, toe = (middle + np.append(s * self.across, z) for s, z in face)
            lines = (np.array([end, end + along]) for end in (crest, toe))
            plane = Plane(f"the face of bench {number}", face_normal(*lines), crest, along)
            if plane.area_in(box) > 0.0:
                self.faces.append(plane)
                self.heights += face[:, 1].tolist()

    def ground(self, horizontal: np.ndarray) -> np.ndarray:
        """Return the height (n,) in m of the ground at horizontal positions (n, 2)."""
        return np.interp(horizontal @ self.across, *self.profile.T)

    def air(self, positions: np.ndarray) -> np.ndarray:
        """Return which positions (n, 3) in m lie above the ground, (n,) bool."""
        return positions[:, 2] > self.ground(positions[:, :2])
