"""Line-implicit layers: closed forms, the rock's step, energy, bits, what flat zones carry."""

import subprocess
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from command_line import python
from slipping_box import digest

from pyblast.mesh.builder import Layer as BoxLayer
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Geometry, Layer
from pyblast.mesh.hexahedral.mapped import build_mapped
from pyblast.mesh.mesh import zone_volumes
from pyblast.model.boundary import Roller, StressInput, Viscous
from pyblast.model.material import ConstantQ, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import MomentTensor, TimeFunction
from pyblast.model.thin_layers import reach_of_trapped_waves
from pyblast.signals.seismogram import Seismogram
from pyblast.solver import assembly
from pyblast.solver.line_implicit import line_zones, node_lines, steps_of_zones
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import integrated, simulate
from pyblast.solver.time_step import largest_eigenvalue
from verification.columns import ricker

SOIL = Material.from_speeds(1800.0, 500.0, 250.0)
ROCK = Material.from_speeds(2600.0, 4300.0, 2500.0)
SIDES = ("west", "east", "south", "north", "bottom")
TIMES = np.arange(0.0, 0.2, 1e-4)


def ground(height, order=3, edge=15.0, soil=SOIL, **parts):
    """Return rock under soil of a height in m, with an explosion and an absorbing layer."""
    box = np.array([[0.0, 60.0], [0.0, 45.0], [-30.0, 0.0]])
    layers = (Layer("soil", height), Layer("rock"))
    geometry = Geometry(box, layers, standing=frozenset(["top"]))
    mesh = build_mapped(geometry, [(edge, height), (edge, edge)], order)
    pulse = TimeFunction(1e12 * ricker(TIMES - 0.01, 40.0), 1e-4)
    known = {
        "boundaries": [Viscous(side) for side in SIDES],
        "sources": [MomentTensor(np.array([22.0, 20.0, -16.0]), np.eye(3), 0.0, pulse)],
        "receivers": [Receiver("R", (45.0, 25.0, -0.5 * height))],
    }
    return Model(mesh, {"soil": soil, "rock": ROCK}, **{**known, **parts})


def chosen(model):
    """Return the line-implicit zones of a model."""
    return line_zones(model, steps_of_zones(model))


def test_the_step_is_that_of_the_rock():
    bare = ground(15.0, soil=ROCK)

    for height in (0.1, 0.5):
        step, limit = assembly.time_step(ground(height))
        assert step > 0.97 * assembly.time_step(bare)[0]
        assert limit.dt > 1.5 * limit.explicit
        assert "line-implicit" in limit.limited_by


def test_thick_layers_stay_explicit():
    assert not chosen(ground(10.0)).any()


@pytest.mark.parametrize("lean", [0.0, 0.3])
def test_stiffness_along_lines_is_that_of_motion_that_varies_along_them_alone(lean):
    mesh = structured_box((2, 2, 4), (20.0, 20.0, 8.0), layers=[BoxLayer("soil")], order=4)
    x = mesh.points[:, :1]
    leaning = replace(mesh, points=mesh.points + lean * x * [0.0, 0.0, 1.0])
    model = Model(leaning, {"soil": replace(SOIL, law=ConstantQ(20.0, 20.0, (5.0, 100.0)))})
    depth = model.spectral.points[:, 2] - lean * model.spectral.points[:, 0]
    motion = np.outer(np.sin(0.7 * depth), [0.3, -0.5, 1.0])
    mass = model.nodes.sums(model.zone_values("density") * zone_volumes(model.mesh))

    lines = node_lines(model, np.ones(len(mesh.zones), dtype=bool))

    force = np.zeros_like(motion)
    own = np.einsum("naibj,nbj->nai", lines.stiffness, motion[lines.nodes])
    np.add.at(force, lines.nodes, own)
    whole = mass[:, None] * assembly.zone_product(model, mass)(motion)
    wanted = np.einsum("na,na->", whole, motion)
    assert np.einsum("na,na->", force, motion) == pytest.approx(wanted, rel=1e-10)
    assert wanted > 0.0


@pytest.mark.long
@pytest.mark.parametrize(("height", "order", "quality"), [(0.1, 3, 20.0), (0.5, 4, None)])
def test_energy_is_balanced_to_rounding_and_dies_away_under_the_absorbing_layer(
    height, order, quality
):
    law = SOIL.law if quality is None else ConstantQ(quality, quality, (5.0, 100.0))
    model = ground(height, order, soil=replace(SOIL, law=law))
    assert chosen(model).any()

    run = simulate(model, 0.5)

    energy = run.energy["kinetic"] + run.energy["strain"]
    late = energy[run.energy["time"] > 0.3]
    assert run.balance_error < 1e-12
    assert late.max() < 1e-3 * energy.max()
    assert late[-1] < 0.5 * late[0]


@pytest.mark.parametrize("height", [0.1, 0.5])
def test_a_layer_on_rock_amplifies_p_waves_as_in_closed_form(height):
    """T = 1/(cos kH + i a sin kH) of the free surface over that of bare rock."""
    box = np.array([[0.0, 20.0], [0.0, 20.0], [-60.0 - height, 0.0]])
    layers = (Layer("soil", height), Layer("rock"))
    geometry = Geometry(box, layers, standing=frozenset(["top", *SIDES]))
    mesh = build_mapped(geometry, [(20.0, height), (20.0, 20.0)], 4)
    pulse = Seismogram(np.outer(ricker(TIMES, 40.0), [0.0, 0.0, 1.0]), TIMES[1])
    rollers = [Roller(side) for side in SIDES[:4]]
    inside = [Viscous("bottom"), StressInput("bottom", pulse)]
    receivers = [Receiver("top", (10.0, 10.0, 0.0))]
    model = Model(
        mesh, {"soil": SOIL, "rock": ROCK}, boundaries=[*rollers, *inside], receivers=receivers
    )
    assert chosen(model).any()

    record = simulate(model, 0.3).seismograms["top"]

    clock = np.arange(0.0, 0.3, 1e-4)
    motion = np.interp(clock, record.times, record.velocity[:, 2])
    spectrum, frequency = np.fft.rfft(motion), np.fft.rfftfreq(len(clock), 1e-4)
    entered = np.fft.rfft(np.interp(clock, TIMES, pulse.velocity[:, 2]))
    kh = 2.0 * np.pi * frequency * height / SOIL.cp
    ratio = SOIL.density * SOIL.cp / (ROCK.density * ROCK.cp)
    exact = 1.0 / np.abs(np.cos(kh) + 1j * ratio * np.sin(kh))
    band = (frequency > 15.0) & (frequency < 70.0)
    gain = np.abs(spectrum / entered)[band]
    assert gain / gain[0] == pytest.approx(exact[band] / exact[band][0], rel=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("height", [0.1, 0.5])
@pytest.mark.parametrize("order", [3, 4, 5])
def test_a_closed_column_keeps_its_energy_over_a_hundred_thousand_steps(height, order):
    box = np.array([[0.0, 20.0], [0.0, 20.0], [-20.0 - height, 0.0]])
    layers = (Layer("soil", height), Layer("rock"))
    geometry = Geometry(box, layers, standing=frozenset(["top", *SIDES]))
    mesh = build_mapped(geometry, [(20.0, height), (20.0, 20.0)], order)
    pulse = TimeFunction(1e12 * ricker(TIMES - 0.01, 40.0), 1e-4)
    source = MomentTensor(np.array([9.0, 11.0, -12.0]), np.diag([1.0, 2.0, 3.0]), 0.0, pulse)
    rollers = [Roller(side) for side in SIDES]
    model = Model(mesh, {"soil": SOIL, "rock": ROCK}, boundaries=rollers, sources=[source])
    assert chosen(model).any()

    run = simulate(model, 1e5 * assembly.time_step(model)[0])

    energy = (run.energy["kinetic"] + run.energy["strain"])[run.energy["time"] > TIMES[-1]]
    assert run.balance_error < 1e-10
    assert np.ptp(energy) < 0.05 * energy.max()  # strain and motion are half a step apart
    assert energy[-1000:].mean() == pytest.approx(energy[:1000].mean(), rel=1e-3)


SCRIPT = """
import json
from pyblast import _core
from pyblast.solver.run import simulate
from slipping_box import digest
from test_line_implicit import ground
_core.pyblast_kinds.least_shared = 1
print(json.dumps(digest(simulate(ground(0.5), 0.05))))
"""


@pytest.mark.long
def test_any_number_of_threads_gives_the_same_bits(monkeypatch):
    monkeypatch.chdir(Path(__file__).parent)

    assert python(SCRIPT, threads=3) == digest(simulate(ground(0.5), 0.05))


def test_the_program_gives_the_same_bits(tmp_path):
    program = resources.files("pyblast") / "bin" / "pyblast-run"
    if not program.is_file():
        pytest.skip("pyblast was built without the program pyblast-run")
    model = ground(0.5)
    prepared = prepare(model, 0.05)
    export(prepared, tmp_path / "model.h5")
    subprocess.run([str(program), tmp_path / "model.h5", tmp_path / "out.h5"], check=True)

    stored, run = integrated(model, prepared, tmp_path / "out.h5"), simulate(model, 0.05)

    assert np.array_equal(stored.seismograms["R"].velocity, run.seismograms["R"].velocity)
    assert all(np.array_equal(stored.energy[name], run.energy[name]) for name in run.energy)


def test_flat_zones_carry_what_their_widths_and_heights_do():
    model = ground(0.5, order=4, edge=30.0)
    wide, high = 2500.0 / (1.25 * 30.0), 250.0 / (1.25 * 0.5)

    assert model.highest_frequency()["soil"] == pytest.approx(min(wide, high), rel=1e-6)


def test_zones_that_trap_waves_carry_half_as_much():
    model = ground(2.5, order=4, edge=15.0)
    whole, crossing = 2500.0 / (1.25 * 15.0), 2.5 / 250.0
    wanted = max(min(whole, 0.25 / crossing), min(0.5 * whole, 1.0 / crossing))

    assert model.highest_frequency()["soil"] == pytest.approx(wanted, rel=1e-6)


@pytest.mark.parametrize(("quality", "beyond"), [(5.0, True), (7.0, False)])
def test_zones_carry_what_those_of_the_rock_do_where_trapped_waves_have_died_away(quality, beyond):
    damped = replace(SOIL, law=ConstantQ(quality, quality, (5.0, 100.0)))
    model = ground(1.0, order=4, edge=15.0, soil=damped)
    whole, crossing = 2500.0 / (1.25 * 15.0), 1.0 / 250.0
    away = np.hypot(45.0 - 22.0, 25.0 - 20.0)

    assert (reach_of_trapped_waves(1.0, [damped]) < away) == beyond
    wanted = whole if beyond else max(0.25 / crossing, 0.5 * whole)
    assert model.highest_frequency()["soil"] == pytest.approx(wanted, rel=1e-6)
    without = replace(model, receivers=())
    assert without.highest_frequency()["soil"] < whole


def test_bounds_of_steps_are_below_those_that_are_searched():
    bare = ground(15.0, soil=ROCK)
    mass = bare.nodes.sums(bare.zone_values("density") * zone_volumes(bare.mesh))
    searched = 2.0 / np.sqrt(largest_eigenvalue(assembly.zone_product(bare, mass), mass))

    assert 0.7 * searched < steps_of_zones(bare)[0].min() <= 1.01 * searched
