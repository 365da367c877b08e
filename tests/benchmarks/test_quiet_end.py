"""A run ends when its receivers are quiet, not before, with the bits of a run of that length."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.quiet_end import run_until_quiet
from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Viscous
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, TimeFunction
from pyblast.solver.run import simulate
from verification.columns import ROCK, ricker

RATE = TimeFunction(1e8 * ricker(np.arange(0.0, 0.03, 2.5e-4), 100.0), 2.5e-4)
SIDES = ("west", "east", "south", "north", "bottom", "top")
CENTRE = np.array([10.0, 10.0, 10.0])


def box(boundaries=SIDES, times=(0.0,)):
    return Model(
        structured_box((4, 4, 4), (20.0, 20.0, 20.0)),
        {"rock": ROCK},
        boundaries=[*map(Viscous, boundaries)],
        sources=[Hole(CENTRE, 5.0, time, RATE) for time in times],
        receivers=[Receiver("A", (17.0, 8.0, 13.0)), Receiver("B", (3.0, 12.0, 7.0))],
    )


@pytest.mark.parametrize("quadratic", [False, True])
def test_it_ends_early_with_the_bits_of_a_run(quadratic):
    model = replace(box(), quadratic=quadratic)
    found = run_until_quiet(model, 0.5, share=0.02)
    whole = simulate(model, 0.5).seismograms

    assert found.quiet
    way = max(np.linalg.norm(each.position - CENTRE) for each in model.receivers)
    assert 0.03 + way / ROCK.cs <= found.duration < 0.25
    for name, record in found.seismograms.items():
        n = len(record.velocity)
        assert np.array_equal(record.velocity, whole[name].velocity[:n])
        assert np.linalg.norm(whole[name].velocity[n:], axis=1).max() <= 0.02 * record.pvs


def test_it_waits_for_the_last_hole():
    late = run_until_quiet(box(times=(0.0, 0.2)), 0.5, share=0.02)

    assert late.quiet
    assert late.duration > 0.23
    assert late.seismograms["A"].windowed(0.2, late.duration).pvs > 0.9 * late.seismograms["A"].pvs


def test_what_rings_on_is_run_to_the_end():
    ringing = run_until_quiet(box(()), 0.1)

    assert not ringing.quiet
    assert ringing.duration == pytest.approx(0.1, abs=1e-3)


def test_without_receivers_or_with_a_senseless_share_it_is_refused():
    with pytest.raises(InputError, match="receivers: none"):
        run_until_quiet(replace(box(), receivers=()), 0.1)
    with pytest.raises(InputError, match="share: must lie between 0 and 1, got 1"):
        run_until_quiet(box(), 0.1, share=1.0)
