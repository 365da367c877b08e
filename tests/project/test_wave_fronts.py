"""A load on a face that falls off and lags with the distance of each point from each hole."""

import math

import numpy as np
import pytest
from small_project import TEXT, written

from pyblast.errors import InputError
from pyblast.model.boundary import WaveFronts
from pyblast.project.checks import check
from pyblast.project.level import graded_energy, incident_energy
from pyblast.project.places import face_areas
from pyblast.project.project import load_project

ROCK = (TEXT[TEXT.index('[[mesh.layers]]\nmaterial = "soil"') : TEXT.index('[[mesh.layers]]\nmat'
        'erial = "rock"')], "")  # fmt: skip
SOIL = (TEXT[TEXT.index("[materials.soil]") : TEXT.index("[materials.rock]")], "")
ONE = ("rows = 4", "rows = 1"), ("holes_per_row = 15", "holes_per_row = 1")
LOW = "low_pass_hz = 20"


def graded(folder, distance=39, exponent=1.6, *changes):
    load = (LOW, f"{LOW}\ndistance_m = {distance}\ndecay_exponent = {exponent}")
    return load_project(written(folder, ROCK, SOIL, load, *changes))


def test_amplitude_delay_and_path_are_those_of_the_distance():
    fronts = WaveFronts(
        np.array([[0.0, 0.0, 0.0]]), np.array([0.2]), np.array([3.0]), 40.0, 1.6, 4000.0,
        np.array([1.0, 0.0, 0.0]),
    )  # fmt: skip

    amplitude, delay, turn = (each[0] for each in fronts.at([[40.0, 0.0, 0.0], [0.0, 80.0, 0.0]]))

    assert amplitude == pytest.approx([3.0, 3.0 * 0.5**1.6])
    assert delay == pytest.approx([0.2, 0.2 + 40.0 / 4000.0])
    assert turn[0] == pytest.approx(np.eye(3))
    assert turn[1] @ [1.0, 0.0, 0.5] == pytest.approx([0.0, 1.0, 0.5])  # along its path


def test_from_far_away_it_is_the_plane_load(tmp_path):
    (tmp_path / "plane").mkdir()
    far = ("position_m = [-39, 10, 30]", "position_m = [-1e6, 10, 30]")
    project = graded(tmp_path, 1e6, 1.6, far, *ONE)
    plane = load_project(written(tmp_path / "plane", ROCK, SOIL, far, *ONE))

    energy = graded_energy(project)
    motion, same = (each.simulate().seismograms["R1"].velocity for each in (project, plane))

    assert energy == pytest.approx(incident_energy(plane.input.motion, face_areas(plane)), rel=0.02)
    assert np.abs(motion - same).max() < 1e-3 * np.abs(same).max()


def test_energy_and_delay_grow_and_fall_with_the_distance(tmp_path):
    """A single hole: its share of the plane load is the mean square of its amplitudes."""
    project = graded(tmp_path, 39, 1.6, *ONE)

    energy = graded_energy(project)

    mesh = project.model.mesh
    corners = mesh.points[mesh.surfaces["west"]]
    centre = project.blast.centres[0]
    away = np.linalg.norm(corners.mean(axis=1) - centre, axis=1)
    plane = incident_energy(
        project.model.boundaries[-1].seismogram, face_areas(project)
    )  # of the single hole, alike on the face
    assert energy == pytest.approx(plane * np.mean((39.0 / away) ** 3.2), rel=0.02)
    assert "D6" not in {finding.code for finding in check(project).findings}


def test_the_input_is_that_of_the_point_opposite_the_first_holes(tmp_path):
    project = graded(tmp_path, 39, 1.6, *ONE)

    signature, motion = project.signature, project.input.superposed

    assert motion.ppv[0] == pytest.approx(signature.ppv[0], rel=1e-6)


def test_holes_beside_the_middle_count_less_and_come_later(tmp_path):
    row = graded(tmp_path, 39, 1.6, ("rows = 4", "rows = 1"))

    ratio = row.input.superposed.ppv[0] / row.signature.ppv[0]

    side = row.blast.centres[:, 1] - row.blast.centres[:, 1].mean()
    away = np.hypot(39.0, side)
    most = float(((39.0 / away) ** 1.6 * 39.0 / away).sum())  # turned into their paths
    assert ratio < most
    assert ratio > 0.8 * most


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((LOW, f"{LOW}\ndecay_exponent = 1.6"), "distance_m is missing beside decay_exponent"),
        ((LOW, f'{LOW}\ndistance_m = 9\ndecay_exponent = 1\nenters_as = "velocity"'),
         "decay_exponent needs enters_as = 'stress'"),
        ((LOW, f'{LOW}\nface = "bottom"\ndistance_m = 9\ndecay_exponent = 1'),
         "decay_exponent: needs .blast. and a face west"),
    ],
)  # fmt: skip
def test_a_graded_load_that_can_not_be_is_refused(tmp_path, change, words):
    with pytest.raises(InputError, match=words):
        _ = load_project(written(tmp_path, change)).input


def test_all_of_it_is_finite(tmp_path):
    run = graded(tmp_path).simulate()

    assert math.isfinite(run.seismograms["R1"].pvs)
    assert run.balance_error < 1e-6
