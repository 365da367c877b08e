"""An explosion in the middle of a box, on a corner of its elements: motion, and what is said."""

import numpy as np
import pytest

from pyblast.back_analysis.findings import near_source_findings
from pyblast.errors import InputError
from pyblast.mesh.quality import explicit_work
from pyblast.project.checks import check
from pyblast.project.places import resolved_receivers
from pyblast.project.project import load_project
from pyblast.solver.run import simulate
from verification.solutions.full_space import Bell, explosion, point_force

BELL = Bell(15.0)
MIDDLE = np.array([65.0, 65.0, 65.0])
OFFSETS = {
    "east 15": (15.0, 0.0, 0.0),
    "up 25": (0.0, 0.0, 25.0),
    "east 40": (40.0, 0.0, 0.0),
    "aside 60": (36.0, -48.0, 0.0),
    "corner 100": (57.7, 57.7, -57.7),
}
PROJECT = """
title = "A hole in the middle"
[mesh]
size_m = [130, 130, 130]
frequency_hz = 40
near_source_work = 1
layers = [{ material = "rock" }]
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 4000
cs_m_per_s = 2300
[boundaries]
viscous = ["west", "east", "south", "north", "bottom", "top"]
[[moment_tensors]]
position_m = [65, 65, 65]
tensor = [1, 1, 1, 0, 0, 0]
file = "rate.csv"
[run]
duration_s = 0.2
"""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("middle")
    values, dt = BELL.samples()
    rows = [f"{n * dt:.9g},{1e9 * value:.9g}" for n, value in enumerate(values)]
    head = "time_s,moment_rate_Nm_per_s"
    (folder / "rate.csv").write_text("\n".join([head, *rows]) + "\n")
    receivers = [
        f'[[receivers]]\nname = "{name}"\nposition_m = {(MIDDLE + offset).tolist()}\n'
        for name, offset in OFFSETS.items()
    ]
    (folder / "project.toml").write_text(PROJECT + "".join(receivers))
    return load_project(folder / "project.toml")


def test_the_middle_of_the_box_is_a_corner_of_elements(project):
    assert np.abs(project.mesh.points - MIDDLE).max(axis=1).min() < 1.0


def test_motion_is_that_of_a_point_beyond_the_sphere_and_never_larger(project):
    records = simulate(project.model, project.duration).seismograms

    ratios = {}
    for name, offset in OFFSETS.items():
        wanted = 1e9 * explosion(records[name].times, offset, BELL, project.materials["rock"])
        error = np.linalg.norm(records[name].velocity - wanted) / np.linalg.norm(wanted)
        ratios[name] = np.abs(records[name].velocity).max() / np.abs(wanted).max()
        assert (
            error
            < {
                "east 15": 0.95,
                "up 25": 0.5,
                "east 40": 0.06,
                "aside 60": 0.04,
                "corner 100": 0.02,
            }[name]
        )
    assert max(ratios.values()) < 1.05


def test_receivers_near_a_source_are_named_with_error_and_edge(project):
    (finding,) = (f for f in check(project).findings if f.code == "D38")

    assert "'east 15' stands 15 m from moment tensor 1, 0.23 of the edge of 65 m" in finding.text
    assert "error up to 75 %; edges of 10 m, 1800 times the work" in finding.text
    assert "'corner 100'" not in finding.text
    assert "Above 20 % at 2 of 4: these count in no fit." in finding.text
    assert finding.numbers["error"] == pytest.approx(0.752, abs=0.01)


def test_a_back_analysis_names_the_receivers_that_do_not_count(project):
    (finding,) = near_source_findings([project])

    assert finding.code == "D38"
    assert "'up 25'" in finding.text


def changed(project, name, **replaced):
    text = (project.folder / "project.toml").read_text()
    for old, new in replaced.items():
        text = text.replace(f"{old} = {new[0]}", f"{old} = {new[1]}")
    (project.folder / f"{name}.toml").write_text(text)
    return load_project(project.folder / f"{name}.toml")


@pytest.fixture(scope="module")
def wide(project):
    return changed(project, "wide", near_source_work=(1, 10))


@pytest.mark.long
def test_a_uniform_ground_goes_on_until_its_explosion_is_injected_and_every_receiver_counts(wide):
    records = simulate(wide.model, wide.duration).seismograms

    assert "times the work for room around the sources" in wide.meshed.reason
    assert "D38" not in {finding.code for finding in check(wide).findings}
    assert resolved_receivers(wide, tuple(OFFSETS)) == tuple(OFFSETS)
    assert "up 25" not in resolved_receivers(wide, tuple(OFFSETS), injected=False)
    for name, offset in OFFSETS.items():
        wanted = 1e9 * explosion(records[name].times, offset, BELL, wide.materials["rock"])
        error = np.linalg.norm(records[name].velocity - wanted) / np.linalg.norm(wanted)
        assert error < 0.01, name


@pytest.fixture(scope="module")
def force(project):
    graded = changed(project, "force", near_source_work=(1, 12))
    text = graded.path.read_text().replace('"rate.csv"', '"force.csv"')
    text = text.replace("moment_tensors", "point_forces")
    graded.path.write_text(text.replace("tensor = [1, 1, 1, 0, 0, 0]", "direction = [0, 0, 1]"))
    rows = (project.folder / "rate.csv").read_text().splitlines()[1:]
    (project.folder / "force.csv").write_text("\n".join(["time_s,force_n", *rows]) + "\n")
    return load_project(graded.path)


def errors(project):
    """Return the error of the motion by a force at each receiver, by the closed form."""
    records, up = simulate(project.model, project.duration).seismograms, np.array([0.0, 0.0, 1.0])
    rock, away = project.materials["rock"], {}
    for name, at in OFFSETS.items():
        wanted = 1e9 * point_force(records[name].times, at, up, BELL, rock)
        away[name] = np.linalg.norm(records[name].velocity - wanted) / np.linalg.norm(wanted)
    return away


def test_a_force_in_open_ground_is_injected_and_every_receiver_counts(force):
    assert "times the work for room around the sources" in force.meshed.reason
    assert resolved_receivers(force, tuple(OFFSETS)) == tuple(OFFSETS)
    assert max(errors(force).values()) < 0.01


@pytest.mark.long
def test_edges_shorten_around_a_force_as_far_as_the_work_allows(force, project):
    text = force.path.read_text().replace("frequency_hz = 40", "frequency_hz = 40\norder = 3")
    (force.folder / "low.toml").write_text(text)  # of too low an order to inject
    low = load_project(force.folder / "low.toml")
    assert "around the sources" in low.meshed.reason
    ratio = explicit_work(low.meshed.mesh) / explicit_work(project.meshed.mesh)
    assert 2.0 < ratio <= 12.0
    near = errors(low)
    for name in ("up 25", "east 40", "aside 60"):
        assert near[name] < 0.05, name


def test_one_times_the_work_and_a_diagnosis_leave_the_mesh_alone(force, project):
    fitted = force.changed(mesh=force.for_band(40.0))
    alone = project.changed(mesh=project.for_band(40.0))

    assert len(fitted.meshed.mesh.zones) == len(alone.meshed.mesh.zones)


def test_what_stands_against_an_injection_is_said(project):
    (finding,) = (f for f in check(project).findings if f.code == "D38")

    assert "Not injected: the absorbing layer lies less than an element" in finding.text


def test_receivers_near_a_source_count_in_no_fit(project):
    assert resolved_receivers(project, tuple(OFFSETS)) == ("east 40", "aside 60", "corner 100")
    assert resolved_receivers(project, ()) == ()
    with pytest.raises(InputError, match=r"receivers\.up 25: stands 25 m from a source.*beyond"):
        resolved_receivers(project, ("east 15", "up 25"))
