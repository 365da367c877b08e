"""What a notebook shows: figures, traces, short texts, and keys that list what is there."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from small_project import TEXT, written

import pyblast
from pyblast.project.result import Result
from pyblast.report.figures import plot
from pyblast.signals.comparison import compare
from pyblast.signals.seismogram import Seismogram

TIMES = 1e-3 * np.arange(600)
PULSE = 1e-3 * np.exp(-((TIMES - 0.2) ** 2) / 0.02**2) * np.sin(2.0 * np.pi * 20.0 * TIMES)
MOTION = Seismogram(np.outer(PULSE, [3.0, 2.0, 1.0]), 1e-3, -0.1, "house")
HEAD = {"dt": 1e-3, "start": -0.1, "components": ["east", "north", "vertical"]}
RESULT = Result(
    {"simulated": {"house": MOTION.velocity}},
    {"title": "Blast 7", "receivers": {"house": {}}, "seismograms": {"simulated": {"house": HEAD}}},
)


def test_a_seismogram_and_a_comparison_are_drawn():
    figure = plot(MOTION)
    ratio = plot(compare(MOTION, Seismogram(2.0 * MOTION.velocity, 1e-3, -0.1, "house")))

    assert len(figure.axes) == 6
    drawn = figure.axes[0].lines[0].get_ydata()
    assert max(np.max(np.abs(axes.lines[0].get_ydata())) for axes in figure.axes[::2]) == (
        pytest.approx(1e3 * MOTION.ppv.max())
    )
    assert len(drawn) == len(TIMES)
    shown = ratio.axes[0].lines[0].get_ydata()
    assert shown[np.isfinite(shown)] == pytest.approx(2.0, rel=1e-6)


def test_traces_of_obspy_hold_the_same_samples_and_times():
    stream = MOTION.to_obspy("2025-01-02T03:04:05")

    assert [trace.stats.channel for trace in stream] == ["E", "N", "V"]
    assert np.array_equal(stream[0].data, MOTION.velocity[:, 0])
    assert stream[0].stats.delta == 1e-3
    assert str(stream[0].stats.starttime) == "2025-01-02T03:04:04.900000Z"


def test_texts_are_one_line():
    project = pyblast.Project
    assert repr(MOTION).startswith("<Seismogram 'house': 600 samples of 1 ms, PPV ")
    assert repr(RESULT) == "<Result 'Blast 7': receivers house>"
    assert repr(compare(MOTION, MOTION)).startswith("<Comparison: PPV east +0 %")
    for shown in (MOTION, RESULT, compare(MOTION, MOTION)):
        assert len(repr(shown)) < 200
    assert project.__repr__ is not object.__repr__


def test_a_missing_name_lists_what_is_there():
    with pytest.raises(KeyError, match=r"no 'mill'; there are 'house'"):
        RESULT.seismogram("simulated", "mill")
    with pytest.raises(KeyError, match=r"no 'mill'; there are 'house'"):
        RESULT.seismograms("simulated")["mill"]
    with pytest.raises(KeyError, match=r"no 'recorded'; there are 'simulated'"):
        RESULT.seismograms("recorded")


def test_a_project_of_tables_is_the_project_of_the_file(tmp_path):
    import tomllib

    path = written(tmp_path)
    from_tables = pyblast.Project.from_dict(tomllib.loads(path.read_text()), tmp_path)

    assert TEXT
    assert from_tables.config == pyblast.load_project(path).config
    assert from_tables.folder == tmp_path
    with pytest.raises(pyblast.InputError, match="missing; add them"):
        pyblast.Project.from_dict({"title": "nothing"})


def test_a_project_of_tables_has_no_file_to_hash(tmp_path):
    import tomllib

    assert pyblast.Project.from_dict(tomllib.loads(TEXT), tmp_path).input_files == {}


def test_tables_of_pandas_and_xarray_hold_all_motions():
    pytest.importorskip("pandas")
    frame = RESULT.to_pandas()
    assert frame["house", "east"].to_numpy() == pytest.approx(MOTION.velocity[:, 0])
    assert frame.index.name == "time_s"
    pytest.importorskip("xarray")
    data = RESULT.to_xarray()["house"]
    assert data.sel(component="north").to_numpy() == pytest.approx(MOTION.velocity[:, 1])


def test_a_notebook_shows_models_that_are_meshed_and_turns_them(tmp_path, monkeypatch):
    shown = {}
    html = SimpleNamespace(for_type_by_name=lambda _, name, show: shown.update({name: show}))
    shell = SimpleNamespace(display_formatter=SimpleNamespace(formatters={"text/html": html}))
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    project = pyblast.load_project(written(tmp_path))

    pyblast._show_in_notebooks()

    assert set(shown) == {"Model", "Project", "Result", "Diagnosis"}
    assert shown["Project"](project) is None  # not meshed yet
    assert shown["Model"](project.model).startswith("<iframe")
    assert shown["Project"](project) == pyblast.ModelView(project)._repr_html_()
