"""The march through time in chunks: static stage, dynamic stage, checkpoints, results."""

import logging
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from . import assembly, kernels
from .errors import InputError, SolverError
from .model import Model
from .model_file import read_checkpoint, write_checkpoint, write_model
from .provenance import fingerprint, versions
from .seismogram import Seismogram
from .stability import CriticalStep

LEDGER_EVERY = 20
CHUNK_SECONDS = 0.05
STATIC_CHUNK = 200
STATIC_TOLERANCE = 1e-5
STATIC_STEPS = 40_000
CHECKPOINT_SECONDS = 30.0
log = logging.getLogger(__name__)


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
        SHA-256 of all constants and of the state.
    """

    constants: dict
    state: dict
    n_steps: int
    limit: CriticalStep
    static: dict
    fingerprint: str


@dataclass(frozen=True, eq=False)
class Run:
    """What a run gives.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By receiver.
    energy : dict of str to (n_lines,) float64, J
        The ledger, with ``time`` in s.
    balance_error : float
        Largest difference between energy put in and found, over the largest energy put in.
    dt : float, s
    state : dict of str to numpy array
        Displacement, velocity, tractions and joint states at the end.
    prepared : Prepared
    snapshots : dict of float to (n_nodes, 3) float32, m/s
        Node velocities by time.
    provenance : dict of str to str
    wall_seconds : float
    """

    seismograms: dict[str, Seismogram]
    energy: dict[str, np.ndarray]
    balance_error: float
    dt: float
    state: dict[str, np.ndarray]
    prepared: Prepared
    snapshots: dict[float, np.ndarray] = field(default_factory=dict)
    provenance: dict[str, str] = field(default_factory=dict)
    wall_seconds: float = 0.0


def prepare(model: Model, duration: float, progress: Callable | None = None) -> Prepared:
    """Assemble the arrays of a model and bring it to rest under its in-situ stress.

    Parameters
    ----------
    model : Model
    duration : float, s
    progress : callable, optional
        Called with (stage, done, total) between chunks.

    Raises
    ------
    InputError
        If the duration is not positive.
    SolverError
        If the static stage does not come to rest.
    """
    if not (math.isfinite(duration) and duration > 0.0):
        raise InputError(f"duration: must be positive, got {duration:g} s")
    geometry, limit = assembly.geometry_arrays(model)
    n_steps = math.ceil(duration / geometry["dt"])
    static, contact_state = {}, None
    if model.insitu is not None and model.mesh.contacts is not None:
        static, traction, contact_state = _equilibrate(model, geometry, progress)
        geometry = {**geometry, "contact_initial": traction}
    constants = {**geometry, **assembly.dynamic_arrays(model, geometry, n_steps)}
    state = assembly.initial_state(constants)
    if contact_state is not None:
        state["contact_state"] = contact_state
    return Prepared(constants, state, n_steps, limit, static, fingerprint(constants, state))


def _equilibrate(model, geometry, progress):
    """Relax to equilibrium; return a report, tractions and joint states without their slip."""
    arrays, scale = assembly.static_arrays(model, geometry)
    constants = {**geometry, **arrays, **assembly.still_loads(STATIC_STEPS)}
    state = assembly.initial_state(constants)
    views = kernels.to_fortran(constants)
    for done in range(0, STATIC_STEPS, STATIC_CHUNK):
        _, energy, failed = kernels.advance(views, state, done, STATIC_CHUNK, STATIC_CHUNK)
        unbalanced = energy[-1][kernels.ENERGIES.index("unbalanced")] / max(scale, 1e-300)
        if failed is not None:
            raise SolverError(f"static stage: the motion grew without limit at step {done}")
        if progress is not None:
            progress("static", min(1.0, math.log(max(unbalanced, 1e-9)) / math.log(1e-5)), 1.0)
        if done and unbalanced < STATIC_TOLERANCE:
            break
    else:
        raise SolverError(
            f"static stage: unbalanced force still {unbalanced:.1e} of the acting forces after "
            f"{STATIC_STEPS} steps; a block may be free to fall, check supports and strengths"
        )
    log.info("static stage: %d steps, unbalanced force %.1e", done + STATIC_CHUNK, unbalanced)
    contact_state = state["contact_state"].copy()
    contact_state[:, :3] = 0.0
    report = {"steps": done + STATIC_CHUNK, "unbalanced": float(unbalanced)}
    return report, state["contact_traction"].copy(), contact_state


def run(
    model: Model,
    duration: float,
    *,
    progress: Callable | None = None,
    checkpoint=None,
    resume=None,
    snapshot_times=(),
    prepared: Prepared | None = None,
) -> Run:
    """March a model through time.

    Parameters
    ----------
    model : Model
    duration : float, s
    progress : callable, optional
        Called with (stage, done, total) between chunks of about 0.05 s; a run can be stopped there.
    checkpoint : path, optional
        Written every 30 s and when the run is interrupted.
    resume : path, optional
        A checkpoint of the same model; the run goes on with the same bits.
    snapshot_times : sequence of float, s
    prepared : Prepared, optional
        The result of `prepare` for the same model and duration.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        If the checkpoint belongs to another model.
    SolverError
        If the motion is not finite or its energy grows without cause.
    """
    began = time.perf_counter()
    prepared = prepared or prepare(model, duration, progress)
    march = _March(model, prepared)
    if resume is not None:
        march.restore(resume)
    stops = sorted({min(prepared.n_steps, round(t / march.dt)) for t in snapshot_times})
    try:
        march.go(progress, checkpoint, stops)
    except KeyboardInterrupt:
        if checkpoint is not None:
            march.save(checkpoint)
        raise
    return march.result(time.perf_counter() - began)


def export(prepared: Prepared, path):
    """Write a prepared model for the program ``pyblast-run``, which marches it to the same bits."""
    march = {"n_steps": prepared.n_steps, "ledger_every": LEDGER_EVERY}
    constants = kernels.numbered(prepared.constants)
    write_model(path, constants, prepared.state, march, prepared.fingerprint)


class _March:
    """A run under way: where it is and what it has recorded."""

    def __init__(self, model, prepared):
        self.model, self.prepared = model, prepared
        self.dt = prepared.constants["dt"]
        self.views = kernels.to_fortran(prepared.constants)
        self.state = {name: value.copy() for name, value in prepared.state.items()}
        self.step = 0
        self.motion = np.zeros((prepared.n_steps, max(1, len(model.receivers)), 3))
        self.energy = np.zeros((-(-prepared.n_steps // LEDGER_EVERY), len(kernels.ENERGIES)))
        self.snapshots = {}

    def go(self, progress, checkpoint, stops):
        """March to the end in chunks of about `CHUNK_SECONDS`."""
        total, chunk, saved = self.prepared.n_steps, 1, time.perf_counter()
        while self.step < total:
            last = min([total, self.step + chunk, *(s for s in stops if s > self.step)])
            began = time.perf_counter()
            self._advance(last - self.step)
            took = time.perf_counter() - began
            chunk = max(1, min(4 * chunk, int(chunk * CHUNK_SECONDS / max(took, 1e-4))))
            if self.step in stops:
                self.snapshots[self.step * self.dt] = self.state["velocity"].astype(np.float32)
            if progress is not None:
                progress("dynamic", self.step, total)
            if checkpoint is not None and time.perf_counter() - saved > CHECKPOINT_SECONDS:
                self.save(checkpoint)
                saved = time.perf_counter()

    def _advance(self, n_steps):
        """March one chunk and keep what it recorded."""
        motion, energy, failed = kernels.advance(
            self.views, self.state, self.step, n_steps, LEDGER_EVERY
        )
        line = -(-self.step // LEDGER_EVERY)
        self.motion[self.step : self.step + len(motion)] = motion
        self.energy[line : line + len(energy)] = energy
        self.step += len(motion)
        if failed is not None:
            raise SolverError(self._failure(failed))

    def _failure(self, node):
        """Say when and where the march failed, and the likely cause."""
        mesh, limit = self.model.mesh, self.prepared.limit
        x, y, z = mesh.points[node]
        zone = np.flatnonzero((mesh.zones == node).any(axis=1))[0]
        group = mesh.groups[mesh.zone_group[zone]]
        cause = "an input that is not finite or a load that grows"
        if self.dt > limit.dt:
            cause = f"a time step of {self.dt:.3g} s above the critical {limit.dt:.3g} s"
        return (
            f"the energy is not finite or exceeds twice what was put in at step {self.step} "
            f"(t = {self.step * self.dt:.4g} s), largest velocity at ({x:.4g}, {y:.4g}, {z:.4g}) m "
            f"in '{group}'; likely cause: {cause}"
        )

    def save(self, path):
        """Write a checkpoint."""
        write_checkpoint(
            path, self.prepared.fingerprint, self.step, self.state, self.motion, self.energy
        )

    def restore(self, path):
        """Go on from a checkpoint of the same model."""
        found = read_checkpoint(path, self.prepared.fingerprint, self.state, self.motion, self.energy)
        self.step, self.state, self.motion, self.energy = found

    def result(self, wall_seconds):
        """Collect seismograms, ledger and provenance."""
        seismograms = {}
        for number, receiver in enumerate(self.model.receivers):
            record = Seismogram(self.motion[:, number], self.dt, 0.5 * self.dt, receiver.name)
            if receiver.azimuth is not None:
                record = record.rotated(receiver.azimuth)
            seismograms[receiver.name] = record
        energy = dict(zip(kernels.ENERGIES, self.energy.T, strict=True))
        energy["time"] = self.dt * LEDGER_EVERY * np.arange(len(self.energy))
        return Run(
            seismograms, energy, balance_error(energy), self.dt, self.state, self.prepared,
            self.snapshots, versions(self.prepared.fingerprint), wall_seconds,
        )  # fmt: skip


def balance_error(energy):
    """Return the largest gap of a ledger over the largest energy put in; theory.md (2.8)."""
    gained = sum(energy[n] for n in ("kinetic", "strain", "joint_stored", "joint_dissipated"))
    gap = gained + energy["damping"] + energy["dashpots"] - energy["input"] - energy["insitu"]
    start = energy["kinetic"][0] + energy["strain"][0]
    largest = max(start + np.abs(energy["input"]).max(), start + np.abs(energy["insitu"]).max())
    return float(np.abs(gap - gap[0]).max() / largest) if largest > 0.0 else 0.0
