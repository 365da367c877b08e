"""A small site whose records are made by the solver itself, with or without hidden physics."""

from dataclasses import replace

import numpy as np

from benchmarks.blind.flat_models import Discretization
from pyblast.blasts.blast import Blast
from pyblast.config.config import check_config
from pyblast.diagnosis.calibration import Baseline
from pyblast.diagnosis.case import Case, case_of
from pyblast.diagnosis.effects import Scene
from pyblast.diagnosis.error import usual_energy
from pyblast.diagnosis.forward import simulation_of
from pyblast.model.model import Receiver
from pyblast.model.source import TimeFunction
from pyblast.project.project import Project, make_project
from pyblast.project.uncertain_ground import factors_of
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram
from pyblast.sources.inside import Inside
from pyblast.survey import Survey

CUT = Discretization(30.0, 60.0, 1.3, quadratic=True)
DT, SAMPLES, BEFORE = 0.004, 100, 50
BAND = (4.0, 25.0)


def small_site() -> Project:
    """Return a project of 120 x 90 x 60 m: a joint, two blasts, four receivers, no records."""
    times = np.arange(0.0, 0.1, 0.002)
    pulse = TimeFunction(np.sin(np.pi * times / 0.1) ** 2 * 6e10, 0.002, 0.0)
    places = [(15.0, 86.0, 0.0), (80.0, 20.0, 0.0), (100.0, 60.0, 0.0), (110.0, 30.0, -20.0)]
    blasts = {
        "S1": holes([[30.0, 30.0]], [10.0], [0.0]),
        "B1": holes([[30.0, 30.0], [34.0, 36.0], [38.0, 42.0]], [60.0] * 3, [0.0, 0.03, 0.06]),
    }
    receivers = tuple(Receiver(f"R{n}", place) for n, place in enumerate(places))
    site = of_shots(make_project(check_config(TABLES), "small.toml"), blasts, pulse, receivers)
    return site.changed(mesh=site.for_band(BAND[1]))


def with_records(project, tables) -> Project:
    """Return a project with other recordings, by blast and receiver."""
    return replace(project, survey=replace(project.survey, recorded=tables))


def of_shots(project, blasts, moment_rate, receivers):
    """Return a project of blasts with one moment rate of 1 kg, without records."""
    shots = [
        replace(project.shots[0], name=name, fired=blast, held=Inside(moment_rate))
        for name, blast in blasts.items()
    ]
    return replace(project, survey=Survey(tuple(shots), tuple(receivers), {}))


TABLES = {
    "title": "small",
    "mesh": {
        "size_m": [120.0, 90.0, 60.0], "origin_m": [0.0, 0.0, -60.0], "edge_m": 30.0,
        "layers": [{"material": "rock"}],
        "faults": [{"name": "J1", "dip_deg": 90.0, "dip_direction_deg": 90.0,
                    "through_m": [60.0, 45.0, 0.0]}],
    },
    "materials": {"rock": {"density_kg_per_m3": 2600.0, "cp_m_per_s": 2800.0,
                           "cs_m_per_s": 1600.0}},
    "joints": {"J1": {"law": "elastic", "kn_gpa_per_m": 0.8, "ks_gpa_per_m": 0.4,
                      "insitu_pressure_kpa": 100.0}},
    "boundaries": {"viscous": ["west", "east", "south", "north", "bottom"]},
    "blast": {"file": "holes.csv", "charge_exponent": 0.9},
    "holes_inside": {"moment_rate_file": "source.csv"},
    "run": {"duration_s": 0.4, "compare_band_hz": list(BAND)},
    "diagnosis": {"noise_window_s": [-BEFORE * DT, 0.0]},
}  # fmt: skip


def holes(places, charge, times):
    """Return a blast of short vertical holes."""
    places = np.array(places, dtype=float)
    collar, toe = (np.column_stack([places, np.full(len(places), z)]) for z in (-9.0, -11.0))
    n = len(places)
    return Blast("", collar, toe, np.array(charge), np.array(times), np.full(n, 0.1))


def recorded(
    site: Project, truth: Project | None = None, noise=0.003, seed=1, change=None, fine=False
):
    """Return a case with records of the truth: coloured noise, a share of the peak, added."""
    blank = {
        blast: {r.name: _recording(np.zeros((BEFORE + SAMPLES, 3))) for r in site.stations}
        for blast in site.blasts
    }
    rng = np.random.default_rng(seed)
    first = with_records(site, blank)
    for some in blank.values():  # a noise window must move
        for one in some.values():
            one.seismogram.velocity.setflags(write=True)
            one.seismogram.velocity[:] = rng.normal(size=one.seismogram.velocity.shape)
    case = case_of(first)
    motion = simulation_of(case, finer=fine).motion(truth or site)
    if change is not None:
        motion = change(motion)
    records = {}
    for blast, some in zip(case.blasts, motion, strict=True):
        records[blast] = {}
        for name, velocity in zip(case.receivers, some, strict=True):
            quiet = noise * np.abs(motion[0]).max() * _coloured(rng, BEFORE + SAMPLES)
            quiet[BEFORE:] += velocity.T
            records[blast][name] = _recording(quiet)
    return case_of(with_records(site, records))


def scene_of(case: Case) -> Scene:
    """Return a case of the small site as if it were calibrated: one run of each blast."""
    simulation = simulation_of(case)
    motion = simulation.motion(case.project)
    times = DT * np.arange(case.n_samples)
    stretched = times * np.gradient(motion, DT, axis=-1)
    unknowns = factors_of(case.project)
    slopes = np.stack([stretched, 0.7 * stretched, 0.05 * motion, -0.03 * motion])
    baseline = Baseline(
        case, unknowns, np.zeros(4), np.diag([one.sigma**2 for one in unknowns]), case.project,
        motion, slopes, motion, np.zeros_like(motion), usual_energy(case),
    )  # fmt: skip
    holes = np.stack([motion[0], np.roll(motion[0], 3, axis=-1), 0.5 * motion[0]])
    return Scene(simulation, baseline, {"S1": motion[:1], "B1": holes})


def _coloured(rng, n):
    """Return noise (n, 3) of unit variance that remembers its last sample."""
    noise = rng.normal(size=(n + 50, 3))
    for k in range(1, len(noise)):
        noise[k] = 0.7 * noise[k - 1] + np.sqrt(1.0 - 0.49) * noise[k]
    return noise[50:]


def _recording(velocity):
    """Return a recording that begins before the blast."""
    seismogram = Seismogram(velocity, DT, -BEFORE * DT, "")
    return Recording(seismogram, "", "", None, np.zeros(velocity.shape, dtype=bool))
