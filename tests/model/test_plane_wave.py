"""Applied plane waves: what faces see, what a free surface sends back, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import (
    Damping,
    Fixed,
    InputError,
    Material,
    Model,
    PlaneWave,
    Receiver,
    SpongeLayer,
    StressInput,
    TimeFunction,
    Viscous,
    structured_box,
)
from pyblast.mesh.grid import Layer
from pyblast.model.material import ConstantQ
from pyblast.model.plane_wave import reflected, stress_of
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import ricker
from verification.solutions.free_surface import plane_field

ROCK = Material.from_speeds(2500.0, 3464.0, 2000.0)
SOFT = Material.from_speeds(2000.0, 1200.0, 600.0)
UP = np.array([0.0, 0.0, 1.0])
TIMES = np.arange(0.0, 0.15, 5e-4)
PULSE = TimeFunction(ricker(TIMES, 20.0), TIMES[1])
QUIET = ("west", "east", "south", "north", "bottom")


def block(wave, n=8, materials=None, layers=None, boundaries=(), **parts):
    """Return the model of a cube of 100 m whose quiet sides see a wave."""
    mesh = structured_box((n, n, n), (100.0, 100.0, 100.0), layers=layers, pattern="alternating")
    return Model(
        mesh,
        materials or {"rock": ROCK},
        boundaries=[*map(Viscous, QUIET), *boundaries],
        sources=[wave],
        **parts,
    )


def wave(kind="P", degrees=30.0, **about):
    return PlaneWave(kind, PULSE, np.radians(40.0), np.radians(degrees), **about)


@pytest.mark.parametrize("kind", ["P", "SV", "SH"])
def test_polarisations_are_along_the_path_or_across_it(kind):
    one = wave(kind, 25.0)

    assert np.linalg.norm(one.polarisation) == pytest.approx(1.0)
    assert one.polarisation @ one.direction == pytest.approx(1.0 if kind == "P" else 0.0, abs=1e-15)
    assert (one.polarisation[2] == 0.0) == (kind == "SH")


def test_a_plane_wave_carries_minus_its_impedance_times_its_velocity_across_its_fronts():
    way = np.array([0.6, 0.0, 0.8])
    lame, shear = ROCK.first_lame, ROCK.shear

    push = stress_of(way / ROCK.cp, way, lame, shear) @ way
    shake = stress_of(way / ROCK.cs, np.array([0.0, 1.0, 0.0]), lame, shear) @ way

    assert push == pytest.approx(-ROCK.density * ROCK.cp * way)
    assert shake == pytest.approx([0.0, -ROCK.density * ROCK.cs, 0.0], abs=1e-6)


@pytest.mark.parametrize(("kind", "degrees"), [("P", 0), ("P", 50), ("SV", 20), ("SH", 60)])
def test_a_level_surface_sends_back_what_textbooks_say(kind, degrees):
    wanted = plane_field(kind, np.radians(degrees), ROCK.cp, ROCK.cs)
    (slowness, motion), *back = wanted

    found = reflected(slowness, motion, ROCK.cp, ROCK.cs, UP)

    for (s, v), (s_wanted, v_wanted) in zip(found, back, strict=True):
        assert s == pytest.approx(s_wanted, abs=1e-12)
        assert v == pytest.approx(v_wanted, abs=1e-9)


@pytest.mark.parametrize("kind", ["P", "SV"])
def test_nothing_pulls_on_a_tilted_free_surface(kind):
    normal = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    one = wave(kind, 10.0)
    slowness = one.direction / (ROCK.cp if kind == "P" else ROCK.cs)
    waves = [(slowness, one.polarisation)]
    waves += reflected(slowness, one.polarisation, ROCK.cp, ROCK.cs, normal)

    pull = sum(stress_of(s, v, ROCK.first_lame, ROCK.shear) @ normal for s, v in waves)

    assert np.linalg.norm(pull) < 1e-12 * ROCK.density * ROCK.cp


def test_energy_that_arrives_at_the_surface_goes_back():
    slowness, motion = wave("SV", 20.0).direction / ROCK.cs, wave("SV", 20.0).polarisation

    back = reflected(slowness, motion, ROCK.cp, ROCK.cs, UP)

    pairs = zip(back, (ROCK.cp, ROCK.cs), strict=True)
    flux = [ROCK.density * (v @ v) * -s[2] * c**2 for (s, v), c in pairs]
    assert sum(flux) == pytest.approx(ROCK.density * slowness[2] * ROCK.cs**2)


def test_a_block_moves_as_the_half_space_around_it_would():
    model = block(wave("P", 35.0), n=12, receivers=[Receiver("mid", (52.0, 48.0, 55.0))])

    result = simulate(model, 0.2)

    record = result.seismograms["mid"]
    turn = np.radians(40.0)
    axes = np.array([[np.sin(turn), np.cos(turn), 0], [np.cos(turn), -np.sin(turn), 0], UP])
    field = plane_field("P", np.radians(35.0), ROCK.cp, ROCK.cs)
    place = axes @ (np.array([52.0, 48.0, 55.0]) - [0.0, 0.0, 100.0])
    first = field[0][0] @ axes @ [0.0, 0.0, -100.0]
    wanted = sum(np.outer(PULSE(record.times - s @ place + first), v @ axes) for s, v in field)
    misfit = np.linalg.norm(record.velocity - wanted) / np.linalg.norm(wanted)
    assert misfit < 0.08  # 12 edges to an S wave, which the surface makes; 0.073 at 12
    assert result.balance_error < 1e-12


def test_a_wave_that_runs_straight_up_is_a_stress_input_with_quiet_sides_left_out():
    motion = np.zeros((len(TIMES), 3))
    motion[:, 2] = PULSE.values
    slab = structured_box((2, 2, 12), (10.0, 10.0, 60.0))
    rollers = [Fixed(side, ("east", "north")) for side in ("west", "east", "south", "north")]
    common = {
        "mesh": slab,
        "materials": {"rock": ROCK},
        "receivers": [Receiver("top", (5.0, 5.0, 60.0))],
    }
    input_ = StressInput("bottom", Seismogram(motion, TIMES[1]))
    given = Model(boundaries=[*rollers, Viscous("bottom"), input_], **common)
    plane = PlaneWave("P", PULSE)
    seen = Model(boundaries=[*rollers, Viscous("bottom")], sources=[plane], **common)

    wanted, found = (simulate(model, 0.2).seismograms["top"].velocity for model in (given, seen))

    assert found == pytest.approx(wanted, abs=1e-12)


def test_a_quiet_top_sends_nothing_back():
    free = wave()

    loads = [
        len(prepare(block(one, boundaries=extra), 0.01).constants["load_node"])
        for one, extra in ((free, ()), (free, [Viscous("top")]),
                           (replace(free, free_surface=None), ()))
    ]  # fmt: skip

    per_face, more = loads[2], loads[1] - loads[2]
    assert loads[0] == 3 * per_face
    assert 0 < more < per_face


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "SV", "degrees": 50.0}, "SV meets 'top' at 50 degrees, beyond its critical"),
        ({"degrees": 120.0}, "does not run towards 'top'"),
        ({"surfaces": ["top"]}, "'top' must be viscous"),
        ({"free_surface": "ground"}, "no surface named 'ground'"),
    ],
)
def test_waves_that_can_not_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        prepare(block(wave(**change)), 0.01)


def test_media_that_differ_along_the_faces_are_refused_with_the_cure():
    layers = [Layer("soil", 25.0), Layer("rock")]

    with pytest.raises(InputError, match=r"one medium behind .* FreeField on the sides"):
        prepare(block(wave(), layers=layers, materials={"soil": SOFT, "rock": ROCK}), 0.01)


def test_ground_that_fades_by_a_law_is_refused():
    fading = replace(ROCK, law=ConstantQ(50.0, 40.0))

    with pytest.raises(InputError, match="does not attenuate, got the law ConstantQ of 'rock'"):
        prepare(block(wave(), materials={"rock": fading}), 0.01)


def test_a_sponge_layer_is_refused():
    sponge = SpongeLayer(((20.0, 80.0), (20.0, 80.0), (20.0, 100.0)), 20.0)

    with pytest.raises(InputError, match="plane_wave: a sponge layer would damp the wave"):
        prepare(block(wave(), sponge=sponge, damping=Damping(0.01, 5.0)), 0.01)


def test_a_hill_inside_does_not_matter_but_ground_that_bends_at_the_faces_does():
    def raised(height):
        model = block(wave())
        points = model.mesh.points.copy()
        points[:, 2] += height(*points[:, :2].T / 100.0) * points[:, 2] / 100.0
        return replace(model, mesh=replace(model.mesh, points=points))

    prepare(raised(lambda x, y: 300.0 * x * (1.0 - x) * y * (1.0 - y)), 0.01)

    with pytest.raises(InputError, match="must be plane where it meets the viscous"):
        prepare(raised(lambda x, y: 20.0 * x * (1.0 - x) + 0.0 * y), 0.01)


def test_a_wave_of_an_unknown_kind_is_refused():
    with pytest.raises(InputError, match="must be P, SV or SH, got 'S'"):
        PlaneWave("S", PULSE)


def test_a_wave_that_would_be_in_the_model_already_is_refused():
    with pytest.raises(InputError, match=r"plane_wave\.history: must begin at 0 or later"):
        PlaneWave("P", replace(PULSE, start=-0.1))


def test_an_inclination_beyond_straight_down_is_refused():
    with pytest.raises(InputError, match=r"plane_wave\.inclination: must lie in 0 to pi"):
        PlaneWave("P", PULSE, inclination=4.0)
