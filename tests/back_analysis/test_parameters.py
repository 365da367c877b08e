"""Unknowns addressed by keys: values reach the model in SI, and wrong keys are refused."""

import pytest
from small_project import written

from pyblast.back_analysis.parameters import check_parameters
from pyblast.errors import InputError
from pyblast.inference.parameter import Parameter, set_all
from pyblast.project.project import load_project

KN = "joints.F1.kn_gpa_per_m"


@pytest.fixture
def project(tmp_path):
    return load_project(written(tmp_path))


@pytest.mark.parametrize(
    ("path", "value", "found", "wanted"),
    [
        (KN, 0.2, lambda p: p.model.joints[0].properties["kn"], 2e8),
        ("damping.ratio", 0.03, lambda p: p.model.damping.ratio, 0.03),
        ("materials.rock.young_mpa", 9000.0, lambda p: p.materials["rock"].young, 9e9),
        ("mesh.layers.soil.thickness_m", 20.0, lambda p: p.config.mesh.layers[0].thickness_m, 20.0),
        ("blast.delay_ms", 25.0, lambda p: p.firing.times.max(), 0.075),
        ("mesh.faults.F1.dip_deg", 60.0, lambda p: p.config.mesh.faults[0].dip_deg, 60.0),
    ],
)
def test_a_value_reaches_its_place_in_si(project, path, value, found, wanted):
    varied = set_all(project, [Parameter(path, 0.1, 1e5)], [value])

    assert found(varied) == pytest.approx(wanted, rel=1e-12)


def test_the_scale_of_the_source_multiplies_the_motion_that_enters(project):
    varied = set_all(project, [Parameter("signature.scale", 0.5, 2.0)], [1.5])

    assert varied.input.motion.ppv == pytest.approx(1.5 * project.input.motion.ppv, rel=1e-12)


def test_joints_and_damping_keep_the_mesh_of_the_model(project):
    mesh = project.model.mesh
    parameters = [Parameter(KN, 0.01, 0.5), Parameter("damping.ratio", 0.005, 0.05)]

    assert set_all(project, parameters, [0.3, 0.02]).model.mesh is mesh


def test_a_varied_model_is_the_one_that_the_changed_file_gives(project, tmp_path):
    assert project.model is not None
    varied = set_all(project, [Parameter(KN, 0.01, 0.5)], [0.3]).model
    other = load_project(written(tmp_path, ("kn_gpa_per_m = 0.114", "kn_gpa_per_m = 0.3"))).model

    assert varied.joints == other.joints
    assert varied.damping == other.damping
    assert (varied.mesh.zones == other.mesh.zones).all()


def test_materials_keep_the_split_mesh_of_the_project(project):
    mesh = project.mesh

    varied = set_all(project, [Parameter("materials.rock.young_mpa", 1e3, 1e5)], [9000.0])

    assert varied.mesh is mesh


@pytest.mark.parametrize(
    ("parameter", "match"),
    [
        (Parameter("joints.F1.kn", 0.1, 1.0), "did you mean 'joints.F1.kn_gpa_per_m'"),
        (Parameter("joints.F9.kn_gpa_per_m", 0.1, 1.0), "must name one number"),
        (Parameter("title", 0.1, 1.0), "must name one number"),
        (Parameter("damping.ratio", 0.1, 1.5), "high: project.toml: damping.ratio: must be below"),
        (Parameter(KN, -0.1, 1.0), "low: project.toml: joints.F1.kn_gpa_per_m: must be pos"),
        (Parameter("blast.rows", 1.5, 2.5), "low: project.toml: blast.rows: must be a whole num"),
    ],
)
def test_a_wrong_key_or_range_is_refused_with_its_name(project, parameter, match):
    with pytest.raises(InputError, match=match):
        check_parameters(project, [parameter])


def test_a_key_given_twice_is_refused(project):
    with pytest.raises(InputError, match="given twice"):
        check_parameters(project, [Parameter(KN, 0.1, 1.0), Parameter(KN, 0.1, 1.0)])


@pytest.mark.parametrize(
    ("numbers", "match"),
    [((1.0, 0.1), "low must be below high"), ((0.0, 1.0, True), "must be positive")],
)
def test_a_range_that_is_none_is_refused(numbers, match):
    with pytest.raises(InputError, match=match):
        Parameter(KN, *numbers)
