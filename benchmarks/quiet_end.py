"""How long a run must be: marched until its receivers have been quiet for long enough."""

from typing import NamedTuple

import numpy as np

from pyblast import core
from pyblast.errors import InputError, SolverError
from pyblast.model.model import Model
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import LEDGER_EVERY, prepare
from pyblast.solver.run import seismograms

CHECKS = 10  # in the time that receivers must be quiet
FADED = 1e-6  # of the largest value of a history, per step: it has ended


class QuietRun(NamedTuple):
    """A run that ended when there was nothing left to see.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        The same bits as those of a run of this duration.
    duration : float, s
        That other runs of the like need.
    quiet : bool
        False where the longest duration came first.
    """

    seismograms: dict[str, Seismogram]
    duration: float
    quiet: bool


def run_until_quiet(
    model: Model, longest: float, *, share: float = 0.01, still: float | None = None
) -> QuietRun:
    """March until all sources have ended and no receiver has moved much for some time.

    Parameters
    ----------
    model : Model
    longest : float, s
        When it ends at the latest.
    share : float
        Of each receiver's largest velocity, which it must not have exceeded.
    still : float, optional, s
        For how long. None: as long as an S wave in the slowest ground needs from one corner of
        the model to the opposite one, so that nothing is still under way; a shorter time may miss
        what returns late.

    Returns
    -------
    QuietRun

    Raises
    ------
    InputError
        If there is no receiver, or the share is not between 0 and 1.
    SolverError
        If the run is unstable.
    """
    if not model.receivers:
        raise InputError("receivers: none; a run ends when its receivers are quiet")
    if not 0.0 < share < 1.0:
        raise InputError(f"share: must lie between 0 and 1, got {share:g}")
    prepared = prepare(model, longest)
    dt = prepared.constants["dt"]
    window = max(CHECKS, int(np.ceil((_crossing(model) if still is None else still) / dt)))
    ended = _end_of_sources(prepared.constants)
    views, state = prepared.begun()
    motion, quiet, done = np.zeros((0, len(model.receivers), 3)), False, 0
    while not quiet and done < prepared.n_steps:
        count = min(window // CHECKS, prepared.n_steps - done)
        more, _, failed = core.advance(views, state, done, count, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"run: unstable at step {done + len(more)}")
        motion = np.concatenate([motion, more[:, : len(model.receivers)]])
        done += count
        size = np.linalg.norm(motion, axis=2)
        peak = size.max(axis=0)
        late = size[-window:].max(axis=0)
        quiet = done >= ended + window and bool(((late <= share * peak) & (peak > 0.0)).all())
    return QuietRun(seismograms(model, motion, dt), done * dt, quiet)


def _crossing(model):
    """Return how long an S wave in the slowest ground needs along the diagonal, s."""
    points = model.mesh.points
    return float(np.linalg.norm(np.ptp(points, axis=0)) / np.min(model.zone_values("cs")))


def _end_of_sources(constants):
    """Return the step after which no history changes by `FADED` of its size, delays included."""
    history = constants["history"]
    changes = np.abs(np.diff(history, axis=0)) > FADED * np.abs(history).max(axis=0)
    steps = np.flatnonzero(changes.any(axis=1))
    last = int(steps[-1]) + 2 if len(steps) else 0
    return last + int(np.ceil(max(constants["load_delay"], default=0.0)))
