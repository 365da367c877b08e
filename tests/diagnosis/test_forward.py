"""What a diagnosis counts of its runs."""

import numpy as np
import pytest
from grounds import case_on, slope
from small_site import recorded, small_site

from pyblast.diagnosis.forward import probe_positions_inside, simulation_of


def test_a_run_counts_as_kept_once_and_only_if_it_was_there_before(tmp_path):
    case = recorded(small_site())
    made, after = (simulation_of(case, tmp_path) for _ in range(2))

    for simulation in (made, after):
        for _ in range(2):
            simulation.motion(case.project, ["S1"])
    whole = after.run([after.model(after.of(case.project, "S1"))])[0].wall_seconds

    assert (made.runs, made.cached, made.cached_s) == (2, 0, 0.0)
    assert (after.runs, after.cached, after.cached_s) == (3, 1, whole)


def test_probe_receivers_are_as_deep_below_a_slope_as_their_receiver():
    case = case_on("survey")
    receiver = next(r for r in case.project.receivers if r.position[0] > 60.0)
    x, _, z = receiver.position
    offsets = np.array([-6.0, 0.0, 6.0])

    positions = np.array(probe_positions_inside(case, receiver, offsets))

    assert np.ptp(positions[:, :2], axis=0) == pytest.approx([12.0, 12.0])
    assert positions[:, 2] - slope(positions[:, 0]) == pytest.approx(
        np.full(9, z - slope(x)), abs=1e-6
    )
