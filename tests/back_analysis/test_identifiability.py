"""What records could tell: closed answers, then plans of a small project."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import call
from small_project import CARRIED, INSIDE, written

from pyblast import design_survey, load_project
from pyblast.back_analysis.identifiability import (
    UNIFORM,
    FisherInformation,
    Sensitivities,
    posterior_intervals,
)
from pyblast.back_analysis.survey_design import (
    survey_receivers,
    with_receivers,
    without_uncertain,
)
from pyblast.back_analysis.waveforms import Window
from pyblast.errors import InputError
from pyblast.inference.nuisances import DESIGN_LEVELS
from pyblast.inference.records import band_functions, white_noise
from pyblast.report.survey_design import beside_laboratory

WINDOW = Window((5.0, 20.0), 1.0 / 160.0, 160)
RMS = 1e-4
RIGHT = dict.fromkeys(DESIGN_LEVELS, 0.0)  # a theory without errors
RANGES = {
    "joints.F1.ks_gpa_per_m": (0.005, 0.1),
    "damping.ratio": (0.005, 0.05),
    "joints.F1.friction_angle_deg": (20, 40),
}
SECOND = """
[[receivers]]
name = "R2"
position_m = [5, 10]
[[receivers]]
name = "R3"
position_m = [45, 10]

[run]
"""


def pulse(hertz, at):
    times = WINDOW.dt * np.arange(WINDOW.n_samples)
    return np.exp(-0.5 * ((times - at) / 0.08) ** 2) * np.cos(2.0 * np.pi * hertz * (times - at))


def heard(changes, levels=RIGHT):
    """Sensitivities (n, n_receivers, n_samples) of one blast, first component only."""
    changes = np.asarray(changes)
    whole = np.zeros((len(changes), 1, changes.shape[1], 3, WINDOW.n_samples))
    whole[:, 0, :, 0] = changes
    motion = np.zeros(whole.shape[1:])
    motion[:] = 1e-2 * pulse(10.0, 0.5)
    noise = white_noise(RMS, changes.shape[1], WINDOW.band, WINDOW.dt, WINDOW.n_samples)
    band = band_functions(WINDOW.n_samples, WINDOW.dt, WINDOW.band)
    return Sensitivities(motion, whole, band, noise, levels)


def table(folder, *, ranges=RANGES, run="duration_s = 0.4", **keys):
    """Write a project without records, with two receivers and a candidate; return its path."""
    keys = {"misfit": "waveform", "receivers": ["R1", "R2"]} | keys
    path = written(
        folder, *CARRIED[:2], ("low_pass_hz = 20", "low_pass_hz = 15"),
        ("duration_s = 0.1", run), ("cohesion_kpa = 20", "cohesion_kpa = 500"),
        ("tension_kpa = 0", "tension_kpa = 1e6"), ("\n[run]\n", SECOND),
    )  # fmt: skip
    lines = ["[back_analysis]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    for name, (low, high) in ranges.items():
        lines += ["[[back_analysis.parameters]]", f'path = "{name}"', "log = true"]
        lines += [f"low = {low}", f"high = {high}"]
    path.write_text(path.read_text() + "\n".join(lines) + "\n")
    return path


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    other = folder / "stronger.toml"
    path = table(folder, candidate_blasts=["stronger.toml"], candidate_grid=[3, 1])
    text = path.read_text().split("[back_analysis]")[0]
    other.write_text(text.replace("delay_ms = 40", "delay_ms = 25"))
    return design_survey(path)


def test_one_unknown_keeps_one_over_root_of_one_plus_its_information():
    assert FisherInformation(np.array([[8.0]])).ratios == pytest.approx([1.0 / 3.0])


def test_two_unknowns_that_do_the_same_keep_their_difference():
    same = FisherInformation(100.0 * np.ones((2, 2)))

    # 1/(1 + 200) of the sum, all of the difference
    assert same.ratios == pytest.approx(2 * [np.sqrt(0.5 * (1.0 + 1.0 / 201.0))])
    assert same.trade_offs() == [(0, 1, pytest.approx(-200.0 / 202.0))]


def test_independent_unknowns_do_not_trade_off():
    assert FisherInformation(np.diag([3.0, 8.0])).trade_offs() == []


def test_the_posterior_of_a_linear_model_in_white_noise_is_that_of_least_squares():
    changes = np.array([[5e-4 * pulse(10.0, 0.4)], [3e-4 * pulse(13.0, 0.45)]])
    found = heard(changes).information([0], [0])

    held = changes[:, 0] @ band_functions(WINDOW.n_samples, WINDOW.dt, WINDOW.band).basis
    density = RMS**2 / (2.0 * 15.0)
    # the covariance has 2 % more on its diagonal, and leaks a little at the edges of the band
    wanted = UNIFORM**2 * held @ held.T / (density / WINDOW.dt * 1.02)
    assert found.matrix == pytest.approx(wanted, rel=0.03)


def test_errors_of_the_theory_leave_less_to_be_told():
    changes = np.array([[5e-4 * pulse(10.0, 0.4)]])

    sure, usual = (
        heard(changes, levels).information([0], [0]) for levels in (RIGHT, DESIGN_LEVELS)
    )
    assert usual.matrix[0, 0] < sure.matrix[0, 0]


def test_a_second_receiver_that_hears_the_same_helps_less_than_one_that_hears_something_new():
    a, b, none = 5e-4 * pulse(10.0, 0.4), 5e-4 * pulse(10.0, 0.6), np.zeros(WINDOW.n_samples)
    made = heard([[a, a, none], [none, none, b]])

    one, same, new = (made.information([0], which) for which in ([0], [0, 1], [0, 2]))
    told = one.matrix[0, 0]
    gain = one.log_determinant - same.log_determinant
    assert gain == pytest.approx(np.log((1.0 + 2.0 * told) / (1.0 + told)), rel=1e-6)
    assert one.log_determinant - new.log_determinant == pytest.approx(np.log(1.0 + told), rel=1e-4)
    assert np.log(1.0 + told) > gain


def test_an_unknown_without_influence_is_not_felt_and_keeps_its_range():
    made = heard([[5e-4 * pulse(10.0, 0.4)], [np.zeros(WINDOW.n_samples)]]).information([0], [0])

    assert made.sensitive.tolist() == [True, False]
    assert made.ratios[1] == 1.0


def test_by_peaks_a_factor_is_known_as_well_as_three_peaks_let_it():
    made = heard([[0.0 * pulse(10.0, 0.5)]])
    made.changes[:] = made.motion  # the range is from half to one and a half of the motion

    # a deviation of 100/root 12 % of the range against 15 % and noise of 1 % of three PPV
    wanted = 3.0 * 100.0**2 / (15.0**2 + 1.0) / 12.0
    found = replace(made, peaks_only=True).information([0], [0])
    assert found.matrix[0, 0] == pytest.approx(wanted, rel=1e-3)


def test_peaks_tell_less_than_waveforms(tmp_path):
    made, _ = design_survey(table(tmp_path, misfit="paper", candidate_grid=[1, 1]))

    assert made.misfit == "paper"
    assert made.information.ratios[0] > made.other.ratios[0]
    assert made.information.ratios[1] > made.other.ratios[1]


def test_silent_receivers_tell_nothing():
    made = heard([[0.0 * pulse(10.0, 0.4)]])
    made.motion[:] = 0.0

    assert made.information([0], [0]).ratios == pytest.approx([1.0])


def test_intervals_are_those_of_prior_and_data_together():
    share = 0.1
    found = posterior_intervals(
        np.array([0.8]), FisherInformation(np.array([[1.0 / share**2 - 1.0]]))
    )

    # the middle of the range, weighed by the share of its precision
    middle = 0.5 + (1.0 - share**2) * 0.3
    assert found[0] == pytest.approx([middle - 0.04748, middle + 0.04748], abs=1e-5)


def test_what_nothing_tells_keeps_nine_tenths_of_its_range_wherever_it_was_found():
    found = posterior_intervals(np.array([0.95]), FisherInformation(np.zeros((1, 1))))

    assert found[0] == pytest.approx([0.5 - 0.4748, 0.5 + 0.4748], abs=1e-4)


def test_a_plan_needs_no_records_and_says_what_noise_it_takes(plan):
    made, folder = plan

    assert "0.05 mm/s rms in the band, assumed" in made.noise
    assert {path.name for path in folder.iterdir()} == {"survey.json", "report.html"}
    told = json.loads((folder / "survey.json").read_text())["plan"]
    assert [one["name"] for one in told["receivers"]] == ["R1", "R2"]


def test_strength_that_nothing_depends_on_is_named_with_its_reason(plan):
    made, _ = plan

    assert list(made.why) == ["joints.F1.friction_angle_deg"]
    assert made.why["joints.F1.friction_angle_deg"].startswith("no contact of 'F1' slipped")
    assert made.constraint(2) == "not identifiable"


def test_more_never_costs_and_less_never_gains(plan):
    made, _ = plan

    assert {one.kind for one in made.gains} == {"receiver", "blast", "without"}
    for one in made.gains:
        assert (one.gain < 0.0) == (one.kind == "without")


@pytest.mark.long
def test_a_given_level_of_noise_is_taken(tmp_path):
    loud, quiet = (
        design_survey(table(tmp_path, noise_mm_per_s=level, candidate_grid=[1, 1]))[0]
        for level in (10.0, 0.01)
    )

    assert "10 mm/s rms in the band, as given" in loud.noise
    assert loud.information.ratios[0] > quiet.information.ratios[0]


def test_the_command_prints_identifiability_and_the_best_candidates(tmp_path):
    done = call("backanalyse", table(tmp_path, candidate_grid=[3, 1]), "--design-survey")

    assert done.exit_code == 0, done.output
    assert "not identifiable: no contact" in done.output
    assert "would add most information" in done.output
    assert "trade off" in done.output or " well " in done.output
    page = (tmp_path / "survey" / "001" / "report.html").read_text()
    assert page.count('class="plot"') == 1


def test_without_a_grid_point_far_enough_the_command_says_so(tmp_path):
    path = table(tmp_path, candidate_grid=[1, 1], receivers=[])
    crowd = "".join(
        f'\n[[receivers]]\nname = "C{x}"\nposition_m = [{x}, 10]\n' for x in range(15, 60, 15)
    )
    path.write_text(path.read_text().replace("\n[run]\n", f"{crowd}\n[run]\n"))

    done = call("backanalyse", path, "--design-survey")

    assert done.exit_code == 0, done.output
    assert "only receivers of the project are candidates" in done.output
    page = (tmp_path / "survey" / "001" / "report.html").read_text()
    assert "half a wavelength of S" in page
    assert "the circle marks the best candidate" not in page


OBLIQUE = (
    ("size_m = [60, 20, 30]\ngrid_cells = [12, 4, 6]",
     "size_m = [200, 160, 60]\npadding_m = 60\npadding_edge_m = 20"),
    ("dip_deg = 90\ndip_direction_deg = 90\nthrough_m = [30, 0, 0]",
     "dip_deg = 60\ndip_direction_deg = 145\nthrough_m = [100, 80, 60]"),
    ("position_m = [14, 10, 30]", "position_m = [60, 60, 60]"),
    ("duration_s = 0.1", "duration_s = 0.1\ncompare_band_hz = [3, 30]"),
)  # fmt: skip
SPEEDS = """
[back_analysis]
[[back_analysis.parameters]]
path = "materials.rock.cs_m_per_s"
low = 1500
high = 1900
"""


def test_candidates_stand_outside_the_layer_of_a_mesh_that_is_turned_to_the_strike(tmp_path):
    project = load_project(written(tmp_path, *OBLIQUE, text=INSIDE + SPEEDS))
    mesh = project.mesh

    points = [r.position for r in survey_receivers([project], ["house"], 10.0) if r.gridded]

    edges = np.diff(mesh.points[mesh.zones[0]][:2, :2], axis=0)[0]
    assert mesh.hexahedral
    assert np.abs(edges).min() > 0.1 * np.abs(edges).max()  # turned
    assert len(points) > 3
    assert mesh.layer.depths(np.array(points)).max() <= 0.0
    with_receivers(project, survey_receivers([project], ["house"], 10.0)).model  # noqa: B018


def test_candidates_near_a_source_or_behind_a_coarse_mesh_do_not_count(tmp_path):
    project = load_project(written(tmp_path, text=INSIDE + SPEEDS))  # holes near (14, 10)
    receivers = survey_receivers([project], ["house"], 2.0)

    counted, words = without_uncertain([project], receivers, 20.0)
    none, low = without_uncertain([project], receivers, 120.0)

    gone = {row.name for row in receivers} - {row.name for row in counted}
    assert gone == {f"18, {north} m" for north in (2, 8, 12, 18)}
    assert "D38" in words[0]
    assert all(name in words[0] for name in gone)
    assert [row.name for row in none] == ["house"]  # those of the survey stay
    assert "D40" in low[-1]
    assert "120 Hz" in low[-1]


def test_a_survey_counts_what_its_mesh_carries_and_no_receiver_beside_a_hole(tmp_path):
    at_hole = ('[[receivers]]\nname = "house"', '[[receivers]]\nname = "pit"\n'
               'position_m = [14, 12]\n[[receivers]]\nname = "house"')  # fmt: skip
    band = ("duration_s = 0.1", "duration_s = 0.4\ncompare_band_hz = [5, 70]")
    text = SPEEDS.replace("[back_analysis]", '[back_analysis]\nmisfit = "paper"\n'
                          "candidate_grid = [2, 1]")  # fmt: skip
    plan, _ = design_survey(written(tmp_path, at_hole, band, text=INSIDE + text))

    assert [row.name for row in plan.receivers if row.in_survey] == ["house"]
    assert plan.window.band == (5.0, pytest.approx(27.0, abs=0.1))  # 1700 m/s in ten mean edges
    assert "records are compared from 5 to 27 Hz and not to 70" in plan.uncertain[-1]


def test_a_check_of_a_project_without_records_points_to_the_survey_design(tmp_path):
    done = call("check", table(tmp_path))

    assert done.exit_code in (0, 3), done.output
    assert "no record yet; use backanalyse --design-survey" in done.output


def test_a_survey_has_nothing_to_start_afresh(tmp_path):
    done = call("backanalyse", table(tmp_path), "--design-survey", "--fresh")

    assert done.exit_code == 2
    assert "--design-survey: takes neither" in done.output


def test_a_plan_for_a_receiver_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="has no receiver 'R9'; it has R1, R2"):
        design_survey(load_project(table(tmp_path, receivers=["R9"])))


@pytest.mark.parametrize(
    ("within", "words"),
    [
        ((1.0, 2.0), "below"),
        ((7.0, 8.0), "above"),
        ((3.0, 6.0), "within"),
        ((2.0, 3.5), "not dist"),
    ],
)
def test_a_result_is_set_beside_the_laboratory(within, words):
    best = sum(within) / 2.0
    one = {"laboratory": (3.0, 6.0), "within": within, "best": best, "unidentifiable": ""}

    assert beside_laboratory(one).startswith(words)
