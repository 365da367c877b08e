"""Grounds of every kind through project files: built as asked for, and by which elements."""

import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from pyblast import simulate
from pyblast.config.config import check_config
from pyblast.mesh.gmsh import MeshingError
from pyblast.mesh.hexahedral import swept
from pyblast.mesh.mesh import locate_in_zones
from pyblast.mesh.quality import explicit_work
from pyblast.project.checks import check
from pyblast.project.places import on_ground
from pyblast.project.project import make_project
from pyblast.simulation import recipe

SIDES = ["west", "east", "south", "north", "bottom", "top"]
JOINT = {"law": "elastic", "kn_gpa_per_m": 0.2, "ks_gpa_per_m": 0.1}
ROCK = {"density_kg_per_m3": 2600, "cp_m_per_s": 3000, "cs_m_per_s": 1700}
DEEP = {"density_kg_per_m3": 2650, "cp_m_per_s": 3600, "cs_m_per_s": 2100}


def fault(name, dip, towards, through, extent=None):
    part = {"name": name, "dip_deg": dip, "dip_direction_deg": towards, "through_m": list(through)}
    return part | ({} if extent is None else {"extent_m": list(extent)})


def joints(dip, towards, spacing, **more):
    angles = {"dip_deg": dip, "dip_direction_deg": towards}
    return {"name": "S", "spacing_m": spacing} | angles | more


def hill(size, height, slope=None, turn=0.0):
    """Return lines of a survey: a hill of a height over 60 m, or a slope of an angle, turned."""
    x, y = np.meshgrid(np.arange(-10, size[0] + 11, 10.0), np.arange(-10, size[1] + 11, 10.0))
    z = 60.0 + height * np.exp(
        -(((x - size[0] / 2) / (0.22 * size[0])) ** 2) - ((y - size[1] / 2) / (0.35 * size[1])) ** 2
    )
    if slope is not None:
        across = (x - 0.3 * size[0]) * np.cos(np.radians(turn))
        across += (y - 0.5 * size[1]) * np.sin(np.radians(turn))
        z = 60.0 + np.clip(across * np.tan(np.radians(slope)), 0.0, height)
    rows = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return "x_m,y_m,z_m\n" + "\n".join(",".join(f"{v:.4f}" for v in row) for row in rows)


@pytest.fixture
def ground(tmp_path):
    """Return a function that makes a project of a box, its planes, free sides and a survey."""
    t = np.arange(0.0, 0.12, 0.0005)
    a = (np.pi * 18.0 * (t - 0.06)) ** 2
    lines = zip(t, 1e6 * (1 - 2 * a) * np.exp(-a), strict=True)
    rows = [f"{time:.4f},{force:.6g}" for time, force in lines]
    (tmp_path / "f.csv").write_text("\n".join(["time_s,force_n", *rows]) + "\n")

    def made(size=(120, 90, 60), faults=(), sets=(), free=("top",), survey=None, **more):
        mesh = {"size_m": list(size), "layers": more.pop("layers", [{"material": "rock"}]),
                "faults": list(faults), "joint_sets": list(sets), "frequency_hz": 30,
                "kind": more.pop("kind", "auto")}  # fmt: skip
        if survey is not None:
            (tmp_path / "survey.csv").write_text(survey)
            mesh["surface_file"] = "survey.csv"
        at, force = more.pop("receiver", (85, 52, 55)), more.pop("force", (40, 40, 41))
        tables = {
            "title": "ground",
            "mesh": mesh,
            "materials": {"rock": ROCK, "deep": DEEP},
            "joints": {part["name"]: JOINT for part in (*faults, *sets)},
            "boundaries": {"viscous": [s for s in SIDES if s not in free], "free": list(free)},
            "point_forces": [{"position_m": list(force), "direction": [1, 2, -3], "file": "f.csv"}],
            "receivers": [{"name": "A", "position_m": list(at)}],
            "run": {"duration_s": 0.3},
        }
        return make_project(check_config(tables | more), tmp_path / "project.toml")

    return made


LAYERS = [{"material": "rock", "thickness_m": 25.0}, {"material": "deep"}]
EAST = ("top", "east")
SITES = [
    fault("F1", 56, 248.9, (96.37, 90.2, 80)), fault("F2", 56, 248.9, (126.97, 102.0, 80)),
    fault("F3", 56, 248.9, (142.92, 110.84, 58), (95, 53.07)),
]  # fmt: skip
OTHERS = [
    fault("F1", 60, 298.9, (131.06, 96.69, 80)), fault("F2", 60, 298.9, (101.91, 112.78, 80)),
    fault("F3", 60, 298.9, (60.42, 132.82, 58), (95, 50.81)),
]  # fmt: skip
MEETING = [fault("F", 60, 90, (60, 45, 60)), fault("G", 50, 270, (110, 45, 60))]
OBLIQUE = [fault("F", 60, 90, (50, 45, 60)), fault("G", 70, 40, (110, 60, 60))]
ACROSS = [fault("F", 60, 90, (100, 80, 60)), fault("G", 90, 0, (100, 80, 30), (60, 30))]
BELOW = {"force": (40, 40, 30), "receiver": (120, 52, 50)}
GROUNDS = {
    "free face, 60 degrees": dict(faults=[fault("F", 60, 90, (90, 45, 60))], free=EAST),
    "free face, 45 degrees": dict(faults=[fault("F", 45, 90, (100, 45, 60))], free=EAST),
    "free face in the west": dict(
        faults=[fault("F", 60, 270, (30, 45, 60))], free=("top", "west"), force=(80, 40, 41)
    ),
    "oblique set": dict(
        size=(200, 200, 60), sets=[joints(90, 30, 30.0)],
        force=(90, 90, 41), receiver=(120, 110, 60),
    ),
    "upright oblique fault": dict(size=(200, 160, 60), faults=[fault("F", 90, 60, (150, 120, 60))]),
    "upright, free face": dict(
        size=(200, 160, 60), faults=[fault("F", 90, 60, (150, 120, 60))], free=EAST
    ),
    "limited, strikes east": dict(faults=[fault("F", 90, 0, (62, 48, 45), (60, 30))]),
    "limited, under a hill": dict(
        size=(200, 90, 60), faults=[fault("F", 60, 90, (100, 45, 30), (40, 20))],
        survey=hill((200, 90), 33.0), **BELOW,
    ),
    "level planes under a hill": dict(
        size=(200, 90, 60), faults=[fault("F", 0, 0, (100, 45, 30))], layers=LAYERS,
        survey=hill((200, 90), 33.0), **BELOW,
    ),
    "steep slope": dict(
        size=(200, 90, 60), faults=[fault("F", 60, 90, (100, 45, 30))],
        survey=hill((200, 90), 35.0, 60.0), force=(40, 40, 30), receiver=(150, 52),
    ),
    "slope oblique to the sides": dict(
        size=(228, 194, 80), survey=hill((228, 194), 14.0, 40.0, 20.0),
        force=(40, 40, 30), receiver=(200, 150),
    ),
    "level set that comes out in a hill": dict(
        size=(200, 90, 60), sets=[joints(0, 0, 20.0)], survey=hill((200, 90), 20.0), **BELOW
    ),
    "three parallel, one limited": dict(size=(228, 194, 80), faults=SITES, force=(40, 40, 61)),
    "three parallel, another limited": dict(
        size=(232, 210, 80), faults=OTHERS, force=(40, 40, 61)
    ),
    "two dips that meet": dict(size=(160, 90, 60), faults=MEETING, force=(20, 40, 41)),
    "two dips and strikes": dict(size=(160, 120, 60), faults=OBLIQUE, force=(20, 40, 41)),
    "set and layer beside a fault": dict(
        size=(200, 120, 60), faults=[fault("F", 60, 90, (70, 45, 60))],
        sets=[joints(30, 90, 25.0)], layers=LAYERS, force=(20, 40, 41),
    ),
    "bedding": dict(size=(238, 145, 52), sets=[joints(8, 255, 23.8)], receiver=(33, 127, 52)),
    "upright across dipping": dict(size=(200, 160, 60), faults=ACROSS),
}  # fmt: skip
CUT = {
    "two dips and strikes",
    "level set that comes out in a hill",
}  # no grid serves


@pytest.mark.long
@pytest.mark.parametrize("name", GROUNDS)
def test_the_ground_is_built_as_the_file_asks(ground, name):
    built = ground(**GROUNDS[name]).meshed

    assert [str(row) for row in built.rows if not row.good] == []
    assert built.mesh.hexahedral
    assert ("of tetrahedra cut" in built.reason) == (name in CUT)
    nodes = len(built.mesh.zones) * built.mesh.order**3
    assert explicit_work(built.mesh) < 50.0 * nodes  # 2 cm between nodes: no step of 1e-8 ms


@pytest.mark.long
def test_more_receivers_leave_the_planes_of_a_set_as_they_are(ground):
    parts = GROUNDS["oblique set"]
    places = [(100, 100), (110, 95), (95, 105), (112, 108), (120, 110)]
    more = [{"name": f"R{n}", "position_m": [*at, 60]} for n, at in enumerate(places)]

    one, other = ground(**parts).meshed, ground(**parts, receivers=more).meshed

    normal = np.array([np.sin(np.radians(30.0)), np.cos(np.radians(30.0)), 0.0])
    planes = [
        np.unique(np.round(each.mesh.points[each.mesh.surfaces["S"]] @ normal, 6))
        for each in (one, other)
    ]
    np.testing.assert_array_equal(*planes)
    assert [row.built for row in other.rows if row.quantity == "planes"] == [9.0]


def test_one_fault_in_flat_ground_is_no_reason_for_a_finding(ground):
    """As the quick start: neither facets in the layer nor dashpots behind it are doubtful."""
    project = ground(faults=[fault("F", 70, 90, (60, 45, 60))], force=(30, 40, 41))

    checked = check(project)

    assert project.mesh.layer is not None
    assert {"D22", "D37", "D39"}.isdisjoint(finding.code for finding in checked.findings)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["hexahedra", "tetrahedra"])
def test_a_joint_that_sets_the_time_step_is_named_with_its_price(ground, kind):
    plane = [fault("F", 90, 90, (60, 45, 60))]
    steps = {}
    for stiffness in (5.0, 1e4):
        joint = {"F": JOINT | {"kn_gpa_per_m": stiffness}}
        project = ground(faults=plane, joints=joint, kind=kind)
        checked = check(project)
        steps[stiffness] = checked.summary.steps
        found = [finding for finding in checked.findings if finding.code == "D45"]
        assert bool(found) == (stiffness > 5.0)
    (finding,) = found
    assert "'F' with 10000 GPa/m" in finding.text
    assert "joint 'F'" in checked.summary.limited_by
    assert finding.numbers["price"] == pytest.approx(steps[1e4] / steps[5.0], rel=0.3)
    assert finding.numbers["enough"] < 200e9


def test_the_step_of_ground_with_quality_factors_is_found_in_seconds(ground):
    soft = {"density_kg_per_m3": 2000, "cp_m_per_s": 900, "cs_m_per_s": 450}
    quality = {"qp": 40, "qs": 20, "quality_band_hz": [1, 60]}
    project = ground(
        size=(300, 160, 60),
        materials={"rock": ROCK | quality, "deep": DEEP, "soil": soft | quality},
        layers=[{"material": "soil", "thickness_m": 6.0}, {"material": "rock"}],
        force=(40, 40, 41), receiver=(250, 120, 60),
    )  # fmt: skip
    told = []
    began = time.process_time()

    check(project, progress=lambda *report: told.append(report))

    assert time.process_time() - began < 20.0  # it was 280 s
    assert 20 <= sum(stage == "step" for stage, _, _ in told) <= 80


@pytest.mark.long
def test_every_place_of_a_hill_has_its_height_on_cut_tetrahedra(ground):
    size, heights = (160, 120), hill((160, 120), 9.0)
    project = ground(size=(*size, 60), faults=OBLIQUE, survey=heights, **BELOW)
    mesh = project.mesh
    survey = np.array([[float(v) for v in line.split(",")] for line in heights.split()[1:]])
    surface = LinearNDInterpolator(survey[:, :2], survey[:, 2])
    plan = np.random.default_rng(1).uniform((0.0, 0.0), size, (400, 2))

    assert "of tetrahedra cut" in project.meshed.reason
    built = np.array([on_ground(mesh, at)[2] for at in plan])
    off = built - surface(plan)
    assert np.sqrt(np.mean(off**2)) < 0.02 * 1700 / 30
    locate_in_zones(mesh, np.column_stack([plan, built]), 1e-6)


def test_a_candidate_that_fails_makes_room_for_the_next(ground, monkeypatch):
    """Zones that lack under a receiver, an error of the mesher: no reason to refuse a ground."""
    parts = dict(faults=[fault("F", 60, 90, (90, 45, 60))], receiver=(20, 45))
    assert "of tetrahedra cut" not in ground(**parts).meshed.reason

    def pierced(*arguments):
        mesh = swept.build_swept(*arguments)
        outer = np.concatenate([faces.ravel() for faces in mesh.surfaces.values()])
        away = np.linalg.norm(mesh.points[mesh.zones].mean(axis=1) - [21, 43, 8], axis=1)
        keep = (away > 30.0) | np.isin(mesh.zones, outer).any(axis=1)
        return replace(mesh, zones=mesh.zones[keep], zone_group=mesh.zone_group[keep])

    def failing(*_):
        raise MeshingError("gmsh could not mesh the section")

    monkeypatch.setitem(recipe.BUILDERS, "between the planes", failing)
    monkeypatch.setitem(recipe.BUILDERS, "swept along one direction", pierced)
    built = ground(**parts | {"receiver": (21, 43, 8)}).meshed

    assert "of tetrahedra cut" in built.reason
    assert "gmsh could not mesh the section" in built.reason
    assert "receivers.A, outside of the ground, m" in built.reason


def turned(position, quarter):
    """Return a position in a box of 120 x 120 m turned clockwise by quarters."""
    x, y = position[0] - 60.0, position[1] - 60.0
    for _ in range(quarter):
        x, y = y, -x
    return [x + 60.0, y + 60.0, position[2]]


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_a_turned_ground_gives_turned_records(ground, quarter):
    def motion(quarter):
        order = ["north", "east", "south", "west"]
        side = order[(order.index("east") + quarter) % 4]
        x, y, _ = turned((61.0, 62.0, 0.0), quarter)
        direction = [x - 60.0, y - 60.0, -2.0]
        at = partial(turned, quarter=quarter)
        model = ground(
            (120, 120, 60), [fault("F", 50, (90 + 90 * quarter) % 360, at((90, 60, 60)))],
            free=("top", side), receiver=at((100, 80, 60)),
            point_forces=[
                {"position_m": at((40, 50, 41)), "direction": direction, "file": "f.csv"}
            ],
        ).model  # fmt: skip
        seismogram = simulate(model, 0.12).seismograms["A"]
        assert seismogram.components == ("east", "north", "vertical")
        return seismogram.velocity

    east, north, vertical = motion(0).T
    for _ in range(quarter):
        east, north = north, -east
    expected = np.column_stack([east, north, vertical])
    difference = motion(quarter) - expected
    assert np.sum(difference**2) < 1e-18 * np.sum(expected**2)


def test_a_fault_that_dips_west_gives_the_mirrored_motion_through_the_west_face(ground, tmp_path):
    def motion(side, sign):
        mirror = lambda x: 60.0 + sign * (x - 60.0)  # noqa: E731
        tables = {"face": side, "enters_as": "stress"}
        towards = 90.0 if sign > 0.0 else 270.0
        t = np.arange(0.0, 0.1, 0.0005)
        pulse = 0.01 * np.sin(np.pi * np.minimum(t / 0.08, 1.0)) ** 2
        (tmp_path / "signature.csv").write_text(
            "time_s,east_m_per_s,north_m_per_s,vertical_m_per_s\n"
            + "\n".join(f"{a:.4f},{sign * v:.8g},{v:.8g},{0.5 * v:.8g}"
                        for a, v in zip(t, pulse, strict=True))
        )  # fmt: skip
        project = ground(
            faults=[fault("F", 54, towards, (mirror(70.0), 45, 60))],
            receiver=(mirror(40.0), 55, 60), input=tables, point_forces=[],
            signature={"recorded": {"file": "signature.csv"}}, blast=None,
        )  # fmt: skip
        return simulate(project.model, 0.15).seismograms["A"].velocity

    east, west = motion("east", 1.0), motion("west", -1.0) * [-1.0, 1.0, 1.0]
    assert np.sum((east - west) ** 2) < 1e-18 * np.sum(west**2)
