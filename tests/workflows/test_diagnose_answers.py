"""A diagnosis answers whatever fails on the way: what fails costs itself."""

import json
import os
import re
import signal
from dataclasses import replace

import numpy as np
import pytest
from library_scene import library_of
from small_fits import fits
from small_site import recorded, scene_of, small_site
from typer import Exit

from pyblast.cli.console import exit_codes
from pyblast.diagnosis import decision as deciding
from pyblast.diagnosis.decision import decide
from pyblast.diagnosis.effects import HOLES, Effect
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.search import Search, search
from pyblast.diagnosis.thresholds import LEAST_SCORE
from pyblast.errors import LostProcessError, contained
from pyblast.project.project import Project
from pyblast.simulation.simulation import Simulation
from pyblast.workflows import diagnose as workflow

CLOCK, LAYER, SENSOR = "clock_error", "soft_surface_layer", "sensor_orientation_or_polarity/turned"
SOFT = Effect(LAYER, "", ((5.0,), (0.4,)))
SLOWER = Effect("rock_speed", "rock", ((1.0,), (0.9,)))
SAID = "its computation failed (LinAlgError: Eigenvalues did not converge)"


def late(motion):
    """Let the clock of R2 be five samples slow."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 5, axis=-1)
    return motion


def without_layers(patch, error):
    """Let the mesh of a project with one layer more fail."""
    whole = Project._mesh_ground

    def mesh_ground(project):
        if len(project.config.mesh.layers) > 1:
            raise error
        return whole(project)

    patch.setattr(Project, "_mesh_ground", mesh_ground)


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Diagnose a slow clock where a mesh and a figure fail, ended by SIGTERM and taken up again."""
    out, site = tmp_path_factory.mktemp("out"), recorded(small_site(), change=late, fine=True)

    def progress(stage, *_):
        if stage == f"fit {CLOCK}" and os.environ.get("STOP"):
            os.kill(os.getpid(), signal.SIGTERM)

    def no_map(*_, **__):
        raise IndexError("no such axis")

    with pytest.MonkeyPatch.context() as patch, library_of([CLOCK, LAYER, SENSOR]):
        without_layers(patch, np.linalg.LinAlgError("Eigenvalues did not converge"))
        patch.setattr("pyblast.report.diagnosis.maps_figure", no_map)
        patch.setattr(workflow, "read_case", lambda _: site.project)
        patch.setattr(workflow, "_hash_of", lambda _: "input")
        patch.setattr(workflow, "_say_level", lambda *_: [])
        patch.setenv("STOP", "1")
        with pytest.raises(Exit) as stop, exit_codes():
            workflow.diagnose_case(out / "site.toml", out, progress=progress)
        patch.delenv("STOP")
        known = json.loads((out / "001" / workflow.STARTED).read_text())["known_so_far"]
        summary, folder = workflow.diagnose_case(out / "site.toml", out, progress=progress)
    page = (folder / workflow.REPORT).read_text()
    return stop.value.exit_code, known, summary, folder, page


@pytest.mark.long
def test_after_sigterm_what_is_known_is_readable(ended):
    code, known, *_ = ended

    assert code == 130
    assert known["scores"][CLOCK] > LEAST_SCORE
    assert known["largest_chi_square"] > 2.0
    assert known["runs"] > 0


def test_the_same_call_goes_on_and_leaves_the_answer_alone(ended):
    folder = ended[3]

    assert sorted(path.name for path in folder.iterdir()) == ["diagnosis.json", "report.html"]
    assert folder.name == "001"


def test_a_mesh_that_fails_costs_its_hypothesis_alone(ended):
    summary = ended[2]

    assert summary["outcome"] == "NAMED"
    assert summary["effects"][0]["label"] == CLOCK
    assert {"label": LAYER, "targets": [], "reason": SAID} in summary["not_testable"]


def test_a_figure_that_fails_costs_itself_and_is_named(ended):
    page = ended[4]
    titles = re.findall(r"<figcaption><b>([^<]*)[.]</b>", page)

    assert "In time and frequency" in titles
    assert "Evidence" in titles
    assert "In plan and section" not in titles
    assert "<dt>In plan and section</dt>" in page
    assert "no such axis" in page
    assert "The clock of receiver R2 was wrong" in page


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("NaN"), IndexError("7"), KeyError("J1")])
def test_a_state_that_fails_has_no_motion_and_those_beside_it_have(monkeypatch, error):
    scene = scene_of(recorded(small_site()))
    without_layers(monkeypatch, error)

    failed, slower = scene.simulate([(np.zeros(4), (SOFT,)), (np.zeros(4), (SLOWER,))], [0])

    assert failed is None
    assert np.isfinite(slower).all()
    assert str(error) in scene.failures[frozenset([(LAYER, "")])]


@pytest.mark.parametrize("error", [MemoryError(), LostProcessError("gone"), OSError("disk")])
def test_the_fault_of_the_machine_is_raised(error):
    with pytest.raises(type(error)), contained({}, "key"):
        raise error


def test_a_state_without_effects_that_fails_is_raised(monkeypatch):
    scene = scene_of(recorded(small_site()))
    monkeypatch.setattr(Simulation, "of", lambda *_: 1 / 0)

    with pytest.raises(ZeroDivisionError):
        scene.simulate([(np.full(4, 0.1), ())])


def test_a_target_that_fails_is_named_and_others_are_tried(monkeypatch):
    entry = LIBRARY[SENSOR]

    def apply(scene, motion, target, **parameters):
        changed = entry.apply(scene, motion, target, **parameters)
        return changed * np.nan if target == "R1" else changed

    monkeypatch.setitem(LIBRARY, SENSOR, replace(entry, apply=apply))

    with library_of([SENSOR]):
        result = search(scene_of(recorded(small_site(), change=late)))

    assert result.failed.keys() == {(SENSOR, "R1")}
    assert "not a finite number" in result.failed[SENSOR, "R1"]
    assert {member.target for member in result.scores.members} == {"R0", "R2", "R3"}


def test_lost_runs_of_single_holes_cost_the_effects_that_need_them():
    scene = scene_of(recorded(small_site()))
    scene.failures[HOLES] = "unstable"
    delays, clock = (
        (Effect("delay_scatter", "B1", ((0.0,) * 3,)),),
        (Effect("clock_error/blast", "B1", ((0.01,),)),),
    )

    with scene.contained(delays):
        scene.received(scene.baseline.motion, delays)

    assert "unstable" in scene.failures[frozenset([("delay_scatter", "B1")])]
    assert np.isfinite(scene.received(scene.baseline.motion, clock)).all()


def test_an_answer_without_its_finer_mesh_is_at_most_a_class(monkeypatch):
    scene, none, slow, loud, both = fits()
    monkeypatch.setattr(deciding, "on_finer_mesh", lambda *_: 1 / 0)
    monkeypatch.setattr(scene, "failures", {})

    found = Search(scene, lambda *_: None, none, [both, loud, slow], both)

    decision = decide(found, scene.simulation)

    assert decision.outcome in ("CLASS", "PARTIAL")
    assert decision.rivals == (*both.labels, deciding.RESOLUTION)
    assert list(scene.failures) == [deciding.FINER_MESH]
