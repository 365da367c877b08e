"""What quiet faces do to plane waves: drained sides, and the impedance of jointed rock."""

import math

import numpy as np
import pytest
from small_project import TEXT, written

from pyblast import Joint, Material, Model, Receiver, Seismogram
from pyblast.mesh.builder import structured_box
from pyblast.model.anisotropy import jointed
from pyblast.model.boundary import Fixed, Roller, StressInput, Viscous
from pyblast.project.checks import check
from pyblast.project.checks_ground import (
    dissipating_sides,
    jointed_face,
    jointed_stiffness,
    transmitted_share,
)
from pyblast.project.project import load_project
from pyblast.solver.loads import surface_impedance
from pyblast.solver.run import simulate

ROCK = Material(4500.0, 32.1e9, 14.8e9)
KN, KS = 1.5e9, 0.734e9
EAST, NORTH = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def ricker(frequency, dt=2e-3):
    """A short push to the east and its sampling."""
    squared = (np.pi * frequency * (np.arange(0.0, 3.2 / frequency, dt) - 1.4 / frequency)) ** 2
    return Seismogram(np.outer((1.0 - 2.0 * squared) * np.exp(-squared), EAST), dt)


def test_a_quiet_side_drains_a_long_wave_as_foretold():
    mesh = structured_box((30, 4, 4), (300.0, 60.0, 60.0))
    model = Model(
        mesh,
        {"rock": ROCK},
        boundaries=[
            *map(Viscous, ("west", "east", "south")),
            StressInput("west", ricker(5.0)),
            *map(Roller, ("north", "bottom", "top")),
        ],
        receivers=[Receiver(str(x), (x, 30.0, 30.0)) for x in (50.0, 150.0)],
    )
    face, side = (sum(surface_impedance(model, n).values()) for n in ("west", "south"))

    peaks = [s.ppv[0] for s in simulate(model, 0.75).seismograms.values()]

    assert peaks[1] / peaks[0] == pytest.approx(
        transmitted_share(face, side, 100.0 / 300.0)[0], rel=0.05
    )


def test_d23_is_said_only_where_sides_take_much():
    assert dissipating_sides(("south",), np.array([0.9, 0.8, 0.8]), "R", True) is None
    assert dissipating_sides((), np.array([1.0, 0.1, 0.1]), "R", False) is None
    assert "north" in dissipating_sides(("north",), np.array([0.5, 0.1, 0.2]), "R", False).text


def test_rock_without_joints_keeps_its_stiffness():
    stiffness = jointed_stiffness(ROCK, [])

    eye = np.eye(3)
    lame = np.einsum("ij,kl->ijkl", eye, eye) * ROCK.first_lame
    shear = np.einsum("ik,jl->ijkl", eye, eye) + np.einsum("il,jk->ijkl", eye, eye)
    assert stiffness == pytest.approx(lame + ROCK.shear * shear, rel=1e-12, abs=1e-3)


def test_waves_across_one_set_are_as_slow_as_the_layered_closed_form():
    numbers = jointed_face("rock", ROCK, [(EAST, KN, KS, 14.0)], EAST).numbers

    modulus = ROCK.density * ROCK.cp**2
    assert numbers["speed_p"] == pytest.approx(1.0 / math.sqrt(1.0 + modulus / (14.0 * KN)))
    assert numbers["speed_s"] == pytest.approx(1.0 / math.sqrt(1.0 + ROCK.shear / (14.0 * KS)))


def test_waves_along_one_set_feel_only_its_lateral_strain():
    along = jointed_face("rock", ROCK, [(NORTH, 1e7, 1e7, 14.0)], EAST).numbers

    ratio = ROCK.first_lame / (ROCK.first_lame + 2.0 * ROCK.shear)
    modulus = ROCK.density * ROCK.cp**2
    soft = modulus / (14.0 * 1e7) / (1.0 + modulus / (14.0 * 1e7))
    assert along["speed_p"] == pytest.approx(math.sqrt(1.0 - ratio**2 * soft), rel=1e-9)


def test_a_face_of_jointed_rock_moves_more_than_asked_for_by_the_number_of_d24():
    planes = {f"j{n}": ("x", 7.0 + 14.0 * n) for n in range(60)}
    mesh = structured_box((240, 1, 1), (840.0, 3.5, 3.5), planes=planes).split(list(planes))
    model = Model(
        mesh,
        {"rock": ROCK},
        joints=[Joint(name, "elastic", {"kn": KN, "ks": KS}) for name in planes],
        boundaries=[Viscous("west"), StressInput("west", ricker(4.0)), Viscous("east")]
        + [Fixed(side, ("north", "vertical")) for side in ("south", "north", "bottom", "top")],
        receivers=[Receiver("inside", (420.0, 1.75, 1.75))],
    )

    peak = simulate(model, 0.65).seismograms["inside"].ppv[0]

    joints = [(EAST, KN, KS, 14.0)]
    excess = jointed_face("rock", ROCK, joints, EAST).numbers["excess_p"]
    assert peak == pytest.approx(1.0 + excess, rel=0.01)


def test_stiff_joints_are_no_defect():
    assert jointed_face("rock", ROCK, [(EAST, 1e12, 1e12, 14.0)], EAST) is None


def test_a_check_tells_what_quiet_sides_take_on_the_way_to_the_receiver(tmp_path):
    findings = check(load_project(written(tmp_path))).findings

    finding = next(f for f in findings if f.code == "D23")
    assert "bottom, north, south" in finding.text
    assert "R1" in finding.text
    assert 0.0 < finding.numbers["north"] < finding.numbers["east"] < 1.0


def test_rollers_on_the_sides_take_nothing(tmp_path):
    rollers = written(
        tmp_path,
        ('"south", "north", "bottom"]', ']\nroller = ["south", "north", "bottom"]'),
    )

    assert "D23" not in [f.code for f in check(load_project(rollers)).findings]


SET = """[[mesh.joint_sets]]
name = "F1"
dip_deg = 90
dip_direction_deg = 90
spacing_m = 12
persistence = 0.5
"""
CLOSING = """law = "closure"
kn_gpa_per_m = 0.114
ks_gpa_per_m = 0.025
closure_mm = 1
insitu_pressure_kpa = 342
"""


def with_a_closing_set(folder, *changes):
    """Write the small project with a set of closing joints, half of their planes rock."""
    fault = "[[mesh.faults]]" + TEXT.split("[[mesh.faults]]")[1].split("[materials.soil]")[0]
    law = 'law = "coulomb"' + TEXT.split('law = "coulomb"')[1].split("[boundaries]")[0]
    cells = ("grid_cells = [6, 2, 3]", "edge_m = 12")
    assumed = (', "joints.F1.cohesion_kpa"', "")
    swapped = ((fault, SET + "\n"), (law, CLOSING + "\n"), cells, assumed)
    return load_project(written(folder, *swapped, *changes))


def test_faces_and_d24_meet_joints_as_their_pressure_has_closed_them(tmp_path):
    quiet = 'free = ["top"]'
    plain = with_a_closing_set(tmp_path)
    knowing = with_a_closing_set(tmp_path, (quiet, quiet + "\njointed_faces = true"))
    rock = plain.materials["rock"]
    kn, ks = 2.0 * 0.114e9 * 16.0, 2.0 * 0.025e9  # (1 + p/(kn Vm))^2 over half the area

    finding = next(
        f for f in check(plain, False).findings if f.code == "D24" and "'rock'" in f.text + f.title
    )
    wanted = jointed_face("rock", rock, [(EAST, kn, ks, 12.0)], EAST).numbers
    assert finding.numbers == pytest.approx(wanted)
    viscous = {b.surface: b for b in knowing.model.boundaries if isinstance(b, Viscous)}
    found = viscous["west"].media["rock"].law.stiffness
    stiffness = jointed(rock, EAST, 12.0, kn, ks).law.stiffness
    assert found == pytest.approx(stiffness, rel=1e-6, abs=1e3)
