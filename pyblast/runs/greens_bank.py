"""Runs of unit sources or unit receivers behind stored Green's functions."""

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import core
from ..core import LANES
from ..errors import InputError, SolverError
from ..mesh.mesh import locate
from ..model.model import Model
from ..model.source import Column, PointForce
from ..solver.linear_runs import STICKING_JOINTS, at_rest, node_receivers, refuse_slip, stretches
from ..solver.preparation import LEDGER_EVERY, Prepared, prepare
from ..solver.run import simulate
from .cache import Cache, input_hash
from .greens import (
    NEAR,
    NONE,
    GreensFunctions,
    likeness,
    loads,
    place,
    refuse_what_does_not_superpose,
    unit_source,
)


def march_side_by_side(
    prepared: Prepared, loads: Sequence[dict[str, np.ndarray]], n_steps: int, nodes: np.ndarray
) -> Iterator[np.ndarray]:
    """March a linear model from rest, all that drives it left out, under each of some loads.

    A single load goes without lanes.

    Parameters
    ----------
    prepared : Prepared
    loads : sequence of dict
        Load arrays of up to `kernels.LANES` lanes, each with one history.
    n_steps : int
    nodes : (n_nodes,) int
        That are listened to beside the receivers of the model.

    Yields
    ------
    (n, n_receivers + n_nodes, 3, n_loads) float64, m/s
        Motion at mid-steps, stretch by stretch.

    Raises
    ------
    SolverError
        If the motion grows without cause.
    """
    constants, state = at_rest(prepared.constants)
    constants = {**constants, **node_receivers(constants, nodes), **_in_lanes(loads)}
    if len(loads) == 1:
        views, advance = core.to_fortran(prepared.as_marched(constants)), core.advance
        state = prepared.as_marched(state)
    else:
        views, state = core.side_by_side(_repeated(constants)), _repeated(state)
        advance = core.advance_all
    for first, count in stretches(n_steps, 3 * core.LANES * len(constants["receiver_node"])):
        motion, _, failed = advance(views, state, first, count, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"march: the motion grew without limit at step {first + len(motion)}")
        yield motion.reshape(*motion.shape[:3], -1)[..., : len(loads)]


def _in_lanes(loads):
    """Return the loads of all lanes as one list."""
    together = {
        name: np.concatenate([one[name] for one in loads])
        for name in ("load_node", "load_vector", "load_delay")
    }
    lane = np.repeat(
        np.arange(len(loads), dtype=np.int32), [len(one["load_node"]) for one in loads]
    )
    history = np.hstack([one["history"] for one in loads])
    return {**together, "load_history": lane, "load_lane": lane, "history": history}


def _repeated(arrays):
    """Return arrays that each lane has for itself once for each lane."""
    return {
        name: np.stack([value] * core.LANES, axis=core.LANE_AXIS[name])
        if name in core.LANE_AXIS
        else value
        for name, value in arrays.items()
    }


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
    """Run what is needed to superpose the blasts of a linear model.

    Parameters
    ----------
    model : Model
        Its sources tell the places; charges, times and histories count only for the proof below.
    duration : float, s
    within : float, m
        Holes this near to another share its run; `cluster_error` says at which price.
    side : str, optional
        "source": a run for each place. "receiver": three for each receiver, by reciprocity. None
        takes what needs fewer.
    folder : path, optional
        Where responses are kept and found.
    executor : Executor, optional
        As for `run_all`.

    Returns
    -------
    GreensFunctions

    Raises
    ------
    InputError
        If the model does not superpose: it yields, closes, is driven by more than its holes, or
        has joints with friction of which a contact slips or opens in a run of its own blast. That
        run proves it for this blast only; a stronger one may still slip.

    Notes
    -----
    The step of moment comes in a single time step: it holds all frequencies that a run can hold,
    so that no time function lies outside and nothing is divided by a spectrum; theory.md (9.1) to
    (9.3).
    """
    refuse_what_does_not_superpose(model)
    if side not in (None, "source", "receiver"):
        raise InputError(f'side: must be "source" or "receiver", got {side!r}')
    units = tuple(unit_source(source) for source in _places(model.sources, within))
    chosen, said = _choose(side, units, model.receivers)
    proved = _prove_no_slip(model, duration, folder)
    said = f"{said}; {proved}" if proved else said
    log.info("stored responses: %s", said)
    numbers = list(range(len(units) if chosen == "source" else 3 * len(model.receivers)))
    still = replace(model, sources=units, insitu=None)
    found = _collect(still, duration, chosen, numbers, folder, executor)
    response = np.stack([arrays["response"] for arrays in found])
    if chosen == "receiver":
        response = response.reshape(len(model.receivers), 3, len(units), -1).transpose(2, 0, 1, 3)
    dt = float(found[0]["dt"])
    return GreensFunctions(
        units, model.receivers, np.ascontiguousarray(response), dt, within, chosen, len(numbers),
        said,
    )  # fmt: skip


def cluster_error(model: Model, within: float, highest: float) -> float:
    """Return how far a source moved by ``within`` m may turn phases: 2 pi f d/cs, in rad.

    At the highest frequency in Hz and with the slowest ground that holds a source; about the
    largest relative error of the motion, where both waves arrive along the way it was moved.
    """
    zones, _ = locate(model.mesh, [place(source) for source in model.sources])
    slowest = np.broadcast_to(model.zone_values("cs"), len(model.mesh.zones))[zones].min()
    return float(2.0 * np.pi * highest * within / slowest)


def _places(sources, within):
    """Return one source for each place and shape; those within reach of one kept are left out."""
    kept = []
    for source in sources:
        reached = [
            likeness(one) == likeness(source)
            and np.linalg.norm(place(one) - place(source)) <= within + NEAR
            for one in kept
        ]
        if not any(reached):
            kept.append(source)
    return kept


def _choose(side, units, receivers):
    """Return the side with fewer runs, or the one wanted, and a sentence about it."""
    n_source, n_receiver = len(units), 3 * len(receivers)
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
        f"{chosen} side ({reason}): {n_source} runs for {n_source} places, or {n_receiver} for "
        f"{len(receivers)} receivers"
    )


def _prove_no_slip(model, duration, folder):
    """Run the blast of a model with joints that may slip; say that none did."""
    if not any(joint.law in STICKING_JOINTS for joint in model.joints):
        return ""
    key = input_hash("no slip", model, duration) if folder is not None else ""
    cache = Cache(folder) if folder is not None else None
    if cache is None or cache.get(key) is None:
        made = simulate(model, duration)
        refuse_slip(model, made.prepared, made.state)
        if cache is not None:
            cache.put(key, {"slipped": np.zeros(1, dtype=np.int32)})
    return "no contact slips or opens in the run of the whole blast"


def _collect(model, duration, side, numbers, folder, executor):
    """Return the arrays of every run, those that are kept from the folder."""
    found = {}
    if folder is not None:
        cache = Cache(folder)
        found = {n: cache.get(_key(model, duration, side, n)) for n in numbers}
    missing = [n for n in numbers if found.get(n) is None]
    abreast = 1 if model.quadratic else LANES  # lanes gain nothing there: docs/performance.md
    groups = [missing[n : n + abreast] for n in range(0, len(missing), abreast)]
    if executor is None:
        made = [_march_group(model, duration, side, group, folder) for group in groups]
    else:
        tasks = [executor.submit(_march_group, model, duration, side, g, folder) for g in groups]
        made = [task.result() for task in tasks]
    for group, arrays in zip(groups, made, strict=True):
        found |= dict(zip(group, arrays, strict=True))
    return [found[n] for n in numbers]


def _key(model, duration, side, number):
    """Return the hash of all that one run depends on."""
    if side == "source":
        return input_hash(side, replace(model, sources=[model.sources[number]]), duration)
    receiver = model.receivers[number // 3]
    at = np.asarray(receiver.position, dtype=float)
    return input_hash(side, replace(model, receivers=()), at, number % 3, duration)


def _march_group(model, duration, side, numbers, folder):
    """March some runs of a bank side by side; keep each."""
    prepared = prepare(model, duration)
    march = _from_sources if side == "source" else _from_receivers
    dt = np.array(prepared.constants["dt"])
    made = [{"response": one, "dt": dt} for one in march(model, prepared, numbers)]
    if folder is not None:
        for number, arrays in zip(numbers, made, strict=True):
            Cache(folder).put(_key(model, duration, side, number), arrays)
    return made


def _from_sources(model, prepared, numbers):
    """Return the motion (n_receivers, 3, n_steps) after a unit step of each source."""
    motion = np.concatenate(list(_march(model, prepared, [model.sources[n] for n in numbers], [])))
    return [np.ascontiguousarray(one) for one in motion[1:].transpose(3, 1, 2, 0)]


def _from_receivers(model, prepared, numbers):
    """Return what a unit step of each source does to some components, (n_sources, n_steps) each.

    The motion of the nodes that a source loads, by a force at the receiver, times those loads;
    theory.md (9.3).
    """
    each = [loads(model, source, 2, prepared.constants["dt"]) for source in model.sources]
    nodes = np.unique(np.concatenate([one["load_node"] for one in each]))
    table = np.zeros((len(each), len(nodes), 3))
    for row, one in zip(table, each, strict=True):
        np.add.at(row, np.searchsorted(nodes, one["load_node"]), one["load_vector"])
    forces = [PointForce(model.receivers[n // 3].position, np.eye(3)[n % 3], NONE) for n in numbers]
    pieces = [
        np.tensordot(motion[:, len(model.receivers) :], table, axes=([1, 2], [1, 2]))
        for motion in _march(model, prepared, forces, nodes)
    ]
    return [np.ascontiguousarray(one) for one in np.concatenate(pieces)[1:].transpose(1, 2, 0)]


def _march(model, prepared, sources, nodes):
    """March one step more than a run under unit steps of sources, which come with the second."""
    n_steps = prepared.n_steps + 1
    each = [loads(model, source, n_steps, prepared.constants["dt"]) for source in sources]
    return march_side_by_side(prepared, each, n_steps, np.array(nodes, dtype=int))
