"""Peers beside pyblast: rate of a step on one thread, and error against the exact motion."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.accuracy import DURATION, FORCE, PULSE, RECEIVERS, ROCK, SIZE, SOURCE, misfit
from benchmarks.box_solution import roller_box
from benchmarks.marching import March
from benchmarks.timing import median, on
from pyblast.mesh.builder import Layer, build_mesh
from pyblast.mesh.nodes import nodes_of, renumbered
from pyblast.mesh.tetrahedra import volumes
from pyblast.model.boundary import Roller
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.assembly import time_step
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

TITLE = "Peers"
HERE = Path(__file__).parent
LONGEST = 900.0  # s for each, installation included
EDGE = 7.8  # m: 0.2 million zones
SIDES = ("west", "east", "south", "north", "bottom", "top")
BUSY = 1.5  # load beyond which other work runs beside
SHORT = {"OpenSeesPy": 8}  # how many times fewer steps the slowest march: its rate alone is told
PEERS = {
    "Akantu": ("akantu", ["akantu"]),
    "Kratos": ("kratos", ["KratosMultiphysics", "KratosStructuralMechanicsApplication"]),
    "OpenSeesPy": ("opensees", ["openseespy", "mkl"]),
    "NGSolve": ("ngsolve", ["ngsolve"]),
    "MFEM": ("mfem", ["mfem"]),
}
WANTED = ("libblas.so.3", "liblapack.so.3")  # that OpenSeesPy expects from the system


def measure(effort):
    """Return rate and error of pyblast, and those of each peer or why there are none."""
    mesh = renumbered(box(20.0 if effort == "quick" else EDGE))
    problem = posed(mesh)
    exact = expected(mesh, problem)
    own = Own(mesh, problem)
    found = {
        "zones": len(mesh.zones), "steps": len(problem["samples"]), "dt_ms": 1e3 * problem["dt"],
        "pyblast": {"error": misfit(own.velocity(), exact)}, "peers": {},
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        np.savez(Path(folder) / "problem.npz", **problem)
        for name, (script, packages) in PEERS.items():
            steps = own.n_steps // SHORT.get(name, 1)
            found["peers"][name] = one = tried(Path(folder), script, packages, own, steps)
            if "velocity" in one:
                moved = one.pop("velocity")
                one["error"] = misfit(moved, exact) if len(moved) == own.n_steps else None
            print(name, one, flush=True)
    return found


def box(edge):
    """Return the box, with nodes where the force acts and motion is read."""
    return build_mesh(np.column_stack([0.0 * SIZE, SIZE]), [Layer("rock")], edge=edge)


def posed(mesh):
    """Return what peers are given: arrays in SI, nodes from 0."""
    nearest = [int(np.argmin(np.sum((mesh.points - p) ** 2, axis=1))) for p in [SOURCE, *RECEIVERS]]
    fixed = np.stack(
        [(mesh.points[:, k] < 1e-6) | (mesh.points[:, k] > SIZE[k] - 1e-6) for k in range(3)],
        axis=1,
    )
    model = Model(mesh, {"rock": ROCK})
    dt, _ = time_step(model)
    n_steps = round(DURATION / dt)
    dt = DURATION / n_steps
    mass = nodes_of(mesh, False).sums(ROCK.density * volumes(mesh.points, mesh.zones))
    return {
        "points": mesh.points, "zones": mesh.zones, "density": ROCK.density, "young": ROCK.young,
        "poisson": ROCK.poisson, "fixed": fixed, "mass": mass, "dt": dt,
        "samples": PULSE(np.arange(n_steps) * dt), "force": FORCE, "source": nearest[0],
        "receivers": np.array(nearest[1:]),
    }  # fmt: skip


def expected(mesh, problem):
    """Return the exact velocity at half steps, (n_steps, n_receivers, 3)."""
    clock = np.arange(0.0, DURATION + 1e-3, 5e-4)
    places = mesh.points[problem["receivers"]]
    source = mesh.points[problem["source"]]
    motion = roller_box(clock, SIZE, ROCK, source, FORCE, PULSE, places)
    half = (np.arange(len(problem["samples"])) + 0.5) * problem["dt"]
    return CubicSpline(clock, motion)(half)


class Own:
    """The same problem marched by pyblast, the full step with all its accounts."""

    def __init__(self, mesh, problem):
        self.dt, self.n_steps = problem["dt"], len(problem["samples"])
        places = mesh.points[problem["receivers"]]
        pulse = TimeFunction(problem["samples"], self.dt)
        source = mesh.points[problem["source"]]
        self.model = Model(
            mesh, {"rock": ROCK}, boundaries=[Roller(side) for side in SIDES],
            sources=[PointForce(source, FORCE, pulse)],
            receivers=[Receiver(f"R{k}", tuple(place)) for k, place in enumerate(places)],
        )  # fmt: skip
        _, limit = time_step(self.model)
        span = (1.0 - 1e-9) * self.n_steps * self.dt
        self.prepared = prepare(self.model, span, step=(self.dt, limit))
        self.span = span

    def velocity(self):
        """Return velocities at half steps, (n_steps, n_receivers, 3)."""
        found = simulate(self.model, self.span, prepared=self.prepared).seismograms
        return np.stack([one.velocity for one in found.values()], axis=1)

    def seconds(self):
        """Return the time of a step on one thread, s of the processor, median of five marches."""
        march, took = on(1, March(self.prepared, self.n_steps)), []
        for _ in range(5):
            began = time.process_time()
            march()
            took.append(time.process_time() - began)
        return median(took) / self.n_steps


def tried(folder, script, packages, own, n_steps):
    """Return what some steps of a peer gave between two marches of ours, or why it gave nothing."""
    answer, place = folder / f"{script}.npz", folder / script
    began, load = time.perf_counter(), os.getloadavg()[0]
    try:
        libraries = installed(place, packages)
        left = LONGEST - (time.perf_counter() - began)
        before = own.seconds()
        peer = [place / "bin" / "python", HERE / f"{script}_peer.py"]
        command = [*peer, folder / "problem.npz", str(n_steps), answer]
        alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "LD_LIBRARY_PATH": libraries}
        subprocess.run(command, check=True, timeout=left, capture_output=True, text=True,
                       cwd=folder, env=os.environ | alone)  # fmt: skip
        ours = 0.5 * (before + own.seconds())
    except subprocess.TimeoutExpired:
        return {"failed": f"took longer than {LONGEST:g} s"}
    except subprocess.CalledProcessError as error:
        words = (error.stderr or error.stdout or "no word").strip().splitlines()
        return {"failed": words[-1][:200] if words else f"exit code {error.returncode}"}
    with np.load(answer) as file:
        step = float(file["seconds"]) / n_steps
        velocity = file["velocity"]
    rate = len(own.model.mesh.zones) / step / 1e6
    return {"version": version(place, packages[0]), "million_zone_steps_per_s": rate,
            "ours_over_theirs": step / ours, "beside_other_work": load > BUSY,
            "velocity": velocity}  # fmt: skip


def installed(place, packages):
    """Make an environment with the packages of a peer; return where its libraries are."""
    subprocess.run([sys.executable, "-m", "venv", place], check=True, capture_output=True)
    command = [place / "bin" / "python", "-m", "pip", "install", "--quiet", *packages, "numpy"]
    subprocess.run(command, check=True, timeout=LONGEST, capture_output=True, text=True)
    libraries = place / "lib"
    for made in libraries.glob("libmkl_rt.so.*"):
        for name in WANTED:
            (libraries / name).symlink_to(made)
    return str(libraries)


def version(place, package):
    """Return the version that was installed."""
    words = f"from importlib.metadata import version; print(version({package!r}))"
    command = [place / "bin" / "python", "-c", words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _measured(found, busy):
    """Name the peers that were measured beside other work, or without."""
    each = found["peers"].items()
    return ", ".join(n for n, one in each if one.get("beside_other_work") is busy) or "none"


def lines(found):
    """Return the table of this part."""
    told = [
        f"{found['zones']} zones of constant strain, point force in a box on rollers, "
        f"{found['steps']} steps, one thread, processor seconds. Errors are against the exact "
        "motion (the mesh is the same, and so is the error); our step includes its energy "
        "balance and is timed before and after each peer. NGSolve and MFEM multiply by an "
        "assembled matrix."
        + "".join(f" {name} takes {steps} times fewer steps." for name, steps in SHORT.items()),
        "",
        f"On a quiet machine: {_measured(found, False)}. Alongside other work, which shares "
        f"caches and memory and so may favour either side: {_measured(found, True)}.",
        "",
        "| program | million zones a second | ours over theirs | error % |",
        "|---|---|---|---|",
        f"| pyblast | | 1 | {100 * found['pyblast']['error']:.2f} |",
    ]
    for name, one in found["peers"].items():
        if "failed" in one:
            told.append(f"| {name} | failed: {one['failed']} | | |")
        else:
            error = "–" if one["error"] is None else f"{100 * one['error']:.2f}"
            told.append(
                f"| {name} {one['version']} | {one['million_zone_steps_per_s']:.2f} "
                f"| {one['ours_over_theirs']:.1f} | {error} |"
            )
    return told
