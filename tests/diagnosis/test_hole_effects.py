"""Effects on holes are factors on the motion of each, by drawn cases the same as written out."""

from dataclasses import replace

import numpy as np
import pytest
from library_scene import scene
from scipy import fft

from pyblast.blasts.hole_effects import HARDLY, ROWS, Pattern, what_would_tell
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.hypotheses import LIBRARY, patterns_of
from verification import holes

OLD = {
    "delay_scatter": lambda _, x: (x, np.ones(3)),
    "delay_scatter/pace": lambda blast, x: (
        (x[0] - 1.0) * (blast.times - blast.times.min()), np.ones(3)),
    "misfire_or_charge_error/holes": lambda _, x: (np.zeros(3), x),
    "misfire_or_charge_error/blast": lambda _, x: (np.zeros(3), np.full(3, x[0])),
    "clock_error/blast": lambda _, x: (np.full(3, x[0]), np.ones(3)),
}  # fmt: skip


@pytest.mark.parametrize("name", OLD)
def test_delays_and_scales_of_drawn_holes_change_motion_as_their_sum_does(name):
    here, rng = scene(), np.random.default_rng(4)
    holes, blast = here.holes["B1"], here.case.project.blasts["B1"]
    (parameter,) = LIBRARY[name].parameters
    for _ in range(5):
        x = parameter.value(0.5 * rng.standard_normal(3 if parameter.per_hole else 1))
        effect = Effect(name, "B1", (tuple(x.tolist()),))
        motion = here.baseline.motion
        changed = here.received(motion, (effect,)) - motion

        delays, scales = OLD[name](blast, x)
        size = fft.next_fast_len(2 * holes.shape[-1], real=True)
        turns = -2j * np.pi * fft.rfftfreq(size, here.case.dt)
        wanted = 0.0
        for h, (delay, scale) in enumerate(zip(delays, scales, strict=True)):
            factor = scale * np.exp(turns * delay) - 1.0
            wanted = wanted + fft.rfft(holes[h], size) * factor * np.exp(turns * blast.times[h])
        wanted = fft.irfft(wanted, size)[..., : holes.shape[-1]]

        assert not changed[0].any()
        np.testing.assert_allclose(changed[1], wanted, atol=1e-9 * np.abs(motion).max())


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_each_row_of_the_table_is_a_hypothesis_with_a_prior_around_none(row):
    entry = LIBRARY[row.name]
    (parameter,) = entry.parameters

    assert (entry.on, entry.target, entry.claim) == ("holes", "site", row.claim)
    assert parameter.mean == parameter.null == 0.0
    assert parameter.unit in ("", f"{dict(delay='s', loss='s').get(row.kernel, '1')}/m")


def test_a_covariate_that_hardly_varies_is_not_testable_and_says_so():
    reason = LIBRARY["second_deck"].untestable(scene().case)

    assert reason.startswith("the order of decks hardly varies")
    assert "holes of two decks" in reason


def test_a_charge_exponent_changes_all_blasts_by_their_charges():
    here, motion = scene(), scene().baseline.motion
    changed = here.received(motion, (Effect("charge_exponent", "", ((0.1,),)),))
    reference = patterns_of(here.case)[0].reference
    band = here.case.band

    small = band.project(changed)[0] / band.project(motion)[0]
    np.testing.assert_allclose(small, (10.0 / reference) ** 0.1, rtol=1e-2)


def test_patterns_of_a_case_know_its_receivers():
    patterns = patterns_of(scene().case)

    assert all(isinstance(each, Pattern) for each in patterns)
    assert [each.receivers.shape for each in patterns] == [(4, 3), (4, 3)]


def test_what_a_survey_cannot_tell_is_what_its_covariates_do_not_show():
    rng = np.random.default_rng(2)
    fired = [replace(blast, stemming=np.full(30, np.nan)) for blast in holes.blasts(rng)[:3]]
    told = what_would_tell([Pattern(blast, holes.PLACES) for blast in fired])

    hardly = {line.partition(":")[0] for line in told if HARDLY in line}
    assert hardly == {"stemming", "second_deck"}

    behind = np.array([[0.0, 90.0, 0.0]])  # no wave to it crosses broken ground
    alike = [replace(blast, charge=np.full(30, 70.0)) for blast in fired]
    told = what_would_tell([Pattern(blast, behind) for blast in alike])
    (charges,) = (line for line in told if line.startswith("charge_exponent, pulse_length: "))
    (across,) = (line for line in told if line.startswith("screening, screening/loss, "))
    assert "35 to 130 kg" in charges
    assert "a receiver across the pit" in across

    by_row = [replace(blast, charge=40.0 * np.exp(0.4 * blast.row)) for blast in fired]
    told = what_would_tell([Pattern(blast, holes.PLACES) for blast in by_row])
    inseparable = "charge_exponent and row_number are hardly separable"
    assert any(line.startswith(inseparable) for line in told)
