"""Case folders that are written are read again, as projects."""

import numpy as np
import pytest
from case_folder import write_folder
from small_site import recorded, small_site

from pyblast.project.case_folder import read_case_folder
from pyblast.project.flat_box import flat_box, not_flat
from pyblast.project.project import make_project


def test_a_site_comes_back_as_it_was(tmp_path):
    project = recorded(small_site()).project
    write_folder(tmp_path, project)
    again = read_case_folder(tmp_path)
    assert not not_flat(again)
    np.testing.assert_allclose(flat_box(again).box, flat_box(project).box)
    assert flat_box(again).planes == flat_box(project).planes
    assert again.joints[0].properties == project.joints[0].properties
    np.testing.assert_allclose(again.blasts["B1"].times, project.blasts["B1"].times)
    np.testing.assert_allclose(again.blasts["B1"].centres, project.blasts["B1"].centres)
    pulse = project.inside.moment_rate.values
    np.testing.assert_allclose(again.inside.moment_rate.values, pulse, rtol=1e-6)
    for name in project.of("B1").records:
        there, here = (p.of("B1").records[name].seismogram for p in (again, project))
        assert there.start == pytest.approx(here.start)
        np.testing.assert_allclose(there.velocity, here.velocity, rtol=1e-6, atol=1e-12)


def test_the_tables_of_a_case_folder_make_the_same_project_without_what_was_given(tmp_path):
    write_folder(tmp_path, recorded(small_site()).project)
    project = read_case_folder(tmp_path).of("B1")
    again = make_project(project.config, project.path)

    np.testing.assert_allclose(again.blast.times, project.blast.times)
    values = again.inside.moment_rate.values
    np.testing.assert_allclose(values, project.inside.moment_rate.values)
    assert again.joints[0].properties == pytest.approx(project.joints[0].properties)
    for name, record in project.records.items():
        np.testing.assert_array_equal(
            again.records[name].seismogram.velocity, record.seismogram.velocity
        )
        assert again.records[name].seismogram.start == record.seismogram.start


def test_a_site_without_joints_comes_back_without_joints(tmp_path):
    project = recorded(small_site()).project
    mesh = project.config.mesh.model_copy(update={"faults": []})
    write_folder(tmp_path, project.changed(mesh=mesh, joints=()))

    assert read_case_folder(tmp_path).joints == ()
