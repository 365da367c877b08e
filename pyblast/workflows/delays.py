"""Delay optimisation of a project: motions of the holes, search, files."""

import hashlib
import math
import shutil
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..blasts.blast import CHARGE_WINDOW, Blast
from ..blasts.peaks import LEVEL
from ..blasts.signature import travel_shifts
from ..config.config import DelaysConfig
from ..errors import InputError, named_error
from ..files import versions, write_summary
from ..planning import DelayPlan, FiringScatter, plan_delays, rows_pattern
from ..project.level import level_error
from ..project.project import Project, load_project
from ..report.delays import write_delay_report
from ..runs.blast_ensemble import BlastSpectra, blast_spectra, signature_spectra
from ..runs.greens import greens_functions
from ..runs.parallel import input_hash
from ..signals.comparison import load_limits
from ..sources.recorded import read_hole
from ..sources.shot import make_firing
from . import Progress, Say, csv_table, new_folder, silent, write_tables

RESULT, REPORT = "delays.json", "report.html"
RUNS = "runs"  # folder of stored responses, shared by all plans
SHARES = (0.5, 0.9, 0.95)
MOST_PLANS = 10


def optimise_delays(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    full: bool = False,
    executor: Executor | None = None,
    progress: Progress | None = None,
    say: Say | None = None,
) -> tuple[dict, Path]:
    """Optimise the delays of table ``[delays]`` of a project for the least vibration.

    Parameters
    ----------
    project : Project or path of a project file
    out : path, optional
        Folder that takes numbered folders, one per plan, and the responses of the holes in
        ``runs``, which the next call reuses; ``delays`` beside the project file by default.
    fresh : bool
        Run the responses of the holes anew.
    full : bool
        Take the table ``[full]`` of the project file.
    executor : Executor, optional
        As for `run_all`; the result does not depend on it.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when stored responses are reused.

    Returns
    -------
    dict
        Content of ``delays.json``, see `summarise_delays`.
    Path
        Its folder, with ``report.html``.

    Raises
    ------
    InputError, ReadError
        If the project or a file of it is wrong, or no delays are allowed.
    SolverError
        If a model can't be run.
    """
    if not isinstance(project, Project):
        project = load_project(project, full, ground=False)
    tell, where = progress or silent, f"{project.path.name}: delays"
    table, blast = _settings(project)
    limits = house_limits(project)
    out = project.folder / "delays" if out is None else Path(out)
    _stored_runs(out / RUNS, fresh, say or silent)
    pattern = _pattern(project)
    scatter = FiringScatter(
        1e-3 * table.scatter_ms, 1e-2 * table.scatter_percent, 1e-2 * table.charge_percent,
        1e-2 * table.blast_percent, table.doubt,
    )  # fmt: skip
    ends = 1e-3 * np.array([table.between_holes_ms, table.between_rows_ms]).T
    planned = blast.times
    tell("holes", 0, 2)
    fired = [pattern @ ends[1], pattern @ ends[0], planned]
    spectra, scales, used = _spectra(
        project, np.array([scatter.reach(t) for t in fired]), out, executor
    )
    tell("delays", 1, 2)
    with named_error(where):
        if table.band_hz is not None:
            spectra = spectra.banded(*table.band_hz)
        plan = plan_delays(
            spectra, pattern[used], ends[0], ends[1], scatter, planned=planned[used], limits=limits,
            step=1e-3 * table.step_ms, share=1e-2 * table.share_percent, scales=scales,
            allowed=_allowed(project, used), n_blasts=table.draws, seed=table.seed,
        )  # fmt: skip
    tell("writing", 2, 2)
    folder = new_folder(out)
    summary = summarise_delays(project, plan, pattern)
    write_summary(folder / RESULT, summary)
    write_tables(folder, delay_tables(summary))
    write_delay_report(folder / REPORT, summary)
    return summary, folder


def _settings(project: Project) -> tuple[DelaysConfig, Blast]:
    """Return the table of delays of a project, and its blast."""
    table, where = project.config.delays, f"{project.path.name}: delays"
    if table is None:
        raise InputError(f"{where}: missing; give the bounds of the delays, and the houses")
    if project.blast is None:
        raise InputError(f"{where}: needs [blast] with the holes that are to be fired")
    return table, project.blast


def _stored_runs(folder: Path, fresh: bool, say: Say) -> None:
    """Report that stored responses are reused, or remove them for a fresh start."""
    if not any(folder.glob("*.h5")):
        return
    if fresh:
        shutil.rmtree(folder)
    else:
        say(f"uses the responses stored in {folder}; --fresh runs them again")


def house_limits(project: Project) -> np.ndarray:
    """Return the limit of each house, (n_houses,) m/s; the lowest of a curve within the band.

    Raises
    ------
    InputError
        If a curve has no value within the band, or limits the vector sum.
    """
    table, curves, limits = _settings(project)[0], load_limits(), []
    for house in table.houses:
        where = f"{project.path.name}: delays.houses.{house.name}.limit_curve"
        if house.limit_curve is None:
            limits.append(1e-3 * (house.limit_mm_per_s or math.nan))
            continue
        curve = curves[house.limit_curve]
        if curve.quantity == "vector sum":
            raise InputError(f"{where}: limits the vector sum instead of PPV; give "
                             "limit_mm_per_s")  # fmt: skip
        if table.band_hz is None:
            raise InputError(f"{where}: depends on frequency; give delays.band_hz")
        low, high = table.band_hz
        corners = curve.corners[:, 0]
        within = corners[(corners > low) & (corners < high)]
        limit = float(np.min(curve.limit(np.array([low, *within, high]))))
        if np.isnan(limit):
            raise InputError(
                f"{where}: has no value below {corners[0]:g} Hz, and delays.band_hz begins at "
                f"{low:g} Hz; raise it or give limit_mm_per_s"
            )
        limits.append(limit)
    return np.array(limits)


def _pattern(project):
    """Return the number of delays before each hole."""
    blast, where = project.config.blast, f"{project.path.name}: delays.holes_per_row"
    n_holes, each = len(project.blast.times), project.config.delays.holes_per_row
    if each is None and blast.file is not None:
        raise InputError(f"{where}: missing; the hole table does not contain rows")
    each = blast.holes_per_row if each is None else each
    if n_holes % each:
        raise InputError(f"{where}: {n_holes} holes do not make rows of {each}")
    return rows_pattern(n_holes // each, each)


def _spectra(
    project: Project, reach: np.ndarray, out: Path, executor: Executor | None
) -> tuple[BlastSpectra, np.ndarray, np.ndarray]:
    """Return the responses of the holes at the houses, their scales, and which holes are used."""
    (table, blast), ends = _settings(project), (float(reach.min()), float(reach.max()))
    if table.houses[0].recorded is not None:
        beside = make_firing(project.config.blast, blast).scales  # over the recorded hole
        return _recorded(project, *ends), beside, np.arange(len(blast.times))
    names = [house.name for house in table.houses]
    known = {receiver.name: receiver for receiver in project.receivers}
    for name in names:
        if name not in known:
            raise InputError(
                f"{project.path.name}: delays.houses.{name}: must be a receiver, which are "
                f"{', '.join(known) or 'none'}, or have a recorded hole"
            )
    if project.config.holes_inside is None:
        raise InputError(
            f"{project.path.name}: delays.houses: the motion of each hole there is unknown; record "
            "a single hole at each, or model the holes with [holes_inside]"
        )
    _refuse_missing_band(project, names)
    model = replace(project.model, receivers=tuple(known[name] for name in names))
    bank = greens_functions(model, project.duration, folder=out / RUNS, executor=executor)
    spectra = blast_spectra(bank, model.sources, earliest=ends[0], latest=ends[1])
    return spectra, np.ones(len(model.sources)), np.flatnonzero(blast.charge)


def _refuse_missing_band(project: Project, names: list[str]) -> None:
    """Refuse delays by motion that the mesh does not carry to the houses."""
    table, where = _settings(project)[0], f"{project.path.name}: delays.band_hz"
    carried = {row.name: row.carried for row in project.accuracy.rows if row.name in names}
    least = min(carried, key=lambda name: carried[name])
    if table.band_hz is None:
        band = project.accuracy.band
        if not band.complete:
            raise InputError(
                f"{where}: missing, and the run holds {100 * band.energy_share:.2g} % of the "
                f"energy of the blast, up to {band.carried:.3g} of {band.needed:.3g} Hz (finding "
                "D40); refine the mesh, or give a band that it carries"
            )
    elif table.band_hz[1] > carried[least]:
        raise InputError(
            f"{where}: reaches to {table.band_hz[1]:g} Hz, the mesh carries "
            f"{carried[least]:.3g} Hz at {least}; refine it or narrow the band"
        )


def _recorded(project: Project, earliest: float, latest: float) -> BlastSpectra:
    """Return the spectra of single holes recorded at the houses."""
    (table, blast), motions, shifts = _settings(project), {}, None
    for house in table.houses:
        with named_error(f"{project.path.name}: delays.houses.{house.name}.recorded"):
            motions[house.name] = read_hole(house.recorded, project.folder)
    if table.wave_speed_m_per_s is not None:
        reference = blast.centres[0]
        shifts = [
            travel_shifts(blast, house.position_m, table.wave_speed_m_per_s, reference)
            for house in table.houses
            if house.position_m is not None  # as the table requires
        ]
    with named_error(f"{project.path.name}: delays.houses"):
        return signature_spectra(
            motions, len(blast.times), earliest=earliest, latest=latest,
            travel_shifts=shifts,
        )  # fmt: skip


def _allowed(project, used):
    """Return the check of the charge in 8 ms for times of the used holes, or None."""
    most, blast = project.config.delays.max_charge_per_8ms_kg, project.blast
    if most is None:
        return None

    def allowed(times):
        fired = blast.times.copy()
        fired[used] = times
        return replace(blast, times=fired).charge_per_window() <= most

    return allowed


def best_plans(blast: Blast, plan: DelayPlan, pattern: np.ndarray) -> list[dict]:
    """Return the ten best plans of a search, the best first.

    Parameters
    ----------
    blast : Blast
    plan : DelayPlan
    pattern : (n_holes, 2) float
        Number of delays between holes and between rows before each hole.
    """
    tried = np.array(plan.best.tried)
    order = np.argsort(tried[:, -1], kind="stable")[:MOST_PLANS]
    return [
        {
            "between_holes_s": holes,
            "between_rows_s": rows,
            "severity": severity,
            "charge_per_8ms_kg": _charge_in_8_ms(blast, pattern @ (holes, rows)),
            "last_s": float(np.ptp(pattern @ (holes, rows))),
        }
        for holes, rows, severity in tried[order]
    ]


def _charge_in_8_ms(blast, times):
    """Return the largest charge in 8 ms of a blast with other times, None where unknown."""
    if np.isnan(blast.charge).any():
        return None
    return replace(blast, times=times).charge_per_window()


def charge_histogram(blast: Blast, times: np.ndarray) -> list[list[float]]:
    """Return the charge in each 8 ms after the first firing: (start in s, charge in kg) rows.

    Notes
    -----
    The bins stand still; the largest charge in any 8 ms lies at or above the highest of them.
    """
    since = times - times.min()
    bins = np.floor(since / CHARGE_WINDOW + 1e-9).astype(int)
    charges = np.bincount(bins, weights=np.nan_to_num(blast.charge))
    return [[n * CHARGE_WINDOW, float(charge)] for n, charge in enumerate(charges)]


def delay_tables(summary: dict) -> dict[str, str]:
    """Return firing times, best plans and charges in 8 ms as CSV, by name."""
    histograms = [
        [name, 1e3 * start, charge]
        for name, rows in summary["charge_histogram"].items()
        for start, charge in rows
    ]
    return {
        "firing_times": csv_table(
            ("hole", "charge_kg", "x_m", "y_m", "z_m", "planned_ms", "best_ms"),
            [[row["hole"], row["charge_kg"], *row["collar"], 1e3 * row["planned_s"],
              1e3 * row["best_s"]] for row in summary["firing"]],
        ),
        "best_plans": csv_table(
            ("between_holes_ms", "between_rows_ms", "ppv_over_limit", "charge_per_8ms_kg",
             "last_ms"),
            [[1e3 * row["between_holes_s"], 1e3 * row["between_rows_s"], row["severity"],
              row["charge_per_8ms_kg"], 1e3 * row["last_s"]] for row in summary["best_plans"]],
        ),
        "charge_in_8_ms": csv_table(("plan", "start_ms", "charge_kg"), histograms),
    }  # fmt: skip


def _level_errors(project):
    """Return the error of the level at each house, with its law; None where a record sets it."""
    places = {receiver.name: receiver.position for receiver in project.receivers}
    return [
        level_error(project, places[house.name])
        if house.recorded is None and house.name in places else None
        for house in _settings(project)[0].houses
    ]  # fmt: skip


def _variation(table, plan):
    """Return how much holes vary, and the width of the 90 % band with and without, of the best.

    The width is the upper over the lower end, the median of the houses.
    """
    pairs = {"band_90": plan.after.band(0.9), "band_90_without": plan.alike.band(0.9)}
    widths = {name: float(np.median(high / low)) for name, (low, high) in pairs.items()}
    return {"charge_percent": table.charge_percent, **widths}


def summarise_delays(project: Project, plan: DelayPlan, pattern: np.ndarray) -> dict:
    """Return the plain numbers of a delay plan; ``pattern`` (n_holes, 2) delays before a hole."""
    (table, blast), gained = _settings(project), plan.gain
    times = pattern @ plan.best.delays
    curves, bands = load_limits(), {"before": plan.before, "after": plan.after}
    errors = _level_errors(project)
    at_level = {n: band.under([e and e[0] for e in errors]) for n, band in bands.items()}
    names = [house.recorded.file for house in table.houses if house.recorded is not None]
    files = project.input_files | {
        name: hashlib.sha256((project.folder / name).read_bytes()).hexdigest() for name in names
    }
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "delays_s": {"between_holes": plan.best.delays[0], "between_rows": plan.best.delays[1]},
        "firing": [
            {"hole": name, "charge_kg": charge, "collar": collar, "planned_s": planned,
             "best_s": best}
            for name, charge, collar, planned, best in zip(
                blast.hole_ids, blast.charge, blast.collar, blast.times, times, strict=True
            )
        ],
        "charge_per_8ms_kg": {
            "before": _charge_in_8_ms(blast, blast.times),
            "after": _charge_in_8_ms(blast, times),
            "allowed": table.max_charge_per_8ms_kg,
        },
        "charge_histogram": {
            "before": charge_histogram(blast, blast.times),
            "after": charge_histogram(blast, times),
        },
        "best_plans": best_plans(blast, plan, pattern),
        "band_hz": table.band_hz,
        "share": gained.share,
        "burden_m": project.config.blast and project.config.blast.burden_m,
        "severity": {"before": gained.before, "after": gained.after,
                     "reduction": gained.reduction, "reduction_90": gained.interval},
        "houses": [
            {
                "name": house.name,
                "limit": plan.limits[k],
                "curve": house.limit_curve,
                "level_by": "" if errors[k] is None else errors[k][1],
                "curve_verified": house.limit_curve and curves[house.limit_curve].verified,
                **{
                    name: {
                        "within_limit": at_level[name].share_below(plan.limits)[k],
                        "high": at_level[name].level(LEVEL)[k],
                        "levels": {f"{s:g}": band.level(s)[k] for s in SHARES},
                        "bands": {f"{s:g}": band.band(s)[:, k] for s in SHARES},
                    }
                    for name, band in bands.items()
                },
            }
            for k, house in enumerate(table.houses)
        ],
        "variation": _variation(table, plan),
        "tried": plan.best.tried,
        "files_sha256": files,
        "provenance": versions(input_hash("delays", files)),
    }  # fmt: skip
