"""Fractures as they are mapped: discs and polygons from files, and random sets of discs."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError, ReadError
from ..mesh.grid import Fault, upward_normal
from ..readers.cells import read_bytes, unit_name
from ..readers.geometry import LENGTHS, file_unit, read_faces, read_positions
from ..readers.kinds import expect
from ..readers.provenance import ReadLog

MOST_FRACTURES = 500
SIDES = 12  # of the polygon that stands for a disc
SIZE_LAWS = ("constant", "exponential", "lognormal", "power")
_FLAT = 0.01  # largest distance of a corner from the plane of a polygon, over its size
_QUANTILES = (np.arange(20000) + 0.5) / 20000


@dataclass(frozen=True)
class SizeLaw:
    """Law of the radii of discs, truncated to a range.

    Parameters
    ----------
    name : str
        One of `SIZE_LAWS`. "power": the number of discs above a radius falls with its power.
    mean, deviation : float, m
        Of the law before truncation; the deviation of "lognormal" only.
    exponent : float
        Of "power", positive.
    range : tuple of 2 float, m
        Smallest and largest radius.
    """

    name: str
    mean: float = 1.0
    deviation: float = 0.0
    exponent: float = 0.0
    range: tuple[float, float] = (0.0, np.inf)

    def __post_init__(self) -> None:
        """Check the values."""
        low, high = self.range
        if self.name not in SIZE_LAWS:
            raise InputError(f"radius law: must be one of {', '.join(SIZE_LAWS)}, got {self.name}")
        if not 0.0 <= low <= high or not self.mean > 0.0:
            raise InputError(
                f"radius law: needs a positive mean and a range that rises, got {self.mean:g} m "
                f"and {low:g} to {high:g} m"
            )
        if self.name == "lognormal" and not self.deviation > 0.0:
            raise InputError(f"radius law: lognormal needs a deviation, got {self.deviation:g} m")
        if self.name == "power" and not (0.0 < low < high < np.inf and self.exponent > 0.0):
            raise InputError(
                "radius law: power needs a positive exponent and a range from above 0, got "
                f"{self.exponent:g} and {low:g} to {high:g} m"
            )

    def radii(self, shares: ArrayLike) -> np.ndarray:
        """Return the radii (n,) in m at shares (n,) of the truncated distribution."""
        shares, (low, high) = np.asarray(shares, dtype=float), self.range
        if self.name == "constant":
            return np.full(shares.shape, self.mean)
        if self.name == "power":
            a, b = low**-self.exponent, high**-self.exponent
            return (a - shares * (a - b)) ** (-1.0 / self.exponent)
        if self.name == "exponential":
            a, b = np.exp(-low / self.mean), np.exp(-high / self.mean)
            return -self.mean * np.log(a - shares * (a - b))
        spread = np.sqrt(np.log1p((self.deviation / self.mean) ** 2))
        law = scipy.stats.lognorm(spread, scale=self.mean / np.exp(0.5 * spread**2))
        a, b = law.cdf(low), law.cdf(high)
        return law.ppf(a + shares * (b - a))

    def mean_area(self) -> float:
        """Return the mean area of the discs, m2."""
        return float(np.pi * np.mean(self.radii(_QUANTILES) ** 2))


def fisher_normals(
    mean: ArrayLike, kappa: float, count: int, generator: np.random.Generator
) -> np.ndarray:
    """Draw unit normals (n, 3) from Fisher's distribution around a mean direction.

    Parameters
    ----------
    mean : (3,) float, unit
    kappa : float
        Concentration; infinite: all parallel.
    count : int
    generator : numpy Generator

    Notes
    -----
    Density proportional to ``exp(kappa cos theta)`` on the sphere (R. A. Fisher, Dispersion on a
    sphere, Proc. R. Soc. A 217 (1953) 295-305); the mean of ``cos theta`` is
    ``coth kappa - 1/kappa``. The cosine is drawn by inversion.
    """
    mean = np.asarray(mean, dtype=float)
    share, turn = generator.random(count), 2.0 * np.pi * generator.random(count)
    if np.isinf(kappa):
        return np.tile(mean, (count, 1))
    cosine = 1.0 + np.log(share + (1.0 - share) * np.exp(-2.0 * kappa)) / kappa
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    first = np.cross(mean, np.eye(3)[np.abs(mean).argmin()])
    first /= np.linalg.norm(first)
    second = np.cross(mean, first)
    around = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return cosine[:, None] * mean + sine[:, None] * around


@dataclass(frozen=True)
class FractureSet:
    """Random set of discs.

    Parameters
    ----------
    name : str
        Of the joint surface, which all discs share.
    dip, dip_direction : float, rad
        Of the mean plane.
    kappa : float
        Fisher's concentration of the normals.
    p32 : float, 1/m
        Area of fractures in a volume, by expectation.
    sizes : SizeLaw
    seed : int
    """

    name: str
    dip: float
    dip_direction: float
    kappa: float
    p32: float
    sizes: SizeLaw
    seed: int = 0

    def draw(self, box: ArrayLike) -> list[Fault]:
        """Draw the discs whose middles lie in a box or within their largest radius around it.

        Parameters
        ----------
        box : (3, 2) float, m

        Returns
        -------
        list of Fault, those that reach into the box

        Raises
        ------
        InputError
            If there would be more than `MOST_FRACTURES`.
        """
        box = np.asarray(box, dtype=float)
        generator = np.random.default_rng([self.seed, 32])
        reach = float(self.sizes.radii([1.0 - 1e-6])[0])
        wide = box + np.array([-reach, reach])
        expected = self.p32 * np.prod(np.ptp(wide, axis=1)) / self.sizes.mean_area()
        if expected > 20.0 * MOST_FRACTURES:
            raise InputError(_too_many(self.name, expected))
        count = int(generator.poisson(expected))
        middles = wide[:, 0] + generator.random((count, 3)) * np.ptp(wide, axis=1)
        radii = self.sizes.radii(generator.random(count))
        mean = upward_normal(self.dip, self.dip_direction)
        normals = fisher_normals(mean, self.kappa, count, generator)
        discs = [
            Fault(self.name, point=tuple(middle), normal=tuple(normal), polygon=corners)
            for middle, normal, corners in zip(
                middles, normals, disc_corners(middles, normals, radii), strict=True
            )
        ]
        return refuse_many(self.name, [disc for disc in discs if area_within(disc, box) > 0.0])


def _too_many(name, count):
    """Say that a set has too many fractures."""
    return (
        f"{name}: at most {MOST_FRACTURES} fractures can be cut, got about {count:.0f}; raise the "
        "smallest radius, or represent small ones by the stiffness of the rock"
    )


def refuse_many(name: str, faults: list[Fault]) -> list[Fault]:
    """Return fractures as they are; raise InputError if they are more than `MOST_FRACTURES`."""
    if len(faults) > MOST_FRACTURES:
        raise InputError(_too_many(name, len(faults)))
    return faults


def disc_corners(middles: ArrayLike, normals: ArrayLike, radii: ArrayLike) -> np.ndarray:
    """Return the corners (n, 12, 3) in m of polygons with the areas of discs.

    Parameters
    ----------
    middles, normals : (n, 3) float, m and unit
    radii : (n,) float, m
    """
    normals = np.asarray(normals, dtype=float)
    strike = np.cross([0.0, 0.0, 1.0], normals)
    level = np.linalg.norm(strike, axis=1) < 1e-12
    strike[level] = [1.0, 0.0, 0.0]
    strike /= np.linalg.norm(strike, axis=1)[:, None]
    down = np.cross(normals, strike)
    turn = 2.0 * np.pi * np.arange(SIDES) / SIDES
    size = np.sqrt(2.0 * np.pi / SIDES / np.sin(2.0 * np.pi / SIDES)) * np.asarray(radii)
    around = np.cos(turn)[:, None] * strike[:, None] + np.sin(turn)[:, None] * down[:, None]
    return np.asarray(middles)[:, None] + size[:, None, None] * around


def polygon(name: str, corners: ArrayLike) -> Fault:
    """Return a fracture with given corners.

    Parameters
    ----------
    name : str
    corners : (n, 3) float, m

    Raises
    ------
    InputError
        If the corners do not lie in one plane or their polygon is not convex.
    """
    corners = np.asarray(corners, dtype=float)
    if corners.ndim != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(f"{name}: a polygon needs three finite corners or more")
    middle = corners.mean(axis=0)
    away = corners - middle
    area = 0.5 * np.cross(away, np.roll(away, -1, axis=0)).sum(axis=0)
    size, length = np.abs(away).max(), float(np.linalg.norm(area))
    if not length > 1e-6 * size**2:
        raise InputError(f"{name}: the corners of a polygon lie on one line near {_at(middle)}")
    normal = area / length * (1.0 if area[2] >= 0.0 else -1.0)
    if np.abs(away @ normal).max() > _FLAT * size:
        raise InputError(
            f"{name}: the polygon near {_at(middle)} is not plane, a corner lies "
            f"{np.abs(away @ normal).max():.3g} m off; cut it into triangles"
        )
    corners = corners - np.outer(away @ normal, normal)
    run = np.roll(corners, -1, axis=0) - corners
    turns = np.cross(run, np.roll(run, -1, axis=0)) @ area
    if not (turns > -1e-9 * size**4).all():
        raise InputError(f"{name}: the polygon near {_at(middle)} is not convex; cut it in two")
    return Fault(name, point=tuple(middle), normal=tuple(normal), polygon=corners)


def _at(position):
    """Write a position."""
    return "({:.4g}, {:.4g}, {:.4g}) m".format(*position)


def clipped(corners: np.ndarray, normal: np.ndarray, offset: float) -> np.ndarray:
    """Return the part (m, 3) of a convex polygon (n, 3) with ``normal . x <= offset``, m."""
    height = corners @ normal - offset
    parts = []
    for a in range(len(corners)):
        b = (a + 1) % len(corners)
        if height[a] <= 0.0:
            parts.append(corners[a])
        if height[a] * height[b] < 0.0:
            share = height[a] / (height[a] - height[b])
            parts.append(corners[a] + share * (corners[b] - corners[a]))
    return np.array(parts).reshape(-1, 3)


def polygon_area(corners: np.ndarray) -> float:
    """Return the area of a plane polygon (n, 3), m2."""
    if len(corners) < 3:
        return 0.0
    away = corners - corners[0]
    return 0.5 * float(np.linalg.norm(np.cross(away, np.roll(away, -1, axis=0)).sum(axis=0)))


def area_within(fracture: Fault, box: ArrayLike) -> float:
    """Return the area of a fracture within a box (3, 2), m2."""
    corners = np.asarray(fracture.polygon, dtype=float)
    for axis, (low, high) in enumerate(np.asarray(box, dtype=float)):
        side = np.eye(3)[axis]
        corners = clipped(clipped(corners, side, high), -side, -low)
        if len(corners) < 3:
            return 0.0
    return polygon_area(corners)


def terminated(fractures: Sequence[Fault], at: Sequence[Fault]) -> list[Fault]:
    """Return fractures that end at unbounded faults: the parts on the side of their middles.

    Parameters
    ----------
    fractures : sequence of Fault, with polygons
    at : sequence of Fault
    """
    result = []
    for fracture in fractures:
        corners = np.asarray(fracture.polygon)
        for fault in at:
            normal = fault.unit_normal
            offset = float(normal @ fault.point)
            side = 1.0 if normal @ fracture.point <= offset else -1.0
            corners = clipped(corners, side * normal, side * offset)
        if len(corners) >= 3:
            result.append(replace(fracture, polygon=corners))
    return result


def read_fractures(
    path: str | Path, name: str, *, box: ArrayLike | None = None, unit: str | None = None,
    log: ReadLog | None = None,
) -> list[Fault]:  # fmt: skip
    """Read mapped fractures by the content of their file.

    Parameters
    ----------
    path : str or Path
        DXF (faces), text of FracMan (``.fab``: BEGIN FRACTURE, a line with number and count
        of corners, the corners, and a line of the normal; words of its FORMAT are obeyed or
        refused), or a table. A table of discs has the head
        ``x_m,y_m,z_m,dip_deg,dip_direction_deg,radius_m``, one of corners
        ``fracture,x_m,y_m,z_m``.
    name : str
        Of the joint surface.
    box : (3, 2) float, m, optional
        Of the ground, which fractures must meet in their unit.
    unit : str, optional
        In the place of what a header says, or of lengths whose titles say none.
    log : ReadLog, optional
        Takes what was read.

    Raises
    ------
    ReadError
        If the file can't be read or holds no fractures.
    InputError
        If a fracture can't be cut, the unit can't be decided, or nothing meets the box.
    """
    path = Path(path)
    content = read_bytes(path)
    kind = expect(path.name, content, "fractures").name
    if kind == "DXF":
        faces = read_faces(path, box=box, unit=unit, log=log)
        return [polygon(name, corners) for corners in faces]
    if kind == "FracMan text":
        faces, said = _fab(path.name, content.decode("utf-8", errors="replace"))
        symbol, why = file_unit(path.name, np.concatenate(faces), box, unit or said)
        (log or ReadLog()).file(path, kind).column(
            "faces", "corners", symbol, LENGTHS[symbol], rows=len(faces), why=why
        )
        return [polygon(name, LENGTHS[symbol] * corners) for corners in faces]
    table = read_positions(path, "fractures", box=box, unit=unit, log=log)
    for key in {"dip", "dip_direction"} & set(table.values):
        if (absent := np.isnan(table.values[key])).any():
            line = table.lines[int(absent.argmax())]
            raise ReadError(f"{path.name}, line {line}: {key} is missing, expected a number")
    places = np.column_stack([table.values[axis] for axis in "xyz"])
    if {"dip", "dip_direction", "radius"} <= set(table.values):
        return _discs(table, name, places)
    if "fracture" not in table.values:
        raise ReadError(
            f"{path.name}: needs beside x_m,y_m,z_m the columns dip_deg,dip_direction_deg,radius_m "
            "of discs, or a column fracture that names the polygon of each corner"
        )
    parts: dict[str, list] = {}
    for label, corner in zip(table.values["fracture"], places, strict=True):
        parts.setdefault(label, []).append(corner)
    return [polygon(f"{name}, fracture {label}", part) for label, part in parts.items()]


def _discs(table, name, middles):
    """Return the fractures of a table of discs."""
    dip, azimuth, radius = (table.values[key] for key in ("dip", "dip_direction", "radius"))
    bad = ~((dip >= 0.0) & (dip <= np.pi / 2.0 + 1e-9) & (radius > 0.0))
    if bad.any():
        raise ReadError(
            f"{table.where}, line {table.lines[int(bad.argmax())]}: dip_deg must lie between 0 and "
            "90 and radius_m be positive"
        )
    normals = np.array([upward_normal(*each) for each in zip(dip, azimuth, strict=True)])
    corners = disc_corners(middles, normals, radius)
    return [
        Fault(name, point=tuple(middle), normal=tuple(normal), polygon=polygon_corners)
        for middle, normal, polygon_corners in zip(middles, normals, corners, strict=True)
    ]


# Words of FORMAT that change places or amounts beside Length_Unit and No_Fractures: what is read.
FAB_WORDS = {"format": "ascii", "xaxis": "east", "no_tessfractures": "0"}


def _fab(file, text):
    """Return the polygons (n, 3) of a FracMan text, and its unit of lengths, None if not said."""
    head = text.partition("END FORMAT")[0]
    words = re.findall(r"(?m)^[ \t]*(\w+)[ \t]*=[ \t]*([^\r\n]*\S)", head)
    said = {key.lower(): value for key, value in words}
    for key, read in FAB_WORDS.items():
        if said.get(key, read).lower() != read:
            raise ReadError(f"{file}: {key} = {said[key]} is not read; export with {read}")
    unit = said.get("length_unit")
    if unit is not None and unit_name(unit) not in LENGTHS:
        raise ReadError(f"{file}: unknown Length_Unit {unit[:40]!r}; export in metres")
    block = re.search(r"BEGIN FRACTURE\s*\n(.*?)END FRACTURE", text, re.S | re.I)
    if block is None:
        raise ReadError(f"{file}: holds no block BEGIN FRACTURE ... END FRACTURE")
    lines, polygons = [line.split() for line in block[1].splitlines() if line.strip()], []
    try:
        while lines:
            count = int(lines[0][1])
            corners = np.array(lines[1 : count + 1], dtype=float)
            if not np.array_equal(np.diff(corners[:, 0]), np.ones(count - 1)):
                raise ValueError
            polygons.append(corners[:, 1:4])
            lines = lines[count + 2 :]  # the line after the corners holds the normal
    except (ValueError, IndexError):
        number = len(polygons) + 1
        raise ReadError(f"{file}: fracture {number} can't be read; export text") from None
    if str(len(polygons)) != said.get("no_fractures", str(len(polygons))) or not polygons:
        raise ReadError(f"{file}: No_Fractures = {said.get('no_fractures')}, found {len(polygons)}")
    return polygons, unit and unit_name(unit)
