"""A project: everything that its file names, in SI, made when it is asked for."""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from .blast import Blast
from .boundaries import StressInput
from .config import Config
from .config_file import read_config
from .errors import InputError
from .ground import (
    joint_of_surface,
    make_boundaries,
    make_damping,
    make_insitu,
    make_joint,
    make_material,
    make_mesh,
    named_error,
)
from .input_motion import (
    InputMotion,
    make_blast,
    make_firing,
    make_input,
    make_signature,
    read_motion,
    shifts_of,
)
from .joints import Joint
from .materials import Material
from .mesh import Mesh
from .model import Model, Receiver
from .seismogram import GEOGRAPHIC, Seismogram


@dataclass(frozen=True, eq=False)
class Project:
    """A checked project file and the objects it stands for.

    Parameters
    ----------
    path : Path
    config : Config
    materials : dict of str to Material
    joints : tuple of Joint
        One for each joint surface of the mesh.
    """

    path: Path
    config: Config
    materials: dict[str, Material]
    joints: tuple[Joint, ...]

    @property
    def folder(self) -> Path:
        """Folder of the project file; other files are looked for there."""
        return self.path.parent

    @property
    def title(self) -> str:
        """Title of the project."""
        return self.config.title

    def is_assumed(self, key) -> bool:
        """Tell whether a key path, or one it lies under, is marked as assumed."""
        return any(key == name or key.startswith(f"{name}.") for name in self.config.assumed)

    @property
    def faults(self) -> list[str]:
        """Joint surfaces that are single planes: the faults, or all joints of a mesh file."""
        config = self.config.mesh
        return [*config.file_joints, *(fault.name for fault in config.faults)]

    @cached_property
    def blast(self) -> Blast | None:
        """Holes of the production blast."""
        if self.config.blast is None:
            return None
        with named_error(f"{self.path.name}: blast"):
            return make_blast(self.config.blast, self.folder)

    @cached_property
    def signature(self) -> Seismogram:
        """Seismogram of a single hole."""
        with named_error(f"{self.path.name}: signature"):
            return make_signature(self.config.signature, self.materials, self.folder)

    @cached_property
    def input(self) -> InputMotion:
        """Motion that enters the model, with its stages."""
        config = self.config
        with named_error(f"{self.path.name}: input"):
            firing = make_firing(config.blast, self.blast)
            cavity, shifts = config.signature.cavity, None
            if cavity is not None:
                shifts = shifts_of(config.blast, self.blast, cavity.receiver_m, cavity.hole_m)
            return make_input(self.signature, firing, config.input.low_pass_hz, shifts)

    @property
    def lead(self) -> float:
        """Time from the start of the run to the first firing [s]."""
        return -min(self.input.motion.start, 0.0)

    @property
    def duration(self) -> float:
        """Time to march [s]: the duration asked for after the first firing, and the lead."""
        return self.lead + self.config.run.duration_s

    @cached_property
    def mesh(self) -> Mesh:
        """Mesh, split along its joints."""
        with named_error(self.path.name):
            return make_mesh(self.config.mesh, self.materials, self.folder).split(
                [joint.surface for joint in self.joints]
            )

    @cached_property
    def receivers(self) -> tuple[Receiver, ...]:
        """Receivers; those without height stand on the surface."""
        return tuple(
            Receiver(
                part.name,
                tuple(_on_ground(self.mesh, part.position_m)),
                None if part.azimuth_deg is None else float(np.radians(part.azimuth_deg)),
            )
            for part in self.config.receivers
        )

    @cached_property
    def recorded(self) -> dict[str, Seismogram]:
        """Recorded seismograms by receiver, in the components of the simulated ones."""
        found = {}
        for part in self.config.receivers:
            if part.recorded is not None:
                with named_error(f"{self.path.name}: receivers.{part.name}.recorded"):
                    found[part.name] = _like_simulated(
                        part, read_motion(part.recorded, self.folder)
                    )
        return found

    @cached_property
    def model(self) -> Model:
        """Model, with the input on its face; its time 0 is `lead` before the first firing."""
        config = self.config
        boundaries = make_boundaries(config.boundaries, config.input.face)
        motion = self.input.motion.shifted(self.lead)
        with named_error(self.path.name):
            return Model(
                mesh=self.mesh,
                materials=self.materials,
                joints=self.joints,
                boundaries=[*boundaries, StressInput(config.input.face, motion)],
                damping=make_damping(config.damping),
                receivers=self.receivers,
                insitu=make_insitu(config.insitu),
                added_mass=config.run.added_mass,
                step_factor=config.run.step_factor,
            )

    @cached_property
    def input_files(self) -> dict[str, str]:
        """SHA-256 of the project file and of every file that it names."""
        config = self.config
        names = [self.path.name, config.mesh.file, config.mesh.surface_file]
        if config.blast is not None:
            names += [config.blast.file, config.blast.mapping]
        records = [config.signature.recorded, *(part.recorded for part in config.receivers)]
        names += [name for r in records if r is not None for name in (r.file, r.mapping)]
        contents = {name: (self.folder / name).read_bytes() for name in names if name is not None}
        return {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}


def load_project(path, full=False) -> Project:
    """Read a project file and make what does not take long: materials and joints.

    Parameters
    ----------
    path : path
    full : bool
        Whether the table ``[full]`` overrides the rest, for a larger run of the same project.

    Returns
    -------
    Project

    Raises
    ------
    ReadError
        If a file can't be read.
    InputError
        If a rule is broken; one sentence with file, key, rule and value.
    """
    path = Path(path)
    return make_project(read_config(path, full), path)


def make_project(config, path) -> Project:
    """Make a `Project` from a checked `Config`; other files are looked for beside ``path``."""
    path = Path(path)
    materials = {}
    for name, part in config.materials.items():
        with named_error(f"{path.name}: materials.{name}"):
            materials[name] = make_material(part)
    joints = []
    with named_error(path.name):
        for surface, name in joint_of_surface(config.mesh).items():
            if name not in config.joints:
                raise InputError(f"joints.{name}: missing; the joint surface {surface!r} needs it")
            joints.append(make_joint(f"joints.{name}", surface, config.joints[name]))
        for name in config.joints:
            if name not in joint_of_surface(config.mesh).values():
                raise InputError(f"joints.{name}: no joint set or fault of the mesh takes it")
        _refuse_unknown_groups(config)
    return Project(path, config, materials, tuple(joints))


def _refuse_unknown_groups(config):
    """Refuse layers and regions without a material."""
    for number, layer in enumerate(config.mesh.layers):
        if layer.material not in config.materials:
            raise InputError(
                f"mesh.layers[{number + 1}].material: must be one of "
                f"{', '.join(config.materials)}, got {layer.material!r}"
            )
    layers = [layer.material for layer in config.mesh.layers]
    for part in config.mesh.joint_sets:
        for region in part.regions:
            if region not in layers:
                raise InputError(
                    f"mesh.joint_sets.{part.name}.regions: must be layers "
                    f"({', '.join(layers)}), got {region!r}"
                )


def _on_ground(mesh, place):
    """Return a place (3,) in m, on the surface "top" where no height is given."""
    if len(place) == 3:
        return [float(value) for value in place]
    if "top" not in mesh.surfaces:
        raise InputError("receivers.position_m: needs a height, the mesh has no surface 'top'")
    return [float(place[0]), float(place[1]), _height(mesh, np.array(place, dtype=float))]


def _height(mesh, place):
    """Return the height of the surface "top" at a place (2,)."""
    corners = mesh.points[mesh.surfaces["top"]]
    a, b, c = (corners[:, k, :2] for k in range(3))
    area = _cross(b - a, c - a)
    u = _cross(place - a, c - a) / area
    v = _cross(b - a, place - a) / area
    inside = np.flatnonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9))
    if not len(inside):
        raise InputError(
            f"receivers.position_m: ({place[0]:g}, {place[1]:g}) m lies outside of the ground"
        )
    k = inside[0]
    heights = corners[k, :, 2]
    return float(heights @ [1.0 - u[k] - v[k], u[k], v[k]])


def _cross(a, b):
    """Return the cross product of plane vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _like_simulated(part, seismogram):
    """Turn a record into the components of its receiver."""
    geographic = tuple(seismogram.components) == GEOGRAPHIC
    if part.azimuth_deg is None and not geographic:
        raise InputError(
            "azimuth_deg: missing at the receiver; the record has longitudinal and transverse "
            "components"
        )
    if part.azimuth_deg is not None and geographic:
        return seismogram.rotated(float(np.radians(part.azimuth_deg)))
    return seismogram
