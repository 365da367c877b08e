"""Back-analysis by waveforms: noise from before the blast, levels of errors from the residual."""

import json

import numpy as np
import pytest
from inversion_project import PARAMETERS, TRUTH, noisy

from pyblast import back_analyse, load_project
from pyblast.back_analysis.findings import findings_of_fit, findings_of_table
from pyblast.back_analysis.fit import Fitter
from pyblast.back_analysis.search import make_target
from pyblast.back_analysis.trials import evaluate
from pyblast.back_analysis.waveforms import (
    COARSER,
    mesh_errors_of,
    remaining,
    sampled_motion,
    window_of,
)
from pyblast.errors import InputError, SolverError
from pyblast.inference.parameter import set_all
from pyblast.inference.records import band_functions, white_noise
from pyblast.simulation.simulation import in_batches
from pyblast.workflows.back_analysis import RESULT, TRIALS


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return back_analyse(noisy(tmp_path_factory.mktemp("waves")))


def test_waveforms_find_stiffness_and_damping_by_the_default_method(found):
    one, _ = found

    assert (one.target.misfit, one.method) == ("waveform", "levenberg")
    assert one.fit.converged
    for parameter, truth, within in zip(PARAMETERS, TRUTH, (0.05, 0.05, 0.3), strict=True):
        assert one.best[parameter.name] == pytest.approx(truth, rel=within)


def test_intervals_hold_the_truth_and_are_written_with_what_constrains_them(found):
    one, folder = found
    written = json.loads((folder / RESULT).read_text())

    assert written["finished"]
    for row, truth in zip(written["parameters"], TRUTH, strict=True):
        assert row["within"][0] < truth < row["within"][1]
    assert [row["constraint"] for row in written["parameters"]][:2] == ["well", "well"]
    assert written["parameters"][2]["constraint"] in ("well", "partly")  # damping: at the border
    assert not written["fit"]["lacking"]
    assert one.plan is None  # a survey is planned by its own command
    for first, second, rho in one.fit.trade_offs():
        assert first != second
        assert 0.5 <= abs(rho) < 1.0


def test_what_is_held_is_not_known_and_the_page_says_what_would_help(found):
    one, folder = found
    page = (folder / "report.html").read_text()
    held = {row["name"] for row in json.loads((folder / RESULT).read_text())["fit"]["held"]}

    assert held >= {"soil.cs", "rock.cp", "density", "amplitude", "1/Q", "dip"}
    assert "<h2>What is held, and what would help</h2>" in page
    assert "its variance would fall by" in page
    assert "below the laboratory" in page
    assert "F1.place is taken as known" in page  # a regular grid can't move it
    assert set(one.fit.left_out) >= {"the error of the mesh", "F1.place"}


@pytest.mark.long
def test_priors_that_are_smaller_make_intervals_smaller(found, tmp_path):
    wide = found[0].fit.intervals()
    path = noisy(tmp_path)
    path.write_text(path.read_text() + "[priors]\ndensity_percent = 0\namplitude_percent = 0.1\n")

    narrow = back_analyse(path)[0].fit.intervals()

    name = PARAMETERS[0].name
    assert np.diff(narrow[name]) < 0.9 * np.diff(wide[name])


def test_noise_leaves_its_share_of_the_energy(tmp_path):
    records = make_target(load_project(noisy(tmp_path))).records
    band = records.band
    noise = np.trace(records.noise.covariance(band, 0, 0))
    energy = np.sum(band.project(records.motion) ** 2)
    project = load_project(noisy(tmp_path))
    truth = set_all(project, PARAMETERS, TRUTH)
    motion = sampled_motion(in_batches([truth]), records.receivers, records)

    # 45 numbers, and a factor in the noise for the few that it is estimated from
    assert 0.2 < remaining(records, motion) / (noise / energy) < 1.5


@pytest.mark.long
def test_a_search_goes_on_with_stored_runs_to_the_same_bits(tmp_path):
    path = noisy(tmp_path)
    whole, folder = back_analyse(path)
    (folder / RESULT).unlink()

    again, again_in = back_analyse(path)

    assert again_in == folder
    assert again.fit.intervals() == whole.fit.intervals()
    assert np.array_equal(again.trace.points, whole.trace.points)
    rows = [json.loads(line) for line in (folder / TRIALS).open()][1:]
    assert [row["number"] for row in rows] == [*range(1, whole.runs + 1)]


@pytest.mark.long
def test_a_search_that_ran_out_of_runs_says_so_and_goes_on_with_more(tmp_path):
    path = noisy(tmp_path, runs=13)
    path.write_text(path.read_text().replace("kn_gpa_per_m = 0.2", "kn_gpa_per_m = 0.02"))
    short, folder = back_analyse(path)

    codes = {finding.code for finding in findings_of_fit(short)}
    assert "D43" in codes
    assert short.constraint(0).startswith("not to be relied on")

    path.write_text(path.read_text().replace("runs = 13", "runs = 60"))
    long, same = back_analyse(path)

    assert same == folder
    assert long.fit.converged
    assert "D43" not in {finding.code for finding in findings_of_fit(long)}


def test_fewer_runs_than_the_derivatives_need_are_refused_with_their_number(tmp_path):
    with pytest.raises(InputError, match=r"runs: must be at least \d+ for the derivatives"):
        back_analyse(noisy(tmp_path, runs=5))


@pytest.mark.long
def test_a_step_that_can_not_be_run_ends_the_search_with_what_is_known(tmp_path, monkeypatch):
    def broken(*_):
        raise SolverError("unstable after 3 steps")

    monkeypatch.setattr(Fitter, "simulated", broken)

    result, folder = back_analyse(noisy(tmp_path))

    assert not result.fit.converged
    assert "unstable after 3 steps" in (folder / "report.html").read_text()
    assert len(result.trace.misfits) == 1


@pytest.mark.long
def test_a_search_that_does_not_end_starts_again_with_the_lower_third_of_the_band(
    tmp_path, monkeypatch
):
    bands, minimise = [], Fitter._minimised

    def noted(fitter, state, records):
        bands.append((records.band.low, records.band.high))
        return minimise(fitter, state, records)

    monkeypatch.setattr(Fitter, "_minimised", noted)
    monkeypatch.setattr("pyblast.inference.fit.STEPS", 0)
    monkeypatch.setattr("pyblast.back_analysis.fit.LAST_STEPS", 0)
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("[3, 20]", "[1, 19]"))

    result, _ = back_analyse(path)

    assert bands == [(1.0, 19.0), (1.0, 7.0), (1.0, 19.0)]
    assert result.fit.starts == 3
    assert not result.fit.converged


def test_another_method_for_waveforms_is_refused(tmp_path):
    with pytest.raises(InputError, match="misfit 'waveform' is fitted by 'levenberg'"):
        back_analyse(noisy(tmp_path, method="'random'"))


@pytest.mark.long
def test_values_are_written_although_the_full_run_and_the_page_fail(tmp_path, monkeypatch):
    def broken(*_):
        raise SolverError("no full run today")

    monkeypatch.setattr("pyblast.workflows.back_analysis.confirm", broken)
    monkeypatch.setattr("pyblast.workflows.back_analysis.write_search_report", broken)

    result, folder = back_analyse(noisy(tmp_path))

    written = json.loads((folder / RESULT).read_text())
    assert written["parameters"][0]["within"][0] < TRUTH[0] < written["parameters"][0]["within"][1]
    assert ["full run" in line or "report.html" in line for line in result.missing] == [True] * 2


def test_a_record_without_quiet_before_the_blast_is_refused_with_advice(tmp_path):
    with pytest.raises(InputError, match=r"receivers.R1.recorded: begins at -0\.01\d* s, but wave"):
        make_target(load_project(noisy(tmp_path, start=-0.01)))


def test_a_level_of_noise_takes_the_place_of_quiet(tmp_path):
    target = make_target(load_project(noisy(tmp_path, start=-0.01, noise_mm_per_s=0.1)))

    assert np.all(target.records.noise.variance > 0.0)


def test_two_blasts_are_met_together(tmp_path):
    path = noisy(tmp_path, blasts='["second/project2.toml"]')
    other = noisy(tmp_path / "second")
    other.rename(other.with_name("project2.toml"))

    target = make_target(load_project(path))
    truth, wrong = evaluate(target, np.array([TRUTH, (0.2, 0.05, 0.0112)]))

    assert target.records.motion.shape[:2] == (2, 1)
    assert truth["misfit"] < 0.3 * wrong["misfit"]


def test_white_noise_has_the_rms_that_is_given(tmp_path):
    window = window_of([load_project(noisy(tmp_path))])
    band = band_functions(window.n_samples, window.dt, window.band)

    variance = (
        np.diag(
            white_noise(1e-4, 1, window.band, window.dt, window.n_samples).covariance(band, 0, 0)
        ).sum()
        / 3.0
    )
    rms = np.sqrt(variance / window.n_samples)
    # 2 % are added to the diagonal; functions fill the band but for its edges
    assert rms == pytest.approx(1e-4, rel=0.1)


def clipped(folder, marked):
    """Write a project whose record is cut at 40 % of its peak, flat or not: as noise hides it."""
    path = noisy(folder)
    values = np.loadtxt(folder / "wall.csv", delimiter=",", skiprows=1)
    top = 0.4 * np.abs(values[:, 1:]).max()
    cut = np.clip(values[:, 1:], -top, top)
    noise = 1e-4 * np.sin(np.arange(cut.size)).reshape(cut.shape)
    values[:, 1:] = cut if marked else cut * (1.0 + noise)
    head, *_, low_pass = (folder / "wall.csv").read_text().splitlines()
    texts = {"header": head, "footer": low_pass, "comments": ""}
    np.savetxt(folder / "wall.csv", values, "%.17g", ",", **texts)
    told = f"bearing_deg = 90\nfull_scale_mm_per_s = {1e3 * top if marked else 1e6}"
    path.write_text(path.read_text().replace("bearing_deg = 90", told))
    return path


@pytest.mark.filterwarnings("ignore:.*clipped at full scale")
def test_a_record_that_is_clipped_throughout_is_refused(tmp_path):
    path = clipped(tmp_path, True)
    path.write_text(
        path.read_text().replace("full_scale_mm_per_s = ", "full_scale_mm_per_s = 1e-9 #")
    )

    with pytest.raises(
        InputError, match=r"receivers.R1.recorded: no sample after the first firing"
    ):
        make_target(load_project(path))


@pytest.mark.filterwarnings("ignore:.*clipped at full scale")
def test_samples_at_full_scale_are_not_compared(tmp_path):
    masked, believed, whole = (
        evaluate(make_target(load_project(path)), np.array([TRUTH]))[0]["misfit"]
        for path in (clipped(tmp_path / "masked", True), clipped(tmp_path / "cut", False),
                     noisy(tmp_path / "whole"))
    )  # fmt: skip

    assert believed > 100.0 * whole
    assert masked < 0.05 * believed


EDGES = 'edge_m = 10\nkind = "tetrahedra"'


def test_the_error_of_a_grid_that_can_not_be_coarsened_is_said(tmp_path):
    path = noisy(tmp_path)
    path.write_text(
        path.read_text().replace("grid_cells = [6, 2, 3]\nquadratic = true", "edge_m = 10")
    )
    project = load_project(path)
    window = window_of([project])
    motion = np.zeros((1, 1, 3, 4))

    none, why = mesh_errors_of([project], motion, ["R1"], window)

    assert (none, project.mesh.hexahedral) == ((), True)
    assert why.endswith("the grid is too small to coarsen")


def test_the_error_of_a_mesh_is_extrapolated_from_a_coarser_one(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("grid_cells = [6, 2, 3]", EDGES))
    project = load_project(path)
    window, other = window_of([project]), project.changed(mesh=project.refined(COARSER))
    motion, coarse = (
        sampled_motion([one.simulate().seismograms], ["R1"], window) for one in (project, other)
    )

    (error,), doubt = mesh_errors_of([project], motion, ["R1"], window)

    ratio = other.config.mesh.edge_m / 10.0
    assert (1.3 < ratio < 1.7, doubt) == (True, "")
    assert np.any(motion != coarse)
    assert error == pytest.approx((motion - coarse) / (1.0 - ratio**2))


def test_few_coefficients_in_the_band_are_a_finding(tmp_path):
    found = findings_of_table(load_project(noisy(tmp_path)))[0]

    assert found.code == "D10"
    assert found.numbers == {"numbers": 45.0, "parameters": 3.0}
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("duration_s = 0.5", "duration_s = 0.8"))
    assert findings_of_table(load_project(path)) == []


def test_only_the_band_that_the_mesh_carries_is_compared(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("[3, 20]", "[3, 60]"))
    project = load_project(path)
    (row,) = project.accuracy.rows

    target = make_target(project)
    (finding,) = (one for one in findings_of_table(project) if one.code == "D40")

    assert (target.records.band.low, target.records.band.high) == (3.0, row.carried)
    assert 18.0 < row.carried < 40.0
    assert "and not to 60; edges of" in finding.text
    assert finding.numbers == {"carried": row.carried, "asked": 60.0}
    varied = set_all(target.projects[0], PARAMETERS, TRUTH)
    assert varied.compared_band == (3.0, row.carried)


def test_a_mesh_that_carries_nothing_of_the_band_is_refused(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("shear_mpa = 1150", "shear_mpa = 20"))

    with pytest.raises(InputError, match=r"mesh carries motion up to .*'soil' sets that.*edges"):
        make_target(load_project(path))
