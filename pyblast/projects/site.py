"""Case folders: a site as it is believed to be, its blasts, and what the receivers recorded."""

import tomllib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..blasting.blast import Blast
from ..blasting.hole_tables import read_blast
from ..errors import InputError, PyblastError, ReadError
from ..records.recordings import Recording, read_stations
from ..solving.joints import Joint
from ..solving.materials import Material
from ..solving.model import Receiver
from ..solving.sources import TimeFunction
from .site_checks import check_site
from .site_fabric import Fabric

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
