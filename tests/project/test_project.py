import math

import meshio
import numpy as np
import pytest
from small_project import TEXT, written

from pyblast.errors import InputError, ReadError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Roller, StressInput, Viscous
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.project.result import write_csv
from pyblast.signals.seismogram import Seismogram


def test_units_in_key_names_become_si(tmp_path):
    project = load_project(written(tmp_path))

    joint = project.joints[0]

    assert joint.properties["kn"] == pytest.approx(0.114e9)
    assert joint.properties["cohesion"] == pytest.approx(20e3)
    assert joint.properties["friction"] == pytest.approx(math.tan(math.radians(25.0)))
    assert project.materials["soil"].bulk == pytest.approx(125e6)
    assert project.materials["rock"].young == pytest.approx(18720e6)


def test_materials_are_given_in_three_ways(tmp_path):
    by_speeds = load_project(
        written(
            tmp_path, ("young_mpa = 18720\npoisson = 0.3", "cp_m_per_s = 3078\ncs_m_per_s = 1645")
        )
    )

    assert by_speeds.materials["rock"].cp == pytest.approx(3078.0)
    assert by_speeds.materials["rock"].cs == pytest.approx(1645.0)


def test_the_blast_has_rows_of_holes_away_from_the_face(tmp_path):
    blast = load_project(written(tmp_path)).blast

    assert len(blast.times) == 60
    assert np.unique(blast.times) == pytest.approx([0.0, 0.04, 0.08, 0.12])
    assert blast.charge_per_window() == pytest.approx(6750.0)
    assert blast.collar[:, 0].max() == pytest.approx(-39.0)
    assert blast.collar[:, 0].min() == pytest.approx(-39.0 - 3 * 6.5)
    assert np.ptp(blast.collar[:15, 1]) == pytest.approx(14 * 7.5)
    assert blast.length == pytest.approx(17.0)


def test_neighbouring_rows_are_staggered_by_half_a_spacing(tmp_path):
    blast = load_project(written(tmp_path)).blast

    assert abs(blast.collar[15, 1] - blast.collar[0, 1]) == pytest.approx(7.5 / 2.0)


def test_the_run_leads_by_the_delay_of_the_low_pass_which_is_taken_back(tmp_path):
    project = load_project(written(tmp_path))

    motion = project.input.motion

    assert motion.start == -project.lead
    assert project.lead == pytest.approx(0.336 / 20.0, rel=0.01)
    assert np.abs(motion.velocity[0]).max() < 1e-3 * motion.ppv.max()
    assert project.duration == pytest.approx(project.lead + 0.1)


def test_the_signature_is_one_line_away_from_a_record(tmp_path):
    record = Seismogram(np.random.default_rng(0).normal(size=(64, 3)), 1.0 / 256.0)
    write_csv(tmp_path / "hole.csv", record)
    cavity = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[input]")]
    recorded = '[signature]\nrecorded = { file = "hole.csv" }\n'
    path = written(tmp_path, (cavity, recorded), ('"signature.cavity", ', ""))

    signature = load_project(path).signature

    offset = record.velocity.mean(axis=0)
    assert signature.velocity == pytest.approx(record.velocity - offset, abs=1e-8)


def test_the_offset_of_a_recorder_does_not_add_up_over_the_holes(tmp_path):
    times = np.arange(-0.5, 1.5, 1.0 / 512.0)
    pulse = times * np.exp(-((times / 0.04) ** 2))
    record = Seismogram(np.outer(pulse, [1.0, 0.5, 0.2]) + 2e-4, 1.0 / 512.0, -0.5)
    write_csv(tmp_path / "hole.csv", record)
    cavity = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[input]")]
    recorded = '[signature]\nrecorded = { file = "hole.csv" }\n'
    path = written(tmp_path, (cavity, recorded), ('"signature.cavity", ', ""))

    motion = load_project(path).input.motion

    quiet = np.abs(motion.velocity[motion.times < -0.3]).max()
    assert quiet < 1e-5  # 60 holes would make 12 mm/s of 0.2 mm/s


def test_a_clipped_hole_is_refused_unless_the_user_accepts_it(tmp_path):
    times = np.arange(0.0, 1.0, 1.0 / 512.0)
    pulse = np.exp(-(((times - 0.3) / 0.1) ** 2)) * np.sin(60.0 * times)
    record = Seismogram(np.outer(np.clip(pulse, -0.5, 0.5), [1.0, 0.3, 0.2]), 1.0 / 512.0)
    write_csv(tmp_path / "hole.csv", record)
    cavity = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[input]")]
    recorded = '[signature]\nrecorded = { file = "hole.csv"%s }\n'
    clipped, accepted = (
        written(tmp_path, (cavity, recorded % more), ('"signature.cavity", ', ""))
        .rename(tmp_path / f"{number}.toml")
        for number, more in enumerate((", full_scale_mm_per_s = 500",
                                       ", full_scale_mm_per_s = 500, accept_clipped = true"))
    )  # fmt: skip
    full = int((np.abs(pulse) >= 0.5).sum())

    # the other components are cut at their own levels, far below the range
    counts = ", ".join(rf"{full} of {name}" for name in ("east", "north", "vertical"))
    with pytest.raises(InputError, match=rf"clipped \({counts}\), .* accept_clipped = true"):
        load_project(clipped).signature  # noqa: B018
    assert load_project(accepted).signature.ppv[0] > 0.4


def test_travel_times_without_places_are_refused(tmp_path):
    cavity = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[input]")]
    recorded = '[signature]\nrecorded = { file = "hole.csv" }\n'
    speed = ("delay_ms = 40\n", "delay_ms = 40\nwave_speed_m_per_s = 3000\n")
    path = written(tmp_path, (cavity, recorded), ('"signature.cavity", ', ""), speed)

    with pytest.raises(InputError, match="wave_speed_m_per_s: a recorded signature does not say"):
        load_project(path)


def test_a_receiver_without_height_stands_on_the_ground(tmp_path):
    receiver = load_project(written(tmp_path)).receivers[0]

    assert receiver.position == pytest.approx([55.0, 10.0, 30.0])
    assert receiver.azimuth == pytest.approx(math.pi / 2.0)


def test_a_receiver_outside_of_the_ground_is_refused(tmp_path):
    path = written(tmp_path, ("[55, 10]", "[99, 10]"))

    with pytest.raises(InputError, match=r"R1.position_m: lies outside of the ground, .* got 99"):
        load_project(path)


def test_the_default_reading_is_viscous_only(tmp_path):
    model = load_project(written(tmp_path)).model

    assert {b.surface for b in model.boundaries if isinstance(b, Viscous)} == {
        "west", "east", "south", "north", "bottom",
    }  # fmt: skip
    assert not [b for b in model.boundaries if isinstance(b, Roller)]


def test_the_literal_reading_fixes_all_viscous_surfaces_but_the_input_face(tmp_path):
    path = written(tmp_path, ('free = ["top"]', "viscous_and_fixed = true"))

    model = load_project(path).model

    assert {b.surface for b in model.boundaries if isinstance(b, Roller)} == {
        "east", "south", "north", "bottom",
    }  # fmt: skip


def test_the_stress_on_a_viscous_face_is_doubled(tmp_path):
    model = load_project(written(tmp_path)).model

    load = next(b for b in model.boundaries if isinstance(b, StressInput))

    assert load.surface == "west"
    assert model.doubles(load)


def test_edges_follow_from_edges_per_wavelength():
    from pyblast.config.ground import LayerConfig, MeshConfig
    from pyblast.ground.tables import mean_edge
    from pyblast.model.material import Material

    soil = Material(2000.0, 125e6, 57.7e6)
    layer = LayerConfig(material="soil", edges_per_wavelength=10.0)
    config = MeshConfig(size_m=[1.0, 1.0, 1.0], layers=[layer], frequency_hz=20.0, edge_m=5.0)

    assert mean_edge(config, layer, soil) == pytest.approx(0.85, rel=1e-3)
    assert mean_edge(config, LayerConfig(material="soil"), soil) == 5.0


def test_a_wrong_surface_is_refused_with_the_ones_there_are(tmp_path):
    project = load_project(written(tmp_path, ('"bottom"]', '"botom"]')))

    with pytest.raises(InputError, match=r"boundaries\.botom: no such surface; there are west"):
        _ = project.model


def test_assumptions_cover_the_keys_below_them(tmp_path):
    project = load_project(written(tmp_path))

    assert project.is_assumed("signature.cavity.radius_m")
    assert project.is_assumed("joints.F1.cohesion_kpa")
    assert not project.is_assumed("joints.F1.kn_gpa_per_m")


def test_every_input_file_has_a_hash(tmp_path):
    hashes = load_project(written(tmp_path)).input_files

    assert list(hashes) == ["project.toml"]
    assert len(hashes["project.toml"]) == 64


def test_a_surveyed_surface_drapes_the_ground(tmp_path):
    (tmp_path / "ground.csv").write_text("x_m,y_m,z_m\n0,0,30\n60,0,36\n0,20,30\n60,20,36\n")
    path = written(tmp_path, ("grid_cells = [6, 2, 3]", 'edge_m = 10\nsurface_file = "ground.csv"'))

    project = load_project(path)

    assert project.receivers[0].position[2] == pytest.approx(35.5, abs=0.1)
    assert list(project.input_files) == ["project.toml", "ground.csv"]


@pytest.mark.parametrize(
    ("text", "told"),
    [("east,north,up\n", r"line 1: missing columns: z .m."),
     ("x_m,y_m,z_m\n0,0,30\n60,zero,36\n", "line 3, column 2 .*: expected a number")],
)  # fmt: skip
def test_a_broken_surface_is_refused_with_its_line(tmp_path, text, told):
    (tmp_path / "ground.csv").write_text(text)
    path = written(tmp_path, ("grid_cells = [6, 2, 3]", 'edge_m = 10\nsurface_file = "ground.csv"'))

    with pytest.raises(ReadError, match=told):
        _ = load_project(path).ground.surface


def test_joint_sets_are_cut_to_their_layers(tmp_path):
    joint_set = """
[[mesh.joint_sets]]
name = "J1"
joint = "F1"
dip_deg = 90
dip_direction_deg = 90
spacing_m = 20
origin_m = [10, 0, 0]
regions = ["rock"]
[[mesh.faults]]"""
    path = written(
        tmp_path, ("grid_cells = [6, 2, 3]", "edge_m = 10"), ("[[mesh.faults]]", joint_set)
    )

    mesh = load_project(path).mesh

    trace = mesh.points[mesh.surfaces["J1"]]
    assert trace[:, :, 2].max() == pytest.approx(20.0)
    assert set(mesh.contacts.names) == {"J1", "F1"}


def test_a_mesh_file_takes_the_place_of_the_builder(tmp_path):
    box = structured_box((6, 2, 3), (60.0, 20.0, 30.0), planes={"F": ("x", 30.0)})
    sides = ("F", "west", "east", "south", "north", "bottom", "top")
    triangles = np.concatenate([box.surfaces[name] for name in sides])
    tags = np.repeat(np.arange(7) + 1, [len(box.surfaces[name]) for name in sides])
    cells = [("triangle", triangles), ("tetra", box.zones)]
    data = {"gmsh:physical": [tags, np.full(len(box.zones), 11)]}
    meshio.Mesh(box.points, cells, cell_data=data).write(tmp_path / "ground.vtu")
    built = TEXT[TEXT.index("[mesh]") : TEXT.index("[materials.soil]")]
    read = """[mesh]
file = "ground.vtu"
file_groups = { 11 = "rock" }
file_joints = { surface_1 = "F1" }
"""
    names = '["surface_2", "surface_3", "surface_4", "surface_5", "surface_6"]'
    path = written(
        tmp_path, (built, read), ('["west", "east", "south", "north", "bottom"]', names),
        ("low_pass_hz = 20", 'low_pass_hz = 20\nface = "surface_2"'),
        ('free = ["top"]', ""), ("[55, 10]", "[55, 10, 30]"),
    )  # fmt: skip

    project = load_project(path)

    assert project.model.mesh.contacts.names == ("surface_1",)
    assert project.model.joints[0].properties["kn"] == pytest.approx(0.114e9)
    assert "surface_1" in next(f.text for f in check(project, False).findings if f.code == "D8")
