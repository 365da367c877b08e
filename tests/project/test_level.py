"""The level of a project: peaks of a wrong source, unit or charge are named, others pass."""

import math

import numpy as np
import pytest
from small_project import INSIDE, written

from pyblast.blasts.blast import Blast
from pyblast.blasts.published_laws import BY_NAME, HARD_ROCK, plausible_ppv
from pyblast.blasts.signature import moment_velocity
from pyblast.errors import InputError
from pyblast.project.inputs import input_band
from pyblast.project.level import (
    Peak,
    expected_peaks,
    implausible_level,
    input_peaks,
    level_findings,
    level_rank,
    moment_rate_words,
    plausible_at,
    radiated_peak,
)
from pyblast.project.project import load_project

HOUSE = (52.0, 10.0, 30.0)
ALONE = ("holes_per_row = 3", "holes_per_row = 1")
LAW = ("pressure_mpa = 100", 'law = "AS 2187.2-1993"\ndistance_m = 40')


def finding_of(path):
    project = load_project(path)
    return level_findings(project, expected_peaks(project))


def blast(times, charge, east):
    places = np.column_stack([east, np.zeros(len(east)), np.zeros(len(east))])
    return Blast("B", places, places, charge, times)


def test_the_window_counts_what_fires_within_8_ms():
    holes = blast([0.0, 0.007, 0.008], [10.0, 20.0, 30.0], [0.0, 0.0, 0.0])

    assert holes.strongest_window([100.0, 0.0, 0.0]) == pytest.approx((100.0, 50.0))


def test_a_near_small_charge_may_be_the_strongest():
    holes = blast([0.0, 0.1], [100.0, 4.0], [0.0, 190.0])

    assert holes.strongest_window([200.0, 0.0, 0.0]) == pytest.approx((10.0, 4.0))


@pytest.mark.parametrize("charge", [[math.nan, 10.0], [0.0, 0.0]])
def test_holes_without_known_charge_have_no_window(charge):
    assert blast([0.0, 0.1], charge, [0.0, 0.0]).strongest_window([9.0, 0.0, 0.0]) is None


def test_the_window_is_the_charge_of_the_blast():
    times, charge = [0.0, 0.004, 0.02, 0.024, 0.029], [5.0, 6.0, 7.0, 0.0, 9.0]
    holes = blast(times, charge, np.zeros(5))

    assert holes.strongest_window([50.0, 0, 0])[1] == pytest.approx(holes.charge_per_window())


def test_the_range_at_a_receiver_is_that_of_its_window(tmp_path):
    project = load_project(written(tmp_path, text=INSIDE))

    plausible = plausible_at(project, HOUSE)

    assert plausible.charge == 150.0  # three holes at once
    assert 30.0 < plausible.distance < 45.0


def test_forces_alone_have_no_range(tmp_path):
    (tmp_path / "blow.csv").write_text("time_s,force_kn\n0,0\n0.01,1\n0.02,0\n")
    head, tail = INSIDE.split("[blast]")[0], INSIDE.split("peak_time_ms = 40\n")[1]
    force = '[[point_forces]]\nposition_m = [10, 10]\ndirection = [0, 0, 1]\nfile = "blow.csv"\n'

    project = load_project(written(tmp_path, text=head + force + tail))

    assert plausible_at(project, HOUSE) is None
    assert expected_peaks(project) == []


def test_a_level_by_a_law_is_the_one_of_the_law_before_the_run(tmp_path):
    project = load_project(written(tmp_path, ALONE, LAW, text=INSIDE))

    wanted = BY_NAME["AS 2187.2-1993"].ppv(40.0, 50.0)
    assert radiated_peak(project, 40.0) == pytest.approx(wanted, rel=0.1)
    assert expected_peaks(project) == []


def test_a_level_by_a_peak_is_the_one_of_the_peak(tmp_path):
    level = ("pressure_mpa = 100", "peak_mm_per_s = 12\ndistance_m = 40")

    project = load_project(written(tmp_path, ALONE, level, text=INSIDE))

    assert radiated_peak(project, 40.0) == pytest.approx(0.012, rel=0.1)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("pressure_mpa = 9\nlaw = 'Oriard 1972'", "give pressure_mpa or law, not both"),
        ("peak_mm_per_s = 9", "distance_m is missing beside peak_mm_per_s"),
        ("pressure_mpa = 9\ndistance_m = 9", "distance_m goes with a peak or a law"),
        ("law = 'USBM'\ndistance_m = 9", "law: must be one of Oriard 1972, .*, got 'USBM'"),
    ],
)
def test_two_levels_or_half_of_one_are_refused(tmp_path, keys, message):
    with pytest.raises(InputError, match=message):
        load_project(written(tmp_path, ("pressure_mpa = 100", keys), text=INSIDE))


@pytest.mark.parametrize(
    ("pressure", "words"), [("pressure_mpa = 1", "too low"), ("pressure_mpa = 1e9", "too high")]
)
def test_holes_inside_far_off_are_named_before_the_run(tmp_path, pressure, words):
    (found,) = finding_of(written(tmp_path, ("pressure_mpa = 100", pressure), text=INSIDE))

    assert words in found.title
    assert found.failed
    assert "peak_mm_per_s and distance_m" in found.text
    assert list(found.numbers) == ["house, estimated"]


def test_a_single_hole_by_the_default_law_is_plausible(tmp_path):
    assert finding_of(written(tmp_path)) == ()


@pytest.mark.parametrize(("peak", "words"), [("0.05", "too low"), ("50000", "too high")])
def test_a_single_hole_a_hundred_times_off_is_named(tmp_path, peak, words):
    change = ("radius_m = 3", f"radius_m = 3\npeak_mm_per_s = {peak}")

    (found,) = finding_of(written(tmp_path, change))

    assert words in found.title
    assert "single hole" in found.numbers
    assert "leave out both" in found.text


def test_a_named_law_sets_the_level_of_the_closed_form(tmp_path):
    change = ("radius_m = 3", 'radius_m = 3\nlaw = "AS 2187.2-2006"')
    plain, named = (load_project(written(tmp_path, *x)) for x in ([], [change]))

    ratio = named.signature.ppv / plain.signature.ppv

    assert ratio == pytest.approx(1140.0 / 500.0)


def test_the_scale_of_a_signature_counts(tmp_path):
    change = ("[signature.cavity]", "[signature]\nscale = 0.001\n[signature.cavity]")

    hole = input_peaks(load_project(written(tmp_path, change)))[0]

    assert hole.name == "single hole times 0.001"
    assert hole.excess < 0.05


@pytest.mark.parametrize(
    ("factor", "hint"), [(1e-3, "m/s read as mm/s"), (1e3, "mm/s read as m/s")]
)
def test_a_record_in_another_unit_is_said_to_be_one(factor, hint):
    plausible = plausible_ppv(120.0, 60.0)
    peak = Peak("house, recorded", 0.009 * factor, plausible, recorded=True)

    found = implausible_level([peak], "Check the source.")

    assert hint in found.text
    assert "Check the source" not in found.text
    assert found.failed


def test_inches_read_as_millimetres_are_outside_and_do_not_fail():
    plausible = plausible_ppv(120.0, 60.0)

    found = implausible_level([Peak("house, recorded", 0.009 / 25.4, plausible, True)])

    assert not found.failed
    assert "Check the unit of the record," in found.text


def test_plausible_peaks_and_those_without_a_law_are_no_finding():
    plausible = plausible_ppv(120.0, 60.0)

    assert implausible_level([Peak("a", 0.009, plausible), Peak("b", 1e-9, None)]) is None


def test_many_peaks_outside_are_counted_and_the_worst_come_first():
    plausible = plausible_ppv(120.0, 60.0)
    peaks = [Peak(f"R{n}", 10.0**-n, plausible) for n in range(4, 9)]

    found = implausible_level(peaks)

    assert found.text.startswith("R8: ")
    assert "and 2 more" in found.text
    assert len(found.numbers) == 5


def test_no_motion_at_all_is_outside():
    found = implausible_level([Peak("house", 0.0, plausible_ppv(120.0, 60.0))])

    assert "0 mm/s, no motion" in found.text
    assert found.failed


def peak_at(project, distance):
    """Return the velocity on the ground at a distance of one hole of the project, m/s."""
    inside, rock = project.inside, project.materials["rock"]
    rate = inside.unfiltered or inside.moment_rate
    motion = moment_velocity(rate.values, rate.dt, distance, rock.density, rock.cp)
    return 2.0 * 50.0 * np.abs(motion).max()


def test_without_a_level_the_hole_has_that_of_the_law_for_hard_rock_at_the_receivers(tmp_path):
    project = load_project(written(tmp_path, ("pressure_mpa = 100\n", ""), text=INSIDE))

    (receiver,) = project.config.receivers
    middle = project.blast.centres[:, :2].mean(axis=0)
    distance = math.dist(receiver.position_m[:2], middle)
    assert peak_at(project, distance) == pytest.approx(HARD_ROCK.ppv(distance, 50.0), rel=1e-9)
    assert finding_of(project.path) == ()
    assert level_rank(project)["rank_of_trust"] == 3


def test_a_law_of_the_site_goes_before_a_published_one_and_scales_the_hole(tmp_path):
    law = "distance_m = 40\nsite_law = { k_mm_per_s = 700, exponent = 1.4 }\n"
    project = load_project(written(tmp_path, ("pressure_mpa = 100\n", law), text=INSIDE))

    assert peak_at(project, 40.0) == pytest.approx(0.7 * (40.0 / 50.0**0.5) ** -1.4, rel=1e-9)
    assert level_rank(project)["rank_of_trust"] == 2
    assert "(R/W^0.5)^-1.4 at 40 m" in moment_rate_words(project)


def test_a_law_sets_the_level_before_the_low_pass(tmp_path):
    change = ("pressure_mpa = 100\n", "distance_m = 40\nlaw = 'Oriard 1972'\n")
    short = ("peak_time_ms = 40", "peak_time_ms = 1")
    assert short[0] in INSIDE

    project = load_project(written(tmp_path, change, short, text=INSIDE))

    inside = project.inside
    carried = min(project.model.highest_frequency().values())
    assert input_band(project) <= carried
    assert inside.low_pass < carried
    peak = BY_NAME["Oriard 1972"].ppv(40.0, 50.0)
    assert peak_at(project, 40.0) == pytest.approx(peak, rel=1e-9)
    # The filter passes the moment at zero frequency as it is: it lifts no level.
    low, whole = (rate.integral().values for rate in (inside.moment_rate, inside.unfiltered))
    assert low.sum() == pytest.approx(whole.sum(), rel=1e-3)
    assert inside.moment_rate.start == 0.0
    assert "low-passed at" in moment_rate_words(project)


def test_a_pulse_that_the_mesh_carries_stays_as_it_is(tmp_path):
    slow = ("peak_time_ms = 40", "peak_time_ms = 200")

    project = load_project(written(tmp_path, slow, text=INSIDE))

    assert project.inside.low_pass is None
    assert project.inside.moment_rate.start == 0.0
