"""Damage model files at random and see that pyblast-run refuses them in one sentence.

    python -m verification.fuzz [COUNT] [--seed N]

Half of the files have bytes changed, cut or overwritten, half have values, lengths or kinds of
their arrays changed. The program may run a file whose damage leaves a model (exit code 0, or 1 if
its energy grows); all others it must refuse with exit code 2 and one sentence, never by a signal.
Files that broke it are kept in ``build/fuzz``.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
from dataclasses import replace
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
from verification.columns import ROCK
from verification.contact import properties
from verification.zone import MATERIALS

FOLDER = Path(__file__).resolve().parents[1] / "build" / "fuzz"
PROGRAM = resources.files("pyblast") / "bin" / "pyblast-run"
PULSE = TimeFunction(1e7 * np.hanning(21), 1e-3)
SECONDS = 20  # that a run may take
MEMORY = 4 << 30  # bytes that it may take
SIDES = ("west", "east", "south", "north", "bottom")
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
    command = [str(PROGRAM), str(path), str(path.with_suffix(".result"))]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=SECONDS,
            preexec_fn=limited, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"takes longer than {SECONDS} s", None
    lines = done.stderr.strip().splitlines()
    if done.returncode not in (0, 1, 2):
        return f"ends with {done.returncode}: {' / '.join(lines)[:200]}", done.returncode
    if done.returncode and (len(lines) != 1 or not lines[0].startswith("pyblast-run: ")):
        return f"says {len(lines)} lines: {' / '.join(lines)[:200]}", done.returncode
    return "", done.returncode


def fuzz(count, seed):
    """Damage files and run them; return the faults, and how often each exit code came."""
    rng, codes, faults = np.random.default_rng(seed), {}, []
    FOLDER.mkdir(parents=True, exist_ok=True)
    wholes = []
    for make in (layered, tetrahedra, bent):
        model = make()
        wholes.append(FOLDER / f"{make.__name__}.h5")
        export(prepare(model, 0.02), wholes[-1])
        fault, code = fault_of(wholes[-1])
        if fault or code:
            raise SystemExit(f"fuzz: {wholes[-1].name} whole: {fault or code}")
    for number in range(count):
        path = FOLDER / "damaged.h5"
        done = damaged(wholes[number % 3], path, rng)
        fault, code = fault_of(path)
        codes[code] = codes.get(code, 0) + 1
        if fault:
            kept = FOLDER / f"fault-{seed}-{number}.h5"
            shutil.copy(path, kept)
            faults.append(f"{kept.name} ({done}) {fault}")
            print(f"fuzz: {faults[-1]}", flush=True)
    return faults, codes


def main(arguments):
    """Damage as many files as asked for; return 1 if one broke the program."""
    parser = argparse.ArgumentParser(prog="./dev fuzz", description=__doc__.split("\n")[0])
    parser.add_argument("count", nargs="?", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    faults, codes = fuzz(given.count, given.seed)
    told = ", ".join(f"{n} with exit code {code}" for code, n in sorted(codes.items(), key=str))
    print(f"fuzz: {given.count} files, seed {given.seed}: {told}; {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
