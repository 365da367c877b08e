"""The drawn cases: their plan, their truths and what is written of them."""

import numpy as np
import pytest

from benchmarks.blind.case_files import write_case
from benchmarks.blind.drawing import drawn, with_effects
from benchmarks.blind.noise import SEAM, joined
from benchmarks.blind.nuisances import shaken
from benchmarks.blind.plan import DEVELOPMENT_SEED, FAMILY, OUTSIDE, PROOF_SEED, SHARES, plan
from benchmarks.blind.sites import AFTER, BEFORE, DT, FURTHER, HIDDEN, draw_site
from benchmarks.blind.worlds import World
from verification.proof.predictions import project_in


def test_the_whole_plan_has_sixty_nulls_and_every_block():
    blocks = [case.block for case in plan(160, PROOF_SEED)]
    assert {block: blocks.count(block) for block in SHARES} == SHARES


def test_a_short_plan_begins_a_long_one():
    assert plan(160, DEVELOPMENT_SEED)[:16] == plan(16, DEVELOPMENT_SEED)


def test_short_plans_mix_the_blocks():
    assert {"null", "single", "two", "out of library"} <= {c.block for c in plan(16, PROOF_SEED)}


def test_a_truth_follows_from_its_seed():
    case, other = plan(2, DEVELOPMENT_SEED)
    assert drawn(case).truth == drawn(case).truth != drawn(other).truth


def test_project_files_hold_neither_the_further_blast_nor_the_hidden_receiver(tmp_path):
    rng = np.random.default_rng(3)
    site = draw_site(rng)
    shape = len(site.receivers), 3, BEFORE + AFTER
    drawn = {blast: rng.normal(size=shape) * np.hanning(shape[-1]) for blast in site.blasts}
    write_case(tmp_path / "cases" / "case-000", "case-000", site, drawn)
    read = project_in(tmp_path, "case-000")
    assert list(read.blasts) == [blast for blast in site.blasts if blast != FURTHER]
    assert [r.name for r in read.config.receivers] == [
        r.name for r in site.receivers if r.name != HIDDEN
    ]
    assert read.joints[0].properties == pytest.approx(site.joints[0].joint.properties)
    rate = read.inside.moment_rate
    np.testing.assert_allclose(rate.values, site.moment_rate.values, rtol=1e-8, atol=1.0)
    for one in map(read.of, read.blasts):
        np.testing.assert_allclose(one.blast.times, site.blasts[one.name].times)
        for n, record in enumerate(one.records.values()):
            np.testing.assert_allclose(
                record.seismogram.velocity.T, drawn[one.name][n], rtol=1e-6, atol=1e-6
            )
            assert record.seismogram.start == -BEFORE * DT


@pytest.mark.parametrize("label", sorted({*FAMILY, *OUTSIDE}))
def test_every_effect_that_is_planned_can_be_drawn(label):
    rng = np.random.default_rng(5)
    bare = World(*shaken(draw_site(rng), 1, rng))
    world, hidden = with_effects(bare, [label], rng)
    assert world is not bare
    assert hidden[0]["family"] == FAMILY.get(label)


def test_joined_noise_keeps_its_power_in_the_seams():
    windows = np.random.default_rng(1).normal(size=(400, 3, 200))
    whole = np.array([joined(some) for some in windows])
    assert whole.shape[1] == 600 - 2 * SEAM
    power = np.mean(whole**2, axis=0)
    assert np.abs(power.mean() - 1.0) < 0.02  # 192 000 numbers: 0.3 % is one sigma
    assert np.abs(power[200 - SEAM : 200].mean() - 1.0) < 0.03  # 24 000: 0.9 %
