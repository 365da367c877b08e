"""Injected explosions: closed forms, superposition, what nodes show, and where there is none."""

import hashlib
import subprocess
from dataclasses import replace
from functools import partial
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from command_line import python

from pyblast.mesh.grid import Geometry, Layer
from pyblast.mesh.hexahedral import mapped
from pyblast.model.boundary import Roller, Viscous
from pyblast.model.ground_fields import Gradient
from pyblast.model.half_space import explosion as in_half_space
from pyblast.model.material import Damping, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Column, Hole, MomentTensor, PointForce, TimeFunction
from pyblast.solver.injection import _add_by_azimuth, near_receivers, patch_of, tapered
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import integrated, simulate
from verification.solutions.full_space import Bell, explosion, moment, point_force
from verification.solutions.layered_half_space import Bed, strike_slip_motion

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0)
BELL = Bell(12.0)
VALUES, DT = BELL.samples()
RATE = TimeFunction(1e9 * VALUES, DT)
EDGE, DURATION = 60.0, 0.2
SIDES = ("west", "east", "south", "north", "bottom")
ALL = (*SIDES, "top")
ROCKS = (Layer("rock"),)
POINTS = {"5 m": (5.0, 0.0, 0.0), "20 m": (12.0, -16.0, 0.0), "45 m": (-27.0, 36.0, 0.0),
          "100 m": (60.0, 80.0, 0.0), "below": (0.0, 30.0, -40.0)}  # fmt: skip


def box(centre, depth=180.0, sides=SIDES, layers=ROCKS, order=4):
    """Return a box of elements of 60 m with a free top at 0, five wide, about a centre (2,)."""
    low = np.array([*centre, 0.0]) - [150.0, 150.0, depth]
    limits = np.column_stack([low, low + np.array([300.0, 300.0, depth])])
    geometry = Geometry(limits, layers, standing=frozenset(ALL) - set(sides))
    return mapped.build_mapped(geometry, [EDGE] * len(layers), order)


def model_of(sources, centre=(0.0, 0.0), receivers=POINTS, sides=SIDES, **other):
    mesh = box(centre, sides=sides, layers=other.pop("layers", ROCKS), order=other.pop("order", 4))
    parts = {"materials": {"rock": ROCK, "stiff": ROCK}} | other
    return Model(
        mesh, boundaries=[Viscous(side) for side in sides], sources=sources, injected=True,
        receivers=[Receiver(name, at) for name, at in receivers.items()], **parts,
    )  # fmt: skip


def hole(position, time=0.0, charge=1.0):
    return Hole(np.array(position), charge, time, RATE)


def closed_form(times, offset, depth):
    """Return the velocity (n, 3) of a hole at a depth at an offset (3,) with its height."""
    away = float(np.hypot(*offset[:2]))
    motion = in_half_space(RATE, depth, np.array([away]), -np.array(offset[2:]), times, ROCK)
    radial, up = motion[0, 0].T
    return np.column_stack([radial * offset[0] / away, radial * offset[1] / away, up])


def error(motion, wanted):
    return np.linalg.norm(motion - wanted) / np.linalg.norm(wanted)


@pytest.mark.parametrize("centre", [(0.0, 0.0), (30.0, 30.0), (12.0, -25.0)])
def test_a_shallow_explosion_moves_all_near_receivers_as_in_a_half_space(centre):
    model = model_of([hole((0.0, 0.0, -8.0))], centre)

    records = simulate(model, DURATION).seismograms

    assert near_receivers(model) == ()
    assert near_receivers(replace(model, injected=False)) != ()
    for name, at in POINTS.items():
        wanted = closed_form(records[name].times, at, 8.0)
        assert error(records[name].velocity, wanted) < 0.015, name


def test_a_deep_explosion_is_that_of_unbounded_rock():
    sides = (*SIDES, "top")
    points = {"5 m": (3.0, 4.0, -90.0), "50 m": (30.0, 0.0, -130.0)}
    tensor = MomentTensor(np.array([0.0, 0.0, -90.0]), 2.0 * np.eye(3), 0.0, RATE)
    model = model_of([tensor], (30.0, 30.0), points, sides)

    records = simulate(model, DURATION).seismograms

    assert patch_of(model).top is None
    for name, at in points.items():
        wanted = 2e9 * explosion(records[name].times, np.add(at, (0.0, 0.0, 90.0)), BELL, ROCK)
        assert error(records[name].velocity, wanted) < 0.01, name


TENSORS = {
    "column": np.diag([1.0, 1.0, 0.5]),
    "couple": np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0]]),
}


@pytest.mark.parametrize("kind", TENSORS)
@pytest.mark.parametrize("centre", [(30.0, 30.0), (12.0, -25.0)])
def test_a_deep_tensor_is_that_of_unbounded_rock(kind, centre):
    points = {"5 m": (3.0, 4.0, -90.0), "10 m": (0.0, 6.0, -98.0), "50 m": (30.0, 0.0, -130.0)}
    source = MomentTensor(np.array([0.0, 0.0, -90.0]), TENSORS[kind], 0.0, RATE)
    model = model_of([source], centre, points, ALL)

    records = simulate(model, DURATION).seismograms

    assert near_receivers(model) == ()
    for name, at in points.items():
        offset = np.add(at, (0.0, 0.0, 90.0))
        wanted = 1e9 * moment(records[name].times, offset, TENSORS[kind], BELL, ROCK)
        assert error(records[name].velocity, wanted) < 0.02, name


def test_a_deep_force_is_that_of_unbounded_rock():
    points = {"5 m": (3.0, 4.0, -90.0), "50 m": (30.0, 0.0, -130.0)}
    push = np.array([0.6, 0.0, -0.8])
    force = PointForce(np.array([0.0, 0.0, -90.0]), push, RATE)
    model = model_of([force], (30.0, 30.0), points, ALL)

    records = simulate(model, DURATION).seismograms

    for name, at in points.items():
        offset = np.add(at, (0.0, 0.0, 90.0))
        wanted = 1e9 * point_force(records[name].times, offset, push, BELL, ROCK)
        assert error(records[name].velocity, wanted) < 0.02, name


def test_a_deep_column_is_the_sum_of_its_points():
    points = {"5 m": (3.0, 4.0, -90.0), "50 m": (30.0, 0.0, -130.0)}
    column = Column(np.array([0.0, 0.0, -92.0]), np.array([0.0, 0.0, -88.0]), 1.0, 0.0, RATE)
    model = model_of([column], (30.0, 30.0), points, ALL)

    records = simulate(model, DURATION).seismograms

    for name, at in points.items():
        places, delays = column.points(20)
        wanted = sum(
            1e9
            / 20
            * moment(records[name].times - late, at - place, column.tensor(ROCK), BELL, ROCK)
            for place, late in zip(places, delays, strict=True)
        )
        assert error(records[name].velocity, wanted) < 0.02, name


def test_a_shallow_couple_moves_near_receivers_as_an_independent_integral_says():
    couple = MomentTensor(np.array([0.0, 0.0, -8.0]), TENSORS["couple"], 0.0, RATE)
    model = model_of([couple], (12.0, -25.0))

    records = simulate(model, DURATION).seismograms

    assert near_receivers(model) == ()
    for name in ("5 m", "20 m", "45 m"):
        offset, times = POINTS[name][:2], records[name].times
        rate = partial(np.interp, xp=DT * np.arange(len(VALUES)), fp=1e9 * VALUES)
        wanted = strike_slip_motion([Bed.of(np.inf, ROCK)], 8.0, offset, times, rate, 60.0)
        assert error(records[name].velocity, wanted) < 0.01, name


@pytest.mark.long
def test_a_shallow_column_is_the_sum_of_its_points():
    ends = np.array([0.0, 0.0, -14.0]), np.array([0.0, 0.0, -4.0])
    column = Column(*ends, 1.0, 0.0, RATE, sources=8)
    places, delays = column.points(8)
    tensor = column.tensor(ROCK) / 8
    points = [MomentTensor(at, tensor, t, RATE) for at, t in zip(places, delays, strict=True)]
    near = {name: POINTS[name] for name in ("5 m", "20 m")}

    models = [model_of(each, (12.0, -25.0), near) for each in ([column], points)]
    one, several = (simulate(model, DURATION).seismograms for model in models)

    assert near_receivers(models[0]) == ()
    for name in near:
        assert error(one[name].velocity, several[name].velocity) < 0.02, name


@pytest.mark.parametrize(
    "source",
    [PointForce(np.zeros(3), np.array([0.0, 0.0, -1.0]), RATE),
     Column(np.array([0.0, 0.0, -14.0]), np.array([3.0, 0.0, -4.0]), 1.0, 0.0, RATE)],
    ids=["force on the surface", "leaning column"],
)  # fmt: skip
def test_what_is_not_injected_under_a_free_surface_leaves_an_explosion_beside_it(source):
    assert "on a free surface and columns that lean" in patch_of(model_of([source]))
    assert patch_of(model_of([source, hole((0.0, 0.0, -8.0))])).sources == (1,)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_waves_of_a_source_that_is_turned_are_turned_with_it(order):
    rng, angle = np.random.default_rng(order), 0.7
    waves, azimuth = rng.normal(size=(5, 4, 3)), rng.uniform(0.0, 6.0, 5)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    cosine, sine = rng.normal(size=2)
    by = order * angle
    amplitudes = {
        0.0: (cosine, sine),
        angle: (np.cos(by) * cosine - np.sin(by) * sine, np.cos(by) * sine + np.sin(by) * cosine),
    }

    still, turned = (np.zeros((5, 4, 3)) for _ in range(2))
    for total, (late, own) in zip((still, turned), amplitudes.items(), strict=True):
        ray = np.column_stack([np.cos(azimuth + late), np.sin(azimuth + late)])
        _add_by_azimuth(total, 0, waves, ray, order, *own)

    np.testing.assert_allclose(turned[..., :2], still[..., :2] @ turn.T, atol=1e-12)
    np.testing.assert_allclose(turned[..., 2], still[..., 2], atol=1e-12)


def test_holes_superpose_with_delays_between_the_steps():
    parts = [hole((0.0, 0.0, -8.0)), hole((9.0, -4.0, -11.0), 0.0137, 3.0)]
    together, *alone = (
        simulate(model_of(sources), DURATION).seismograms for sources in (parts, *zip(parts))
    )

    for name in POINTS:
        total = sum(each[name].velocity for each in alone)
        assert error(together[name].velocity, total) < 1e-9, name
        wanted = closed_form(together[name].times - 0.0137, np.subtract(POINTS[name], (9, -4, 0)),
                             11.0) * 3.0  # fmt: skip
        assert error(alone[1][name].velocity, wanted) < 0.02, name


def test_nodes_move_as_receivers_at_them():
    model = model_of([hole((0.0, 0.0, -8.0))])
    mesh, nodes = model.mesh, model.nodes
    inside = nodes.points[nodes.zone_nodes[patch_of(model).zones].ravel()]
    away = np.linalg.norm(inside - [0.0, 0.0, -8.0], axis=1)
    points = {"near": inside[np.argsort(away)[5]], "boundary": inside[np.argmax(away)]}
    model = replace(model, receivers=[Receiver(n, tuple(at)) for n, at in points.items()])
    assert mesh is model.mesh

    run = simulate(model, DURATION, snapshot_times=[0.1], peaks_to=40.0)

    ((time, shown),) = run.snapshots.items()
    for name, at in points.items():
        node = np.linalg.norm(nodes.points - at, axis=1).argmin()
        record = run.seismograms[name]
        step = round(time / run.dt) - 1
        peak = np.linalg.norm(record.velocity, axis=1).max()
        assert error(shown[node], record.velocity[step]) < 1e-3, name
        assert run.peak_velocity[node] == pytest.approx(peak, rel=0.02)
        moved = run.dt * record.velocity.sum(axis=0)
        assert error(run.state["displacement"][node], moved) < 2e-3, name


OBSTACLES = {
    "other ground lies": ({"layers": (Layer("rock", 60.0), Layer("stiff"))}, (0.0, 0.0, -8.0)),
    "an element from a source": ({}, (100.0, 0.0, -8.0)),
    "speeds vary": ({"ground": [Gradient(0.2, 100.0)]}, None),
    "takes more than 2 %": ({"damping": Damping(0.05, 12.0)}, None),
    "elements of order 3 carry": ({"order": 3}, None),
}


@pytest.mark.parametrize("said", OBSTACLES)
def test_what_stands_against_an_injection_is_named(said):
    other, at = OBSTACLES[said]
    assert said in patch_of(model_of([hole(at or (0.0, 0.0, -8.0))], **other))


def test_a_supported_top_is_no_free_surface():
    model = model_of([hole((0.0, 0.0, -8.0))])
    held = replace(model, boundaries=(*model.boundaries, Roller("top")))

    assert patch_of(held) == (
        "a side, a joint or ground that is not flat lies less than an element from a source"
    )


def test_a_tapered_rate_keeps_what_elements_carry_and_its_moment():
    times = np.arange(0.0, 0.4, DT)
    carried = tapered(RATE, 40.0)
    short = TimeFunction(np.hanning(9), 1e-4)

    assert np.abs(carried(times) - RATE(times)).max() < 2e-3 * np.abs(RATE.values).max()
    assert tapered(short, 40.0).values.sum() == pytest.approx(short.values.sum(), rel=1e-3)


SCRIPT = """
import json
from test_injection import digest, hole, model_of
print(json.dumps(digest(model_of([hole((0.0, 0.0, -8.0))]))))
"""


def digest(model):
    records = simulate(model, 0.05).seismograms.values()
    return hashlib.sha256(b"".join(each.velocity.tobytes() for each in records)).hexdigest()


@pytest.mark.long
def test_any_number_of_threads_gives_the_same_bits(monkeypatch):
    monkeypatch.chdir(Path(__file__).parent)

    assert python(SCRIPT, threads=3) == digest(model_of([hole((0.0, 0.0, -8.0))]))


def test_the_program_gives_the_same_bits(tmp_path):
    program = resources.files("pyblast") / "bin" / "pyblast-run"
    if not program.is_file():
        pytest.skip("pyblast was built without the program pyblast-run")
    model = model_of([hole((0.0, 0.0, -8.0))])
    prepared = prepare(model, DURATION)
    export(prepared, tmp_path / "model.h5")
    subprocess.run(
        [program, tmp_path / "model.h5", tmp_path / "records.h5"], check=True, timeout=60
    )

    here, there = simulate(model, DURATION), integrated(model, prepared, tmp_path / "records.h5")

    for name, record in here.seismograms.items():
        assert np.array_equal(record.velocity, there.seismograms[name].velocity), name
    for name, value in here.state.items():
        assert np.array_equal(value, there.state[name]), name
