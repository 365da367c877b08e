"""What a verdict rests on: folds of the effect in question, records that exist, all rivals."""

from dataclasses import replace
from functools import cache

import numpy as np
from small_site import CUT, recorded, scene_of, small_site

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.diagnosis.chance import Chance, chance
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.folds import held_out
from pyblast.diagnosis.forward import Forward
from pyblast.diagnosis.mesh_control import RESOLUTION, changed_by_mesh
from pyblast.diagnosis.scene import Effect
from pyblast.diagnosis.search import MATERIAL, Search, material
from pyblast.diagnosis.verdict import COARSE, controlled, judge

SLOW = Effect("clock_error", "R2", ((0.0,),))
LOUD = Effect("misfire_or_charge_error/blast", "B1", ((1.0,),))
CHANCE = Chance(np.zeros((2, 200)), {})


def late_and_loud(motion):
    """Let the clock of R2 be 16 ms slow, and blast B1 be twice as large as its charge."""
    motion = motion.copy()
    motion[:, 2] = np.roll(motion[:, 2], 4, axis=-1)
    motion[1] *= 2.0
    return motion


def with_holes(scene):
    """Return a scene whose first hole sends all of each blast."""
    motion = scene.baseline.motion
    nothing = 0.0 * motion[1]
    return replace(scene, holes={"S1": motion[:1], "B1": np.stack([motion[1], nothing, nothing])})


@cache
def fits():
    """Return a scene with two effects, and the fits of none, of each and of both."""
    here = scene_of(recorded(small_site(), change=late_and_loud))
    here = with_holes(here)
    return here, *(fit(here, some) for some in ((), (SLOW,), (LOUD,), (SLOW, LOUD)))


def test_an_effect_beside_another_is_tested_on_its_own_folds():
    here, _, slow, loud, both = fits()

    assert [f.name for f in held_out(here, loud, both).folds] == ["S1", "B1"]
    assert [f.name for f in held_out(here, slow, both).folds] == ["R0", "R1", "R2", "R3"]


def test_a_clock_and_a_charge_that_are_both_wrong_make_a_composite():
    here, none, slow, loud, both = fits()
    found = Search(here, 400, lambda *_: None, none, [both, loud, slow], [], both)

    assert judge(found, CHANCE).outcome == "COMPOSITE"


def test_what_a_finer_mesh_changes_as_much_as_small_errors_do_is_not_named():
    here, none, _, _, both = fits()
    named = judge(Search(here, 400, lambda *_: None, none, [both], [], both), CHANCE)
    changed = np.full(both.size.shape, 0.5)

    assert controlled(named, changed).outcome == "COMPOSITE"
    changed[:, 1] = COARSE
    doubted = controlled(named, changed)
    assert doubted.outcome == "CLASS"
    assert doubted.rivals == (*both.labels, RESOLUTION)


def test_what_a_finer_mesh_is_held_against_is_what_was_fitted():
    here, *_ = fits()
    damped = fit(here, (Effect("attenuation_Q", "", ((25.0,),)),))
    fine, runs = Forward(here.case, CUT), here.forward.runs

    changed = changed_by_mesh(here, fine, damped)

    assert here.forward.runs == runs  # the answer was run already, and corrected
    assert changed.max() < 1e-12  # the same zones


def test_nothing_is_named_where_the_budget_ended_before_the_others_were_tried():
    here, none, slow, loud, both = fits()
    found = Search(here, 400, lambda *_: None, none, [both, loud, slow], [], both)
    found.compared = False

    assert judge(found, CHANCE).outcome == "PARTIAL"


def test_a_receiver_without_records_is_no_fold_that_must_gain():
    here, _, slow, _, both = fits()
    likelihood = here.baseline.likelihood
    kept = likelihood.kept.copy()
    kept[:, 3] = 0
    baseline = replace(here.baseline, likelihood=replace(likelihood, kept=kept))

    proof = held_out(replace(here, baseline=baseline), slow, both)

    assert [fold.name for fold in proof.folds] == ["R0", "R1", "R2"]
    assert np.all(np.isfinite([fold.after for fold in proof.folds]))


def test_a_residual_counts_as_much_where_a_receiver_missed_other_blasts():
    size = np.ones((3, 4))
    size[:, 1] = 0.0, 0.0, MATERIAL + 0.1

    assert material(size)


def late_everywhere(motion):
    """Let every path be 2 to 4 ms late or early: more than supposed, and no clock's fault."""
    steps = np.array([0.75, -0.75, 0.9, -0.6])  # of samples
    slopes = np.gradient(motion, axis=-1)
    return motion - steps[:, None, None] * slopes


def test_small_errors_of_every_path_are_no_clocks_that_were_wrong():
    here = with_holes(scene_of(recorded(small_site(), change=late_everywhere)))
    none = fit(here, ())
    clocks = tuple(Effect("clock_error", f"R{n}", ((0.0,),)) for n in range(4))
    every, found = fit(here, clocks), Search(here, 400, lambda *_: None, none)

    beyond = chance(here, none, [], seed=1)

    assert found.worth(every) > beyond.needed(())  # shuffled among receivers they are rare
    assert found.worth(every) < beyond.needed(clocks)


def test_one_clock_that_is_wrong_stands_out_of_small_errors():
    here, none, slow, *_ = fits()
    found = Search(here, 400, lambda *_: None, none)

    assert found.worth(slow) > chance(here, none, [], seed=1).needed([SLOW])


def test_noise_is_no_error_that_comes_back_in_each_blast():
    here = with_holes(scene_of(recorded(small_site(), change=late_everywhere)))
    none = fit(here, ())
    likelihood = replace(here.baseline.likelihood, noisy=none.size)
    noise = replace(here, baseline=replace(here.baseline, likelihood=likelihood))

    beyond = [chance(one, none, [], seed=1) for one in (here, noise)]

    assert beyond[0].needed([SLOW]) > beyond[0].needed(())
    assert beyond[1].needed([SLOW]) == beyond[1].needed(())  # what is shuffled alone
