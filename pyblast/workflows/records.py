"""Analysis of field records without a model: quality, odd channels, air wave, layers, sensors."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..files import plain, versions, write_summary
from ..line_records.field_records import FieldRecord, read_folder
from ..line_records.quality import odd_channels, sensor_response
from ..line_records.shots import EffectDecision, ShotGather, shot_of
from ..line_records.waves import NEAREST, Picks, air_wave, phase_speeds, soft_layer
from ..readers.provenance import ReadLog
from ..recordings.recording import Recording
from ..report.records import CLOSED_LISTS, LineView, write_records_report
from ..signals.spectra import zero_crossing_frequency
from . import Progress, csv_table, new_folder, silent, write_tables

RESULT, REPORT = "records.json", "report.html"
SURFACE_BAND, AIR_BAND = (10.0, 60.0), (120.0, 500.0)
TOP_OF_NYQUIST = 0.8  # share of the Nyquist frequency up to which a band may reach
FEWEST = 6  # receivers on a line
CROOKED = 0.1  # of the length of a line, by which receivers may stand beside it
PER_PLACE, MOST = 2, 15  # shots of one source place for the air wave; shots a side for layers
SAME_PLACE = 0.01  # m
NOISE = -1.0  # share of energy explained below which a channel is no copy of its neighbours


@dataclass(frozen=True, eq=False)
class Line:
    """Shots along one line of receivers.

    Parameters
    ----------
    name : str
    shots : list of Shot
    files : list of str
        Of each shot.
    """

    name: str
    shots: list[ShotGather]
    files: list[str]


def analyse_records(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    geometry: str | Path | None = None,
    surface_band: tuple[float, float] = SURFACE_BAND,
    air_band: tuple[float, float] = AIR_BAND,
    sensor_band: tuple[float, float] | None = None,
    reference: str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[dict, Path]:
    """Analyse field records without a model.

    Parameters
    ----------
    folder : path
        With files in SEG-2, SEG-Y, miniSEED, SAC, GSE2, formats of blast seismographs, or CSV.
    out : path, optional
        Folder that takes numbered folders; that of the records with ``_analysis`` by default.
    geometry : path, optional
        CSV of places, see `pyblast.line_records.field_records.read_geometry`.
    surface_band : tuple of 2 float, Hz
        Where surface waves prevail: odd channels and layering.
    air_band : tuple of 2 float, Hz
        Where the air wave is looked for, at most up to 0.8 of the Nyquist frequency.
    sensor_band : tuple of 2 float, Hz, optional
        Where sensors at one place are compared; 20 cycles a record to 0.8 of Nyquist by default.
    reference : str, optional
        Name of the sensor whose response is known to be flat.
    seed : int
        Of all permutation tests.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    dict
        Content of ``records.json``.
    Path
        Folder with ``records.json`` and ``report.html``.

    Raises
    ------
    InputError, ReadError
        If there is no record, or the table of places is wrong.
    """
    tell, folder = progress or silent, Path(folder)
    for name, band in (("surface", surface_band), ("air", air_band), ("sensor", sensor_band)):
        if band is not None and not 0.0 < band[0] < band[1]:
            raise InputError(f"{name} band: must rise from above 0 Hz, got {band[0]:g} {band[1]:g}")
    tell("records", 0, 1)
    log = ReadLog()
    records, skipped = read_folder(folder, geometry, log)
    lines, refused = lines_of(records)
    results, views = [], []
    for number, line in enumerate(lines):
        tell("analyses", number, len(lines))
        outcomes, view = _of_line(line, surface_band, air_band, seed)
        results += outcomes
        views.append(view)
    results += refused
    results.append(_sensors(records, sensor_band, reference, seed))
    summary = {
        "folder": folder.name,
        "geometry": None if geometry is None else Path(geometry).name,
        "files": [quality_of_record(record) for record in records],
        "skipped": [{"file": name, "reason": reason} for name, reason in skipped],
        "analyses": [row for row in results if "outcome" in row],
        "closed_lists": CLOSED_LISTS,
        "not_analysed": [row for row in results if "outcome" not in row],
        "seed": seed,
        "inputs": log.table(),
        "provenance": versions(_hash(folder, records)),
    }
    tell("writing", 0, 1)
    result = new_folder(folder.parent / f"{folder.name}_analysis" if out is None else out)
    write_summary(result / RESULT, summary)
    if any(row["peaks"] for row in summary["files"]):
        write_tables(result, {"peaks": peaks_csv(summary["files"])})
    write_records_report(result / REPORT, plain(summary), views)
    return plain(summary), result


def quality_of_record(record: FieldRecord) -> dict:
    """Return the quality of a file: sampling, dead channels, clipped samples, printed values."""
    gather = record.gather
    counts = gather.clipped.sum(axis=1)
    wrong = [row for row in record.checks if not row[3]]
    return {
        "file": record.file,
        "format": record.format,
        "channels": len(record.channels),
        "samples": gather.data.shape[1],
        "dt_s": gather.dt,
        "start_s": gather.start,
        "unit": gather.unit,
        "time": gather.time,
        "placed": bool(np.isfinite(gather.receiver_positions).all()),
        "source_placed": bool(np.isfinite(gather.source_position).all()),
        "dead": [record.channels[n] for n in np.flatnonzero(gather.dead)],
        "clipped": {record.channels[n]: int(counts[n]) for n in np.flatnonzero(counts)},
        "full_scale": gather.full_scale,
        "printed_values_checked": len(record.checks),
        "printed_values_wrong": [
            {"name": name, "printed": printed, "from_samples": value}
            for name, printed, value, _ in wrong
        ],
        "peaks": None if record.recording is None else peaks_of_record(record.recording),
        "notes": list(record.notes),
    }


def peaks_of_record(recording: Recording) -> dict:
    """Return peaks of the record of a blast seismograph: velocity, frequency, air overpressure."""
    motion = recording.seismogram
    return {
        "components": list(motion.components),
        "ppv": motion.ppv,
        "frequency": zero_crossing_frequency(motion).hz,
        "vector_sum": motion.pvs,
        "overpressure": recording.peak_overpressure,
        "overpressure_db": recording.peak_overpressure_db,
        "offset": recording.offset,
        "serial": recording.serial,
    }


PEAK_HEADS = (
    "file", "serial", "time", "component", "ppv_mm_per_s", "zero_crossing_frequency_hz",
    "vector_sum_mm_per_s", "air_overpressure_pa", "air_overpressure_db", "offset_mm_per_s",
)  # fmt: skip


def peaks_csv(files: Sequence[dict]) -> str:
    """Return the peaks of all records of blast seismographs as CSV, one row a component."""
    rows = []
    for file in files:
        peaks = file["peaks"]
        for n, name in enumerate(peaks["components"] if peaks else ()):
            values = (
                1e3 * peaks["ppv"][n], peaks["frequency"][n], 1e3 * peaks["vector_sum"],
                peaks["overpressure"], peaks["overpressure_db"], 1e3 * peaks["offset"][n],
            )  # fmt: skip
            rows.append([file["file"], peaks["serial"], file["time"], name, *values])
    return csv_table(PEAK_HEADS, rows)


def lines_of(records: Sequence[FieldRecord]) -> tuple[list[Line], list[dict]]:
    """Return the lines of receivers with their shots, and the reasons for missing ones."""
    names = dict.fromkeys(name for record in records for name in record.line)
    lines, refused = [], []
    for name in names:
        shots, files, reasons = [], [], []
        for record in records:
            try:
                shot = _shot(record, name)
            except InputError as error:
                reasons.append(f"{record.file}: {error}")
                continue
            shots.append(shot)
            files.append(record.file)
        if shots:
            lines.append(Line(name, shots, files))
        else:
            reason = f"{reasons[0]}{f' (and {len(reasons) - 1} more files)' * (len(reasons) > 1)}"
            refused += [
                _refusal(analysis, name, reason)
                for analysis in ("odd channels", "air wave", "layering")
            ]
    return lines, refused


def _shot(record: FieldRecord, name: str) -> ShotGather:
    """Return the receivers of a record on a line as a shot, ordered along the line."""
    own = np.array([n for n, line in enumerate(record.line) if line == name], dtype=int)
    gather = record.gather
    places, source = gather.receiver_positions[own], gather.source_position
    if len(own) < FEWEST:
        raise InputError(f"{len(own)} channels, and a line needs {FEWEST}")
    if not np.isfinite(places).all():
        raise InputError("the places of its receivers are not known; give --geometry")
    if not np.isfinite(source).all():
        raise InputError("the place of its source is not known; give --geometry")
    middle = places.mean(axis=0)
    axis = np.linalg.svd(places - middle)[2][0]
    axis = axis if axis @ (places[-1] - places[0]) >= 0.0 else -axis
    along = (places - places[0]) @ axis
    beside = np.linalg.norm(places - places[0] - along[:, None] * axis, axis=1)
    if np.ptp(along) == 0.0 or beside.max() > CROOKED * np.ptp(along):
        raise InputError(
            f"receivers stand up to {beside.max():.3g} m beside a straight line of "
            f"{np.ptp(along):.3g} m; name its lines in the column 'line' of --geometry"
        )
    part = replace(
        gather, data=gather.data[own], receiver_positions=places, dead=gather.dead[own],
        clipped=gather.clipped[own],
    )  # fmt: skip
    offsets = np.linalg.norm(places - source, axis=1)
    shot = shot_of(part, along, float((source - places[0]) @ axis), offsets)
    if len(shot.channels) < FEWEST:
        raise InputError(f"{len(shot.channels)} channels are neither dead nor clipped, and a line "
                         f"needs {FEWEST}")  # fmt: skip
    return replace(shot, channels=own[shot.channels])


def _of_line(line: Line, surface: tuple, air: tuple, seed: int) -> tuple[list[dict], LineView]:
    """Return the analyses of one line, and the data of its figures."""
    odd = _tried("odd channels", line.name, lambda: _odd(line, surface, seed))
    air_waves = _tried("air wave", line.name, lambda: _air(line, air, seed))
    sides = _sides(line)
    layers = _tried("layering", line.name, lambda: _layers(line, sides, surface, seed))
    picks: dict[str, Picks] = {}
    if "outcome" in layers[0]:
        frequencies = np.geomspace(*_inside(surface, sides[0][0].dt), 14)
        picks = {
            name: phase_speeds(shots, frequencies, seed=seed)
            for name, shots in zip(("fitted", "held out"), sides, strict=True)
        }
    shown = max(range(len(line.shots)), key=lambda n: len(line.shots[n].channels))
    view = LineView(
        line.name, line.shots[shown], line.files[shown], picks, odd + air_waves + layers
    )
    return odd + air_waves + layers, view


def _tried(analysis: str, line: str, analyse: Callable[[], list[EffectDecision]]) -> list[dict]:
    """Return the outcomes of an analysis, or the reason for none."""
    try:
        return [_outcome(analysis, line, decision) for decision in analyse()]
    except InputError as error:
        return [_refusal(analysis, line, str(error))]


def _outcome(analysis: str, line: str, decision: EffectDecision) -> dict:
    """Return a decision as plain numbers and words."""
    target = [int(part) + 1 if isinstance(part, int) else part for part in decision.target]
    return {
        "analysis": analysis,
        "line": line,
        "outcome": decision.outcome,
        "label": decision.label,
        "reason": decision.reason,
        "target": [] if analysis == "air wave" else target,
        "parameters": {k: list(v) for k, v in decision.parameters.items()},
        "band_hz": decision.band,
        "window_s": decision.window,
        "p_value": decision.p_value,
        "held_out": decision.held_out,
    }


def _refusal(analysis: str, line: str, reason: str) -> dict:
    """Return the reason why an analysis is missing."""
    return {"analysis": analysis, "line": line, "reason": reason}


def _inside(band: tuple[float, float], dt: float) -> tuple[float, float]:
    """Return a band that ends below the Nyquist frequency."""
    top = TOP_OF_NYQUIST * 0.5 / dt
    if band[0] >= top:
        raise InputError(f"the band begins at {band[0]:g} Hz, and records end at {top:.3g} Hz")
    return band[0], min(band[1], top)


def _odd(line: Line, band: tuple[float, float], seed: int) -> list[EffectDecision]:
    """Look for odd channels with the shots that share most of the receivers."""
    shots = sorted(line.shots, key=lambda shot: -len(shot.channels))
    chosen: list[ShotGather] = []
    common = set(shots[0].channels.tolist())
    for shot in shots:
        shared = common & set(shot.channels.tolist())
        if shot.dt == shots[0].dt and len(shared) >= max(FEWEST, 0.8 * len(common)):
            chosen, common = [*chosen, shot], shared
    if len(chosen) < 4:
        raise InputError(f"{len(chosen)} shots share their receivers and sampling, and it needs 4")
    own = [shot.only(np.isin(shot.channels, list(common))) for shot in chosen]
    channels = odd_channels(own, _inside(band, own[0].dt), seed=seed)
    return [_unless_noise(decision) for decision in channels]


def _unless_noise(decision: EffectDecision) -> EffectDecision:
    """Return a decision on an odd channel, unconfirmed where it shares nothing with neighbours."""
    if decision.outcome in ("NULL", "UNKNOWN") or (decision.held_out or (0.0, 0.0))[1] > NOISE:
        return decision
    why = "; its neighbours explain nothing of it even when corrected: it may hold only noise"
    return replace(decision, outcome="UNKNOWN", reason=decision.reason + why)


def _air(line: Line, band: tuple[float, float], seed: int) -> list[EffectDecision]:
    """Look for the air wave with up to two shots of each source place."""
    far = [shot for shot in line.shots if (shot.offsets > NEAREST).sum() >= FEWEST]
    if not far:
        raise InputError(f"no shot has {FEWEST} receivers beyond {NEAREST:g} m")
    places: dict[float, list[ShotGather]] = {}
    for shot in far:
        if shot.dt == far[0].dt:
            places.setdefault(round(shot.source, 2), []).append(shot)
    shots = [shot for each in places.values() for shot in each[:PER_PLACE]]
    return [air_wave(shots, _inside(band, shots[0].dt), seed=seed)]


def _sides(line: Line) -> tuple[list[ShotGather], list[ShotGather]]:
    """Return the shots for the fit and for its test: those off either end, else alternate ones."""
    dt = line.shots[0].dt
    shots = [shot for shot in line.shots if shot.dt == dt]
    low = [shot for shot in shots if shot.source < shot.places[0]]
    high = [shot for shot in shots if shot.source > shot.places[-1]]
    if min(len(low), len(high)) < 3:
        off = max(low, high, key=len)
        low, high = off[::2], off[1::2]
    return low[:MOST], high[:MOST]


def _layers(
    line: Line,
    sides: tuple[list[ShotGather], list[ShotGather]],
    band: tuple[float, float],
    seed: int,
) -> list[EffectDecision]:
    """Fit a layer over a half-space to the dispersion of surface waves."""
    if min(map(len, sides)) < 3:
        off = sum(map(len, sides))
        raise InputError(
            f"{off} of {len(line.shots)} shots lie off an end of the line, and it needs 6, best 3 "
            "off each end"
        )
    return [soft_layer(*sides, _inside(band, sides[0][0].dt), seed=seed)]


def _sensors(
    records: Sequence[FieldRecord], band: tuple | None, reference: str | None, seed: int
) -> dict:
    """Compare two sensors that stood side by side at two places."""
    stood: dict[tuple, dict[str, tuple[np.ndarray, float]]] = {}
    for record in records:
        spoilt = record.gather.dead | record.gather.clipped.any(axis=1)
        for n, sensor in enumerate(record.sensor):
            position = record.gather.receiver_positions[n]
            if sensor and not spoilt[n] and np.isfinite(position).all():
                key = tuple(np.round(position / SAME_PLACE).astype(int))
                stood.setdefault(key, {}).setdefault(
                    sensor, (record.gather.data[n], record.gather.dt)
                )
    names = sorted({sensor for each in stood.values() for sensor in each})
    pairs = [
        (first, second, [each for each in stood.values() if {first, second} <= set(each)])
        for k, first in enumerate(names) for second in names[k + 1 :]
    ]  # fmt: skip
    pair = next((row for row in pairs if len(row[2]) >= 2), None)
    if pair is None:
        return _refusal(
            "sensor response", "",
            "no two sensors with sound records stood side by side at two places; the column "
            "'sensor' of --geometry names them",
        )  # fmt: skip
    first, second, places = pair
    rows = [[each[name] for each in places[:2]] for name in (first, second)]
    steps = {dt for row in rows for _, dt in row}
    if len(steps) > 1:
        return _refusal("sensor response", "", "the sensors were sampled at different rates")
    dt, length = steps.pop(), min(len(samples) for row in rows for samples, _ in row)
    motion = [np.array([samples[:length] for samples, _ in row]) for row in rows]
    band = band or (20.0 / (dt * length), TOP_OF_NYQUIST * 0.5 / dt)
    return _tried("sensor response", "", lambda: [sensor_response(
        motion[0], motion[1], dt, _inside(band, dt), names=(first, second), reference=reference,
        seed=seed,
    )])[0]  # fmt: skip


def _hash(folder: Path, records: Sequence[FieldRecord]) -> str:
    """Return the SHA-256 of the files that were read."""
    digest = hashlib.sha256()
    for record in records:
        digest.update(record.file.encode() + (folder / record.file).read_bytes())
    return digest.hexdigest()
