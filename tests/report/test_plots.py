import html
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from pyblast.report.pages import page
from pyblast.report.plots import axis_of, dots, line, page_plot, panel, segments, tables

HOSTILE = "</script><script>alert(\"&')</script>"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


def drawn(*marks, **axes):
    x = axes.get("x", axis_of("time [s]"))
    return page_plot("words", panel(x, axes.get("y", axis_of("PPV [mm/s]")), marks))


def rendered(plot):
    """Return a page of one plot."""
    text = page("figure.html").render(f={"title": HOSTILE, "image": plot})
    return f"<body>{text}<script>{page('plots.js').render()}</script></body>"


def test_a_long_line_keeps_its_ends_and_its_peak():
    time = np.linspace(0.0, 1.0, 100_001)
    wave = np.sin(40.0 * time)
    wave[51_234] = 9.0

    mark = line(time, wave)

    assert len(mark["x"]) <= 802
    assert max(mark["y"]) == 9.0
    assert mark["x"][int(np.argmax(mark["y"]))] == pytest.approx(0.51234)
    assert (mark["x"][0], mark["x"][-1]) == (0.0, 1.0)
    assert mark["x"] == sorted(mark["x"])


def test_values_that_are_not_finite_are_no_points_and_no_numbers_of_json():
    mark = dots([1.0, np.nan, 3.0], [np.inf, 2.0, 4.0])

    assert json.loads(json.dumps(mark, allow_nan=False))["x"] == [1.0, None, 3.0]
    assert mark["y"] == [None, 2.0, 4.0]


def test_a_table_says_what_the_plot_shows():
    scale = {"label": "gain", "low": 0.0, "high": 1.0, "colours": "viridis"}
    houses = axis_of("", ticks={0.0: "farm"})
    parts = panel(axis_of("PPV [mm/s]"), houses, [
        segments([1.0], [0.0], [2.5], [0.0], "bands"),
        dots([1.5], [0.0], "median", values=[0.25], text=["M1"]),
    ], scale=scale)  # fmt: skip

    (table,) = tables(page_plot("words", parts))

    assert table["heads"] == ["", "PPV [mm/s]", "", "to", "gain"]
    assert table["rows"] == [
        ["bands", "1", "farm", "2.5", ""],
        ["median: M1", "1.5", "farm", "", "0.25"],
    ]


def test_a_table_of_a_long_line_holds_its_peak_in_few_rows():
    values = np.zeros(500)
    values[333] = -7.0

    (table,) = tables(drawn(line(np.arange(500.0), values)))

    assert ["", "333", "-7"] in table["rows"]
    assert len(table["rows"]) <= 24


def test_hostile_names_end_no_script_and_open_no_tag():
    text = rendered(drawn(dots([1.0], [2.0], HOSTILE, text=[HOSTILE])))

    assert HOSTILE not in text
    assert text.count("</script>") == 2  # data, and what draws them
    data = re.search(r'(?s)<script type="application/json">(.*?)</script>', text)[1]
    assert json.loads(data)["panels"][0]["marks"][0]["name"] == HOSTILE


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_browser_draws_points_at_their_places_and_says_their_values(tmp_path):
    mark = dots([0.0, 5.0, 10.0], [1.0, 10.0, 100.0], HOSTILE)
    text = rendered(
        drawn(mark, x=axis_of("time [s]", 0.0, 10.0), y=axis_of("a [m]", 1.0, 100.0, log=True))
    )
    probe = """<script>
    var dots = Array.from(document.querySelectorAll("svg circle[stroke='#fff']")).map(
      function (c) { return [Number(c.getAttribute("cx")), Number(c.getAttribute("cy"))]; });
    var svg = document.querySelector("svg");
    svg.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
    svg.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
    document.title = JSON.stringify({ dots: dots, 
      said: document.querySelector(".readout").textContent,
      scripts: document.scripts.length, open: document.querySelector("details.values").open });
    </script>"""
    (tmp_path / "page.html").write_text(text + probe, encoding="utf-8")

    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
         f"file://{tmp_path}/page.html"], capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip

    said = json.loads(html.unescape(re.search(r"<title>(.*?)</title>", done.stdout)[1]))
    (x0, y0), (x1, y1), (x2, y2) = said["dots"]
    assert x1 - x0 == pytest.approx(x2 - x1)  # linear
    assert y0 - y1 == pytest.approx(y1 - y2)  # logarithmic: decades are equal
    assert y0 > y1
    assert said["said"] == f"{HOSTILE}: time 5 s, a 10 m"
    assert said["scripts"] == 3  # data, what draws, this probe: none from a name
    assert not said["open"]
