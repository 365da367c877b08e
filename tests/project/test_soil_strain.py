"""Soil at strain: the finding is that of a plane wave, velocity over S speed."""

from types import SimpleNamespace

import numpy as np
import pytest

from pyblast.mesh.builder import Layer, structured_box
from pyblast.model.material import Material, MohrCoulomb
from pyblast.model.model import Receiver
from pyblast.project.elastic_ground import soil_strain
from pyblast.signals.seismogram import Seismogram

SOIL = Material.from_speeds(1800.0, 500.0, 250.0)
ROCK = Material.from_speeds(2600.0, 4300.0, 2500.0)


def found(peak, soil=SOIL):
    layers = [Layer("soil", 10.0), Layer("rock")]
    mesh = structured_box((2, 2, 2), (20.0, 20.0, 20.0), layers=layers)
    receivers = [Receiver("on soil", (10.0, 10.0, 20.0)), Receiver("in rock", (10.0, 10.0, 2.0))]
    model = SimpleNamespace(mesh=mesh, receivers=receivers, materials={"soil": soil, "rock": ROCK})
    motion = Seismogram(np.outer([0.0, 0.5, 0.0], [0.0, 0.6 * peak, 0.8 * peak]) * 2.0, 0.01)
    return soil_strain(model, dict.fromkeys(("on soil", "in rock"), motion))


def test_soil_is_strained_by_the_peak_of_the_vector_over_its_s_speed():
    finding = found(0.05)

    assert finding.numbers["strain"] == pytest.approx(0.05 / 250.0)
    assert finding.numbers["receivers"] == 1
    assert "on soil" in finding.text


def test_little_strain_and_soil_that_yields_are_no_finding():
    assert found(0.024) is None
    yielding = Material.from_speeds(
        1800.0, 500.0, 250.0, cohesion=1e4, friction=0.5, law=MohrCoulomb()
    )
    assert found(0.05, yielding) is None
