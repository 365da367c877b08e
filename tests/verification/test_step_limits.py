"""Low-passed stiffness damping: full runs on both sides of the limit of an unstructured mesh."""

from dataclasses import replace

import pytest

from benchmarks.blocky import blocky_mesh, blocky_model
from pyblast.model.material import Damping
from pyblast.solver.preparation import prepare
from pyblast.solver.time_step import critical_step
from verification.step_limits import lasts, true_limit

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
    limit = true_limit(prepare(model, 1e-3))

    assert lasts(model, 0.98 * limit, 2000)
    assert not lasts(model, 1.02 * limit, 2000)


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_bound_is_safe_and_near_the_limit(blocks, ratio):
    prepared = prepare(damped(blocks, ratio), 1e-3)

    assert 0.8 < prepared.constants["dt"] / true_limit(prepared) <= 1.0


def test_three_quarters_of_the_step_that_is_marched_are_left_at_five_percent(blocks):
    plain, with_damping = (critical_step(model).dt for model in (blocks, damped(blocks, 0.05)))

    assert with_damping >= 0.75 * plain


@pytest.mark.parametrize("ratio", RATIOS)
def test_the_limit_itself_falls_by_the_factor_of_theory_where_masses_are_the_same(blocks, ratio):
    bare = replace(blocks, added_mass=0.0)
    model = damped(bare, ratio)

    left = true_limit(prepare(model, 1e-3)) / true_limit(prepare(bare, 1e-3))

    assert left == pytest.approx(model.damping.step_factor, rel=2e-3)
