"""Marches in numbers of four bytes: near those in eight, and as repeatable."""

from dataclasses import replace

import numpy as np
import pytest
from command_line import python
from layered_box import FADING, SIDES, TIMES, shaking, site
from slipping_box import digest

from pyblast.errors import InputError
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.source import PointForce, TimeFunction
from pyblast.runs.greens import greens_functions
from pyblast.solver.preparation import export, prepare
from pyblast.solver.run import run_many, simulate
from verification.columns import ricker

DURATION = 0.06
NEAR = 1e-5  # of the peak
AMPLIFIED = 1e-4  # where contacts open and close: a step longer by 1e-6 changes motion by 4e-3
CLOSURE = {"kn": 4e9, "ks": 2e9, "closure": 2e-4, "kn_max": 4e10, "irrecoverable": 0.0,
           "cohesion": 0.0, "friction": 0.6}  # fmt: skip
STRONG = [*map(Viscous, SIDES), StressInput("west", shaking(None, 5.0))]
SITES = {
    "linear": {"joints": [Joint("J", "elastic", {"kn": 4e9, "ks": 2e9})]},
    "slips": {"boundaries": STRONG},
    "closes": {"joints": [Joint("J", "closure", CLOSURE, insitu_pressure=2e4)],
               "boundaries": STRONG},
    "fades": FADING,
}  # fmt: skip


def apart(one, other):
    """Return the largest difference of motion over the peak."""
    motion, found = (r.seismograms["A"].velocity for r in (one, other))
    return np.abs(found - motion).max() / np.abs(motion).max()


@pytest.mark.parametrize("name", SITES)
@pytest.mark.parametrize("quadratic", [True, False])
def test_motion_and_energy_are_those_of_eight_bytes(name, quadratic):
    model = site(**SITES[name], quadratic=quadratic)

    double, single = simulate(model, DURATION), simulate(replace(model, single=True), DURATION)

    near = AMPLIFIED if name == "closes" else NEAR
    assert 0.0 < apart(double, single) < near
    allowed = near * double.energy["input"].max() + 1e-3 * double.energy["joint_stored"][0]
    for term, found in single.energy.items():
        if term not in ("time", "unbalanced"):
            assert np.abs(found - double.energy[term]).max() <= allowed, term


def test_a_joint_that_pressure_has_closed_rests_until_waves_come():
    joint = Joint("J", "closure", CLOSURE, insitu_pressure=2e5)
    boundaries = [*map(Viscous, SIDES), StressInput("west", shaking(None, 1e-4))]
    model = site(joints=[joint], boundaries=boundaries, single=True)

    result = simulate(model, DURATION)

    assert apart(simulate(replace(model, single=False), DURATION), result) < 0.01


SCRIPT = """
import json
from layered_box import FADING, site
from pyblast import _core_single
from pyblast.solver.run import simulate
from slipping_box import digest
_core_single.pyblast_kinds.least_shared = 1
print(json.dumps(digest(simulate(site(**FADING, single=True), 0.06))))
"""


@pytest.mark.parametrize("threads", [1, 3])
def test_any_number_of_threads_gives_the_same_bits(threads):
    whole = simulate(site(**FADING, single=True), DURATION)

    assert python(SCRIPT, threads=threads) == digest(whole)


def test_an_interrupted_run_goes_on_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr("pyblast.solver.preparation.CHUNK_SECONDS", 0.0)
    path, model = tmp_path / "checkpoint.h5", site(single=True)

    def stop(stage, done, total):
        if stage == "dynamic" and 0.3 * total < done < total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(model, DURATION, progress=stop, checkpoint=path)

    assert digest(simulate(model, DURATION, resume=path)) == digest(simulate(model, DURATION))
    with pytest.raises(InputError, match="another model"):
        simulate(replace(model, single=False), DURATION, resume=path)


def test_many_runs_are_those_of_one():
    models = [replace(site(**SITES["linear"], quadratic=False), single=True)] * 2

    for one in run_many(models, DURATION):
        assert digest(one) == digest(simulate(models[0], DURATION))


def test_stored_responses_superpose_to_the_run():
    rate = TimeFunction(1e8 * ricker(TIMES, 50.0), TIMES[1])
    push = PointForce(np.array([11.0, 7.0, 13.0]), np.array([1.0, 2.0, 0.5]), rate)
    sides = [*map(Viscous, SIDES)]
    model = site(**SITES["linear"], sources=[push], boundaries=sides, single=True)

    found = greens_functions(model, DURATION, side="source").blast([push])["A"]

    wanted = simulate(model, DURATION).seismograms["A"]
    n = min(len(found.velocity), len(wanted.velocity))
    gap = np.abs(found.velocity[:n] - wanted.velocity[:n]).max()
    assert gap < NEAR * np.abs(wanted.velocity).max()


def test_the_program_for_eight_bytes_is_not_given_such_a_model(tmp_path):
    with pytest.raises(InputError, match="single"):
        export(prepare(site(single=True), DURATION), tmp_path / "model.h5")
    assert not list(tmp_path.iterdir())
