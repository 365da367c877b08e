"""Model files damaged at random, and project files by grammar: refused in one sentence, or whole.

    python -m verification.fuzz [COUNT] [--seed N] [--again] [--minutes N]

Half of the files have bytes changed, cut or overwritten, half have values, lengths or kinds of
their arrays changed. The program may run a file whose damage leaves a model (exit code 0, or 1 if
its energy grows): one whose numbers are finite, with no negative mass, area or modulus, and whose
result is finite. All others it must refuse with exit code 2 and one sentence, never by a signal.
Of project files a quarter as many are drawn by `verification.grammar`. Writes the rows that
``verification/fuzz.json`` lacks, one for each fifty files with the counts of outcomes; COUNT 2000,
seed 2026, 25 minutes unless given otherwise. Files that broke the program are kept in
``build/fuzz``.
"""

import os
import resource
import shutil
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from functools import cache
from importlib import resources
from pathlib import Path

import h5py
import numpy as np

from pyblast import core
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.hexahedra import AbsorbingLayer
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import export, prepare
from verification import grammar
from verification.columns import ROCK
from verification.contact import properties
from verification.rows import draws, each_row
from verification.zone import MATERIALS

OUT = Path(__file__).with_suffix(".json")
SEED, COUNT, MINUTES = 2026, 2000, 25.0
PIECE = 50  # files in a row
FOLDER = Path(__file__).resolve().parents[1] / "build" / "fuzz"
PROGRAM = resources.files("pyblast") / "bin" / "pyblast-run"
PULSE = TimeFunction(1e7 * np.hanning(21), 1e-3)
SECONDS = 20  # that a run may take
MEMORY = 4 << 30  # bytes that it may take
SIDES = ("west", "east", "south", "north", "bottom")
OUTCOMES = {0: "run", 1: "stopped", 2: "refused"}  # by exit code
COUNTED = {"files", "fault", *OUTCOMES.values(), *grammar.OUTCOMES.values()}
# What no model has, beside numbers that are not finite; only strengths of joints may be endless.
NEVER_NEGATIVE = "node_mass", "contact_area", "layer_mass", "zone_shear", "patch_bulk", "set_beta"
ENDLESS = "joint_property"
WRONG = (0, -1, 1, 2, 7, 10**6, -(2**31), 2**31 - 1, np.nan, np.inf, -np.inf, 1e308, -1.0, 1e-308)


def bent():
    """Return a small box of hexahedra that are no bricks, damped."""
    mesh = structured_box((2, 2, 1), (40.0, 40.0, 20.0), order=3)
    places = mesh.node_places.copy()
    places[..., 2] += 0.05 * places[..., 2] * np.sin(places[..., 0] / 20.0)
    return Model(
        replace(mesh, places=places), {"rock": ROCK}, damping=Damping(0.02, 10.0),
        boundaries=[*map(Viscous, SIDES[:3])],
        sources=[PointForce((5.0, 10.0, 5.0), (1.0, 0.5, -0.3), PULSE)],
        receivers=[Receiver("A", (15.0, 5.0, 5.0))],
    )  # fmt: skip


def layered():
    """Return a small box of bricks with an absorbing layer and a joint, attenuating."""
    lines = [20.0 * np.arange(-1, 3), 20.0 * np.arange(-1, 3), 20.0 * np.arange(-2, 1)]
    mesh = structured_box(*lines, order=2, planes={"J": ("x", 20.0)})
    inner = ((0.0, 20.0), (0.0, 20.0), (-20.0, np.inf))
    return Model(
        replace(mesh, layer=AbsorbingLayer(inner, ((20.0, 20.0),) * 3)).split(["J"]),
        {"rock": replace(ROCK, law=ConstantQ(40.0, 20.0))},
        joints=[Joint("J", "elastic", {"kn": 2e9, "ks": 1e9})],
        boundaries=[*map(Viscous, SIDES)],
        sources=[PointForce((5.0, 10.0, -5.0), (1.0, 0.5, -0.3), PULSE)],
        receivers=[Receiver("A", (15.0, 5.0, -5.0))],
    )


def tetrahedra():
    """Return a small box of tetrahedra of all laws, with a joint of each law."""
    names, laws = list(MATERIALS), list(core.JOINT_LAWS)
    layers = [*(Layer(name, 4.0) for name in names[:-1]), Layer(names[-1])]
    planes = {law: ("x", 8.0 * (n + 1)) for n, law in enumerate(laws)}
    edges = np.arange(0.0, 8.0 * len(laws) + 9.0, 4.0)
    grid = edges, [0.0, 4.0], np.arange(-4.0 * len(names), 1.0, 4.0)
    push = Seismogram(np.outer(np.hanning(21), [0.2, 0.1, 0.05]), 1e-3)
    return Model(
        structured_box(*grid, layers=layers, planes=planes).split(laws),
        MATERIALS,
        joints=[Joint(law, law, properties(law), 3e5) for law in laws],
        boundaries=[Viscous("west"), Fixed("east"), StressInput("west", push)],
        receivers=[Receiver("A", (edges[-1] - 2.0, 2.0, -2.0))],
    )


def flip(raw, rng):
    """Return bytes with a few of them changed."""
    raw = bytearray(raw)
    for at in rng.integers(len(raw), size=rng.integers(1, 9)):
        raw[at] = int(rng.integers(256))
    return bytes(raw)


def cut(raw, rng):
    """Return the beginning of the bytes."""
    return raw[: rng.integers(len(raw))]


def overwrite(raw, rng):
    """Return bytes with a stretch of them taken from elsewhere, or set to one value."""
    raw, size = bytearray(raw), int(rng.integers(1, 257))
    to, start = rng.integers(len(raw) - size, size=2)
    raw[to : to + size] = raw[start : start + size] if rng.random() < 0.5 else bytes(size)
    return bytes(raw)


def change_values(file, name, rng):
    """Set some values of an array to what does not belong there."""
    held = file[name][()]
    values = np.atleast_1d(held).copy()
    if values.size == 0:
        return
    for at in rng.integers(values.size, size=rng.integers(1, 4)):
        wrong = WRONG[rng.integers(len(WRONG))]
        if values.dtype.kind == "f":
            values.flat[at] = wrong
        elif np.isfinite(wrong):
            values.flat[at] = int(np.clip(wrong, -(2**31), 2**31 - 1))
    file[name][...] = values.reshape(held.shape) if np.ndim(held) else values[0]


def change_shape(file, name, rng):
    """Lengthen, shorten, empty or turn an array."""
    held = file[name][()]
    del file[name]
    kind = rng.integers(4)
    if kind == 0 or not np.ndim(held):
        file[name] = np.zeros(0, dtype=held.dtype)
    elif kind == 1:
        file[name] = held[:-1]
    elif kind == 2:
        file[name] = np.concatenate([held, held[:1]])
    else:
        file[name] = held.T if held.ndim > 1 else held[:, None]


def change_kind(file, name, rng):
    """Give an array another kind of numbers, or take it away."""
    held = file[name][()]
    del file[name]
    kind = rng.integers(3)
    if kind == 0:
        file[name] = np.asarray(held).astype("f8" if np.asarray(held).dtype.kind == "i" else "i4")
    elif kind == 1:
        file[name] = "soon"


def damaged(whole, path, rng):
    """Write a damaged copy of a model file; return what was done to it."""
    if rng.random() < 0.5:
        way = (flip, cut, overwrite)[rng.integers(3)]
        path.write_bytes(way(whole.read_bytes(), rng))
        return way.__name__
    shutil.copy(whole, path)
    way = (change_values, change_values, change_shape, change_kind)[rng.integers(4)]
    with h5py.File(path, "r+") as file:
        names = [f"{group}/{name}" for group in file for name in file[group]]
        name = names[rng.integers(len(names))]
        with np.errstate(all="ignore"):
            way(file, name, rng)
    return f"{way.__name__} of {name}"


def limited():
    """Limit the memory of the program, but not of one that checks addresses: it maps all of it."""
    if "ASAN_OPTIONS" not in os.environ:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def fault_of(path):
    """Return what is wrong with how the program takes a file, or nothing; and its exit code."""
    result = path.with_suffix(".result")
    command = [str(PROGRAM), str(path), str(result)]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=SECONDS,
            preexec_fn=limited, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"takes longer than {SECONDS} s", None
    lines = done.stderr.strip().splitlines()
    if done.returncode not in OUTCOMES:
        return f"ends with {done.returncode}: {' / '.join(lines)[:200]}", done.returncode
    if done.returncode and (len(lines) != 1 or not lines[0].startswith("pyblast-run: ")):
        return f"says {len(lines)} lines: {' / '.join(lines)[:200]}", done.returncode
    return ("" if done.returncode else nonsense(path, result)), done.returncode


def nonsense(path, result):
    """Return what should have kept a file from being run, or what its result lacks."""
    for file in (path, result):
        with h5py.File(file) as held:
            for place in (f"{group}/{name}" for group in held for name in held[group]):
                values, name = held[place][()], place.split("/")[1]
                if np.isnan(values).any() or (np.isinf(values).any() and name != ENDLESS):
                    return f"{place} of the {file.suffix[1:]} is not finite"
                if name in NEVER_NEGATIVE and np.min(values) < 0.0:
                    return f"{place} of the {file.suffix[1:]} is negative"
    return ""


@cache
def wholes(folder):
    """Write the whole model files, which the program must run."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{make.__name__}.h5" for make in (layered, tetrahedra, bent)]
    for make, path in zip((layered, tetrahedra, bent), paths, strict=True):
        export(prepare(make(), 0.02), path)
        fault, code = fault_of(path)
        if fault or code:
            raise SystemExit(f"fuzz: {path.name} whole: {fault or code}")
    return paths


def model(number, seed, folder):
    """Damage a model file and run it; return its outcome, and the fault if there is one."""
    path, rng = folder / "damaged.model", np.random.default_rng([seed, number])
    done = damaged(wholes(folder)[number % 3], path, rng)
    fault, code = fault_of(path)
    if not fault:
        return OUTCOMES[code], ""
    shutil.copy(path, folder / f"fault-{seed}-{number}.h5")
    return "fault", f"{number} ({done}) {fault}"


KINDS = {"project file": (grammar.fuzz, 4), "model file": (model, 1)}  # and 1 in how many


def fuzz(kind, first, count, seed, folder):
    """Try files of a kind; return a row: how often each outcome came, and the faults."""
    outcomes, faults = Counter(), []
    for number in range(first, first + count):
        outcome, fault = KINDS[kind][0](number, seed, folder)
        outcomes[outcome] += 1
        if fault:
            faults.append(fault)
            print(f"fuzz: {fault}", flush=True)
    return {"seed": seed, "files": count, **dict(sorted(outcomes.items())), "faults": faults}


def main(arguments):
    """Try the files whose rows are missing; return 1 if one of them all broke the program."""
    seed, count, limits = draws(arguments, SEED, COUNT, MINUTES)
    jobs = {
        f"{kind} {first:05}, seed {seed}": (kind, first, min(PIECE, count // share - first))
        for kind, (_, share) in KINDS.items() for first in range(0, count // share, PIECE)
    }  # fmt: skip
    rows = each_row(OUT, jobs, lambda name: fuzz(*jobs[name], seed, FOLDER), **limits)
    for kind in KINDS:
        told = Counter()
        for row in (rows[name] for name in jobs if name in rows and jobs[name][0] == kind):
            told.update({key: n for key, n in row.items() if key in COUNTED})
        print(f"fuzz: {kind}s, seed {seed}: {', '.join(f'{n} {key}' for key, n in told.items())}")
    return 1 if any(row.get("fault") for row in rows.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
