"""One model at rest under several loads, each in a lane of its own, side by side in one march."""

from collections.abc import Iterator

import numpy as np

from ..errors import SolverError
from ..solving import kernels
from ..solving.histories import listening, stretches
from ..solving.perturbations import at_rest
from ..solving.preparation import LEDGER_EVERY, Prepared


def march_side_by_side(prepared: Prepared, loads, n_steps, nodes) -> Iterator[np.ndarray]:
    """March a linear model from rest, all that drives it left out, under each of some loads.

    A single load goes without lanes.

    Parameters
    ----------
    prepared : Prepared
    loads : sequence of dict
        Load arrays of up to `kernels.LANES` lanes, each with one history.
    n_steps : int
    nodes : (n_nodes,) int
        That are listened to beside the receivers of the model.

    Yields
    ------
    (n, n_receivers + n_nodes, 3, n_loads) float64, m/s
        Motion at mid-steps, stretch by stretch.

    Raises
    ------
    SolverError
        If the motion grows without cause.
    """
    constants, state = at_rest(prepared.constants)
    constants = {**constants, **listening(constants, nodes), **_in_lanes(loads)}
    if len(loads) == 1:
        views, advance = kernels.to_fortran(prepared.as_marched(constants)), kernels.advance
        state = prepared.as_marched(state)
    else:
        views, state = kernels.side_by_side(_repeated(constants)), _repeated(state)
        advance = kernels.advance_all
    for first, count in stretches(n_steps, 3 * kernels.LANES * len(constants["receiver_node"])):
        motion, _, failed = advance(views, state, first, count, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"march: the motion grew without limit at step {first + len(motion)}")
        yield motion.reshape(*motion.shape[:3], -1)[..., : len(loads)]


def _in_lanes(loads):
    """Return the loads of all lanes as one list."""
    together = {
        name: np.concatenate([one[name] for one in loads])
        for name in ("load_node", "load_vector", "load_delay")
    }
    lane = np.repeat(
        np.arange(len(loads), dtype=np.int32), [len(one["load_node"]) for one in loads]
    )
    history = np.hstack([one["history"] for one in loads])
    return {**together, "load_history": lane, "load_lane": lane, "history": history}


def _repeated(arrays):
    """Return arrays that each lane has for itself once for each lane."""
    return {
        name: np.stack([value] * kernels.LANES, axis=kernels.LANE_AXIS[name])
        if name in kernels.LANE_AXIS
        else value
        for name, value in arrays.items()
    }
