"""Gradients and first-order changes are those of full runs; what is not linear is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.anisotropy import jointed as medium
from pyblast.model.boundary import Fixed, Roller, StressInput, VelocityInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material
from pyblast.model.model import InSitu, Model, Receiver
from pyblast.model.plane_wave import PlaneWave
from pyblast.model.source import Hole, TimeFunction
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import linear_runs
from pyblast.solver.linear_runs import track
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.sensitivity import gradient, tangents, with_speeds
from verification.columns import ROCK, misfit, ricker

TIMES = np.arange(0.0, 0.06, 5e-4)
SOIL = Material.from_speeds(2200.0, 2500.0, 1200.0)
STIFFNESS = {"kn": 2e9, "ks": 1e9}
STRONG = {**STIFFNESS, "cohesion": 5e6, "friction": 0.6, "tension": 5e6}
WEAK = {**STIFFNESS, "cohesion": 0.0, "friction": 0.2, "tension": 0.0}
FILL = {**STIFFNESS, "eta_n": 2e6, "eta_s": 1e6}
SIDES = ("west", "east", "south", "north", "bottom")
DURATION = 0.07
STEP = 1e-4


def shaking(amplitude=0.05):
    return Seismogram(amplitude * ricker(TIMES, 50.0)[:, None] * [0.8, 0.5, -0.3], TIMES[1])


def crooked():
    mesh = structured_box((6, 4, 4), (30.0, 20.0, 20.0), planes={"J": ("x", 15.0)})
    moves = np.random.default_rng(2).uniform(-1.0, 1.0, size=mesh.points.shape)
    edges = (mesh.points == 0.0) | (mesh.points == mesh.points.max(axis=0))
    moves[edges | (mesh.points == 15.0)] = 0.0
    points = mesh.points + moves
    group = (points[mesh.zones].mean(axis=1)[:, 2] > 10.0).astype(int)
    return Mesh(points, mesh.zones, group, ("rock", "soil"), mesh.surfaces).split(["J"])


def jointed(law="elastic", properties=STIFFNESS, **parts):
    rate = TimeFunction(1e8 * ricker(TIMES, 50.0), TIMES[1])
    known = {
        "materials": {"rock": ROCK, "soil": SOIL},
        "boundaries": [*map(Viscous, SIDES), StressInput("west", shaking())],
        "damping": Damping(0.02, 50.0),
        "sources": [Hole(np.array([8.0, 11.0, 6.0]), 20.0, 0.004, rate)],
        "receivers": [Receiver("A", (8.0, 11.0, 17.0)), Receiver("B", (24.0, 6.0, 15.0), 0.6)],
        "added_mass": 0.0,  # which would follow the stiffness
    }
    return Model(crooked(), joints=[Joint("J", law, properties)], **{**known, **parts})


MODELS = {
    "elastic": jointed(),
    "constant Q, Kelvin fill": jointed(
        "kelvin", FILL, damping=None,
        materials={"rock": replace(ROCK, law=ConstantQ(30.0, 20.0, (5.0, 100.0))), "soil": SOIL},
    ),
    "low-passed damping": jointed(damping=Damping(0.05, 50.0, corner=200.0)),
    "stuck by friction, stressed": jointed(
        "coulomb", STRONG, insitu=InSitu(), boundaries=[Viscous("west"), Fixed("bottom")]
    ),
    "moved face": jointed(
        boundaries=[VelocityInput("west", shaking()), Viscous("east"), Roller("bottom")]
    ),
}  # fmt: skip
CHANGES = {
    "kn": lambda model, factor: model.with_joint("J", kn=factor * STIFFNESS["kn"]),
    "ks": lambda model, factor: model.with_joint("J", ks=factor * STIFFNESS["ks"]),
    "rock cp": lambda model, factor: with_speeds(model, "rock", cp=factor),
    "rock cs": lambda model, factor: with_speeds(model, "rock", cs=factor),
    "soil cs": lambda model, factor: with_speeds(model, "soil", cs=factor),
}


def together(seismograms):
    return np.concatenate([one.velocity for one in seismograms.values()], axis=1)


def motion(model, dt):
    own = prepare(model, DURATION).constants["dt"]
    alike = replace(model, step_factor=model.step_factor * dt / own)
    return together(simulate(alike, DURATION).seismograms)


def slope(model, change, dt):
    """Return the derivative of seismograms with respect to a relative change, by two runs."""
    more, less = (motion(CHANGES[change](model, 1.0 + sign * STEP), dt) for sign in (1.0, -1.0))
    return (more - less) / (2.0 * STEP)


def weights(n_steps):
    """Return what stands for the derivative of a misfit, by receiver."""
    values = np.random.default_rng(7).normal(size=(n_steps, 6))
    return values, {"A": values[:, :3], "B": values[:, 3:]}


def relative(found, change):
    """Return the derivative with respect to a relative change of stiffness or speed."""
    if change in STIFFNESS:
        return found.joint("J")[change] * STIFFNESS[change]
    group, name = change.split()
    return found.ground(group)[name] * getattr(found.model.materials[group], name)


def tracked(model, **about):
    known = track(model, DURATION, **about)
    return known, *weights(known.prepared.n_steps)


@pytest.mark.parametrize("name", MODELS)
def test_the_gradient_is_that_of_full_runs(name):
    model = MODELS[name]
    known, values, derivative = tracked(model)

    found = gradient(known, derivative)

    for change in CHANGES:
        wanted = np.sum(slope(model, change, known.prepared.constants["dt"]) * values)
        assert relative(found, change) == pytest.approx(wanted, rel=2e-5), change


@pytest.mark.parametrize("name", MODELS)
def test_the_first_order_change_is_that_of_full_runs(name):
    model, names = MODELS[name], ("kn", "soil cs")
    dt = prepare(model, DURATION).constants["dt"]
    steps = [CHANGES[n](model, 1.0 + s * STEP) for n in names for s in (1.0, -1.0)]

    base, found = tangents(model, steps, DURATION)

    assert together(base) == pytest.approx(motion(model, dt), rel=1e-9, abs=1e-12)
    for number, change in enumerate(names):
        more, less = (together(one) for one in found[2 * number : 2 * number + 2])
        assert misfit((more - less) / (2.0 * STEP), slope(model, change, dt)) < 1e-6


@pytest.mark.parametrize("change", CHANGES)
def test_adjoint_and_tangent_are_transposes(change):
    model = MODELS["elastic"]
    known, values, derivative = tracked(model)
    changed = CHANGES[change](model, 1.3)

    _, (born,) = tangents(model, [changed], DURATION)

    product = np.sum(together(born) * values)
    assert gradient(known, derivative).along(changed) == pytest.approx(product, rel=1e-5)


def test_eight_samples_a_period_are_enough():
    known, values, _ = tracked(jointed(damping=Damping(0.02, 50.0, stiffness=False)), highest=200.0)
    values = np.stack([np.convolve(v, np.hanning(15), "same") for v in values.T], axis=1)
    derivative = {"A": values[:, :3], "B": values[:, 3:]}
    every, _, _ = tracked(known.model)

    coarse, fine = (gradient(one, derivative) for one in (known, every))

    assert len(every.steps) >= 2 * len(known.steps)
    for change in CHANGES:
        assert relative(coarse, change) == pytest.approx(relative(fine, change), rel=5e-3)


def test_joints_alone_give_the_same_stiffness_gradient():
    known, _, derivative = tracked(MODELS["elastic"])
    alone = track(MODELS["elastic"], DURATION, ground=False)

    whole, part = gradient(known, derivative), gradient(alone, derivative)

    assert part.kn == pytest.approx(whole.kn, rel=1e-12)
    assert len(alone.nodes) < len(known.nodes) / 2
    with pytest.raises(InputError, match="joints only"):
        part.ground("rock")


@pytest.mark.parametrize("name", ["constant Q, Kelvin fill", "low-passed damping"])
def test_stretches_of_the_march_change_nothing(name, monkeypatch):
    model, changed = MODELS[name], CHANGES["soil cs"](MODELS[name], 1.1)
    known, _, derivative = tracked(model)
    wanted = gradient(known, derivative), together(tangents(model, [changed], DURATION)[1][0])

    monkeypatch.setattr(linear_runs, "STRETCH_VALUES", 100_000)
    known = track(model, DURATION, highest=None)
    found = gradient(known, derivative), together(tangents(model, [changed], DURATION)[1][0])

    assert len(linear_runs.stretches(known.prepared.n_steps, 3 * len(known.nodes))) > 1
    assert found[0].along(changed) == pytest.approx(wanted[0].along(changed), rel=1e-6)
    assert misfit(found[1], wanted[1]) < 1e-9


def test_the_map_shows_where_a_joint_is_softer_than_believed():
    mesh = structured_box((20, 40, 1), (100.0, 200.0, 5.0), planes={"J": ("x", 50.0)})
    surfaces = dict(mesh.surfaces)
    faces = surfaces.pop("J")
    north = mesh.points[faces].mean(axis=1)[:, 1]
    soft = (north > 110.0) & (north < 150.0)
    surfaces |= {"firm": faces[~soft], "soft": faces[soft]}
    slab = Mesh(mesh.points, mesh.zones, mesh.zone_group, mesh.groups, surfaces)
    pulse = np.zeros((61, 3))
    pulse[:, 0] = 0.1 * ricker(5e-4 * np.arange(61), 100.0)
    ends = [Viscous("west"), Viscous("east"), StressInput("west", Seismogram(pulse, 5e-4))]
    model = Model(
        slab.split(["firm", "soft"]), {"rock": ROCK},
        joints=[Joint(name, "elastic", {"kn": 6e9, "ks": 3e9}) for name in ("firm", "soft")],
        boundaries=[*ends, *map(Roller, ("south", "north", "bottom", "top"))],
        receivers=[Receiver(f"{y}", (80.0, y, 2.5)) for y in range(5, 200, 10)],
    )  # fmt: skip
    known = track(model, 0.06, ground=False)
    truth = model.with_joint("soft", kn=3e9, ks=1.5e9)
    recorded = tangents(model, [truth], 0.06)[1][0]

    found = gradient(known, {name: -one.velocity for name, one in recorded.items()})

    contacts = model.mesh.contacts
    place = model.mesh.points[contacts.minus, 1]
    image = found.kn / contacts.area
    middle = np.average(place, weights=np.maximum(0.0, image - 0.5 * image.max()))
    assert 110.0 <= place[image.argmax()] <= 150.0
    assert middle == pytest.approx(130.0, abs=5.0)


REFUSED = {
    "joints.J.law: gradients need": jointed("closure", {**STIFFNESS, "closure": 1e-3}),
    "materials.soil: gradients need": jointed(
        materials={"rock": ROCK, "soil": medium(SOIL, (0.0, 0.0, 1.0), 1.0, 1e10, 5e9)}
    ),
    "local_damping: gradients need": jointed(local_damping=0.5),
    r"joints.J: \d+ of \d+ contacts slip": jointed(
        "coulomb", WEAK, boundaries=[*map(Viscous, SIDES), StressInput("west", shaking(2.0))]
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_not_linear_is_refused(message):
    with pytest.raises(InputError, match=message):
        track(REFUSED[message], DURATION)
    with pytest.raises(InputError, match=message):
        tangents(REFUSED[message], [REFUSED[message]], DURATION)


def denser(model):
    material = replace(SOIL, density=2300.0)
    return replace(model, materials={**model.materials, "soil": material})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (denser, "materials.soil: a gradient knows"),
        (lambda m: replace(m, damping=Damping(0.03, 50.0)), "damping: a gradient knows"),
        (lambda _: jointed("kelvin", FILL), "mesh: a gradient knows"),
        (lambda m: replace(m, joints=[Joint("J", "kelvin", FILL)]), "joints.J: a gradient knows"),
    ],
)
def test_changes_of_other_things_than_stiffness_are_refused(change, message):
    model = MODELS["elastic"]

    with pytest.raises(InputError, match=message):
        tangents(model, [change(model)], DURATION)


def test_ground_that_a_plane_wave_follows_may_not_change_but_joints_may():
    wave = PlaneWave("P", TimeFunction(ricker(TIMES, 50.0), TIMES[1]), 0.5, 0.3)
    rock = {"rock": ROCK, "soil": ROCK}
    model = jointed(sources=[wave], boundaries=list(map(Viscous, SIDES)), materials=rock)
    known, values, derivative = tracked(model)

    found = gradient(known, derivative)

    wanted = np.sum(slope(model, "ks", known.prepared.constants["dt"]) * values)
    assert relative(found, "ks") == pytest.approx(wanted, rel=2e-5)
    with pytest.raises(InputError, match="sources: a PlaneWave follows the moduli"):
        found.ground("rock")


@pytest.mark.parametrize(
    ("receiver", "shape", "message"),
    [("C", (10, 3), "derivative.C: no such receiver"), ("A", (10, 3), "derivative.A: must be")],
)
def test_derivatives_that_are_not_of_the_run_are_refused(receiver, shape, message):
    known = track(MODELS["elastic"], 0.01)

    with pytest.raises(InputError, match=message):
        gradient(known, {receiver: np.zeros(shape)})


def test_a_model_without_joints_has_a_gradient_of_its_ground_only():
    mesh = structured_box((2, 2, 2), (10.0, 10.0, 10.0))
    model = Model(mesh, {"rock": ROCK}, receivers=[Receiver("A", (4.0, 5.0, 6.0))])

    with pytest.raises(InputError, match="track: the model has no joints"):
        track(model, 0.01, ground=False)
    with pytest.raises(InputError, match="gradient: no joint 'J'"):
        gradient(track(model, 0.01), {}).joint("J")
    with pytest.raises(InputError, match="gradient: no group 'clay'"):
        gradient(track(model, 0.01), {}).ground("clay")
