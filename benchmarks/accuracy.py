"""What it costs to be accurate: constant-strain zones, the same with tuned mass, quadratic zones.

Two problems with an exact answer: a point force in a box on rollers (Ricker pulse of 8 Hz, S waves
of 125 m and, at 20 Hz, 50 m), and a pulse of the same wavelength across six joints 20 m apart.
"""

import sys
from itertools import islice

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.bare import bare
from benchmarks.box_solution import Ricker, past_joints, roller_box
from pyblast.mesh.builder import Layer, build_mesh
from pyblast.mesh.grid import structured_box
from pyblast.model.material import Material

ROCK = Material.from_speeds(2700.0, 1871.0, 1000.0)
TITLE = "Error against cost"
SHARE = 0.8  # of the longest stable step
SIZE, DURATION = np.array([300.0, 340.0, 150.0]), 0.6
SOURCE, FORCE = np.array([97.3, 118.9, 61.7]), np.array([6e8, -5e8, 6.245e8])
RECEIVERS = np.array([[211.3, 227.1, 83.9], [187.7, 66.3, 31.1], [63.9, 277.7, 112.3]])
PULSE = Ricker(8.0, 0.15)

COLUMN, SPAN = (900.0, 40.0, 40.0), 0.4
JOINTS = 400.0 + 20.0 * np.arange(6)
START, PLACES = 200.0, np.array([340.0, 560.0])
FAST = Ricker(8.0 * ROCK.cp / ROCK.cs, 0.0)
IMPEDANCE = ROCK.density * ROCK.cp
STIFFNESS = IMPEDANCE * 2.0 * np.pi * 8.0 * ROCK.cp / ROCK.cs


def measure(effort):
    """Return rows of the intact box and of the jointed column; finest meshes where it is long."""
    few, rows = effort != "long", 2 if effort == "quick" else None
    studies = {"box": box_study(few), "joints": joint_study(few)}
    return {name: list(islice(study, rows)) for name, study in studies.items()}


def lines(found):
    """Return the tables of this part."""
    told = [
        "Bare time loops on one thread against exact solutions: a point force of 8 Hz in a box on",
        "rollers, a pulse across six joints 20 m apart. γ is the parameter of the tuned mass.",
        "",
        "| problem | mesh | zones | number | step ms | s | error % |",
        "|---|---|---|---|---|---|---|",
    ]
    for problem, rows in found.items():
        for row in rows:
            told.append(
                f"| {problem} | {row['mesh']} | {row['zones']} | {row['n_zones']} "
                f"| {row['longest_step_ms']:.3f} | {row['seconds']:.2f} | "
                f"{100 * row['error']:.2f} |"
            )
    return told


def draw(found, axes):
    """Draw error against time, for both problems, without tuned mass."""
    for axis, (problem, rows) in zip(axes, found.items(), strict=True):
        kinds = dict.fromkeys((row["mesh"], row["zones"]) for row in rows)
        for kind in (one for one in kinds if "gamma" not in one[1] or one[1].endswith(" 0")):
            mine = [row for row in rows if (row["mesh"], row["zones"]) == kind]
            cost, off = [r["seconds"] for r in mine], [100 * r["error"] for r in mine]
            style, label = "s--" if "quadratic" in kind[1] else "o-", ", ".join(kind)
            axis.loglog(cost, off, style, ms=3, lw=0.8, label=label.replace(", gamma 0", ""))
        axis.set(xlabel="s on one thread", ylabel=f"error % ({problem})")
        axis.set_ylim(top=200.0)
        axis.legend(fontsize=6, loc="upper right")


def box_study(few):
    """Yield the error and the cost of each kind of zone on each mesh of the intact box."""
    clock = np.arange(0.0, DURATION + 1e-3, 5e-4)
    wanted = CubicSpline(clock, roller_box(clock, SIZE, ROCK, SOURCE, FORCE, PULSE, RECEIVERS))
    for name, mesh, kinds in box_meshes(few):
        for kind in kinds:
            box = bare(mesh, ROCK, *kind)
            longest = box.longest_step()
            n_steps = round(DURATION / (SHARE * longest))
            dt = DURATION / n_steps
            source = SOURCE, FORCE, PULSE(np.arange(n_steps) * dt)
            got, _, _, seconds = box.march(dt, n_steps, source=source, receivers=RECEIVERS)
            error = misfit(got, wanted((np.arange(n_steps) + 0.5) * dt))
            yield told("box", name, kind, box, longest, n_steps, seconds, error)


def box_meshes(few):
    """Yield names, meshes and the kinds of zones to try: quadratic or not, gamma."""
    linear = [(False, gamma) for gamma in (0.0, -0.35, 0.35)]
    shapes = {
        "kuhn": [(10, 11, 5), (15, 17, 8)],
        "alternating": [(10, 11, 5), (15, 17, 8)],
        "centred": [(6, 7, 3), (8, 9, 4), (10, 11, 5), (12, 13, 6), (15, 17, 8)],
    }
    for pattern, counts in shapes.items():
        for count in counts[: 2 if few else None]:
            yield pattern, structured_box(count, SIZE, pattern=pattern), [(True, 0.0)]
    for count in [(24, 27, 12), (36, 41, 18)][: 1 if few else None]:
        yield "kuhn", structured_box(count, SIZE), linear
    for count in [(24, 27, 12), (36, 41, 18)][: 1 if few else None]:
        yield "centred", structured_box(count, SIZE, pattern="centred"), linear
    for edge, kinds in ((33.0, [(True, 0.0)]), (25.0, [(True, 0.0)]), (9.0, linear)):
        yield (
            "gmsh",
            build_mesh(np.column_stack([0.0 * SIZE, SIZE]), [Layer("rock")], edge=edge),
            kinds,
        )


def joint_study(few):
    """Yield the error and the cost of each kind of zone on each mesh of the jointed column."""
    linear = [(False, gamma) for gamma in (0.0, -0.35, 0.35)]
    clock = np.arange(0.0, SPAN + 1e-3, 2.5e-4)
    exact = past_joints(clock, PLACES, START, JOINTS, ROCK.cp, IMPEDANCE, STIFFNESS, FAST)
    wanted = CubicSpline(clock, exact)
    for pattern, cells, kinds in (
        ("alternating", (1, 2), [(True, 0.0)]),
        ("centred", (1, 2), [(True, 0.0)]),
        ("alternating", (2, 4, 6), linear),
        ("centred", (2, 3, 4), linear),
    ):
        for count in cells[: 2 if few else None]:
            shape = np.array([45, 2, 2]) * count
            mesh = structured_box(shape, COLUMN, planes={"J": ("x", JOINTS)}, pattern=pattern)
            for kind in kinds:
                box = bare(mesh.split(["J"]), ROCK, *kind, (STIFFNESS, STIFFNESS))
                longest = box.longest_step()
                n_steps = round(SPAN / (SHARE * longest))
                dt = SPAN / n_steps
                still = np.zeros_like(box.points)
                moved, going = still.copy(), still.copy()
                passed = (box.points[:, 0] - START) / ROCK.cp
                moved[:, 0], going[:, 0] = FAST(-passed, -1), FAST(-0.5 * dt - passed)
                receivers = np.column_stack([PLACES, [17.0, 23.0], [23.0, 17.0]])
                got, _, _, seconds = box.march(dt, n_steps, (moved, going), receivers=receivers)
                error = misfit(got[:, :, :1], wanted((np.arange(n_steps) + 0.5) * dt)[:, :, None])
                yield told("joints", pattern, kind, box, longest, n_steps, seconds, error)


def misfit(got, wanted):
    """Return the mean over receivers of the norm of the difference over that of the motion."""
    difference = np.sum((got - wanted) ** 2, axis=(0, 2)) / np.sum(wanted**2, axis=(0, 2))
    return float(np.mean(np.sqrt(difference)))


def told(problem, mesh, kind, box, longest, n_steps, seconds, error):
    """Return one row and say it."""
    quadratic, gamma = kind
    row = {
        "mesh": mesh,
        "zones": "quadratic" if quadratic else f"constant strain, gamma {gamma:g}",
        "n_zones": len(box.zone_nodes),
        "n_nodes": len(box.points),
        "longest_step_ms": round(1e3 * longest, 4),
        "n_steps": n_steps,
        "seconds": round(seconds, 4),
        "us_per_zone_step": round(1e6 * seconds / n_steps / len(box.zone_nodes), 4),
        "error": round(error, 5),
    }
    sys.stdout.write(" ".join(map(str, (problem, *row.values()))) + "\n")
    return row
