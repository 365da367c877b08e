"""Spectral hexahedra: quadrature, geometry, location, numbering across zones and joints."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh import hexahedra
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import locate_in_zones, zone_volumes
from pyblast.mesh.spectral_nodes import spectral_nodes

ORDERS = pytest.mark.parametrize("order", hexahedra.ORDERS)
SIZE = (30.0, 20.0, 10.0)


def bent(mesh, amount=1.0):
    """Return a mesh with curved zones: nodes moved smoothly, those of faces together."""
    places = mesh.node_places.copy()
    x, y, z = np.moveaxis(places, -1, 0)
    wave = np.sin(x / 9.0) * np.cos(y / 7.0) * np.sin(np.pi * z / SIZE[2])
    places[..., 0] += amount * wave
    places[..., 2] += amount * np.sin(x / 11.0 + y / 8.0) * (z / SIZE[2])
    return replace(mesh, places=places)


def box(order=4, planes=None, shape=(3, 2, 2)):
    return structured_box(shape, SIZE, order=order, planes=planes)


@ORDERS
def test_the_quadrature_is_exact_up_to_twice_the_order_less_one(order):
    points, weights = hexahedra.lobatto(order)

    powers = np.arange(2 * order)
    assert weights @ points[:, None] ** powers == pytest.approx(
        np.where(powers % 2 == 0, 2.0 / (powers + 1), 0.0), abs=1e-13
    )


@ORDERS
def test_slopes_of_polynomials_up_to_the_order_are_exact(order):
    points, _ = hexahedra.lobatto(order)

    for power in range(order + 1):
        slope = hexahedra.slopes_on_line(order) @ points**power
        assert slope == pytest.approx(power * points ** max(power - 1, 0), abs=1e-11)


@ORDERS
def test_shape_functions_are_one_at_their_node_and_sum_to_one(order):
    nodes = hexahedra.reference_nodes(order)
    places = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3))

    assert hexahedra.shape_values(order, nodes) == pytest.approx(np.eye(len(nodes)), abs=1e-12)
    assert hexahedra.shape_values(order, places).sum(axis=1) == pytest.approx(1.0, abs=1e-12)
    assert hexahedra.shape_slopes(order, places).sum(axis=1) == pytest.approx(0.0, abs=1e-11)


def test_faces_of_a_zone_close_around_it():
    nodes = spectral_nodes(bent(box()))

    every = np.arange(6 * len(nodes.mesh.zones))
    _, vectors = nodes.face_areas(every)
    total = vectors.sum(axis=1).reshape(-1, 6, 3).sum(axis=1)
    assert total == pytest.approx(0.0, abs=1e-9 * np.abs(vectors).sum())


def test_a_curved_zone_has_the_volume_that_its_faces_enclose():
    nodes = spectral_nodes(bent(box(5)))

    numbers, vectors = nodes.face_areas(np.arange(6 * len(nodes.mesh.zones)))
    flux = (nodes.points[numbers] * vectors).sum(axis=(1, 2)).reshape(-1, 6).sum(axis=1) / 3.0
    assert zone_volumes(nodes.mesh) == pytest.approx(flux, rel=1e-6)


def test_zones_share_the_nodes_of_their_faces():
    nodes = spectral_nodes(bent(box(4)))

    assert len(nodes.points) == (3 * 4 + 1) * (2 * 4 + 1) * (2 * 4 + 1)
    assert nodes.points[nodes.zone_nodes] == pytest.approx(nodes.mesh.node_places, abs=1e-12)
    assert nodes.sums(np.ones(12)).sum() == pytest.approx(12.0)


def test_a_joint_has_nodes_of_its_own_on_both_sides():
    mesh = box(3, {"J": ("x", 10.0), "K": ("z", 5.0)}).split(["J", "K"])
    contacts = spectral_nodes(mesh).contacts

    points = spectral_nodes(mesh).points
    assert points[contacts.minus] == pytest.approx(points[contacts.plus], abs=1e-12)
    area = np.bincount(contacts.joint, contacts.area)
    assert area == pytest.approx([SIZE[1] * SIZE[2], SIZE[0] * SIZE[1]])
    assert np.abs(contacts.normal[contacts.joint == 0]) == pytest.approx(
        np.tile([1.0, 0.0, 0.0], (np.count_nonzero(contacts.joint == 0), 1))
    )
    assert mesh.blocks().max() == 3


def test_a_turned_neighbour_shares_the_nodes_of_its_face():
    mesh = box(4, shape=(2, 1, 1))
    turned = mesh.zones.copy()
    turned[1] = mesh.zones[1][[1, 3, 0, 2, 5, 7, 4, 6]]  # a quarter about the vertical

    assert len(spectral_nodes(replace(mesh, zones=turned)).points) == 9 * 5 * 5


def test_places_are_found_in_curved_zones():
    mesh = bent(box(4))
    zones = np.arange(len(mesh.zones))
    wanted = np.random.default_rng(2).uniform(-0.9, 0.9, (len(zones), 3))
    places = np.einsum("na,nac->nc", hexahedra.shape_values(4, wanted), mesh.node_places)

    zone, found = locate_in_zones(mesh, places)

    assert zone.tolist() == zones.tolist()
    assert found == pytest.approx(wanted, abs=1e-9)


def test_a_place_outside_is_refused():
    with pytest.raises(InputError, match="must lie in the mesh"):
        locate_in_zones(box(), [(100.0, 0.0, 0.0)])


def test_an_order_that_has_no_kernel_is_refused():
    with pytest.raises(InputError, match=r"mesh\.order: must be 2 to 8"):
        box(9)
