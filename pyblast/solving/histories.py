"""Marches that hand out the motion of chosen nodes, stretch by stretch."""

from typing import NamedTuple

import numpy as np

from ..errors import SolverError
from . import kernels
from .preparation import LEDGER_EVERY

STRETCH_VALUES = 2**23  # numbers that one stretch may hold: 64 MB


class Stretch(NamedTuple):
    """Motion over some steps.

    Parameters
    ----------
    first : int
        Step of the first sample, from 0; step k begins at time k dt.
    receivers : (n, n_receivers, 3) float64, m/s
        Of the model, at mid-steps.
    displacement : (n, n_nodes, 3) float64, m
        Of the chosen nodes, at the beginning of each step.
    before, after : (n, n_nodes, 3) float64, m/s
        Velocity half a step before and after.
    """

    first: int
    receivers: np.ndarray
    displacement: np.ndarray
    before: np.ndarray
    after: np.ndarray


class Watch:
    """A march that tells how chosen nodes move; its state changes in place.

    Parameters
    ----------
    constants, state : dict
        As in `Prepared`; the state is not copied.
    nodes : (n_nodes,) int
    """

    def __init__(self, constants, state, nodes):
        """Put a receiver at every chosen node, behind those of the model."""
        self._nodes, self._state, self._dt = np.asarray(nodes), state, constants["dt"]
        self._n_receivers = len(constants["receiver_node"])
        self._constants = kernels.to_fortran({**constants, **listening(constants, self._nodes)})

    def go(self, first, n_steps):
        """March from a step on; return the `Stretch`.

        Raises
        ------
        SolverError
            If the motion grows without cause.
        """
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        return self._stretch(first, start, last, self._advance(self._constants, first, n_steps))

    def pushed(self, first, loads):
        """March under the loads of one stretch only, whose histories begin with its first step."""
        start = self._state["displacement"][self._nodes]
        last = self._state["velocity"][self._nodes]
        self._state["sums"][:] = 0.0  # the ledger of a stretch; its end is another's beginning
        constants = {**self._constants, **kernels.to_fortran(loads)}
        motion = self._advance(constants, 0, len(loads["history"]))
        return self._stretch(first, start, last, motion)

    def _advance(self, constants, first, n_steps):
        """March and return the motion (n_steps, n, 3) of receivers and nodes."""
        motion, _, failed = kernels.advance(constants, self._state, first, n_steps, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"march: the motion grew without limit at step {first + len(motion)}")
        return motion

    def _stretch(self, first, start, last, motion):
        """Add up velocities to displacements."""
        after = motion[:, self._n_receivers : self._n_receivers + len(self._nodes)]
        before = np.concatenate([last[None], after[:-1]])
        displacement = start + self._dt * (np.cumsum(after, axis=0) - after)
        receivers = motion[:, : self._n_receivers]
        return Stretch(first, receivers, displacement, before, after)


def listening(constants, nodes):
    """Return the receivers of a model, and behind them one at every chosen node."""
    corners = constants["receiver_node"].shape[1]  # or all nodes of a quadratic zone
    node, weight = np.repeat(np.asarray(nodes)[:, None], corners, axis=1), np.eye(corners)[:1]
    weight = weight.repeat(len(node), axis=0)
    return {
        "receiver_node": np.concatenate([constants["receiver_node"], node]).astype(np.int32),
        "receiver_weight": np.concatenate([constants["receiver_weight"], weight]),
    }


def stretches(n_steps, values):
    """Cut steps that hold some numbers each into (first, count) of bounded memory."""
    count = int(min(n_steps, max(1, STRETCH_VALUES // max(1, values))))
    return [(first, min(count, n_steps - first)) for first in range(0, n_steps, count)]


def point_loads(node, history):
    """Return the load arrays of force histories (n_total, n, 3) in N at nodes (n,)."""
    n_total, n = history.shape[:2]
    return {
        "load_node": np.repeat(node, 3).astype(np.int32),
        "load_vector": np.tile(np.eye(3), (n, 1)),
        "load_history": np.arange(3 * n, dtype=np.int32),
        "load_delay": np.zeros(3 * n),
        "load_lane": np.full(3 * n, -1, dtype=np.int32),
        "history": np.ascontiguousarray(history.reshape(n_total, 3 * n)),
    }
