"""The level of a project: peaks of a wrong source, unit or charge are named, others pass."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from small_project import INSIDE, written

from pyblast.blasts.blast import Blast
from pyblast.blasts.published_laws import BY_NAME, HARD_ROCK, plausible_ppv
from pyblast.blasts.signature import ground_peak
from pyblast.config.ground import BenchConfig
from pyblast.errors import InputError
from pyblast.model.material import Material
from pyblast.project import level
from pyblast.project.level import (
    Peak,
    SourceEnergy,
    anchoring_law,
    energy_finding,
    expected_peaks,
    frequency_words,
    implausible_level,
    incident_energy,
    input_peaks,
    level_findings,
    level_rank,
    moment_rate_words,
    off_its_law,
    on_crest,
    plausible_at,
    predicted_peak,
    radiated_energy,
    radiated_peak,
    simulated_peaks,
    source_energy,
)
from pyblast.project.project import load_project
from pyblast.signals.seismogram import Seismogram
from pyblast.sources.inside import charge_depth

HOUSE = (52.0, 10.0, 30.0)
ALONE = ("holes_per_row = 3", "holes_per_row = 1")
LAW = ("pressure_mpa = 100", 'law = "AS 2187.2-1993"\ndistance_m = 40')


def finding_of(path):
    project = load_project(path)
    return level_findings(project, expected_peaks(project))


@pytest.mark.parametrize(
    ("given", "assumed"),
    [(("peak_time_ms = 40\n", ""), True),
     (("peak_time_ms = 40", "frequency_hz = 12"), False),
     (("radius_m = 0.5", "radius_m = 0.5"), False)],
)  # fmt: skip
def test_a_frequency_that_nobody_gave_is_said_beside_the_limits(tmp_path, given, assumed):
    words = frequency_words(load_project(written(tmp_path, given, text=INSIDE)))

    assert ("20 Hz assumed for each hole" in words) == assumed
    assert bool(words) == assumed


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
    assert expected_peaks(project) == ()


def test_a_level_by_a_law_is_the_one_of_the_law_before_the_run(tmp_path):
    project = load_project(written(tmp_path, ALONE, LAW, text=INSIDE))

    wanted = BY_NAME["AS 2187.2-1993"].ppv(40.0, 50.0)
    assert radiated_peak(project, 40.0) == pytest.approx(wanted, rel=0.1)
    assert finding_of(project.path) == ()


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
    ("pressure", "radius", "words"), [("1", "0.5", "too low"), ("1e6", "5", "too high")]
)
def test_holes_inside_far_off_are_named_before_the_run(tmp_path, pressure, radius, words):
    changes = ("pressure_mpa = 100", f"pressure_mpa = {pressure}"), ("= 0.5", f"= {radius}")
    (found,) = finding_of(written(tmp_path, *changes, text=INSIDE))

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
    depth = charge_depth(project.config, project.blast)
    return 50.0 * ground_peak(rate, distance, depth, rock)


def test_without_a_level_the_hole_has_that_of_the_law_for_hard_rock_at_the_receivers(tmp_path):
    project = load_project(written(tmp_path, ("pressure_mpa = 100\n", ""), text=INSIDE))

    (receiver,) = project.config.receivers
    middle, top = project.blast.centres.mean(axis=0), project.blast.collar[:, 2].mean()
    distance = math.dist([*receiver.position_m, top][:3], middle)
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
    assert project.shot.highest_frequency <= carried
    assert inside.low_pass < carried
    peak = BY_NAME["Oriard 1972"].ppv(40.0, 50.0)
    assert peak_at(project, 40.0) == pytest.approx(peak, rel=1e-9)
    # The filter passes the moment at zero frequency as it is: it lifts no level.
    low, whole = (rate.integral().values for rate in (inside.moment_rate, inside.unfiltered))
    assert low.sum() == pytest.approx(whole.sum(), rel=1e-3)
    # Its delay is taken back, so that motion is at physical time.
    assert inside.moment_rate.start == pytest.approx(-0.336 / inside.low_pass, rel=2e-3)
    assert "low-passed at" in moment_rate_words(project)


def test_a_pulse_that_the_mesh_carries_stays_as_it_is(tmp_path):
    slow = ("peak_time_ms = 40", "peak_time_ms = 200")

    project = load_project(written(tmp_path, slow, text=INSIDE))

    assert project.inside.low_pass is None
    assert project.inside.moment_rate.start == 0.0


def at_site(folder, *changes):
    """Write three delayed holes with a level by a law 40 m away, in rock alone."""
    level = ("pressure_mpa = 100", 'law = "AS 2187.2-1993"\ndistance_m = 40')
    return written(folder, level, *changes, text=INSIDE)


def test_each_receiver_is_predicted_by_the_law_that_sets_the_level(tmp_path):
    project = load_project(at_site(tmp_path))
    law = BY_NAME["AS 2187.2-1993"]

    predicted = predicted_peak(project, HOUSE)

    window = project.blast.strongest_window(HOUSE)
    assert predicted == pytest.approx(law.ppv(*window))
    assert plausible_at(project, HOUSE).laws == (law.name,)  # stated, so it alone
    assert anchoring_law(project) is law


def test_a_level_by_a_peak_is_carried_on_by_the_slope_for_hard_rock(tmp_path):
    peak = ("pressure_mpa = 100", "peak_mm_per_s = 12\ndistance_m = 40")
    project = load_project(written(tmp_path, peak, text=INSIDE))

    law = anchoring_law(project)

    assert law.ppv(40.0, 50.0) == pytest.approx(0.012)
    assert law.beta == HARD_ROCK.beta
    assert len(plausible_at(project, HOUSE).laws) > 1


def test_a_pressure_has_no_law(tmp_path):
    project = load_project(written(tmp_path, text=INSIDE))

    assert anchoring_law(project) is None
    assert predicted_peak(project, HOUSE) is None


@pytest.mark.parametrize(
    ("factor", "failed"), [(1.9, None), (0.55, None), (2.1, False), (0.4, False), (3.1, True),
                           (0.3, True)]
)  # fmt: skip
def test_a_factor_of_two_from_the_law_is_named_and_one_of_three_fails(tmp_path, factor, failed):
    project = load_project(at_site(tmp_path))
    predicted = predicted_peak(project, HOUSE)
    peak = Peak("house", factor * predicted, None, predicted=predicted)

    result = off_its_law(project, [peak])

    assert (None if result is None else result.failed) is failed


def test_an_incomplete_run_is_judged_where_it_is_too_high_alone(tmp_path):
    project = load_project(at_site(tmp_path))
    predicted = predicted_peak(project, project.receivers[0].position)

    def peaks(factor, complete):
        motion = Seismogram(np.outer(np.hanning(99), [factor * predicted, 0.0, 0.0]), 1e-3)
        return simulated_peaks(project, {"house": motion}, complete)

    assert peaks(0.1, False) == []
    assert len(peaks(0.1, True)) == len(peaks(4.0, False)) == 1


def test_pulses_that_overlap_are_said_to_be_off_the_law_before_the_run(tmp_path):
    """Fifteen delayed holes become one slow pulse, as the low-pass made of a fast one."""
    slow = ("peak_time_ms = 40", "frequency_hz = 2")
    many = ("rows = 1", "rows = 15"), ("burden_m = 3", "burden_m = 0.1")

    project = load_project(at_site(tmp_path, ALONE, slow, *many))

    result = off_its_law(project, expected_peaks(project))

    assert result.failed
    assert "overlap" in result.text
    assert min(result.numbers.values()) > 3.0


ROCK = Material.from_speeds(2700.0, 5000.0, 3000.0)


@pytest.mark.parametrize(
    ("along", "speed"), [((1.0, 0.0, 0.0), ROCK.cp), ((0.0, 0.6, 0.8), ROCK.cs)]
)
def test_a_plane_wave_carries_the_energy_of_its_closed_form(along, speed):
    pulse = 0.5 * np.sin(np.linspace(0.0, np.pi, 1001))[:, None] * along

    energy = incident_energy(Seismogram(pulse, 1e-4), [(1e4, ROCK)])

    assert energy == pytest.approx(1e4 * ROCK.density * speed * 0.25 * 0.05, rel=1e-6)


def test_a_moment_radiates_what_flows_through_a_far_sphere():
    """Aki & Richards (2002), 4.29: far P and S waves of a tensor, integrated over directions."""
    tensor = np.array([[2.0, 0.3, 0.0], [0.3, -1.0, 0.4], [0.0, 0.4, 0.5]])
    rng = np.random.default_rng(0)
    ray = rng.normal(size=(200_000, 3))
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    traction = ray @ tensor
    along = np.einsum("ni,ni->n", traction, ray)
    across = traction - along[:, None] * ray
    square = 4.0 * math.pi * ROCK.density
    flux_p = ROCK.density * ROCK.cp * along**2 / (square * ROCK.cp**3) ** 2
    flux_s = ROCK.density * ROCK.cs * (across**2).sum(axis=1) / (square * ROCK.cs**3) ** 2
    slope = np.sin(np.linspace(0.0, np.pi, 1001))

    energy = radiated_energy(slope, 1e-3, tensor, ROCK)

    sphere = 4.0 * math.pi * float((flux_p + flux_s).mean())
    assert energy == pytest.approx(sphere * 1e-3 * float((slope**2).sum()), rel=0.01, abs=0.0)


def test_the_energy_of_a_hole_is_what_its_far_motion_carries(tmp_path):
    """E = 4 pi density cp R^2 integral v^2 dt, v = M''/(4 pi density cp^3 R) far away."""
    far = ("distance_m = 40", "distance_m = 2000")
    path = at_site(tmp_path, ALONE, ("peak_time_ms = 40", "frequency_hz = 8"))
    path.write_text(path.read_text().replace(*far))
    project = load_project(path)
    rock, rate = project.materials["rock"], project.inside.moment_rate
    slope = 50.0 * np.gradient(rate.values, rate.dt)
    motion = slope / (4.0 * math.pi * rock.density * rock.cp**3 * 2000.0)

    energy = source_energy(project)

    square = rate.dt * float(np.sum(motion**2))
    carried = 4.0 * math.pi * rock.density * rock.cp * 2000.0**2 * square
    assert project.inside.low_pass is None
    assert energy.put_in == pytest.approx(carried, rel=0.03)
    assert energy.explosive == pytest.approx(50.0 * 3.8e6)


@pytest.mark.parametrize(("share", "failed"), [(0.09, None), (0.11, False), (0.21, True)])
def test_more_than_a_tenth_of_the_explosive_is_named_and_a_fifth_fails(share, failed):
    result = energy_finding(SourceEnergy(share * 4e9, 4e9))

    assert (None if result is None else result.failed) is failed
    assert energy_finding(SourceEnergy(1e12, None)) is None


def test_after_a_run_the_energy_is_the_work_of_its_sources(tmp_path):
    project = load_project(at_site(tmp_path))

    energy = source_energy(project, np.array([0.0, 5e6, 2e6]))

    assert (energy.put_in, energy.returned) == (2e6, 3e6)
    assert energy.table()["explosive_j"] == pytest.approx(150.0 * 3.8e6)


def test_a_receiver_within_the_height_of_a_bench_of_its_crest_stands_on_it():
    bench = BenchConfig(crest_m=[[60.0, 0.0, 0.0], [60.0, 90.0, 0.0]], height_m=15.0)

    assert on_crest([bench], (50.0, 45.0, 0.0))
    assert not on_crest([bench], (44.0, 45.0, 0.0))
    assert not on_crest([bench], (60.0, 110.0, 0.0))
    assert not on_crest([], (60.0, 45.0, 0.0))


def test_a_crest_that_moves_more_than_the_law_is_named_and_does_not_fail():
    law = SimpleNamespace(name="law")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(level, "anchoring_law", lambda _: law)
        peaks = [Peak("crest", 0.040, None, predicted=0.010, on_crest=True)]

        crest = off_its_law(None, peaks)
        flat = off_its_law(None, [peaks[0]._replace(on_crest=False)])

    assert not crest.failed
    assert "At crest, beside the crest of a bench" in crest.text
    assert flat.failed
