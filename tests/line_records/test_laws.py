"""Records without a model: each law on made records, named where it is and not where it isn't."""

from dataclasses import replace

import numpy as np
import pytest
from blast_cause import blast_cause
from closure_law import closure_law, hyperbola
from line_shots import DT, FREQUENCY, N, ground, shot, tampered

from pyblast.errors import InputError
from pyblast.line_records.quality import odd_channels, sensor_response
from pyblast.line_records.shots import shifted
from pyblast.line_records.waves import (
    Picks,
    air_wave,
    fit_layer,
    rayleigh_speeds,
    soft_layer,
    without_outliers,
)


def test_a_line_of_good_receivers_has_no_odd_one():
    assert odd_channels(ground(), (10.0, 60.0))[0].outcome == "NULL"


@pytest.mark.parametrize(
    ("label", "change", "knob", "value"),
    [
        ("polarity", {"flip": True}, "factor", -1.0),
        ("clock_error", {"late": 6e-3}, "shift", 6e-3),
        ("wrong_coordinates", {"moved": 0.8}, "move", 0.8),
    ],
)
def test_an_odd_receiver_is_named_with_its_size(label, change, knob, value):
    said = odd_channels(tampered(ground(), **change), (10.0, 60.0))

    assert [(v.outcome, v.label, v.target) for v in said] == [("NAMED", label, (9,))]
    assert said[0].parameters[knob][0] == pytest.approx(value, rel=0.1)
    assert said[0].held_out[1] > said[0].held_out[0]


@pytest.mark.parametrize("seed", range(3))
def test_a_receiver_of_noise_carries_no_signal_and_has_no_polarity(seed):
    rng = np.random.default_rng(seed)
    shots = ground()
    for each in shots:
        each.motion[9] = each.motion.std() * rng.normal(size=N)

    said = odd_channels(shots, (10.0, 60.0))

    assert [(v.outcome, v.label, v.target) for v in said] == [("NAMED", "no_signal", (9,))]


def test_from_one_end_clock_and_place_are_one_class():
    said = odd_channels(tampered(ground()[::2] * 2, late=6e-3), (10.0, 60.0))

    assert (said[0].outcome, said[0].label) == ("CLASS", "clock_error | wrong_coordinates")


@pytest.mark.parametrize(("speed", "outcome"), [(343.0, "NAMED"), (180.0, "NULL"), (450.0, "NULL")])
def test_only_a_wave_of_the_speed_of_air_is_an_air_wave(speed, outcome):
    made = [replace(shot(s, speed, (150.0, 350.0), n), start=-0.05) for n, s in enumerate([-6, 50])]

    said = air_wave(made, (120.0, 400.0))

    assert said.outcome == outcome
    assert said.parameters["speed"][0] == pytest.approx(speed, rel=0.01)


def test_noise_holds_no_air_wave():
    made = [replace(one, motion=np.random.default_rng(4).normal(size=(24, N))) for one in ground(1)]

    assert air_wave(made, (120.0, 400.0)).outcome == "NULL"


def test_rayleigh_speed_of_a_half_space_is_that_of_the_closed_form():
    found = rayleigh_speeds([10.0, 40.0], [3.0], [100.0, 100.0], poisson=0.25)

    assert found == pytest.approx(91.94, rel=2e-3)


@pytest.mark.long
def test_a_soft_layer_is_named_and_a_half_space_is_not():
    frequency = np.geomspace(5.0, 80.0, 30)
    slow = np.interp(FREQUENCY, frequency, rayleigh_speeds(frequency, [3.0], [150.0, 280.0]))
    for speeds, outcome in ((slow, "NAMED"), (190.0, "NULL")):
        left, right = ([shot(s, speeds, (10.0, 60.0), n) for n in range(3)] for s in (-5.0, 51.0))

        said = soft_layer(left, right, (10.0, 50.0))

        assert said.outcome == outcome
        if outcome == "NAMED":
            assert said.parameters["vs_layer"][0] == pytest.approx(150.0, rel=0.1)


def test_a_resonant_sensor_is_named_only_beside_one_known_to_be_flat():
    rng = np.random.default_rng(2)
    flat = rng.normal(size=(2, 8000)) + 0.0
    f = np.fft.rfftfreq(8000, 1e-4)
    reply = 1.0 / np.abs(1.0 - (f / 800.0) ** 2 + 0.3j * f / 800.0)
    bent = np.fft.irfft(np.fft.rfft(flat) * reply, 8000)
    band, names = (200.0, 3000.0), ("a", "b")

    known = sensor_response(bent, flat, 1e-4, band, names=names, reference="b")
    unknown = sensor_response(bent, flat, 1e-4, band, names=names)
    nothing = sensor_response(2.0 * flat, flat, 1e-4, band, names=names, reference="b")

    assert (known.outcome, known.target) == ("NAMED", ("a",))
    assert known.parameters["corner"][1] < 800.0 < known.parameters["corner"][2]
    assert known.parameters["damping"][0] == pytest.approx(0.15, abs=0.02)
    assert unknown.outcome == "CLASS"
    assert nothing.outcome == "NULL"


@pytest.mark.parametrize("power", [0, 2])
def test_a_sensor_of_one_corner_is_named_with_its_corner_and_damping(power):
    flat = np.random.default_rng(3).normal(size=(2, 8000))
    r = np.fft.rfftfreq(8000, 1e-4) / 700.0
    bent = np.fft.irfft(np.fft.rfft(flat) * r**power / (1.0 - r**2 + 1j * r), 8000)

    for first, second, reference in ((bent, flat, "b"), (flat, bent, "a")):
        said = sensor_response(
            first, second, 1e-4, (200.0, 3000.0), names=("a", "b"), reference=reference
        )

        assert said.outcome == "NAMED"
        assert said.parameters["corner"][0] == pytest.approx(700.0, rel=0.03)
        assert said.parameters["damping"][0] == pytest.approx(0.5, abs=0.05)
        assert ("geophone" if power else "accelerometer") in said.reason


def test_a_curve_of_many_peaks_has_a_size_and_no_corner():
    flat = np.random.default_rng(3).normal(size=(2, 8000))
    f = np.fft.rfftfreq(8000, 1e-4)
    wavy = 0.8 * np.sin(6.0 * np.pi * np.log(np.maximum(f, 1.0) / 200.0) / np.log(15.0))
    bent = np.fft.irfft(np.fft.rfft(flat) * np.exp(wavy), 8000)

    said = sensor_response(bent, flat, 1e-4, (200.0, 3000.0), names=("a", "b"), reference="b")

    assert said.outcome == "NAMED"
    assert said.parameters.keys() == {"departure"}
    assert said.parameters["departure"][0] == pytest.approx(0.8 / np.sqrt(2.0), rel=0.1)


def test_shots_that_clip_at_different_receivers_are_not_mixed():
    shots = ground()
    spoilt = [one.only(np.arange(24) != (5 if n % 2 else 15)) for n, one in enumerate(shots)]

    with pytest.raises(InputError, match="at the same receivers"):
        odd_channels(spoilt, (10.0, 60.0))


def test_a_shift_that_explains_little_is_not_named():
    shots = tampered(ground(), late=6e-3)
    for each in shots:
        each.motion[9] += 2.0 * each.motion[9].std() * np.sin(2.0 * np.pi * 30.0 * each.times + 1.0)

    said = odd_channels(shots, (10.0, 60.0))

    assert [(v.outcome, v.label, v.target) for v in said] == [("UNKNOWN", "clock_error", (9,))]
    assert said[0].p_value < 0.001
    assert "too small a gain" in said[0].reason


@pytest.mark.long
def test_outlying_picks_do_not_move_the_layer():
    f = np.geomspace(10.0, 60.0, 14)
    speed = rayleigh_speeds(f, [3.0], [150.0, 280.0])
    right = Picks(f, speed, 0.01 * speed)
    wrong = replace(
        right, speed=speed + 120.0 * (np.arange(14) == 6) + 90.0 * (np.arange(14) == 11)
    )

    kept = without_outliers(wrong)

    assert len(without_outliers(right).speed) == 14
    assert np.setdiff1d(f, kept.frequency).tolist() == f[[6, 11]].tolist()
    assert np.exp(fit_layer(kept, 0.4)[0][1]) == pytest.approx(150.0, rel=0.02)
    assert np.exp(fit_layer(wrong, 0.4)[0][1]) != pytest.approx(150.0, rel=0.02)


@pytest.mark.long
def test_a_hyperbola_of_closure_is_named_with_its_stiffness_and_a_line_is_not():
    closure = np.linspace(0.0, 1e-4, 13)
    rng = np.random.default_rng(0)
    bent = [hyperbola((2e10, 1.6e-4, 2e5), closure) * (1 + 0.01 * rng.normal(size=13))
            for _ in range(2)]  # fmt: skip
    straight = [6e10 * closure + 2e4 * rng.normal(size=13) for _ in range(2)]

    said = closure_law([closure] * 2, bent)

    assert said.outcome == "NAMED"
    assert said.parameters["kni"][1] < 2e10 < said.parameters["kni"][2]
    assert closure_law([closure] * 2, straight).outcome == "NULL"


@pytest.mark.long
def test_firing_times_charges_and_nothing_are_told_apart():
    rng = np.random.default_rng(1)
    pulse = np.exp(-np.arange(200) * 0.02) * np.sin(0.2 * np.arange(200))
    greens = np.stack([[np.convolve(rng.normal(size=40), pulse) for _ in range(6)]
                       for _ in range(4)])  # fmt: skip
    nominal = np.array([0.0, 0.04, 0.08, 0.12])

    def blast(times, scales):
        made = sum(a * shifted(np.pad(g, ((0, 0), (0, 200))), np.full(6, t), DT)
                   for g, t, a in zip(greens, times, scales, strict=True))  # fmt: skip
        return made + 0.02 * made.std() * rng.normal(size=made.shape)

    late = nominal + np.array([0.002, -0.003, 0.004, -0.001])
    ask = [(late, np.ones(4)), (nominal, np.array([1.0, 0.5, 1.3, 0.0])), (nominal, np.ones(4))]
    said = [blast_cause(greens, blast(*one), DT, nominal, sigma=3e-3) for one in ask]

    assert [v.outcome for v in said] == ["NAMED", "NAMED", "NULL"]
    assert [v.label for v in said[:2]] == ["delay_scatter", "misfire_or_charge_error"]
    assert said[0].parameters["time_2"][0] == pytest.approx(late[2], abs=2e-4)


def test_too_few_shots_are_refused():
    with pytest.raises(InputError, match="at least 4 shots"):
        odd_channels(ground(1), (10.0, 60.0))
