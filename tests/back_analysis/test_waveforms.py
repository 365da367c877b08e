"""Back-analysis by waveforms: noise from before the blast, levels of errors from the residual."""

import json

import numpy as np
import pytest
from inversion_project import PARAMETERS, TRUTH, noisy

from pyblast import back_analyse, load_project
from pyblast.back_analysis.findings import findings_of_table
from pyblast.back_analysis.parameters import simulate, with_values
from pyblast.back_analysis.search import make_target
from pyblast.back_analysis.trials import evaluate
from pyblast.back_analysis.waveforms import (
    coarser,
    mesh_errors_of,
    sampled_motion,
    white_noise,
    window_of,
)
from pyblast.errors import InputError
from pyblast.inference.covariance import usual_whitener
from pyblast.inference.records import band_functions
from pyblast.project.validity import validity
from pyblast.workflows.back_analysis import RESULT, TRIALS


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return back_analyse(noisy(tmp_path_factory.mktemp("waves")))


def test_waveforms_find_stiffness_and_damping_by_the_default_method(found):
    one, _ = found

    assert one.method == "levenberg"
    for parameter, truth in zip(PARAMETERS[:2], TRUTH, strict=False):
        assert one.best[parameter.name] == pytest.approx(truth, rel=0.05)


def test_the_interval_of_what_was_found_holds_the_truth(found):
    one, folder = found
    told = json.loads((folder / RESULT).read_text())["plan"]

    assert one.plan.misfit == "waveform"
    assert told["noise"].startswith("of the records before the first firing")
    for row, truth in zip(told["parameters"], TRUTH, strict=True):
        assert row["within"][0] < truth < row["within"][1]


def test_the_page_sets_the_result_beside_the_laboratory_and_warns_of_low_damping(found):
    page = (found[1] / "report.html").read_text()

    assert "below the laboratory" in page
    assert "a low damping ratio does not prove a realistic model" in page
    assert "<h2>Identifiability</h2>" in page


def test_noise_above_all_errors_of_the_theory_is_worth_about_one(tmp_path):
    target = make_target(load_project(noisy(tmp_path, rms=0.05)))

    # 42 numbers, four degrees of freedom to the level of the noise of each channel
    assert 0.25 < evaluate(target, np.array([TRUTH]))[0]["misfit"] < 2.5


def test_misfits_of_a_trace_are_all_by_the_same_levels(found):
    one, folder = found
    target = one.target

    again = evaluate(target, one.trace.points[:1])[0]
    assert one.trace.misfits[0] == pytest.approx(again["misfit"], rel=1e-9)
    assert len((folder / TRIALS).read_text().splitlines()) == 16


def test_a_search_by_waveforms_is_resumed_to_the_same_trace(tmp_path):
    path = noisy(tmp_path)
    whole, folder = back_analyse(path)
    lines = (folder / TRIALS).read_text().splitlines(keepends=True)
    (folder / TRIALS).write_text("".join(lines[:12]))
    (folder / RESULT).unlink()

    again, again_in = back_analyse(path)

    assert again_in == folder
    assert np.array_equal(again.trace.points, whole.trace.points)
    assert np.array_equal(again.trace.misfits, whole.trace.misfits)


def test_a_point_that_was_run_is_not_run_again(found):
    rows = [json.loads(line) for line in (found[1] / TRIALS).open()][1:]
    values = [tuple(row["values"]) for row in rows]

    for number, row in enumerate(rows):
        repeated = tuple(row["values"]) in values[:number]
        assert (row["wall_seconds"] == 0.0) == repeated


def test_a_record_without_quiet_before_the_blast_is_refused_with_advice(tmp_path):
    with pytest.raises(InputError, match=r"receivers.R1.recorded: begins at -0\.01\d* s, but wave"):
        make_target(load_project(noisy(tmp_path, start=-0.01)))


def test_a_level_of_noise_takes_the_place_of_quiet(tmp_path):
    target = make_target(load_project(noisy(tmp_path, start=-0.01, noise_mm_per_s=0.1)))

    assert target.waveforms.likelihood.covariance.n_data > 0


def test_two_blasts_are_met_together(tmp_path):
    path = noisy(tmp_path, blasts='["second/project2.toml"]')
    other = noisy(tmp_path / "second")
    other.rename(other.with_name("project2.toml"))

    target = make_target(load_project(path))
    truth, wrong = evaluate(target, np.array([TRUTH, (0.2, 0.05, 0.0112)]))

    assert target.waveforms.records.motion.shape[:2] == (2, 1)
    assert truth["misfit"] < 0.3 * wrong["misfit"]


def test_white_noise_has_the_rms_that_is_given(tmp_path):
    window = window_of([load_project(noisy(tmp_path))])
    band = band_functions(window.n_samples, window.dt, window.band)

    variance = np.diag(white_noise(1e-4, 1, window).covariance(band, 0, 0)).sum() / 3.0
    rms = np.sqrt(variance / window.n_samples)
    # 2 % are added to the diagonal; functions fill the band but for its edges
    assert rms == pytest.approx(1e-4, rel=0.1)


def clipped(folder, marked):
    """Write a project whose record is cut at 40 % of its peak, and says so or not."""
    path = noisy(folder)
    values = np.loadtxt(folder / "wall.csv", delimiter=",", skiprows=1)
    top = 0.4 * np.abs(values[:, 1:]).max()
    values[:, 1:] = np.clip(values[:, 1:], -top, top)
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

    assert believed > 5.0 * whole
    assert masked < 2.0 * whole


def test_errors_of_the_theory_look_like_the_best_simulation_not_like_the_record(found):
    one, _ = found
    waves, records = one.target.waveforms, one.target.waveforms.records
    row = evaluate(one.target, one.trace.points[one.trace.best][None])[0]
    best = records.motion - waves.motion_of(row["residuals"])

    held = waves.likelihood.covariance
    wanted, recorded = (usual_whitener(motion, records.noise, records.band) for motion in
                        (best, records.motion))  # fmt: skip
    gains = [n for n, group in enumerate(held.groups) if group == "gain"]
    size = np.linalg.norm(wanted.columns[gains], axis=1)
    # a turn of near eigenvectors leaves lengths alone; rounding of the search
    assert np.linalg.norm(held.columns[gains], axis=1) == pytest.approx(size, rel=1e-6)
    assert np.linalg.norm(recorded.columns[gains], axis=1) != pytest.approx(size, rel=1e-3)


def test_a_mesh_that_can_not_be_made_coarser_is_said_not_dropped(found):
    one, folder = found
    table, page = json.loads((folder / RESULT).read_text()), (folder / "report.html").read_text()

    assert "mesh" not in one.target.waveforms.likelihood.covariance.levels
    for doubt in (
        one.target.waveforms.mesh_error_missing,
        table["plan"]["mesh_error_missing"],
        page,
    ):
        assert "the mesh error is not estimated: project.toml: mesh.grid_cells" in doubt


EDGES = 'edge_m = 10\nkind = "tetrahedra"'


def test_the_error_of_a_grid_that_can_not_be_coarsened_is_said(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("grid_cells = [6, 2, 3]", "edge_m = 10"))
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
    window, other = window_of([project]), coarser(project)
    motion, coarse = (
        sampled_motion(simulate(one, (), [()]), ["R1"], window) for one in (project, other)
    )

    (error,), doubt = mesh_errors_of([project], motion, ["R1"], window)

    assert (other.config.mesh.edge_m, doubt) == (15.0, "")
    assert np.any(motion != coarse)
    assert error == pytest.approx((motion - coarse) / (1.0 - 1.5**2))


def test_an_error_of_the_mesh_widens_what_waveforms_leave(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("grid_cells = [6, 2, 3]", EDGES))

    found, _ = back_analyse(path)

    assert found.target.waveforms.likelihood.covariance.levels["mesh"] > 0.0
    assert found.plan.levels["mesh"] > 0.0
    assert found.plan.mesh_error_missing == ""


def test_few_coefficients_in_the_band_are_a_finding(tmp_path):
    found = findings_of_table(load_project(noisy(tmp_path)))[0]

    assert found.code == "D10"
    assert found.numbers == {"numbers": 42.0, "parameters": 3.0}
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("duration_s = 0.8", "duration_s = 1.2"))
    assert findings_of_table(load_project(path)) == []


def test_only_the_band_that_the_mesh_carries_is_compared(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("[3, 13]", "[3, 25]"))
    project = load_project(path)
    (row,) = validity(project)

    target = make_target(project)
    (finding,) = (one for one in findings_of_table(project) if one.code == "D40")

    assert target.waveforms.window.band == (3.0, row.carried)
    assert 12.0 < row.carried < 14.0
    assert "from 3 to 13.1 Hz and not to 25; edges of" in finding.text
    assert finding.numbers == {"carried": row.carried, "asked": 25.0}
    varied = with_values(target.projects[0], PARAMETERS, TRUTH)
    assert varied.compared_band == (3.0, row.carried)


def test_a_mesh_that_carries_nothing_of_the_band_is_refused(tmp_path):
    path = noisy(tmp_path)
    path.write_text(path.read_text().replace("shear_mpa = 7200", "shear_mpa = 57.7"))

    with pytest.raises(InputError, match=r"mesh carries motion up to 2.*'soil' sets that.*edges"):
        make_target(load_project(path))
