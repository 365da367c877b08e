"""Low-passed stiffness damping: full runs on both sides of the limit of an unstructured mesh."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blocky import blocky_mesh, blocky_model
from pyblast.model.material import Damping
from pyblast.solver.assembly import time_step
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.step_limits import explicit, lasts, true_limit

pytest.importorskip("gmsh", exc_type=ImportError)

RATIOS = (0.005, 0.0112, 0.05)


@pytest.fixture(scope="module")
def blocks():
    return blocky_model(blocky_mesh((30.0, 30.0, 20.0), 5.0)[0], step_factor=1.0)


def damped(model, ratio):
    return replace(model, damping=Damping(ratio, 4.0, corner=60.0))


@pytest.mark.parametrize("ratio", RATIOS)
def test_a_run_lasts_just_below_the_limit_and_fails_just_above(blocks, ratio):
    model = damped(blocks, ratio)
    limit = true_limit(explicit(model))

    assert lasts(model, 0.98 * limit, 2000)
    assert not lasts(model, 1.02 * limit, 2000)


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_bound_is_safe_and_near_the_limit(blocks, ratio):
    prepared = explicit(damped(blocks, ratio))

    assert 0.7 < prepared.constants["dt"] / true_limit(prepared) <= 1.0


def test_implicit_zones_lengthen_the_step_of_slivers_and_it_stays_stable(blocks):
    dt, limit = time_step(blocks)
    prepared = prepare(blocks, 3000 * dt)
    noise = np.random.default_rng(0).normal(size=prepared.state["velocity"].shape)
    noise[prepared.constants["implicit_node"]] = 0.0
    state = {**prepared.state, "velocity": noise}

    found = simulate(blocks, 3000 * dt, prepared=replace(prepared, state=state))

    assert limit.dt > 4.0 * limit.explicit
    assert found.balance_error < 1e-9


def test_three_quarters_of_the_step_that_is_marched_are_left_at_five_percent(blocks):
    plain, with_damping = (time_step(model)[0] for model in (blocks, damped(blocks, 0.05)))

    assert with_damping >= 0.75 * plain


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_limit_itself_falls_by_the_factor_of_theory(blocks, ratio):
    model = damped(blocks, ratio)

    left = true_limit(explicit(model)) / true_limit(explicit(blocks))

    assert left == pytest.approx(model.damping.step_factor, rel=2e-3)
