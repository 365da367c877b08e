"""Cases of the proof by name: what is true of each, sealed by a digest, and how it is answered.

Eight kinds: sites of an independent program with real geometry (``site``) and with flat layers
(``flat``), sites that SPECFEM3D records (``specfem``), drawn sites with real noise (``drawn``;
``fresh`` by a later seed, ``trial`` by one for development), the mine of the paper (``mine``), real
hits on a line of geophones (``real``), simulated drops of a ball on a bar of rock (``drop``).
"""

import fcntl
import hashlib
import importlib
import json
import os
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from benchmarks.blind.drawing import drawn
from benchmarks.blind.plan import (
    DEVELOPMENT_SEED,
    FRESH_CASES,
    FRESH_SEED,
    PROOF_CASES,
    PROOF_SEED,
    Draw,
    plan,
)
from benchmarks.specfem.plan import plan as specfem_plan
from benchmarks.specfem.plan import store_of
from benchmarks.specfem.worlds import drawn as drawn_for_specfem
from examples.gol_e_gohar import diagnose as mine
from pyblast.errors import InputError

from .drawn import answered as answered_drawn
from .drawn import named_parts, names_of
from .scores import NULLS

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"
TRIAL_CASES = 40
DIGITS = 9  # of a number in a truth: further ones differ from machine to machine
# Kinds and whether their truths were known to the authors when they were registered.
KNOWN = {
    "site": True, "flat": True, "specfem": False, "drawn": False, "fresh": False, "mine": True,
    "real": False, "drop": True, "trial": True,
}  # fmt: skip
DRAWN = {
    "drawn": (PROOF_CASES, PROOF_SEED), "fresh": (FRESH_CASES, FRESH_SEED),
    "trial": (TRIAL_CASES, DEVELOPMENT_SEED),
}  # fmt: skip
FOLDERS = "site", "flat", "specfem"
COMPACT = "void", "body"  # effects with a middle, from which a place can be off


def folder_of(kind: str) -> Path:
    """Return the folder of the cases of an independent program."""
    if kind == "specfem":
        return store_of()
    if kind == "site":
        return Path(os.environ.get("PYBLAST_SITES", SHARED / "sites"))
    return Path(os.environ.get("PYBLAST_CASES", SHARED / "cases"))


def digest_of(truth: Any) -> str:
    """Return the SHA-256 of a truth: bytes as they are, else as JSON of rounded numbers."""
    if not isinstance(truth, bytes):
        truth = json.dumps(_rounded(truth), sort_keys=True).encode()
    return hashlib.sha256(truth).hexdigest()


def truths() -> Iterator[tuple[str, Any]]:
    """Yield the name and the truth of each case that can be registered here.

    Sites of the independent program are left out where their folder is not there.
    """
    for kind in ("site", "flat"):
        for file in sorted((folder_of(kind) / "truth").glob("case-*/truth.toml")):
            yield f"{kind}-{file.parent.name.removeprefix('case-')}", file.read_bytes()
    for draw in specfem_plan():
        yield draw.name.replace("case", "specfem"), drawn_for_specfem(draw).truth
    for kind in ("drawn", "fresh"):
        for draw in plan(*DRAWN[kind]):
            yield draw.name.replace("case", kind), drawn(draw).truth
    for number, (trial, (effect, physics, _, _, change)) in enumerate(mine.TRIALS.items()):
        rules = mine.SPEEDS, mine.STIFFNESSES, mine.NOISE, mine.SCATTER, mine.TURN
        yield f"mine-{number}", [trial, effect, physics, change, rules]
    for trial in example("real", "hammer_line").drawn():
        yield f"real-{trial['trial']:02d}", trial
    for row in example("ball_drops", "trials").drawn():
        yield f"drop-{row['trial']:02d}", row


def truth_of(name: str) -> Any:
    """Return the truth of a case.

    Raises
    ------
    InputError
        If there is no such case here.
    """
    kind, _, number = name.partition("-")
    if kind in DRAWN:
        return drawn(_draw(name)).truth
    if kind in ("site", "flat"):
        file = folder_of(kind) / "truth" / f"case-{number}" / "truth.toml"
        if file.is_file():
            return file.read_bytes()
    if kind == "specfem":
        for draw in specfem_plan():
            if draw.name == f"case-{number}":
                return drawn_for_specfem(draw).truth
    found = dict(truths()) if kind in ("mine", "real", "drop") else {}
    if name not in found:
        raise InputError(f"proof: {name} is not here; see verification/proof/registered.json")
    return found[name]


def answered(name: str, store: Path) -> dict:
    """Answer a case and set the answer beside its truth.

    Returns
    -------
    dict
        As of `drawn.row_of`, with ``energy`` that the effects change, ``length`` (d') and
        ``processor_s``; a crash is an answer, too, with outcome ``CRASH``.
    """
    kind, _, number = name.partition("-")
    if kind in DRAWN:
        return answered_drawn(_draw(name), store)
    if kind in FOLDERS:
        return _answered_folder(kind, f"case-{number}", store)
    if kind == "mine":
        return _answered_mine(int(number))
    return (_answered_real if kind == "real" else _answered_drop)(int(number), store)


def as_crash(name: str, error: Exception) -> dict:
    """Return the row of a case whose diagnosis raised an error."""
    truth, kind = truth_of(name), name.partition("-")[0]
    if kind in ("site", "flat"):
        row = _row_of_folder(truth)
    elif kind == "specfem":
        labels = [] if truth["block"] in NULLS else [truth["effect"]]
        row = {"block": truth["block"], "truth": labels}
    elif kind in DRAWN:
        row = {"block": truth["block"], "truth": [part["label"] for part in truth["effects"]]}
    else:
        label = _label(kind, truth)
        row = {"block": "single" if label else "null", "truth": [label] if label else []}
    return row | {"outcome": "CRASH", "named": [], "class": [], "error": repr(error)}


def _label(kind, truth):
    """Return what is true of the mine, of real hits or of drops; None of a null."""
    if kind == "mine":
        return truth[1]
    if kind == "real":
        return truth["label"]
    return None if truth["kind"] == "null" else truth["truth"]


def _draw(name) -> Draw:
    """Return the draw of a case."""
    kind, _, number = name.partition("-")
    count, seed = DRAWN[kind]
    if not number.isdigit() or int(number) >= count:
        raise InputError(f"proof: {name} is no case; {kind}-000 to {kind}-{count - 1:03d} are")
    return plan(count, seed)[int(number)]


def _rounded(value):
    """Return a truth whose numbers have no more than `DIGITS` digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _row_of_folder(content):
    """Return what a truth file of the independent program says."""
    truth = tomllib.loads(content.decode())
    labels = [label for label in truth["effects"] if label != "null"]
    outside = "outside" if truth.get("out_of_library") else None
    block = outside or ("null", "single", "two")[min(len(labels), 2)]
    block = "hard null" if truth.get("hard_null") else block
    return {"block": block, "truth": labels, "energy": truth["effect_energy_mean_affected"]}


def _answered_folder(kind, name, store):
    """Answer a site of the independent program."""
    from verification.foreign import judged  # which asks for a machine of its own kind

    truth = _truth_file(kind, name)
    row = judged(folder_of(kind), name, store, None, {})
    answer = json.loads((store / name / "diagnosis.json").read_text(encoding="utf-8"))
    misfits = row["further_blast_misfit"]
    words, named = {"before": "calibrated", "after": "diagnosed"}, names_of(answer)
    return _row_of_folder(truth) | {
        "outcome": row["outcome"], "named": named,
        "class": row["class"], "length": None, "metres": _metres(truth, answer),
        "covered": [each["low"] <= each["true"] <= each["high"]
                    for each in row["intervals"].values()] if named else [],
        "held_out": {key: round(1.0 - misfits[word], 5) for key, word in words.items()
                     if misfits[word] is not None},
        "processor_s": round(row["processor_s"] + row["kept_s"], 1),
    }  # fmt: skip


def _truth_file(kind, name):
    """Return the truth file of a case, checked to be of the draw that was registered."""
    file = folder_of(kind) / "truth" / name / "truth.toml"
    if not file.is_file():
        raise InputError(f"proof: {file} is not there; python -m benchmarks.specfem makes it")
    content = file.read_bytes()
    if kind == "specfem":
        sealed = digest_of(truth_of(name.replace("case", kind)))
        if tomllib.loads(content.decode())["drawn"] != sealed:
            raise InputError(f"proof: {file} is of another draw; remove it and make it anew")
    return content


def _metres(content, answer):
    """Return how far a compact body was located from its middle on the map, or None."""
    truth = tomllib.loads(content.decode())
    if not set(truth["effects"]) & set(COMPACT):
        return None
    void = truth["parameters"].get("void", {})
    at = truth.get("in_project_coordinates", {}).get(
        "void_centre_m", [void.get("x"), void.get("y")]
    )
    points = (answer["located"] or {}).get("points", [])
    if at[0] is None or not points:
        return None
    return round(float(np.hypot(points[0]["x"] - at[0], points[0]["y"] - at[1])), 1)


def _answered_mine(number):
    """Answer a trial of the mine."""
    trial = list(mine.TRIALS)[number]
    label, began = mine.TRIALS[trial][0], time.process_time()
    answer, shares = mine.diagnosed(trial, number + 1)
    spent = time.process_time() - began
    return {
        "block": "single" if label else "null", "truth": [label] if label else [],
        "outcome": answer["outcome"], "named": names_of(answer),
        "class": answer["class"], "metres": None, "covered": [], "energy": None, "length": None,
        "held_out": shares, "processor_s": round(spent + answer["kept_s"], 1),
    }  # fmt: skip


def example(folder: str, name: str) -> ModuleType:
    """Return a module of an example, whose own modules import each other by their bare names."""
    path = str(ROOT / "examples" / folder)
    if path not in sys.path:
        sys.path.insert(0, path)
    return importlib.import_module(name)


def _answered_real(number, store):
    """Answer a trial of the hammer line."""
    line = example("real", "hammer_line")
    trial = line.drawn()[number]
    began = time.process_time()
    answer, targets = line.answered(trial, store)
    spent = time.process_time() - began
    held = answer["held_out_blasts"]
    shares = held["receivers"][targets[0]] if targets else [
        held["explained_before"], held["explained_after"]
    ]  # fmt: skip
    return {
        "block": "single" if trial["label"] else "null",
        "truth": [trial["label"]] if trial["label"] else [],
        "outcome": answer["outcome"], "named": named_at(answer, targets),
        "class": answer["class"], "metres": None, "covered": [], "energy": None, "length": None,
        "held_out": dict(zip(("before", "after"), np.round(shares, 5).tolist(), strict=True)),
        "processor_s": round(spent + answer["kept_s"], 1),
    }  # fmt: skip


def named_at(answer: dict, targets: list[str]) -> list[str]:
    """Return the labels that an answer names; one at another receiver than it is says so.

    Parameters
    ----------
    answer : dict
        As in ``diagnosis.json``.
    targets : list of str
        Receivers in which the effect is; empty where any place is right.
    """
    named = []
    for part in named_parts(answer):
        there = part["target"] if isinstance(part["target"], str) else " ".join(part["target"])
        right = all(target in there for target in targets)
        named.append(part["label"] + ("" if right else f" at {there}"))
    return named


def _answered_drop(number, store):
    """Answer a trial of the drops; their stored runs are shared, so one at a time."""
    trials = example("ball_drops", "trials")
    store.mkdir(parents=True, exist_ok=True)
    with (store / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        survey = trials.read_survey()
        row = trials.tried(trials.drawn()[number], survey, trials.bank_of(survey, store), store)
    return {
        "block": "single" if row["concealed"] else "null", "truth": row["expected"],
        "outcome": row["outcome"], "named": row["named"], "class": row["rivals"], "metres": None,
        "covered": [], "energy": None, "length": None, "held_out": {},
        "processor_s": row["processor_s"],
    }  # fmt: skip
