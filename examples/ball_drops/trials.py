"""Trials with a known truth: records simulated or spoiled by a seed, judged like the real ones.

    python examples/ball_drops/trials.py [FOLDER]

Rows go to ``trials.json`` beside this file, one by one; those that are there already stay. The
records of the drops are not read.
"""

import json
import sys
import time
from pathlib import Path

import numpy as np
from diagnose import bank_of, digest, stored
from judge import BEFORE, DT, FORCE, compared, in_band, judge
from scipy import signal
from survey import HERE, members, motions, read_survey, reference_project, with_speeds

from pyblast.diagnosis.library.sides import with_joint

SEED = 5903
TRUE_ACCURACY = 0.01  # of the meshes of truths; those of the members have 0.02
SPREAD = 0.015  # of the speeds of a truth that is about something else
GAIN, FACTOR, CLOCK, SMOOTH, SCATTER, NOISE = 0.15, 0.15, 1.5e-6, 0.15, 0.12, 0.0002
SIDES = {
    "under rock: roller": 2, "under rock: fixed": 1, "under rock: free": 2,
    "under rock: joint 0.25": 1, "under rock: joint 1.7": 2, "bottom: viscous": 1,
    "south and north: viscous": 2, "under rock: viscous": 1,
}  # fmt: skip
SPEEDS = (0.975, 1.0), (1.02, 1.0), (0.98, 1.0), (1.0, 0.985)
LOSSES = ("reference", 60.0), ("reference", 100.0), ("under rock: roller", 80.0)
SENSORS = ("gain", 2), ("polarity", 2), ("swap", 2), ("place", 2)
NULLS = ("reference", 4), ("first 20 us", 2), ("longer bar", 2)
MOVED = 25e-3  # m


def drawn() -> list[dict]:
    """Return the trials, drawn by `SEED`."""
    rng, rows = np.random.default_rng(SEED), []

    def add(kind, truth, factor=1.0, ratio=1.0, **more):
        number = len(rows)
        rows.append({"trial": number, "kind": kind, "truth": truth, "factor": round(factor, 4),
                     "ratio": ratio, "seed": int(rng.integers(1 << 31)), **more})  # fmt: skip

    for truth, count in SIDES.items():
        for _ in range(count):
            add("side", truth, 1.0 + rng.uniform(-SPREAD, SPREAD))
    for factor, ratio in SPEEDS:
        add("speeds", "reference", factor, ratio)
    for truth, quality in LOSSES:
        add("loss", truth, 1.0 + rng.uniform(-0.005, 0.005), quality=quality)
    for what, count in SENSORS:
        for _ in range(count):
            add("sensor", "reference", what=what, sensor=int(rng.integers(2, 30)))
    for what, count in NULLS:
        for _ in range(count):
            truth = "under rock: roller" if what == "first 20 us" else "reference"
            add("null", truth, what=what)
    return rows


def expected(row: dict, survey) -> list[str]:
    """Return what is right to name: both sensors that are swapped."""
    if row["kind"] == "null":
        return []
    if row["kind"] == "sensor":
        name = sorted(dict.fromkeys(survey.sensors))[row["sensor"]]
        spoilt = sorted([name, partner(name, survey)]) if row["what"] == "swap" else [name]
        return [f"{each} {row['what']}" for each in spoilt]
    if row["kind"] == "loss":
        return ["loss"]
    return ["speeds"] if row["kind"] == "speeds" else [row["truth"].rstrip("0123456789. ")]


def truth_project(row: dict):
    """Return the project of a truth, on a finer mesh."""
    reference = reference_project()
    truth = row["truth"]
    if "joint" in truth:
        project = with_joint(reference, "under rock", float(truth.rpartition(" ")[2]), 2.0)
    else:
        project = members(reference)[truth][1]
    mesh = project.config.mesh
    update = {"accuracy": TRUE_ACCURACY}
    if row.get("what") == "longer bar":
        size, origin = list(mesh.size_m), list(mesh.origin_m)
        size[0], origin[0] = 1.4 * size[0], origin[0] - 0.2 * size[0]
        update |= {"size_m": size, "origin_m": origin}
    project = project.changed(mesh=mesh.model_copy(update=update))
    return project if row["ratio"] == 1.0 else with_speeds(project, row["ratio"])


def simulated(row: dict, survey, bank, folder) -> np.ndarray:
    """Return simulated records of a truth: what is not known of sensors and drops is drawn.

    A truth that is a member has its run, at speeds that no member has; others a finer mesh.
    """
    name = f"truth {row['truth']} {row['ratio']:g} {row.get('what') == 'longer bar'}"
    moved = row.get("what") == "place"
    place = None
    if moved:
        names = list(dict.fromkeys(survey.sensors))
        own = np.array(survey.sensors) == sorted(names)[row["sensor"]]
        place = survey.positions + np.where(own[:, None], [MOVED, 0.0, 0.0], 0.0)
        name += f" moved {row['sensor']}"
    if row["truth"] in bank.classes and name.endswith(" 1 False"):
        three = bank.responses(row["truth"], 1.0)
    else:
        three = stored(folder, name, lambda: motions(survey, truth_project(row), None, place=place))
    velocity = three[0].faster(row["factor"]).driven(FORCE)
    padded = np.pad(velocity, ((0, 0), (round(BEFORE / DT), 0)))
    if "quality" in row:
        times = np.maximum(DT * np.arange(padded.shape[1]) - BEFORE, 0.0)
        padded = in_band(padded, DT, (50e3, 100e3)) * np.exp(-np.pi * 71e3 * times / row["quality"])
    return with_nuisances(padded, survey, np.random.default_rng(row["seed"]))


def with_nuisances(motion, survey, rng) -> np.ndarray:
    """Return records of a motion: gains, responses, clocks, scattered energy and noise drawn."""
    size = 2 * motion.shape[1]
    frequency = np.fft.rfftfreq(size, DT)
    octave = np.clip(np.log2(np.maximum(frequency, 1.0) / 50e3), -0.5, 1.5)
    response = {}
    for name in dict.fromkeys(survey.sensors):
        smooth = sum(rng.normal(size=2) @ [1.0, 1j] * np.cos(np.pi * k * octave) for k in range(3))
        response[name] = np.exp(GAIN * rng.normal()) * (1.0 + SMOOTH / np.sqrt(3.0) * smooth)
    drops = {name: (np.exp(FACTOR * rng.normal()), CLOCK * rng.normal())
             for name in dict.fromkeys(survey.drops)}  # fmt: skip
    result = np.zeros_like(motion)
    for k, (drop, sensor) in enumerate(zip(survey.drops, survey.sensors, strict=True)):
        factor, late = drops[drop]
        turns = factor * response[sensor] * np.exp(-2j * np.pi * frequency * late)
        each = np.fft.irfft(np.fft.rfft(motion[k], size) * turns, size)[: motion.shape[1]]
        banded = in_band(each[None], DT, (50e3, 100e3))[0]
        envelope = np.abs(signal.hilbert(banded))
        noise = in_band(rng.normal(size=(2, len(each))), DT, (50e3, 100e3))
        noise /= noise.std(axis=1, keepdims=True)
        scattered = np.sqrt(SCATTER) * envelope * noise[0]
        result[k] = each + scattered + NOISE * envelope.max() * noise[1]
    return result


def spoiled(row: dict, records, survey):
    """Return records (n, n_samples) with a sensor spoiled, and the names of those spoiled."""
    names = sorted(dict.fromkeys(survey.sensors))
    name = names[row["sensor"]]
    own = np.array(survey.sensors) == name
    if row["what"] == "gain":
        return np.where(own[:, None], 0.5, 1.0) * records
    if row["what"] == "polarity":
        return np.where(own[:, None], -1.0, 1.0) * records
    if row["what"] == "place":
        return records
    index = {pair: k for k, pair in enumerate(zip(survey.drops, survey.sensors, strict=True))}
    other = partner(name, survey)
    changed = records.copy()
    for drop in dict.fromkeys(survey.drops):
        if (drop, name) in index and (drop, other) in index:
            a, b = index[drop, name], index[drop, other]
            changed[[a, b]] = records[[b, a]]
    return changed


def partner(name, survey) -> str:
    """Return the sensor that recorded most of the drops that one recorded, the first of several."""
    pairs = dict.fromkeys(zip(survey.drops, survey.sensors, strict=True))
    others = [sensor for drop, sensor in pairs if (drop, name) in pairs and sensor != name]
    return max(dict.fromkeys(others), key=others.count)


def tried(row: dict, survey, bank, folder) -> dict:
    """Judge one trial and return its row."""
    begin = time.process_time()
    samples = simulated(row, survey, bank, folder)
    if row["kind"] == "sensor":
        samples = spoiled(row, samples, survey)
    records = compared(survey, samples)
    if row.get("what") == "first 20 us":
        records.ends[:] = records.arrivals + 16e-6
    answer = judge(records, bank, ratios=(1.0,))
    right_names, named = expected(row, survey), answer["named"]
    right = named == [] if not right_names else set(right_names) <= set(named)
    gain = answer.get("gain_held_out", {})
    return {
        **row, "concealed": row["kind"] != "null", "outcome": answer["outcome"], "named": named,
        "rivals": answer["rivals"], "expected": right_names, "right": bool(right),
        "gain_held_out": gain.get("behind"),
        "leads": [[c["name"], c["log_likelihood"]] for c in answer.get("classes", [])[:4]],
        "loss": answer.get("loss"),
        "processor_s": round(time.process_time() - begin, 1), "program": digest(),
    }  # fmt: skip


def main(arguments):
    """Judge what is not yet in ``trials.json``."""
    folder = Path(arguments[0]) if arguments else HERE / "results"
    path = HERE / "trials.json"
    rows = json.loads(path.read_text())["rows"] if path.exists() else []
    done = {row["trial"] for row in rows}
    survey = read_survey()
    bank = bank_of(survey, folder)
    for row in drawn():
        if row["trial"] in done:
            continue
        rows.append(tried(row, survey, bank, folder))
        last = rows[-1]
        print(last["trial"], last["kind"], last["truth"], last.get("what", ""), last["outcome"],
              last["named"], last["rivals"], last["right"], flush=True)  # fmt: skip
        rows.sort(key=lambda each: each["trial"])
        lines = ",\n".join(json.dumps(each) for each in rows)
        path.write_text(f'{{"seed": {SEED}, "rows": [\n{lines}\n]}}\n')
    concealed = [row["right"] for row in rows if row["concealed"]]
    nulls = [not row["named"] for row in rows if not row["concealed"]]
    print(
        f"right {sum(concealed)} of {len(concealed)}; no name on {sum(nulls)} of {len(nulls)} nulls"
    )


if __name__ == "__main__":
    main(sys.argv[1:])
