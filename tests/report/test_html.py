import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from small_project import CARRIED, written

from pyblast import Seismogram
from pyblast.project.result import read_result, write_csv
from pyblast.report import figures
from pyblast.report.figures import (
    limits_figure,
    peaks_of,
    section_of_surface,
    section_of_zones,
    waveform_figure,
)
from pyblast.report.pages import angle, shown_in_unit, shown_number
from pyblast.report.run import render, render_one_page
from pyblast.signals.comparison import load_limits
from pyblast.workflows import run


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    project = run.load_project(
        written(folder, ('"Small column"', '"Ore <script>alert(1)</script> & soil"'))
    )
    write_csv(folder / "R1.csv", project.input.motion.rotated(np.pi / 2.0))
    path = written(
        folder,
        ('"Small column"', '"Ore <script>alert(1)</script> & soil"'),
        ('name = "R1"', 'name = "R1<b>"\nrecorded = { file = "R1.csv" }'),
    )
    outcome = run.run(path)
    return render(read_result(outcome.folder / "result.h5"))


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.tags, self.links = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]


def test_the_page_needs_no_network(page):
    parser = Tags()
    parser.feed(page)

    assert all(link.startswith(("data:image/png;base64,", "#")) for link in parser.links)
    # data of seismograms, view, energy, limit curves and slip, and three that draw them, all inside
    assert parser.tags.count("script") == 8
    assert "fetch(" not in page
    assert "http" not in re.sub(r"<script.*?</script>", "", page, flags=re.DOTALL)
    assert "link" not in parser.tags


def test_names_that_users_give_are_escaped(page):
    assert "<script>" not in page
    assert "Ore &lt;script&gt;alert(1)&lt;/script&gt; &amp; soil" in page
    assert "R1&lt;b&gt;" in page


def test_the_page_warns_of_failing_checks_and_short_records_before_the_peaks(page):
    first = page.index("<table>")

    assert "before you use these peaks" in page[:first]
    assert page.index('id="answer"') < page.index("<img")
    assert "fewer than two cycles fit into the record" in page
    assert "1.12 % at 4 Hz (Rayleigh)" in page
    assert "enters through &#39;west&#39; at the arrows" in page


def test_figures_are_those_of_the_project_not_of_a_paper(page):
    assert "of the paper" not in page
    images = re.findall(r'src="data:image/png;base64,([^"]+)"', page)
    assert len(images) == 3
    assert page.count('class="plot"') == 3  # limit curves, slip, energy
    assert page.count('class="waveform"') == 3  # single hole, input, receiver
    assert all(base64.b64decode(image)[:8] == b"\x89PNG\r\n\x1a\n" for image in images)


def test_the_page_says_what_was_read(page):
    table = page[page.index("What was read") :]

    assert "R1.csv" in table
    assert "column 2 &#39;longitudinal_m_per_s&#39;" in table


def test_links_within_the_page_lead_somewhere(page):
    targets = re.findall(r'href="#([^"]+)"', page)

    assert len(targets) > 10
    assert all(f'id="{target}"' in page for target in targets)


def test_the_chosen_limit_curves_judge_the_peaks(tmp_path, page):
    curves = 'duration_s = 0.1\nlimit_curves = ["din_4150_dwelling", "as_2187_occupied"]'
    outcome = run.run(written(tmp_path, ("duration_s = 0.1", curves), *CARRIED))
    summary = outcome.result.summary

    drawn = render(outcome.result)
    rows = summary["compliance"]["rows"]

    assert "for orientation" in page
    assert "for orientation" not in drawn
    assert {row["curve"] for row in rows} == {"din_4150_dwelling", "as_2187_occupied"}
    words = summary["compliance"]["conclusion"]
    assert words.startswith("Not to be signed: the level stands on a published law alone")
    assert "By that law not allowed at " in words
    assert drawn.count("by a named person yet") == 1
    for row in rows:
        assert row["peak"] <= row["vector_sum"] * (1.0 + 1e-12)
        assert row["share"] * row["limit"] == pytest.approx(row["peak"])


def test_seismograms_in_the_page_keep_their_peaks():
    time = np.arange(0.0, 2.0, 1e-5)
    wave = np.exp(-3.0 * time) * np.sin(60.0 * np.pi * time)
    motion = Seismogram(np.c_[wave, -0.1 * wave, np.full(len(time), np.nan)], 1e-5)

    place = waveform_figure({"simulated": motion}, ["#c2410c"], top=60.0)

    peaks = dict(zip(motion.components, motion.ppv, strict=True))
    for trace in place["traces"]:
        peak = peaks[trace["name"]]
        values = np.frombuffer(base64.b64decode(trace["values"]), "<i2") * trace["scale"]
        assert np.abs(values).max() == pytest.approx(1e3 * peak, rel=1e-4)
        assert len(values) <= 4002
        assert trace["dt"] * len(values) == pytest.approx(2.0, rel=1e-3)
    assert [trace["name"] for trace in place["traces"]] == ["north", "east"]


def test_spectra_in_the_page_end_at_the_band_and_peak_where_the_motion_does():
    time = np.arange(0.0, 2.0, 0.001)
    wave = np.exp(-3.0 * time) * np.sin(2.0 * np.pi * 30.0 * time)
    motion = Seismogram(np.column_stack([wave, wave, 0.0 * wave]), 0.001)

    _, silent, one = waveform_figure({"simulated": motion}, ["#c2410c"], top=60.0)["traces"]

    amplitude = np.frombuffer(base64.b64decode(one["spectrum"]["values"]), "<i2")
    frequency = one["spectrum"]["low"] * one["spectrum"]["growth"] ** np.arange(len(amplitude))
    assert frequency[-2] <= 60.0 <= frequency[-1] * one["spectrum"]["growth"]
    assert frequency[amplitude.argmax()] == pytest.approx(30.0, abs=1.0)
    assert one["hz"] == pytest.approx(30.0, abs=1.0)
    assert silent["ppv"] == 0.0
    assert silent["hz"] is None


def test_peaks_of_a_decaying_sine_lie_at_its_frequency_the_sum_at_that_of_the_largest():
    time = np.arange(0.0, 2.0, 0.001)
    waves = [np.exp(-time) * np.sin(2.0 * np.pi * hz * time) for hz in (4.0, 10.0)]
    motion = Seismogram(np.column_stack([0.01 * waves[0], 0.002 * waves[1], 0.0 * time]), 0.001)

    (_, *first), (_, *second), (name, *total) = peaks_of(motion, summed=True)

    np.testing.assert_allclose(first, [motion.ppv[0], 4.0], rtol=0.01)
    np.testing.assert_allclose(second, [motion.ppv[1], 10.0], rtol=0.01)
    assert (name, total) == ("vector sum", [motion.pvs, first[1]])
    assert len(peaks_of(motion, summed=False)) == 2


def test_peaks_without_a_frequency_are_told():
    step = Seismogram(np.outer(np.linspace(0.0, 1.0, 50), [0.01, 0.0, 0.0]), 0.001)

    _, left_out = limits_figure({"simulated": {"R1": step}}, [load_limits()["usbm_plaster"]])

    assert left_out == ["R1 E (simulated)"]


def test_recorded_and_simulated_stand_side_by_side(page):
    assert "recorded against simulated" in page
    assert "Mean deviation of PPV and dominant frequency" in page


def test_assumptions_are_marked_where_they_matter(page):
    assert page.count("assumed: signature.cavity") >= 3
    assert "assumed: cohesion_kpa" in page


def test_defects_and_provenance_are_there(page):
    assert "does not carry the input" in page
    assert "input_sha256" in page
    assert "project.toml (SHA-256)" in page


def test_every_table_row_has_the_cells_of_its_head(page):
    for table in re.findall(r"<table>.*?</table>", page, re.DOTALL):
        rows = [len(re.findall(r"<t[hd]", row)) for row in re.findall(r"<tr>.*?</tr>", table, re.S)]
        assert len(set(rows)) == 1


def test_every_receiver_has_a_row_of_its_error(tmp_path):
    result = read_result(run.run(written(tmp_path)).folder / "result.h5")
    (table,) = result.summary["receivers"].values()
    near = {"source": "hole 1", "distance": 4.0, "edge": 20.0, "error": 0.4, "edge_needed": 3.0}
    error = {"waveform": 0.4, "peak": 0.3, "cause": "near source", "near": near}
    receivers = {f"R{number}": {**table, "expected_error": error} for number in range(20)}
    shown = render(replace(result, summary={**result.summary, "receivers": receivers}))

    rows = re.findall(r"<tr><td>R\d+</td><td>40 %</td><td>30 %</td><td>–</td>", shown)
    assert len(rows) == 20
    assert shown.count('<td class="words">hole 1</td>') == 20


def test_numbers_are_shown_with_a_dash_where_there_is_none():
    assert (shown_number(None), shown_number(float("nan")), shown_number(0.12345)) == (
        "–",
        "–",
        "0.123",
    )
    assert shown_in_unit(0.00254, 1e3) == "2.54"
    assert angle(1.0) == "45"


def test_a_section_has_the_area_of_the_model():
    points = np.array([[x, y, z] for x in (0.0, 2.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
    zones = np.array([[0, 4, 2, 1], [6, 2, 4, 7], [3, 1, 2, 7], [5, 1, 7, 4], [1, 2, 4, 7]])

    polygons, zone = section_of_zones(points, zones, 1.0)

    x, y = (np.array([np.pad(p[:, k], (0, 4 - len(p)), "edge") for p in polygons]) for k in (0, 1))
    area = 0.5 * np.abs((x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1)).sum()
    assert area == pytest.approx(6.0, rel=1e-4)
    assert len(zone) == 5


def test_a_section_cuts_a_joint_in_its_trace():
    points = np.array([[1.0, 0.0, 0.0], [1.0, 4.0, 0.0], [1.0, 0.0, 4.0]])

    segments = section_of_surface(points, np.array([[0, 1, 2]]), 1.0)

    assert np.sort(segments[0], axis=0) == pytest.approx(
        np.array([[1.0, 0.0], [1.0, 3.0]]), abs=1e-3
    )


def test_the_a4_page_holds_what_an_inspector_asks_for(tmp_path):
    project = run.load_project(written(tmp_path, *CARRIED))
    write_csv(tmp_path / "R1.csv", project.input.motion.rotated(np.pi / 2.0))
    facts = 'serial_number = "UM<1>", calibration_date = "2026-01-02", operator = "A. Blaster"'
    path = written(
        tmp_path, *CARRIED,
        ('name = "R1"', f'name = "R1"\nrecorded = {{ file = "R1.csv", {facts} }}'),
    )  # fmt: skip
    outcome = run.run(path)

    text = (outcome.folder / "report_one_page.html").read_text(encoding="utf-8")

    for part in ("UM&lt;1&gt;", "2026-01-02", "A. Blaster", "kg", "vector sum", "Limit ="):
        assert part in text
    assert text.count('class="plot"') == 1  # the limit curves
    assert text.count('class="waveform"') == 1
    assert text == render_one_page(outcome.result)
    assert (outcome.folder / "report.html").stat().st_size < 6e6


@pytest.mark.parametrize(
    "name", ["House $3^$", "a_b^c $x$ $", "\\frac{$", "Prüf$ung$^{", "日本語 $"]
)
def test_signs_of_formulas_in_names_are_drawn_as_they_are(name):
    figure = figures._figure(4, 3)
    axes = figure.subplots()
    axes.plot([1, 10], [1, 10], label=name)
    axes.set_title(name)
    axes.set_yticks([1, 2], [name, name])
    axes.legend()

    assert figures._uri(figure).startswith("data:image/png;base64,")


def test_a_figure_that_can_not_be_drawn_costs_that_figure():
    figure = figures._figure(4, 3)
    figure.savefig = lambda *_, **__: 1 / 0

    image = figures._uri(figure)

    assert image.startswith("data:image/svg+xml;base64,")
    assert b"can't be drawn (division by zero)" in base64.b64decode(image.split(",")[1]).replace(
        b"&#x27;", b"'"
    )


def energy_panel(**terms):
    """Return the panel of the plot of energies."""
    time = np.linspace(0.0, 1.0, 5)
    return figures.energy_figure({"time": time} | terms, 0.0)["panels"][0]


def test_energies_are_those_since_the_start_and_terms_without_any_are_left_out():
    put_in = np.array([0.0, 100.0, 400.0, 300.0, 200.0])

    drawn = energy_panel(input=put_in, joint_stored=7e6 + put_in, joint_dissipated=0.0 * put_in)

    lines = {mark["name"]: mark["y"] for mark in drawn["marks"]}
    assert set(lines) == {"put in", "stored in joints"}
    np.testing.assert_allclose(lines["stored in joints"], put_in)
    assert drawn["y"]["label"] == "energy [J]"
    assert drawn["y"]["log"]


def test_joints_that_give_energy_are_drawn_on_a_linear_scale():
    put_in = np.array([0.0, 100.0, 400.0, 300.0, 200.0])

    assert not energy_panel(input=put_in, joint_stored=7e6 - put_in)["y"]["log"]


def test_the_spectrum_of_a_source_of_few_samples_reaches_the_top():
    table = np.array([[0.0, 0.0], [0.01, 1.0], [0.02, 0.0]])

    spectrum = figures.source_figure({"force_1": table}, 200.0)["panels"][1]["marks"][0]

    frequency, share = np.array(spectrum["x"]), np.array(spectrum["y"])
    assert frequency[-1] >= 200.0
    assert share[np.argmin(np.abs(frequency - 100.0))] < 0.05  # sinc: a zero at 1/0.01 s
