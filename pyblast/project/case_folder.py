"""Case folders: ``site.toml``, hole tables, records; read as the project of each blast."""

import tomllib
from dataclasses import replace
from pathlib import Path

from pydantic import Field, ValidationError

from ..blasts.hole_tables import read_blast
from ..config.config import check_config
from ..config.section import Name, Section, Span, read_time_function, sentence_of
from ..errors import InputError, ReadError, named_error
from ..model.joint import Joint
from ..model.material import Material
from ..readers.tables import Rules
from ..recordings.recording import read_stations
from .flat_box import (
    OUTER,
    check_flat,
    constant_q,
    flat_box,
    moment_begins,
    place_in_box,
    refuse_beyond,
)
from .inputs import Inside
from .project import Project, make_project

TABLE = "site.toml"
PADDING = 0.2  # of the longest S wavelength of the band
PADDING_EDGES = 3.0  # ratio of edges in the padding to those in the box


class _Layer(Section):
    """A layer, from the top down; the last has no end."""

    name: Name
    thickness_m: float | None = None
    halfspace: bool | None = None
    density: float
    vp: float
    vs: float


class _Receiver(Section):
    """A receiver; its name is the station of its records."""

    id: Name
    x: float
    y: float
    z: float


class _Channel(Section):
    """Orientation of a component; channels are identified by their last letter."""

    code: Name
    azimuth: float
    dip: float


class _Box(Section):
    """Box around all holes and receivers."""

    x: Span
    y: Span
    z: Span
    free_surface: str | None = None
    outer_boundaries: str | None = None


class _Attenuation(Section):
    """Attenuation: quality factors, if known."""

    known: bool
    Qp: float | None = None
    Qs: float | None = None


class _Joint(Section):
    """Vertical joint normal to x or y; its strength, if given, is not read."""

    id: Name
    axis: str
    position: float
    law: str
    kn: float
    ks: float
    insitu_normal_stress: float = 0.0
    whole_box: bool = True
    extent: Span | None = None
    depth: Span | None = None
    extent_axis: str | None = None
    normal: list[float] | None = None
    point: list[float] | None = None
    cohesion: float | None = None
    friction_deg: float | None = None


class _Source(Section):
    """Moment rate of 1 kg."""

    file: str
    charge_exponent: float
    type: str | None = None
    columns: list[str] | None = None
    moment_per_kg: float | None = None
    law: str | None = None


class _Blast(Section):
    """A blast: its holes and its records."""

    id: Name
    holes: str
    records: str
    time_zero: str
    total_charge_kg: float | None = None


class _Recording(Section):
    """Recording: band and noise window of the comparison."""

    band_hz: Span
    noise_window_s: Span
    sampling_rate: float | None = None
    pretrigger_s: float | None = None
    samples: int | None = None
    quantity: str | None = None
    unit: str | None = None
    response: str | None = None
    clock: str | None = None


class _Case(Section):
    """All tables of ``site.toml``; descriptive keys are accepted and not used."""

    case: Name
    units: str | None = None
    axes: str | None = None
    channels: list[_Channel] | None = None
    layers: list[_Layer]
    receivers: list[_Receiver]
    box: _Box
    attenuation: _Attenuation
    joints: list[_Joint] = Field([])
    source: _Source
    blasts: list[_Blast]
    recording: _Recording


def read_case_folder(folder) -> Project:
    """Read a case folder: ``site.toml``, hole tables, records.

    Returns
    -------
    Project
        Of the first blast, with the further ones.

    Raises
    ------
    ReadError
        If a file is missing or broken.
    InputError
        If a key of ``site.toml`` is unknown, missing or of a wrong kind, or a value breaks a rule.
    """
    folder = Path(folder)
    case = _case_of(folder)
    with named_error(TABLE):
        _check(case)
    every = [_project(folder, case, blast) for blast in case.blasts]
    project = replace(every[0], further=tuple(every[1:]))
    check_flat(project)
    _check_source(project.inside.moment_rate)
    _check_stations(project)
    return project


def case_files(folder) -> list[Path]:
    """Return ``site.toml`` of a case folder and the files that it names, sorted.

    Raises
    ------
    ReadError, InputError
        As of `read_case_folder`, of the table; the other files need not be there.
    """
    folder = Path(folder)
    case = _case_of(folder)
    names = [
        case.source.file,
        *(name for blast in case.blasts for name in (blast.holes, blast.records)),
    ]
    return sorted({folder / TABLE, *(folder / name for name in names)})


def _case_of(folder):
    """Return the checked table of the ``site.toml`` of a folder."""
    path = folder / TABLE
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ReadError(f"{path}: can't be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise ReadError(f"{path}: not valid TOML ({error})") from None
    try:
        return _Case.model_validate(table)
    except (ValidationError, RecursionError) as error:
        raise InputError(f"{path}: {sentence_of(error, _Case)}") from None


def _check(case):
    """Refuse values that no project can have."""
    for axis in "xyz":
        low, high = getattr(case.box, axis)
        if not low < high:
            raise InputError(f"box: each axis must go from low to high, got {axis} = {low:g}, "
                             f"{high:g}")  # fmt: skip
    low, high = case.recording.band_hz
    if not 0.0 < low < high:
        raise InputError(f"recording.band_hz: must be lowest, highest, got {low:g}, {high:g}")
    first, last = case.recording.noise_window_s
    if not first < last <= 0.0:
        raise InputError(
            "recording.noise_window_s: must begin and end before the first hole at 0, "
            f"got {first:g}, {last:g}"
        )
    for part, names in (
        ("layers", [layer.name for layer in case.layers]),
        ("joints", [joint.id for joint in case.joints]),
        ("blasts", [blast.id for blast in case.blasts]),
        ("receivers", [receiver.id for receiver in case.receivers]),
    ):
        _check_names(part, names)
    if case.layers[-1].thickness_m is not None:
        raise InputError(
            f"layers.{case.layers[-1].name}.thickness_m: the last layer has no end; leave it out"
        )
    for layer in case.layers[:-1]:
        if layer.thickness_m is None or not layer.thickness_m > 0.0:
            raise InputError(f"layers.{layer.name}.thickness_m: must be positive, "
                             f"got {layer.thickness_m}")  # fmt: skip
    known = case.attenuation
    if known.known and (known.Qp is None or known.Qs is None):
        raise InputError("attenuation.Qp: missing; give Qp and Qs, or known = false")
    for joint in case.joints:
        if joint.axis not in ("x", "y"):
            raise InputError(f"joints.{joint.id}.axis: must be x or y, got {joint.axis}")
        if joint.law != "linear":
            raise InputError(f"joints.{joint.id}.law: only 'linear' is known, got {joint.law}")
        if not joint.whole_box and (joint.extent is None or joint.depth is None):
            raise InputError(
                f"joints.{joint.id}.extent: missing; whole_box = false needs extent and depth"
            )
        for key in ("extent", "depth"):
            ends = getattr(joint, key)
            if not joint.whole_box and not ends[0] < ends[1]:
                limits = getattr(case.box, "y" if joint.axis == "x" else "x")
                limits = limits if key == "extent" else [0.0, case.box.z[1] - case.box.z[0]]
                raise InputError(
                    f"joints.{joint.id}.{key}: must go from low to high and reach into the box, "
                    f"{limits[0]:g} to {limits[1]:g} m, got {ends[0]:g} to {ends[1]:g}"
                )


def _check_names(part, names):
    """Refuse an empty list and duplicate names."""
    if not names and part != "joints":
        raise InputError(f"{part}: empty; give at least one")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{part}: {name!r} appears twice; give each a different name")


def _check_source(rate):
    """Refuse a moment rate that begins before its hole fires."""
    begins = moment_begins(rate)
    if begins < 0.0:
        raise InputError(
            f"source: its moment rate begins at {begins:g} s, but no hole radiates before it "
            f"fires at 0; shift the table, and all records with it, by {-begins:g} s to later"
        )


def _check_stations(project):
    """Refuse records of stations that are no receivers."""
    known = {receiver.name for receiver in project.receivers}
    for each in (project, *project.further):
        for name in each.records:
            if name not in known:
                raise InputError(
                    f"{each.name}: station {name!r} of its records is no receiver; list it, or "
                    "take it out of the file"
                )


def _project(folder, case, blast):
    """Return the project of one blast; values in SI are those of the file to the last bit."""
    records = read_stations(folder / blast.records, time_zero=blast.time_zero)
    config = check_config(_tables(case, blast, records), TABLE)
    given = {
        "blast": read_blast(folder / blast.holes),
        "records": records,
        "time_zero": blast.time_zero,
    }
    project = make_project(config, folder / TABLE, given)
    materials = {
        layer.name: Material.from_speeds(layer.density, layer.vp, layer.vs) for layer in case.layers
    }
    if case.attenuation.known:
        law = constant_q(case.attenuation.Qp, case.attenuation.Qs, case.recording.band_hz)
        materials = {name: replace(rock, law=law) for name, rock in materials.items()}
    joints = tuple(
        Joint(joint.id, "elastic", {"kn": joint.kn, "ks": joint.ks},
              insitu_pressure=joint.insitu_normal_stress)
        for joint in case.joints
    )  # fmt: skip
    inside = Inside(project.firing, _moment_rate(folder / case.source.file), (), (), (), None)
    given |= {"inside": inside, "receivers": place_in_box(config.receivers, flat_box(project))}
    return replace(project, name=blast.id, materials=materials, joints=joints, given=given)


def _tables(case, blast, records):
    """Return the tables of the project file of one blast."""
    low, high = case.recording.band_hz
    slowest = min(layer.vs for layer in case.layers)
    box = case.box
    quality = {}
    if case.attenuation.known:
        law = constant_q(case.attenuation.Qp, case.attenuation.Qs, (low, high))
        quality = {"qp": law.qp, "qs": law.qs, "quality_band_hz": list(law.band)}
    last = min(float(record.seismogram.times[-1]) for record in records.values())
    names = list(records)
    return {
        "title": case.case,
        "mesh": {
            "size_m": [b - a for a, b in (box.x, box.y, box.z)],
            "origin_m": [box.x[0], box.y[0], box.z[0]],
            "edges_per_wavelength": 10.0, "frequency_hz": high,
            "padding_m": PADDING * slowest / low,
            "padding_edge_m": PADDING_EDGES * slowest / (10.0 * high),
            "layers": [
                {"material": layer.name}
                | ({} if layer.thickness_m is None else {"thickness_m": layer.thickness_m})
                for layer in case.layers
            ],
            "faults": [_fault(joint, box) for joint in case.joints],
        },
        "materials": {
            layer.name: {"density_kg_per_m3": layer.density, "cp_m_per_s": layer.vp,
                         "cs_m_per_s": layer.vs, **quality}
            for layer in case.layers
        },
        "joints": {
            joint.id: {"law": "elastic", "kn_gpa_per_m": 1e-9 * joint.kn,
                       "ks_gpa_per_m": 1e-9 * joint.ks,
                       "insitu_pressure_kpa": 1e-3 * joint.insitu_normal_stress}
            for joint in case.joints
        },
        "boundaries": {"viscous": list(OUTER), "free": ["top"]},
        "blast": {"file": blast.holes, "charge_exponent": case.source.charge_exponent},
        "holes_inside": {"moment_rate_file": case.source.file},
        "receivers": [
            {"name": receiver.id, "position_m": [receiver.x, receiver.y, receiver.z]}
            | ({} if receiver.id not in records else {"recorded": {
                "file": blast.records, "record": 1 + names.index(receiver.id),
                "unit": "m_per_s", "start_s": float(records[receiver.id].seismogram.start),
            }})
            for receiver in case.receivers
        ],
        "run": {"duration_s": max(last, 1e-3), "compare_band_hz": [low, high]},
        "diagnosis": {"noise_window_s": list(case.recording.noise_window_s)},
    }  # fmt: skip


def _fault(joint, box):
    """Return the table of a joint as a fault."""
    refuse_beyond(joint.id, joint.position, box.x if joint.axis == "x" else box.y)
    across = {"name": joint.id, "dip_deg": 90, "dip_direction_deg": 90 if joint.axis == "x" else 0}
    along = box.y if joint.axis == "x" else box.x
    middle, down, sizes = 0.5 * (along[0] + along[1]), 0.0, {}
    if not joint.whole_box:
        (low, high), (upper, lower) = joint.extent, joint.depth
        middle, down = 0.5 * (low + high), 0.5 * (upper + lower)
        sizes = {"extent_m": [high - low, lower - upper]}
    position = [joint.position, middle] if joint.axis == "x" else [middle, joint.position]
    return {**across, "through_m": [*position, box.z[1] - down], **sizes}


def _moment_rate(path):
    """Read the source table below its title line."""
    columns = {"time": (1, "s"), "moment_rate_per_kg": (2, "Nm_per_s")}
    rules = Rules(columns, {"delimiter": ",", "header": False, "skip_lines": 1})
    return read_time_function(path, "moment_rate_per_kg", rules=rules)
