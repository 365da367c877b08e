"""What a diagnosis counts of its runs."""

import numpy as np
import pytest
from grounds import case_on, slope
from small_site import BAND, holes, recorded, small_site

from pyblast.diagnosis.effects import Effect, changed_site
from pyblast.diagnosis.forward import _at_points, probe_positions_inside, simulation_of
from pyblast.simulation import estimate


def test_a_run_counts_as_kept_once_and_only_if_it_was_there_before(tmp_path):
    case = recorded(small_site())
    made, after = (simulation_of(case, tmp_path) for _ in range(2))

    for simulation in (made, after):
        for _ in range(2):
            simulation.motion(case.project, ["S1"])
    whole = after.run([after.model(after.of(case.project, "S1"))])[0].wall_seconds

    assert (made.runs, made.cached, made.cached_s) == (2, 0, 0.0)
    assert (after.runs, after.cached, after.cached_s) == (3, 1, whole)


def test_a_stored_run_has_the_price_that_it_had_before_and_needs_no_time_step(
    tmp_path, monkeypatch
):
    case = recorded(small_site())
    made, after = (simulation_of(case, tmp_path) for _ in range(2))
    state = made.of(case.project, "S1")
    before = made.price(state)
    made.motion(case.project, ("S1",))
    monkeypatch.setattr(estimate, "time_step", None)

    assert after.price(state) == before


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


@pytest.mark.long
def test_a_joint_that_closes_moves_the_ground_as_on_a_mesh_twice_as_fine():
    # its harmonics; on the mesh of the band alone 6 % of the energy of the change is wrong
    site, effect = small_site(), Effect("joint_nonlinear_closure", "J1", ((0.6,),))
    loud = {"S1": site.blasts["S1"], "B1": holes([[30.0, 30.0]], [600.0], [0.0])}
    case = recorded(site.changed(blasts=loud))
    simulation, closed = simulation_of(case), changed_site(case.project, [], [effect])
    meshes = case.project.config.mesh, closed.config.mesh, closed.for_band(2.0 * BAND[1])

    changes = []
    for mesh in meshes:
        motion = [
            simulation.motion(each.changed(mesh=mesh), ["B1"])[0] for each in (case.project, closed)
        ]
        changes.append(case.band.project(motion[1] - motion[0]))
    coarse, used, fine = changes

    assert np.sum((used - fine) ** 2) < 0.015 * np.sum(fine**2)
    assert np.sum((coarse - fine) ** 2) > 0.05 * np.sum(fine**2)


def test_what_enters_through_a_face_comes_from_no_points():
    through_face, inside = case_on("face"), case_on("flat")

    for case, points in ((through_face, False), (inside, True)):
        simulation = simulation_of(case)
        models = [simulation.model(simulation.of(case.project, case.blasts[0]))]
        assert _at_points(models) is points
