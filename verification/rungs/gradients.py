"""Gradients by one adjoint run and by the tangent, against finite differences. Rung 32."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.perturbation import with_speeds
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.sensitivity import gradient, tangents
from pyblast.solver.tracks import track
from verification.columns import ROCK, ricker
from verification.ladder import Curve, Reading, rung

SIDES = ("west", "east", "south", "north", "bottom")
SIZE = (40.0, 30.0, 30.0)
STRIPS = 6
STIFFNESS = {"kn": 2e9, "ks": 1e9}
SOFT = 2  # the strip that is softer in the ground than in the model
SOIL = Material.from_speeds(2200.0, 2500.0, 1200.0)
DURATION, HIGHEST = 0.12, 150.0
STEP = 1e-4  # relative


def ground():
    """Return a crooked box of two layers with a joint in horizontal strips."""
    mesh = structured_box((8, 6, STRIPS), SIZE, planes={"J": ("x", 20.0)})
    points = mesh.points.copy()
    moves = np.random.default_rng(2).uniform(-1.0, 1.0, size=points.shape)
    moves[(points == 0.0) | (points == SIZE) | (points == 20.0)] = 0.0
    group = points[mesh.zones].mean(axis=1)[:, 2] > 0.5 * SIZE[2]
    surfaces = dict(mesh.surfaces)
    faces = surfaces.pop("J")
    strip = (points[faces].mean(axis=1)[:, 2] * STRIPS / SIZE[2]).astype(int)
    surfaces |= {f"J{i}": faces[strip == i] for i in range(STRIPS)}
    jointed = Mesh(points + moves, mesh.zones, group.astype(int), ("rock", "soil"), surfaces)
    return jointed.split([f"J{i}" for i in range(STRIPS)])


def shaken_ground():
    """Return the model that does not know of the soft strip."""
    times = np.arange(0.0, 0.1, 5e-4)
    shaking = 0.05 * ricker(times, 30.0)[:, None] * [0.8, 0.5, -0.3]
    rate = TimeFunction(1e8 * ricker(times, 30.0), 5e-4)
    places = ((33.0, 8.0, 21.0), (30.0, 20.0, 26.0), (36.0, 14.0, 6.0), (9.0, 20.0, 24.0))
    return Model(
        ground(), {"rock": ROCK, "soil": SOIL},
        joints=[Joint(f"J{i}", "elastic", STIFFNESS) for i in range(STRIPS)],
        boundaries=[*map(Viscous, SIDES), StressInput("west", Seismogram(shaking, 5e-4))],
        damping=Damping(0.02, 30.0), sources=[Hole(np.array([11.0, 17.0, 9.0]), 20.0, 0.004, rate)],
        receivers=[Receiver(f"R{i}", place) for i, place in enumerate(places)],
    )  # fmt: skip


def scaled(model, strips, **factors):
    """Return the model with the stiffness of some strips multiplied."""
    for i in strips:
        values = {name: STIFFNESS[name] * factor for name, factor in factors.items()}
        model = model.with_joint(f"J{i}", **values)
    return model


def motion(model, dt):
    """Run a model at a given time step; return all seismograms, (n_steps, 3 n_receivers)."""
    own = prepare(model, DURATION).constants["dt"]
    result = simulate(replace(model, step_factor=model.step_factor * dt / own), DURATION)
    return np.concatenate([one.velocity for one in result.seismograms.values()], axis=1)


def both_ways(change, dt):
    """Return the seismograms of a model changed by plus and by minus a small step."""
    return [motion(change(1.0 + sign * STEP), dt) for sign in (1.0, -1.0)]


@rung(
    "32",
    "Gradients by adjoint and Born",
    source="central differences of full runs",
    gate="E",
    tolerance={
        **{f"adjoint, {name}": 0.01 for name in ("kn", "ks", "cp", "cs")},
        "adjoint, kn strip by strip": 0.01,
        "8 samples a period, ks": 0.01,
        **{f"Born, {name}": 0.01 for name in ("kn", "ks", "cp", "cs")},
        "<Jx, y> = <x, J'y>": 1e-4,
    },
    quick=True,
    note="Least squares of the waveforms at four receivers, the joint half as stiff in one of six "
    "strips as the model has it. The discrete scheme is its own adjoint: no mesh is involved. "
    "What is left is the step of the differences and that motion is kept in single precision.",
)
def gradients():
    """Compare gradients of a waveform misfit, and changes of seismograms, with full runs."""
    model = shaken_ground()
    known = track(model, DURATION)
    dt = known.prepared.constants["dt"]
    recorded = motion(scaled(model, [SOFT], kn=0.5, ks=0.5), dt)
    residual = motion(model, dt) - recorded
    derivative = {f"R{i}": residual[:, 3 * i : 3 * i + 3] for i in range(len(model.receivers))}
    found = gradient(known, derivative)
    sparse = gradient(track(model, DURATION, ground=False, highest=HIGHEST), derivative)
    changes = {
        "kn": lambda x: scaled(model, range(STRIPS), kn=x),
        "ks": lambda x: scaled(model, range(STRIPS), ks=x),
        "cp": lambda x: with_speeds(model, "soil", cp=x),
        "cs": lambda x: with_speeds(model, "soil", cs=x),
    }
    two = {name: both_ways(change, dt) for name, change in changes.items()}
    born = tangents(model, [c(1.0 + s) for c in changes.values() for s in (STEP, -STEP)], DURATION)
    born = [np.concatenate([s.velocity for s in one.values()], axis=1) for one in born[1]]
    readings, slopes = [], {}
    for i, (name, (more, less)) in enumerate(two.items()):
        there = [found.along(changes[name](1.0 + sign * STEP)) for sign in (1.0, -1.0)]
        wanted = 0.5 * (np.sum((more - recorded) ** 2) - np.sum((less - recorded) ** 2))
        slopes[name] = wanted
        readings += [
            Reading.relative(f"adjoint, {name}", wanted, there[0] - there[1]),
            Reading.norm(f"Born, {name}", more - less, born[2 * i] - born[2 * i + 1]),
        ]
    kept = sparse.along(changes["ks"](1.0 + STEP)) - sparse.along(changes["ks"](1.0 - STEP))
    product = np.sum(born[0] * residual)
    readings += [
        Reading.relative("8 samples a period, ks", slopes["ks"], kept),
        Reading.relative("<Jx, y> = <x, J'y>", product, found.along(changes["kn"](1.0 + STEP))),
    ]
    strips = [both_ways(lambda x, i=i: scaled(model, [i], kn=x), dt) for i in range(STRIPS)]
    wanted = [np.sum((a - recorded) ** 2) - np.sum((b - recorded) ** 2) for a, b in strips]
    wanted = 0.5 * np.array(wanted) / (2.0 * STEP)
    map_ = np.array([found.joint(f"J{i}")["kn"] * STIFFNESS["kn"] for i in range(STRIPS)])
    height = (np.arange(STRIPS) + 0.5) * SIZE[2] / STRIPS
    readings.append(Reading.norm("adjoint, kn strip by strip", wanted, map_))
    curve = Curve("kn of six strips of a joint", height, wanted, map_,
                  "height of the strip [m]", "misfit per relative change of kn")  # fmt: skip
    return readings, [curve]
