"""Forward simulation of a case: motion at and around its receivers."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import make_interp_spline

from ..blasts.blast import Firing
from ..errors import InputError
from ..mesh.mesh import locate
from ..model.model import Model
from ..project.flat_box import (
    Discretization,
    flat_box,
    flat_mesh,
    flat_model,
    ground_materials,
    is_anisotropic,
    not_flat,
)
from ..project.inputs import make_input
from ..project.places import on_ground, refuse_outside
from ..project.project import Project
from ..runs.greens import LINEAR_ZONE_LAWS, greens_functions
from ..runs.parallel import run_all
from .case import Case

LINEAR_JOINTS = "elastic", "kelvin", "maxwell"


@dataclass(eq=False)
class Forward:
    """The solver as a diagnosis sees it; counts its runs.

    Parameters
    ----------
    case : Case
    cut : Discretization or None
        Discretization of a flat box; None takes the mesh of the project.
    folder : path, optional
        Where runs are kept and found.
    executor : Executor, optional
        As for `run_all`.
    runs, kept : int
        How many were asked for, and how many whole blasts the folder had before any was made here.
    kept_s : float, s
        How long those took when they were made.
    """

    case: Case
    cut: Discretization | None
    folder: str | None = None
    executor: Executor | None = None
    runs: int = 0
    kept: int = 0
    kept_s: float = 0.0
    _meshes: dict = field(default_factory=dict, repr=False)
    _models: dict = field(default_factory=dict, repr=False)
    _known: set = field(default_factory=set, repr=False)

    def motion(self, project: Project) -> np.ndarray:
        """Return the motion (n_blasts, n_receivers, 3, n_samples) in m/s of one project."""
        return self.motions([project])[0]

    def motions(self, projects: Sequence[Project]) -> np.ndarray:
        """Return the motion (n_projects, n_blasts, n_receivers, 3, n_samples) in m/s of many."""
        motion = np.stack(
            self.heard([(project, blast) for project in projects for blast in self.case.blasts])
        )
        return motion.reshape(len(projects), -1, *motion.shape[1:])

    def heard(self, pairs: Sequence[tuple[Project, str]]) -> list[np.ndarray]:
        """Return the motion (n_receivers, 3, n_samples) in m/s of pairs of project and blast."""
        runs = self.made([self.model(project, blast) for project, blast in pairs])
        return [
            self._sampled(run.seismograms, self.lead(blast))
            for run, (_, blast) in zip(runs, pairs, strict=True)
        ]

    def made(self, models):
        """Run models, or read them where they are kept, and count them."""
        duration = self.case.duration + max(map(self.lead, self.case.blasts))
        done = run_all(models, duration, folder=self.folder, executor=self.executor)
        self.runs += len(done)
        for one in done:
            key = one.provenance["input_sha256"], *one.seismograms
            if one.from_cache and key not in self._known:
                self.kept, self.kept_s = self.kept + 1, self.kept_s + one.wall_seconds
            self._known.add(key)
        return done

    def lead(self, blast: str) -> float:
        """Return the time in s from the start of a run to the first firing of a blast."""
        return 0.0 if self.cut is not None else self.case.project.of(blast).lead

    def hole_motion(self, project: Project) -> dict[str, np.ndarray]:
        """Return by blast the motion of each hole with its planned charge, fired at zero.

        By a run for each hole, or three for each receiver if these are fewer; one for each blast
        whose motion enters through a face. Empty where holes do not superpose, see
        `not_superposed`.

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
        sources = [source for model in models for source in model.sources]
        bank = greens_functions(
            replace(models[0], sources=sources),
            self.case.duration + max(leads),
            folder=self.folder,
            executor=self.executor,
        )
        self.runs += bank.runs
        motion = {}
        for blast, model, lead in zip(self.case.blasts, models, leads, strict=True):
            early = [replace(source, time=lead) for source in model.sources]
            fired = np.stack([self._sampled(bank.blast([one]), lead) for one in early])
            charge = project.blasts[blast].charge
            motion[blast] = np.zeros((len(charge), *fired.shape[1:]))
            motion[blast][charge > 0.0] = fired
        return motion

    def _through_face(self, project, blast):
        """Return the motion of each hole of a blast that enters through a face, by one run."""
        one = self.case.project.of(blast)
        single = make_input(one.signature, Firing(np.zeros(1), 1.0), one.config.input.low_pass_hz)
        alone = replace(one, given={**one.given, "input": single})
        base, entered = self._base(blast), replace(
            alone, given={**alone.given, "mesh": self._base(blast).mesh}
        ).model  # fmt: skip
        model = replace(
            base, sources=entered.sources, boundaries=entered.boundaries,
            **self._ground(project, base),
        )  # fmt: skip
        run = self.made([model])[0]
        motion = self._sampled(run.seismograms, alone.lead)
        return np.multiply.outer(one.firing.scales, motion)

    def model(self, project: Project, blast: str) -> Model:
        """Return the model of one blast; flat boxes of one geometry share a mesh."""
        if self.cut is None:
            return self._own(project, blast)
        key = geometry(project)
        if key not in self._meshes:
            self._meshes[key] = flat_mesh(flat_box(project), self.cut.of(project.materials))
        return flat_model(project, blast, self.cut, self._meshes[key])

    def holds(self, project: Project) -> bool:
        """Tell whether all holes lie in the mesh, where it is that of the project."""
        if self.cut is not None or project.config.holes_inside is None:
            return True
        mesh = self._base(self.case.blasts[0]).mesh
        try:
            for blast in self.case.blasts:
                places = dict(enumerate(project.blasts[blast].centres))
                refuse_outside(mesh, {str(k): place for k, place in places.items()})
        except InputError:
            return False
        return True

    def _own(self, project, blast):
        """Return the model of one blast on the mesh of the reference project."""
        base, one = self._base(blast), project.of(blast)
        parts = self._ground(project, base) | {"receivers": project.receivers}
        if one.given.get("blast") is not self.case.project.of(blast).given.get("blast"):
            placed = replace(one, given={**one.given, "mesh": base.mesh})
            parts["sources"] = placed.sources
        return replace(base, **parts)

    def _ground(self, project, base):
        """Return what changes of the ground of a project give its models."""
        return {
            "materials": {**base.materials, **project.materials}, "joints": project.joints,
            "ground": (*base.ground, *project.fields),
        }  # fmt: skip

    def _base(self, blast):
        """Return the model of one blast in the reference project; all share a mesh."""
        if blast not in self._models:
            made = self.case.project.of(blast).model
            first = next(iter(self._models.values()), None)
            if first is None:
                made = replace(made, single=is_single(made))
            elif self.case.project.config.ground.damaged_zone is None:
                made = replace(
                    first, sources=made.sources, boundaries=made.boundaries, ground=made.ground
                )
            self._models[blast] = made
        return self._models[blast]

    def _sampled(self, seismograms, lead=0.0):
        """Return seismograms (n_receivers, 3, n_samples) at the instants of the records."""
        dt, n = self.case.dt, self.case.n_samples
        return np.stack(
            [seismograms[name].sampled(lead, dt, n).velocity.T for name in self.case.receivers]
        )


def is_single(model: Model) -> bool:
    """Tell whether a model is run in single precision: quadratic zones without a static stage."""
    return model.quadratic and model.insitu is None


def geometry(project):
    """Return what the mesh of a flat box depends on; nothing of it changes elsewhere."""
    mesh = project.config.mesh
    layers = tuple((layer.material, layer.thickness_m) for layer in mesh.layers)
    planes = tuple(fault.model_dump_json() for fault in mesh.faults)
    joints = tuple(joint.surface for joint in project.joints)
    return layers, planes, joints, is_anisotropic(project.materials)


def not_superposed(case: Case) -> str:
    """Return why the motion of a blast is not the sum over its holes; empty where it is."""
    project = case.project
    for one in (project, *project.further):
        config = one.config
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
        if joint.law not in LINEAR_JOINTS:
            return (
                f"holes do not superpose across the law {joint.law!r} of joint {joint.surface}: "
                "give the joints the law 'elastic'"
            )
    for name in ground_materials(project):
        if project.materials[name].law.name not in LINEAR_ZONE_LAWS:
            return f"holes do not superpose in material {name!r}, which yields: make it elastic"
    return ""


def surface_speed(project: Project) -> float:
    """Return the speed of S waves in m/s in the uppermost ground."""
    if project.config.mesh.layers:
        return project.materials[project.config.mesh.layers[0].material].cs
    zone, _ = locate(project.mesh, [project.receivers[0].position])
    return project.materials[project.mesh.groups[int(project.mesh.zone_group[zone][0])]].cs


STEPS = 3  # on either side of a receiver
STEPS_PER_WAVE = 6.0  # of the shortest S wave at the surface


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Motion on a square grid around each receiver, as high as it stands.

    Parameters
    ----------
    ways : (n,) float64, m
        Of the grid, to the east and to the north.
    motion : (n_blasts, n_receivers, n, n, 3, n_samples) float64, m/s
    """

    ways: np.ndarray
    motion: np.ndarray

    def change(self, receiver: int, east: float, north: float):
        """Return what else one receiver would record elsewhere, (n_blasts, 3, n_samples) m/s.

        By cubic splines; beyond the grid as at its rim.
        """
        cardinal = make_interp_spline(self.ways, np.eye(len(self.ways)), 3)
        way = np.clip((east, north), self.ways[0], self.ways[-1])
        here, there = (np.multiply.outer(*cardinal(one)) for one in (np.zeros(2), way))
        return np.tensordot(there - here, self.motion[:, receiver], ([0, 1], [1, 2]))


def surroundings(forward: Forward, project: Project) -> Surroundings:
    """Run every blast of a case with probe receivers around all receivers."""
    case = forward.case
    ways, n = steps_around(case, project), 2 * STEPS + 1
    there = {r.name: r for r in project.receivers}
    points = tuple(
        replace(there[name], name=f"{name} {k}", position=place)
        for name in case.receivers
        for k, place in enumerate(places_around(case, there[name], ways, fallback=True))
    )
    models = [replace(forward.model(project, blast), receivers=points) for blast in case.blasts]
    done = forward.made(models)
    motion = np.stack(
        [
            [run.seismograms[one.name].sampled(
                forward.lead(blast), case.dt, case.n_samples).velocity.T for one in points]
            for run, blast in zip(done, case.blasts, strict=True)
        ]
    )  # fmt: skip
    return Surroundings(ways, motion.reshape(len(models), -1, n, n, *motion.shape[2:]))


def steps_around(case: Case, project: Project) -> np.ndarray:
    """Return the distances (n,) in m of probe receivers from a receiver, east and north."""
    slowest = min(project.materials[name].cs for name in ground_materials(project))
    return np.arange(-STEPS, STEPS + 1) * slowest / (STEPS_PER_WAVE * case.band.high)


def places_around(case: Case, receiver, ways, fallback=False) -> list | None:
    """Return the places (3,) in m of probe receivers, as deep as the receiver itself.

    None where one lies outside of the mesh of the project; the receiver's own place instead of all
    of them with ``fallback``.
    """
    at = np.asarray(receiver.position, dtype=float)
    grid = [(x, y) for x in ways for y in ways]
    flat = [np.add(receiver.position, (x, y, 0.0)) for x, y in grid]
    if not not_flat(case.project):
        return flat
    mesh = case.project.mesh
    try:
        if "top" in mesh.surfaces:
            below = on_ground(mesh, at[:2])[2] - at[2]
            flat = [np.subtract(on_ground(mesh, at[:2] + step), (0.0, 0.0, below)) for step in grid]
        locate(mesh, flat)
    except InputError:
        return [at] * len(grid) if fallback else None
    return flat
