"""Both doors and several threads: whether a run has the same bits from Python and from pyblast-run.

    python -m verification.bits [ROW ...] [--page] [--again] [--minutes N]

Each row is a ground on one element: all laws of joints and of zones, layers, a gradient, both kinds
of damping, a dipping joint, zones that are integrated implicitly, and project files with thin soil
on a slope, a bench and in a trench, whose hexahedra stand in an absorbing layer. Models
have more nodes than the least that threads share. Each is prepared and run on 1, 2 and 5 threads,
and by the program on as many; every record, energy and array of the final state is compared with
that of Python on one thread, bit by bit. A row says, too, whether the law it is about has done
anything. Writes the rows that ``verification/bits.json`` lacks and the table of
docs/quality/verification.md; ``--page`` writes the table alone.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np

from benchmarks.timing import threads
from pyblast import core
from pyblast.model.source import TimeFunction
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import integrated, simulate

from . import elements, soil
from .contact import properties
from .rows import study
from .zone import MATERIALS

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- bits: from verification/bits.json -->", "<!-- end of bits -->"
PROGRAM = resources.files("pyblast") / "bin" / "pyblast-run"
THREADS = 1, 2, 5
DURATION = 0.03  # s
PULSE = TimeFunction(np.hanning(21), 5e-4)
GRIDS = {"4 nodes": (26, 20, 14), "15 nodes": (8, 6, 6), "hexahedra": (8, 6, 4)}
ORDER = 4
PRESSED = 5e4  # Pa, of joints
YIELDS = "joint that yields"
JOINTED = elements.GROUNDS | {
    YIELDS: elements.jointed("yielding", PRESSED, **properties("yielding")),
}
ZONES = {f"{law} ground": {"materials": {"rock": MATERIALS[law]}}
         for law in core.ZONE_LAWS if law != "elastic"}  # fmt: skip
SLIVERS, SLIVER = "slivers in a joint that slips", 0.9  # of an edge that a node is moved
SOIL = {f"soil of {name}": ground for name, ground in soil.GROUNDS.items() if ground.where}
ROWS = {
    f"{ground}, {element}": (ground, element)
    for element in GRIDS
    for ground in (
        *(name for name in JOINTED if element != "hexahedra" or name != YIELDS),
        *((*ZONES, SLIVERS) if element == "4 nodes" else SOIL if element == "hexahedra" else ()),
    )
}


def model_of(ground, element, folder):
    """Return the model of a ground on an element; files of a project go into a folder."""
    if ground in SOIL:
        return soil.project(folder, SOIL[ground]).model
    slivers = ground == SLIVERS
    parts = JOINTED["Coulomb joint that slips"] if slivers else {**JOINTED, **ZONES}[ground]
    order = ORDER if element == "hexahedra" else 1
    quadratic = element == "15 nodes"
    model = elements.made(GRIDS[element], order, quadratic=quadratic, **parts)
    mesh = model.mesh
    if slivers:
        places = mesh.points.copy()
        near = np.argmin(np.linalg.norm(places - [45.0, 45.0, 30.0], axis=1))
        places[near, 1] += SLIVER * elements.SIZE[1] / GRIDS[element][1] / 2.0
        mesh = replace(mesh, points=places)
    sources = tuple(replace(one, history=PULSE) for one in model.sources)
    return replace(model, mesh=mesh, sources=sources)


def arrays(run):
    """Return all that a run gives, by name: records, energies, final state."""
    return {
        **{f"record {name}": one.velocity for name, one in run.seismograms.items()},
        **{f"energy {name}": values for name, values in run.energy.items()},
        **{f"state {name}": values for name, values in run.state.items()},
    }


def on_threads(count, model, folder):
    """Return a run by Python and one by the program, both on a number of threads."""
    threads(count)
    prepared = prepare(model, DURATION)
    run = simulate(model, DURATION, prepared=prepared)
    given, made = Path(folder) / "model.h5", Path(folder) / "result.h5"
    export(prepared, given)
    environment = os.environ | {"OMP_NUM_THREADS": str(count)}
    subprocess.run([PROGRAM, given, made], env=environment, check=True, capture_output=True)
    return run, integrated(model, prepared, made)


def measured(name):
    """Return the row of a ground on an element: what differs from Python on one thread."""
    runs = {}
    with tempfile.TemporaryDirectory() as folder:
        model = model_of(*ROWS[name], folder)
        for count in THREADS:
            runs[f"Python, {count}"], runs[f"pyblast-run, {count}"] = on_threads(
                count, model, folder
            )
    threads(1)
    first = runs["Python, 1"]
    wanted = arrays(first)
    constants = first.prepared.constants
    return {
        "nodes": len(constants["node_mass"]), "steps": first.prepared.n_steps,
        "shared": len(constants["node_mass"]) >= core.LEAST_SHARED,
        "acts": acts(model, first),
        "differs": {
            door: [name for name, found in arrays(run).items()
                   if not np.array_equal(wanted[name], found)]
            for door, run in runs.items()
        },
    }  # fmt: skip


def acts(model, run):
    """Return whether the motion is there, and all laws with a memory have come to remember."""
    joints = any(core.JOINT_LAWS[joint.law].state for joint in model.joints)
    zones = any(core.ZONE_LAWS[model.law(group).name].state for group in model.mesh.groups)
    kept = {"contact_state": joints, "row_state": zones}
    remembers = all(run.state[name].any() for name, remembered in kept.items() if remembered)
    return bool(remembers and all(one.pvs > 0.0 for one in run.seismograms.values()))


def table(rows):
    """Return the lines of the table, a ground a line, its elements beside one another."""
    same = sum(not any(row["differs"].values()) for row in rows.values())
    lines = [
        f"{same} of {len(rows)} give the same bits from Python and from `pyblast-run` on 1, 2 and "
        "5 threads.",
        "", f"| ground | {' | '.join(GRIDS)} |", "|---|---|---|---|",
    ]  # fmt: skip
    for ground in dict.fromkeys(ground for ground, _ in ROWS.values()):
        own = [_cell(rows.get(f"{ground}, {element}")) for element in GRIDS]
        lines.append(f"| {ground} | {' | '.join(own)} |")
    return lines


def _cell(row):
    """Return yes or no, and how far it reaches."""
    if row is None:
        return "–"
    lacks = [] if row["shared"] else ["too few nodes to share"]
    lacks += [] if row["acts"] else ["law idle"]
    lacks += [f"{door}: {', '.join(names)}" for door, names in row["differs"].items() if names]
    same = not any(row["differs"].values())
    return "; ".join([f"{'yes' if same else '**no**'}, {row['nodes']} nodes", *lacks])


def main(arguments):
    """Measure rows and write them and the table."""
    study(arguments, ROWS, measured, table, OUT, PAGE, (BEGIN, END))


if __name__ == "__main__":
    main(sys.argv[1:])
