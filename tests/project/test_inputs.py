"""Sources, absorbing layer, damping and velocity in a project file, on the small column."""

import math

import numpy as np
import pytest
from small_project import TEXT, written
from typer.testing import CliRunner

from pyblast.blasts.signature import SmoothPulse, cavity_moment, cavity_response
from pyblast.cli.commands import app
from pyblast.config.sources import ChargedHoleConfig
from pyblast.errors import InputError, ReadError
from pyblast.model.boundary import StressInput, VelocityInput
from pyblast.model.material import Material
from pyblast.project.checks import check
from pyblast.project.project import load_project
from pyblast.sources.inside import make_moment_rate

FACE = TEXT[TEXT.index("[signature.cavity]") : TEXT.index("[[receivers]]")]
HOLE = """
[holes_inside]
low_pass_hz = "none"

[holes_inside.charged_hole]
material = "rock"
charge_kg = 16
radius_m = 0.5
pressure_mpa = 100
peak_time_ms = 40
"""
INSIDE = (
    (FACE, HOLE), ('"signature.cavity"', '"holes_inside"'), ("rows = 4", "rows = 2"),
    ("holes_per_row = 15", "holes_per_row = 2"), ("[-39, 10, 30]", "[20, 10, 30]"),
)  # fmt: skip
FORCE = '[[point_forces]]\nposition_m = [20, 10]\ndirection = [0, 0, -2]\nfile = "hammer.csv"\n'
ROCK = Material.from_young_poisson(2660.0, 18.72e9, 0.3)
LAYER = "[absorbing_layer]\nbox_m = [[5, 50], [2, 18], [10, 30]]\nwidth_m = 10\n"


def inside(folder, *changes):
    return load_project(written(folder, *INSIDE, *changes))


def hit(folder, *changes, head="time_s,force_kn", start=0.0):
    times = start + 0.001 * np.arange(41)
    rows = [f"{t:.4f},{3.0 * math.sin(math.pi * k / 40.0)}" for k, t in enumerate(times)]
    (folder / "hammer.csv").write_text("\n".join([head, *rows]))
    blast = TEXT[TEXT.index("[blast]") : TEXT.index("[[receivers]]")]
    return load_project(
        written(folder, (blast, FORCE), ('"signature.cavity", ', ""), *changes)
    )  # fmt: skip


def test_holes_take_place_charge_and_time_from_the_blast(tmp_path):
    project = inside(tmp_path, ("delay_ms = 40", "delay_ms = 40\ncharge_exponent = 0.7"))

    holes = project.sources

    assert np.array([h.position for h in holes]) == pytest.approx(project.blast.centres)
    assert [h.time for h in holes] == pytest.approx([0.0, 0.0, 0.04, 0.04])
    assert {(h.charge, h.exponent) for h in holes} == {(450.0, 0.7)}
    assert not [b for b in project.model.boundaries if isinstance(b, StressInput)]


def test_firing_scatter_before_zero_begins_the_run_earlier(tmp_path):
    project = inside(tmp_path, ("delay_ms = 40", "delay_ms = 0\nscatter_ms = 5"))

    assert project.lead == pytest.approx(-project.firing.times.min())
    assert project.lead > 0.0
    assert min(hole.time for hole in project.sources) == pytest.approx(0.0, abs=1e-12)


def charged(radius, charge, exponent):
    hole = ChargedHoleConfig(
        material="rock", charge_kg=charge, radius_m=radius, pressure_mpa=100, peak_time_ms=40
    )
    return make_moment_rate(hole, exponent, {"rock": ROCK})


def test_the_moment_of_a_charged_hole_is_brought_to_one_kilogram():
    moment = charged(0.5, 16.0, 0.7).integral().values * 16.0**0.7

    assert moment.max() == pytest.approx(cavity_moment(0.5, 1e8, ROCK.cp, ROCK.cs), rel=1e-4)


def test_the_moment_of_a_charged_hole_moves_the_rock_as_its_cavity_does():
    rate, r = charged(0.5, 1.0, 1.0), 50.0
    late = np.arange(10_001) * 2e-5 - r / ROCK.cp

    slope = np.gradient(rate.values, rate.dt)
    times = rate.dt * np.arange(len(slope))
    near, far = (np.interp(late, times, v, 0.0, 0.0) for v in (rate.values, slope))
    point = (near / r**2 + far / (ROCK.cp * r)) / (4.0 * math.pi * ROCK.density * ROCK.cp**2)
    pulse = SmoothPulse(1e8, 0.04)
    exact = cavity_response(ROCK.density, ROCK.cp, ROCK.cs, 0.5, pulse, r, 2e-5, 0.2)

    # But for the first three samples of the rate, whose slope is taken one-sided here.
    later = late > 3 * rate.dt
    assert np.abs(point - exact)[later].max() < 0.005 * np.abs(exact).max()


def test_a_moment_rate_is_read_from_a_table(tmp_path):
    rows = [f"{0.001 * k},{1e6 * k * (20 - k)}" for k in range(21)]
    (tmp_path / "rate.csv").write_text("\n".join(["time_s,moment_rate_per_kg_Nm_per_s", *rows]))
    project = inside(tmp_path, (HOLE, '[holes_inside]\nmoment_rate_file = "rate.csv"\n'))

    rate = project.inside.moment_rate

    assert rate.dt == pytest.approx(0.001)
    assert rate.values.max() == pytest.approx(1e8)
    assert list(project.input_files) == ["project.toml", "rate.csv"]


@pytest.mark.parametrize(
    ("text", "told"),
    [("time_s,moment\n", "line 1: missing columns: moment_rate_per_kg .Nm/s."),
     ("time_s,moment_rate_per_kg_Nm_per_s\n0,1\n1,x\n", "line 3, column 2 .*: expected a number"),
     ("time_s,moment_rate_per_kg_Nm_per_s\n0,1\n0.1,2\n", "at least 4 lines of numbers, got 2"),
     ("time_s,moment_rate_per_kg_Nm_per_s\n0,1\n1,2\n2,1\n4,0\n", "must grow by equal steps"),
     ("time_s,moment_rate_per_kg_Nm_per_s\n3,1\n2,2\n1,1\n0,0\n", "must grow by equal steps")],
    ids=["head", "text", "short", "uneven", "backward"],
)  # fmt: skip
def test_a_broken_moment_rate_is_refused_with_its_place(tmp_path, text, told):
    (tmp_path / "rate.csv").write_text(text)
    project = inside(tmp_path, (HOLE, '[holes_inside]\nmoment_rate_file = "rate.csv"\n'))

    with pytest.raises(ReadError, match=told):
        _ = project.sources


def test_the_centre_of_holes_inside_is_that_of_their_far_motion(tmp_path):
    common = "[damping]\nratio = 0.0112\nfrequency_hz = 4"
    project = inside(tmp_path, (common, ""), ("delay_ms = 40", "delay_ms = 0"))

    assert project.shot.central_frequency == pytest.approx(3.0 / (2.0 * math.pi * 0.04), rel=0.05)


def test_the_band_of_a_force_holds_95_percent_of_the_energy_of_its_slope(tmp_path):
    project = hit(tmp_path)

    force = project.inside.forces[0]
    power = np.abs(np.fft.rfft(np.gradient(force.values, force.dt), 4096)) ** 2
    half_a_line = 13.0
    below = np.fft.rfftfreq(4096, force.dt) <= project.shot.highest_frequency + half_a_line
    assert power[below].sum() / power.sum() == pytest.approx(0.95, abs=0.04)


REFUSED = [
    ("nothing enters", (HOLE, ""), "signature: missing; add it, or"),
    ("both ways", (HOLE, FACE[: FACE.index("[input]")] + HOLE), "the blast enters twice"),
    ("two moments", ("[holes_inside]\n", '[holes_inside]\nmoment_rate_file = "a"\n'),
     "holes_inside: give one of moment_rate_file; charged_hole"),
    ("phase of none", ('low_pass_hz = "none"', 'low_pass_hz = "none"\nzero_phase = true'),
     "zero_phase is of a low-pass"),
    ("input beside", (HOLE, f"{HOLE}[input]\nlow_pass_hz = 20\n"), "input: needs [signature]"),
    ("reference", ("charge_kg = 450\ndia", "charge_kg = 450\nreference_charge_kg = 9\ndia"),
     "blast.reference_charge_kg: the moment rate is of 1 kg"),
    ("wave speed", ("charge_kg = 450\ndia", "charge_kg = 450\nwave_speed_m_per_s = 9\ndia"),
     "blast.wave_speed_m_per_s: waves cross the model"),
    ("zero force", ("[[receivers]]", f"{FORCE.replace('-2', '0')}[[receivers]]"),
     "point_forces[1]: direction must not be [0, 0, 0]"),
    ("crooked layer", ("[[receivers]]", f"{LAYER.replace('[5, 50]', '[50, 5]')}[[receivers]]"),
     "absorbing_layer.box_m: needs low below high on each axis, got 50 and 5 for x"),
    ("full layer", ("[[receivers]]",
                  "[absorbing_layer]\nbox_m = [[0, 60], [0, 20], [0, 30]]\nwidth_m = 5\n"
                  "[[receivers]]"),
     "absorbing_layer.box_m: holds the whole ground"),
    ("receiver in the layer", ("[[receivers]]", f"{LAYER}[[receivers]]"),
     "receivers.R1: lies in the absorbing layer, which damps motion"),
    ("hole in the layer", ("[[receivers]]", f"{LAYER.replace('[5, 50]', '[22, 59]')}[[receivers]]"),
     "blast: hole 1-1: lies in the absorbing layer"),
    ("hole outside", ("[20, 10, 30]", "[-39, 10, 30]"), "blast: hole 1-1: "),
    ("open side", ('"south", "north"', '"south"'), "boundaries.viscous: lacks 'north'"),
    ("unknown rock", ('material = "rock"\ncharge', 'material = "clay"\ncharge'),
     "holes_inside: charged_hole.material: must be one of soil, rock, got 'clay'"),
    ("receiver below", ("[55, 10]", "[55, 10, -20]"), "receivers.R1: "),
    ("receiver beside", ("[55, 10]", "[75, 10]"), "receivers.R1.position_m: lies outside"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "told"), [row[1:] for row in REFUSED],
                         ids=[row[0] for row in REFUSED])  # fmt: skip
def test_what_can_not_be_is_refused_in_one_sentence(tmp_path, change, told):
    with pytest.raises(InputError) as found:
        _ = inside(tmp_path, change).model

    text = str(found.value)
    assert text.startswith("project.toml: ")
    assert told in text
    assert text.count("project.toml") == 1
    assert "\n" not in text


def test_a_blast_that_does_not_enter_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"blast: needs \[signature\], \[holes_inside\] or"):
        hit(tmp_path, ("[[receivers]]", "[blast]\nfile = 'a.csv'\n[[receivers]]"))


def test_holes_without_a_blast_are_refused(tmp_path):
    blast = TEXT[TEXT.index("[blast]") : TEXT.index("[signature.cavity]")]

    with pytest.raises(InputError, match=r"holes_inside: needs \[blast\]"):
        load_project(written(tmp_path, (blast, ""), *INSIDE[:2]))


def test_a_sponge_damps_outside_of_its_box_only(tmp_path):
    project = inside(tmp_path, ("[55, 10]", "[48, 10]"), ("[[receivers]]", f"{LAYER}[[receivers]]"))
    model = project.model

    plain = inside(tmp_path, ("[55, 10]", "[48, 10]")).model
    added = model.zone_damping("alpha") - plain.zone_damping("alpha")
    west = model.mesh.points[model.mesh.zones].mean(axis=1)[:, 0] < 5.0
    assert added[west].min() > 0.0
    assert added.min() == 0.0


def test_a_sponge_may_be_told_the_lowest_frequency_that_shall_leave(tmp_path):
    text = f"{LAYER}lowest_hz = 6\n[[receivers]]"

    sponge = inside(tmp_path, ("[55, 10]", "[48, 10]"), ("[[receivers]]", text)).model.sponge

    assert (sponge.width, sponge.lowest) == (10.0, 6.0)


def test_only_dashpots_around_holes_inside_are_doubtful(tmp_path):
    found = {f.code for f in check(inside(tmp_path), False).findings}

    assert "D22" in found
    assert found.isdisjoint({"D4", "D6", "D7", "D17", "D21"})


def test_a_force_has_its_direction_and_its_unit(tmp_path):
    force = hit(tmp_path).sources[0]

    assert force.position == pytest.approx([20.0, 10.0, 30.0])
    assert force.direction == pytest.approx([0.0, 0.0, -1.0])
    assert force.history.values.max() == pytest.approx(3000.0)


def test_a_force_before_zero_begins_the_run_earlier(tmp_path):
    project = hit(tmp_path, head="time_s,force_n", start=-0.02)

    assert project.lead == pytest.approx(0.02)
    assert project.sources[0].history.start == pytest.approx(0.0)
    assert project.sources[0].history.values.max() == pytest.approx(3.0)


def test_a_force_acts_beside_a_blast_on_the_face(tmp_path):
    hit(tmp_path)
    project = load_project(written(tmp_path, ("[[receivers]]", f"{FORCE}[[receivers]]")))

    assert len(project.model.sources) == 1
    assert project.sources[0].history.start == pytest.approx(project.lead)
    assert [b for b in project.model.boundaries if isinstance(b, StressInput)]


def test_there_is_nothing_to_add_up_without_a_signature(tmp_path):
    done = CliRunner().invoke(app, ["superpose", str(written(tmp_path, *INSIDE))])

    assert done.exit_code == 2


def test_a_material_may_have_a_damping_of_its_own(tmp_path):
    own = "poisson = 0.3\ndamping = { ratio = 0.05, frequency_hz = 10, mass = false }"
    damping = load_project(written(tmp_path, ("poisson = 0.3", own))).model.damping

    assert (damping["rock"].ratio, damping["rock"].frequency) == (0.05, 10.0)
    assert not damping["rock"].mass
    assert (damping["soil"].ratio, damping["soil"].frequency) == (0.0112, 4.0)


def test_a_material_without_any_damping_has_none(tmp_path):
    own = "poisson = 0.3\ndamping = { ratio = 0.05, frequency_hz = 10 }"
    common = "[damping]\nratio = 0.0112\nfrequency_hz = 4\n"
    project = load_project(written(tmp_path, ("poisson = 0.3", own), (common, "")))

    assert project.model.damping["soil"].ratio == 0.0
    assert [f for f in check(project, False).findings if "In 'rock'" in f.text]


def test_the_motion_may_be_prescribed_on_its_face(tmp_path):
    path = written(
        tmp_path, ("low_pass_hz = 20", 'low_pass_hz = 20\nenters_as = "velocity"'),
        ('viscous = ["west", ', "viscous = ["),
    )  # fmt: skip

    boundaries = load_project(path).model.boundaries

    assert [b.surface for b in boundaries if isinstance(b, VelocityInput)] == ["west"]
    assert not [b for b in boundaries if isinstance(b, StressInput)]


def test_a_velocity_on_a_viscous_face_is_refused_with_the_reason(tmp_path):
    path = written(tmp_path, ("low_pass_hz = 20", 'low_pass_hz = 20\nenters_as = "velocity"'))

    with pytest.raises(InputError, match=r"boundaries\.west: a velocity can't .* its dashpots"):
        _ = load_project(path).model


def test_an_unknown_way_to_enter_is_refused(tmp_path):
    path = written(tmp_path, ("low_pass_hz = 20", 'low_pass_hz = 20\nenters_as = "force"'))

    with pytest.raises(InputError, match=r"input\.enters_as: must be 'stress', .* 'plane_wave'"):
        load_project(path)
