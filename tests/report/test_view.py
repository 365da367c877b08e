import base64
import hashlib
import html
import json
import os
import re
import shutil
import subprocess
from importlib import resources

import numpy as np
import pytest
from small_project import written

from pyblast.mesh.builder import structured_box
from pyblast.mesh.faces import faces_of_skin, zone_faces
from pyblast.model.boundary import Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.project.project import load_project
from pyblast.project.result import Result, read_result
from pyblast.report import view
from pyblast.report.pages import page
from pyblast.report.view import ModelView, scene, with_diagnosis
from pyblast.workflows import run

ROCK = Material.from_speeds(2700.0, 5000.0, 3000.0)
HOSTILE = "</script><script>alert(\"&')</script>"
THREE = "0.187.0"
THREE_SHA256 = "d1d5c61329dff42cc0ad85794fa8695222b61b016f933933a15acf63e083f972"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    return run.run(written(folder), report=False).folder


@pytest.fixture(scope="module")
def result(folder):
    return read_result(folder)


def numbers(text, kind="<u2"):
    return np.frombuffer(base64.b64decode(text), kind)


def corners(drawn, part):
    """Return the corners (n, 3, 3) of the triangles of a part, as the script reads them."""
    points = drawn["low"] + drawn["step"] * numbers(part["points"]).reshape(-1, 3)
    return points[numbers(part["triangles"], "<u4" if part["wide"] else "<u2").reshape(-1, 3)]


def values(drawn, part, key):
    """Return the values of a field at the points of a part, as the script reads them."""
    field, level = drawn["fields"][key], numbers(part["of_point"][key]).astype(float)
    share = np.where(level > 0.0, (level - 1.0) / 65534.0, np.nan)
    if field["log"]:
        return field["low"] * (field["high"] / field["low"]) ** share
    return field["low"] + share * (field["high"] - field["low"])


def volume(triangles):
    """Return the volume within closed triangles (n, 3, 3) that look outward."""
    return np.linalg.det(triangles).sum() / 6.0


def layered(cells, size):
    """Return a model of two layers, the upper of two thirds of the height."""
    mesh = structured_box(cells, size)
    low = mesh.points[mesh.zones].mean(axis=1)[:, 2] < size[2] / 3.0
    groups = np.where(low, 0, 1)
    mesh = type(mesh)(mesh.points, mesh.zones, groups, ("base", "soil"), mesh.surfaces)
    return Model(mesh, {"base": ROCK, "soil": ROCK})


FULL_SPACE = """
title = "full space"
[mesh]
size_m = [60, 60, 60]
frequency_hz = 15
[[mesh.layers]]
material = "rock"
[materials.rock]
density_kg_per_m3 = 2600
cp_m_per_s = 4000
cs_m_per_s = 2300
[boundaries]
viscous = ["bottom", "south", "north", "west", "east", "top"]
[run]
duration_s = 0.05
[[point_forces]]
position_m = [30, 30, 30]
direction = [0, 0, 1]
file = "force.csv"
[[receivers]]
name = "a"
position_m = [45, 30, 30]
"""


def test_a_full_space_is_reported_without_a_surface_of_ground(tmp_path):
    # no face of the box looks upward: its top lies within the absorbing layer
    time = np.arange(0.0, 0.2, 1e-3)
    pulse = 1e6 * np.exp(-(((time - 0.05) / 0.02) ** 2))
    np.savetxt(tmp_path / "force.csv", np.c_[time, pulse], "%.9g", ",", header="time_s,force_n",
               comments="")  # fmt: skip

    folder = run.run(written(tmp_path, text=FULL_SPACE)).folder

    assert "<html" in (folder / "report.html").read_text()
    assert not (folder / "surface_peaks.csv").exists()
    assert "ppv" not in scene(read_result(folder))["fields"]


def test_each_material_is_closed_and_has_its_volume():
    drawn = scene(layered((4, 3, 6), (40.0, 30.0, 60.0)))

    (ground,) = drawn["parts"]
    triangles, group = corners(drawn, ground), numbers(ground["of_triangle"]["group"])
    assert len(triangles) == 2 * (4 * 4 * 3 + 2 * 6 * (4 + 3))  # with both sides of the interface
    for number, height in enumerate((20.0, 40.0)):
        own = triangles[group == number]
        area = np.cross(own[:, 1] - own[:, 0], own[:, 2] - own[:, 0])
        np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-6)
        assert volume(own) == pytest.approx(40.0 * 30.0 * height, rel=1e-3)


def test_halves_of_a_shared_face_that_are_cut_by_other_diagonals_are_no_skin():
    points = np.array([[x, y, z] for x in (0, 1, 2) for y in (0, 1) for z in (0, 1)], dtype=float)
    cube = structured_box((1, 1, 1), (1.0, 1.0, 1.0))
    near = {tuple(p): n for n, p in enumerate(points)}
    left = np.array([near[tuple(cube.points[n])] for n in cube.zones.ravel()]).reshape(-1, 4)
    turned = cube.points * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0]  # mirrored: the other diagonals
    right = [near[tuple(turned[n] + [1.0, 0.0, 0.0])] for n in cube.zones.ravel()]
    mirrored_y = cube.points * [1.0, -1.0, 1.0] + [1.0, 1.0, 0.0]
    other = [near[tuple(mirrored_y[n])] for n in cube.zones.ravel()]
    for second in (right, other):
        zones = np.concatenate([left, np.array(second).reshape(-1, 4)[:, [1, 0, 2, 3]]])
        face = faces_of_skin(zones, np.arange(12) // 6, np.arange(12))

        triangles = points[zone_faces(zones)[face]]
        assert len(face) == 2 * 10  # two cubes have ten outer faces
        assert volume(triangles) == pytest.approx(2.0)


def test_a_single_tetrahedron_has_four_faces():
    assert len(faces_of_skin(np.array([[0, 1, 2, 3]]), np.zeros(1, int), np.zeros(1, int))) == 4


def test_a_block_that_can_move_out_is_marked():
    mesh = structured_box((2, 1, 1), (2.0, 1.0, 1.0), planes={"cut": ("x", 1.0)}).split(["cut"])
    joint = Joint("cut", "elastic", {"kn": 1e9, "ks": 1e9})
    model = Model(mesh, {"rock": ROCK}, joints=[joint], boundaries=[Viscous("west")])

    drawn = scene(model)

    ground = drawn["parts"][0]
    east = corners(drawn, ground).mean(axis=1)[:, 0] > 1.0
    removable = numbers(ground["of_triangle"]["removable"])
    np.testing.assert_array_equal(removable, east)  # the western block is held


def test_a_thinned_view_keeps_the_largest_value_and_says_what_it_lost(result, monkeypatch):
    whole = scene(result)
    monkeypatch.setattr(view, "MOST_BYTES", 3000)

    thinned = scene(result)

    held = [[p["points"], p["triangles"], *p["of_point"].values(), *p["of_triangle"].values()]
            for p in thinned["parts"]]  # fmt: skip
    # texts end in full groups of four letters
    assert 1500 < len("".join(each for part in held for each in part)) < 3040
    assert thinned["triangles"] < whole["triangles"]
    assert f"of {whole['triangles']}: what is smaller than" in thinned["said"]
    assert thinned["fields"]["ppv"]["high"] == whole["fields"]["ppv"]["high"]
    assert whole["said"] == f"{whole['triangles']} triangles"


def test_colours_and_clicks_have_the_values_of_the_run_at_their_places(result):
    drawn = scene(result)
    ground = drawn["parts"][0]
    stored = result.arrays["surface_peaks"]

    points = drawn["low"] + drawn["step"] * numbers(ground["points"]).reshape(-1, 3)
    shown = values(drawn, ground, "ppv")

    for point, peak in zip(stored["points"], 1e3 * stored["velocity"], strict=True):
        near = np.flatnonzero(np.linalg.norm(points - point, axis=1) <= drawn["step"])
        expected = max(peak, drawn["fields"]["ppv"]["low"])
        assert np.nanmin(np.abs(shown[near] / expected - 1.0)) < 2e-4


def test_the_offset_of_a_joint_is_the_jump_of_displacement_across_it(result):
    contacts, moved = result.arrays["contacts"], result.arrays["state"]["displacement"]
    jump = moved[contacts["plus"]] - moved[contacts["minus"]]
    opening = np.sum(jump * contacts["normal"], axis=1)
    slip = np.linalg.norm(jump - opening[:, None] * contacts["normal"], axis=1)

    drawn = scene(result)

    fault = drawn["parts"][1]
    assert (fault["name"], fault["kind"]) == ("F1", "fault")
    assert fault["largest_slip"] == pytest.approx(1e3 * slip.max())
    assert fault["largest_opening"] == pytest.approx(1e3 * opening.max())
    assert (fault["dip"], fault["direction"] % 180.0) == (pytest.approx(90.0), pytest.approx(90.0))
    assert fault["area"] == pytest.approx(20.0 * 30.0)


def test_holes_and_receivers_stand_at_their_places(tmp_path):
    project = load_project(written(tmp_path))

    drawn = scene(project)

    assert len(drawn["holes"]) == 60
    np.testing.assert_allclose(drawn["holes"][0]["collar"], project.blast.collar[0])
    np.testing.assert_allclose(drawn["holes"][-1]["toe"], project.blast.toe[-1])
    charges = [hole["column"] for hole in drawn["holes"]]
    np.testing.assert_allclose(charges, project.blast.columns)
    assert [hole["order"] for hole in drawn["holes"][::15]] == [1, 2, 3, 4]
    for receiver in project.receivers:
        position = drawn["receivers"][receiver.name]["position"]
        np.testing.assert_allclose(position, receiver.position)


def test_what_lies_outside_of_the_ground_that_counts_is_left_out(result):
    box = [[0.0, 25.0], [0.0, 20.0], [0.0, 30.0]]  # the padding of the mesh begins in the east

    drawn = scene(Result(result.arrays, result.summary | {"extent": box}))

    east = corners(drawn, drawn["parts"][0])[..., 0]
    assert drawn["box"] == box
    assert east.max() == pytest.approx(30.0, abs=drawn["step"])  # the zones that the end cuts
    assert [part["name"] for part in drawn["parts"]] == ["ground"]  # the fault stands at 30 m


def test_hostile_names_end_no_script_and_open_no_tag():
    box = structured_box((1, 1, 1), (9.0, 9.0, 9.0))
    mesh = type(box)(box.points, box.zones, box.zone_group, (HOSTILE,), box.surfaces)
    model = Model(mesh, {HOSTILE: ROCK}, receivers=(Receiver(HOSTILE, (1.0, 1.0, 9.0)),))
    shown = ModelView(model)

    text = page("view.html").render(scene=shown.scene)
    assert HOSTILE not in text
    assert text.count("</script>") == 1
    data = re.search(r'(?s)<script type="application/json">(.*?)</script>', text)[1]
    assert json.loads(data)["groups"] == [HOSTILE]
    frame = shown._repr_html_()
    assert frame.count("<") == 2  # of the frame alone: its page is an attribute
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame)[1]) == shown.page()
    addresses = set(re.findall(r"https?://[^\"']+|fetch\(|XMLHttp|import\(", shown.page()))
    assert addresses == {"http://www.w3.org/1999/xhtml"}  # a name space, which nobody loads


def test_receivers_take_the_colour_of_their_share_of_a_limit(result):
    limit = {"receiver": "R1", "share": 0.73}

    drawn = scene(Result(result.arrays, result.summary | {"compliance": {"rows": [limit]}}))

    assert drawn["receivers"]["R1"]["values"] == {"share": pytest.approx(73.0)}
    assert drawn["fields"]["share"]["low"] == pytest.approx(73.0)
    assert "share" not in scene(result)["fields"]


def test_a_diagnosis_marks_planes_with_effects_and_adds_those_that_the_model_lacks(result):
    square = np.array([[5.0, 0, 0], [5, 20, 0], [5, 20, 30], [5, 0, 30]])
    found = {"x": 30.0, "y": 10.0, "z": 4.0, "within_m": 8.0}

    drawn = with_diagnosis(scene(result), {"R1": 6.0}, {"F1": [], "found": [square]}, [found])

    kinds = {part["name"]: part["kind"] for part in drawn["parts"]}
    assert kinds == {"ground": "ground", "F1": "named", "found": "named"}
    added = drawn["parts"][-1]
    assert added["area"] == pytest.approx(600.0)
    assert (added["dip"], added["direction"] % 180.0) == (90.0, 90.0)
    np.testing.assert_allclose(
        corners(drawn, added), [square[[0, 1, 2]], square[[0, 2, 3]]], atol=drawn["step"]
    )
    assert drawn["receivers"]["R1"]["values"]["misfit"] == 6.0
    assert drawn["located"] == [found]
    assert next(iter(drawn["fields"])) == "misfit"


def test_three_is_the_pinned_one_with_its_licence():
    text = source("three.min.js")
    licence = source("three.LICENSE")

    assert text.startswith(f"/*! three.js {THREE}\n")
    assert licence.startswith("The MIT License")
    assert licence.strip() in text  # every page that holds it keeps its licence
    assert hashlib.sha256(text.encode()).hexdigest() == THREE_SHA256
    assert "</script" not in text


def source(name):
    return (resources.files("pyblast.report") / "templates" / name).read_text(encoding="utf-8")


SWIFTSHADER = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")  # no graphics card


def in_browser(folder, text, probe, *options):
    """Return what a script finds in a page, by the title that it leaves."""
    script = f"<script>setTimeout(function () {{ {probe} }}, 50)</script></body>"
    (folder / "page.html").write_text(text.replace("</body>", script), encoding="utf-8")
    done = subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", *(options or SWIFTSHADER),
         "--window-size=900,800", "--host-resolver-rules=MAP * ~NOTFOUND",
         "--virtual-time-budget=5000", "--dump-dom", f"file://{folder}/page.html"],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return json.loads(html.unescape(re.search(r"<title>(.*?)</title>", done.stdout)[1]))


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_browser_without_webgl_says_so_and_lists_what_the_view_shows(result, tmp_path):
    probe = """document.title = JSON.stringify([
      document.querySelector(".view .readout").textContent,
      document.querySelectorAll(".view canvas, .view select").length,
      document.querySelector("details.values").open]);"""

    without = "--disable-gpu", "--disable-3d-apis"
    out = in_browser(tmp_path, ModelView(result).page(), probe, *without)

    assert out[0].startswith("This browser has no WebGL")
    assert out[1:] == [0, True]


PROBE = """
var canvas = document.querySelector(".view canvas"), out = {};
function key(name) { canvas.dispatchEvent(new KeyboardEvent("keydown", { key: name })); }
function pick(name, value) {
  var s = document.querySelector(".view ." + name);
  s.value = value; s.onchange();
}
function pointer(kind, x, y) {
  var r = canvas.getBoundingClientRect();
  var at = { pointerId: 1, clientX: r.left + x, clientY: r.top + y, bubbles: true };
  canvas.setPointerCapture = canvas.releasePointerCapture = function () {};
  canvas.dispatchEvent(new PointerEvent("pointer" + kind, at));
}
function click(x, y) {
  pointer("down", x, y); pointer("up", x, y);
  return document.querySelector(".view .readout").textContent;
}
function picture() { return canvas.toDataURL(); }
out.ms = Number(canvas.dataset.ms);
var look = document.querySelector(".view select[aria-label='look from']");
look.value = "above"; look.onchange();
function found(low, high) {
  for (var at = 0; at < 4000; at++) {
    var x = 10 + 12 * (at % 70), y = 10 + 12 * Math.floor(at / 70);
    var text = click(x, y), height = Number((/height (-?[0-9.]+)/.exec(text) || [0, NaN])[1]);
    if (text.slice(0, 6) === "ground" && height > low && height < high) return text;
  }
  return "nothing found";
}
out.above = found(-1e9, 1e9);
var first = picture();
key("n"); out.first = document.querySelector(".view .readout").textContent;
pointer("down", 300, 200); pointer("move", 360, 240); pointer("up", 360, 240);
out.dragged = picture() !== first;
look.value = "south"; look.onchange(); out.turned = picture() !== first;
var whole = picture(); pick("cut", "north"); out.cut = picture() !== whole;
out.face = found(5, 25);
pick("cut", ""); look.value = "south"; look.onchange(); out.side = found(5, 25);
pick("field", "share"); out.share = document.querySelector(".view .names").textContent;
out.open = document.querySelector("details.values").open;
document.title = JSON.stringify(out);
"""


@pytest.mark.long
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_a_browser_turns_cuts_clicks_and_reads_numbers(result, tmp_path):
    drawn = scene(result)
    limits = {"rows": [{"receiver": "R1", "share": 0.73}]}
    judged = Result(result.arrays, result.summary | {"compliance": limits})

    out = in_browser(tmp_path, ModelView(judged).page(), PROBE)

    if os.getloadavg()[0] < os.cpu_count():  # else it is the time of others, too
        assert out["ms"] < 2000
    east, north, height = map(float, re.findall(r"-?\d+\.\d", out["above"])[:3])
    stored, peak = (
        result.arrays["surface_peaks"],
        float(re.search(r"sum ([\d.]+)", out["above"])[1]),
    )
    assert height == pytest.approx(30.0, abs=0.06)  # the top of the model
    near = np.argsort(np.linalg.norm(stored["points"] - [east, north, height], axis=1))[:6]
    around = 1e3 * stored["velocity"][near]
    assert 0.99 * around.min() < peak < 1.01 * around.max()
    assert out["first"].startswith("hole 1-1, number 1 to fire at east -39.0, north -44.4")
    assert out["dragged"]
    assert out["turned"]
    assert out["cut"]
    middle = float(re.search(r"north (-?[\d.]+)", out["face"])[1])
    assert middle == pytest.approx(10.0, abs=0.11)  # the cut goes through the middle
    assert "south side: viscous" in out["side"]
    assert not out["open"]
    assert "R1 73 %" in out["share"]
    assert drawn["fields"]["ppv"]["low"] <= peak <= drawn["fields"]["ppv"]["high"]
