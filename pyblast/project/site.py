"""Case folders of a diagnosis: reference ground, blasts, records, and checks of them."""

import tomllib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..blasts.blast import Blast
from ..blasts.hole_tables import read_blast
from ..errors import InputError, PyblastError, ReadError
from ..mesh.block_cutter import SIDES
from ..model.anisotropy import anisotropic, jointed, stiffness_of
from ..model.joint import Joint
from ..model.material import Material
from ..model.model import Receiver
from ..model.source import TimeFunction
from ..recordings.recording import Recording, read_stations

SPEEDS = 30.0, 10_000.0  # m/s, of waves in ground
EARLY = 1e-3  # of its peak that a moment rate may reach before its hole fires
NEAR = 1e-6  # m that a place may lie outside of the box


def check_site(site):
    """Refuse a `Site` that can't be as it is described, with the part that is to blame.

    Raises
    ------
    InputError
    """
    if not np.all(site.box[:, 0] < site.box[:, 1]):
        raise InputError(f"box: each axis must go from low to high, got {site.box.tolist()}")
    low, high = site.band
    if not 0.0 < low < high:
        raise InputError(f"recording.band_hz: must be lowest, highest, got {low:g}, {high:g}")
    first, last = site.noise_window
    if not first < last <= 0.0:
        raise InputError(
            "recording.noise_window_s: must begin and end before the first hole at 0, "
            f"got {first:g}, {last:g}"
        )
    _check_names("layers", [name for name, *_ in site.layers])
    _check_thicknesses(site)
    _check_names("joints", [one.joint.surface for one in site.joints])
    for name, _, rock in site.layers:
        if not SPEEDS[0] <= rock.cs < rock.cp <= SPEEDS[1]:
            raise InputError(
                f"layers.{name}: speeds must lie in {SPEEDS[0]:g} to {SPEEDS[1]:g} m/s, "
                f"got vp {rock.cp:g}, vs {rock.cs:g}"
            )
    for one in site.joints:
        if one.joint.surface in SIDES:
            raise InputError(f"joints.{one.joint.surface}: is a side of the box; take another name")
        start, end = site.box["xy".index(one.axis)]
        if not start < one.position < end:
            raise InputError(
                f"joints.{one.joint.surface}.position: must lie within the box, {start:g} to "
                f"{end:g} m, got {one.position:g}"
            )
        _check_rims(site.box, one)
    for one in site.receivers:
        refuse_outside(site.box, f"receivers.{one.name}", one.position)
    _check_source(site.moment_rate)
    for name, blast in site.blasts.items():
        check_holes(site.box, name, blast)
    _check_stations(site)


def _check_names(part, names):
    """Refuse a name that two layers or two joints have, by which one would stand for both."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{part}: {name!r} is there twice; each needs a name of its own")


def _check_thicknesses(site):
    """Refuse layers that do not share out the height of the box, the last taking the rest."""
    top, bottom = 0.0, site.box[2, 0] - site.box[2, 1]
    for name, thickness, _ in site.layers[:-1]:
        if thickness is None or not thickness > 0.0:
            raise InputError(f"layers.{name}.thickness_m: must be positive, got {thickness}")
        top -= thickness
        if top <= bottom:
            raise InputError(
                f"layers.{name}: ends {-top:g} m below the ground, at or below the bottom of the "
                f"box at {-bottom:g} m; leave out the layers below it, or give a deeper box"
            )
    name, thickness, _ = site.layers[-1]
    if thickness is not None:
        raise InputError(f"layers.{name}.thickness_m: the last layer has no end; leave it out")


def _check_rims(box, one):
    """Refuse a `SiteJoint` no part of which lies in the box (3, 2) m."""
    along, down = box["yx".index(one.axis)], box[2, 1] - box[2, ::-1]
    for name, part, room in (("extent", one.extent, along), ("depth", one.depth, down)):
        low, high = np.clip(part, *room)
        if not low < high:
            raise InputError(
                f"joints.{one.joint.surface}.{name}: must go from low to high and reach into the "
                f"box, {room[0]:g} to {room[1]:g} m, got {part[0]:g} to {part[1]:g}"
            )


def _check_source(rate):
    """Refuse a moment rate that begins before its hole fires: no run has begun there."""
    size = np.abs(rate.values)
    begins = rate.start + rate.dt * np.argmax(size > EARLY * np.max(size))
    if begins < 0.0:
        raise InputError(
            f"source: its moment rate begins at {begins:g} s, but no hole sends anything before it "
            f"fires at 0; shift the table, and all records with it, by {-begins:g} s to later"
        )


def check_holes(box, name, blast: Blast):
    """Refuse a blast of which a hole lies outside of a box (3, 2) m, or has an unknown charge."""
    for hole, place, charge in zip(blast.hole_ids, blast.centres, blast.charge, strict=True):
        refuse_outside(box, f"{name}: hole {hole}", place)
        if np.isnan(charge):
            raise InputError(f"{name}: hole {hole}: its charge is missing; give kg, 0 for a dud")
    if not np.any(blast.charge > 0.0):
        raise InputError(f"{name}: no hole has a charge")


def refuse_outside(box, name, place):
    """Refuse a place in m, of something of a name, that is not in a box (3, 2) m."""
    low, high = box.T
    if not (np.all(np.array(place) >= low - NEAR) and np.all(np.array(place) <= high + NEAR)):
        raise InputError(f"{name}: lies outside of the box of the ground; move it into it")


def _check_stations(site):
    """Refuse records of stations that are no receivers, which nothing would be compared with."""
    known = {one.name for one in site.receivers}
    for blast, records in site.records.items():
        for name in records:
            if name not in known:
                raise InputError(
                    f"{blast}: station {name!r} of its records is no receiver; list it, or take "
                    "it out of the file"
                )


NONE = 1e-9  # a weakness that changes nothing


@dataclass(frozen=True)
class Fabric:
    """Parallel fissures that make ground weaker across them; theory.md (2.21).

    Parameters
    ----------
    azimuth : float, rad
        Of their normal, from east to north.
    normal, shear : float
        Weaknesses in 0 to 1: the share of the compliance across them, or of that of sliding along
        them, that the fissures bring.

    Raises
    ------
    InputError
        If a weakness is none.
    """

    azimuth: float
    normal: float
    shear: float

    def __post_init__(self):
        """Refuse weaknesses that leave no stiffness."""
        for name in ("normal", "shear"):
            if not 0.0 <= getattr(self, name) < 1.0:
                value = getattr(self, name)
                raise InputError(f"fabric.{name}: must lie in 0 to 1, got {value:g}")

    def of(self, material: Material) -> Material:
        """Return elastic ground with these fissures, its mean shear modulus as it was."""
        across = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        modulus = material.first_lame + 2.0 * material.shear
        normal, shear = max(self.normal, NONE), max(self.shear, NONE)
        kn, ks = modulus * (1.0 / normal - 1.0), material.shear * (1.0 / shear - 1.0)
        weak = jointed(material, across, 1.0, kn, ks)
        stiffness = stiffness_of(weak) * (material.shear / weak.shear)
        strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
        return anisotropic(material.density, stiffness, **strength)


TABLE = "site.toml"


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
        Instant of each blast at which its table of holes has time 0.
    band : tuple of 2 float, Hz
    noise_window : tuple of 2 float, s
        After the first hole of a blast: when nothing but noise was recorded.
    ground : tuple of Gradient, DamagedZone or Heterogeneity
        Factors on the speeds of the layers.
    marks : tuple of (axis, position in m)
        Planes on which the zones shall end although nothing is there.
    fabric : Fabric, optional
        Of all ground, which is elastic then.
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
    noise_window: tuple[float, float]
    ground: tuple = ()
    marks: tuple[tuple[str, float], ...] = ()
    fabric: Fabric | None = None


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
    table = _table_of(folder)
    with _entries_of(folder):
        site = _site(folder, table)
        check_site(site)
    return site


def case_files(folder) -> list[Path]:
    """Return ``site.toml`` of a case folder and the files that it names, sorted.

    Raises
    ------
    ReadError
        As of `read_site`, of what names files; those themselves need not be there.
    """
    folder = Path(folder)
    table = _table_of(folder)
    with _entries_of(folder):
        rows = table["blasts"]
        names = [table["source"]["file"], *(row[k] for row in rows for k in ("holes", "records"))]
        return sorted({folder / TABLE, *(folder / name for name in names)})


def _table_of(folder):
    """Return the table of the ``site.toml`` of a folder."""
    path = folder / TABLE
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ReadError(f"{path}: can't be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ReadError(f"{path}: not valid TOML ({error})") from None


@contextmanager
def _entries_of(folder):
    """Name the ``site.toml`` of a folder where an entry is missing or of a wrong kind."""
    path = folder / TABLE
    try:
        yield
    except KeyError as error:
        raise ReadError(f"{path}: entry {error} is missing") from None
    except PyblastError:
        raise
    except (TypeError, AttributeError, IndexError, ValueError) as error:
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
        if row["id"] in blasts:
            raise InputError(f"blasts: {row['id']!r} is there twice; each needs a name of its own")
        blasts[row["id"]] = read_blast(folder / row["holes"])
        records[row["id"]] = read_stations(folder / row["records"], time_zero=row["time_zero"])
    return Site(
        name=table["case"],
        box=np.array([table["box"][axis] for axis in "xyz"], dtype=float),
        layers=layers,
        joints=tuple(_joint(row) for row in table.get("joints", [])),
        quality=(table["attenuation"]["Qp"], table["attenuation"]["Qs"]) if known else None,
        receivers=tuple(Receiver(r["id"], (r["x"], r["y"], r["z"])) for r in table["receivers"]),
        moment_rate=_moment_rate(folder / table["source"]["file"]),
        exponent=float(table["source"]["charge_exponent"]),
        blasts=blasts,
        records=records,
        time_zeros={row["id"]: row["time_zero"] for row in table["blasts"]},
        band=tuple(table["recording"]["band_hz"]),
        noise_window=tuple(table["recording"]["noise_window_s"]),
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
