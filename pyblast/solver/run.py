"""Runs: time integration in chunks with checkpoints, of one model or of a batch."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any

import numpy as np

from .. import core
from ..errors import InputError, SolverError
from ..files import versions
from ..model.model import Model
from ..signals.seismogram import Seismogram
from . import assembly
from .assembly import Step
from .edge_springs import common_edges
from .model_file import read_checkpoint, read_program_result, write_checkpoint
from .preparation import LEDGER_EVERY, Chunks, Prepared, peak_interval, prepare

CHECKPOINT_SECONDS = 30.0
GROWTH = 4.0  # of energy after the sources, at which a run with an absorbing layer stops
VISIBLE = 1e-6  # of the largest energy, below which growth is not judged


@dataclass(frozen=True, eq=False)
class Run:
    """Run: seismograms, energy balance and final state.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By receiver.
    energy : dict of str to (n_lines,) float64, J
        Terms of the energy balance, with ``time`` in s.
    balance_error : float
        Largest error of the energy balance over the largest input energy.
    dt : float, s
    state : dict of str to numpy array
        Displacement, velocity, tractions and joint states at the end.
    prepared : Prepared
    snapshots : dict of float to (n_nodes, 3) float32, m/s
        Node velocities by time.
    peak_velocity : (n_nodes,) float32, m/s
        Largest length of the velocity of each node; empty unless asked for.
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
    peak_velocity: np.ndarray = field(default_factory=lambda: np.empty(0, np.float32))


def simulate(
    model: Model,
    duration: float,
    *,
    progress: Callable | None = None,
    checkpoint: str | Path | None = None,
    resume: str | Path | None = None,
    snapshot_times: Sequence[float] = (),
    prepared: Prepared | None = None,
    peaks_to: float | None = None,
    observer: Any = None,
) -> Run:
    """Simulate a model: assemble, find static equilibrium, integrate in time.

    Parameters
    ----------
    model : Model
    duration : float, s
    progress : callable, optional
        Called with (stage, done, total) every 0.05 s or so; may raise to stop the run.
    checkpoint : path, optional
        File written every 30 s and on interruption.
    resume : path, optional
        Checkpoint of the same model; the result is bit-identical to an uninterrupted run.
    snapshot_times : sequence of float, s
    prepared : Prepared, optional
        Result of `prepare` for the same model and duration.
    peaks_to : float, Hz, optional
        Keep the peak velocity of every node, sampled 20 times a period of this frequency: up to
        it, 1.2 % of the peak are lost at most, as 1 - cos(pi / 20).
    observer : JointWatch, optional
        Takes a sample every ``observer.every`` steps, which is then the interval of peaks, too; its
        ``records`` are part of the checkpoint.

    Returns
    -------
    Run

    Raises
    ------
    InputError
        If it is no model, or the checkpoint belongs to another one.
    SolverError
        If the motion is not finite or the run is unstable.

    Notes
    -----
    Central differences with velocities at half steps; theory.md (2.5) to (2.8).

    Examples
    --------
    >>> from pyblast.mesh.builder import structured_box
    >>> from pyblast.model.boundary import Viscous
    >>> from pyblast.model.material import Material
    >>> from pyblast.model.model import Receiver
    >>> from pyblast.model.source import PointForce, TimeFunction
    >>> pulse = TimeFunction(1e6 * np.hanning(11), 1e-3)
    >>> model = Model(
    ...     structured_box((4, 4, 4), (40.0, 40.0, 40.0)),
    ...     {"rock": Material.from_speeds(2700.0, 5000.0, 3000.0)},
    ...     boundaries=[Viscous("bottom")],
    ...     sources=[PointForce((10.0, 20.0, 40.0), (0.0, 0.0, -1.0), pulse)],
    ...     receivers=[Receiver("R1", (30.0, 20.0, 40.0))],
    ... )
    >>> run = simulate(model, 0.02)
    >>> run.seismograms["R1"].label, run.balance_error < 1e-9
    ('R1', True)
    """
    if not isinstance(model, Model):
        raise InputError(
            f"simulate: needs a Model, got {type(model).__name__}; load_project reads a project "
            "file, whose simulate() runs its model, and run takes its path"
        )
    began = time.perf_counter()
    prepared = prepared or prepare(model, duration, progress)
    integration = _Integration(model, prepared, peaks_to, observer)
    if resume is not None:
        integration.restore(resume)
    for time_ in snapshot_times:
        if not 0.0 <= time_ <= duration:
            raise InputError(f"snapshot_times: must lie in 0 to {duration:g} s, got {time_:g} s")
    stops = sorted({min(prepared.n_steps, round(t / integration.dt)) for t in snapshot_times})
    try:
        integration.run(progress, checkpoint, stops)
    except KeyboardInterrupt:
        if checkpoint is not None:
            integration.save(checkpoint)
        raise
    return integration.result(time.perf_counter() - began)


def integrated(model: Model, prepared: Prepared, path: str | Path) -> Run:
    """Return the `Run` that the program ``pyblast-run`` made of a prepared model.

    It holds no snapshots and no peaks of nodes, which that program does not record.

    Raises
    ------
    InputError
        If the file belongs to another model.
    ReadError
        If it is damaged or no such file.
    """
    empty = _Integration(model, prepared)
    records = {"motion": empty.motion, "energy": empty.energy}
    stored = read_program_result(
        path, prepared.short_fingerprint, {"records": records, "state": prepared.state}
    )
    motion, energy = (stored["records"][name] for name in records)
    run = collect(model, prepared, motion, energy, stored["state"], 0.0, {})
    return replace(run, peak_velocity=np.zeros(len(stored["state"]["velocity"]), np.float32))


class _Integration:
    """Time integration in progress: current step, state and records."""

    def __init__(self, model, prepared, peaks_to=None, observer=None):
        self.model, self.prepared = model, prepared
        self.dt = prepared.constants["dt"]
        self.views, self.state = prepared.begun()
        self.step = 0
        self.motion = np.zeros((prepared.n_steps, max(1, len(model.receivers)), 3))
        self.energy = np.zeros((-(-prepared.n_steps // LEDGER_EVERY), len(core.ENERGIES)))
        self.snapshots = {}
        self.observer, self.every = observer, None
        if observer is not None:
            self.every = observer.every
        elif peaks_to is not None:
            self.every = peak_interval(self.dt, peaks_to, prepared)
        n_nodes = 0 if peaks_to is None else len(self.state["velocity"])
        self.peak = np.zeros(n_nodes, np.float32)

    def run(self, progress, checkpoint, stops):
        """Integrate to the end in chunks of about `CHUNK_SECONDS`."""
        total, chunks, saved = self.prepared.n_steps, Chunks(1), time.perf_counter()
        self._take_snapshot(stops)
        if self.step == 0 and self.observer is not None:
            self.observer.sample(0, self.state, self._velocity())
        while self.step < total:
            last = min([total, chunks.end(self.step), *(s for s in stops if s > self.step)])
            with chunks.timed(last - self.step):
                while self.step < last:
                    self._advance(self._steps_to(last))
            self._take_snapshot(stops)
            if self.model.mesh.layer is not None:
                check_decay(_ledger(self.energy[: -(-self.step // LEDGER_EVERY)], self.dt))
            if progress is not None:
                progress("dynamic", self.step, total)
            if checkpoint is not None and time.perf_counter() - saved > CHECKPOINT_SECONDS:
                self.save(checkpoint)
                saved = time.perf_counter()

    def _steps_to(self, last):
        """Return the steps to the next sample of the peaks, or to the last step before it."""
        every = self.every or last
        return min(last, (self.step // every + 1) * every) - self.step

    def _take_snapshot(self, stops):
        """Store a snapshot at the requested steps."""
        if self.step in stops:
            self.snapshots[self.step] = self._velocity().astype(np.float32)

    def _velocity(self):
        """Return the whole velocity (n_nodes, 3) of the nodes, with the field of injected sources.

        Velocities are those of half a step before the state.
        """
        velocity, injection = self.state["velocity"], self.prepared.injection
        if injection is None or not self.step:
            return velocity
        whole = velocity.copy()
        whole[injection.nodes] += injection.velocity[self.step - 1]
        return whole

    def _advance(self, n_steps):
        """Integrate one chunk and store its records."""
        motion, energy, failed = core.advance(
            self.views, self.state, self.step, n_steps, LEDGER_EVERY
        )
        line = -(-self.step // LEDGER_EVERY)
        self.motion[self.step : self.step + len(motion)] = motion
        self.energy[line : line + len(energy)] = energy
        self.step += len(motion)
        if failed is not None:
            raise SolverError(failure(self.model, self.prepared, self.step, failed))
        if self.every is None or self.step % self.every:
            return
        velocity = self._velocity()
        if len(self.peak):
            x, y, z = velocity.T
            np.maximum(self.peak, np.sqrt(x * x + y * y + z * z), out=self.peak)
        if self.observer is not None:
            self.observer.sample(self.step, self.state, velocity)

    def save(self, path):
        """Write a checkpoint."""
        key = self.prepared.fingerprint
        write_checkpoint(path, key, self.step, self.state, self._records(), self.snapshots)

    def _records(self):
        """Return what is recorded at every step."""
        observed = {} if self.observer is None else self.observer.records
        return {"motion": self.motion, "energy": self.energy, "peak": self.peak} | {
            f"joints_{name}": values for name, values in observed.items()
        }

    def restore(self, path):
        """Restore a checkpoint of the same model."""
        self.step, self.state, records, self.snapshots = read_checkpoint(
            path, self.prepared.fingerprint, self.state, self._records()
        )
        self.motion, self.energy, self.peak = (records[n] for n in ("motion", "energy", "peak"))
        if self.observer is not None:
            names = self.observer.records
            self.observer.records = {name: records[f"joints_{name}"] for name in names}

    def result(self, wall_seconds):
        """Return the result of the run."""
        run = collect(
            self.model, self.prepared, self.prepared.whole(self.motion), self.energy, self.state,
            wall_seconds,
            {step * self.dt: velocity for step, velocity in self.snapshots.items()},
        )  # fmt: skip
        return replace(run, peak_velocity=self.peak)


def collect(
    model: Model,
    prepared: Prepared,
    motion: np.ndarray,
    energy: np.ndarray,
    state: dict[str, Any],
    wall_seconds: float,
    snapshots: dict[float, np.ndarray],
) -> Run:
    """Return the `Run` of a completed integration, whose motion is whole."""
    dt = prepared.constants["dt"]
    ledger = _ledger(energy, dt, _only_the_layer_damps(model, prepared.constants))
    injection = prepared.injection
    if injection is not None:
        moved = state["displacement"].copy()
        moved[injection.nodes] += dt * injection.velocity.sum(axis=0, dtype=float)
        state = {**state, "displacement": moved}
    return Run(
        seismograms(model, motion, dt), ledger, balance_error(ledger), dt, state, prepared,
        snapshots, versions(prepared.fingerprint), wall_seconds,
    )  # fmt: skip


def seismograms(model: Model, motion: np.ndarray, dt: float) -> dict[str, Seismogram]:
    """Return motion (n_steps, n_receivers, 3) as seismograms in the receivers' directions."""
    records = {}
    for number, receiver in enumerate(model.receivers):
        record = Seismogram(motion[:, number], dt, 0.5 * dt, receiver.name)
        records[receiver.name] = receiver.measured(record)
    return records


def failure(model: Model, prepared: Prepared, step: int, node: int) -> str:
    """Return a message with time, place and likely cause of a failed run."""
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


def _ledger(energy, dt, layer_alone=False) -> dict[str, np.ndarray]:
    """Return the energies (n_lines, n) of a run by name, with their time in s.

    What an absorbing layer takes stands apart where it alone takes as damping does.
    """
    ledger = {**dict(zip(core.ENERGIES, energy.T, strict=True))}
    if layer_alone:
        ledger |= {"absorbing_layer": ledger["damping"], "damping": np.zeros(len(energy))}
    return {**ledger, "time": dt * LEDGER_EVERY * np.arange(len(energy))}


def _only_the_layer_damps(model: Model, constants) -> bool:
    """Tell whether ground without any damping lies in the absorbing layer of hexahedra."""
    damping = (constants[name] for name in ("set_beta", "set_branch", "node_alpha"))
    still = model.local_damping == 0.0 and not any(map(np.any, damping))
    return model.mesh.layer is not None and still


def check_decay(energy: dict[str, np.ndarray]) -> None:
    """Stop a run whose energy grows after its last source: only an absorbing layer can feed it.

    Parameters
    ----------
    energy : dict of str to (n,) float64, J
        Ledger so far, with ``time`` in s.

    Raises
    ------
    SolverError
        If the energy has grown `GROWTH` times since the sources ended, to more than `VISIBLE` of
        its largest.
    """
    given = energy["input"] + energy["insitu"]
    acts = np.abs(np.diff(given)) > 1e-12 * np.abs(given).max(initial=0.0)
    quiet = int(np.flatnonzero(acts)[-1]) + 1 if acts.any() else 0
    total = np.sum([energy[name] for name in ("kinetic", "strain", "joint_stored")], axis=0)
    lowest = np.min(total[quiet:], initial=np.inf)
    if total[-1] > GROWTH * max(lowest, VISIBLE * np.max(total)):
        raise SolverError(
            f"the absorbing layer feeds the motion: the energy at {energy['time'][-1]:.4g} s is "
            f"over {GROWTH:g} times that left after the sources, which ended at "
            f"{energy['time'][quiet]:.4g} s; give soft ground at the sides quality factors, or "
            "take mesh.kind = 'tetrahedra'"
        )


def balance_error(energy: dict[str, np.ndarray]) -> float:
    """Return the largest error of the energy balance over the largest input; theory.md (2.8)."""
    gained = sum(energy[n] for n in ("kinetic", "strain", "joint_stored"))
    gained += sum(energy[n] for n in ("joint_dissipated", "zone_dissipated"))
    gained += sum(energy.get(n, 0.0) for n in ("damping", "dashpots", "absorbing_layer"))
    gap = gained - energy["input"] - energy["insitu"]
    start = energy["kinetic"][0] + energy["strain"][0]
    largest = max(start + np.abs(energy["input"]).max(), start + np.abs(energy["insitu"]).max())
    return float(np.abs(gap - gap[0]).max() / largest) if largest > 0.0 else 0.0


LOADS = ("load_node", "load_vector", "load_history", "load_delay", "load_member")


def run_many(
    models: Sequence[Model],
    duration: float,
    *,
    step: Step | None = None,
    progress: Callable | None = None,
) -> list[Run]:
    """Run many models; those with common mesh, ground and boundaries run in batches.

    Stiffness, strength and laws of joints, damping, strength of ground, sources, input and in-situ
    stress may differ within a batch. A batch has the shortest time step of its models.

    Parameters
    ----------
    models : sequence of Model
        Models of a batch must share their mesh: use ``dataclasses.replace`` or ``with_joint``.
    duration : float, s
    step : tuple of float and CriticalStep, optional
        Result of `assembly.time_step` of the model with the shortest step: all models then use this
        step and its implicit zones, in every batch.
    progress : callable, optional
        Called with ("models", done, total) after each batch.

    Returns
    -------
    list of Run
        In the order of the models; ``wall_seconds`` is that of the batch over its size.

    Raises
    ------
    InputError
        If models of one mesh differ in other properties.
    SolverError
        If one of the runs is unstable.
    """
    models, runs = list(models), {}
    for group in _over_one_mesh(models):
        for first in range(0, len(group), core.BATCH_SIZE):
            members = group[first : first + core.BATCH_SIZE]
            batch = [models[k] for k in members]
            if len(batch) > 1:
                results = _run_batch(batch, duration, step)
            else:
                prepared = prepare(batch[0], duration, step=step)
                results = [simulate(batch[0], duration, prepared=prepared)]
            runs.update(zip(members, results, strict=True))
            if progress is not None:
                progress("models", len(runs), len(models))
    return [runs[k] for k in range(len(models))]


def _over_one_mesh(models):
    """Return the numbers of the models of each mesh.

    Models in single precision and models with an absorbing layer run alone.
    """
    groups = {}
    for number, model in enumerate(models):
        alone = model.single or model.mesh.layer is not None
        groups.setdefault((id(model.mesh), alone and number), []).append(number)
    return groups.values()


def _run_batch(models, duration, step):
    """Run up to `core.BATCH_SIZE` models as one batch."""
    began = time.perf_counter()
    steps = [step or assembly.time_step(model) for model in models]
    shortest = min(dt for dt, _ in steps)
    implicit = reduce(or_, [limit.implicit for _, limit in steps])
    prepared = [
        prepare(model, duration, step=(shortest, replace(limit, implicit=implicit)))
        for model, (_, limit) in zip(models, steps, strict=True)
    ]
    constants, state = stacked([each.constants for each in prepared], [p.state for p in prepared])
    motion, energy = _integrate_batch(models, prepared, constants, state)
    wall = (time.perf_counter() - began) / len(models)
    runs = []
    for member, (model, each) in enumerate(zip(models, prepared, strict=True)):
        last = {
            name: np.take(state[name], member, core.BATCH_AXIS[name])
            if name in core.BATCH_AXIS
            else state[name]
            for name in each.state
        }
        own, ledger = (np.ascontiguousarray(part[..., member]) for part in (motion, energy))
        runs.append(collect(model, each, each.whole(own), ledger, last, wall, {}))
    return runs


def stacked(
    constants: list[dict[str, Any]], states: list[dict[str, np.ndarray]]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Stack the arrays of models as members of a batch; unused ones repeat the first model."""
    rates = sorted({rate for each in constants for rate in each["memory_rate"]})
    constants = common_edges([_at_rates(each, rates) for each in constants])
    fill = core.BATCH_SIZE - len(constants)
    loads, histories = _merged_loads(constants, fill)
    shifted = [
        {
            **each,
            "fixed_history": np.where(each["fixed_history"] < 0, -1, each["fixed_history"] + k),
        }
        for each, k in zip(constants, histories, strict=True)
    ]
    memory = np.zeros((len(states[0]["displacement"]), len(rates), 3))
    states = [{**each, "memory": memory} for each in states]
    together = {}
    for name in constants[0]:
        if name in loads:
            together[name] = loads[name]
        elif name in core.BATCH_AXIS:
            together[name] = _batched(name, [each[name] for each in shifted], fill)
        else:
            together[name] = _common(name, [each[name] for each in constants])
    return together, {
        name: _batched(name, [each[name] for each in states], fill)
        if name in core.BATCH_AXIS
        else states[0][name]
        for name in states[0]
    }


def _at_rates(constants, rates):
    """Return the constants of a model with the relaxation rates of the whole batch."""
    own = constants["set_branch"]
    table = np.zeros((len(own), len(rates), 2))
    table[:, np.searchsorted(rates, constants["memory_rate"])] = own
    return {**constants, "set_branch": table, "memory_rate": np.array(rates)}


def _merged_loads(constants, fill):
    """Return the loads of all models with their members, and the first history of each model.

    Unused members have the loads of the first model too, which may balance its initial stress.
    """
    counts = [each["history"].shape[1] for each in constants]
    begins = np.concatenate([[0], np.cumsum(counts)])[:-1].astype(np.int32)
    parts = [
        {
            **each,
            "load_history": each["load_history"] + begin,
            "load_member": np.full_like(each["load_member"], member),
        }
        for member, (each, begin) in enumerate(
            [*zip(constants, begins, strict=True), *[(constants[0], begins[0])] * fill]
        )
    ]
    loads = {name: np.concatenate([part[name] for part in parts]) for name in LOADS}
    return {**loads, "history": np.hstack([each["history"] for each in constants])}, begins


def _batched(name, values, fill):
    """Stack arrays along the axis of the members; the first fills unused members."""
    members = values + [values[0]] * fill
    return np.ascontiguousarray(np.stack(members, axis=core.BATCH_AXIS[name]))


def _common(name, values):
    """Return an array common to all models.

    Raises
    ------
    InputError
        If it differs.
    """
    if not all(np.array_equal(values[0], other) for other in values[1:]):
        raise InputError(
            f"run_many: models over one mesh differ in '{name}'; only joints, damping, strengths, "
            "sources, input and in-situ stress may differ; run the others by themselves"
        )
    return values[0]


def _integrate_batch(models, prepared, constants, state):
    """Integrate a batch to the end; return motion and energy, members last."""
    views, n_steps = core.to_fortran_batch(constants), prepared[0].n_steps
    motion, energy, failed = core.advance_batch(views, state, 0, n_steps, LEDGER_EVERY)
    if failed is not None:
        node, member = failed
        member = member if member < len(models) else 0  # unused members repeat the first
        text = failure(models[member], prepared[member], len(motion), node)
        raise SolverError(f"model {member + 1} of the batch: {text}")
    return motion, np.moveaxis(energy, 1, -1)
