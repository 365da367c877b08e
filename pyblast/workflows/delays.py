"""Delay optimisation of a project: motions of the holes, search, files."""

import hashlib
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..blasts.blast import Blast
from ..blasts.signature import travel_shifts
from ..errors import InputError, named_error
from ..planning.delays import DelayPlan, plan_delays, rows_pattern
from ..planning.peak_distribution import FiringScatter
from ..project.config import DelaysConfig
from ..project.inputs import make_firing, read_hole
from ..project.project import Project, load_project
from ..project.result import write_summary
from ..report.delays import write_delay_report
from ..runs.blast_ensemble import BlastSpectra, blast_spectra, signature_spectra
from ..runs.cache import input_hash
from ..runs.greens_bank import greens_functions
from ..signals.comparison import load_limits
from ..solver.preparation import versions
from . import Progress, Say, new_folder, silent

RESULT, REPORT = "delays.json", "report.html"
RUNS = "runs"  # folder of stored responses, shared by all plans
SHARES = (0.5, 0.9, 0.95)


def optimise_delays(
    project: Project | str | Path,
    out: str | Path | None = None,
    *,
    fresh: bool = False,
    full: bool = False,
    progress: Progress | None = None,
    say: Say | None = None,
) -> tuple[dict, Path]:
    """Find the delays of least vibration that table ``[delays]`` of a project asks for.

    Parameters
    ----------
    project : Project or path of a project file
    out : path, optional
        Folder that takes numbered folders, one per plan, and the responses of the holes in
        ``runs``, from which the same call goes on; ``delays`` beside the project file by default.
    fresh : bool
        Run the responses of the holes anew.
    full : bool
        Take the table ``[full]`` of the project file.
    progress : callable, optional
        Called with (stage, done, total).
    say : callable, optional
        Called with a sentence when kept responses are there.

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
        project = load_project(project, full)
    tell, where = progress or silent, f"{project.path.name}: delays"
    table, blast = _settings(project)
    limits = house_limits(project)
    out = project.folder / "delays" if out is None else Path(out)
    _kept_runs(out / RUNS, fresh, say or silent)
    pattern = _pattern(project)
    scatter = FiringScatter(
        1e-3 * table.scatter_ms, 1e-2 * table.scatter_percent, 1e-2 * table.charge_percent,
        1e-2 * table.blast_percent, table.doubt,
    )  # fmt: skip
    ends = 1e-3 * np.array([table.between_holes_ms, table.between_rows_ms]).T
    planned = blast.times
    tell("holes", 0, 2)
    fired = [pattern @ ends[1], pattern @ ends[0], planned]
    spectra, scales, kept = _spectra(project, np.array([scatter.reach(t) for t in fired]), out)
    tell("delays", 1, 2)
    with named_error(where):
        if table.band_hz is not None:
            spectra = spectra.banded(*table.band_hz)
        found = plan_delays(
            spectra, pattern[kept], ends[0], ends[1], scatter, planned=planned[kept], limits=limits,
            step=1e-3 * table.step_ms, share=1e-2 * table.share_percent, scales=scales,
            allowed=_allowed(project, kept), n_blasts=table.draws, seed=table.seed,
        )  # fmt: skip
    tell("writing", 2, 2)
    folder = new_folder(out)
    summary = summarise_delays(project, found, pattern @ found.best.delays)
    write_summary(folder / RESULT, summary)
    write_delay_report(folder / REPORT, summary)
    return summary, folder


def _settings(project: Project) -> tuple[DelaysConfig, Blast]:
    """Return the table of delays of a project, and its blast."""
    table, where = project.config.delays, f"{project.path.name}: delays"
    if table is None:
        raise InputError(f"{where}: missing; say between which delays, and at which houses")
    if project.blast is None:
        raise InputError(f"{where}: needs [blast] with the holes that are to be fired")
    return table, project.blast


def _kept_runs(folder: Path, fresh: bool, say: Say) -> None:
    """Say that responses are kept, or remove them for a fresh start."""
    if not any(folder.glob("*.h5")):
        return
    if fresh:
        shutil.rmtree(folder)
    else:
        say(f"goes on with the responses kept in {folder}; --fresh would run them anew")


def house_limits(project: Project) -> np.ndarray:
    """Return the limit of each house, (n_houses,) m/s: of a curve the lowest within the band.

    Raises
    ------
    InputError
        If a curve says nothing within the band, or is of the vector sum.
    """
    table, curves, limits = _settings(project)[0], load_limits(), []
    for house in table.houses:
        where = f"{project.path.name}: delays.houses.{house.name}.limit_curve"
        if house.limit_curve is None:
            limits.append(1e-3 * (house.limit_mm_per_s or math.nan))
            continue
        curve = curves[house.limit_curve]
        if curve.quantity == "vector sum":
            raise InputError(f"{where}: limits the vector sum, and PPV is sought; give "
                             "limit_mm_per_s")  # fmt: skip
        if table.band_hz is None:
            raise InputError(f"{where}: depends on frequency; give delays.band_hz")
        low, high = table.band_hz
        corners = curve.corners[:, 0]
        within = corners[(corners > low) & (corners < high)]
        limit = float(np.min(curve.limit(np.array([low, *within, high]))))
        if np.isnan(limit):
            raise InputError(
                f"{where}: says nothing below {corners[0]:g} Hz, and delays.band_hz begins at "
                f"{low:g} Hz; raise it or give limit_mm_per_s"
            )
        limits.append(limit)
    return np.array(limits)


def _pattern(project):
    """Return how many delays come before each hole."""
    blast, where = project.config.blast, f"{project.path.name}: delays.holes_per_row"
    n_holes, each = len(project.blast.times), project.config.delays.holes_per_row
    if each is None and blast.file is not None:
        raise InputError(f"{where}: missing; the hole table does not say where a row ends")
    each = blast.holes_per_row if each is None else each
    if n_holes % each:
        raise InputError(f"{where}: {n_holes} holes do not make rows of {each}")
    return rows_pattern(n_holes // each, each)


def _spectra(
    project: Project, reach: np.ndarray, out: Path
) -> tuple[BlastSpectra, np.ndarray, np.ndarray]:
    """Return the responses of the holes at the houses, their scales, and which holes count."""
    (table, blast), ends = _settings(project), (float(reach.min()), float(reach.max()))
    if table.houses[0].recorded is not None:
        beside = make_firing(project.config.blast, blast).scales  # over the recorded hole
        return _recorded(project, *ends), beside, np.arange(len(blast.times))
    names = [house.name for house in table.houses]
    known = {one.name: one for one in project.receivers}
    for name in names:
        if name not in known:
            raise InputError(
                f"{project.path.name}: delays.houses.{name}: must be a receiver, which are "
                f"{', '.join(known) or 'none'}, or have a recorded hole"
            )
    if project.config.holes_inside is None:
        raise InputError(
            f"{project.path.name}: delays.houses: what each hole does there is not known; record a "
            "single hole at each, or model the holes with [holes_inside]"
        )
    model = replace(project.model, receivers=tuple(known[name] for name in names))
    bank = greens_functions(model, project.duration, folder=out / RUNS)
    spectra = blast_spectra(bank, model.sources, earliest=ends[0], latest=ends[1])
    return spectra, np.ones(len(model.sources)), np.flatnonzero(blast.charge)


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
        ]
    with named_error(f"{project.path.name}: delays.houses"):
        return signature_spectra(
            motions, len(blast.times), earliest=earliest, latest=latest,
            travel_shifts=shifts,
        )  # fmt: skip


def _allowed(project, kept):
    """Return what says whether times of the holes that count keep the charge in 8 ms, or none."""
    most, blast = project.config.delays.most_charge_kg, project.blast
    if most is None:
        return None

    def allowed(times):
        fired = blast.times.copy()
        fired[kept] = times
        return replace(blast, times=fired).charge_per_window() <= most

    return allowed


def summarise_delays(project: Project, found: DelayPlan, times: np.ndarray) -> dict:
    """Return a plan of delays as plain numbers; ``times`` (n_holes,) s of all its holes."""
    (table, blast), gained = _settings(project), found.gain
    curves, bands = load_limits(), {"before": found.before, "after": found.after}
    names = [house.recorded.file for house in table.houses if house.recorded is not None]
    files = project.input_files | {
        name: hashlib.sha256((project.folder / name).read_bytes()).hexdigest() for name in names
    }
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "delays_s": {"between_holes": found.best.delays[0], "between_rows": found.best.delays[1]},
        "firing": [
            {"hole": name, "planned_s": planned, "best_s": best}
            for name, planned, best in zip(blast.hole_ids, blast.times, times, strict=True)
        ],
        "band_hz": table.band_hz,
        "share": gained.share,
        "severity": {"before": gained.before, "after": gained.after,
                     "reduction": gained.reduction, "reduction_90": gained.interval},
        "houses": [
            {
                "name": house.name,
                "limit": found.limits[k],
                "curve": house.limit_curve,
                "curve_verified": house.limit_curve and curves[house.limit_curve].verified,
                **{
                    name: {
                        "kept": found.kept(one)[k],
                        "levels": {f"{s:g}": one.level(s)[k] for s in SHARES},
                        "bands": {f"{s:g}": one.band(s)[:, k] for s in SHARES},
                    }
                    for name, one in bands.items()
                },
            }
            for k, house in enumerate(table.houses)
        ],
        "tried": found.best.tried,
        "files_sha256": files,
        "provenance": versions(input_hash("delays", files)),
    }  # fmt: skip
