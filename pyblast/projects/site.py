"""Case folders: a site as it is believed to be, its blasts, and what the receivers recorded."""

import tomllib
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..blasting.blast import Blast
from ..blasting.hole_tables import read_blast
from ..errors import InputError, ReadError
from ..meshing.mesh_builder import Layer, structured_box
from ..records.recordings import Recording, read_stations
from ..solving.attenuation import ConstantQ
from ..solving.boundaries import Viscous
from ..solving.joints import Joint
from ..solving.materials import Material
from ..solving.model import Model, Receiver, Rim
from ..solving.sources import Hole, TimeFunction

GROWTH = 1.08
PADDING = 220.0
BEYOND_BAND = 3.0  # how far beyond the band of the records, both ways, a quality factor holds


@dataclass(frozen=True, eq=False)
class SiteJoint:
    """A vertical joint on the plane ``axis`` = ``position``, over the whole ground or a part.

    Parameters
    ----------
    joint : Joint
    axis : str
        "x" or "y".
    position : float, m
    extent : tuple of 2 float, m
        Along the other horizontal axis.
    depth : tuple of 2 float, m
        Below the ground, positive down.
    """

    joint: Joint
    axis: str
    position: float
    extent: tuple[float, float] = (-np.inf, np.inf)
    depth: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True, eq=False)
class Site:
    """A believed site and its blasts.

    Parameters
    ----------
    name : str
    box : (3, 2) float64, m
        The ground goes on beyond its sides and bottom; its top is free.
    layers : tuple of (name, thickness m or None, Material)
        From the top down.
    joints : tuple of SiteJoint
    quality : tuple of 2 float, or None
        Qp and Qs where they are known.
    receivers : tuple of Receiver
    moment_rate : TimeFunction
        Of 1 kg, N m/s.
    exponent : float
        Of the charge.
    blasts : dict of str to Blast
    records : dict of str to dict of str to Recording
        By blast and receiver.
    time_zeros : dict of str to str
        Instant of the first hole of each blast.
    band : tuple of 2 float, Hz
    """

    name: str
    box: np.ndarray
    layers: tuple
    joints: tuple[SiteJoint, ...]
    quality: tuple[float, float] | None
    receivers: tuple[Receiver, ...]
    moment_rate: TimeFunction
    exponent: float
    blasts: dict[str, Blast]
    records: dict[str, dict[str, Recording]]
    time_zeros: dict[str, str]
    band: tuple[float, float]


def read_site(folder) -> Site:
    """Read a case folder: ``site.toml``, hole tables, records.

    Raises
    ------
    ReadError
        If a file is missing or broken, or an entry of ``site.toml`` is missing or of a wrong kind.
    InputError
        If a value breaks a rule.
    """
    folder = Path(folder)
    path = folder / "site.toml"
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ReadError(f"{path}: can't be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ReadError(f"{path}: not valid TOML ({error})") from None
    try:
        return _site(folder, table)
    except KeyError as error:
        raise ReadError(f"{path}: entry {error} is missing") from None
    except (TypeError, AttributeError, IndexError) as error:
        raise ReadError(f"{path}: an entry is of the wrong kind ({error})") from None


def _site(folder, table):
    """Build the site from the table of ``site.toml``."""
    layers = tuple(
        (
            row["name"],
            row.get("thickness_m"),
            Material.from_speeds(row["density"], row["vp"], row["vs"]),
        )
        for row in table["layers"]
    )
    known = table["attenuation"]["known"]
    blasts, records = {}, {}
    for row in table["blasts"]:
        blasts[row["id"]] = read_blast(folder / row["holes"])
        records[row["id"]] = read_stations(folder / row["records"], time_zero=row["time_zero"])
    return Site(
        name=table["case"],
        box=np.array([table["box"][axis] for axis in "xyz"], dtype=float),
        layers=layers,
        joints=tuple(_joint(row) for row in table["joints"]),
        quality=(table["attenuation"]["Qp"], table["attenuation"]["Qs"]) if known else None,
        receivers=tuple(Receiver(r["id"], (r["x"], r["y"], r["z"])) for r in table["receivers"]),
        moment_rate=_moment_rate(folder / table["source"]["file"]),
        exponent=float(table["source"]["charge_exponent"]),
        blasts=blasts,
        records=records,
        time_zeros={row["id"]: row["time_zero"] for row in table["blasts"]},
        band=tuple(table["recording"]["band_hz"]),
    )


def _joint(row):
    """Build one joint from its row."""
    if row["axis"] not in ("x", "y"):
        raise InputError(f"joints.{row['id']}.axis: must be x or y, got {row['axis']}")
    if row["law"] != "linear":
        raise InputError(f"joints.{row['id']}.law: only 'linear' is known, got {row['law']}")
    joint = Joint(
        row["id"],
        "elastic",
        {"kn": row["kn"], "ks": row["ks"]},
        insitu_pressure=float(row.get("insitu_normal_stress", 0.0)),
    )
    limits = {}
    if not row.get("whole_box", True):
        limits = {"extent": tuple(row["extent"]), "depth": tuple(row["depth"])}
    return SiteJoint(joint, row["axis"], float(row["position"]), **limits)


def _moment_rate(path):
    """Read the source table."""
    try:
        times, rate = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    except (OSError, ValueError) as error:
        raise ReadError(f"{path}: needs two columns, time and moment rate ({error})") from None
    steps = np.diff(times)
    if len(times) < 4 or not np.allclose(steps, steps[0], rtol=1e-3):
        raise ReadError(f"{path}: times must be evenly spaced, at least four of them")
    return TimeFunction(rate, float(np.mean(steps)), float(times[0]))


def site_mesh(site, edge, padding=PADDING):
    """Mesh the ground of a site, with its joints split.

    Parameters
    ----------
    site : Site
    edge : float, m
        Of the cubes inside the box.
    padding : float, m
        How far the ground goes on beyond the sides and the bottom, in growing cells.

    Returns
    -------
    Mesh
    """
    anchors = {axis: [j.position for j in site.joints if j.axis == axis] for axis in "xy"}
    for j in site.joints:
        anchors["y" if j.axis == "x" else "x"] += [e for e in j.extent if np.isfinite(e)]
    thickness = [t for _, t, _ in site.layers[:-1]]
    depths = [d for joint in site.joints for d in joint.depth if np.isfinite(d)]
    heights = [*-np.cumsum(thickness), *np.negative(depths)]
    axes = [
        graded_axis(site.box[0], anchors["x"], edge, padding, padding),
        graded_axis(site.box[1], anchors["y"], edge, padding, padding),
        graded_axis(site.box[2], heights, edge, padding, 0.0),
    ]
    layers = [Layer(name, thickness) for name, thickness, _ in site.layers]
    planes = {j.joint.surface: (j.axis, j.position) for j in site.joints}
    mesh = structured_box(*axes, layers=layers, planes=planes, pattern="alternating")
    surfaces = dict(mesh.surfaces)
    for j in site.joints:
        faces = surfaces[j.joint.surface]
        centre = mesh.points[faces].mean(axis=1)
        along = centre[:, 1 if j.axis == "x" else 0]
        inside = (along > j.extent[0]) & (along < j.extent[1])
        inside &= (-centre[:, 2] > j.depth[0]) & (-centre[:, 2] < j.depth[1])
        surfaces[j.joint.surface] = faces[inside]
    return replace(mesh, surfaces=surfaces).split([j.joint.surface for j in site.joints])


def graded_axis(limits, anchors, edge, before, after):
    """Return ascending coordinates: even cells between limits and anchors, growing ones outside.

    Parameters
    ----------
    limits : (2,) float, m
    anchors : sequence of float, m
        Coordinates that must be on the grid; those outside the limits are left out.
    edge : float, m
        Cells between two anchors are at most this long.
    before, after : float, m
        How far the grid goes on outside.
    """
    inside = sorted({float(a) for a in anchors if limits[0] < a < limits[1]})
    stops = [float(limits[0]), *inside, float(limits[1])]
    pieces = [
        np.linspace(low, high, max(1, int(np.ceil((high - low) / edge - 1e-9))) + 1)[:-1]
        for low, high in pairwise(stops)
    ]

    def outside(distance):
        steps, size = [], edge
        while distance > 0.0 and sum(steps) < distance:
            size *= GROWTH
            steps.append(size)
        return np.cumsum(steps)

    low, high = stops[0] - outside(before)[::-1], stops[-1] + outside(after)
    return np.concatenate([low, *pieces, [stops[-1]], high])


def site_model(site, blast, mesh, spread, padding=PADDING) -> Model:
    """Model one blast of a site with its holes as isotropic sources.

    Parameters
    ----------
    site : Site
    blast : str
    mesh : Mesh
    spread : float, m
        Radius over which each hole is spread.
    padding : float, m
        As given to `site_mesh`; the ground out there damps what leaves the box.
    """
    holes = site.blasts[blast]
    sources = [
        Hole(place, charge, time, site.moment_rate, site.exponent, spread)
        for place, charge, time in zip(holes.centres, holes.charge, holes.times, strict=True)
    ]
    materials = {name: material for name, _, material in site.layers}
    if site.quality is not None:
        low, high = site.band
        law = ConstantQ(*site.quality, (low / BEYOND_BAND, high * BEYOND_BAND))
        materials = {name: replace(m, law=law) for name, m in materials.items()}
    return Model(
        mesh,
        materials,
        joints=[j.joint for j in site.joints],
        boundaries=[Viscous(side) for side in ("west", "east", "south", "north", "bottom")],
        rim=Rim(tuple(map(tuple, site.box)), padding),
        sources=sources,
        receivers=site.receivers,
    )
