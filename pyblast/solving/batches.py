"""Many models at once: those over one mesh march side by side, far quicker than in turn."""

import time
from collections.abc import Callable

import numpy as np

from ..errors import InputError, SolverError
from . import assembly, kernels
from .edges import EDGE_ARRAYS, without_edges
from .preparation import LEDGER_EVERY, Chunks, prepare
from .solver import Run, collect, failure, run

LOADS = ("load_node", "load_vector", "load_history", "load_delay", "load_lane")


def run_many(
    models, duration: float, *, step=None, progress: Callable | None = None
) -> list[Run]:
    """March many models; those that share mesh, ground and boundaries go side by side.

    Stiffness, strength and laws of joints, damping, strength of ground, sources, input and in-situ
    stress may differ within a batch. A batch takes the shortest time step of its models.

    Parameters
    ----------
    models : sequence of Model
        Those that shall share a batch come from one by ``dataclasses.replace`` or ``with_joint``.
    duration : float, s
    step : tuple of float and CriticalStep, optional
        What `assembly.time_step` gives for the model that needs the shortest time step: all models
        then march in it, with its masses, whichever batch they are in.
    progress : callable, optional
        Called with ("models", done, total) after each batch.

    Returns
    -------
    list of Run
        In the order of the models; ``wall_seconds`` of a batch is shared out evenly.

    Raises
    ------
    InputError
        If models over one mesh differ in more than what may differ.
    SolverError
        If the motion of one of them is not finite.
    """
    models, runs = list(models), {}
    for group in _over_one_mesh(models):
        for first in range(0, len(group), kernels.LANES):
            members = group[first : first + kernels.LANES]
            some = [models[k] for k in members]
            if len(some) > 1:
                found = _side_by_side(some, duration, step)
            else:
                found = [run(*some, duration, prepared=prepare(*some, duration, step=step))]
            runs.update(zip(members, found, strict=True))
            if progress is not None:
                progress("models", len(runs), len(models))
    return [runs[k] for k in range(len(models))]


def _over_one_mesh(models):
    """Return the numbers of the models that stand on the same mesh, mesh by mesh.

    Those in numbers of four bytes march alone.
    """
    groups = {}
    for number, model in enumerate(models):
        groups.setdefault((id(model.mesh), model.single and number), []).append(number)
    return groups.values()


def _side_by_side(models, duration, step):
    """March up to `kernels.LANES` models together."""
    began = time.perf_counter()
    steps = [step or assembly.time_step(model) for model in models]
    shortest = min(dt for dt, _ in steps)
    prepared = [
        prepare(model, duration, step=(shortest, limit))
        for model, (_, limit) in zip(models, steps, strict=True)
    ]
    constants, state = stacked([one.constants for one in prepared], [p.state for p in prepared])
    motion, energy = _march(models, prepared, constants, state)
    wall = (time.perf_counter() - began) / len(models)
    runs = []
    for lane, (model, one) in enumerate(zip(models, prepared, strict=True)):
        last = {name: np.take(state[name], lane, kernels.LANE_AXIS[name]) for name in one.state}
        own = (np.ascontiguousarray(part[..., lane]) for part in (motion, energy))
        runs.append(collect(model, one, *own, last, wall, {}))
    return runs


def stacked(constants, states):
    """Put the arrays of models side by side, lane by lane; lanes left over repeat the first."""
    rates = sorted({rate for one in constants for rate in one["memory_rate"]})
    constants = _alike_in_edges([_at_rates(one, rates) for one in constants])
    fill = kernels.LANES - len(constants)
    loads, histories = _merged_loads(constants, fill)
    shifted = [
        {**one, "fixed_history": np.where(one["fixed_history"] < 0, -1, one["fixed_history"] + k)}
        for one, k in zip(constants, histories, strict=True)
    ]
    memory = np.zeros((len(states[0]["displacement"]), len(rates), 3))
    states = [{**one, "memory": memory} for one in states]
    together = {}
    for name in constants[0]:
        if name in loads:
            together[name] = loads[name]
        elif name in kernels.LANE_AXIS:
            together[name] = _lanes(name, [one[name] for one in shifted], fill)
        else:
            together[name] = _common(name, [one[name] for one in constants])
    return together, {name: _lanes(name, [one[name] for one in states], fill) for name in states[0]}


def _alike_in_edges(constants):
    """Return the constants of models, by zones alone where their edges are not the same."""
    same = all(
        np.array_equal(constants[0][name], one[name]) for one in constants for name in EDGE_ARRAYS
    )
    return constants if same else [without_edges(one) for one in constants]


def _at_rates(constants, rates):
    """Return the constants of a model with its branches at the rates of the whole batch."""
    own = constants["set_branch"]
    table = np.zeros((len(own), len(rates), 2))
    table[:, np.searchsorted(rates, constants["memory_rate"])] = own
    return {**constants, "set_branch": table, "memory_rate": np.array(rates)}


def _merged_loads(constants, fill):
    """Return the loads of all models with their lanes, and where each one's histories begin.

    Lanes that are left over have the loads of the first too: at rest under loads that balance
    them, they would move without.
    """
    counts = [one["history"].shape[1] for one in constants]
    begins = np.concatenate([[0], np.cumsum(counts)])[:-1].astype(np.int32)
    parts = [
        {
            **one,
            "load_history": one["load_history"] + begin,
            "load_lane": np.full_like(one["load_lane"], lane),
        }
        for lane, (one, begin) in enumerate(
            [*zip(constants, begins, strict=True), *[(constants[0], begins[0])] * fill]
        )
    ]
    loads = {name: np.concatenate([part[name] for part in parts]) for name in LOADS}
    return {**loads, "history": np.hstack([one["history"] for one in constants])}, begins


def _lanes(name, values, fill):
    """Stack arrays along the axis of the lanes; the first fills those that are left over."""
    every = values + [values[0]] * fill
    return np.ascontiguousarray(np.stack(every, axis=kernels.LANE_AXIS[name]))


def _common(name, values):
    """Return what all models share.

    Raises
    ------
    InputError
        If they do not.
    """
    if not all(np.array_equal(values[0], other) for other in values[1:]):
        raise InputError(
            f"run_many: models over one mesh differ in '{name}'; only joints, damping, strengths, "
            "sources, input and in-situ stress may differ; run the others by themselves"
        )
    return values[0]


def _march(models, prepared, constants, state):
    """March all lanes to the end in chunks; return motion and energy with their lanes last."""
    total, step, chunks = prepared[0].n_steps, 0, Chunks(1)
    views, motions, energies = kernels.side_by_side(constants), [], []
    while step < total:
        n_steps = min(chunks.end(step), total) - step
        with chunks.timed(n_steps):
            motion, energy, failed = kernels.advance_all(views, state, step, n_steps, LEDGER_EVERY)
        step += len(motion)
        motions.append(motion)
        energies.append(energy)
        if failed is not None:
            node, lane = failed
            lane = lane if lane < len(models) else 0  # lanes left over repeat the first
            text = failure(models[lane], prepared[lane], step, node)
            raise SolverError(f"model {lane + 1} of the batch: {text}")
    return np.concatenate(motions), np.moveaxis(np.concatenate(energies), 1, -1)
