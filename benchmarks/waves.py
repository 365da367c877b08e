"""What a correct wave costs in the program itself, beside SPECFEM3D.

The free box, its reference and SPECFEM3D come from the folder named by PYBLAST_PEERS (default
``../shared/peers/specfem3d``, its programs in the folder ``build`` there or PYBLAST_SPECFEM). What
is not there is not measured. Times are processor seconds of the time loop on one thread, medians of
rounds taken in turn.
"""

import importlib.util
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks import timing
from benchmarks.accuracy import (
    FAST,
    IMPEDANCE,
    JOINTS,
    PLACES,
    ROCK,
    SPAN,
    START,
    STIFFNESS,
    misfit,
)
from benchmarks.box_solution import Ricker, past_joints
from pyblast.mesh.builder import Layer, build_mesh, structured_box
from pyblast.model.boundary import Roller
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

TITLE = "A correct wave"
ROOT = Path(__file__).resolve().parents[1]
PEER = Path(os.environ.get("PYBLAST_PEERS", ROOT.parent / "shared" / "peers" / "specfem3d"))
BUILT = Path(os.environ.get("PYBLAST_SPECFEM", PEER / "build_here"))
ROUNDS = 5
DURATION = 0.61
PULSE = Ricker(8.0, 0.15)
# order, zones along the axes, share of the critical step: errors of 3 and of 1 % on the free box
GRIDS = {3: (6, (4, 4, 2), 0.97), 1: (6, (4, 5, 3), 0.85)}
# edge in m of quadratic tetrahedra that gmsh makes, share of the critical step: likewise
FREE_MESHES = {3: (25.5, 0.97), 1: (16.5, 0.97)}
PEER_RUNS = {3: (50.0, 1.8), 1: (40.0, 1.25)}  # element in m, step in ms


def measure(effort):
    """Return rows of the free box and of the jointed column, and their key figures."""
    rounds = 1 if effort == "quick" else ROUNDS
    timing.threads(1)
    found = {"box": box_rows(rounds), "joints": joint_rows(rounds)}
    return {**found, "figures": figures(found)}


def figures(found):
    """Return the key figures: processor seconds at an error, by name."""
    named = {
        "grid 3 single": "box_seconds_at_3_percent",
        "grid 3 double": "box_double_seconds_at_3_percent",
        "grid 1 single": "box_seconds_at_1_percent",
        "grid 1 double": "box_double_seconds_at_1_percent",
        "tetrahedra 3 single": "free_mesh_single_seconds_at_3_percent",
        "tetrahedra 3 double": "free_mesh_seconds_at_3_percent",
        "tetrahedra 1 single": "free_mesh_single_seconds_at_1_percent",
        "tetrahedra 1 double": "free_mesh_seconds_at_1_percent",
        "SPECFEM3D 3": "specfem_seconds_at_3_percent",
        "SPECFEM3D 1": "specfem_seconds_at_1_percent",
    }
    values = {named[row["run"]]: row["seconds"] for row in found["box"] if row["run"] in named}
    values["joints_seconds_at_3_percent"] = found["joints"][0]["seconds"]
    return values


def peer():
    """Return the module that runs the box with SPECFEM3D, or None."""
    path = PEER / "box.py"
    if not path.is_file():
        return None
    spec = importlib.util.spec_from_file_location("specfem_box", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def box_model(box, mesh, single, factor, quadratic=False):
    """Return the model of the free box."""
    times = np.arange(0.0, 0.7, 1e-4)
    return Model(
        mesh,
        {"rock": ROCK},
        sources=[PointForce(box.SOURCE, box.FORCE, TimeFunction(PULSE(times), 1e-4))],
        receivers=[Receiver(f"R{k}", place) for k, place in enumerate(box.RECEIVERS)],
        single=single,
        step_factor=factor,
        quadratic=quadratic,
    )


def box_rows(rounds):
    """Return error and processor seconds of the free box, all taken in turn."""
    box = peer()
    if box is None:
        return []
    size = np.array(box.SIZE)
    models = {}
    for target, (order, shape, factor) in GRIDS.items():
        mesh = structured_box(shape, size, order=order)
        for single in (True, False):
            name = f"grid {target} {'single' if single else 'double'}"
            models[name] = box_model(box, mesh, single, factor)
    for target, (edge, factor) in FREE_MESHES.items():
        mesh = build_mesh(np.column_stack([0.0 * size, size]), [Layer("rock")], edge=edge)
        for single in (True, False):
            name = f"tetrahedra {target} {'single' if single else 'double'}"
            models[name] = box_model(box, mesh, single, factor, quadratic=True)
    prepared = {name: prepare(model, DURATION) for name, model in models.items()}
    seconds, errors = {name: [] for name in models}, {}
    reference = np.loadtxt(PEER / "box_reference.csv", delimiter=",")
    for turn in range(rounds):
        for name, model in models.items():
            began = time.process_time()
            run = simulate(model, DURATION, prepared=prepared[name])
            seconds[name].append(time.process_time() - began)
            errors[name] = _box_error(box, run, reference)
        for target, setting in PEER_RUNS.items() if (BUILT / "bin").is_dir() else ():
            name = f"SPECFEM3D {target}"
            took, errors[name] = _peer_run(*setting)
            seconds.setdefault(name, []).append(took)
        sys.stdout.write(f"round {turn + 1} ")
        sys.stdout.flush()
    return [
        {
            "run": name,
            "seconds": float(np.median(took)),
            "error": errors[name],
            "nodes": len(models[name].nodes.points) if name in models else None,
            "steps": prepared[name].n_steps if name in models else None,
        }
        for name, took in seconds.items()
    ]


def _box_error(box, run, reference):
    """Return the error of a run by the measure of the peer."""
    records = list(run.seismograms.values())
    times = records[0].start + records[0].dt * np.arange(len(records[0].velocity))
    return box.error(times, np.stack([r.velocity for r in records], axis=1), reference)


def _peer_run(element, step):
    """Return seconds and error of SPECFEM3D."""
    done = subprocess.run(
        [sys.executable, PEER / "box.py", BUILT, "--element", str(element), "--step-ms", str(step)],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    words = done.stdout.replace(",", "").split()
    return float(words[words.index("loop") + 1]), 0.01 * float(words[words.index("error") + 1])


def joint_rows(rounds):
    """Return error and processor seconds of a pulse across six joints 20 m apart."""
    lines = np.unique(
        np.concatenate([np.linspace(0.0, 400.0, 9), JOINTS, np.linspace(500.0, 900.0, 9)])
    )
    across = np.array([0.0, 40.0])
    mesh = structured_box(lines, across, across, planes={"J": ("x", JOINTS)}, order=4).split(["J"])
    joint = Joint("J", "elastic", {"kn": STIFFNESS, "ks": STIFFNESS})
    model = Model(
        mesh, {"rock": ROCK}, joints=[joint],
        boundaries=[Roller(side) for side in ("south", "north", "bottom", "top")],
        receivers=[Receiver(f"R{k}", (x, 17.0, 23.0)) for k, x in enumerate(PLACES)],
        single=True, step_factor=0.9,
    )  # fmt: skip
    prepared = prepare(model, SPAN)
    dt = prepared.constants["dt"]
    passed = (model.nodes.points[:, 0] - START) / ROCK.cp
    state = {name: value.copy() for name, value in prepared.state.items()}
    state["displacement"][:, 0] = FAST(-passed, -1)
    state["velocity"][:, 0] = FAST(-0.5 * dt - passed)
    state["memory"][:, :, 0] = state["displacement"][:, 0, None]
    prepared = type(prepared)(**{**vars(prepared), "state": state})
    took = []
    for _ in range(rounds):
        began = time.process_time()
        run = simulate(model, SPAN, prepared=prepared)
        took.append(time.process_time() - began)
    clock = np.arange(0.0, SPAN + 1e-3, 2.5e-4)
    exact = CubicSpline(
        clock, past_joints(clock, PLACES, START, JOINTS, ROCK.cp, IMPEDANCE, STIFFNESS, FAST)
    )
    got = np.stack([r.velocity[:, :1] for r in run.seismograms.values()], axis=1)
    wanted = exact((np.arange(len(got)) + 0.5) * dt)[:, :, None]
    return [
        {
            "run": "hexahedra of order 4, single",
            "seconds": float(np.median(took)),
            "error": misfit(got, wanted),
            "nodes": len(model.nodes.points),
            "steps": prepared.n_steps,
        }
    ]


def lines(found):
    """Return the table of this part."""
    told = [
        "Processor seconds of the program's own time loop on one thread, and the error against a",
        "fine run of SPECFEM3D (free box) or the closed form (six joints).",
        "",
        "| problem | run | nodes | steps | s | error % |",
        "|---|---|---|---|---|---|",
    ]
    for problem in ("box", "joints"):
        for row in found[problem]:
            told.append(
                f"| {problem} | {row['run']} | {row['nodes'] or ''} | {row['steps'] or ''} "
                f"| {row['seconds']:.3f} | {100.0 * row['error']:.2f} |"
            )
    return told
