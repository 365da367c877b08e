"""Computation of Green's functions by runs of unit sources, or of receivers by reciprocity."""

import logging
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

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
    PointSource,
    likeness,
    loads,
    place,
    refuse_what_does_not_superpose,
    unit_source,
)


def run_loads(
    prepared: Prepared, loads: Sequence[dict[str, np.ndarray]], n_steps: int, nodes: np.ndarray
) -> Iterator[np.ndarray]:
    """Run a linear model from rest under each of several loads, in one batch.

    The sources of the model are left out; a single load is not run as a batch.

    Parameters
    ----------
    prepared : Prepared
    loads : sequence of dict
        Load arrays of up to `core.LANES` runs, each with one history.
    n_steps : int
    nodes : (n_nodes,) int
        Recorded in addition to the receivers of the model.

    Yields
    ------
    (n, n_receivers + n_nodes, 3, n_loads) float64, m/s
        Motion at mid-steps, stretch by stretch.

    Raises
    ------
    SolverError
        If a run is unstable.
    """
    constants, state = at_rest(prepared.constants)
    constants = {**constants, **node_receivers(constants, nodes), **_merged_loads(loads)}
    if len(loads) == 1:
        views, advance = core.to_fortran(prepared.as_marched(constants)), core.advance
        state = prepared.as_marched(state)
    else:
        views, state = core.side_by_side(_repeated(constants)), _repeated(state)
        advance = core.advance_all
    for first, count in stretches(n_steps, 3 * core.LANES * len(constants["receiver_node"])):
        motion, _, failed = advance(views, state, first, count, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"run: unstable at step {first + len(motion)}")
        yield motion.reshape(*motion.shape[:3], -1)[..., : len(loads)]


def _merged_loads(loads):
    """Return the loads of all lanes as one table."""
    merged = {
        name: np.concatenate([one[name] for one in loads])
        for name in ("load_node", "load_vector", "load_delay")
    }
    lane = np.repeat(
        np.arange(len(loads), dtype=np.int32), [len(one["load_node"]) for one in loads]
    )
    history = np.hstack([one["history"] for one in loads])
    return {**merged, "load_history": lane, "load_lane": lane, "history": history}


def _repeated(arrays):
    """Return arrays repeated for each lane, where lanes have their own."""
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
    """Compute the Green's functions of a linear model, for the superposition of blasts.

    Parameters
    ----------
    model : Model
        Its sources define the places; charges, times and histories are used only to check that no
        contact slips.
    duration : float, s
    within : float, m
        Holes within this distance share a response; see `cluster_error`.
    side : str, optional
        "source": one run per place; "receiver": three per receiver, by reciprocity. None: the side
        with fewer runs.
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
    chosen, summary = _choose(side, units, model.receivers)
    checked = _check_no_slip(model, duration, folder)
    summary = f"{summary}; {checked}" if checked else summary
    log.info("stored responses: %s", summary)
    numbers = list(range(len(units) if chosen == "source" else 3 * len(model.receivers)))
    unloaded = replace(model, sources=units, insitu=None)
    results = _collect(unloaded, duration, chosen, numbers, folder, executor)
    response = np.stack([arrays["response"] for arrays in results])
    if chosen == "receiver":
        response = response.reshape(len(model.receivers), 3, len(units), -1).transpose(2, 0, 1, 3)
    dt = float(results[0]["dt"])
    return GreensFunctions(
        units, model.receivers, np.ascontiguousarray(response), dt, within, chosen, len(numbers),
        summary,
    )  # fmt: skip


def cluster_error(model: Model, within: float, highest: float) -> float:
    """Return the phase error of a source moved by ``within`` m: 2 pi f d/cs, in rad.

    At the highest frequency in Hz and the smallest cs at a source; about the largest relative error
    of the motion.
    """
    zones, _ = locate(model.mesh, [place(source) for source in _point_sources(model)])
    slowest = np.broadcast_to(model.zone_values("cs"), len(model.mesh.zones))[zones].min()
    return float(2.0 * np.pi * highest * within / slowest)


def _point_sources(model) -> list[PointSource]:
    """Return the sources that have a place."""
    return [source for source in model.sources if isinstance(source, PointSource)]


def _places(sources, within):
    """Return one source for each place and kind; sources within reach of another are left out."""
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
    """Return the side with fewer runs, or the requested one, and a sentence about it."""
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


def _check_no_slip(model, duration, folder):
    """Run the blast of a model with frictional joints; raise InputError if a contact slips."""
    if not any(joint.law in STICKING_JOINTS for joint in model.joints):
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
    batch = 1 if model.nodes.quadratic else LANES  # batches do not speed up zones of higher order
    groups = [missing[n : n + batch] for n in range(0, len(missing), batch)]
    if executor is None:
        computed = [_run_group(model, duration, side, group, folder) for group in groups]
    else:
        tasks = [executor.submit(_run_group, model, duration, side, g, folder) for g in groups]
        computed = [task.result() for task in tasks]
    for group, arrays in zip(groups, computed, strict=True):
        results |= dict(zip(group, arrays, strict=True))
    return [results[n] for n in numbers]


def _key(model, duration, side, number):
    """Return the content hash of the input of one run."""
    if side == "source":
        return input_hash(side, replace(model, sources=[model.sources[number]]), duration)
    receiver = model.receivers[number // 3]
    at = np.asarray(receiver.position, dtype=float)
    return input_hash(side, replace(model, receivers=()), at, number % 3, duration)


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
    """Return the motion (n_receivers, 3, n_steps) for a unit step of each source."""
    motion = np.concatenate(
        list(_unit_step_runs(model, prepared, [model.sources[n] for n in numbers], []))
    )
    return [np.ascontiguousarray(one) for one in motion[1:].transpose(3, 1, 2, 0)]


def _from_receivers(model, prepared, numbers):
    """Return the responses (n_sources, n_steps) of receiver components, by reciprocity.

    Motion of the loaded nodes for a force at the receiver, times the loads; theory.md (9.3).
    """
    each = [loads(model, source, 2, prepared.constants["dt"]) for source in model.sources]
    nodes = np.unique(np.concatenate([one["load_node"] for one in each]))
    table = np.zeros((len(each), len(nodes), 3))
    for row, one in zip(table, each, strict=True):
        np.add.at(row, np.searchsorted(nodes, one["load_node"]), one["load_vector"])
    forces = [PointForce(model.receivers[n // 3].position, np.eye(3)[n % 3], NONE) for n in numbers]
    pieces = [
        np.tensordot(motion[:, len(model.receivers) :], table, axes=([1, 2], [1, 2]))
        for motion in _unit_step_runs(model, prepared, forces, nodes)
    ]
    return [np.ascontiguousarray(one) for one in np.concatenate(pieces)[1:].transpose(1, 2, 0)]


def _unit_step_runs(model, prepared, sources, nodes):
    """Run unit steps of sources from the second step, for one step more than a run."""
    n_steps = prepared.n_steps + 1
    each = [loads(model, source, n_steps, prepared.constants["dt"]) for source in sources]
    return run_loads(prepared, each, n_steps, np.array(nodes, dtype=int))
