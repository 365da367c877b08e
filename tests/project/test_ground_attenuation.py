"""Quality factors and low-passed damping in a project file."""

import numpy as np
import pytest
from small_project import written

from benchmarks.blind.flat_models import Discretization, flat_model
from examples.case_folder import write_projects
from pyblast.errors import InputError
from pyblast.ground.tables import quality_of
from pyblast.model.material import ConstantQ
from pyblast.project.checks import check
from pyblast.project.project import load_project

SOIL = "shear_mpa = 57.7"
FADING = "shear_mpa = 57.7\nqp = 20\nqs = 10\nquality_band_hz = [1, 40]"
CORNER = "frequency_hz = 4\ncorner_hz = 80"
LAGGED = "frequency_hz = 4\nlagged = true"


def test_quality_factors_make_a_material_that_fades(tmp_path):
    project = load_project(written(tmp_path, (SOIL, FADING)))

    assert project.materials["soil"].law == ConstantQ(20.0, 10.0, (1.0, 40.0))
    assert project.materials["rock"].law.name == "elastic"


def test_the_reference_of_the_speeds_can_be_given(tmp_path):
    path = written(tmp_path, (SOIL, FADING + "\nquality_reference_hz = 4"))

    assert load_project(path).materials["soil"].law.reference == 4.0


def test_damping_takes_its_corner(tmp_path):
    project = load_project(written(tmp_path, ("frequency_hz = 4", CORNER)))

    assert project.model.damping.corner == 80.0
    assert [one.rate for one in project.model.branches("soil")] == pytest.approx([160.0 * np.pi])


def test_stiffness_damping_is_low_passed_unless_told_otherwise(tmp_path):
    plain, lagged = (
        load_project(written(tmp_path, *changes)).model.damping
        for changes in ((), (("frequency_hz = 4", LAGGED),))
    )

    assert plain.corner == 60.0
    assert plain.beta == 0.0
    assert lagged.corner is None
    assert lagged.beta == pytest.approx(0.0112 / (8.0 * np.pi))


def test_mass_damping_alone_has_no_corner(tmp_path):
    alone = written(tmp_path, ("frequency_hz = 4", "frequency_hz = 4\nstiffness = false"))

    assert load_project(alone).model.damping.corner is None


def test_the_price_of_low_passed_damping_is_told(tmp_path):
    project = load_project(written(tmp_path))

    (found,) = (finding for finding in check(project).findings if finding.code == "D16")

    assert "low-passed at 60 Hz, leaves 0.93 of the step" in found.text


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (SOIL, SOIL + "\nqp = 20", "materials.soil: qs is missing; qp, qs, quality_band_hz"),
        (SOIL, SOIL + "\nquality_reference_hz = 4", "materials.soil: qp is missing"),
        (SOIL, FADING.replace("qs = 10", "qs = 1"), "materials.soil.qs: must be at least 2"),
        (SOIL, FADING.replace("[1, 40]", "[40, 1]"), "must rise from the lowest"),
        (SOIL, FADING.replace("qp = 20", "qp = 200"), "makes compression gain energy"),
        ("frequency_hz = 4", "frequency_hz = 4\ncorner_hz = 3", "corner_hz must exceed"),
        ("frequency_hz = 4", CORNER + "\nlagged = true", "give corner_hz or lagged = true"),
    ],
)
def test_values_that_do_not_fit_are_refused_in_one_sentence(tmp_path, old, new, told):
    with pytest.raises(InputError) as found:
        _ = load_project(written(tmp_path, (old, new))).model

    assert str(found.value).startswith("project.toml: ")
    assert told in str(found.value)
    assert "\n" not in str(found.value)


def test_ground_that_fades_can_be_damped_as_well(tmp_path):
    project = load_project(written(tmp_path, (SOIL, FADING), ("frequency_hz = 4", CORNER)))

    assert len(project.model.branches("soil")) == 6
    assert len(project.model.branches("rock")) == 1


def test_a_site_with_known_quality_fades_by_it_and_by_nothing_else(cases, tmp_path):
    site = load_project(write_projects(cases / "case-10", tmp_path))

    model = flat_model(site, "S1", Discretization(40.0))

    laws = {material.law for material in model.materials.values()}
    assert {(law.qp, law.qs) for law in laws} == {quality_of(site.materials)} == {(83.0, 54.0)}
    assert model.damping is None
