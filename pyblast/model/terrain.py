"""Terrain: benches by their crest and toe lines, and what they do to joints."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError

_FAR = 8.0  # radius of the ground around a site, over the diagonal of its box
_ARC = np.radians(30.0)
_EXACT = 1e-6  # m


@dataclass(frozen=True, eq=False)
class Bench:
    """Bench: a face between a crest and a toe, of ground that steps down to the right of both.

    Parameters
    ----------
    crest, toe : (n, 3) float64, m
        Lines in plan with heights, walked so that the lower ground lies on the right. Where they
        coincide in plan, the face is upright. Both are continued straight beyond their ends.

    Raises
    ------
    InputError
        If a line has fewer than two points, or the toe does not lie below the crest.
    """

    crest: np.ndarray
    toe: np.ndarray

    def __post_init__(self) -> None:
        """Check the lines."""
        for name in ("crest", "toe"):
            line = np.asarray(getattr(self, name), dtype=float)
            if line.ndim != 2 or line.shape[1:] != (3,) or len(line) < 2:
                raise InputError(f"bench: {name} needs two points (x, y, z) or more")
            if not np.isfinite(line).all():
                raise InputError(f"bench: {name} must hold finite numbers")
            if not (np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1) > _EXACT).all():
                raise InputError(f"bench: {name} holds the same place twice in turn")
            object.__setattr__(self, name, line)
        if not self.toe[:, 2].max() < self.crest[:, 2].min():
            raise InputError(
                f"bench: the toe must lie below the crest, got up to {self.toe[:, 2].max():g} m "
                f"under {self.crest[:, 2].min():g} m"
            )


def walked(crest: np.ndarray, toe: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a crest and its toe (n, 3) in m, turned so that the lower ground lies on the right.

    Lines that coincide in plan keep the sense of the crest.
    """
    middles = 0.5 * (toe[1:, :2] + toe[:-1, :2])
    side = sum(_signed_distance(crest[:, :2], middle) for middle in middles)
    crest = crest[::-1] if side > _EXACT else crest
    along = (crest[-1] - crest[0])[:2] @ (toe[-1] - toe[0])[:2]
    return crest, toe[::-1] if along < 0.0 else toe


def toe_of(crest: ArrayLike, height: float, dip: float) -> np.ndarray:
    """Return the toe line (n, 3) in m of a face of constant height and dip.

    Parameters
    ----------
    crest : (n, 3) float, m
    height : float, m
    dip : float, rad
        Of the face; a right angle: upright.
    """
    crest = np.asarray(crest, dtype=float)
    run = np.diff(crest[:, :2], axis=0)
    right = np.column_stack([run[:, 1], -run[:, 0]]) / np.linalg.norm(run, axis=1)[:, None]
    before, after = np.vstack([right[:1], right]), np.vstack([right, right[-1:]])
    corner = before + after  # their mean direction, stretched to both faces
    corner /= 0.5 * np.einsum("ni,ni->n", corner, corner)[:, None]
    reach = height / np.tan(dip) if dip < np.pi / 2.0 - 1e-12 else 0.0
    return np.column_stack([crest[:, :2] + reach * corner, crest[:, 2] - height])


def bench_triangles(benches: Sequence[Bench], box: ArrayLike) -> np.ndarray:
    """Return the ground of benches as triangles.

    Parameters
    ----------
    benches : sequence of Bench
        From the highest to the lowest, each to the right of the one before.
    box : (3, 2) float, m
        Of the ground without padding.

    Returns
    -------
    (n, 3, 3) float64, m
        Beyond the first crest and the last toe the ground keeps the heights of these.

    Raises
    ------
    InputError
        If lines cross or run the wrong way.
    """
    box = np.asarray(box, dtype=float)
    middle, radius = box[:2].mean(axis=1), _FAR * np.linalg.norm(np.ptp(box[:2], axis=1))
    lines = [
        _continued(line, middle, radius) for part in benches for line in (part.crest, part.toe)
    ]
    for upper, lower in pairwise(lines):
        _refuse_crossing(upper, lower)
    outlines = [np.vstack([lines[0], _arc(lines[0][-1], lines[0][0], middle, radius)])]
    for upper, lower in pairwise(lines):
        if upper.shape != lower.shape or np.abs(upper - lower)[:, :2].max() > _EXACT:
            outlines.append(np.vstack([upper, lower[::-1]]))
    last = lines[-1][::-1]
    outlines.append(np.vstack([last, _arc(last[-1], last[0], middle, radius)]))
    return np.concatenate(
        [_triangles(part, 1.0 if n in (0, len(outlines) - 1) else -1.0)
         for n, part in enumerate(outlines)]
    )  # fmt: skip


def _continued(line, middle, radius):
    """Return a line continued straight on both ends to a circle."""

    def end(position, inner):
        run = position[:2] - inner[:2]
        run /= np.linalg.norm(run)
        away = position[:2] - middle
        half, rest = away @ run, away @ away - radius**2
        return np.append(position[:2] + (np.sqrt(half**2 - rest) - half) * run, position[2])

    if np.linalg.norm(line[:, :2] - middle, axis=1).max() > radius:
        raise InputError(f"bench: a line leaves the site by more than {radius:g} m; clip it")
    return np.vstack([end(line[0], line[1]), line, end(line[-1], line[-2])])


def _arc(start, end, middle, radius):
    """Return the points of a circle anticlockwise between two of its points, without these."""
    first, last = (np.arctan2(*(position[:2] - middle)[::-1]) for position in (start, end))
    turn = (last - first) % (2.0 * np.pi)
    share = np.arange(1, int(np.ceil(turn / _ARC))) / np.ceil(turn / _ARC)
    angle = first + share * turn
    height = start[2] + share * (end[2] - start[2])
    plan = middle + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.column_stack([plan, height])


def _cross(a, b):
    """Return the cross products of vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _refuse_crossing(upper, lower):
    """Raise InputError if two lines cross in plan."""
    a, b = upper[:-1, None, :2], upper[1:, None, :2]
    c, d = lower[None, :-1, :2], lower[None, 1:, :2]
    apart = _cross(b - a, c - a) * _cross(b - a, d - a)
    other = _cross(d - c, a - c) * _cross(d - c, b - c)
    near = -_EXACT
    if ((apart < near) & (other < near)).any():
        row, column = np.argwhere((apart < near) & (other < near))[0]
        x, y = 0.5 * (upper[row, :2] + lower[column, :2])
        raise InputError(
            f"bench: two lines cross near ({x:g}, {y:g}) m; give benches from the highest down, "
            "the lower ground on the right of each line"
        )


def _triangles(outline, turn):
    """Cut a polygon (n, 3) into triangles by its ears; ``turn`` 1: it runs anticlockwise."""
    position = outline[:, :2] * [1.0, turn]
    scale = np.ptp(position, axis=0).max()
    remaining, result = list(range(len(position))), []
    while len(remaining) > 3:
        for at in range(len(remaining)):
            ear = [remaining[at - 1], remaining[at], remaining[(at + 1) % len(remaining)]]
            area = _cross(position[ear[1]] - position[ear[0]], position[ear[2]] - position[ear[0]])
            others = position[[v for v in remaining if v not in ear]]
            if area > _EXACT**2 * scale and not _any_inside(position[ear], others):
                break
        else:
            raise InputError(
                "bench: a line crosses itself or the next one, or the lower ground does not lie "
                "on its right; turn or redraw it"
            )
        result.append(ear)
        remaining.remove(ear[1])
    result.append(remaining)
    corners = outline[np.array(result)]
    flat = np.abs(_cross(*(corners[:, k, :2] - corners[:, 0, :2] for k in (1, 2)))) < _EXACT
    return corners[~flat]


def _any_inside(corners, places):
    """Return whether a position lies inside a triangle or on its border."""
    inside = np.ones(len(places), dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inside &= _cross(end - start, places - start) >= 0.0
    same = (np.abs(places[:, None] - corners[None]) < _EXACT).all(axis=2).any(axis=1)
    return bool((inside & ~same).any())


def burdens(benches: Sequence[Bench], places: ArrayLike) -> np.ndarray:
    """Return the distance in m from places (n, 3), middles of holes, to the nearest bench face.

    Negative where a position lies in front of all faces at its height, infinite where no face
    reaches its height.
    """
    places = np.asarray(places, dtype=float)
    result = np.full(len(places), np.inf)
    for bench in benches:
        for row, position in enumerate(places):
            line = _line_at(bench, position[2])
            if line is not None:
                distance = _signed_distance(line, position[:2])
                if abs(distance) < abs(result[row]):
                    result[row] = distance
    return result


def _line_at(bench, height):
    """Return the face of a bench in plan at a height, None beyond its crest or toe."""
    top, bottom = bench.crest, bench.toe
    if len(top) != len(bottom):
        position = np.linspace(0.0, 1.0, max(len(top), len(bottom)))
        top, bottom = (_resampled(line, position) for line in (top, bottom))
    share = (top[:, 2] - height) / (top[:, 2] - bottom[:, 2])
    if (share < 0.0).all() or (share > 1.0).all():
        return None
    return (top + share[:, None] * (bottom - top))[:, :2]


def _resampled(line, shares):
    """Return points at shares of the length of a line."""
    length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line[:, :2], axis=0), axis=1)))
    return np.column_stack([np.interp(shares, length / length[-1], axis) for axis in line.T])


def _signed_distance(line, position):
    """Return the distance in m of a position to a line in plan, positive on its left."""
    start, run = line[:-1], np.diff(line, axis=0)
    share = np.einsum("ni,ni->n", position - start, run) / np.einsum("ni,ni->n", run, run)
    share[1:] = np.maximum(share[1:], 0.0)  # the line goes on straight beyond its ends
    share[:-1] = np.minimum(share[:-1], 1.0)
    away = position - (start + share[:, None] * run)
    nearest = np.linalg.norm(away, axis=1).argmin()
    side = 1.0 if _cross(run[nearest], away[nearest]) >= 0.0 else -1.0
    return float(side * np.linalg.norm(away[nearest]))
