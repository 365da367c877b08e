"""Trusted shots: the source is what all receivers share, gains and model errors are receivers'."""

from dataclasses import make_dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
import small_site

from pyblast.config.config import DiagnosisConfig
from pyblast.diagnosis.calibration import taught
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.library.instruments import (
    moved_along_line,
    pairs_of_near_receivers,
    swapped_channels,
)
from pyblast.diagnosis.library.paths import loss_along_paths
from pyblast.diagnosis.trusted_shots import explained, learned, time_shifted, with_source

DT, N, RECEIVERS = 2e-3, 300, 8
TIMES = DT * np.arange(N)


def pulse(at, peak=20.0):
    """Return a zero-phase pulse at a time in s."""
    x = (np.pi * peak * (TIMES - at)) ** 2
    return (1.0 - 2.0 * x) * np.exp(-x)


def waves(late=0.0, scale=1.0):
    """Return one vertical wave a receiver, further receivers later and weaker."""
    motion = np.zeros((RECEIVERS, 3, N))
    for r in range(RECEIVERS):
        motion[r, 2] = scale / (1.0 + r) * pulse(0.15 + 0.02 * r + late)
    return motion


WITHOUT_HOLES = SimpleNamespace(
    config=SimpleNamespace(holes_inside=None, signature=None), blast=None
)


def case_of(recorded, gain=None, clock=None, **table):
    """Return records of one or several shots (n_shots, n_receivers, 3, n)."""
    fields = {
        "motion": recorded, "valid": np.abs(recorded).sum(axis=-1, keepdims=True) > 0.0,
        "gain": gain, "clock": clock, "share": None, "dt": DT,
        "band": SimpleNamespace(low=8.0, high=40.0, dt=DT),
        "blasts": tuple(f"S{b}" for b in range(len(recorded))),
        "receivers": tuple(f"G{r}" for r in range(RECEIVERS)),
        "project": SimpleNamespace(
            config=SimpleNamespace(diagnosis=DiagnosisConfig(**table)), of=lambda _: WITHOUT_HOLES,
            receivers=[
                SimpleNamespace(name=f"G{r}", position=(2.0 * r, 0.0, 0.0))
                for r in range(RECEIVERS)
            ],
        ),
    }  # fmt: skip
    case = make_dataclass("Case", list(fields))(**fields)
    case.valid = np.broadcast_to(case.valid, recorded.shape)
    return case


def test_a_common_source_is_found_whatever_one_receiver_says():
    recorded = 0.7 * waves(late=0.012) - 0.4 * waves(late=-0.02)
    recorded[3] *= -1.0
    case = case_of(recorded[None], source_s=0.06)

    shares = explained(case, with_source(case, "S0", waves())[None])[0]

    assert np.all(np.delete(shares, 3) > 0.97)
    assert shares[3] < -1.0


def test_a_late_shot_is_moved_by_its_delay_alone():
    case = case_of(waves(late=0.006, scale=3.0)[None], trigger_s=0.02)

    moved = with_source(case, "S0", waves())

    np.testing.assert_allclose(moved, waves(late=0.006), atol=5e-2)


def test_gains_and_model_error_are_those_of_the_records():
    gains = np.array([1.0, 0.5, 2.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    recorded = np.stack([gains[:, None, None] * waves(late=0.01 * b) for b in range(3)])
    simulated = np.stack([waves(late=0.01 * b) for b in range(3)])

    taught = learned(case_of(recorded), simulated, 0.01)

    np.testing.assert_allclose(taught.gain, gains, rtol=1e-6)
    np.testing.assert_allclose(taught.share, 0.01, rtol=1e-6)  # the least


GAINS = np.array([1.0, 0.5, 2.0, -1.0, 1.0, 0.8, 1.2, 0.6])
CLOCKS = 1e-3 * np.array([0.0, 3.0, -4.0, 2.0, 0.0, -1.0, 5.0, -2.0])
EARLY = {"trusted": ["S0"], "early_s": [-0.03, 0.04]}


def echoed(scale):
    """Return waves of three shots, each with an echo after the window of its first arrival."""
    return np.stack([waves(late=0.01 * b) + scale * waves(late=0.16 + 0.01 * b) for b in range(3)])


@pytest.mark.parametrize("echo", [0.0, 0.8, -1.5])
def test_first_arrivals_tell_gains_and_clocks_whatever_comes_later(echo):
    simulated = echoed(0.8)
    received = GAINS[:, None, None] * time_shifted(echoed(echo), CLOCKS[:, None], DT)

    taught = learned(case_of(received, **EARLY), simulated, 0.01)

    np.testing.assert_allclose(taught.gain, GAINS, rtol=0.02)
    np.testing.assert_allclose(taught.clock, CLOCKS, atol=1.0 / (40 * 40.0))
    if echo == 0.8:
        assert np.all(taught.share < 0.02)
    else:  # what no gain explains is error, as large as the difference of the echoes
        wrong = (0.8 - echo) ** 2 / (1.0 + echo**2)
        np.testing.assert_allclose(taught.share, wrong, rtol=0.1)


def test_learned_gains_make_records_of_a_simulation():
    simulated = np.stack([waves(), waves(late=0.01)])

    taught = learned(case_of(GAINS[:, None, None] * simulated), simulated, 0.01)

    np.testing.assert_allclose(
        with_source(taught, "S1", simulated[1]), GAINS[:, None, None] * simulated[1], atol=1e-9
    )


def test_the_error_of_a_shot_is_judged_by_the_gain_of_the_others():
    simulated = np.stack([waves(late=0.01 * b) for b in range(3)])
    recorded = simulated.copy()
    recorded[0, 2] *= 2.0  # half of its energy in each product

    taught = learned(case_of(recorded), simulated, 0.01)

    # Of the loud shot the others leave (1 - 1/2)^2; it gives these a gain of 1.2.
    assert taught.share[2] == pytest.approx((0.25 + 2.0 * 0.04) / 3.0, rel=1e-6)


def test_no_receiver_is_taken_for_better_than_the_median_one():
    simulated = np.stack([waves(late=0.01 * b) for b in range(3)])
    recorded = simulated.copy()
    recorded[:, 1:] = echoed(0.8)[:, 1:]

    taught = learned(case_of(recorded), simulated, 0.01)

    usual = 0.8**2 / (1.0 + 0.8**2)
    np.testing.assert_allclose(taught.share, usual, rtol=0.1)


def test_whole_records_with_a_wrong_echo_would_tell_a_wrong_gain():
    received = GAINS[:, None, None] * echoed(-1.5)

    assert learned(case_of(received), echoed(0.8), 0.01).clock is None
    assert np.all(learned(case_of(received), echoed(0.8), 0.01).gain / GAINS < 0.1)


def test_a_receiver_without_record_is_as_usual():
    received = GAINS[:, None, None] * echoed(0.8)
    received[:, 5] = 0.0

    taught = learned(case_of(received, **EARLY), echoed(0.8), 0.01)

    assert taught.gain[5] == np.median(np.delete(taught.gain, 5))
    assert taught.clock[5] == 0.0


def test_a_trusted_blast_teaches_the_case_of_the_others():
    plain = small_site.small_site()
    table = {"trusted": ["S1"], "early_s": [-0.04, 0.1], "calibrate": False}
    diagnosis = plain.config.diagnosis.model_copy(update=table)
    site = replace(plain, config=plain.config.model_copy(update={"diagnosis": diagnosis}))
    gain, clock = np.array([1.0, 0.5, -1.5, 2.0]), 1e-3 * np.array([0.0, 5.0, -4.0, 3.0])

    def received(motion):
        return gain[:, None, None] * time_shifted(motion, clock[:, None], small_site.DT)

    case = taught(small_site.recorded(site, change=received), simulation_of)

    assert case.blasts == ("B1",)
    np.testing.assert_allclose(case.gain, gain, rtol=0.05)
    np.testing.assert_allclose(case.clock, clock, atol=1.0 / (40 * case.band.high))
    assert np.all(explained(case, simulation_of(case).motion(case.project)) > 0.95)


def test_simulated_motion_is_as_late_as_clocks():
    case = case_of(waves()[None], gain=GAINS, clock=CLOCKS)

    moved = with_source(case, "S0", waves())

    for r in range(RECEIVERS):
        expected = GAINS[r] / (1.0 + r) * pulse(0.15 + 0.02 * r + CLOCKS[r])
        np.testing.assert_allclose(moved[r, 2], expected, atol=1e-3)


def test_a_receiver_that_stood_beside_another_has_its_motion_but_its_own_gain_and_clock():
    case = case_of(waves()[None], gain=GAINS, clock=CLOCKS)
    received = with_source(case, "S0", waves())[None]

    moved = moved_along_line(SimpleNamespace(case=case), received, "G2", 2.0)

    expected = GAINS[2] / 4.0 * pulse(0.15 + 0.06 + CLOCKS[2])
    np.testing.assert_allclose(moved[0, 2, 2], expected, atol=1e-3)


def test_a_gain_that_changes_from_shot_to_shot_is_a_model_error():
    recorded = np.stack([waves() for _ in range(3)])
    recorded[1, 5] *= 3.0

    share = learned(case_of(recorded), np.stack([waves()] * 3), 0.01).share

    assert np.argmax(share) == 5
    assert share[5] > 0.1


def test_loss_is_the_exponential_of_travel_time():
    scene = SimpleNamespace(case=case_of(waves()[None]))
    motion = waves()[None]

    lost = loss_along_paths(scene, motion, "", 0.04)

    f = np.fft.rfftfreq(N, DT)
    ratio = np.abs(np.fft.rfft(lost[0, 4, 2])) / np.abs(np.fft.rfft(motion[0, 4, 2]))
    inside = (f > 12.0) & (f < 35.0)
    expected = np.exp(-np.pi * f * 0.04 * 0.23)
    np.testing.assert_allclose(ratio[inside], expected[inside], rtol=0.06)
    np.testing.assert_allclose(loss_along_paths(scene, motion, "", 0.0), motion, atol=1e-12)


def test_loss_of_a_hole_is_counted_from_its_own_firing():
    scene, delay = SimpleNamespace(case=case_of(waves()[None])), 0.2
    late = np.roll(waves(), round(delay / DT), axis=-1)
    blast = SimpleNamespace(
        times=np.array([0.0, delay]), charge=np.ones(2), centres=np.zeros((2, 3))
    )
    fired = SimpleNamespace(
        config=SimpleNamespace(holes_inside=True, signature=None, blast=None), blast=blast,
        materials={"rock": SimpleNamespace(cs=1000.0)}, receivers=[],
        inside=SimpleNamespace(moment_rate=None),
    )  # fmt: skip
    scene.case.project.of = lambda _: fired

    lost = loss_along_paths(scene, (waves() + late)[None], "", 0.04)[0]

    scene.case.project.of = lambda _: WITHOUT_HOLES
    each = loss_along_paths(scene, waves()[None], "", 0.04)[0]
    both = each + np.roll(each, round(delay / DT), axis=-1)
    counted_at_once = loss_along_paths(scene, (waves() + late)[None], "", 0.04)[0]
    assert np.sum((lost - both) ** 2) < 0.02 * np.sum(both**2)
    assert np.sum((counted_at_once - both) ** 2) > 0.05 * np.sum(both**2)


def test_two_swaps_of_the_same_channels_undo_one_another():
    case = case_of(waves()[None], gain=np.linspace(0.5, 2.0, RECEIVERS))
    scene, pair = SimpleNamespace(case=case), "G1 and G2"

    once = swapped_channels(scene, waves()[None], pair, 1.0)

    assert pair in pairs_of_near_receivers(case)
    assert "G0 and G7" not in pairs_of_near_receivers(case)
    np.testing.assert_allclose(once[0, 1], waves()[2], atol=1e-12)
    np.testing.assert_allclose(swapped_channels(scene, once, pair, 1.0), waves()[None], atol=1e-12)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"trusted": ["a"], "held_out": ["a"]}, "keep one"),
        ({"source_s": 0.1, "trigger_s": 0.1}, "exclude one another"),
        ({"until_s": -1.0}, "greater than 0"),
        ({"source_s": 0.0}, "greater than 0"),
        ({"early_s": [-0.01, 0.02]}, "name them in trusted"),
        ({"trusted": ["a"], "early_s": [0.01, 0.02]}, "must begin before"),
        ({"trusted": ["a"], "early_s": [-0.02, 0.0]}, "end after it"),
    ],
)
def test_contradictory_roles_are_refused(table, said):
    with pytest.raises(ValueError, match=said):
        DiagnosisConfig(**table)
