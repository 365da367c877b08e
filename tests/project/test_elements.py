"""The program chooses the elements: hexahedra where the ground allows it, and says why not."""

from copy import deepcopy

import numpy as np
import pytest
from small_site import TABLES

from pyblast.config.config import check_config
from pyblast.errors import InputError
from pyblast.mesh.quality import explicit_work
from pyblast.project.project import make_project
from pyblast.simulation.recipe import NODES_FOR_ONE_PER_CENT, nodes_per_wavelength

TIMES = np.arange(0.0, 0.2, 1e-3)
POSITION = [30.0, 40.0, -10.0]


@pytest.fixture
def project(tmp_path):
    """Return a function that makes a project with a force and changed tables."""
    pulse = np.sin(np.pi * TIMES / 0.2) ** 2
    lines = [f"{t:.4f},{force:.6g}" for t, force in zip(TIMES, 1e6 * pulse, strict=True)]
    (tmp_path / "hammer.csv").write_text("\n".join(["time_s,force_n", *lines]) + "\n")

    def made(mesh=None, **tables):
        table = deepcopy(TABLES)
        for name in ("blast", "holes_inside", "diagnosis"):
            del table[name]
        table["point_forces"] = [
            {"position_m": POSITION, "direction": [0.0, 0.0, 1.0], "file": "hammer.csv"}
        ]
        table["receivers"] = [{"name": "R1", "position_m": [90.0, 50.0]}]
        given = {**table["mesh"], **(mesh or {})}
        table["mesh"] = {key: value for key, value in given.items() if value is not None}
        return make_project(check_config(table | tables), tmp_path / "project.toml")

    return made


def dipping(dip, towards, name="J1"):
    return {"name": name, "joint": "J1", "dip_deg": dip, "dip_direction_deg": towards,
            "through_m": [60.0, 45.0, 0.0]}  # fmt: skip


def test_a_box_with_a_fault_becomes_hexahedra_with_an_absorbing_layer(project):
    one = project()

    assert one.meshed.reason.startswith("hexahedra of order 5")
    assert one.mesh.hexahedral
    assert one.mesh.layer is not None
    assert one.model.joints[0].surface == "J1"


@pytest.mark.parametrize(
    ("mesh", "why"),
    [
        ({"faults": [dipping(60, 90), dipping(60, 140, "J2")], "order": 6}, "'J1' and 'J2' meet"),
        ({"kind": "tetrahedra"}, "as mesh.kind asks for"),
        ({"grid_cells": [6, 4, 3], "edge_m": None}, "divides the box into tetrahedra"),
    ],
)
def test_what_stands_in_the_way_of_hexahedra_is_said(project, mesh, why):
    joints = {"J1": TABLES["joints"]["J1"]}

    one = project(mesh, joints=joints)

    assert not one.mesh.hexahedral
    assert why in one.meshed.reason


def test_hexahedra_that_can_not_be_are_refused_in_one_sentence(project):
    planes = [dipping(60, 90), dipping(60, 140, "J2")]
    one = project({"kind": "hexahedra", "faults": planes, "order": 6})

    with pytest.raises(InputError, match=r"'hexahedra' do not serve .* 'J1' and 'J2' meet"):
        _ = one.mesh


def test_faults_that_meet_are_cut_into_hexahedra_in_an_absorbing_layer(project):
    planes = [dipping(60, 90), dipping(60, 140, "J2")]
    one = project({"faults": planes, "edge_m": 25.0}, joints={"J1": TABLES["joints"]["J1"]})

    assert one.meshed.reason.startswith("hexahedra of order 3 of tetrahedra cut")
    assert "because 'J1' and 'J2' meet in the box" in one.meshed.reason
    assert one.mesh.layer is not None


def test_the_order_of_least_work_is_taken_where_planes_are_close(project):
    planes = [dipping(60, 90) | {"through_m": [60.0, 45.0, 0.0]},
              dipping(50, 270, "J2") | {"through_m": [66.0, 45.0, 0.0]}]  # fmt: skip
    near = project({"faults": planes}, joints={"J1": TABLES["joints"]["J1"]})

    assert near.mesh.order < 5
    assert "swept along one direction" in near.meshed.reason
    given = project({"faults": planes, "order": 5}, joints={"J1": TABLES["joints"]["J1"]})
    assert given.mesh.order == 5
    assert explicit_work(near.mesh) < explicit_work(given.mesh)


def test_edges_follow_from_the_band_where_they_are_left_out(project):
    free = {"edge_m": None, "frequency_hz": 25.0}
    coarse, fine = (project({**free, "accuracy": wanted}) for wanted in (0.05, 0.0005))
    band = project({"edge_m": None})  # the band in which records are compared

    assert len(fine.mesh.zones) >= len(coarse.mesh.zones)
    assert fine.meshed.reason != coarse.meshed.reason
    assert band.mesh.hexahedral


def test_a_smaller_error_wants_more_nodes_and_a_longer_path_too():
    for order, nodes in NODES_FOR_ONE_PER_CENT.items():
        assert nodes_per_wavelength(order, 0.01, 1.0) == nodes
        assert nodes_per_wavelength(order, 0.001, 3.0) > nodes
        assert nodes_per_wavelength(order, 0.01, 30.0) > nodes


def test_a_source_beyond_the_box_is_refused_before_the_mesh(project):
    outside = {"position_m": [-5.0, 40.0, -10.0], "direction": [0.0, 0.0, 1.0],
               "file": "hammer.csv"}  # fmt: skip

    with pytest.raises(InputError, match="lies outside of the ground, which reaches from 0 to 120"):
        project(point_forces=[outside])


def test_soft_soil_without_attenuation_takes_tetrahedra(project):
    def on_rock(**loss):
        soil = {"density_kg_per_m3": 1800.0, "cp_m_per_s": 600.0, "cs_m_per_s": 300.0, **loss}
        layers = [{"material": "soil", "thickness_m": 20.0}, {"material": "rock"}]
        return project(
            {"layers": layers, "faults": [], "edge_m": 10.0},
            materials={**TABLES["materials"], "soil": soil},
            joints={},
        ).meshed.reason

    assert "an absorbing layer would feed its motion; give it qp and qs" in on_rock()
    assert on_rock(qp=40.0, qs=20.0, quality_band_hz=[2.0, 30.0]).startswith("hexahedra")
