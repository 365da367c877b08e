"""Diagnose the mine of Gol-e-Gohar from records in which one effect at a time is concealed.

    python examples/gol_e_gohar/diagnose.py [TRIAL ...]     all of them without a name

The ground is that of project.toml without joint sets, all of it elastic: layers, the two faults,
motion through the western face. Only the trial of the soil has soil, up to 5 Hz, as its zones make
a run thirty times as long; in the others schist takes its place, up to 15 Hz. The reference model
differs from the truth, which runs on a finer mesh: speeds within 1 %, stiffnesses within 5 %, noise
of 2 % of the PPV. Two blasts at five receivers are diagnosed by `pyblast diagnose`; a third, which
no fit uses, shows what is explained before and after. `./dev proof` also counts these trials, as
cases whose truths the authors know.
"""

import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast import diagnose, predict
from pyblast.config.config import check_config
from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.files import write_text
from pyblast.inference.records import band_functions
from pyblast.project.project import make_project
from pyblast.project.result import write_csv
from pyblast.recordings.recording import read_stations

HERE = Path(__file__).resolve().parent
FOLDER = HERE / "results" / "diagnoses"
PLACES = {  # m
    "toe": (120.0, 150.0), "ramp": (160.0, 110.0), "berm": (180.0, 190.0), "wall": (261.0, 150.0),
    "crest": (245.0, 100.0),
}  # fmt: skip
ROWS = {"S1": (1, 3, 100.0), "B1": (4, 15, 450.0), "H1": (3, 10, 450.0)}  # rows, holes, kg
BANDS = {True: (1.0, 5.0), False: (1.0, 15.0)}  # Hz, with soil and without
DURATION, BEFORE, DT = 1.6, 0.5, 1.0 / 128.0
SPEEDS, STIFFNESSES, NOISE = 0.01, 0.05, 0.02
PRESSURE = 500.0  # kPa on the faults
CAVITY = {  # a single hole, 188 mm/s at 39 m
    "material": "magnetite", "hole_m": [-34.99, 137.27, 68.4], "receiver_m": [0, 150, 80],
    "charge_kg": 450, "radius_m": 5, "peak_time_ms": 20, "duration_s": 1.5,
}  # fmt: skip
INPUT = {"face": "west", "low_pass_hz": 20, "distance_m": 39}  # the same over the whole face


def tables(name, edges, soil):
    """Return the tables of a blast for a number of edges per wavelength, with or without soil."""
    text = tomllib.loads((HERE / "project.toml").read_text(encoding="utf-8"))
    mesh = text["mesh"]
    fault = {key: text["joints"]["fault"][key] for key in ("kn_gpa_per_m", "ks_gpa_per_m")}
    if not soil:
        top, schist, magnetite = mesh["layers"]
        thickness = top["thickness_m"] + schist["thickness_m"]
        mesh["layers"] = [{**schist, "thickness_m": thickness}, magnetite]
    layers = [part["material"] for part in mesh["layers"]]
    rock = ("density_kg_per_m3", "bulk_mpa", "shear_mpa")
    return {
        "title": "Gol-e-Gohar, elastic, faults only",
        "mesh": {
            **{key: mesh[key] for key in ("size_m", "origin_m", "layers")},
            "faults": [{**part, "joint": part["name"]} for part in mesh["faults"]],
            "quadratic": True, "edges_per_wavelength": edges, "frequency_hz": BANDS[soil][1],
        },
        "materials": {
            name: {key: text["materials"][name][key] for key in rock} for name in layers
        },
        "joints": {
            part["name"]: {"law": "elastic", "insitu_pressure_kpa": PRESSURE, **fault}
            for part in mesh["faults"]
        },
        "boundaries": text["boundaries"],
        "damping": {key: text["damping"][key] for key in ("ratio", "frequency_hz")},
        "blast": {"file": f"{name}.csv"},
        "signature": {"cavity": CAVITY},
        "input": INPUT,
        "receivers": [{"name": key, "position_m": [*place]} for key, place in PLACES.items()],
        "run": {"duration_s": DURATION, "compare_band_hz": [*BANDS[soil]]},
    }  # fmt: skip


def toml(value):
    """Return a value as TOML; tables on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {toml(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value)


def write_holes(folder, name, delays):
    """Write the hole table of a blast, whose delays in s are ``delays``."""
    _, holes, charge = ROWS[name]
    lines = ["id,x,y,z,charge_kg,delay_s"]
    for n, delay in enumerate(delays):
        x, y = -39.0 - 6.5 * (n // holes), 150.0 + 7.5 * (n % holes - 0.5 * (holes - 1))
        lines.append(f"{n + 1},{x:g},{y:g},71.5,{charge:g},{delay:.6g}")
    write_text(folder / f"{name}.csv", "\n".join(lines) + "\n")


def planned(name):
    """Return the planned delays (n_holes,) in s: 40 ms from row to row."""
    rows, holes, _ = ROWS[name]
    return 0.04 * np.repeat(np.arange(rows), holes)


def without_second_fault(table):
    """Leave F2 out of the reference model."""
    table["mesh"]["faults"] = table["mesh"]["faults"][:1]
    del table["joints"]["F2"]


def soft_soil(table):
    """Make the soil softer and thinner than in the reference model."""
    soil, schist, _ = table["mesh"]["layers"]
    soil["thickness_m"], schist["thickness_m"] = 14, schist["thickness_m"] + 6
    for key in ("bulk_mpa", "shear_mpa"):
        table["materials"]["soil"][key] *= 0.6


def quality(table):
    """Give the ground constant Q instead of Rayleigh damping."""
    del table["damping"]
    for rock in table["materials"].values():
        rock |= {"qp": 30.0, "qs": 20.0, "quality_band_hz": [*BANDS[False]]}


# Name: effect, physics, change of the reference tables, of the true tables, of the project
TRIALS = {
    "nothing 1": (None, None, None, None, None),
    "nothing 2": (None, None, None, None, None),
    "F2 left out": ("missing_joint", True, without_second_fault, None, None),
    "F1 closes": ("joint_nonlinear_closure", True, None, None,
                  ("joint_nonlinear_closure", {"closed": 0.6})),
    "F1 slips": ("joint_slip", True, None, None,
                 ("joint_slip", {"strength": 3e4, "residual": 0.5})),
    "soft, thin soil": ("soft_surface_layer", True, None, soft_soil, None),
    "Q for Rayleigh": ("attenuation_Q", True, None, quality, None),
    "delays scatter": ("delay_scatter", False, None, None, None),
    "turned sensor": ("sensor_orientation_or_polarity", False, None, None, None),
}  # fmt: skip
SCATTER, TURN = 0.015, np.radians(35.0)  # s of a row and of a hole, of the sensor "berm"


def true_motion(folder, trial, number):
    """Return the true motion of each blast at each receiver."""
    _, _, _, truth, change = TRIALS[trial]
    rng = np.random.default_rng(number)
    scale = dict(
        zip(("magnetite", "schist", "soil"), 1.0 + SPEEDS * rng.standard_normal(3), strict=True)
    )
    spring = {fault: 1.0 + STIFFNESSES * rng.standard_normal(2) for fault in ("F1", "F2")}
    motion = {}
    for name in ROWS:
        table = tables(name, 5.0, truth is soft_soil)
        if truth is not None:
            truth(table)
        for layer, rock in table["materials"].items():
            for key in ("bulk_mpa", "shear_mpa"):
                rock[key] *= scale[layer] ** 2
        for fault, factors in spring.items():
            for key, factor in zip(("kn_gpa_per_m", "ks_gpa_per_m"), factors, strict=True):
                table["joints"][fault][key] *= factor
        delays = planned(name)
        if trial == "delays scatter":
            row = rng.normal(0.0, SCATTER, ROWS[name][0])[(25.0 * delays).round().astype(int)]
            delays = delays + row + rng.normal(0.0, SCATTER, len(delays))
            delays -= delays.min()
        write_holes(folder / "truth", name, delays)
        project = make_project(check_config(table), folder / "truth" / f"{name}.toml")
        if change is not None:
            project = LIBRARY[change[0]].apply(project, "F1", **change[1])
        motion[name] = {}
        for receiver, one in project.simulate().seismograms.items():
            one = one.sampled(-BEFORE, DT, int((BEFORE + DURATION) / DT) - 1)
            if trial == "turned sensor" and receiver == "berm":
                one = replace(one, velocity=turned(one.velocity))
            added = NOISE * one.ppv * rng.standard_normal(one.velocity.shape)
            motion[name][receiver] = replace(one, velocity=one.velocity + added)
    return motion


def turned(velocity):
    """Return what a sensor turned clockwise by `TURN` records of east, north, vertical (n, 3)."""
    sine, cosine = np.sin(TURN), np.cos(TURN)
    east, north, up = velocity.T
    return np.column_stack([cosine * east - sine * north, sine * east + cosine * north, up])


def written(folder, trial, motion):
    """Write the reference project of a trial with its records; return the path of the first."""
    believed = TRIALS[trial][2]
    for name in ROWS:
        write_holes(folder, name, planned(name))
    for name in ("B1", "S1"):
        table = tables(name, 3.0, TRIALS[trial][3] is soft_soil)
        if believed is not None:
            believed(table)
        for part in table["receivers"]:
            record = motion[name][part["name"]]
            part["recorded"] = {"file": f"{name}_{part['name']}.csv", "start_s": -BEFORE}
            write_csv(folder / part["recorded"]["file"], record)
        if name == "B1":
            table["diagnosis"] = {"blasts": ["S1.toml"]}
        write_text(folder / f"{name}.toml", "".join(f"{k} = {toml(v)}\n" for k, v in table.items()))
    return folder / "B1.toml"


def explained(recorded, path, limits):
    """Return the share of energy in a band of the records of H1 that a prediction explains."""
    foretold, shares = read_stations(path), []
    for name, record in recorded.items():
        band = band_functions(len(record.velocity), record.dt, limits)
        data, model = (
            v.T @ band.basis for v in (record.velocity, foretold[name].seismogram.velocity)
        )
        shares.append(1.0 - np.sum((data - model) ** 2) / np.sum(data**2))
    return round(float(np.median(shares)), 4)


def diagnosed(trial, number):
    """Make the records of a trial and diagnose them.

    Returns
    -------
    answer : dict
        As in ``diagnosis.json``.
    explained : dict
        Share of H1 that is explained ``before`` and ``after``.
    """
    folder = FOLDER / trial.replace(" ", "_").replace(",", "")
    (folder / "truth").mkdir(parents=True, exist_ok=True)
    motion = true_motion(folder, trial, number)
    answer, out = diagnose(written(folder, trial, motion), folder / "diagnosis", progress=told)
    shares = {}
    for key, baseline in (("before", True), ("after", False)):
        target = out / f"explained_{key}.mseed"
        predict(folder / "B1.toml", out, folder / "H1.csv", target, baseline=baseline)
        shares[key] = explained(motion["H1"], target, BANDS[TRIALS[trial][3] is soft_soil])
    return answer, shares


def told(stage, done, total):
    """Say how far a diagnosis is."""
    print(f"  {stage} {done}/{total}", flush=True)


def main(arguments):
    """Diagnose the trials that are asked for, and print what came out."""
    unknown = set(arguments) - set(TRIALS)
    if unknown:
        sys.exit(f"no trial is called {', '.join(sorted(unknown))}: they are {', '.join(TRIALS)}")
    for number, trial in enumerate(TRIALS, 1):
        if arguments and trial not in arguments:
            continue
        print(trial, flush=True)
        answer, shares = diagnosed(trial, number)
        found = [one["act"] for one in answer["mistakes"]]
        found += [one["label"] for one in answer["effects"]]
        print(f"  {answer['outcome']} {', '.join(found)}; H1 explained {shares}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
