"""Case folders that are written are read again."""

from dataclasses import replace

import numpy as np
import pytest
from pyblast.project.site import read_site
from pyblast.project.site_file import write_site
from small_site import recorded, small_site

from pyblast import InputError
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.prediction import site_of


def test_a_site_comes_back_as_it_was(tmp_path):
    site = recorded(small_site()).site
    site = replace(site, time_zeros={name: "2024-05-01T10:00:00Z" for name in site.blasts})
    write_site(tmp_path, site)
    again = read_site(tmp_path)
    np.testing.assert_allclose(again.box, site.box)
    assert [j.position for j in again.joints] == [j.position for j in site.joints]
    assert again.joints[0].joint.properties == site.joints[0].joint.properties
    np.testing.assert_allclose(again.blasts["B1"].times, site.blasts["B1"].times)
    np.testing.assert_allclose(again.blasts["B1"].centres, site.blasts["B1"].centres)
    np.testing.assert_allclose(again.moment_rate.values, site.moment_rate.values, rtol=1e-6)
    for name in site.records["B1"]:
        there, here = (s.records["B1"][name].seismogram for s in (again, site))
        assert there.start == pytest.approx(here.start)
        np.testing.assert_allclose(there.velocity, here.velocity, rtol=1e-6, atol=1e-12)


def test_what_a_case_folder_cannot_say_is_refused(tmp_path):
    site = small_site()
    effect = Effect("joint_slip", "J1", ((2e5,), (0.5,)))
    slipping = site_of(site, np.zeros(4), [effect])
    with pytest.raises(InputError, match="only elastic joints"):
        write_site(tmp_path, slipping)


def test_a_site_without_joints_comes_back_without_joints(tmp_path):
    site = replace(recorded(small_site()).site, joints=())
    zeros = dict.fromkeys(site.blasts, "2024-05-01T10:00:00Z")

    write_site(tmp_path, replace(site, time_zeros=zeros))

    assert read_site(tmp_path).joints == ()
