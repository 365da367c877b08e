"""Ground of hexahedra: planes stay planes, layers stay level, what can't be a grid is refused."""

import numpy as np
import pytest

from pyblast.mesh.grid import Fault, JointSet, Layer
from pyblast.mesh.hexahedral_ground import NotMapped, build_hexahedra
from pyblast.mesh.mesh import volumes
from pyblast.mesh.spectral_nodes import spectral_nodes

BOX = np.array([[0.0, 200.0], [0.0, 150.0], [-60.0, 0.0]])
OPEN = ("west", "east", "south", "north", "bottom")
ROCK = [Layer("rock")]


def built(layers=ROCK, sets=(), faults=(), open_sides=OPEN, sizes=None, **options):
    sizes = sizes or [40.0] * len(layers)
    return build_hexahedra(
        BOX, layers, sets, faults, sizes=sizes, order=4, open_sides=open_sides, **options
    )


@pytest.mark.parametrize(("dip", "towards"), [(60.0, 252.0), (35.0, 10.0), (80.0, 135.0)])
def test_a_dipping_fault_is_a_plane_inside_the_model(dip, towards):
    fault = Fault("F", np.radians(dip), np.radians(towards), (100.0, 75.0, 0.0))
    nodes = spectral_nodes(built(faults=[fault]).split(["F"]))

    contacts = nodes.contacts
    place = nodes.points[contacts.minus]
    inside = place[:, 2] > BOX[2, 0] - 1e-6
    off = (place - fault.point) @ fault.unit_normal
    assert np.abs(off[inside]).max() < 1e-9
    above = place[:, 2] > BOX[2, 0] + 1e-6
    assert np.abs(np.abs(contacts.normal[above] @ fault.unit_normal) - 1.0).max() < 1e-9
    assert volumes(nodes.mesh).min() > 0.0


def test_a_dipping_fault_stays_a_plane_under_a_surveyed_surface():
    x, y = np.meshgrid(np.linspace(-400.0, 600.0, 41), np.linspace(-400.0, 600.0, 41))
    surface = np.column_stack([x.ravel(), y.ravel(), 8.0 * np.tanh((x.ravel() - 100.0) / 40.0)])
    fault = Fault("F", np.radians(70.0), np.radians(90.0), (100.0, 75.0, 0.0))
    nodes = spectral_nodes(built(faults=[fault], surface=surface).split(["F"]))

    place = nodes.points[nodes.contacts.minus]
    inside = place[:, 2] > BOX[2, 0] - 1e-6
    assert np.abs((place - fault.point)[inside] @ fault.unit_normal).max() < 1e-6
    top = nodes.points[nodes.surfaces["top"]]
    middle = (np.abs(top[..., 0] - 100.0) < 90.0) & (np.abs(top[..., 1] - 75.0) < 70.0)
    assert top[..., 2][middle] == pytest.approx(
        8.0 * np.tanh((top[..., 0][middle] - 100.0) / 40.0), abs=0.4
    )


def test_joints_of_a_set_stand_at_their_spacing():
    mesh = built(sets=[JointSet("S", np.pi / 2, np.pi / 2, 50.0, origin=(25.0, 0.0, 0.0))])

    x = np.unique(mesh.points[mesh.surfaces["S"]][..., 0].round(6))
    assert x.tolist() == [25.0, 75.0, 125.0, 175.0]


def test_a_set_is_cut_to_the_layers_that_it_names():
    layers = [Layer("soil", 20.0), Layer("rock")]
    vertical = JointSet("S", np.pi / 2, np.pi / 2, 50.0, regions=("rock",))
    mesh = built(layers, [vertical])

    height = mesh.points[mesh.surfaces["S"]][..., 2]
    assert (height.min(), height.max()) == (-60.0, -20.0)  # not in soil nor beyond the box


def test_a_fault_of_limited_extent_has_its_area():
    fault = Fault("F", np.pi / 2, np.pi / 2, (100.0, 75.0, -30.0), extent=(60.0, 40.0))
    nodes = spectral_nodes(built(faults=[fault]).split(["F"]))

    place = nodes.points[nodes.contacts.minus] - fault.point
    assert np.abs(place).max(axis=0) == pytest.approx([0.0, 30.0, 20.0], rel=0.4)
    assert (np.abs(place) < [1e-9, 30.0, 20.0]).all()  # its border stays closed
    assert 0.7 * 2400.0 < nodes.contacts.area.sum() < 2400.0


def test_layers_lie_at_their_depths():
    mesh = built([Layer("soil", 12.5), Layer("rock")], sizes=[10.0, 40.0])

    top = mesh.zones[mesh.zone_group == 0]
    assert mesh.points[top][..., 2].min() == pytest.approx(-12.5)
    assert mesh.points[:, 2].min() < BOX[2, 0]  # the absorbing layer


def test_a_side_that_is_closed_has_no_layer():
    mesh = built(open_sides=("bottom",))

    assert np.ptp(mesh.points[:, 0]) == pytest.approx(200.0)
    assert np.isinf(np.array(mesh.layer.inner)[:2]).all()


@pytest.mark.parametrize(
    ("sets", "faults", "open_sides", "why"),
    [
        ((), [(60, 90), (60, 100)], OPEN, "dip in different ways"),
        ((), [(60, 90), (90, 40)], OPEN, "oblique to the other planes"),
        ((), [(60, 30)], ("bottom",), "oblique to sides where the model ends"),
        ([0.5], [], OPEN, "intact parts"),
    ],
)
def test_planes_that_fit_no_grid_are_refused(sets, faults, open_sides, why):
    planes = [
        Fault(f"F{k}", np.radians(dip), np.radians(to), (100.0, 75.0, 0.0))
        for k, (dip, to) in enumerate(faults)
    ]
    joints = [JointSet("S", np.pi / 2, 0.0, 50.0, persistence=share) for share in sets]

    with pytest.raises(NotMapped, match=why):
        built(sets=joints, faults=planes, open_sides=open_sides)
