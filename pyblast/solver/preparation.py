"""Preparation of a run: kernel arrays in static equilibrium, with their provenance."""

import hashlib
import logging
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import core
from ..errors import InputError, SolverError
from ..mesh.quality import refuse_beyond_memory
from ..model.model import Model
from . import assembly
from .assembly import Step
from .edge_springs import run_bytes
from .free_field import side_loads
from .implicit_zones import implicit_arrays
from .initial_stress import after_static, can_yield, static_arrays
from .injection import Injection, inject, injection_bytes, patch_of
from .line_implicit import line_arrays
from .model_file import write_model
from .time_step import CriticalStep, contact_springs


def fingerprint(*tables: dict[str, Any]) -> str:
    """Return the SHA-256 of named arrays and numbers, in the order of their names."""
    digest = hashlib.sha256()
    for table in tables:
        for name in sorted(table):
            value = np.ascontiguousarray(table[name])
            digest.update(f"{name} {value.dtype.str} {value.shape}".encode())
            digest.update(value.tobytes())
    return digest.hexdigest()


LEDGER_EVERY = 20
PEAK_SAMPLES = 20  # of a period, for the peak velocity of nodes
CHUNK_SECONDS = 0.05  # wall time between returns to Python
STATIC_ROUND = 100  # steps between convergence checks
STATIC_TOLERANCE = 1e-5
YIELDING_TOLERANCE = 1e-6  # plastic zones converge slowly and keep their final stress
STATIC_STEPS = 40_000
log = logging.getLogger(__name__)


class Chunks:
    """Chunk length: steps of about `CHUNK_SECONDS`, at least one round of the energy balance."""

    def __init__(self, steps: int) -> None:
        self.steps = steps

    @contextmanager
    def timed(self, steps: int) -> Iterator[None]:
        """Measure the time of one chunk and adapt the length of the next."""
        began = time.perf_counter()
        yield
        took = max(time.perf_counter() - began, 1e-4)
        target = max(LEDGER_EVERY, int(steps * CHUNK_SECONDS / took))
        self.steps = min(4 * self.steps, target)

    def end(self, step: int) -> int:
        """Return the last step of a chunk: the end of a round of the energy balance.

        The yield check of plastic zones is made at the start of a chunk and of each round.
        """
        last = step + self.steps
        return last - last % LEDGER_EVERY if self.steps >= LEDGER_EVERY else last


@dataclass(frozen=True, eq=False)
class Prepared:
    """Prepared run: the kernel arrays of a model and its initial state.

    Parameters
    ----------
    constants : dict
        Kernel arguments in Python's index order, indices from 0.
    state : dict
        Arrays that change, named as in ``core.STATE``.
    n_steps : int
    limit : CriticalStep
    static : dict
        ``steps`` and ``unbalanced`` of the static stage; empty without one.
    fingerprint : str
        SHA-256 of all constants, of the state and of ``single``.
    single : bool
        Whether the run is in single precision.
    injection : Injection or None
        Of an injected model: what is to be added to the motion of receivers and nodes.
    """

    constants: dict[str, Any]
    state: dict[str, np.ndarray]
    n_steps: int
    limit: CriticalStep
    static: dict[str, Any]
    fingerprint: str
    single: bool = False
    injection: Injection | None = None

    def whole(self, motion: np.ndarray) -> np.ndarray:
        """Return the motion (n_steps, n, 3) of receivers with the field of injected sources."""
        if self.injection is None or not self.injection.motion.size:
            return motion
        return motion + self.injection.motion

    @property
    def short_fingerprint(self) -> int:
        """The first 31 bits of the fingerprint, which fit an integer of Fortran."""
        return int(self.fingerprint[:8], 16) >> 1

    def in_run_precision(self, arrays: dict[str, Any]) -> dict[str, Any]:
        """Return constants or a state in the precision of the run."""
        return core.in_single(arrays) if self.single else arrays

    def begun(self) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
        """Return the constants as views for the kernels, and a copy of the initial state."""
        state = {name: value.copy() for name, value in self.in_run_precision(self.state).items()}
        return core.to_fortran(self.in_run_precision(self.constants)), state


def prepare(
    model: Model, duration: float, progress: Callable | None = None, step: Step | None = None
) -> Prepared:
    """Assemble the arrays of a model and compute its static equilibrium.

    Parameters
    ----------
    model : Model
    duration : float, s
    progress : callable, optional
        Called with (stage, done, total) between chunks.
    step : tuple of float and CriticalStep, optional
        Result of `assembly.time_step` for the model, or the same with a shorter step.

    Raises
    ------
    InputError
        If the duration is not positive, or the model does not fit into memory.
    SolverError
        If the static stage does not converge.
    """
    if not (math.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: must be positive, got {duration:g} s")
    zones = f"model: {len(model.mesh.zones)} zones"
    refuse_beyond_memory(zones, run_bytes(model))
    geometry, limit = assembly.geometry_arrays(model, step, progress)
    n_steps = max(2, math.ceil(duration / geometry["dt"]))  # a seismogram has two samples
    n_samples = n_steps * (1 + len(model.receivers))
    recorded = f"{zones} with {len(model.receivers)} receivers over {n_steps} steps"
    refuse_beyond_memory(recorded, run_bytes(model, n_samples))
    static, settled = {}, None
    if model.insitu is not None and (model.mesh.contacts is not None or model.yielding().any()):
        static, settled = _equilibrate(model, geometry, progress)
    sides = side_loads(model, geometry["dt"], n_steps * geometry["dt"], _run_column)
    if sides:
        histories = f"{recorded} and {len(sides)} histories of free-field sides"
        needed = run_bytes(model, n_samples, n_steps * len(sides))
        refuse_beyond_memory(histories, needed)
    injection, entry = None, None
    if model.injected:
        patch = patch_of(model)
        if not isinstance(patch, str):
            needed = run_bytes(model, n_samples) + injection_bytes(model, patch, n_steps)
            refuse_beyond_memory(f"{recorded} and injected sources", needed)
            injection = inject(model, patch, geometry["dt"], n_steps)
            entry = patch.sources, injection.loads
    constants = {**geometry, **assembly.dynamic_arrays(model, geometry, n_steps, sides, entry)}
    constants |= _implicit(model, constants, limit.implicit)
    state = assembly.initial_state(constants)
    if settled is not None:
        constants, state = after_static(constants, *settled)
    content = fingerprint(constants, state, {"single": model.single})
    return Prepared(constants, state, n_steps, limit, static, content, model.single, injection)


def _implicit(model, constants, implicit):
    """Return the kernel arrays of what a model takes implicitly."""
    if model.mesh.hexahedral:
        return line_arrays(model, constants, implicit.zones)
    springs = contact_springs(model)
    return implicit_arrays(model, constants, implicit, springs, assembly.zone_product)


def _run_column(model, duration):
    """Run a free-field column; return the motion of its receivers and the kernel constants."""
    prepared = prepare(model, duration)
    views, state = core.to_fortran(prepared.constants), prepared.state
    motion, _, failed = core.advance(views, state, 0, prepared.n_steps, LEDGER_EVERY)
    if failed is not None:
        raise SolverError("free-field column: the run is unstable; check the input")
    return motion, prepared.constants


def _equilibrate(model, geometry, progress):
    """Relax to static equilibrium; return a report, and the arrays and final state."""
    arrays, scale = static_arrays(model, geometry)
    constants = {**geometry, **arrays, **assembly.zero_loads(STATIC_STEPS)}
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
        # The stage ends after whole rounds only, so that the result does not depend on timing.
        n_steps = min(chunks.steps, STATIC_ROUND - step % STATIC_ROUND)
        with chunks.timed(n_steps):
            _, energy, failed = core.advance(views, state, step, n_steps, LEDGER_EVERY)
        step += n_steps
        if failed is not None:
            raise SolverError(f"static stage: unstable at step {step}")
        if len(energy):
            unbalanced = float(energy[-1][core.ENERGIES.index("unbalanced")] / scale)
        if progress is not None:
            share = math.log(max(unbalanced, tolerance)) / math.log(tolerance)
            progress("static", max(0.0, share), 1.0)
    log.info("static stage: %d steps, unbalanced force %.1e", step, unbalanced)
    return {"steps": step, "unbalanced": unbalanced}, (constants, state)


def export(prepared: Prepared, path: str | Path) -> None:
    """Write a prepared model for the program ``pyblast-run``, which gives bit-identical results.

    Raises
    ------
    InputError
        If the model is in single precision, which that program does not support.
    """
    if prepared.single:
        raise InputError("model.single: pyblast-run runs in double precision only; leave it out")
    steps = {
        "n_steps": prepared.n_steps, "ledger_every": LEDGER_EVERY,
        "fingerprint": prepared.short_fingerprint,
    }  # fmt: skip
    constants, added = core.numbered(prepared.constants), {}
    if prepared.injection is not None and prepared.injection.motion.size:
        added["receiver_motion"] = prepared.injection.motion
    write_model(path, constants, prepared.state, steps, prepared.fingerprint, added)


def peak_interval(
    dt: float, frequency: float, prepared: Prepared, samples: int = PEAK_SAMPLES
) -> int:
    """Return the steps between samples of a field: at least so many a period of a frequency in Hz.

    It divides the rounds of the energy balance or holds whole rounds. Where zones may yield it
    holds whole rounds always, since their check is made at the start of each chunk.
    """
    most = max(1, int(1.0 / (samples * frequency * dt)))
    constants = prepared.constants
    if most >= LEDGER_EVERY or (not constants["hex_order"] and can_yield(constants).any()):
        return max(1, most // LEDGER_EVERY) * LEDGER_EVERY
    return max(k for k in range(1, LEDGER_EVERY) if LEDGER_EVERY % k == 0 and k <= most)
