"""Forward simulation of a case: motion at and around its receivers, and what it supports."""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ..core import JOINT_LAWS, ZONE_LAWS
from ..errors import InputError
from ..inference.location import Places
from ..mesh.mesh import locate_in_zones
from ..model.model import Receiver
from ..model.source import Column
from ..project.places import on_ground, refuse_outside
from ..project.project import Project
from ..runs.bank import bank_of
from ..runs.greens import PointSource
from ..runs.secondary_sources import by_hole, by_joint, by_rock
from ..simulation.estimate import cost_of
from ..simulation.simulation import Simulation
from .case import Case
from .trusted_shots import time_shifted, with_source


def simulation_of(
    case: Case, folder=None, executor: Executor | None = None, *, finer: bool = False
) -> Simulation:
    """Return the simulation of the blasts of a case at the instants of its records.

    Parameters
    ----------
    case : Case
    folder, executor, finer
        As of `Simulation`.
    """
    lead = max(case.project.of(blast).lead for blast in case.blasts)
    return Simulation(
        case.blasts, case.receivers, case.dt, case.n_samples, case.duration + lead, folder,
        executor, finer, received=partial(with_source, case),
    )  # fmt: skip


def hole_motion(simulation: Simulation, case: Case, project: Project) -> dict[str, np.ndarray]:
    """Simulate each hole of a project with its planned charge, fired at zero, by blast.

    By one run for each hole, or three for each receiver (reciprocity) if these are fewer; by
    one for each blast whose motion enters through a face. Empty where holes do not superpose,
    see `not_superposed`.

    Returns
    -------
    dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
    """
    if not_superposed(case):
        return {}
    if project.config.signature is not None:
        return {name: _through_face(simulation, project, name) for name in case.blasts}
    fired = simulation.by_source([simulation.of(project, name) for name in case.blasts])
    motion = {}
    for name, each in zip(case.blasts, fired, strict=True):
        charge = project.blasts[name].charge
        motion[name] = np.zeros((len(charge), *each.shape[1:]))
        motion[name][charge > 0.0] = each
    return motion


def _through_face(simulation, project, name):
    """Return the motion of each hole of a blast that enters through a face, by one run."""
    fired = simulation.of(project, name)
    if fired.config.input.decay_exponent is not None:
        raise InputError(
            f"{fired.path.name}: input.decay_exponent: a diagnosis needs the motion of each "
            "hole, which is alike on the whole face or comes from holes_inside; leave it out"
        )
    single = replace(fired, survey=replace(fired.survey, shots=(replace(fired.shot, alone=True),)))
    run = simulation.run([simulation.model(single)])[0]
    motion = simulation.sampled(run.seismograms, single.lead)
    return np.multiply.outer(fired.firing.scales, motion)


def holds(simulation: Simulation, reference: Project, project: Project) -> bool:
    """Tell whether the ground of a project can be meshed and holds all its holes."""
    changed = project.geometry != reference.geometry
    moved = project.config.holes_inside is not None and any(
        not np.array_equal(project.blasts[name].centres, reference.blasts[name].centres)
        for name in simulation.shots
    )
    if not (changed or moved):
        return True
    try:
        for name in simulation.shots:
            centres = enumerate(project.blasts[name].centres)
            inside = {} if project.config.holes_inside is None else dict(centres)
            refuse_outside(simulation.of(project, name).mesh, inside)
    except InputError:
        return False
    return True


def not_superposed(case: Case) -> str:
    """Return why the motion of a blast is not the sum over its holes; empty where it is."""
    project = case.project
    for shot in project.shots:
        config = shot.config
        if config.blast is None:
            return "there is no [blast] with holes"
        if config.blast.scatter_ms:
            return "blast.scatter_ms draws firing times: leave it out"
        if config.signature is None and config.holes_inside is None:
            return "what enters is not by hole: give [holes_inside] or [signature]"
        if config.point_forces or config.moment_tensors or config.pressures or config.air_blast:
            return "other sources act beside the holes: leave them out"
        if config.signature is not None and config.blast.wave_speed_m_per_s is not None:
            return "blast.wave_speed_m_per_s shifts what enters by hole: leave it out"
        if config.run.local_damping:
            return "under run.local_damping holes do not superpose: leave it out"
    for joint in project.joints:
        if not JOINT_LAWS[joint.law].linear:
            return (
                f"holes do not superpose across the law {joint.law!r} of joint {joint.surface}: "
                "give the joints the law 'elastic'"
            )
    for name in project.ground_materials:
        if not ZONE_LAWS[project.materials[name].law.name].linear:
            return f"holes do not superpose in material {name!r}, which yields: make it elastic"
    return ""


STEPS = 3  # on either side of a receiver
STEPS_PER_WAVE = 6.0  # of the shortest S wave at the surface


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Surroundings: motion at a square grid of probe receivers around each receiver.

    Parameters
    ----------
    offsets : (n,) float64, m
        Of the grid, to the east and to the north.
    motion : (n_blasts, n_receivers, n, n, 3, n_samples) float64, m/s
    """

    offsets: np.ndarray
    motion: np.ndarray

    def change(self, receiver: int, east: float, north: float) -> np.ndarray:
        """Return the change of motion where a receiver is moved, (n_blasts, 3, n_samples) m/s.

        Interpolated by cubic splines; beyond the grid as at its edge.
        """
        cardinal = make_interp_spline(self.offsets, np.eye(len(self.offsets)), 3)
        offset = np.clip((east, north), self.offsets[0], self.offsets[-1])
        centre, moved = (np.multiply.outer(*cardinal(x)) for x in (np.zeros(2), offset))
        return np.tensordot(moved - centre, self.motion[:, receiver], ([0, 1], [1, 2]))

    def slopes(self) -> np.ndarray:
        """Return the slopes of the motion to the east and to the north.

        (2, n_blasts, n_receivers, 3, n_samples) float64, 1/s.
        """
        spline = make_interp_spline(self.offsets, np.eye(len(self.offsets)), 3)
        at, along = spline(0.0), spline(0.0, 1)
        pairs = np.multiply.outer(along, at), np.multiply.outer(at, along)
        return np.array([np.tensordot(pair, self.motion, ([0, 1], [2, 3])) for pair in pairs])


def surroundings(simulation: Simulation, case: Case, project: Project) -> Surroundings:
    """Simulate every blast of a case at probe receivers around all receivers.

    Raises
    ------
    SolverError
        If a run fails.
    """
    offsets, n = probe_offsets(case, project), 2 * STEPS + 1
    receivers = {r.name: r for r in project.receivers}
    probes = tuple(
        replace(receivers[name], name=f"{name} {k}", position=position)
        for name in case.receivers
        for k, position in enumerate(probe_positions(case, receivers[name], offsets))
    )
    own = [simulation.of(project, blast) for blast in case.blasts]
    done = simulation.run([replace(simulation.model(each), receivers=probes) for each in own])
    names = [probe.name for probe in probes]
    motion = np.stack(
        [
            simulation.sampled(run.seismograms, each.lead, names)
            for each, run in zip(own, done, strict=True)
        ]
    )
    return Surroundings(offsets, motion.reshape(len(own), -1, n, n, *motion.shape[2:]))


def fields_not_kept(case: Case) -> str:
    """Return why the fields of shots and receivers of a case cannot be kept; empty if they can."""
    table = case.project.config.diagnosis
    if table is not None and (table.source_s is not None or table.trigger_s is not None):
        return (
            "diagnosis.source_s, diagnosis.trigger_s: what the records tell of their source is "
            "no part of stored fields; give the source to locate what is missing"
        )
    if not case.project.mesh.hexahedral:
        return "the zones are tetrahedra, and fields to locate a change are kept in hexahedra alone"
    return ""


class StoredFields(NamedTuple):
    """What the fields of shots and receivers tell of a ground, see `stored_fields`.

    Parameters
    ----------
    rock, joints : Places
        Cells of the rock and patches of the joints, with their changes.
    holes : dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
        As of `hole_motion`.
    surroundings : Surroundings
    """

    rock: Places
    joints: Places
    holes: dict[str, np.ndarray]
    surroundings: Surroundings


def stored_fields(
    simulation: Simulation, case: Case, project: Project, progress: Callable = lambda *_: None
) -> StoredFields:
    """Return the places of a project where its ground may differ, and the motion of its holes.

    By one run of each blast and one of a force at each receiver along each axis.

    Parameters
    ----------
    simulation : Simulation
    case : Case
    project : Project
        The reference ground, in which changes are taken to first order.
    progress : callable, optional
        Called with (stage, done, total).

    Raises
    ------
    InputError
        If records have shown their own source, or as `bank_of`.
    SolverError
        If a run fails.
    """
    if why := fields_not_kept(case):
        raise InputError(why)
    names = {receiver.name: receiver for receiver in project.receivers}
    receivers = tuple(names[name] for name in case.receivers)
    own = [simulation.of(project, blast) for blast in case.blasts]
    models = [replace(simulation.model(each), receivers=receivers) for each in own]
    offsets = probe_offsets(case, project)
    probes = [np.array(probe_positions(case, receiver, offsets)) for receiver in receivers]
    bank = bank_of(
        models, simulation.duration, case.band.high, np.concatenate(probes),
        executor=simulation.executor, progress=progress,
    )  # fmt: skip
    simulation.runs += bank.runs
    simulation.priced += bank.runs * cost_of(models[0], simulation.duration).seconds
    times = [each.lead + case.dt * np.arange(case.n_samples) for each in own]
    back = [bank.transform.back(each) for each in times]
    rock, joints = by_rock(bank), by_joint(bank, 2.0 * quarter_wave(project, case))
    return StoredFields(
        _places(bank, rock, case, back), _places(bank, joints, case, back),
        _holes_of(bank, models, own, back)
        if not not_superposed(case) and _at_points(models)
        else hole_motion(simulation, case, project),
        _surroundings_of(bank, offsets, probes, back),
    )  # fmt: skip


def _surroundings_of(bank, offsets, probes, back):
    """Return the motion around the receivers, at probes of each, from the fields of shots."""
    around, n = [], len(offsets)
    for places, measured in zip(probes, bank.measured, strict=True):
        own = np.einsum("ic,bpik->bpck", measured, bank.at_places(places))
        motion = [np.real(each @ instants) for each, instants in zip(own, back, strict=True)]
        around.append(np.reshape(motion, (len(back), n, n, 3, -1)))
    return Surroundings(offsets, np.stack(around, axis=1))


def _at_points(models):
    """Tell whether all sources of models are points, the motion of which reciprocity gives.

    What enters through a face is none.
    """
    return all(model.sources for model in models) and all(
        isinstance(source, PointSource) and not isinstance(source, Column)
        for model in models for source in model.sources
    )  # fmt: skip


def _holes_of(bank, models, own, back):
    """Return the motion of each hole, fired at zero, by blast, from the fields of receivers."""
    motion = {}
    for model, each, instants in zip(models, own, back, strict=True):
        at_zero = [replace(source, time=each.lead) for source in model.sources]
        spectra = np.array([by_hole(bank, source) for source in at_zero])
        fired = np.real(bank.by_receiver(spectra) @ instants)
        charge = each.blast.charge
        motion[each.shot.name] = np.zeros((len(charge), *fired.shape[1:]))
        motion[each.shot.name][charge > 0.0] = fired
    return motion


def _places(bank, sources, case, back):
    """Return secondary sources by the functions of the band, with gains and clocks."""
    spectra = bank.by_receiver(sources.spectra)
    shapes = np.empty((*spectra.shape[:-1], case.band.n_functions), np.float32)
    for b, r, c in np.ndindex(shapes.shape[2:5]):
        functions = case.band.functions((b, r, c))
        if case.clock is not None:
            functions = time_shifted(functions.T, -case.clock[r], case.dt).T
        functions = (back[b] @ functions).astype(np.complex64)
        shapes[:, :, b, r, c] = np.real(spectra[:, :, b, r, c] @ functions)
    if case.gain is not None:
        shapes *= case.gain[:, None, None].astype(np.float32)
    return Places(sources.centres, sources.sizes, shapes, sources.names)


def quarter_wave(project: Project, case: Case) -> float:
    """Return a quarter of the shortest S wave in m: what its waves can tell from a point."""
    slowest = min(project.materials[name].cs for name in project.ground_materials)
    return 0.25 * slowest / case.band.high


def probe_offsets(case: Case, project: Project) -> np.ndarray:
    """Return the offsets (n,) in m of probe receivers from a receiver, east and north."""
    slowest = min(project.materials[name].cs for name in project.ground_materials)
    return np.arange(-STEPS, STEPS + 1) * slowest / (STEPS_PER_WAVE * case.band.high)


def probe_positions(case: Case, receiver: Receiver, offsets: np.ndarray) -> list[np.ndarray]:
    """Return the positions (3,) in m of probe receivers, or all at the receiver without space."""
    inside = probe_positions_inside(case, receiver, offsets)
    return [np.asarray(receiver.position, float)] * len(offsets) ** 2 if inside is None else inside


def probe_positions_inside(case: Case, receiver, offsets) -> list[np.ndarray] | None:
    """Return the positions (3,) in m of probe receivers, each as deep as the receiver.

    None where one of them lies outside of the mesh of the project.
    """
    at = np.asarray(receiver.position, dtype=float)
    grid = [(x, y) for x in offsets for y in offsets]
    positions = [np.add(receiver.position, (x, y, 0.0)) for x, y in grid]
    mesh = case.project.mesh
    try:
        if "top" in mesh.surfaces:
            depth = on_ground(mesh, at[:2])[2] - at[2]
            positions = [
                np.subtract(on_ground(mesh, at[:2] + step), (0.0, 0.0, depth)) for step in grid
            ]
        locate_in_zones(mesh, positions)
    except InputError:
        return None
    return positions
