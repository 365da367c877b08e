"""Project files of a case folder: one TOML file of a site in SI units, hole tables, records.

    python examples/case_folder.py FOLDER OUT
    pyblast diagnose OUT/S1.toml

Writes a project file for each blast, and copies of what they name; the first lists the others.
Units of ``FOLDER/site.toml`` are SI; x is east, y north, z up, the ground surface at z = 0. Other
keys are not read:

    case = "bench 12"
    layers = [{ name = "soil", thickness_m = 8, density = 2100, vp = 1500, vs = 800 },
              { name = "rock", density = 2650, vp = 3000, vs = 1650 }]  # the last has no end
    receivers = [{ id = "R01", x = 134.5, y = 117.9, z = 0.0 }]  # id: the station of its records
    [box]                          # holds all holes and receivers; an absorbing layer is put around
    x = [0, 230]
    y = [0, 170]
    z = [-76, 0]
    [attenuation]
    known = false                  # or true, with Qp and Qs
    [[joints]]                     # vertical, across x or y
    id = "J1"
    axis = "x"
    position = 81.0
    law = "linear"
    kn = 2.4e9                     # Pa/m
    ks = 9e8
    insitu_normal_stress = 2e5     # Pa
    whole_box = true               # or false, with extent = [from, to] along it, depth = [from, to]
    [source]
    file = "source.csv"            # time in s after the hole fires, moment rate of 1 kg in N m/s
    charge_exponent = 0.97         # moment grows with this power of the charge
    [[blasts]]
    id = "S1"
    holes = "S1_holes.csv"         # id,x,y,z,charge_kg,delay_s: middles of charges
    records = "S1.mseed"           # m/s, channels that end in E, N, Z
    time_zero = "2024-05-01T10:00:00Z"  # from which the holes' times count
    [recording]
    band_hz = [4, 30]              # the band that is compared
    noise_window_s = [-0.3, 0]     # noise only, relative to time_zero
"""

import json
import re
import shutil
import sys
import tomllib
from pathlib import Path

from pyblast.errors import InputError
from pyblast.recordings.recording import read_stations

SIDES = ["west", "east", "south", "north", "bottom"]
PADDING, PADDING_EDGES = 0.2, 3.0  # of the longest S wavelength; ratio of edges to those inside
PER_WAVE = 10.0  # edges to the shortest S wavelength
BEYOND_BAND = 3.0  # factor by which quality factors hold beyond the band of the records, both ways


def write_projects(folder: Path, out: Path) -> Path:
    """Write the project files of a case folder; return the first.

    Raises
    ------
    InputError
        If a key of ``site.toml`` is missing, or a joint is neither linear nor across x or y.
    """
    folder, out = Path(folder), Path(out)
    site = tomllib.loads((folder / "site.toml").read_text(encoding="utf-8"))
    out.mkdir(parents=True, exist_ok=True)
    try:
        names = [blast["id"] for blast in site["blasts"]]
        for blast in site["blasts"]:
            for name in (site["source"]["file"], blast["holes"], blast["records"]):
                (out / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(folder / name, out / name)
            records = read_stations(out / blast["records"], time_zero=blast["time_zero"])
            tables = project_tables(site, blast, records)
            if blast["id"] == names[0]:
                tables["diagnosis"]["blasts"] = [f"{name}.toml" for name in names[1:]]
            write_project(out / f"{blast['id']}.toml", tables)
    except KeyError as error:
        raise InputError(f"{folder / 'site.toml'}: {error.args[0]}: missing; add it") from None
    return out / f"{names[0]}.toml"


def project_tables(site: dict, blast: dict, records: dict) -> dict:
    """Return the tables of the project file of one blast, for its records by station."""
    low, high = site["recording"]["band_hz"]
    known, box, layers = site["attenuation"], site["box"], site["layers"]
    slowest = min(layer["vs"] for layer in layers)
    quality = {}
    if known["known"]:
        band = [low / BEYOND_BAND, high * BEYOND_BAND]
        quality = {"qp": known["Qp"], "qs": known["Qs"], "quality_band_hz": band}
    joints, names = site.get("joints", []), list(records)
    last = min((float(one.seismogram.times[-1]) for one in records.values()), default=0.0)
    return {
        "title": site["case"],
        "mesh": {
            "size_m": [box[axis][1] - box[axis][0] for axis in "xyz"],
            "origin_m": [box[axis][0] for axis in "xyz"],
            "edges_per_wavelength": PER_WAVE, "frequency_hz": high,
            "padding_m": PADDING * slowest / low,
            "padding_edge_m": PADDING_EDGES * slowest / (PER_WAVE * high),
            "layers": [
                {"material": layer["name"]}
                | ({"thickness_m": layer["thickness_m"]} if "thickness_m" in layer else {})
                for layer in layers
            ],
            "faults": [fault_of(joint, box) for joint in joints],
        },
        "materials": {
            layer["name"]: {
                "density_kg_per_m3": layer["density"], "cp_m_per_s": layer["vp"],
                "cs_m_per_s": layer["vs"], **quality,
            }
            for layer in layers
        },
        "joints": {
            joint["id"]: {
                "law": "elastic", "kn_gpa_per_m": scaled(joint["kn"], 1e-9),
                "ks_gpa_per_m": scaled(joint["ks"], 1e-9),
                "insitu_pressure_kpa": scaled(joint.get("insitu_normal_stress", 0.0), 1e-3),
            }
            for joint in joints
        },
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "blast": {"file": blast["holes"], "charge_exponent": site["source"]["charge_exponent"]},
        "holes_inside": {"moment_rate_file": site["source"]["file"]},
        "receivers": [
            {"name": one["id"], "position_m": [one["x"], one["y"], one["z"]]}
            | ({"recorded": {
                "file": blast["records"], "record": 1 + names.index(one["id"]), "unit": "m_per_s",
                "start_s": float(records[one["id"]].seismogram.start),
            }} if one["id"] in records else {})
            for one in site["receivers"]
        ],
        "run": {"duration_s": max(last, 1e-3), "compare_band_hz": [low, high]},
        "diagnosis": {"noise_window_s": site["recording"]["noise_window_s"]},
    }  # fmt: skip


def fault_of(joint: dict, box: dict) -> dict:
    """Return the table of a vertical joint as a fault."""
    name, across = joint["id"], joint["axis"]
    if across not in ("x", "y") or joint["law"] != "linear":
        raise InputError(
            f"joints.{name}: must be across x or y and linear, got {across!r}, {joint['law']!r}"
        )
    along = box["y" if across == "x" else "x"]
    middle, down, sizes = 0.5 * sum(along), 0.0, {}
    if not joint.get("whole_box", True):
        (low, high), (upper, lower) = joint["extent"], joint["depth"]
        middle, down = 0.5 * (low + high), 0.5 * (upper + lower)
        sizes = {"extent_m": [high - low, lower - upper]}
    position = [joint["position"], middle] if across == "x" else [middle, joint["position"]]
    return {
        "name": name, "dip_deg": 90, "dip_direction_deg": 90 if across == "x" else 0,
        "through_m": [*position, box["z"][1] - down], **sizes,
    }  # fmt: skip


def scaled(value: float, factor: float) -> float:
    """Return a value in another unit, as it is written: 4.5e8 times 1e-9 is 0.45."""
    return float(f"{value * factor:.15g}")


def write_project(path: Path, tables: dict):
    """Write nested tables as a TOML file, each table of the first level under its name."""
    lines = []
    for key, value in tables.items():
        if isinstance(value, str):
            lines.append(f"{key} = {toml(value)}")
            continue
        head = f"[{key}]" if isinstance(value, dict) else f"[[{key}]]"
        for table in [value] if isinstance(value, dict) else value:
            lines += [head, *(f"{named(k)} = {toml(v)}" for k, v in table.items())]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def named(key: str) -> str:
    """Return a key as TOML, in quotes where it has other signs than letters, digits, _ and -."""
    return key if re.fullmatch(r"[\w-]+", key, re.ASCII) else json.dumps(key)


def toml(value) -> str:
    """Return a value as TOML; tables on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{named(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("name the case folder and the folder to write to")
    print(f"written: {write_projects(*map(Path, sys.argv[1:]))}")
