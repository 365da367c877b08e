"""Runs to learn from: how the whole model moves for one set of values, kept on disk."""

import time
from dataclasses import dataclass

import numpy as np

from pyblast import core
from pyblast.errors import SolverError
from pyblast.runs.cache import Cache, input_hash
from pyblast.solver.preparation import LEDGER_EVERY
from pyblast.solver.run import stacked

from .basis import main_directions
from .family import Family

MOST_BYTES = 2e9  # of displacements kept while runs march side by side
KEPT = 1e-6  # of the largest singular value of the motion of a run


@dataclass(frozen=True, eq=False)
class Sample:
    """What a run of a family taught.

    Parameters
    ----------
    values : dict of str to float
    modes : (3 n_nodes, n_modes) float32
        Directions of its motion times their size, both weighted by the root of the mass.
    motion : (n_steps, n_receivers, 3) float64, m/s
        Of the receivers, east, north, up.
    seconds : float
        What the march took, without storing.
    """

    values: dict[str, float]
    modes: np.ndarray
    motion: np.ndarray
    seconds: float


def samples(family: Family, values, store=None) -> list[Sample]:
    """Run models of a family side by side, or read their runs if they are in store.

    Parameters
    ----------
    family : Family
    values : list of dict of str to float
    store : path, optional
        A folder, where a run is found by the hash of its input.

    Returns
    -------
    list of Sample
        In the order of the values.

    Raises
    ------
    SolverError
        If the motion grows without cause.
    """
    cache = Cache(store) if store is not None else None
    step = (family.dt, family.mass, family.n_steps, family.every, KEPT)
    keys, known = [], [None] * len(values)
    if cache is not None:
        keys = [input_hash("reduced", family.model(one), *step) for one in values]
        known = [cache.get(key) for key in keys]
    missing = [k for k, one in enumerate(known) if one is None]
    room = int(MOST_BYTES / (12 * len(family.mass) * -(-family.n_steps // family.every)))
    side = max(1, min(core.LANES, room))
    for first in range(0, len(missing), side):
        some = missing[first : first + side]
        for k, found in zip(some, _learnt(family, [values[k] for k in some]), strict=True):
            known[k] = found
            if cache is not None:
                cache.put(keys[k], found)
    return [
        Sample(one, kept["modes"], kept["motion"], float(kept["seconds"]))
        for one, kept in zip(values, known, strict=True)
    ]


def _learnt(family, values):
    """March some models and return what is kept of each."""
    weight = np.repeat(np.sqrt(family.mass), 3).astype(np.float32)
    motions, snapshots, seconds = _march(family, [family.prepared(one) for one in values])
    return [
        {
            "modes": main_directions(weight[:, None] * snapshots[..., lane].T, KEPT),
            "motion": np.ascontiguousarray(motions[..., lane]),
            "seconds": np.array(seconds / len(values)),
        }
        for lane in range(len(values))
    ]


def _march(family, prepared):
    """Return motion of receivers, displacements (n, 3 n_nodes, n_models) float32, and seconds."""
    count, n, every = len(prepared), family.n_steps, family.every
    if count > 1:
        constants, state = stacked([one.constants for one in prepared], [p.state for p in prepared])
        views, advance = core.side_by_side(constants), core.advance_all
    else:
        state = {name: value.copy() for name, value in prepared[0].state.items()}
        views, advance = core.to_fortran(prepared[0].constants), core.advance
    motion, snapshots, seconds = [], [], 0.0
    for first in range(0, n, every):
        began = time.perf_counter()
        moved, _, failed = advance(views, state, first, min(every, n - first), LEDGER_EVERY)
        seconds += time.perf_counter() - began
        if failed is not None:
            raise SolverError(f"reduced: the motion grew without limit at step {first}")
        motion.append(moved if count > 1 else moved[..., None])
        there = state["displacement"] if count > 1 else state["displacement"][..., None]
        there = np.moveaxis(there, core.LANE_AXIS["displacement"], -1) if count > 1 else there
        snapshots.append(there.astype(np.float32).reshape(-1, there.shape[-1])[:, :count])
    return np.concatenate(motion), np.array(snapshots), seconds
