"""Preparation of a run: arrays in equilibrium with the in-situ stress, with their provenance."""

import hashlib
import logging
import math
import os
import platform
import time
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import metadata

import numpy as np

from .. import core
from ..errors import InputError, SolverError
from ..mesh.quality import refuse_beyond_memory
from ..model.model import Model
from . import assembly
from .edge_springs import marching_bytes
from .free_field import side_loads
from .model_file import write_model
from .time_step import CriticalStep


def fingerprint(*tables):
    """Return the SHA-256 of named arrays and numbers, in the order of their names."""
    digest = hashlib.sha256()
    for table in tables:
        for name in sorted(table):
            value = np.ascontiguousarray(table[name])
            digest.update(f"{name} {value.dtype.str} {value.shape}".encode())
            digest.update(value.tobytes())
    return digest.hexdigest()


LIBRARIES = ("numpy", "scipy", "obspy", "h5py", "meshio", "gmsh")
installed = cache(metadata.version)  # reads files of the library, at every run otherwise


def versions(input_hash):
    """Return the provenance of a result, all text."""
    return {
        "pyblast": installed("pyblast"),
        "input_sha256": input_hash,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "threads": os.environ.get("OMP_NUM_THREADS", str(os.cpu_count())),
        **{name: installed(name) for name in LIBRARIES},
    }


LEDGER_EVERY = 20
CHUNK_SECONDS = 0.05
STATIC_ROUND = 100
STATIC_TOLERANCE = 1e-5
YIELDING_TOLERANCE = 1e-6  # what yields creeps to rest, and keeps the stress that it came to
STATIC_STEPS = 40_000
log = logging.getLogger(__name__)


class Chunks:
    """How many steps take about `CHUNK_SECONDS`, or a round of the ledger where that is more."""

    def __init__(self, steps):
        self.steps = steps

    @contextmanager
    def timed(self, steps):
        """Time one chunk of some steps and choose the length of the next."""
        began = time.perf_counter()
        yield
        took = max(time.perf_counter() - began, 1e-4)
        wanted = max(LEDGER_EVERY, int(steps * CHUNK_SECONDS / took))
        self.steps = min(4 * self.steps, wanted)

    def end(self, step):
        """Return where a chunk from a step ends: with a round of the ledger if it has one.

        Zones that can yield are judged when a chunk begins and when energies are told.
        """
        last = step + self.steps
        return last - last % LEDGER_EVERY if self.steps >= LEDGER_EVERY else last


@dataclass(frozen=True, eq=False)
class Prepared:
    """A model turned into arrays, ready to march.

    Parameters
    ----------
    constants : dict
        Kernel arguments in Python's order, indices from 0.
    state : dict
        Arrays that change, named as in ``kernels.STATE``.
    n_steps : int
    limit : CriticalStep
    static : dict
        ``steps`` and ``unbalanced`` of the static stage; empty where there was none.
    fingerprint : str
        SHA-256 of all constants, of the state and of ``single``.
    single : bool
        Whether the march is in numbers of four bytes.
    """

    constants: dict
    state: dict
    n_steps: int
    limit: CriticalStep
    static: dict
    fingerprint: str
    single: bool = False

    def as_marched(self, arrays):
        """Return constants or a state of this model in the numbers of its march."""
        return core.in_single(arrays) if self.single else arrays

    def begun(self):
        """Return the constants as the kernels take them, and a state of its own to march from."""
        state = {name: value.copy() for name, value in self.as_marched(self.state).items()}
        return core.to_fortran(self.as_marched(self.constants)), state


def prepare(model: Model, duration: float, progress: Callable | None = None, step=None) -> Prepared:
    """Assemble the arrays of a model and bring it to rest under its in-situ stress.

    Parameters
    ----------
    model : Model
    duration : float, s
    progress : callable, optional
        Called with (stage, done, total) between chunks.
    step : tuple of float and CriticalStep, optional
        What `assembly.time_step` gives for the model, its time step in s as it is or shortened.

    Raises
    ------
    InputError
        If the duration is not positive, or the model does not fit into memory.
    SolverError
        If the static stage does not come to rest.
    """
    if not (math.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: must be positive, got {duration:g} s")
    zones = f"model: {len(model.mesh.zones)} zones"
    refuse_beyond_memory(zones, marching_bytes(model))
    geometry, limit = assembly.geometry_arrays(model, step)
    n_steps = max(2, math.ceil(duration / geometry["dt"]))  # a seismogram has two samples
    n_samples = n_steps * (1 + len(model.receivers))
    recorded = f"{zones} with {len(model.receivers)} receivers over {n_steps} steps"
    refuse_beyond_memory(recorded, marching_bytes(model, n_samples))
    static, settled = {}, None
    if model.insitu is not None and (model.mesh.contacts is not None or model.yielding().any()):
        static, settled = _equilibrate(model, geometry, progress)
    sides = side_loads(model, geometry["dt"], n_steps * geometry["dt"], _marched)
    if sides:
        histories = f"{recorded} and {len(sides)} histories of free-field sides"
        needed = marching_bytes(model, n_samples, n_steps * len(sides))
        refuse_beyond_memory(histories, needed)
    constants = {**geometry, **assembly.dynamic_arrays(model, geometry, n_steps, sides)}
    state = assembly.initial_state(constants)
    if settled is not None:
        constants, state = assembly.after_static(constants, *settled)
    marked = fingerprint(constants, state, {"single": model.single})
    return Prepared(constants, state, n_steps, limit, static, marked, model.single)


def _marched(model, duration):
    """March a column; return the motion of its receivers and the constants of the kernels."""
    prepared = prepare(model, duration)
    views, state = core.to_fortran(prepared.constants), prepared.state
    motion, _, failed = core.advance(views, state, 0, prepared.n_steps, LEDGER_EVERY)
    if failed is not None:
        raise SolverError("free-field column: the motion grew without limit; check the input")
    return motion, prepared.constants


def _equilibrate(model, geometry, progress):
    """Relax to equilibrium; return a report, and the arrays and the state at rest."""
    arrays, scale = assembly.static_arrays(model, geometry)
    constants = {**geometry, **arrays, **assembly.still_loads(STATIC_STEPS)}
    state = assembly.initial_state(constants)
    views = core.to_fortran(constants)
    step, unbalanced, chunks = 0, 1.0, Chunks(1)
    tolerance = YIELDING_TOLERANCE if model.yielding().any() else STATIC_TOLERANCE
    while unbalanced > tolerance or step % STATIC_ROUND:
        if step >= STATIC_STEPS:
            raise SolverError(
                f"static stage: unbalanced force still {unbalanced:.1e} of the acting forces after "
                f"{step} steps; a block may be free to fall, check supports and strengths"
            )
        # Only whole rounds may end the stage: else its last step would depend on the clock.
        n_steps = min(chunks.steps, STATIC_ROUND - step % STATIC_ROUND)
        with chunks.timed(n_steps):
            _, energy, failed = core.advance(views, state, step, n_steps, LEDGER_EVERY)
        step += n_steps
        if failed is not None:
            raise SolverError(f"static stage: the motion grew without limit at step {step}")
        if len(energy):
            unbalanced = float(energy[-1][core.ENERGIES.index("unbalanced")] / scale)
        if progress is not None:
            share = math.log(max(unbalanced, tolerance)) / math.log(tolerance)
            progress("static", max(0.0, share), 1.0)
    log.info("static stage: %d steps, unbalanced force %.1e", step, unbalanced)
    return {"steps": step, "unbalanced": unbalanced}, (constants, state)


def export(prepared: Prepared, path):
    """Write a prepared model for the program ``pyblast-run``, which marches it to the same bits.

    Raises
    ------
    InputError
        If the model is to march in numbers of four bytes, which that program has not.
    """
    if prepared.single:
        raise InputError("model.single: pyblast-run has numbers of eight bytes only; leave it out")
    march = {"n_steps": prepared.n_steps, "ledger_every": LEDGER_EVERY}
    constants = core.numbered(prepared.constants)
    write_model(path, constants, prepared.state, march, prepared.fingerprint)
