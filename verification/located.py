"""Bodies hidden in a small site: where the map of secondary sources puts them.

    python -m verification.located [NAME ...] [--again] [--minutes N]

Soft, stiff and damaged bodies and nearly voids are drawn with a seed and run by the program on
another mesh, with errors drawn from the model of these; the map is made on the mesh of a
diagnosis. Writes the rows that ``verification/located.json`` lacks and the table of
docs/quality/diagnosis.md; ``--page`` writes the table alone.
"""

import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from pyblast.blasts.blast import Blast
from pyblast.config.config import check_config
from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.forward import quarter_wave, simulation_of
from pyblast.diagnosis.scores import SiteScores
from pyblast.inference.location import located
from pyblast.model.ground_fields import Body, DamagedZone
from pyblast.model.model import Receiver
from pyblast.model.source import TimeFunction
from pyblast.project.project import make_project
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram
from pyblast.sources.inside import Inside
from pyblast.survey import Survey
from pyblast.workflows.diagnose import prepared

from .rows import study

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "diagnosis.md"
BEGIN, END = "<!-- located: from verification/located.json -->", "<!-- end of located -->"
SEED, DT, SAMPLES, BEFORE, HIGH = 71, 0.004, 110, 50, 25.0
CHANGES = {"soft": -0.35, "stiff": 0.3, "nearly void": -1.2, "damaged": 0.4}
ROWS = [f"{kind} {n}" for n in range(1, 7) for kind in CHANGES]
TABLES = {
    "title": "located",
    "mesh": {"size_m": [180.0, 140.0, 80.0], "origin_m": [0.0, 0.0, -80.0],
             "layers": [{"material": "rock"}],
             "faults": [{"name": "J1", "dip_deg": 90.0, "dip_direction_deg": 90.0,
                         "through_m": [75.0, 70.0, 0.0]}]},
    "materials": {"rock": {"density_kg_per_m3": 2600.0, "cp_m_per_s": 3000.0,
                           "cs_m_per_s": 1700.0}},
    "joints": {"J1": {"law": "elastic", "kn_gpa_per_m": 1.6, "ks_gpa_per_m": 0.8,
                      "insitu_pressure_kpa": 100.0}},
    "boundaries": {"viscous": ["west", "east", "south", "north", "bottom"]},
    "blast": {"file": "holes.csv"}, "holes_inside": {"moment_rate_file": "source.csv"},
    "run": {"duration_s": 0.45, "compare_band_hz": [4.0, HIGH]},
    "diagnosis": {"noise_window_s": [-BEFORE * DT, 0.0]},
}  # fmt: skip
PLACES = [(20, 120, 0), (60, 100, 0), (100, 30, 0), (110, 110, 0), (140, 70, 0), (165, 25, 0),
          (160, 120, 0), (120, 60, -30)]  # fmt: skip


def holes(places, charge):
    """Return a blast of short upright holes that fire together."""
    ends = [np.column_stack([places, np.full(len(places), z)]) for z in (-9.0, -11.0)]
    n = len(places)
    return Blast("", *ends, np.full(n, charge), np.zeros(n), np.full(n, 0.1))


def site():
    """Return the project of the site, without records."""
    times = np.arange(0.0, 0.1, 0.002)
    pulse = TimeFunction(np.sin(np.pi * times / 0.1) ** 2 * 6e10, 0.002, 0.0)
    blasts = {"S1": holes([[30.0, 40.0]], 10.0), "B1": holes([[34.0, 30.0], [40.0, 34.0]], 60.0)}
    receivers = tuple(Receiver(f"R{n}", place) for n, place in enumerate(PLACES))
    project = make_project(check_config(TABLES), "located.toml")
    shots = tuple(
        replace(project.shots[0], name=name, fired=blast, held=Inside(pulse))
        for name, blast in blasts.items()
    )
    project = replace(project, survey=Survey(shots, receivers, {}))
    return project.changed(mesh=project.for_band(HIGH))


def recorded(project, motion, rng):
    """Return a project with motion (n_blasts, n_receivers, 3, n) and white noise as its records."""
    tables = {}
    for blast, own in zip(project.blasts, motion, strict=True):
        tables[blast] = {}
        for receiver, part in zip(project.stations, own, strict=True):
            noise = 1e-3 * np.abs(motion[0]).max() * rng.normal(size=(BEFORE + SAMPLES, 3))
            noise[BEFORE:] += part.T
            record = Seismogram(noise, DT, -BEFORE * DT, "")
            tables[blast][receiver.name] = Recording(
                record, "", "", None, np.zeros(noise.shape, dtype=bool)
            )
    return replace(project, survey=replace(project.survey, recorded=tables))


@cache
def reference():
    """Return the scores of the site as it is, and a simulation of it on another mesh."""
    project, rng = site(), np.random.default_rng(SEED)
    blank = recorded(project, rng.normal(size=(2, len(PLACES), 3, SAMPLES)), rng)
    case = case_of(blank)
    case = case_of(recorded(project, simulation_of(case).motion(project), rng))
    scene, _ = prepared(case)
    other = case.project.changed(mesh=case.project.for_band(2.0 * HIGH))
    simulation = simulation_of(case)
    return SiteScores(scene, (), SEED), simulation, other, simulation.motion(other)


def drawn(name):
    """Return kind, place and the field of the body of a row."""
    kind, number = name.rsplit(" ", 1)
    rng = np.random.default_rng((SEED, list(CHANGES).index(kind), int(number)))
    place = rng.uniform((50.0, 40.0, -50.0), (160.0, 120.0, -8.0))
    if kind != "damaged":
        return kind, place, Body(tuple(place), CHANGES[kind], rng.uniform(8.0, 15.0))
    along = np.array([rng.uniform(-15.0, 15.0), rng.uniform(-15.0, 15.0), 5.0])
    return (
        kind,
        place,
        DamagedZone(
            np.array([[place - along, place + along]]), CHANGES[kind], rng.uniform(6.0, 10.0)
        ),
    )


def measured(name):
    """Return the row of a body."""
    scores, simulation, other, before = reference()
    scene, (kind, place, field) = scores.scene, drawn(name)
    change = scene.seen(simulation.motion(other.changed(fields=(field,))) - before)
    rng = np.random.default_rng((SEED, ROWS.index(name)))
    at = scores.error.scores(change[None]).at._replace(scatter=0.005, transfer=0.002, nuisance=1.0)
    residual = change + scores.error.draws(rng, 1, at)[0]
    rock, _ = scene.secondary_places
    reach = quarter_wave(scene.case.project, scene.case)
    found = located(scores.error, rock.spread(reach), residual, 0.3)
    away = np.linalg.norm(rock.centres - place, axis=1)
    order = np.argsort(-found.log_bayes, kind="stable")
    above = np.cumsum(rock.sizes[order])[np.flatnonzero(order == np.argmin(away))[0]]
    recorded_energy = np.sum(scene.seen(scene.baseline.reference) ** 2)
    return {
        "kind": kind, "place_m": np.round(place, 1).tolist(),
        "energy_percent": float(f"{100 * np.sum(change**2) / recorded_energy:.3g}"),
        "rank_percent": round(float(100 * above / rock.sizes.sum()), 2),
        "away_m": round(float(away[found.best]), 1),
        "within_m": round(found.within(reach), 1),
        "score": round(found.score, 1),
        "cs_percent": round(100.0 * float(np.expm1(found.strength[found.best, 1])), 1),
    }  # fmt: skip


def table(rows):
    """Return the lines of the table and the share of bodies that are found."""
    lines = [
        "| body | energy, % | rank of truth, % of the volume | best place off by, m | stated "
        "within, m | "
        "ln B | cs there, % |",
        "|---|---|---|---|---|---|---|",
    ]
    held = [rows[name] for name in ROWS if name in rows]
    for name, row in ((each, rows[each]) for each in ROWS if each in rows):
        values = (row[key] for key in ("energy_percent", "rank_percent", "away_m", "within_m",
                                       "score", "cs_percent"))  # fmt: skip
        lines.append(f"| {name} | {' | '.join(f'{value:g}' for value in values)} |")
    near = sum(row["away_m"] <= row["within_m"] for row in held)
    top = sum(row["rank_percent"] <= 2.0 for row in held)
    away = np.median([row["away_m"] for row in held]) if held else 0.0
    return [
        *lines, "",
        f"{top} of {len(held)} in the top 2 % of the volume, {near} within the stated distance; "
        f"{away:.0f} m off in the median.",
    ]  # fmt: skip


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, ROWS, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
