"""Snapshots of full runs, and their proper orthogonal decomposition."""

import time
from dataclasses import dataclass

import numpy as np

from pyblast import core
from pyblast.errors import SolverError
from pyblast.runs.parallel import Cache, input_hash
from pyblast.solver.preparation import LEDGER_EVERY
from pyblast.solver.run import stacked

from .families import Family

CHUNK = 8192  # rows whose products are formed at once, in double precision


def principal_directions(motion, smallest):
    """Return the left singular vectors of motion times their singular values, largest first.

    Parameters
    ----------
    motion : (n_dof, n) float32
        Displacements weighted by the root of the mass.
    smallest : float
        Fraction of the largest singular value below which vectors are dropped.

    Returns
    -------
    (n_dof, n_kept) float32
        ``A A^T`` approximates ``motion motion^T``: theory.md (10.2).
    """
    size, turn = _sizes(motion)
    kept = size > smallest * size[0] if size[0] > 0.0 else size > 0.0
    return motion @ turn[:, kept].astype(motion.dtype)


def orthonormal_basis(modes, smallest):
    """Return an orthonormal basis for the motion of several runs; theory.md (10.1).

    Parameters
    ----------
    modes : list of (n_dof, n) float32
        Of each run, from `principal_directions`.
    smallest : float
        Fraction of the largest singular value below which vectors are dropped.

    Returns
    -------
    (n_dof, n_basis) float64
    """
    snapshots = np.concatenate(modes, axis=1)
    size, turn = _sizes(snapshots)
    kept = size > smallest * size[0]
    directions = snapshots @ (turn[:, kept] / size[kept]).astype(snapshots.dtype)
    return np.linalg.qr(directions.astype(np.float64))[0]


def _sizes(motion):
    """Return singular values and right singular vectors of columns, the largest first."""
    gram = np.zeros((motion.shape[1], motion.shape[1]))
    for first in range(0, len(motion), CHUNK):
        rows = motion[first : first + CHUNK].astype(np.float64)
        gram += rows.T @ rows
    squared, turn = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(squared[::-1], 0.0)), turn[:, ::-1]


MOST_BYTES = 2e9  # of snapshots of one batch
KEPT = 1e-6  # fraction of the largest singular value of a run


@dataclass(frozen=True, eq=False)
class Sample:
    """Snapshots of one run, compressed.

    Parameters
    ----------
    values : dict of str to float
    modes : (3 n_nodes, n_modes) float32
        Singular vectors times singular values, weighted by the root of the mass.
    motion : (n_steps, n_receivers, 3) float64, m/s
        Of the receivers, east, north, up.
    seconds : float
        Wall time of the time integration.
    """

    values: dict[str, float]
    modes: np.ndarray
    motion: np.ndarray
    seconds: float


def samples(family: Family, values, store=None) -> list[Sample]:
    """Run models of a family in batches, or read their runs from the cache.

    Parameters
    ----------
    family : Family
    values : list of dict of str to float
    store : path, optional
        Cache folder.

    Returns
    -------
    list of Sample
        In the order of the values.

    Raises
    ------
    SolverError
        If a run is unstable.
    """
    cache = Cache(store) if store is not None else None
    step = (family.dt, family.mass, family.n_steps, family.every, KEPT)
    keys, known = [], [None] * len(values)
    if cache is not None:
        keys = [input_hash("reduced", family.model(one), *step) for one in values]
        known = [cache.get(key) for key in keys]
    missing = [k for k, one in enumerate(known) if one is None]
    fitting = int(MOST_BYTES / (12 * len(family.mass) * -(-family.n_steps // family.every)))
    batch = max(1, min(core.BATCH_SIZE, fitting))
    for first in range(0, len(missing), batch):
        members = missing[first : first + batch]
        for k, arrays in zip(members, _simulate(family, [values[k] for k in members]), strict=True):
            known[k] = arrays
            if cache is not None:
                cache.put(keys[k], arrays)
    return [
        Sample(one, kept["modes"], kept["motion"], float(kept["seconds"]))
        for one, kept in zip(values, known, strict=True)
    ]


def _simulate(family, values):
    """Integrate one batch of models; return the arrays of each for the cache."""
    weight = np.repeat(np.sqrt(family.mass), 3).astype(np.float32)
    motions, snapshots, seconds = _integrate(family, [family.prepared(each) for each in values])
    return [
        {
            "modes": principal_directions(weight[:, None] * snapshots[..., lane].T, KEPT),
            "motion": np.ascontiguousarray(motions[..., lane]),
            "seconds": np.array(seconds / len(values)),
        }
        for lane in range(len(values))
    ]


def _integrate(family, prepared):
    """Return motion of receivers, displacements (n, 3 n_nodes, n_models) float32, and seconds."""
    count, n, every = len(prepared), family.n_steps, family.every
    if count > 1:
        constants, state = stacked([one.constants for one in prepared], [p.state for p in prepared])
        views, advance = core.to_fortran_batch(constants), core.advance_batch
    else:
        state = {name: value.copy() for name, value in prepared[0].state.items()}
        views, advance = core.to_fortran(prepared[0].constants), core.advance
    motion, snapshots, seconds = [], [], 0.0
    for first in range(0, n, every):
        began = time.perf_counter()
        velocity, _, failed = advance(views, state, first, min(every, n - first), LEDGER_EVERY)
        seconds += time.perf_counter() - began
        if failed is not None:
            raise SolverError(f"reduced: the run is unstable at step {first}")
        motion.append(velocity if count > 1 else velocity[..., None])
        moved = state["displacement"]
        axis = core.BATCH_AXIS["displacement"]
        moved = np.moveaxis(moved, axis, -1) if count > 1 else moved[..., None]
        snapshots.append(moved.astype(np.float32).reshape(-1, moved.shape[-1])[:, :count])
    return np.concatenate(motion), np.array(snapshots), seconds
