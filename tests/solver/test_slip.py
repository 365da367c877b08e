"""Margins of joints against slip and opening: closed forms and runs on both sides of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from slipping_box import sheared

from pyblast.model.joint import Joint
from pyblast.solver.assembly import initial_pressures
from pyblast.solver.initial_stress import joint_pressures
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.slip import GAP, SLIP, JointObserver, run_with_slip, slip_factors

NORMAL = np.array([[1.0, 0.0, 0.0]])


def factor(initial, moved, cohesion=1e5, friction=0.5, tension=0.0):
    strength = [np.array([value]) for value in (cohesion, friction, tension)]
    return slip_factors(np.array([initial]), np.array([moved]), NORMAL, *strength)[0]


def test_shear_alone_slips_at_strength_over_shear():
    assert factor([-4e5, 0.0, 0.0], [0.0, 1e5, 0.0]) == pytest.approx(3.0, rel=1e-12)


def test_pull_takes_friction_away_and_push_adds_it():
    # c + f (p - m s) = m t with s > 0 pulling: 3e5 = m (1e5 + 0.5 s)
    assert factor([-4e5, 0.0, 0.0], [1e5, 1e5, 0.0]) == pytest.approx(2.0, rel=1e-12)
    assert factor([-4e5, 0.0, 0.0], [-1e5, 1e5, 0.0]) == pytest.approx(6.0, rel=1e-12)


def test_push_that_adds_more_friction_than_shear_never_slips():
    assert factor([-4e5, 0.0, 0.0], [-4e5, 1e5, 0.0]) == math.inf


def test_pull_without_shear_opens_when_it_overcomes_pressure_and_tension():
    assert factor([-4e5, 0.0, 0.0], [1e5, 0.0, 0.0], cohesion=1e9, tension=1e5) == pytest.approx(
        5.0
    )


def test_where_a_contact_is_pulled_its_strength_is_cohesion_alone():
    held = {"cohesion": 2e5, "tension": 1e9}

    assert factor([-1e5, 0.0, 0.0], [1e6, 1e5, 0.0], **held) == pytest.approx(2.0, rel=1e-12)


def test_shear_before_the_blast_counts_with_its_direction():
    ahead = factor([-4e5, 2e5, 0.0], [0.0, 1e5, 0.0])
    back = factor([-4e5, 2e5, 0.0], [0.0, -1e5, 0.0])

    assert ahead == pytest.approx(1.0)
    assert back == pytest.approx(5.0)


def test_a_contact_that_has_nothing_left_before_the_blast_has_no_margin():
    assert factor([-4e5, 3e5, 0.0], [0.0, 1.0, 0.0]) == 0.0


def brute(initial, moved, cohesion, friction, tension):
    """Return the least factor of a fine grid at which (11.5) is reached."""
    m = np.linspace(0.0, 15.0, 300_001)[1:, None]
    traction = np.asarray(initial) + m * np.asarray(moved)
    held = cohesion - np.minimum(0.0, traction[:, 0]) * friction
    reached = (np.linalg.norm(traction[:, 1:], axis=1) >= held) | (traction[:, 0] >= tension)
    return m[int(np.argmax(reached)), 0] if reached.any() else math.inf


@pytest.mark.parametrize("rest", [-1.0, 0.5])
def test_the_margin_is_the_least_factor_that_reaches_the_strength(rest):
    rng, strength = np.random.default_rng(5), {"cohesion": 0.3, "friction": 0.8, "tension": 1.0}
    for _ in range(150):
        initial = [rest, *rng.uniform(-0.7, 0.7, 2)]
        moved = rng.normal(size=3)
        found, wanted = factor(initial, moved, **strength), brute(initial, moved, **strength)
        # beyond the grid nothing is looked for
        assert (
            found == pytest.approx(wanted, abs=1e-4)
            or min(found, wanted) > 14.9
            or (found == 0.0 and wanted < 1e-4)
        )


def test_a_watched_run_is_the_run_itself():
    model = sheared(0.05)

    found, _ = run_with_slip(model, 0.1, 100.0)

    wanted = simulate(model, 0.1)
    assert np.array_equal(found.seismograms["A"].velocity, wanted.seismograms["A"].velocity)
    assert np.array_equal(found.energy["input"], wanted.energy["input"])


def test_the_first_contact_slips_at_the_stated_factor_and_not_below():
    first = run_with_slip(sheared(0.01), 0.1, 100.0)[1]["J"]
    assert first.failed == 0
    assert 1.0 < first.factor < math.inf

    below, above = (
        run_with_slip(sheared(0.01 * share * first.factor), 0.1, 100.0)[1]["J"]
        for share in (0.98, 1.02)
    )

    assert below.failed == 0
    assert above.failed > 0


def test_the_weakest_strength_of_a_range_has_its_own_factor():
    model = sheared(0.01)
    weak = [replace(model.joints[0], properties={**model.joints[0].properties, "cohesion": 1e5})]

    found = run_with_slip(model, 0.1, 100.0, weak)[1]["J"]

    assert found.weakest_factor < found.factor
    assert found.weakest_factor == pytest.approx(
        run_with_slip(sheared(0.01, cohesion=1e5, cohesion_residual=1e5), 0.1, 100.0)[1]["J"].factor
    )


def test_slip_before_the_blast_is_no_slip_of_the_blast():
    model = sheared(0.05)
    observer = JointObserver(model, prepare(model, 0.01), 100.0)
    before = observer.begun["contact_state"].copy()
    before[:, SLIP] = [2e-3, -1e-3, 5e-4]
    observer.begun = observer.begun | {"contact_state": before}
    after = before.copy()
    after[:, SLIP] += [3e-4, 0.0, 4e-4]

    assert not observer.moved(before)[0].any()
    assert observer.moved(after)[0] == pytest.approx(5e-4, rel=1e-12)


def test_largest_slip_and_opening_count_the_end_between_samples():
    model = sheared(0.05)
    prepared = prepare(model, 0.01)
    observer = JointObserver(model, prepared, 100.0)
    ended = {name: value.copy() for name, value in prepared.state.items()}
    ended["contact_state"][:, SLIP] += [3e-4, 0.0, 4e-4]
    ended["contact_state"][:, GAP] = 2e-4

    observer.by_surface(ended)

    assert observer.records["largest_slip"] == pytest.approx(5e-4, rel=1e-12)
    assert observer.records["largest_opening"] == pytest.approx(2e-4, rel=1e-12)
    assert (observer.records["slip_step"] == prepared.n_steps).all()


def test_pressure_whose_shear_is_round_off_has_no_factor_of_safety():
    model = sheared(0.05)
    prepared = prepare(model, 0.01)
    observer = JointObserver(model, prepared, 100.0)
    state = {name: value.copy() for name, value in prepared.state.items()}
    normal = prepared.constants["contact_normal"]
    state["contact_traction"] = -4e5 * normal + [0.0, 1e-10, 0.0]

    observer.sample(0, state, np.zeros_like(prepared.state["velocity"]))

    assert observer.records["history"][0, 0, 3] == math.inf


@pytest.mark.parametrize("worn", [0.0, 0.5, 1.0, 2.0])
def test_safety_is_that_of_the_strength_that_weakening_has_left(worn):
    weakening = {"kn": 4e9, "ks": 2e9, "cohesion": 2e5, "friction": 0.5, "tension": 1e5,
                 "friction_dynamic": 0.2, "weakening_slip": 1e-3}  # fmt: skip
    joint = Joint("J", "softening", weakening, insitu_pressure=1e5)
    model = replace(sheared(0.05), joints=[joint])
    prepared = prepare(model, 0.01)
    observer = JointObserver(model, prepared, 100.0)
    state = {name: value.copy() for name, value in prepared.state.items()}
    state["contact_state"][:, 6] = worn * 1e-3
    normal = prepared.constants["contact_normal"]
    state["contact_traction"] = -4e5 * normal + [0.0, 1e5, 0.0]

    observer.sample(0, state, np.zeros_like(prepared.state["velocity"]))

    left = min(worn, 1.0)
    strength = 2e5 * (1.0 - left) + 4e5 * (0.5 - 0.3 * left)
    assert observer.records["history"][0, 0, 3] == pytest.approx(strength / 1e5, rel=1e-12)


def deeper(pressure, gradient=2e4):
    """Return the sheared column with a pressure at its top, 10 m high, that grows with depth."""
    model = sheared(0.01)
    joint = replace(
        model.joints[0], insitu_pressure=pressure, insitu_gradient=gradient, insitu_level=10.0
    )
    return replace(model, joints=[joint])


def test_pressure_that_grows_with_depth_presses_each_contact_by_its_height():
    model, bare = deeper(5e4), deeper(0.0)
    contacts = model.nodes.contacts
    depth = 10.0 - model.nodes.points[contacts.minus, 2]

    np.testing.assert_allclose(initial_pressures(model), 5e4 + 2e4 * depth, rtol=1e-12)
    assert joint_pressures(model)["J"] == pytest.approx(5e4 + 2e4 * 5.0)
    assert joint_pressures(bare)["J"] == pytest.approx(1e5)


def test_a_joint_whose_pressure_grows_with_depth_opens_first_at_its_top():
    less, more = (run_with_slip(deeper(p), 0.1, 100.0)[1]["J"].factor for p in (5e4, 1.5e5))

    # tension + p over the pull of the wave, which is the same
    assert more / less == pytest.approx((1e5 + 1.5e5) / (1e5 + 5e4), rel=1e-9)


def test_joints_without_strength_are_left_out():
    model = sheared(0.01)
    elastic = replace(model, joints=[Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})])

    assert run_with_slip(elastic, 0.05, 100.0)[1] == {}
