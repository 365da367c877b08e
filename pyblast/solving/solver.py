"""The march through time in chunks, with checkpoints; what a run gives."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError, SolverError
from ..motion.seismogram import Seismogram
from . import kernels
from .model import Model
from .model_file import read_checkpoint, write_checkpoint
from .preparation import LEDGER_EVERY, Chunks, Prepared, prepare
from .provenance import versions

CHECKPOINT_SECONDS = 30.0


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
    for time_ in snapshot_times:
        if not 0.0 <= time_ <= duration:
            raise InputError(f"snapshot_times: must lie in 0 to {duration:g} s, got {time_:g} s")
    stops = sorted({min(prepared.n_steps, round(t / march.dt)) for t in snapshot_times})
    try:
        march.go(progress, checkpoint, stops)
    except KeyboardInterrupt:
        if checkpoint is not None:
            march.save(checkpoint)
        raise
    return march.result(time.perf_counter() - began)


class _March:
    """A run under way: where it is and what it has recorded."""

    def __init__(self, model, prepared):
        self.model, self.prepared = model, prepared
        self.dt = prepared.constants["dt"]
        self.views, self.state = prepared.begun()
        self.step = 0
        self.motion = np.zeros((prepared.n_steps, max(1, len(model.receivers)), 3))
        self.energy = np.zeros((-(-prepared.n_steps // LEDGER_EVERY), len(kernels.ENERGIES)))
        self.snapshots = {}

    def go(self, progress, checkpoint, stops):
        """March to the end in chunks of about `CHUNK_SECONDS`."""
        total, chunks, saved = self.prepared.n_steps, Chunks(1), time.perf_counter()
        self._keep(stops)
        while self.step < total:
            last = min([total, chunks.end(self.step), *(s for s in stops if s > self.step)])
            with chunks.timed(last - self.step):
                self._advance(last - self.step)
            self._keep(stops)
            if progress is not None:
                progress("dynamic", self.step, total)
            if checkpoint is not None and time.perf_counter() - saved > CHECKPOINT_SECONDS:
                self.save(checkpoint)
                saved = time.perf_counter()

    def _keep(self, stops):
        """Keep a snapshot where one is wanted."""
        if self.step in stops:
            self.snapshots[self.step] = self.state["velocity"].astype(np.float32)

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
            raise SolverError(failure(self.model, self.prepared, self.step, failed))

    def save(self, path):
        """Write a checkpoint."""
        records = {"motion": self.motion, "energy": self.energy}
        write_checkpoint(
            path, self.prepared.fingerprint, self.step, self.state, records, self.snapshots
        )

    def restore(self, path):
        """Go on from a checkpoint of the same model."""
        records = {"motion": self.motion, "energy": self.energy}
        found = read_checkpoint(path, self.prepared.fingerprint, self.state, records)
        self.step, self.state, records, self.snapshots = found
        self.motion, self.energy = records["motion"], records["energy"]

    def result(self, wall_seconds):
        """Collect what the run gives."""
        return collect(
            self.model, self.prepared, self.motion, self.energy, self.state, wall_seconds,
            {step * self.dt: velocity for step, velocity in self.snapshots.items()},
        )  # fmt: skip


def collect(model, prepared, motion, energy, state, wall_seconds, snapshots):
    """Return the `Run` of a model that was marched to its end."""
    dt, seismograms = prepared.constants["dt"], {}
    for number, receiver in enumerate(model.receivers):
        record = Seismogram(motion[:, number], dt, 0.5 * dt, receiver.name)
        if receiver.azimuth is not None:
            record = record.rotated(receiver.azimuth)
        seismograms[receiver.name] = record
    ledger = dict(zip(kernels.ENERGIES, energy.T, strict=True))
    ledger["time"] = dt * LEDGER_EVERY * np.arange(len(energy))
    return Run(
        seismograms, ledger, balance_error(ledger), dt, state, prepared, snapshots,
        versions(prepared.fingerprint), wall_seconds,
    )  # fmt: skip


def failure(model, prepared, step, node):
    """Say when and where a march failed, and the likely cause."""
    mesh, limit, dt = model.mesh, prepared.limit, prepared.constants["dt"]
    x, y, z = model.nodes.points[node]
    zone = np.flatnonzero((model.nodes.zone_nodes == node).any(axis=1))[0]
    group = mesh.groups[mesh.zone_group[zone]]
    cause = "an input that is not finite or a load that grows"
    if dt > limit.dt:
        cause = f"a time step of {dt:.3g} s above the critical {limit.dt:.3g} s"
    return (
        f"the energy is not finite or exceeds five times what was put in at step {step} "
        f"(t = {step * dt:.4g} s), largest velocity at ({x:.4g}, {y:.4g}, {z:.4g}) m "
        f"in '{group}'; likely cause: {cause}"
    )


def balance_error(energy):
    """Return the largest gap of a ledger over the largest energy put in; theory.md (2.8)."""
    gained = sum(energy[n] for n in ("kinetic", "strain", "joint_stored"))
    gained += sum(energy[n] for n in ("joint_dissipated", "zone_dissipated"))
    gap = gained + energy["damping"] + energy["dashpots"] - energy["input"] - energy["insitu"]
    start = energy["kinetic"][0] + energy["strain"][0]
    largest = max(start + np.abs(energy["input"]).max(), start + np.abs(energy["insitu"]).max())
    return float(np.abs(gap - gap[0]).max() / largest) if largest > 0.0 else 0.0
