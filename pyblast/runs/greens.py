"""Green's functions: stored unit responses of holes, and blasts superposed from them."""

import logging
from collections.abc import Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import scipy.sparse

from ..core import BATCH_SIZE, JOINT_LAWS, ZONE_LAWS
from ..errors import InputError
from ..laws import of_laws
from ..mesh.mesh import locate_in_zones
from ..model.boundary import StressInput, VelocityInput
from ..model.joint import FAILED, SLIP, STATUS
from ..model.model import Model, Receiver
from ..model.source import Column, Hole, MomentTensor, PointForce, TimeFunction
from ..signals.seismogram import Seismogram, fast_length
from ..solver.loads import ADDERS, Loads
from ..solver.moment_density import deconvolved
from ..solver.preparation import Prepared, prepare
from ..solver.run import simulate
from .parallel import Cache, input_hash, lost_process, run_loads, shared_folder

PointSource = Hole | Column | MomentTensor | PointForce
CHARGES = (Hole, Column)
KINDS = (*CHARGES, MomentTensor, PointForce)
NONE = TimeFunction(np.zeros(2), 1.0)
PER_LOAD = ("load_node", "load_vector", "load_delay", "load_member")


def unit_source(source: PointSource) -> PointSource:
    """Return a unit source without firing time and history."""
    if isinstance(source, CHARGES):
        return replace(source, charge=1.0, time=0.0, moment_rate=NONE, exponent=1.0)
    if isinstance(source, MomentTensor):
        tensor = source.tensor / size(source)
        return replace(source, tensor=tensor, time=0.0, moment_rate=NONE)
    return replace(source, direction=np.asarray(source.direction) / size(source), history=NONE)


def size(source: PointSource) -> float:
    """Return the factor on the history: of the charge, the norm of the tensor or direction."""
    if isinstance(source, CHARGES):
        return source.charge**source.exponent
    vector = source.tensor if isinstance(source, MomentTensor) else source.direction
    return float(np.linalg.norm(vector)) or 1.0


def history(source: PointSource, times: np.ndarray, width: float = 0.0) -> np.ndarray:
    """Return the moment (n,) in N m, or the force in N, at times (n,).

    The moment is divided by the response of a sphere of width R/cp in s.
    """
    if isinstance(source, PointForce):
        return size(source) * source.history(times)
    return size(source) * drive(source, width)(times - source.time)


def drive(source: PointSource, width: float) -> TimeFunction:
    """Return the force, or the moment divided by the response of a sphere, see `history`."""
    if isinstance(source, PointForce):
        return source.history
    return deconvolved(source.moment_rate.integral(), width)


def position_of(source: PointSource) -> np.ndarray:
    """Return the position of a source, (3,) m; the centre of a column."""
    if isinstance(source, Column):
        return 0.5 * np.add(source.primed, source.end)
    return np.asarray(source.position, dtype=float)


def likeness(source: PointSource) -> tuple:
    """Return the properties that sources at one place must share to have one response."""
    if isinstance(source, Column):
        direction = np.round(np.subtract(source.end, source.primed), 9)
        return Column, *direction, source.detonation_speed, source.sources
    if isinstance(source, PointForce):
        return PointForce, *np.round(np.asarray(source.direction) / size(source), 9)
    if isinstance(source, MomentTensor):
        return MomentTensor, source.spread, *np.round(source.tensor / size(source), 9).ravel()
    return Hole, source.spread


def _unit_step(n_steps):
    """Return a history (n_steps, 1) of a step at the second step."""
    step = np.ones((n_steps, 1))
    step[0] = 0.0
    return step


def unit_loads(
    model: Model, source: PointSource, n_steps: int, dt: float
) -> list[tuple[float, dict[str, np.ndarray]]]:
    """Return the loads of a source with a unit step history from the second step, part by part.

    Parts differ in the width R/cp in s that their history is to be divided by, see
    `moment_density.deconvolved`: the isotropic part of a moment, and the rest.
    """
    collector = Loads()
    ADDERS[type(source)](collector, model, source)
    step = _unit_step(n_steps)
    arrays = collector.arrays(dt * np.arange(n_steps))
    parts = []
    for number, width in enumerate(collector.widths):
        own = arrays["load_history"] == number
        loads = {name: arrays[name][own] for name in PER_LOAD}
        parts.append((width, {**loads, "load_history": 0 * arrays["load_history"][own],
                              "history": step}))  # fmt: skip
    return parts


def refuse_what_does_not_superpose(model: Model) -> None:
    """Raise InputError for models to which superposition of their holes does not apply.

    Raises
    ------
    InputError
        Naming the part.
    """
    for joint in model.joints:
        if not JOINT_LAWS[joint.law].superposes:
            known = ", ".join(name for name, law in JOINT_LAWS.items() if law.superposes)
            raise InputError(
                f"joints.{joint.surface}.law: holes do not superpose across '{joint.law}'; take "
                f"one of {known}, or run each blast as a whole"
            )
    for group in model.mesh.groups:
        if not ZONE_LAWS[model.law(group).name].linear:
            raise InputError(
                f"materials.{group}: holes do not superpose in ground of the law "
                f"'{model.law(group).name}'; take elastic ground, or run each blast as a whole"
            )
    if model.local_damping:
        raise InputError(
            "local_damping: holes do not superpose under it; set it to zero, got "
            f"{model.local_damping:g}"
        )
    for boundary in model.boundaries:
        if isinstance(boundary, (StressInput, VelocityInput)):
            raise InputError(
                f"boundaries.{boundary.surface}: stored responses are those of holes alone; take "
                f"the {type(boundary).__name__} out and add its motion afterwards"
            )
    for source in model.sources:
        if type(source) not in KINDS:
            raise InputError(
                f"sources: a {type(source).__name__} is no hole, column, tensor or force at a "
                "place; take it out and add its motion afterwards"
            )
    for part in ("sources", "receivers"):
        if not getattr(model, part):
            raise InputError(f"{part}: none; stored responses lead from sources to receivers")


def refuse_slip(model: Model, prepared: Prepared, state: dict[str, Any]) -> None:
    """Raise InputError if contacts have slipped or opened at the end of a run.

    Raises
    ------
    InputError
        Naming the joint and the number of contacts.
    """
    sticks = of_laws(JOINT_LAWS, prepared.constants["joint_law"], "sticks")
    begun, ended = prepared.state["contact_state"], state["contact_state"]
    moved = (ended[:, SLIP] != 0.0).any(axis=1) | (ended[:, STATUS] > 0.0)
    moved |= ended[:, FAILED] > begun[:, FAILED]
    for number, joint in enumerate(model.numbered_joints):
        here = prepared.constants["contact_joint"] == number
        if sticks[number]:
            count = np.count_nonzero(moved & here)
            if count:
                raise InputError(
                    f"joints.{joint.surface}: {count} of {np.count_nonzero(here)} contacts slip "
                    "or open in this run, which is not linear then; take the law 'elastic' or "
                    "a weaker load"
                )


NEAR = 1e-6  # m, distance of equal positions


@dataclass(frozen=True, eq=False)
class GreensFunctions:
    """Green's functions: response of receivers to a unit step of moment or force at places.

    Parameters
    ----------
    sources : tuple of Hole, Column, MomentTensor or PointForce
        Unit sources, one for each place.
    parts : tuple of (int, float)
        Number of the source and width R/cp in s of the parts of all sources, see `unit_loads`.
    receivers : tuple of Receiver
    response : (n_parts, n_receivers, 3, n_steps) float64, m/s per N m or per N
        East, north, vertical; sample k half a step after k - 1 steps from the step of moment: the
        interpolation of a delay below one step looks one step ahead.
    dt : float, s
        The time step of the model.
    within : float, m
        Largest distance of a source from its place.
    side : str
        "source" or "receiver" (reciprocity).
    runs : int
    said : str
        Choice of the side, and the check that no contact slips.
    """

    sources: tuple[PointSource, ...]
    parts: tuple[tuple[int, float], ...]
    receivers: tuple[Receiver, ...]
    response: np.ndarray
    dt: float
    within: float
    side: str
    runs: int
    said: str

    @property
    def duration(self) -> float:
        """Duration of the responses, s."""
        return self.dt * (self.response.shape[-1] - 1)

    @property
    def unfinished(self) -> float:
        """Largest motion in the last tenth over the peak, for the worst receiver and place.

        Motion later than `duration` after a firing is missing in longer blasts.
        """
        size = np.linalg.norm(self.response, axis=2)
        return float((size[..., -(size.shape[-1] // 10 + 1) :].max(-1) / size.max(-1)).max())

    def numbers(self, sources: Sequence[PointSource]) -> np.ndarray:
        """Return the number (n,) of the place of each source.

        Raises
        ------
        InputError
            If there is no place of its kind within reach.
        """
        places = np.array([position_of(unit) for unit in self.sources])
        kinds = [likeness(unit) for unit in self.sources]
        numbers = np.zeros(len(sources), dtype=int)
        for n, source in enumerate(sources):
            kind = likeness(source)
            away = np.linalg.norm(places - position_of(source), axis=1)
            away[[other != kind for other in kinds]] = np.inf
            numbers[n] = away.argmin()
            if np.isinf(away[numbers[n]]):
                raise InputError(
                    f"sources[{n}]: no {type(source).__name__} of this shape is stored anywhere; "
                    "add one to the model of the bank"
                )
            if away[numbers[n]] > self.within + NEAR:
                raise InputError(
                    f"sources[{n}]: the nearest stored place of such a {type(source).__name__} "
                    f"lies {away[numbers[n]]:g} m away, allowed are {self.within:g} m; add its "
                    "place to the model of the bank"
                )
        return numbers

    def blast(
        self, sources: Sequence[PointSource], duration: float | None = None
    ) -> dict[str, Seismogram]:
        """Return the seismograms of a blast; theory.md (9.1), (9.2).

        Parameters
        ----------
        sources : sequence of Hole, Column, MomentTensor or PointForce
            At the stored places, with any charges, exponents, times and time functions.
        duration : float, s, optional
            Default `duration`, for which the result equals a run to rounding; see `unfinished` for
            longer ones.

        Raises
        ------
        InputError
            If a source is at no stored place.
        """
        n_known = self.response.shape[-1] - 1
        n = n_known if duration is None else max(2, int(np.ceil(duration / self.dt - 1e-9)))
        size = fast_length(n + min(n, n_known) + 2)
        total = np.zeros((len(self.receivers), 3, size // 2 + 1), dtype=complex)
        numbers = self.numbers(sources)
        for response, (number, width) in zip(self.response, self.parts, strict=True):
            chosen = [s for s, at in zip(sources, numbers, strict=True) if at == number]
            if not chosen:
                continue
            drive = np.asarray(
                sum(
                    np.asarray(scipy.fft.rfft(self.increments(s, n + 1, width), size))
                    for s in chosen
                )
            )
            total += np.asarray(scipy.fft.rfft(response[..., : n + 1], size)) * drive
        return self.seismograms(np.asarray(scipy.fft.irfft(total, size))[..., 1 : n + 1])

    def increments(self, source: PointSource, n_steps: int, width: float = 0.0) -> np.ndarray:
        """Return the increments of moment or force per step, (n_steps,), see `history`."""
        moment = history(source, self.dt * np.arange(n_steps), width)
        return np.diff(moment, prepend=0.0)

    def seismograms(self, motion: np.ndarray) -> dict[str, Seismogram]:
        """Return motion (n_receivers, 3, n) as seismograms in the receivers' directions."""
        records = {}
        for receiver, velocity in zip(self.receivers, motion, strict=True):
            record = Seismogram(velocity.T, self.dt, 0.5 * self.dt, receiver.name)
            turned = record if receiver.azimuth is None else record.rotated(receiver.azimuth)
            records[receiver.name] = turned
        return records


log = logging.getLogger(__name__)


def greens_functions(
    model: Model,
    duration: float,
    *,
    within: float = 0.0,
    side: str | None = None,
    folder: str | Path | None = None,
    executor: Executor | None = None,
) -> GreensFunctions:
    """Compute the Green's functions of a linear model, for the superposition of blasts.

    Parameters
    ----------
    model : Model
        Its sources define the places; charges, times and histories are used only to check that no
        contact slips.
    duration : float, s
    within : float, m
        Holes within this distance d share a response; its phase is off by 2 pi f d/cs, which is
        about the largest relative error of the motion.
    side : str, optional
        "source": one run per place; "receiver": three per receiver, or one where it has a normal,
        by reciprocity. None: the side with fewer runs.
    folder : path, optional
        Cache folder.
    executor : Executor, optional
        As for `run_all`.

    Returns
    -------
    GreensFunctions

    Raises
    ------
    InputError
        If superposition does not apply: plastic ground, closing joints, other sources than holes,
        or contacts that slip or open in a run of the blast of the model. A stronger blast may
        still slip.

    Notes
    -----
    The moment is a step within one time step, which contains all frequencies of a run, so there is
    no division by a spectrum; theory.md (9.1) to (9.3).
    """
    refuse_what_does_not_superpose(model)
    if side not in (None, "source", "receiver"):
        raise InputError(f'side: must be "source" or "receiver", got {side!r}')
    units = tuple(unit_source(source) for source in _places(model.sources, within))
    unloaded = replace(model, sources=units, insitu=None, injected=False)
    parts = _parts(unloaded)
    chosen, summary = _choose(side, units, len(parts), model.receivers)
    checked = _check_no_slip(model, duration, folder)
    summary = f"{summary}; {checked}" if checked else summary
    log.info("stored responses: %s", summary)
    forces = receiver_forces(model.receivers)
    numbers = list(range(len(parts) if chosen == "source" else len(forces)))
    results = _collect(unloaded, duration, chosen, numbers, folder, executor)
    response = np.stack([arrays["response"] for arrays in results])
    if chosen == "receiver":
        response = in_components(model.receivers, forces, response)
    dt = float(results[0]["dt"])
    return GreensFunctions(
        units, parts, model.receivers, np.ascontiguousarray(response), dt, within, chosen,
        len(numbers), summary,
    )  # fmt: skip


def _parts(model):
    """Return source number and width of the parts of all sources of a model, see `unit_loads`."""
    return tuple(
        (number, width)
        for number, source in enumerate(model.sources)
        for width, _ in unit_loads(model, source, 2, 1.0)
    )


def _places(sources, within):
    """Return one source for each place and kind; sources within reach of another are left out."""
    chosen, by_kind = [], {}
    for source in sources:
        alike, position = by_kind.setdefault(likeness(source), []), position_of(source)
        away = np.array([position_of(other) - position for other in alike]).reshape(-1, 3)
        if not (np.linalg.norm(away, axis=1) <= within + NEAR).any():
            alike.append(source)
            chosen.append(source)
    return chosen


def _choose(side, units, n_source, receivers):
    """Return the side with fewer runs, or the requested one, and a sentence about it."""
    n_receiver = len(receiver_forces(receivers))
    columns = any(isinstance(unit, Column) for unit in units)
    if columns and side == "receiver":
        raise InputError(
            "side: columns are stored from their own side, points of theirs fire one after "
            'another; take "source"'
        )
    fewer = "source" if columns or n_source <= n_receiver else "receiver"
    chosen = side or fewer
    reason = "wanted" if side else "columns need it" if columns else "fewer"
    return chosen, (
        f"{chosen} side ({reason}): {n_source} runs for {len(units)} places, or {n_receiver} for "
        f"{len(receivers)} receivers"
    )


def _check_no_slip(model, duration, folder):
    """Run the blast of a model with frictional joints; raise InputError if a contact slips."""
    if not any(JOINT_LAWS[joint.law].sticks for joint in model.joints):
        return ""
    key = input_hash("no slip", model, duration) if folder is not None else ""
    cache = Cache(folder) if folder is not None else None
    if cache is None or cache.get(key) is None:
        run = simulate(model, duration)
        refuse_slip(model, run.prepared, run.state)
        if cache is not None:
            cache.put(key, {"slipped": np.zeros(1, dtype=np.int32)})
    return "no contact slips or opens in the run of the whole blast"


def _collect(model, duration, side, numbers, folder, executor):
    """Return the arrays of every run, from the cache where possible."""
    results: dict[int, Any] = {}
    if folder is not None:
        cache = Cache(folder)
        results = {n: cache.get(_key(model, duration, side, n)) for n in numbers}
    missing = [n for n in numbers if results.get(n) is None]
    batch = 1 if model.nodes.quadratic else BATCH_SIZE  # does not speed up higher orders
    groups = [missing[n : n + batch] for n in range(0, len(missing), batch)]
    if executor is None:
        computed = [_run_group(model, duration, side, group, folder) for group in groups]
    else:
        shared = shared_folder(folder)
        tasks = [executor.submit(_run_group, model, duration, side, g, shared) for g in groups]
        try:
            computed = [task.result() for task in tasks]
        except BrokenProcessPool:
            raise lost_process(executor) from None
    for group, arrays in zip(groups, computed, strict=True):
        results |= dict(zip(group, arrays, strict=True))
    return [results[n] for n in numbers]


def _key(model, duration, side, number):
    """Return the content hash of the input of one run."""
    if side == "source":
        part = _parts(model)[number]
        alone = replace(model, sources=[model.sources[part[0]]])
        return input_hash(side, alone, part[1], duration)
    receiver, direction = receiver_forces(model.receivers)[number]
    at = np.asarray(model.receivers[receiver].position, dtype=float)
    return input_hash(side, replace(model, receivers=()), at, direction, duration)


def _run_group(model, duration, side, numbers, folder):
    """Compute one batch of responses; store each in the cache."""
    prepared = prepare(model, duration)
    respond = _from_sources if side == "source" else _from_receivers
    dt = np.array(prepared.constants["dt"])
    results = [{"response": each, "dt": dt} for each in respond(model, prepared, numbers)]
    if folder is not None:
        for number, arrays in zip(numbers, results, strict=True):
            Cache(folder).put(_key(model, duration, side, number), arrays)
    return results


def _from_sources(model, prepared, numbers):
    """Return the motion (n_receivers, 3, n_steps) for a unit step of each part of a source."""
    motion = np.concatenate(
        list(_unit_step_runs(prepared, [_part_loads(model, prepared)[n] for n in numbers], []))
    )
    return [np.ascontiguousarray(response) for response in motion.transpose(3, 1, 2, 0)]


def _from_receivers(model, prepared, numbers):
    """Return the responses (n_parts, n_steps) of receiver components, by reciprocity.

    Motion of the loaded nodes for a force at the receiver, times the loads; theory.md (9.3).
    """
    each = _part_loads(model, prepared)
    nodes = np.unique(np.concatenate([load["load_node"] for load in each]))
    table = np.zeros((len(each), len(nodes), 3))
    for row, load in zip(table, each, strict=True):
        np.add.at(row, np.searchsorted(nodes, load["load_node"]), load["load_vector"])
    step = _unit_step(prepared.n_steps + 1)
    forces = [receiver_loads(model, n, step) for n in numbers]
    weights, pieces = scipy.sparse.csr_array(table.reshape(len(each), -1)), []
    for motion in _unit_step_runs(prepared, forces, nodes):
        loaded = np.moveaxis(motion[:, len(model.receivers) :], 0, -1)  # (nodes, 3, loads, steps)
        along = weights @ loaded.reshape(weights.shape[1], -1)
        pieces.append(along.reshape(len(each), len(numbers), -1))
    return list(np.ascontiguousarray(np.concatenate(pieces, axis=2).swapaxes(0, 1)))


def receiver_forces(receivers: Sequence[Receiver]) -> list[tuple[int, np.ndarray]]:
    """Return receiver number and direction (3,) of the forces that stand for its components.

    Three along the axes, or one along the normal of a receiver of one component.
    """
    return [
        (number, np.array(direction))
        for number, receiver in enumerate(receivers)
        for direction in (np.eye(3) if receiver.normal is None else [receiver.normal])
    ]


def in_components(
    receivers: Sequence[Receiver], forces: Sequence[tuple[int, np.ndarray]], response: np.ndarray
) -> np.ndarray:
    """Return responses (n_forces, n_parts, n) by receiver along east, north, vertical.

    Parameters
    ----------
    receivers : sequence of n_receivers Receiver
    forces : sequence of n_forces (int, (3,) float64)
        Of `receiver_forces`.
    response : (n_forces, n_parts, n) float64 or complex64

    Returns
    -------
    (n_parts, n_receivers, 3, n)
        Of the type of the responses.
    """
    motion = np.zeros((response.shape[1], len(receivers), 3, response.shape[2]), response.dtype)
    for (receiver, direction), along in zip(forces, response, strict=True):
        motion[:, receiver] += direction[:, None] * along[:, None]
    return motion


def receiver_loads(model: Model, number: int, history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the loads of a force at a receiver along one of its axes: its own weights.

    Parameters
    ----------
    model : Model
    number : int
        Among `receiver_forces` of its receivers.
    history : (n_steps, 1) float64, N
    """
    receiver, direction = receiver_forces(model.receivers)[number]
    zone, local = locate_in_zones(model.mesh, model.receivers[receiver].position)
    nodes = model.nodes.zone_nodes[zone[0]]
    return {
        "load_node": nodes,
        "load_vector": np.outer(model.nodes.shapes(local)[0], direction),
        "load_history": np.zeros(len(nodes), dtype=np.int32),
        "load_delay": np.zeros(len(nodes)),
        "load_member": np.full(len(nodes), -1, dtype=np.int32),
        "history": history,
    }


def _part_loads(model, prepared):
    """Return the loads of the parts of all sources, of unit steps for one step more than a run."""
    n_steps, dt = prepared.n_steps + 1, prepared.constants["dt"]
    return [
        loads for source in model.sources for _, loads in unit_loads(model, source, n_steps, dt)
    ]


def _unit_step_runs(prepared, loads, nodes):
    """Run unit steps from the second step, for one step more than a run."""
    return run_loads(prepared, loads, prepared.n_steps + 1, np.array(nodes, dtype=int))
