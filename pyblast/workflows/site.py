"""Monitoring of a site: records of a folder joined to its log, law, compliance, one page."""

import hashlib
import json
import math
import tomllib
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..blasts.compliance import assess_peaks, limit_at
from ..blasts.peaks import LEVEL
from ..blasts.published_laws import HARD_ROCK
from ..blasts.site_law import fit_site_law, site_law_of_exponent
from ..errors import InputError, PyblastError, ReadError
from ..files import code_hash, plain, versions, write_summary, write_text
from ..line_records.changes import StepChange, changes, residuals
from ..line_records.field_records import NOT_RECORDS
from ..line_records.forecasts import BAND, StatisticalLimit, forecasts, share_interval, trend
from ..line_records.monitoring import (
    FEATURES,
    Joined,
    LoggedBlast,
    RecordPeaks,
    Station,
    joined,
    read_log,
    read_peaks,
    read_quietly,
    read_stations_of,
)
from ..line_records.superposition import HoleMotion, calibrated, sum_of_holes
from ..readers.provenance import ReadLog
from ..recordings.raw import decibels
from ..report.site import write_site_report
from ..signals.comparison import load_limits
from . import Progress, csv_table, silent, write_tables

OUT, RESULT, REPORT, STORE = "site", "site.json", "report.html", "parsed.json"
READING = ("recordings", "readers", "signals", "line_records")  # code on which a parse depends
TABLES = (".csv", ".txt", ".xlsx", ".xlsm")
KEEP_EVERY = 50  # files after which what was parsed is kept
FAR, FEWEST = 4.0, 6  # robust standard deviations beyond which one of so many records is named
FARTHEST = 1e5  # m from a blast to the nearest station
DAYS = 365.25  # of a year
NORMAL_MAD = 1.4826  # standard deviation of a normal law over its median absolute deviation


def learn_site(
    folder: str | Path,
    out: str | Path | None = None,
    *,
    limit_curve: str = "din_4150_dwelling",
    air_limit: float | None = None,
    statistical: StatisticalLimit | None = None,
    progress: Progress | None = None,
) -> tuple[dict, Path]:
    """Join the records of a site to its blasts, and learn its law, compliance and changes.

    Parameters
    ----------
    folder : path
        With a log of blasts (``blasts.csv`` or ``.xlsx``, see
        `pyblast.line_records.monitoring.read_log`), stations (``stations.csv``, see
        `read_stations_of`), and records in any format and any subfolder.
    out : path, optional
        Folder of the result, written anew by each call; ``site`` in that of the records by default.
    limit_curve : str
        Key of the limit curve, as in `pyblast.load_limits`.
    air_limit : float, Pa, optional
        Limit of air overpressure.
    statistical : StatisticalLimit, optional
        Limit of a share of all blasts of a period.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    dict
        Content of ``site.json``.
    Path
        Folder with ``site.json``, ``report.html``, ``compliance.csv``, ``tables.xlsx``, and what
        was parsed, by the hash of its content, in ``parsed.json``.

    Raises
    ------
    InputError, ReadError
        If log, stations or all records are missing or can't be read.
    """
    tell, folder = progress or silent, Path(folder)
    if not folder.is_dir():
        raise ReadError(f"{folder}: is no folder; give the folder that holds log and records")
    if limit_curve not in load_limits():
        raise InputError(f"limit curve: one of {', '.join(load_limits())}, got {limit_curve!r}")
    if air_limit is not None and not air_limit > 0.0:
        raise InputError(f"air limit: must be positive, got {air_limit:g} Pa")
    out, log = folder / OUT if out is None else Path(out), ReadLog()
    tables = [_table_of(folder, name) for name in ("blasts", "stations")]
    blasts, stations = read_log(tables[0], log), read_stations_of(tables[1], log)
    used = {*tables, *(folder / blast.holes for blast in blasts if blast.holes)}
    _refuse_far_blasts(tables[0].name, blasts, stations)
    runs = _runs(folder)
    records, skipped, digest = _parsed(folder, out, used, runs, tell)
    site = joined(blasts, stations, records)
    if not site.records:
        reasons = [f"{file}: {reason}" for file, reason in [*site.unjoined, *skipped][:3]]
        why = "; ".join(reasons) or "it holds no record"
        raise InputError(f"{folder}: no record belongs to a blast ({why})")
    rows = rows_of(site, limit_curve, air_limit)
    summary = plain({
        "folder": folder.resolve().name,
        "limit_curve": limit_curve,
        "air_limit": air_limit,
        "blasts": [blast.table() for blast in blasts],
        "stations": [asdict(station) for station in stations],
        "clocks": site.clocks,
        "records": rows,
        "silent": [
            {"blast": blasts[b].name, "station": stations[s].name, "below": stations[s].trigger}
            for b, s in np.argwhere(site.silent)
        ],
        "law": law_of(site, 0.5, "largest"),
        "air_law": law_of(site, 1.0 / 3.0, "overpressure"),
        **_learned(site, limit_curve, _predicted(site, folder, runs)),
        "projects": _projects(folder),
        "statistical": None if statistical is None else asdict(statistical) | {
            "stations": _judged(site, statistical)
        },
        "unjoined": [{"file": file, "reason": reason} for file, reason in site.unjoined],
        "skipped": [{"file": file, "reason": reason} for file, reason in skipped],
        "inputs": log.table(),
        "provenance": versions(digest),
    })  # fmt: skip
    tell("writing", 0, 1)
    write_summary(out / RESULT, summary)
    write_tables(out, {"compliance": site_csv(summary)})
    write_site_report(out / REPORT, summary)
    return summary, out


def _refuse_far_blasts(where: str, blasts: list[LoggedBlast], stations: list[Station]) -> None:
    """Raise InputError where a blast lies too far from all stations to be of their site."""
    for blast in blasts:
        near = min(math.dist(blast.position, station.position) for station in stations)
        if near > FARTHEST:
            raise InputError(
                f"{where}, blast {blast.name!r}: lies {1e-3 * near:.3g} km from the nearest "
                "station; look at its coordinates, their unit, and those of the stations"
            )


def _table_of(folder: Path, name: str) -> Path:
    """Return the table of a name in a folder."""
    paths = [folder / f"{name}{ending}" for ending in TABLES]
    paths = [path for path in paths if path.is_file()]
    if len(paths) != 1:
        has = "more than one of" if paths else "none of"
        listed = ", ".join(f"{name}{ending}" for ending in TABLES)
        raise ReadError(f"{folder}: holds {has} {listed}; it needs one")
    return paths[0]


def _parsed(folder: Path, out: Path, used: set[Path], runs: list[dict], tell: Progress):
    """Return the peaks of all records, refused files with reasons, and the hash of all files."""
    ours = {out.resolve(), (folder / OUT).resolve()}
    ours |= {run["folder"].resolve() for run in runs}
    paths = [
        path for path in sorted(folder.rglob("*"))
        if path.is_file() and path not in used and ours.isdisjoint(path.resolve().parents)
        and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    ]  # fmt: skip
    code = code_hash(READING)
    store, digest = _stored(out / STORE, code), hashlib.sha256()
    current: dict[str, Any] = {}
    records: list[RecordPeaks] = []
    skipped: list[tuple[str, str]] = []
    fresh = 0
    for number, path in enumerate(paths):
        name = path.relative_to(folder).as_posix()
        key = hashlib.sha256(path.suffix.encode() + _content(path)).hexdigest()
        digest.update(name.encode() + key.encode())
        if key not in store:
            store[key] = _parse(path, name)
            fresh += 1
            if fresh % KEEP_EVERY == 0:
                _keep(out, code, store)
        current[key] = store[key]
        if isinstance(store[key], str):
            skipped.append((name, store[key]))
        else:
            read = [RecordPeaks.from_table(row) for row in store[key]]
            records += [replace(record, file=name) for record in read]
        tell("records", number + 1, len(paths))
    if fresh or current.keys() != store.keys():
        _keep(out, code, current)
    for path in sorted(used):
        digest.update(path.name.encode() + _content(path))
    return records, skipped, digest.hexdigest()


def _content(path: Path) -> bytes:
    """Return the bytes of a file."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise ReadError(f"{path}: can't be read ({error.strerror or error})") from None


def _stored(path: Path, code: str) -> dict[str, Any]:
    """Return what the same code parsed before; nothing where the store is damaged."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored["code"] == code:
            for rows in stored["files"].values():
                _ = rows if isinstance(rows, str) else [RecordPeaks.from_table(r) for r in rows]
            return stored["files"]
    return {}


def _keep(out: Path, code: str, files: dict[str, Any]) -> None:
    """Keep what was parsed."""
    write_text(out / STORE, json.dumps({"code": code, "files": files}))


def _parse(path: Path, name: str) -> list[dict] | str:
    """Return the peaks of the records of a file as tables, or the reason for none."""
    try:
        return plain([asdict(record) for record in read_peaks(path, name)])
    except PyblastError as error:
        reason = str(error).removeprefix(f"{path}").lstrip(":, ")
        reason = reason.replace("read it with read_gather", "pyblast records analyses it")
        other = path.suffix in NOT_RECORDS and reason.startswith("is none of")
        return "is no record" if other else reason


def rows_of(site: Joined, curve: str, air_limit: float | None) -> list[dict]:
    """Return the joined records by time: peaks against the limit curve, air overpressure.

    Parameters
    ----------
    site : Joined
    curve : str
    air_limit : float or None, Pa

    Returns
    -------
    list of dict
        SI; None where a value is missing.
    """
    distance, rows = site.distance, []
    for (b, s), record in sorted(site.records.items()):
        blast, station = site.blasts[b], site.stations[s]
        window = float(distance[b, s]), blast.charge
        row = assess_peaks(record.peaks, curve, station.name, "recorded", window=window)
        rows.append({
            "blast": blast.name, "time": blast.time, "station": station.name, "file": record.file,
            **({} if row is None else row.table()),
            "distance": window[0], "charge": blast.charge, "vector_sum": record.pvs,
            "overpressure": record.overpressure,
            "air_share": None if air_limit is None else record.overpressure / air_limit,
            "spoilt": record.spoilt, "practice": blast.practice,
        })  # fmt: skip
    return rows


def law_of(site: Joined, exponent: float, quantity: str) -> dict:
    """Return the site law of the records with its 50 and 95 % lines, or why there is none.

    Parameters
    ----------
    site : Joined
    exponent : float
        Of the charge.
    quantity : str
        "largest" for peak velocity or "overpressure".
    """
    peak, distance = site.values(quantity), site.distance
    charge = np.array([[blast.charge] for blast in site.blasts]) + 0.0 * distance
    below = site.silent if quantity == "largest" else np.zeros(peak.shape, dtype=bool)
    trigger = np.array([station.trigger for station in site.stations])
    peak = np.where(below, trigger, peak)
    known = np.isfinite(peak) & np.isfinite(distance) & np.isfinite(charge) & (distance > 0.0)
    rows, fixed = (distance[known], charge[known], peak[known]), ""
    if not known.any() and np.isfinite(peak).any():
        known = {"places": site.distance, "charges": [blast.charge for blast in site.blasts]}
        lacks = [what for what, values in known.items() if not np.isfinite(values).any()]
        return {"refused": f"the log lacks {' and '.join(lacks) or 'places or charges'}"}
    try:
        law = fit_site_law(*rows, exponent, below[known])
    except InputError as error:
        fixed, seen = str(error), ~below[known]
        if quantity != "largest" or seen.sum() < FEWEST:
            return {"refused": fixed}
        law = site_law_of_exponent(*(row[seen] for row in rows), HARD_ROCK.beta, exponent)
    at = np.geomspace(*law.reach, 60)
    levels = {f"{share:g}": law.peak(at, 1.0).level(share) for share in (0.5, 0.95)}
    return {
        "k": law.k, "beta": law.beta, "beta_90": law.beta_interval(), "s": law.s, "n": law.n,
        "r2": law.r2, "fixed": fixed, "charge_exponent": exponent, "notes": law.notes,
        "below": int(below[known].sum()), "scaled_distance": at, "levels": levels,
        "outliers": _outliers(site, law, np.where(below, np.nan, peak), distance, charge),
    }  # fmt: skip


def _outliers(site, law, peak, distance, charge) -> list[dict]:
    """Return the records far off the law and the usual level of their station."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = distance / charge**law.charge_exponent
        residual = np.log10(peak / (law.k * scaled**-law.beta))
    rows = []
    for s, station in enumerate(site.stations):
        if np.isfinite(residual[:, s]).sum() < FEWEST:
            continue
        own = residual[:, s] - np.nanmedian(residual[:, s])
        for b in np.flatnonzero(np.abs(own) > FAR * NORMAL_MAD * np.nanmedian(np.abs(own))):
            rows.append({"blast": site.blasts[b].name, "station": station.name,
                          "factor": 10.0 ** own[b]})  # fmt: skip
    return rows


def _runs(folder: Path) -> list[dict]:
    """Return the runs of projects in a folder, the latest last.

    Each has its ``folder``, hashes of its ``files``, ``peaks`` by receiver: log10 of the largest
    component in m/s and of its frequency, and with one hole ``hole`` by receiver: file, charge,
    distance.
    """
    runs = []
    for path in sorted(folder.rglob("summary.json")):
        with suppress(OSError, ValueError, TypeError, LookupError, AttributeError):
            run = json.loads(path.read_text(encoding="utf-8"))
            rows, holes = run["receivers"], run["sources"]["holes"]
            runs.append({
                "folder": path.parent,
                "files": set(run["files_sha256"].values()),
                "peaks": {name: _log_peak(row["simulated"]) for name, row in rows.items()},
                "hole": {} if len(holes) != 1 else {
                    name: (path.parent / "curves" / f"simulated_{name}.csv", holes[0]["charge"],
                           math.dist(holes[0]["position"], row["position"]))
                    for name, row in rows.items()
                },
            })  # fmt: skip
    return runs


def _log_peak(motion: dict) -> tuple[float, float]:
    """Return log10 of the largest peak of a run's motion and of its zero-crossing frequency."""
    pairs = zip(motion["ppv"], motion["zero_crossing_frequency"], strict=True)
    peak, hz = max(((p, f or math.nan) for p, f in pairs if p), default=(math.nan, math.nan))
    return math.log10(peak), math.log10(hz)


def _projects(folder: Path) -> list[str]:
    """Return the project files of a folder that hold a ground."""
    names = []
    for path in sorted(folder.glob("*.toml")):
        with suppress(OSError, ValueError):
            if "mesh" in tomllib.loads(path.read_text(encoding="utf-8")):
                names.append(path.name)
    return names


def _predicted(site: Joined, folder: Path, runs: list[dict]) -> dict[str, np.ndarray]:
    """Return log10 of peaks and frequencies, (n_blasts, n_stations, 2), beside a law.

    By recorded holes: the blasts of the log whose table has one charge. By a model: the runs whose
    project reads the hole table of a blast, else those of one hole, superposed.
    """
    recorded: dict[int, list[HoleMotion]] = {}
    for (b, s), record in sorted(site.records.items()):
        plan = site.blasts[b].plan
        if plan is not None and np.count_nonzero(plan.charge) == 1 and not record.spoilt:
            each = {(r.serial, r.time): r for r in read_quietly(folder / record.file)[0]}
            motion, charge = each[record.serial, record.time].seismogram, float(plan.charge.max())
            away = np.linalg.norm(plan.centres - site.stations[s].position, axis=1)[plan.charge > 0]
            recorded.setdefault(s, []).append(HoleMotion(motion, charge, float(away[0]), b + 1))
    modelled: dict[int, list[HoleMotion]] = {}
    own = np.full((len(site.blasts), len(site.stations), 2), np.nan)
    digests = [_digest(folder / blast.holes) if blast.holes else None for blast in site.blasts]
    for run in runs:
        for s, station in enumerate(site.stations):
            if station.name in run["peaks"]:
                own[[d in run["files"] for d in digests], s] = run["peaks"][station.name]
            path, charge, far = run["hole"].get(station.name, (None, 0.0, 0.0))
            if path is not None and path.is_file():
                hole = HoleMotion(read_quietly(path)[0][0].seismogram, charge, far, 0)
                modelled.setdefault(s, []).append(hole)
    methods = {
        "superposition": sum_of_holes(site, recorded),
        "model": np.where(np.isfinite(own), own, sum_of_holes(site, modelled)),
    }
    return {method: values for method, values in methods.items() if np.isfinite(values).any()}


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file, as runs name it."""
    return hashlib.sha256(_content(path)).hexdigest()


def _learned(site: Joined, curve: str, predicted: dict[str, np.ndarray]) -> dict:
    """Return control charts, changes, forecasts of blasts to come, and coverage of all before."""
    away = site.away
    charge = np.array([[blast.charge] for blast in site.blasts]) + 0.0 * site.distance
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.log10(np.stack([site.distance, charge], axis=-1))
        peak, hz = np.log10(site.values("largest")), np.log10(site.values("frequency"))
        trigger = np.log10([station.trigger for station in site.stations])
    scaled[~np.isfinite(scaled)] = np.nan
    features = site.values("features", len(FEATURES))
    residual = residuals(features, scaled, np.arctan2(away[..., 1], away[..., 0]))
    silent = np.where(site.silent, trigger, np.nan)
    methods = {"law": (forecasts(peak, scaled, silent), forecasts(hz, scaled, prior=(0.0, 0.0)))}
    for method, values in predicted.items():
        methods[method] = (calibrated(peak, values[..., 0], silent), calibrated(hz, values[..., 1]))
    last = max(b for b, _ in site.records)
    coming = [(b, s) for b in range(last + 1, len(site.blasts)) for s in range(len(site.stations))]
    return {
        "charts": [
            {"station": station.name, "level": 10.0 ** residual[:, s, :2].mean(axis=-1),
             "channel_ratio": 10.0 ** (residual[:, s, 1] - residual[:, s, 0])}
            for s, station in enumerate(site.stations)
        ],
        "changes": [_change_row(site, change) for change in changes(residual)],
        "forecasts": [
            {"method": method} | _forecast_row(site, *both, curve, b, s)
            for b, s in coming for method, both in methods.items()
            if np.isfinite(both[0].mean[b, s])
        ],
        "coverage": {
            method: _coverage(peaks.inside(peak), peaks.half(BAND)[np.isfinite(peak)])
            for method, (peaks, _) in methods.items()
        },
        "model": _against(site, peak - predicted["model"][..., 0]) if "model" in predicted else [],
    }  # fmt: skip


def _coverage(inside: np.ndarray, half: np.ndarray) -> dict:
    """Return how many peaks came inside their bands, and the factor of a usual band."""
    count, total = int(np.nansum(inside)), int(np.isfinite(inside).sum())
    return {
        "band": BAND, "inside": count, "forecasts": total,
        "interval": share_interval(count, total) if total else None,
        "factor": 10.0 ** float(np.nanmedian(half)) if total else None,
    }  # fmt: skip


def _against(site: Joined, ratio: np.ndarray) -> list[dict]:
    """Return how records compare with the model by station: factor of each blast, and trend."""
    years = np.array([np.datetime64(blast.time[:10]) for blast in site.blasts]).astype(float)
    rows = []
    for station, own in zip(site.stations, ratio.T, strict=True):
        known = np.isfinite(own)
        if not known.any():
            continue
        slope, half = trend(years[known] / DAYS, own[known])
        rows.append({
            "station": station.name, "factor": 10.0**own, "median": 10.0 ** np.median(own[known]),
            "records": int(known.sum()), "per_year": 10.0**slope,
            "per_year_90": (10.0 ** (slope - half), 10.0 ** (slope + half)),
        })  # fmt: skip
    return rows


def _change_row(site: Joined, change: StepChange) -> dict:
    """Return a change as plain values, with what the log says about its date."""
    blasts, (first, last) = site.blasts, change.interval
    around = blasts[max(first - 1, 0)], blasts[min(last, len(blasts) - 1)]
    says = [
        f"{key}: {around[0].practice[key]} to {around[1].practice[key]}"
        for key in around[0].practice
        if around[0].practice[key] != around[1].practice[key]
    ]
    return {
        "blast": blasts[change.blast].name, "time": blasts[change.blast].time,
        "until": blasts[min(change.blast + change.length, len(blasts) - 1)].name
        if change.length else None,
        "between": [around[0].name, around[1].name], "kinds": change.kinds,
        "station": None if change.station is None else site.stations[change.station].name,
        "features": FEATURES, "step": change.step, "error": change.error,
        "evidence": change.evidence, "log_says": says,
    }  # fmt: skip


def _forecast_row(site, peaks, pitch, curve, b, s) -> dict:
    """Return the forecast of a blast that is planned at a station, against the limit curve."""
    blast = site.blasts[b]
    peak = peaks.peak(b, s, blast.charge)
    row = {
        "blast": blast.name, "time": blast.time, "station": site.stations[s].name,
        "charge": blast.charge, "distance": site.distance[b, s], "median": peak.level(0.5),
        "band": peak.band(BAND), "level_95": peak.level(LEVEL),
    }  # fmt: skip
    if not np.isfinite(pitch.mean[b, s]):
        return row
    hz = pitch.peak(b, s)
    limit = limit_at(load_limits()[curve], float(hz.level(0.5)))
    return row | {
        "frequency": hz.level(0.5), "frequency_band": hz.band(BAND), "limit": limit,
        "share_below_limit": peak.share_below(limit),
        "charge_below": peak.charge_below(limit) if peaks.exponent[b] > 0.1 else None,
    }  # fmt: skip


def _judged(site: Joined, limit: StatisticalLimit) -> list[dict]:
    """Return how each station keeps a statistical limit so far."""
    last = max(b for b, _ in site.records) + 1
    days = [blast.time[:10] for blast in site.blasts[:last]]
    peak = site.values("at_least")[:last]
    trigger = np.array([station.trigger for station in site.stations])
    bounds = np.where(site.silent, trigger, np.nan)[:last]
    return [
        {"station": station.name} | limit.judged(days, peak[:, s], bounds[:, s])
        for s, station in enumerate(site.stations)
    ]


HEADS = (
    ("blast", "blast", 1.0), ("time", "time", 1.0), ("station", "station", 1.0),
    ("file", "file", 1.0), ("component", "quantity", 1.0), ("ppv_mm_per_s", "peak", 1e3),
    ("frequency_hz", "frequency", 1.0), ("vector_sum_mm_per_s", "vector_sum", 1e3),
    ("limit_mm_per_s", "limit", 1e3), ("share_of_limit", "share", 1.0),
    ("distance_m", "distance", 1.0), ("charge_in_8_ms_kg", "charge", 1.0),
    ("scaled_distance_m_per_kg05", "scaled_distance", 1.0),
    ("air_overpressure_pa", "overpressure", 1.0), ("share_of_air_limit", "air_share", 1.0),
)  # fmt: skip


def site_csv(summary: dict) -> str:
    """Return all joined records as CSV: one row a record, as regulators ask for it."""
    return csv_table(
        [head for head, _, _ in HEADS] + ["air_overpressure_db"],
        ([*(_scaled(row.get(key), factor) for _, key, factor in HEADS),
          _decibels(row["overpressure"])] for row in summary["records"]),
    )  # fmt: skip


def _scaled(value, factor):
    """Return a value in the unit of its head."""
    return value if value is None or isinstance(value, str) else factor * value


def _decibels(pressure: float | None) -> float | None:
    """Return a pressure in Pa as dB(L)."""
    return None if pressure is None else decibels(pressure)
