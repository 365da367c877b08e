"""Thin soil by project files: widths, orders by cost, surveyed ground, faults that cut it."""

import subprocess
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from command_line import python
from slipping_box import digest

from pyblast.errors import InputError
from pyblast.project.checks_ground import summarise_model
from pyblast.project.project import Project
from pyblast.solver.assembly import time_step
from pyblast.solver.line_implicit import line_zones, steps_of_zones
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import integrated, simulate

ROCK = {"density_kg_per_m3": 2600.0, "cp_m_per_s": 4300.0, "cs_m_per_s": 2500.0, "qp": 100.0,
        "qs": 50.0, "quality_band_hz": [3.0, 100.0]}  # fmt: skip
SOIL = ROCK | {"density_kg_per_m3": 1900.0, "cp_m_per_s": 500.0, "cs_m_per_s": 250.0,
               "qp": 20.0, "qs": 20.0}  # fmt: skip
SIDES = ["west", "east", "south", "north", "bottom"]
TIMES = np.arange(0.0, 0.1, 5e-4)
PULSE = 1e9 * np.exp(-(((TIMES - 0.03) / 0.006) ** 2))


def project(folder, thickness=2.0, receivers=((330.0, 60.0),), soil=SOIL, joints=(),
            at=(40.0, 60.0, -20.0), **mesh):  # fmt: skip
    lines = [f"{t:.4f},{rate:.9g}" for t, rate in zip(TIMES, PULSE, strict=True)]
    (folder / "rate.csv").write_text("time_s,moment_rate_Nm_per_s\n" + "\n".join(lines))
    layers = [{"material": "soil", "thickness_m": thickness}, {"material": "rock"}]
    tables = {
        "title": "Thin soil",
        "mesh": {"origin_m": [0.0, 0.0, -60.0], "size_m": [360.0, 120.0, 60.0],
                 "frequency_hz": 60.0, "layers": layers, **mesh},
        "materials": {"rock": ROCK, "soil": soil},
        "boundaries": {"viscous": SIDES, "free": ["top"]},
        "moment_tensors": [{"position_m": list(at), "file": "rate.csv",
                            "tensor": [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]}],
        "receivers": [{"name": f"R{number}", "position_m": list(place)}
                      for number, place in enumerate(receivers)],
        "joints": {name: {"law": "elastic", "kn_gpa_per_m": 1.0, "ks_gpa_per_m": 0.5}
                   for name in joints},
        "run": {"duration_s": 0.1},
    }  # fmt: skip
    return Project.from_dict(tables, folder)


def test_soil_is_as_wide_as_rock_where_all_receivers_are_beyond_its_trapped_waves(tmp_path):
    """At 60 Hz 2 m of it take half a period; 3 x 4QH/pi are 153 m."""
    far, near = (
        project(tmp_path, receivers=at) for at in ([(330.0, 60.0)], [(330.0, 60.0), (120.0, 60.0)])
    )

    wide = [float(np.ptp(each.mesh.points[each.mesh.zones[:, :2], 0], axis=1).max())
            for each in (far, near)]  # fmt: skip

    assert wide[0] > 1.6 * wide[1]
    assert far.cost.seconds < 0.3 * near.cost.seconds
    assert far.accuracy.band.carried > 0.95 * 60.0
    assert near.accuracy.band.carried > 0.95 * 60.0


@pytest.mark.parametrize("thickness", [0.5, 2.0])
def test_the_order_is_the_one_of_the_least_cost(tmp_path, thickness):
    own = project(tmp_path, thickness)
    costs = {}
    for order in (3, 4, 5):
        table = own.sized.mesh.model_copy(update={"order": order})
        costs[order] = own.price(table).seconds

    built = summarise_model(own)

    order = int(built.elements.split("order ")[1][0])
    assert costs[order] < 1.3 * min(costs.values())


def survey(folder, height, size=(120.0, 120.0)):
    """Write a survey of heights and return its key."""
    x, y = (each.ravel() for each in np.meshgrid(*(np.linspace(0.0, side, 25) for side in size)))
    rows = np.column_stack([x, y, height(x, y)])
    np.savetxt(folder / "top.csv", rows, delimiter=",", header="x_m,y_m,z_m", comments="")
    return {"surface_file": "top.csv"}


def face(x, **more):
    """Return a bench of 10 m that drops to the east."""
    return {"crest_m": [[x, -50.0, 0.0], [x, 170.0, 0.0]], "height_m": 10.0, "face_dip_deg": 75.0,
            **more}  # fmt: skip


def trench(plan, foot=-1.0, top=0.0):
    """Return a fill of soil."""
    return {"material": "soil", "box_m": [*plan, [foot, top]]}


def uneven(folder, kind, soil=SOIL):
    """Return half a metre of soil with a surveyed surface, over joints that dip, cut by a fault."""
    if kind == "survey":
        parts = survey(folder, lambda x, y: 0.1 * np.sin(x / 25.0) * np.cos(y / 20.0))
    elif kind == "hill":
        parts = survey(folder, lambda x, y: 8.0 * np.sin(x / 40.0) * np.cos(y / 50.0))
        soil_on_it = {"material": "soil", "thickness_m": 0.5, "follows_surface": True}
        parts["layers"] = [soil_on_it, {"material": "rock"}]
    elif kind == "bench":
        parts = {"benches": [face(60.0)]}
    elif kind == "fill":
        parts = {"layers": [{"material": "rock"}], "fills": [trench([[60.0, 66.0], [0.0, 120.0]])]}
    elif kind == "fault":
        fault = {"name": "F", "through_m": [75.0, 60.0, 0.0], "dip_deg": 70,
                 "dip_direction_deg": 90}  # fmt: skip
        parts = {"joints": "F", "faults": [fault]}
    else:
        dips = {"name": "J", "dip_deg": 60, "dip_direction_deg": 90, "spacing_m": 60,
                "regions": ["rock"]}  # fmt: skip
        parts = {"joints": "J", "joint_sets": [dips]}
    return project(folder, 0.5, [(100.0, 70.0)], soil, size_m=[120.0, 120.0, 60.0], **parts)


KINDS = ["survey", "hill", "bench", "fault", "joints below"]


@pytest.mark.parametrize("thickness", [0.5, 2.0])
def test_soil_that_follows_a_hill_costs_at_most_twice_its_rock(tmp_path, thickness):
    soil = {"material": "soil", "thickness_m": thickness, "follows_surface": True}
    top = survey(tmp_path, lambda x, _: 20.0 * np.exp(-(((x - 180.0) / 90.0) ** 2)), (360.0, 120.0))

    own, bare = (
        summarise_model(project(tmp_path, **top, layers=layers))
        for layers in ([soil, {"material": "rock"}], [{"material": "rock"}])
    )

    assert "in a plain grid" in own.elements
    assert own.implicit
    assert own.nodes * own.steps < 2.0 * bare.nodes * bare.steps


@pytest.mark.parametrize("thickness", [0.5, 2.0])
def test_soil_on_a_straight_bench_costs_at_most_twice_its_rock(tmp_path, thickness):
    soil = {"material": "soil", "thickness_m": thickness}

    own, bare = (
        summarise_model(project(tmp_path, benches=[face(100.0)], layers=layers))
        for layers in ([soil, {"material": "rock"}], [{"material": "rock"}])
    )

    assert "between the planes" in own.elements
    assert own.nodes * own.steps < 2.0 * bare.nodes * bare.steps


def test_benches_that_bend_are_priced_as_what_is_cut_out_of_tetrahedra(tmp_path):
    bent = face(60.0) | {"crest_m": [[60.0, -50.0, 0.0], [66.0, 60.0, 0.0], [60.0, 170.0, 0.0]]}
    box = {"size_m": [120.0, 120.0, 60.0], "receivers": [(110.0, 60.0)], "benches": [bent]}
    rock = {"material": "rock"}
    own = project(tmp_path, layers=[rock], **box)

    built = summarise_model(own)

    assert 0.5 < own.cost.zones / built.zones < 2.0
    assert 0.5 < own.cost.steps / built.steps < 2.0
    soil = {"material": "soil", "thickness_m": 2.0}
    dear = project(tmp_path, layers=[soil, rock], minutes=1.0, **box).dear
    assert "benches whose lines are straight, level and parallel" in dear.text


@pytest.mark.parametrize(
    ("fill", "more"),
    [(trench([[200.0, 280.0], [30.0, 90.0]]), {}), (trench([[200.0, 206.0], [0.0, 120.0]]), {}),
     (trench([[140.0, 360.0], [0.0, 120.0]], -11.0, -10.0), {"benches": [face(100.0)]})],
    ids=["fill", "trench", "on a bench"],
)  # fmt: skip
def test_a_metre_of_fill_costs_at_most_twice_its_rock(tmp_path, fill, more):
    """Rock beside it is as flat and line-implicit, too, at its own width."""
    own, bare = (
        summarise_model(project(tmp_path, layers=[{"material": "rock"}], fills=fills, **more))
        for fills in ([fill], [])
    )

    assert own.implicit
    assert own.nodes * own.steps < 2.0 * bare.nodes * bare.steps


@pytest.mark.parametrize(
    ("more", "words"),
    [({"fills": [trench([[400.0, 410.0], [0.0, 120.0]])]}, "lies outside of the model"),
     ({"fills": [trench([[40.0, 50.0], [0.0, 120.0]])] * 2}, "materials and places of their own"),
     ({"fills": [trench([[40.0, 50.0], [0.0, 120.0]])], "kind": "tetrahedra"},
      "mesh.fills: asks for hexahedra between planes, here tetrahedra, as mesh.kind asks for")],
)  # fmt: skip
def test_a_fill_that_cannot_be_built_is_refused(tmp_path, more, words):
    with pytest.raises(InputError, match=words):
        _ = project(tmp_path, layers=[{"material": "rock"}], **more).mesh


@pytest.mark.parametrize(
    ("layers", "more", "words"),
    [(["soil", "rock"], {}, "'soil' is the material of a layer, too"),
     (["rock"], {"surface_file": "top.csv"}, "fills go without surface_file")],
)  # fmt: skip
def test_a_fill_that_contradicts_its_mesh_is_refused(tmp_path, layers, more, words):
    thick = [{"material": name, "thickness_m": 2.0} for name in layers[:-1]]
    fills = [trench([[40.0, 50.0], [0.0, 120.0]])]
    with pytest.raises(InputError, match=words):
        project(tmp_path, layers=[*thick, {"material": layers[-1]}], fills=fills, **more)


def test_a_source_in_a_fill_is_seen(tmp_path):
    fill, rock = trench([[0.0, 120.0], [0.0, 120.0]], -4.0), [{"material": "rock"}]
    below, within = (
        project(tmp_path, layers=rock, fills=[fill], at=(40.0, 60.0, height))
        for height in (-5.0, -3.0)
    )

    assert below.cost.seconds < 0.1 * within.cost.seconds


def test_what_no_layer_follows_is_refused_with_what_stands_in_the_way(tmp_path):
    soil = {"material": "soil", "thickness_m": 2.0, "follows_surface": True}
    with pytest.raises(InputError, match="follows_surface goes with surface_file"):
        project(tmp_path, layers=[soil, {"material": "rock"}])
    top = survey(tmp_path, lambda x, _: 0.0 * x, (360.0, 120.0))
    cut = project(tmp_path, **top, layers=[soil, {"material": "rock"}], kind="tetrahedra")
    with pytest.raises(InputError, match="follows_surface: asks for hexahedra between planes"):
        _ = cut.mesh


def test_a_source_in_soil_that_follows_a_hill_is_seen_by_its_depth(tmp_path):
    """At 8 m the source lies above the feet of the hill, and 12 m under its top."""
    soil = {"material": "soil", "thickness_m": 2.0, "follows_surface": True}
    top = survey(tmp_path, lambda x, _: 20.0 * np.exp(-(((x - 40.0) / 90.0) ** 2)), (360.0, 120.0))
    deep, within = (
        project(tmp_path, **top, layers=[soil, {"material": "rock"}], at=(40.0, 60.0, height))
        for height in (8.0, 19.0)
    )

    assert deep.cost.seconds < 0.1 * within.cost.seconds


@pytest.mark.parametrize("kind", KINDS)
def test_the_step_on_uneven_ground_is_that_of_the_rock(tmp_path, kind):
    own = uneven(tmp_path, kind).model
    bounds = steps_of_zones(own)
    soil = own.mesh.zone_group == own.mesh.groups.index("soil")

    assert np.array_equal(line_zones(own, bounds), soil)
    # Nodes that line-implicit zones share with rock have less mass left for the stiffness of rock.
    assert time_step(own)[0] > np.sqrt(0.75) * own.step_factor * bounds[0][~soil].min()
    assert time_step(own)[0] > 1.5 * own.step_factor * bounds[0][soil].min()
    assert own.highest_frequency()["soil"] > 0.95 * 60.0


@pytest.mark.long
@pytest.mark.parametrize("kind", [*KINDS, "fill"])
def test_energy_on_uneven_ground_is_balanced_to_rounding(tmp_path, kind):
    own = uneven(tmp_path, kind)

    run = own.simulate()

    assert run.balance_error < 1e-12


SCRIPT = """
import tempfile
import json
from pathlib import Path
from pyblast import _core
from pyblast.solver.run import simulate
from slipping_box import digest
from test_thin_soil import uneven
_core.pyblast_kinds.least_shared = 1
with tempfile.TemporaryDirectory() as folder:
    print(json.dumps(digest(simulate(uneven(Path(folder), "{kind}").model, 0.03))))
"""


@pytest.mark.long
@pytest.mark.parametrize("kind", [*KINDS, "fill"])
def test_uneven_ground_has_the_same_bits_on_threads_and_by_the_program(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(Path(__file__).parent)
    program = resources.files("pyblast") / "bin" / "pyblast-run"
    model = uneven(tmp_path, kind).model
    run, prepared = simulate(model, 0.03), prepare(model, 0.03)

    assert python(SCRIPT.replace("{kind}", kind), threads=2) == digest(run)
    if not program.is_file():
        pytest.skip("pyblast was built without the program pyblast-run")
    export(prepared, tmp_path / "model.h5")
    subprocess.run([str(program), tmp_path / "model.h5", tmp_path / "out.h5"], check=True)
    stored = integrated(model, prepared, tmp_path / "out.h5")
    assert np.array_equal(stored.seismograms["R0"].velocity, run.seismograms["R0"].velocity)
