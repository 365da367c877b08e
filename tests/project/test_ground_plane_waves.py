"""Keys by which a motion enters a project: plane waves, free-field sides, and their checks."""

import math

import numpy as np
import pytest
from small_project import written

from pyblast import FreeField, InputError, PlaneWave, StressInput, check, load_project
from pyblast.solver.preparation import prepare

ALL = 'viscous = ["west", "east", "south", "north", "bottom"]'
BELOW = (ALL, 'viscous = ["bottom"]\nfree_field = ["south", "north", "east", "west"]')
FROM_BOTTOM = ("[input]\n", '[input]\nface = "bottom"\n')
WAVE = (
    "[input]\n",
    '[input]\nenters_as = "plane_wave"\nwave = "P"\nazimuth_deg = 90\ninclination_deg = 30\n',
)
ONE_ROCK = ('material = "soil"\nthickness_m = 10\n[[mesh.layers]]\n', "")
NO_FAULT = (
    '[[mesh.faults]]\nname = "F1"\ndip_deg = 90\ndip_direction_deg = 90\nthrough_m = [30, 0, 0]\n',
    "",
)


def load(folder, *changes):
    return load_project(written(folder, *changes))


@pytest.fixture
def whole(tmp_path):
    """Return a function that loads the small project without its fault."""
    joint = (
        '[joints.F1]\nlaw = "coulomb"\nkn_gpa_per_m = 0.114\nks_gpa_per_m = 0.025\n'
        "cohesion_kpa = 20\nfriction_angle_deg = 25\ntension_kpa = 0\n",
        "",
    )
    assumed = ('assumed = ["signature.cavity", "joints.F1.cohesion_kpa"]\n', "")
    return lambda *changes: load(tmp_path, NO_FAULT, joint, assumed, *changes)


def test_a_plane_wave_carries_the_motion_along_its_polarisation(whole):
    project = whole(WAVE)

    (wave,) = (source for source in project.model.sources if isinstance(source, PlaneWave))

    motion = project.input.motion
    along = motion.velocity @ [math.sin(math.pi / 6), 0.0, math.cos(math.pi / 6)]
    assert wave.history.values == pytest.approx(along, abs=1e-15)
    assert wave.history.start == pytest.approx(motion.start + project.lead)
    assert not any(isinstance(b, StressInput) for b in project.model.boundaries)


def test_a_plane_wave_through_layers_is_refused_before_the_run(whole):
    with pytest.raises(InputError, match="needs one medium behind"):
        prepare(whole(WAVE).model, 0.01)


def test_a_plane_wave_marches_in_one_rock(whole):
    prepared = prepare(whole(WAVE, ONE_ROCK).model, 0.02)

    assert np.abs(prepared.constants["load_vector"]).max() > 0.0


def test_sides_in_the_list_free_field_are_viscous_and_see_columns(whole):
    model = whole(BELOW, FROM_BOTTOM).model

    free = [b.surface for b in model.boundaries if isinstance(b, FreeField)]
    assert free == ["south", "north", "east", "west"]
    assert len(prepare(model, 0.02).constants["history"][0]) > 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("[input]\n", '[input]\nenters_as = "plane_wave"\n')], "input: wave is missing beside"),
        ([("[input]\n", '[input]\nwave = "P"\n')], "wave needs enters_as = 'plane_wave'"),
        ([BELOW, WAVE], "all viscous sides see a plane wave; move these to viscous"),
        ([(ALL, f'{ALL}\nfree_field = ["west"]')], "'west' stands in two lists"),
    ],
)
def test_keys_that_do_not_go_together_are_refused(whole, changes, message):
    with pytest.raises(InputError, match=message):
        whole(*changes)


def d23(project):
    return [f for f in check(project, False).findings if f.code == "D23"]


def test_the_check_names_the_cure_for_sides_that_drain_input_from_below(whole):
    (finding,) = d23(whole(FROM_BOTTOM))

    assert "name these sides in boundaries.free_field" in finding.text


def test_free_field_sides_and_plane_waves_drain_nothing(whole):
    assert d23(whole(BELOW, FROM_BOTTOM)) == []
    assert d23(whole(WAVE, ONE_ROCK)) == []
