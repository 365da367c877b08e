"""Forward simulation of a case: motion at and around its receivers, and what it supports."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ..core import JOINT_LAWS, ZONE_LAWS
from ..errors import InputError
from ..mesh.mesh import locate_in_zones
from ..model.model import Model, Receiver
from ..project.places import on_ground, placed_again, refuse_outside
from ..project.project import Project
from ..runs.greens import PointSource, greens_functions
from ..runs.parallel import CachedRun, is_single, run_all
from ..signals.seismogram import Seismogram
from ..simulation.recipe import BETTER, with_laws
from .case import Case
from .trusted_shots import with_source


@dataclass(eq=False)
class Forward:
    """Forward simulation of the blasts of a case; counts its runs.

    A project may differ from that of the case in anything, its geometry included (see
    `Project.changed`): each geometry is meshed once, and all blasts share the mesh.

    Parameters
    ----------
    case : Case
    folder : path, optional
        Folder of stored runs.
    executor : Executor, optional
        As for `run_all`.
    fine : bool
        Whether to run on finer meshes than those of the projects.
    runs, cached : int
        Number of runs, and number of those that were in the folder already.
    cached_s : float, s
        Time that the latter took when they were run.
    """

    case: Case
    folder: str | None = None
    executor: Executor | None = None
    fine: bool = False
    runs: int = 0
    cached: int = 0
    cached_s: float = 0.0
    _known: set = field(default_factory=set, repr=False)

    def motion(self, project: Project) -> np.ndarray:
        """Simulate all blasts of a project, (n_blasts, n_receivers, 3, n_samples) in m/s."""
        return self.motions([project])[0]

    def motions(self, projects: Sequence[Project]) -> np.ndarray:
        """Simulate all blasts of n projects, (n, n_blasts, n_receivers, 3, n_samples) in m/s."""
        motion = np.stack(
            self.simulate([(project, blast) for project in projects for blast in self.case.blasts])
        )
        return motion.reshape(len(projects), -1, *motion.shape[1:])

    def simulate(self, pairs: Sequence[tuple[Project, str]]) -> list[np.ndarray]:
        """Simulate pairs of project and blast.

        Returns
        -------
        list of (n_receivers, 3, n_samples) float64, m/s
            At the instants of the records.

        Raises
        ------
        SolverError
            If a run fails.
        """
        models = [self.model(project, blast) for project, blast in pairs]
        return self.simulate_models(models, [blast for _, blast in pairs])

    def simulate_models(self, models: Sequence[Model], blasts: Sequence[str]) -> list[np.ndarray]:
        """Simulate models of blasts, as `simulate` does with its pairs."""
        return [
            with_source(self.case, blast, self._sampled(run.seismograms, self.lead(blast)))
            for run, blast in zip(self.run(models), blasts, strict=True)
        ]

    def run(self, models: Sequence[Model]) -> list[CachedRun]:
        """Run models, or read their stored runs, and count them."""
        duration = self.case.duration + max(map(self.lead, self.case.blasts))
        done = run_all(models, duration, folder=self.folder, executor=self.executor)
        self.runs += len(done)
        for run in done:
            key = run.provenance["input_sha256"], *run.seismograms
            if run.from_cache and key not in self._known:
                self.cached, self.cached_s = self.cached + 1, self.cached_s + run.wall_seconds
            self._known.add(key)
        return done

    def lead(self, blast: str) -> float:
        """Return the time in s from the start of a run to the first firing of a blast."""
        return self.case.project.of(blast).lead

    def hole_motion(self, project: Project) -> dict[str, np.ndarray]:
        """Simulate each hole with its planned charge, fired at zero, by blast.

        By one run for each hole, or three for each receiver (reciprocity) if these are fewer; by
        one for each blast whose motion enters through a face. Empty where holes do not superpose,
        see `not_superposed`.

        Returns
        -------
        dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
        """
        if not_superposed(self.case):
            return {}
        if project.config.signature is not None:
            return {name: self._through_face(project, name) for name in self.case.blasts}
        models = [self.model(project, blast) for blast in self.case.blasts]
        leads = [self.lead(blast) for blast in self.case.blasts]
        sources = [s for model in models for s in model.sources if isinstance(s, PointSource)]
        bank = greens_functions(
            replace(models[0], sources=sources),
            self.case.duration + max(leads),
            folder=self.folder,
            executor=self.executor,
        )
        self.runs += bank.runs
        motion = {}
        for blast, model, lead in zip(self.case.blasts, models, leads, strict=True):
            early = [replace(s, time=lead) for s in model.sources if isinstance(s, PointSource)]
            fired = np.stack([self._sampled(bank.blast([source]), lead) for source in early])
            charge = project.blasts[blast].charge
            motion[blast] = np.zeros((len(charge), *fired.shape[1:]))
            motion[blast][charge > 0.0] = fired
        return motion

    def _through_face(self, project, blast):
        """Return the motion of each hole of a blast that enters through a face, by one run."""
        fired = self.case.project.of(blast)
        if fired.config.input.decay_exponent is not None:
            raise InputError(
                f"{fired.path.name}: input.decay_exponent: a diagnosis needs the motion of each "
                "hole, which is alike on the whole face or comes from holes_inside; leave it out"
            )
        alone = replace(project.of(blast).shot, alone=True)
        shots = tuple(alone if shot.name == blast else shot for shot in project.shots)
        single = replace(project, survey=replace(project.survey, shots=shots))
        run = self.run([self._own(single, blast)])[0]
        motion = self._sampled(run.seismograms, alone.lead)
        return np.multiply.outer(fired.firing.scales, motion)

    def model(self, project: Project, blast: str) -> Model:
        """Return the model of one blast of a project; blasts of one geometry share a mesh.

        Raises
        ------
        InputError
            If its ground can't be meshed, or a source or receiver lies outside of it.
        """
        return self._own(project, blast)

    def holds(self, project: Project) -> bool:
        """Tell whether the ground of a project can be meshed and holds all its holes."""
        reference = self.case.project
        changed = project.geometry != reference.geometry
        moved = project.config.holes_inside is not None and any(
            not np.array_equal(project.blasts[name].centres, reference.blasts[name].centres)
            for name in self.case.blasts
        )
        if not (changed or moved):
            return True
        try:
            for blast in self.case.blasts:
                centres = enumerate(project.blasts[blast].centres)
                inside = {} if project.config.holes_inside is None else dict(centres)
                refuse_outside(self._suited(project).of(blast).mesh, inside)
        except InputError:
            return False
        return True

    def _own(self, project, blast):
        """Return the model of one blast in the mesh of its project."""
        project = self._suited(project)
        own = project.of(blast)
        if own.survey.receivers is not None and project.geometry != self.case.project.geometry:
            described = [part for each in project.shots for part in each.config.receivers]
            receivers = placed_again(own.receivers, described, own.mesh)
            own = replace(own, survey=replace(own.survey, receivers=receivers))
        model = own.model
        # As stored responses of holes, so that all motion of a case is of one kind.
        return replace(model, single=is_single(model), injected=False)

    def _suited(self, project):
        """Return a project with zones that its ground allows, and finer ones if that is wanted."""
        mesh = project.config.mesh
        suited = with_laws(mesh, project.materials)
        if suited is not mesh:
            project = project.changed(mesh=suited)
        return project.changed(mesh=project.refined(BETTER)) if self.fine else project

    def _sampled(self, seismograms: Mapping[str, Seismogram], lead: float = 0.0) -> np.ndarray:
        """Return seismograms (n_receivers, 3, n_samples) at the instants of the records."""
        dt, n = self.case.dt, self.case.n_samples
        return np.stack(
            [seismograms[name].sampled(lead, dt, n).velocity.T for name in self.case.receivers]
        )


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


def surface_speed(project: Project) -> float:
    """Return the S-wave speed in m/s of the uppermost ground."""
    if project.config.mesh.layers:
        return project.materials[project.config.mesh.layers[0].material].cs
    zone, _ = locate_in_zones(project.mesh, [project.receivers[0].position])
    return project.materials[project.mesh.groups[int(project.mesh.zone_group[zone][0])]].cs


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


def surroundings(forward: Forward, project: Project) -> Surroundings:
    """Simulate every blast of a case at probe receivers around all receivers.

    Raises
    ------
    SolverError
        If a run fails.
    """
    case = forward.case
    offsets, n = probe_offsets(case, project), 2 * STEPS + 1
    receivers = {r.name: r for r in project.receivers}
    probes = tuple(
        replace(receivers[name], name=f"{name} {k}", position=position)
        for name in case.receivers
        for k, position in enumerate(probe_positions(case, receivers[name], offsets))
    )
    models = [replace(forward.model(project, blast), receivers=probes) for blast in case.blasts]
    done = forward.run(models)
    motion = np.stack(
        [
            [run.seismograms[probe.name].sampled(
                forward.lead(blast), case.dt, case.n_samples).velocity.T for probe in probes]
            for run, blast in zip(done, case.blasts, strict=True)
        ]
    )  # fmt: skip
    return Surroundings(offsets, motion.reshape(len(models), -1, n, n, *motion.shape[2:]))


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
