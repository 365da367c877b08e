"""Runs to learn from: how the whole model moves for one set of values, kept on disk."""

import time
from dataclasses import dataclass

import numpy as np

from ..ensembles.input_hash import input_hash
from ..ensembles.run_cache import Cache
from ..errors import SolverError
from ..solving import kernels
from ..solving.preparation import LEDGER_EVERY
from .basis import main_directions
from .family import Family

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


def sample(family: Family, values, store=None) -> Sample:
    """Run a model of a family, or read its run if it is in store.

    Parameters
    ----------
    family : Family
    values : dict of str to float
    store : path, optional
        A folder, where a run is found by the hash of its input.

    Raises
    ------
    SolverError
        If the motion grows without cause.
    """
    cache = Cache(store) if store is not None else None
    key = ""
    if cache is not None:
        step = (family.dt, family.mass, family.n_steps, family.every, KEPT)
        key = input_hash("reduced", family.model(values), *step)
        kept = cache.get(key)
        if kept is not None:
            return Sample(values, kept["modes"], kept["motion"], float(kept["seconds"]))
    motion, snapshots, seconds = _march(family, family.prepared(values))
    weight = np.repeat(np.sqrt(family.mass), 3).astype(np.float32)
    found = Sample(values, main_directions(weight[:, None] * snapshots.T, KEPT), motion, seconds)
    if cache is not None:
        cache.put(key, {"modes": found.modes, "motion": motion, "seconds": np.array(seconds)})
    return found


def _march(family, prepared):
    """Return the motion of the receivers, displacements (n, 3 n_nodes) float32, and seconds."""
    constants = kernels.to_fortran(prepared.constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    n, every = family.n_steps, family.every
    motion, snapshots, seconds = [], [], 0.0
    for first in range(0, n, every):
        began = time.perf_counter()
        moved, _, failed = kernels.advance(
            constants, state, first, min(every, n - first), LEDGER_EVERY
        )
        seconds += time.perf_counter() - began
        if failed is not None:
            raise SolverError(f"reduced: the motion grew without limit at step {first}")
        motion.append(moved)
        snapshots.append(state["displacement"].astype(np.float32).ravel())
    return np.concatenate(motion), np.array(snapshots), seconds
