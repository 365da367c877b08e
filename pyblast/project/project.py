"""A project: everything that its file names, as objects in SI units, and variants of it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from ..blasts.blast import Blast, Firing
from ..config.config import Config, check_config, read_config
from ..config.ground import BoundariesConfig, GroundConfig, MeshConfig
from ..config.section import changed_tables, value_at
from ..core import JOINT_LAWS
from ..errors import Finding, InputError, named_error
from ..ground.ground import Ground
from ..ground.surface import welded_surfaces
from ..ground.tables import (
    joint_of_surface,
    jointed_media,
    make_boundaries,
    make_damping,
    make_fields,
    make_insitu,
    make_joints,
    make_materials,
    refuse_open_sides,
    refuse_unknown_sides,
    with_damaged_material,
)
from ..mesh.as_built import Row, positions_as_built
from ..mesh.mesh import Mesh, inner_facets
from ..model.joint import Joint
from ..model.material import Material
from ..model.model import Model, Receiver, SpongeLayer
from ..readers.provenance import ReadLog
from ..recordings.recording import Recording
from ..signals.seismogram import Seismogram
from ..simulation.accuracy import Accuracy
from ..simulation.estimate import Cost, beyond_budget, estimate
from ..simulation.recipe import (
    BETTER,
    FINER_ERROR,
    HARMONICS,
    OF_FITS,
    Meshed,
    Stations,
    mesh_ground,
    sized_by_blast,
    sizes_for_band,
    sizes_for_error,
    with_laws,
)
from ..solver.initial_stress import joint_pressures
from ..solver.injection import with_injection
from ..solver.run import Run, simulate
from ..sources.face import InputMotion
from ..sources.inside import Inside
from ..sources.shot import Shot
from ..survey import Survey
from .elastic_ground import ElasticGround, elastic_ground, with_elastic_ground
from .places import (
    carried_frequency,
    check_absorbing_layer,
    clearance_of,
    hole_positions,
    longest_path,
    make_absorbing_layer,
    place_sources,
    placed,
    positions_of,
    radiating_positions,
    single_source,
    source_positions,
    start_of_waves,
    survey_positions,
)

MOST_MESHES = 24  # of variants of a project that are kept, split and not
STEP_FACTOR = {False: 0.8, True: 0.95}  # over a bound of tetrahedra, over the limit of hexahedra


@dataclass(frozen=True, eq=False)
class Project:
    """Project: a checked project file and the objects that it describes.

    Parameters
    ----------
    path : Path
    config : Config
    materials : dict of str to Material
    joints : tuple of Joint
        One for each joint surface of the mesh.
    survey : Survey
        The shot of this file, then those of `with_further`, with receivers and recordings.
    fields : tuple of Gradient, DamagedZone, Body or Heterogeneity
        Factors on the wave speeds beside those of the table [ground].
    terrain : (n, 3) or (n, 3, 3) float64, m, optional
        Surveyed top surface, or its triangles, in place of that of the file.
    span : float, m, optional
        Longest path between sources and receivers that sets the edges, in place of that between
        those of the file.
    uncut : bool
        Whether the ground is refused where its mesh would need tetrahedra.
    meshes : dict
        Meshes of this project and of what `replace` makes of it, each built once; shared.
    log : ReadLog
        What was read from files so far.
    """

    path: Path
    config: Config
    materials: dict[str, Material]
    joints: tuple[Joint, ...]
    survey: Survey
    fields: tuple = ()
    terrain: np.ndarray | None = None
    span: float | None = None
    uncut: bool = False
    meshes: dict[tuple, Any] = field(default_factory=dict, repr=False)
    log: ReadLog = field(default_factory=ReadLog, repr=False)

    @classmethod
    def from_dict(cls, tables: dict[str, Any], folder: str | Path = ".") -> "Project":
        """Make a project of nested tables, as in a project file; its files lie in a folder."""
        return make_project(check_config(tables), Path(folder) / "project.toml")

    def __repr__(self) -> str:
        """Return title and file on one line."""
        return f"<Project {self.title!r} of {self.path}>"

    @property
    def folder(self) -> Path:
        """Folder of the project file; other files are looked for there."""
        return self.path.parent

    @property
    def title(self) -> str:
        """Title of the project."""
        return self.config.title

    def is_assumed(self, key) -> bool:
        """Return whether a key path or a parent of it is marked as assumed."""
        return any(key == name or key.startswith(f"{name}.") for name in self.config.assumed)

    @property
    def shots(self) -> tuple[Shot, ...]:
        """Blasts in this ground; sources inside have all frequencies, see `shot`."""
        return self.survey.shots

    @cached_property
    def shot(self) -> Shot:
        """The first blast, its sources inside low-passed to what the mesh carries."""
        return self._shot_on(lambda: self.mesh)

    def _shot_on(self, mesh):
        """Return the first blast on the mesh that a function returns."""
        return self.shots[0].on_mesh(lambda: carried_frequency(self, mesh()))

    @property
    def name(self) -> str:
        """Name of the first blast; by default the stem of the file."""
        return self.shots[0].name

    @property
    def ground_materials(self) -> list[str]:
        """Names of the materials in the ground, layers from the top down."""
        mesh = self.config.mesh
        parts = [part.material for part in (*mesh.layers, *mesh.fills)]
        return list(dict.fromkeys(parts or self.mesh.groups))

    @property
    def faults(self) -> list[str]:
        """Joint surfaces that are single planes: the faults, or all joints of a mesh file."""
        config = self.config.mesh
        return [*config.file_joints, *(fault.name for fault in config.faults)]

    @property
    def blast(self) -> Blast | None:
        """Holes of the production blast."""
        return self.shots[0].blast

    @property
    def firing(self) -> Firing:
        """Firing times and scales of the holes; scales of holes inside refer to 1 kg."""
        return self.shots[0].firing

    @property
    def signature(self) -> Seismogram | None:
        """Seismogram of a single hole."""
        return self.shots[0].signature

    @property
    def input(self) -> InputMotion | None:
        """Motion that enters through a face, with its stages."""
        return self.shots[0].input

    @property
    def inside(self) -> Inside:
        """Time functions of all sources beside a motion on a face."""
        return self.shot.inside

    @property
    def lead(self) -> float:
        """Time from the start of the run to the first firing [s]."""
        return self.shot.lead

    @property
    def duration(self) -> float:
        """Duration of the run [s]: the lead and the given duration after the first firing."""
        return self.shot.duration

    @cached_property
    def ground(self) -> Ground:
        """What is there, whatever elements it is cut into."""
        config = self.config
        band, signature = config.run.compare_band_hz, config.signature
        return Ground(
            config.mesh, config.ground, config.boundaries, config.absorbing_layer, self.materials,
            self.joints, self.terrain, "" if signature is None else config.input.enters_as,
            None if band is None else band[1], self.folder, self.log,
        )  # fmt: skip

    @cached_property
    def reach(self) -> float:
        """Longest path in m between sources and receivers of all blasts; sets the edges."""
        return longest_path(survey_positions(self)) if self.span is None else self.span

    @cached_property
    def geometry(self) -> tuple:
        """What decides the mesh: variants with the same share it."""
        return self.reach, *self.ground.key()

    @cached_property
    def meshed(self) -> Meshed:
        """Mesh, not split, and why it has its elements."""
        return self._kept(self.geometry, self._mesh_ground)

    def _mesh_ground(self):
        """Build the mesh of the ground, not split; refuse one of the program's choice if dear."""
        if self.sized is not self.ground and self.dear is not None:
            raise InputError(f"{self.path.name}: mesh.minutes: {self.dear.text}")
        with named_error(self.path.name):
            return mesh_ground(self.ground, self._places, self._top, self._model_on, self.uncut)

    @property
    def _places(self):
        """What of sources and receivers decides how the ground is cut."""
        config = self.config
        received = config.receivers or self.survey.receivers is not None
        moments = bool(config.holes_inside or config.moment_tensors)
        near = bool((moments or config.point_forces) and received)
        places = positions_of(self)
        return Stations(places, self.reach, moments, near, clearance_of(self, places))

    @cached_property
    def sized(self) -> Ground:
        """The ground with the frequency that the blast asks its mesh to carry, if no key does."""
        with named_error(self.path.name):
            return sized_by_blast(self.ground, self._top)

    @cached_property
    def cost(self) -> Cost | None:
        """What a run costs, before a mesh is built; None where the mesh is read from a file."""
        return self.price(self.sized.mesh)

    def price(self, mesh: MeshConfig) -> Cost | None:
        """Return what a run costs with another table of the mesh."""
        factor = self.config.run.step_factor
        factors = STEP_FACTOR if factor is None else dict.fromkeys(STEP_FACTOR, factor)
        ground, duration = replace(self.ground, mesh=mesh), self.shots[0].duration
        with named_error(self.path.name):
            return estimate(ground, self._places, self._top, duration, factors)

    @cached_property
    def dear(self) -> Finding | None:
        """D49: the run takes longer than its budget; what would be affordable."""
        if self.cost is None:
            return None
        return beyond_budget(self.cost, self.sized, self.price, self.shots[0].unfiltered)

    def _kept(self, key, build):
        """Return a mesh of the shared store, built where it is new; the first ones stay in it."""
        if key not in self.meshes:
            built = build()
            if len(self.meshes) >= MOST_MESHES:
                del self.meshes[list(self.meshes)[2]]
            self.meshes[key] = built
        return self.meshes[key]

    def _top(self):
        """Return the frequency in Hz that the blast asks a mesh to carry, if it does."""
        return self.shots[0].asked_frequency

    def sized_for_band(self, highest: float, accuracy: float = OF_FITS) -> MeshConfig:
        """Return the table of `sizes_for_band`, by which hexahedra carry harmonics, too.

        Joints of laws that are not linear make them, up to `HARMONICS` times a frequency in Hz.
        """
        if not all(JOINT_LAWS[joint.law].linear for joint in self.joints):
            highest *= HARMONICS
        return sizes_for_band(self.ground, highest, accuracy)

    def for_band(self, highest: float, accuracy: float = OF_FITS) -> MeshConfig:
        """Return the table of the mesh on which records are fitted up to a frequency in Hz.

        That of `sized_for_band` where the ground takes hexahedra, else that of the file.
        """
        fitted = self.sized_for_band(highest, accuracy)
        plain = self.config.mesh.model_copy(update={"near_source_work": fitted.near_source_work})
        if fitted == plain:
            return plain
        with suppress(InputError):  # edges of that size that don't build this ground
            if self.changed(mesh=fitted).meshed.mesh.hexahedral:
                return fitted
        return plain

    def refined(self, error: float = FINER_ERROR) -> MeshConfig | None:
        """Return the table of a mesh with another error over that of the mesh, if there is one."""
        frequency = self.sized.frequency
        return sizes_for_error(self.ground, self.meshed.mesh, frequency, error)

    def suited(self, finer: bool = False) -> "Project":
        """Return the project with zones that its laws allow, finer ones if that is wanted."""
        mesh = with_laws(self.config.mesh, self.materials)
        project = self if mesh is self.config.mesh else self.changed(mesh=mesh)
        return project.changed(mesh=project.refined(BETTER)) if finer else project

    @property
    def as_built(self) -> tuple[Row, ...]:
        """Survey of the ground, and of where sources and receivers stand in it."""
        asked = None if self.config.mesh.file else self.ground.geometry
        positions = source_positions(self) | {
            f"receivers.{part.name}": part.position for part in self.receivers
        }
        return (*self.meshed.rows, *positions_as_built(self.mesh, asked, positions))

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh, split along its joints."""
        holes = ()
        if self.ground.of_one_blast:
            holes = self.blast.collar.tobytes(), self.blast.toe.tobytes()
        key = "split", *self.geometry, holes
        return self._kept(key, lambda: self._split(self.meshed.mesh))

    def _split(self, mesh):
        """Return a mesh split along its joints, with the damaged ground of this blast."""
        with named_error(self.path.name):
            mesh = mesh.split([joint.surface for joint in self.joints])
            return with_damaged_material(self.config.ground, self.blast, mesh)

    @property
    def stations(self) -> tuple[Receiver, ...]:
        """Receivers as they are stated, those without height not placed on the ground."""
        return self.survey.stations(self.shots[0])

    @cached_property
    def receivers(self) -> tuple[Receiver, ...]:
        """Receivers; those without height stand on the surface."""
        return self._receivers_in(self.mesh)

    def _receivers_in(self, mesh):
        """Return the receivers in a mesh."""
        with named_error(self.path.name):
            return placed(self.stations, mesh)

    @property
    def sources(self) -> tuple:
        """All sources in the mesh; their time 0 is `lead` before the first firing."""
        return self._sources_in(self.mesh, self.shot)

    def _sources_in(self, mesh, shot):
        """Return the sources of a blast in a mesh."""
        with named_error(self.path.name):
            return place_sources(shot, mesh)

    @property
    def absorbing_layer(self) -> SpongeLayer | None:
        """Damped ground around tetrahedra; no receiver and no hole stands in it."""
        return self._layer_in(self.mesh, self.inside, self.receivers)

    def _layer_in(self, mesh, inside, receivers):
        """Return the absorbing layer around a mesh of tetrahedra."""
        layer = None if mesh.hexahedral else make_absorbing_layer(self.config, inside.lowest)
        positions = {f"receivers.{part.name}": part.position for part in receivers}
        if inside.moment_rate is not None:
            positions |= hole_positions(self.blast)
        if layer is not None:
            with named_error(self.path.name):
                check_absorbing_layer(layer, mesh, positions)
        return layer

    @cached_property
    def records(self) -> dict[str, Recording]:
        """Records of the first blast by receiver, in the components of simulated seismograms."""
        return self.survey.in_axes(self.shots[0])

    @property
    def recorded(self) -> dict[str, Seismogram]:
        """Recorded seismograms by receiver."""
        return {name: record.seismogram for name, record in self.records.items()}

    @property
    def compared_band(self) -> tuple[float, float] | None:
        """Band in Hz in which records are compared, None for all."""
        band = self.survey.band or self.config.run.compare_band_hz
        return None if band is None else (band[0], band[1])

    @cached_property
    def comparable(self) -> dict[str, Recording]:
        """Return records to set beside simulated motion, low-passed like what enters."""
        return self.survey.comparable(self.shot)

    def simulate(
        self,
        duration: float | None = None,
        *,
        progress: Callable | None = None,
        snapshot_times: Sequence[float] = (),
    ) -> Run:
        """Simulate the motion of the model from the first firing on; no file is written.

        Parameters
        ----------
        duration : float, s, optional
            From the start of the run; by default that of the project.
        progress : callable, optional
            Called with (stage, done, total) between chunks of time steps of about 0.05 s.
        snapshot_times : sequence of float, s
            After the first firing, when node velocities are kept.

        Raises
        ------
        InputError, ReadError
            If the project or a file of it is wrong.
        SolverError
            If the motion is not finite or its energy grows without cause.

        See Also
        --------
        pyblast.run : the whole chain, with checks, comparison, files and report.
        """
        done = simulate(
            self.model, self.duration if duration is None else duration, progress=progress,
            snapshot_times=[time + self.lead for time in snapshot_times],
        )  # fmt: skip
        snapshots = {time - self.lead: velocity for time, velocity in done.snapshots.items()}
        return replace(done, seismograms=self.simulated(done.seismograms), snapshots=snapshots)

    def simulated(self, motion: Mapping[str, Seismogram]) -> dict[str, Seismogram]:
        """Return seismograms of a run of the model from the first firing, with their low-pass."""
        corner = self.shot.low_pass
        return {
            name: replace(each, start=each.start - self.lead, low_passed=corner)
            for name, each in motion.items()
        }

    @property
    def with_low_pass(self) -> "Project":
        """The project with the low-pass that the mesh asks for as a number of its file.

        Variants of it, with other ground or another mesh, then stay beside the same records.
        """
        table = self.config.holes_inside
        if table is None or table.charged_hole is None or table.low_pass_hz not in (None, "mesh"):
            return self
        corner = self.inside.low_pass
        corner = "none" if corner is None else float(corner)
        table = table.model_copy(update={"low_pass_hz": corner})
        config = self.config.model_copy(update={"holes_inside": table})
        shots = replace(self.shot, config=config), *self.shots[1:]
        return replace(self, config=config, survey=replace(self.survey, shots=shots))

    def compared_in(self, band: tuple[float, float] | None) -> "Project":
        """Return the project with another band in Hz in which records are compared."""
        return replace(self, survey=replace(self.survey, band=band))

    @cached_property
    def model(self) -> Model:
        """Model with all that enters; its time 0 is `lead` before the first firing."""
        return self._assembled(self.mesh, self.shot, self.receivers)

    @cached_property
    def accuracy(self) -> Accuracy:
        """Expected error of the run at each receiver, and the band that it holds."""
        layers = self.config.mesh.layers
        heights = {p.material: p.thickness_m for p in layers if p.thickness_m is not None}
        inside = len(radiating_positions(self)) > 0
        before, after = self.shot.unfiltered, self.shot.motions
        start = partial(start_of_waves, self)
        return Accuracy(self.model, before, after, start, heights, inside)

    def _model_on(self, mesh):
        """Return the model on a mesh, not split, that need not be that of the project."""
        mesh = self._split(mesh)
        return self._assembled(mesh, self._shot_on(lambda: mesh), self._receivers_in(mesh))

    def _assembled(self, mesh, shot, receivers):
        """Return the model of a mesh, of a blast on it and of receivers."""
        config, face = self.config, None if shot.input is None else self.config.input.face
        if face is not None:
            joints = {joint.surface for joint in self.joints}
            outer = [
                name for name in mesh.surfaces
                if name not in joints and not inner_facets(mesh, name)[0].any()
            ]  # fmt: skip
            if face not in outer:
                what = f"must be one of {', '.join(outer)}, got {face!r}"
                raise InputError(f"{self.path.name}: input.face: {what}")
        entries, waves = shot.entry()
        sources = self._sources_in(mesh, shot)
        layer = self._layer_in(mesh, shot.inside, receivers)
        with named_error(self.path.name):
            refuse_unknown_sides("boundaries.free", config.boundaries.free, mesh)
            welded_surfaces(config.mesh, mesh)
            if config.holes_inside or config.moment_tensors:
                refuse_open_sides(config.boundaries, mesh, joint_of_surface(config.mesh))
            model = Model(
                mesh=mesh,
                materials=self.materials,
                joints=self.joints,
                boundaries=(*make_boundaries(config.boundaries, face), *entries),
                damping=make_damping(config),
                ground=(*make_fields(config.ground, self.blast, mesh), *self.fields),
                insitu=make_insitu(config.insitu),
                step_factor=config.run.step_factor or STEP_FACTOR[mesh.hexahedral],
                local_damping=config.run.local_damping,
                quadratic=config.mesh.quadratic,
                sources=(*sources, *waves),
                receivers=receivers,
                sponge=layer,
            )
            model = with_elastic_ground(model, elastic_ground(model, self.core))
            model = with_injection(model, shot.duration)
            if not config.boundaries.jointed_faces:
                return model
            pressures = joint_pressures(model)  # joints that close are stiffer under them
            media = jointed_media(config.mesh, self.materials, self.joints, pressures)
            known = make_boundaries(config.boundaries, face, media)
            return replace(model, boundaries=(*known, *entries))

    @property
    def core(self) -> float | None:
        """Stated radius in m of elastic ground around the holes, None: that of the closed form."""
        return None if self.config.holes_inside is None else self.config.holes_inside.core_m

    @property
    def elastic_ground(self) -> ElasticGround | None:
        """Ground of the model that stays elastic around its sources."""
        return elastic_ground(self.model, self.core)

    @property
    def blasts(self) -> dict[str, Blast]:
        """Holes of all blasts by name; one hole stands for other sources."""
        return {shot.name: shot.blast or single_source(shot.config) for shot in self.shots}

    def of(self, name: str) -> "Project":
        """Return the project of one of the blasts alone, in the ground of this project."""
        shot = self.survey.shot(name)
        tables = {table: getattr(self.config, table) for table in OF_GROUND}
        config = shot.config.model_copy(update=tables)
        survey = replace(self.survey, shots=(shot,))
        return replace(self, path=shot.path, config=config, survey=survey)

    @property
    def held_shots(self) -> tuple[Shot, ...]:
        """All blasts with their sources as they are on the mesh of this project."""
        return tuple(self.of(shot.name).shot for shot in self.shots)

    def changed(
        self,
        *,
        materials: dict[str, Material] | None = None,
        joints: Iterable[Joint] | None = None,
        fields: Iterable | None = None,
        mesh: MeshConfig | None = None,
        ground: GroundConfig | None = None,
        boundaries: BoundariesConfig | None = None,
        surface: np.ndarray | None = None,
        blasts: dict[str, Blast] | None = None,
        receivers: Iterable[Receiver] | None = None,
    ) -> "Project":
        """Return the project with other parts; what the sources do stays as it is.

        Another geometry is another ``mesh``, ``ground``, ``boundaries`` or ``surface``, with
        ``joints`` and ``materials`` to match: the mesh is built anew when first used. A fault
        without a joint of its name stays closed; zones end on it.

        Parameters
        ----------
        materials, joints, fields
            Of the ground, in place of those that it has.
        mesh, ground, boundaries : MeshConfig, GroundConfig, BoundariesConfig, optional
        surface : (n, 3) float64, m, optional
            Surveyed top surface, in place of ``mesh.surface_file``.
        blasts : dict of str to Blast, optional
        receivers : sequence of Receiver, optional
        """
        parts = {"materials": materials, "joints": joints, "fields": fields}
        parts = {key: value for key, value in parts.items() if value is not None}
        parts |= {key: tuple(parts[key]) for key in ("joints", "fields") if key in parts}
        tables = {"mesh": mesh, "ground": ground, "boundaries": boundaries}
        tables = {name: table for name, table in tables.items() if table is not None}
        parts["config"] = self.config.model_copy(update=tables)
        if surface is not None:
            parts["terrain"] = surface
        survey = self.survey
        if materials is not None or blasts is not None:
            survey = replace(survey, shots=self.held_shots)
        if blasts is not None:
            fired = [replace(s, fired=blasts[s.name]) for s in survey.shots if s.name in blasts]
            survey = replace(survey, shots=tuple(fired))
        if receivers is not None:
            survey = replace(survey, receivers=tuple(receivers))
        return replace(self, survey=survey, **parts)

    def set(self, changes: Mapping[str, float]) -> "Project":
        """Return the project with other values of some keys.

        Parameters
        ----------
        changes : dict of str to float
            By dotted path, in the units of the keys: ``{"joints.fault.kn_gpa_per_m": 0.2}``.

        Returns
        -------
        Project
            Its mesh is that of the project, so that `run_many` can run several at once, but where a
            change affects it.

        Raises InputError if a path names no number, or a value breaks a rule of the project file.
        """
        config = check_config(changed_tables(self.config, changes), self.path.name)
        tables = {
            table
            for table in Config.model_fields
            if getattr(config, table) != getattr(self.config, table)
        }
        others = {"materials"} if self.ground.sized_by_speeds else set()
        others |= {"blast", "materials"} if config.ground.damaged_zone else set()
        varied = make_project(config, self.path)
        if tables <= CHEAP:
            shot = replace(self.shot, config=config)
        else:
            shot = replace(varied.shots[0], log=self.log, read=self.shots[0].read)
        survey = replace(self.survey, shots=(shot,))
        meshes = {} if tables & others else self.meshes
        return replace(varied, survey=survey, meshes=meshes, span=self.reach)

    @property
    def input_files(self) -> dict[str, str]:
        """SHA-256 of the project file and of every file that it names."""
        return self.shots[0].input_files


OF_GROUND = "mesh", "boundaries", "absorbing_layer", "ground", "damping", "insitu"
SHARED = (
    "mesh", "materials", "joints", "boundaries", "absorbing_layer", "ground", "damping", "insitu",
    "holes_inside", "blast.charge_exponent",
)  # fmt: skip


def with_further(project: Project) -> Project:
    """Return a project with those that its table [diagnosis] names: blasts in the same ground.

    Raises InputError if a name appears twice, or the ground or the moment rate of a hole differs.
    """
    table, folder = project.config.diagnosis, project.folder
    every = (project, *(load_project(folder / name) for name in (table.blasts if table else ())))
    names = [each.name for each in every]
    for each, name in zip(every, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"{project.path.name}: diagnosis.blasts: {name!r} is named twice")
        for key in SHARED:
            if value_at(each.config, key) != value_at(project.config, key):
                raise InputError(
                    f"{each.path.name}: {key}: differs from {project.path.name}; blasts that are "
                    "diagnosed together share their ground and the moment rate of 1 kg"
                )
    first = project.shots[0]
    shots = [replace(each.shots[0], read=first.read, log=first.log) for each in every[1:]]
    return replace(project, survey=replace(project.survey, shots=(first, *shots)))


def load_project(path, full=False, ground=True) -> Project:
    """Load a project file; mesh, records and model are built when first used.

    Parameters
    ----------
    path : path
    full : bool
        Whether the table ``[full]`` overrides the rest.
    ground : bool
        Whether the file must describe the ground; superposition and delays do without.

    Returns
    -------
    Project

    Raises
    ------
    ReadError, InputError
        If a file can't be read or a rule is broken; one sentence with file, key, rule and value.
    """
    path = Path(path)
    return make_project(read_config(path, full, ground), path)


def make_project(config, path) -> Project:
    """Make a `Project` from a checked `Config`; other files are relative to ``path``.

    Parameters
    ----------
    config : Config
    path : path
    """
    path = Path(path)
    with named_error(path.name):
        materials, joints = make_materials(config), make_joints(config)
    shot = Shot(path, config, materials, path.stem)
    return Project(path, config, materials, joints, Survey((shot,)), log=shot.log)


CHEAP = {"joints", "damping"}
