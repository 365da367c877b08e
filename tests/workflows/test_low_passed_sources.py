"""Motion whose sources were low-passed is at physical time, also beside records."""

from dataclasses import replace

import numpy as np
import pytest
from inversion_project import PARAMETERS, RECORDED, TRUTH, section
from small_project import CARRIED, INSIDE, written

from pyblast.back_analysis.search import make_target
from pyblast.back_analysis.trials import evaluate
from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.forward import simulation_of
from pyblast.errors import InputError
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.project.result import Result, seismogram_heads, write_csv
from pyblast.recordings.recording import read_recording
from pyblast.signals.comparison import compare
from pyblast.signals.seismogram import Seismogram, ZeroPhase
from pyblast.workflows.back_analysis import back_analyse, find_moment_rate
from pyblast.workflows.run import compare_all, compare_files

CORNER, CENTRE, ALL = 20.0, 12.0, 450.0  # Hz; the last takes nothing
STRONG = ("cohesion_kpa = 20", "cohesion_kpa = 500"), ("tension_kpa = 0", "tension_kpa = 1e6")


def burst(dt, corner=None):
    """Return a burst of three components at a sampling in s, low-passed at a corner or not."""
    times = np.arange(-0.3, 1.2, 2.0**-13)
    wave = np.exp(-(((times - 0.4) / 0.03) ** 2)) * np.cos(2 * np.pi * CENTRE * (times - 0.4))
    fine = Seismogram(wave[:, None] * [1.0, 0.5, 0.2], 2.0**-13, -0.3)
    fine = fine if corner is None else fine.lowpassed(corner, of_source=True)
    return fine.sampled(-0.3, dt, int(1.49 / dt))


@pytest.mark.parametrize("dt", [1e-3, 4e-3, 1e-2])
@pytest.mark.parametrize("corner", [10.0, CORNER, 60.0, ZeroPhase(10.0), ZeroPhase(30.0)])
def test_the_record_of_a_low_passed_simulation_has_no_delay_at_any_sampling(dt, corner):
    simulated = burst(2.0**-11, corner)
    beside = compare(burst(dt), simulated, time_frequency=False)
    without = compare(burst(dt), replace(simulated, low_passed=None), time_frequency=False)

    assert np.abs(beside.lag).max() < 5e-5
    assert beside.waveform_misfit.max() < 2e-5
    assert np.abs(beside.ppv_deviation).max() < 2e-2 * (dt > 4e-3) + 2e-3
    assert np.abs(without.lag).max() < 1e-3  # which the filter bends but does not delay


def test_an_offset_before_the_blast_does_not_ring():
    still = Seismogram(np.full((500, 3), 3e-3), 2e-3, -0.3)
    assert np.allclose(still.filtered_like(CORNER).velocity, 3e-3, rtol=1e-12)


def test_motion_of_zero_phase_is_told_from_other_motion(tmp_path):
    write_csv(tmp_path / "R1.csv", burst(1e-3, ZeroPhase(CORNER)))
    (again,) = read_recording(tmp_path / "R1.csv")

    assert again.filtered_like(ZeroPhase(CORNER)).seismogram is again.seismogram
    with pytest.raises(InputError, match="the same low_pass_hz and zero_phase"):
        again.filtered_like(CORNER)
    beside, _, _ = compare_files(
        tmp_path / "R1.csv", tmp_path / "R1.csv", low_passed_hz=CORNER, zero_phase=True
    )
    assert beside.waveform_misfit.max() == 0.0


def test_a_low_pass_of_zero_phase_begins_before_and_keeps_its_result(tmp_path):
    low = ("low_pass_hz = 20", "low_pass_hz = 20\nzero_phase = true")
    project = load_project(written(tmp_path, ("duration_s = 0.1", "duration_s = 0.4"), low))

    motion = project.simulate().seismograms["R1"]

    spectrum = np.abs(np.fft.rfft(project.shot.input.motion.velocity[:, 0], 1 << 15))
    whole = np.abs(np.fft.rfft(project.shot.input.superposed.velocity[:, 0], 1 << 15))
    at = round(CORNER * (1 << 15) * project.shot.input.motion.dt)
    assert spectrum[at] / whole[at] == pytest.approx(0.5, rel=0.02)
    assert project.lead == pytest.approx(3.0 / CORNER, rel=0.02)
    assert isinstance(motion.low_passed, ZeroPhase)
    heads = seismogram_heads({"simulated": {"R1": motion}})
    result = Result({"simulated": {"R1": motion.velocity}}, {"seismograms": heads})
    assert isinstance(result.seismogram("simulated", "R1").low_passed, ZeroPhase)


def test_a_curve_of_a_run_says_its_filter_and_is_not_filtered_again(tmp_path):
    write_csv(tmp_path / "R1.csv", burst(1e-3, CORNER))
    (again,) = read_recording(tmp_path / "R1.csv")

    assert again.seismogram.low_passed == CORNER
    assert again.filtered_like(CORNER).seismogram is again.seismogram
    for other in (None, 2.0 * CORNER):
        with pytest.raises(InputError, match=r"were low-passed at 20 Hz.*give both the same"):
            again.filtered_like(other)
    assert np.loadtxt(tmp_path / "R1.csv", delimiter=",", skiprows=1).shape[1] == 4
    beside, _, _ = compare_files(tmp_path / "R1.csv", tmp_path / "R1.csv")
    assert beside.waveform_misfit.max() == 0.0


def test_what_follows_a_clipped_sample_for_a_period_of_the_corner_counts_as_clipped(tmp_path):
    write_csv(tmp_path / "R1.csv", burst(1e-3))
    (record,) = read_recording(tmp_path / "R1.csv")
    marks = np.zeros_like(record.clipped)
    marks[700, 1] = True

    clipped = replace(record, clipped=marks).filtered_like(CORNER).clipped

    assert np.flatnonzero(clipped[:, 1]).tolist() == list(range(700, 751))
    assert not clipped[:, [0, 2]].any()


def unfiltered_twin(folder, recorded, corner=CORNER, noise=0.0, table=""):
    """Write a project whose record was made without the low-pass of its face; return its path."""
    folder.mkdir(exist_ok=True)
    changes = (
        ("duration_s = 0.1", "duration_s = 0.5\ncompare_band_hz = [3, 13]"),
        CARRIED[0],
        *STRONG,
    )
    low = "low_pass_hz = 20"
    whole = written(folder, *changes, (low, f"low_pass_hz = {recorded}"))
    motion = load_project(whole).simulate().seismograms["R1"]
    made = motion.sampled(-0.4, 1.0 / 512.0, int(512 * 0.9))
    shaken = noise * np.random.default_rng(3).normal(size=made.velocity.shape)
    write_csv(folder / "wall.csv", replace(made, velocity=made.velocity + shaken, low_passed=None))
    path = written(folder, *changes, (low, f"low_pass_hz = {corner}"))
    path.write_text(path.read_text().replace("\n[run]\n", RECORDED) + table)
    return path


def test_a_run_finds_no_delay_against_a_twin_that_was_recorded_unfiltered(tmp_path):
    path = unfiltered_twin(tmp_path, ALL)
    project = load_project(path)

    beside = compare_all(project, project.simulate().seismograms)["R1"]

    moving = beside.recorded_energy > 1e-6 * np.nanmax(beside.recorded_energy)
    assert np.abs(beside.lag[moving]).max() < 1e-4
    assert beside.waveform_misfit[moving].max() < 1e-4
    assert "R1, low-passed at 20 Hz like the sources" in " ".join(check(project, False).notes)
    whole = compare(project.recorded["R1"], project.simulate().seismograms["R1"])
    assert whole.total_waveform_misfit < 1e-3


@pytest.mark.parametrize("corner", [20.0, 40.0])
def test_motion_arrives_when_it_does_without_a_low_pass(tmp_path, corner):
    path = unfiltered_twin(tmp_path, ALL, corner=corner)
    project = load_project(path)

    run = project.simulate()

    whole = project.recorded["R1"]  # of a run that takes nothing
    passed = replace(run.seismograms["R1"], low_passed=None)
    assert np.abs(compare(whole, passed, (3.0, 13.0)).lag).max() < 1e-4
    assert project.lead == pytest.approx(0.336 / corner, rel=0.01)


@pytest.mark.long
def test_the_back_analysis_finds_the_truth_from_a_record_without_the_filter(tmp_path):
    path = unfiltered_twin(tmp_path, ALL, noise=2e-4, table=section())

    result, _ = back_analyse(path)

    for parameter, truth in zip(PARAMETERS[:2], TRUTH, strict=False):
        low, high = result.fit.intervals()[parameter.name]
        assert low < truth < high < 2.0 * low


def elastic(path):
    """Turn a project with a back-analysis into one with a diagnosis of elastic ground."""
    text = path.read_text().replace("\n[run]\n", "\n[diagnosis]\nband_hz = [4, 13]\n\n[run]\n")
    for key in (
        "cohesion_kpa = 500\n",
        "friction_angle_deg = 25\n",
        "tension_kpa = 1e6\n",
        ', "joints.F1.cohesion_kpa"',
    ):
        text = text.replace(key, "")
    path.write_text(text.replace('law = "coulomb"', 'law = "elastic"'))
    return load_project(path)


def test_a_prediction_is_at_the_time_of_an_independent_record(tmp_path):
    project = elastic(unfiltered_twin(tmp_path, ALL, corner=40.0))
    case = case_of(project)

    predicted = simulation_of(case).motion(case.project)[0, 0].T

    record = project.recorded["R1"].rotated(np.pi / 2.0).sampled(0.0, case.dt, case.n_samples)
    beside = compare(record, replace(record, velocity=predicted), (3.0, 13.0))
    moving = beside.recorded_energy > 1e-6 * beside.recorded_energy.max()
    assert np.abs(beside.lag[moving]).max() < 1e-4
    assert beside.total_waveform_misfit < 1e-3


def test_diagnosis_gathers_records_as_its_sources_are(tmp_path):
    project = elastic(unfiltered_twin(tmp_path, ALL, noise=2e-4))

    case = case_of(project)

    wanted = project.comparable["R1"].seismogram.rotated(np.pi / 2.0)
    wanted = wanted.sampled(0.0, case.dt, case.n_samples).velocity.T
    assert case.motion[0, 0] == pytest.approx(wanted, abs=0.02 * np.abs(wanted).max())
    assert case.project.comparable["R1"].seismogram.low_passed == CORNER


HOLE = (("peak_time_ms = 40", "peak_time_ms = 8"), ("duration_s = 0.1", "duration_s = 0.3"))
HOUSE = "position_m = [52, 10]\n"


def test_variants_keep_the_low_pass_that_the_mesh_asked_for(tmp_path):
    receiver = f'{HOUSE}recorded = {{ file = "house.csv" }}\n'
    table = (
        '[back_analysis]\nmisfit = "paper"\n[[back_analysis.parameters]]\n'
        'path = "materials.rock.cs_m_per_s"\nlow = 1000\nhigh = 1800\n'
    )
    path = written(tmp_path, *HOLE, (HOUSE, receiver), text=INSIDE + table)
    project = load_project(path)
    corner = project.inside.low_pass
    assert corner is not None
    write_csv(tmp_path / "house.csv", project.simulate().seismograms["house"])

    target = make_target(project)

    slow = target.projects[0].set({"materials.rock.cs_m_per_s": 1000})
    assert load_project(path).config.holes_inside.low_pass_hz is None
    assert slow.shot.low_pass == corner
    assert project.set({"materials.rock.cs_m_per_s": 1000}).shot.low_pass < corner
    assert evaluate(target, np.array([[1700.0]]))[0]["misfit"] < 0.1


def test_some_sources_low_passed_and_others_not_can_not_stand_beside_a_record(tmp_path):
    receiver = f'{HOUSE}recorded = {{ file = "house.csv" }}\n'
    air = "[air_blast]\npressure_kpa = 100\nduration_ms = 5\n"
    path = written(tmp_path, *HOLE, (HOUSE, receiver), text=INSIDE + air)
    write_csv(tmp_path / "house.csv", burst(1e-3))

    with pytest.raises(InputError, match=r"recorded: .*some of whose sources were low-passed"):
        check(load_project(path))


def test_a_moment_rate_is_not_found_from_motion_that_holds_a_filter(tmp_path):
    receiver = f'{HOUSE}recorded = {{ file = "house.csv" }}\n'
    path = written(tmp_path, (HOUSE, receiver), text=INSIDE)
    write_csv(tmp_path / "house.csv", burst(1e-3, CORNER))

    with pytest.raises(InputError, match="were low-passed at 20 Hz"):
        find_moment_rate(path)


def test_records_beside_sources_without_a_low_pass_are_named_by_a_check(tmp_path):
    receiver = f'{HOUSE}recorded = {{ file = "house.csv" }}\n'
    whole = "[holes_inside]\nlow_pass_hz = 'none'\n\n[holes_inside.charged_hole]"
    path = written(
        tmp_path, (HOUSE, receiver), ("[holes_inside.charged_hole]", whole), text=INSIDE
    )  # fmt: skip
    write_csv(tmp_path / "house.csv", burst(1e-3))

    assert "Records to compare with: house." in check(load_project(path)).notes
