"""A moment over a sphere: its far field is that of a point, wherever it lies in its element."""

from dataclasses import replace

import numpy as np
import pytest
from open_box import ROCK, open_box

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer
from pyblast.mesh.mesh import locate_in_zones
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Column, Hole, MomentTensor, PointForce, TimeFunction
from pyblast.project.project import load_project
from pyblast.runs.greens import greens_functions
from pyblast.solver.loads import model_loads
from pyblast.solver.moment_density import (
    ERRORS,
    beside_sources,
    clearance,
    deconvolved,
    edge_at,
    flat_response,
    moment_forces,
    near_sources,
    response,
    source_radius,
    sphere_rule,
)
from verification.solutions.full_space import Bell, explosion

BELL = Bell(15.0)
VALUES, DT = BELL.samples()
RATE = TimeFunction(1e9 * VALUES, DT)
UNBOUNDED = """
title = "Ground without end"
[mesh]
size_m = [200, 200, 200]
frequency_hz = 40
layers = [{ material = "rock" }]
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 4000
cs_m_per_s = 2300
[boundaries]
viscous = ["west", "east", "south", "north", "bottom", "top"]
[[point_forces]]
position_m = [100, 100, 100]
direction = [0, 0, 1]
file = "force.csv"
[[receivers]]
name = "R"
position_m = [122, 125, 119]
[run]
duration_s = 0.2
"""


@pytest.fixture(scope="module")
def unbounded(tmp_path_factory):
    """Ground without end, of elements of 66.7 m."""
    folder = tmp_path_factory.mktemp("unbounded")
    (folder / "project.toml").write_text(UNBOUNDED)
    (folder / "force.csv").write_text("time_s,force_n\n0,0\n0.1,1\n0.2,0\n0.3,0\n")
    return load_project(folder / "project.toml").model


def places(mesh):
    """Positions in the elements around the middle: corner, edge, face, middle and random ones."""
    x, y, z = (np.unique(column.round(6)) for column in mesh.points.T)
    lines = np.array([line[(line > 33.0) & (line < 99.0)][0] for line in (x, y, z)])
    shares = [(0, 0, 0), (0, 0, 0.5), (0, 0.5, 0.5), (0.5, 0.5, 0.5), (0, 0.3, 0), (0.02, 0.4, 0)]
    random = np.random.default_rng(4).uniform(-0.5, 0.5, (6, 3))
    return lines + 66.7 * np.concatenate([shares, random])


def test_an_explosion_radiates_as_a_point_from_any_place_of_its_element(unbounded):
    positions = places(unbounded.mesh)
    holes = [Hole(position, 1.0, 0.02, RATE) for position in positions]

    bank = greens_functions(replace(unbounded, sources=holes), 0.2, side="receiver")

    (receiver,) = unbounded.receivers
    for hole in holes:
        record = bank.blast([hole])["R"]
        offset = np.subtract(receiver.position, hole.position)
        rock = unbounded.materials["rock"]
        wanted = 1e9 * explosion(record.times - 0.02, offset, BELL, rock)
        error = np.linalg.norm(record.velocity - wanted) / np.linalg.norm(wanted)
        edges = np.linalg.norm(offset) / edge_at(unbounded.mesh, 0)
        assert error < (0.01 if edges > 1.2 else 0.02 if edges > 0.9 else 0.05)


@pytest.mark.parametrize("x", [1e-3, 0.0999, 0.1001, 0.7, 2.5, 6.0])
def test_the_response_is_the_transform_of_the_density(x):
    positions, weight = sphere_rule(False)
    radius = np.linalg.norm(positions, axis=1)

    assert response(np.array(x)) == pytest.approx(weight @ np.sinc(x * radius / np.pi), abs=1e-6)


def test_densities_have_the_moments_they_are_named_for():
    for flat, second in ((False, 1.0 / 9.0), (True, 0.0)):
        positions, weight = sphere_rule(flat)
        assert weight.sum() == pytest.approx(1.0, rel=1e-13)
        assert weight @ positions == pytest.approx(np.zeros(3), abs=1e-14)
        along = np.einsum("n,ni,nj->ij", weight, positions, positions)
        assert along == pytest.approx(second * np.eye(3), abs=1e-13)


def test_a_deconvolved_moment_seen_through_its_sphere_is_the_moment():
    width = 0.004
    moment = TimeFunction(np.append(np.zeros(200), np.cumsum(VALUES)), DT, held=True)
    positions, weight = sphere_rule(False)
    times = DT * np.arange(100, 380)

    # A plane wave passes the shells of the sphere early and late.
    divided = deconvolved(moment, width)
    shifts = width * positions[:, 2]
    seen = sum(w * divided(times + shift) for w, shift in zip(weight, shifts, strict=True))
    assert seen == pytest.approx(moment(times), abs=2e-4 * moment.values[-1])
    assert divided.values[-1] == pytest.approx(moment.values[-1], rel=1e-8)


BOXES = {
    "hexahedra": ({"order": 4}, False),
    "quadratic": ({"pattern": "alternating"}, True),
    "linear": ({"pattern": "alternating"}, False),
}


def layered(kind, **parts):
    how, quadratic = BOXES[kind]
    lines = [np.linspace(0.0, 40.0, 5), np.linspace(0.0, 40.0, 5), np.linspace(-40.0, 0.0, 5)]
    mesh = structured_box(*lines, layers=[Layer("soil", 10.0), Layer("rock")], **how)
    return Model(mesh, {"soil": ROCK, "rock": ROCK}, quadratic=quadratic, **parts)


@pytest.mark.parametrize("kind", BOXES)
@pytest.mark.parametrize("depth", [0.0, 0.3, 10.2, 14.0, 20.0])
def test_a_moment_keeps_its_sum_centre_and_ground_at_any_depth(kind, depth):
    body = layered(kind)
    position, tensor = np.array([17.0, 21.0, -depth]), np.diag([1.0, 2.0, 3.0]) + 0.5
    zone = locate_in_zones(body.mesh, position)[0][0]
    radius = source_radius(body.nodes, zone, position)

    for flat in (False, True):
        nodes, forces = moment_forces(body.nodes, zone, position, tensor, radius, flat)
        points = body.nodes.points[nodes]
        assert forces.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-11)
        assert points.T @ forces == pytest.approx(tensor, abs=1e-9)
        isotropic = moment_forces(body.nodes, zone, position, np.eye(3), radius, flat)[1]
        second = np.einsum("ni,ni,nj->j", isotropic, points, points)
        assert second == pytest.approx(4.0 * position, abs=2.0 if kind == "linear" else 1e-6)
        moved = points[np.abs(forces).max(axis=1) > 0.0, 2]
        top, low = (0.0, -10.0) if depth < 10.0 else (-10.0, -40.0)
        assert moved.max() <= top
        assert moved.min() >= low


def test_the_radius_ends_where_the_ground_ends():
    split = structured_box((4, 4, 4), (40.0, 40.0, 40.0), order=4, planes={"J": ("x", 20.0)})
    joint = Joint("J", "elastic", {"kn": 1e9, "ks": 1e9})
    body = Model(split.split(["J"]), {"rock": ROCK}, joints=[joint])
    zone = locate_in_zones(body.mesh, [17.0, 12.0, 18.0])[0][0]

    assert clearance(body.mesh, np.array([17.0, 12.0, 18.0]), 8.0) == pytest.approx(3.0)
    assert clearance(body.mesh, np.array([14.0, 12.0, 37.5]), 8.0) == pytest.approx(2.5)
    assert clearance(body.mesh, np.array([10.0, 20.0, 20.0]), 8.0) == 8.0
    assert source_radius(body.nodes, zone, np.array([17.0, 12.0, 18.0])) == pytest.approx(3.0)
    assert source_radius(body.nodes, zone, np.array([10.0, 15.0, 20.0])) == pytest.approx(6.0)
    assert source_radius(body.nodes, zone, np.array([10.0, 15.0, 20.0]), 2.0) == pytest.approx(2.0)


def test_the_radius_ends_where_the_absorbing_layer_begins():
    position = np.array([117.0, 40.0, -40.0])

    assert clearance(open_box(2, True).mesh, position, 20.0) == pytest.approx(3.0)
    assert clearance(open_box(2, False).mesh, position, 20.0) == 20.0


def test_the_source_nearest_by_edges_says_what_a_receiver_lacks():
    x, across = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 80.0, 120.0, 160.0]), 10.0 * np.arange(9)
    mesh = structured_box(x, across, across, order=4)
    places = (35.0, 45.0, 45.0), (97.0, 45.0, 45.0)
    sources = [PointForce(place, (0.0, 0.0, 1.0), RATE) for place in places]
    receiver = Receiver("A", (65.0, 45.0, 45.0))  # 3 edges of 10 m from one, 0.8 of 40 m from one

    (row,) = near_sources(Model(mesh, {"rock": ROCK}, sources=sources, receivers=[receiver]))

    assert (row.source, row.distance, row.edge) == (1, 32.0, 40.0)


@pytest.mark.parametrize(("at", "error"), [(60.0, 0.02), (80.0, 0.95)])
def test_a_force_is_seen_worse_on_a_face_of_elements(at, error):
    mesh = structured_box((4, 4, 4), (160.0, 160.0, 160.0), order=4)
    force = PointForce((at, 60.0, 60.0), (0.0, 0.0, 1.0), RATE)
    receiver = Receiver("A", (at + 30.0, 60.0, 60.0))

    (row,) = near_sources(Model(mesh, {"rock": ROCK}, sources=[force], receivers=[receiver]))

    assert row.error == pytest.approx(error)


def test_a_column_has_points_enough_and_two_histories():
    body = layered("hexahedra")
    column = Column(np.array([17.0, 21.0, -36.0]), np.array([17.0, 21.0, -12.0]), 3.0, 0.0, RATE)

    loads = model_loads(replace(body, sources=[column]), None).arrays(DT * np.arange(10.0))

    assert loads["history"].shape[1] == 2
    delays = np.unique(loads["load_delay"].round(9))
    assert len(delays) >= 4 * 24.0 / 6.0
    moment = body.nodes.points[loads["load_node"]].T @ loads["load_vector"]
    assert moment == pytest.approx(3.0 * column.tensor(ROCK), abs=1e-9)


def test_a_radius_of_nothing_is_refused():
    with pytest.raises(InputError, match=r"hole\.spread: must be positive, got 0 m; leave it out"):
        Hole(np.zeros(3), 1.0, 0.0, RATE, spread=0.0)
    with pytest.raises(InputError, match=r"moment tensor\.spread: must be positive"):
        MomentTensor(np.zeros(3), np.eye(3), 0.0, RATE, -2.0)


def test_models_that_share_a_mesh_average_over_the_sphere_of_a_hole_once(monkeypatch):
    mesh = structured_box((4, 4, 4), (40.0, 40.0, 40.0))
    hole = Hole(np.array([18.0, 21.0, 22.0]), 5.0, 0.0, RATE)
    models = [Model(mesh, {"rock": rock}, sources=[hole])
              for rock in (ROCK, replace(ROCK, density=2000.0))]  # fmt: skip
    first = model_loads(models[0], {}.get).arrays(DT * np.arange(4))
    monkeypatch.setattr("pyblast.solver.moment_density._average", None)

    again, other = (model_loads(m, {}.get).arrays(DT * np.arange(4)) for m in models)

    for name, wanted in first.items():
        np.testing.assert_array_equal(again[name], wanted)
    assert other.keys() == first.keys()


@pytest.mark.parametrize("kind", list(ERRORS))
def test_errors_near_a_source_end_at_one_per_cent_and_fall_to_it(kind):
    ratios, errors = ERRORS[kind]

    assert errors[-1] == 0.01
    assert min(errors[:-1]) > 0.01
    assert (np.diff(ratios) > 0.0).all()


@pytest.mark.parametrize("ratio", [0.6, 1.0, 1.2, 1.4, 2.0, 3.0])
@pytest.mark.parametrize("tensor", [np.eye(3), np.eye(3)[[1, 0, 2]] * [1.0, 1.0, 0.0]])
def test_the_edge_that_is_asked_for_is_shorter_than_one_that_errs(tensor, ratio):
    mesh = structured_box((8, 4, 4), (320.0, 160.0, 160.0), order=4)
    source = MomentTensor(np.full(3, 60.0), tensor, 0.0, RATE)
    receiver = Receiver("A", (60.0 + 40.0 * ratio, 60.0, 60.0))
    model = Model(mesh, {"rock": ROCK}, sources=[source], receivers=[receiver])

    (row,) = beside_sources(model)

    assert row.named == (row.error > 0.01) == bool(near_sources(model))
    assert (row.edge_needed < row.edge) == row.named
    if ratio >= 1.5:
        assert row.error == pytest.approx(0.01 * (1.5 / ratio) ** 2)


def test_a_density_without_second_moment_leaves_all_but_the_fourth_power_of_a_wave():
    x = np.array([0.1, 0.2, 0.4])

    left = 1.0 - flat_response(x)

    assert left[1:] / left[:-1] == pytest.approx([16.0, 16.0], rel=0.02)
    assert flat_response(np.zeros(1)) == pytest.approx([1.0], abs=1e-12)
