"""Uncertain ground: speeds, stiffnesses, layers and planes as parameters, with [priors]."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..config.config import PriorsConfig
from ..config.ground import MeshConfig
from ..config.section import value_at
from ..ground.tables import joint_of_surface
from ..inference.parameter import DENSITY, GEOMETRY, OTHER, SPEED, STIFFNESS, Parameter, kind_of_key
from ..model.anisotropy import Anisotropic
from ..model.material import Material
from ..units import split_key
from .project import Project

STEPS = {SPEED: 0.02, STIFFNESS: 0.3, OTHER: 0.1}  # of coordinates, for derivatives
OF_SPEEDS = {"cp", "cs", "youngs", "bulk", "shear", "poisson"}  # keys of a material


def sought_in(project: Project, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Return parameters of ranges that start at the value of the project file.

    Or in the middle of the range where the file has none in it.
    """
    sought = []
    for each in parameters:
        low, high = each.low, each.high
        middle = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        given = value_at(project.config, each.name)
        start = float(given) if given is not None and low <= given <= high else middle
        each = replace(each, kind=kind_of_key(each.name), starts=(start,))
        sought.append(replace(each, step=min(STEPS[each.kind], each.prior[1])))
    return tuple(sought)


def factors_of(project: Project) -> tuple[Parameter, ...]:
    """Return factors on wave speeds and joint stiffnesses, as ``rock.cp`` and ``J1.kn``.

    Wave speeds of each material, one factor for all of an anisotropic one; stiffnesses of each
    fault, and of all joint sets that share an entry. What [priors] takes as known is left out.
    """
    priors, parts = project.config.priors, {}
    sets = {each.name: each.joint or each.name for each in project.config.mesh.joint_sets}
    single = {joint.surface for joint in project.joints} - sets.keys()
    for joint in project.joints:
        part = sets.get(joint.surface, joint.surface)
        own = joint.surface in sets and part in single
        parts.setdefault(joint.surface if own else part, []).append(joint.surface)
    known = {joint.surface: joint.properties for joint in project.joints}
    return (
        *(each for name in project.ground_materials for each in _speeds(project, name, priors)),
        *(
            _stiffness(part, key, surfaces, priors)
            for part, surfaces in parts.items()
            for key in ("kn", "ks")
            if key in known[surfaces[0]] and priors.stiffness_percent
        ),
    )


def held_beside(project: Project, parameters: Sequence[Parameter]) -> tuple[Parameter, ...]:
    """Return what a project takes as known beside parameters of its keys, with its [priors].

    Speeds of each material of a layer and stiffness of each joint, one factor on all densities,
    thickness of each layer, dip, direction and place of the family of planes.
    """
    paths, priors = [parameter.name for parameter in parameters], project.config.priors
    mesh, held = project.config.mesh, []
    for name in dict.fromkeys(layer.material for layer in mesh.layers):
        stated = [path for path in paths if path.startswith(f"materials.{name}.")]
        keys = {split_key(path.rpartition(".")[-1])[0] for path in stated}
        if not keys & (OF_SPEEDS - {"cp", "cs"}):  # else speeds follow from what is looked for
            speeds = _speeds(project, name, priors)
            held += [each for each in speeds if each.name.rpartition(".")[-1] not in keys]
    entries = joint_of_surface(mesh)
    known = [(entries.get(joint.surface), joint) for joint in project.joints]
    for entry in dict.fromkeys(entry for entry, _ in known if entry is not None):
        for key in ("kn", "ks"):
            own = [j.surface for name, j in known if name == entry and key in j.properties]
            free = not any(path.startswith(f"joints.{entry}.{key}_") for path in paths)
            if own and free and priors.stiffness_percent:
                held.append(_stiffness(entry, key, own, priors))
    if priors.density_percent and not any("density" in path for path in paths):
        held.append(_factor("density", DENSITY, priors.density_percent, _as_is))
    if mesh.file is None and not any(path.startswith("mesh.") for path in paths):
        held += _geometry(mesh, priors)
    return tuple(held)


def _factor(name, kind, percent, act):
    """Return a factor, its prior log-normal around 1."""
    sigma, step = 0.01 * percent, STEPS.get(kind, 0.0)
    return Parameter(name, log=True, mean=1.0, sigma=sigma, kind=kind, step=step, act=act)


def _speeds(project, name, priors: PriorsConfig):
    """Return factors on the wave speeds of a material."""
    if not priors.speed_percent:
        return []
    anisotropic = isinstance(project.materials[name].law, Anisotropic)
    return [
        _factor(f"{name}.{key}", SPEED, priors.speed_percent, partial(_with_speed, name, key))
        for key in (("cs",) if anisotropic else ("cp", "cs"))
    ]


def _stiffness(part, key, surfaces, priors: PriorsConfig):
    """Return the factor on a stiffness of joint surfaces."""
    act = partial(_with_stiffness, tuple(surfaces), key)
    return _factor(f"{part}.{key}", STIFFNESS, priors.stiffness_percent, act)


def _geometry(mesh: MeshConfig, priors: PriorsConfig) -> Iterator[Parameter]:
    """Yield changes of layers and planes of a mesh, in m and degrees."""

    def change(name, sigma, step, act):
        if sigma > 0.0:
            yield Parameter(name, mean=0.0, sigma=sigma, kind=GEOMETRY, step=step, act=act)

    for n, layer in enumerate(mesh.layers):
        if layer.thickness_m is not None:
            step = min(0.5, 0.1 * layer.thickness_m)
            name = f"{layer.material}.thickness"
            yield from change(name, priors.thickness_m, step, partial(_thicker, n))
    if mesh.faults:
        turn = 2.0 if max(fault.dip_deg for fault in mesh.faults) <= 88.0 else -2.0
        act = partial(_turned, "dip_direction_deg")
        yield from change("dip", priors.dip_deg, turn, partial(_turned, "dip_deg"))
        yield from change("dip direction", priors.dip_direction_deg, 3.0, act)
    for n, fault in enumerate(mesh.faults):
        yield from change(f"{fault.name}.place", priors.plane_m, 1.0, partial(_moved, n))


def _as_is(project, _):
    """Leave a project as it is: what a factor on all densities does follows from the others."""
    return project


def _with_speed(name, key, project, factor):
    """Change a project by a factor on a wave speed, or on all of an anisotropic material."""
    rock = project.materials[name]
    if isinstance(rock.law, Anisotropic):
        other = scaled_material(rock, factor)
    else:
        speeds = {"cp": rock.cp, "cs": rock.cs}
        speeds[key] *= factor
        moduli = Material.from_speeds(rock.density, speeds["cp"], speeds["cs"])
        other = replace(rock, bulk=moduli.bulk, shear=moduli.shear)
    return project.changed(materials={**project.materials, name: other})


def scaled_material(material: Material, factor: float) -> Material:
    """Return a material of any law with one factor on all of its wave speeds."""
    law = material.law
    if isinstance(law, Anisotropic):
        law = Anisotropic(factor**2 * law.stiffness)
    bulk, shear = factor**2 * material.bulk, factor**2 * material.shear
    return replace(material, bulk=bulk, shear=shear, law=law)


def _with_stiffness(surfaces, key, project, factor):
    """Change a project by a factor on a stiffness of joint surfaces."""
    joints = [
        replace(joint, properties={**joint.properties, key: factor * joint.properties[key]})
        if joint.surface in surfaces and key in joint.properties
        else joint
        for joint in project.joints
    ]
    return project.changed(joints=joints)


def _with_mesh(project, **update):
    """Change tables of the mesh of a project."""
    return project.changed(mesh=project.config.mesh.model_copy(update=update))


def _thicker(number, project, change):
    """Change a project by metres of thickness of a layer."""
    layers = list(project.config.mesh.layers)
    thickness = layers[number].thickness_m + change
    layers[number] = layers[number].model_copy(update={"thickness_m": thickness})
    return _with_mesh(project, layers=layers)


def _turned(key, project, change):
    """Change a project by degrees of the dip or direction of all planes."""
    faults = [
        fault.model_copy(update={key: (getattr(fault, key) + change) % 360.0})
        for fault in project.config.mesh.faults
    ]
    return _with_mesh(project, faults=faults)


def _moved(number, project, change):
    """Change a project by metres of a plane along its normal."""
    faults = list(project.config.mesh.faults)
    fault = faults[number]
    dip, direction = (math.radians(a) for a in (fault.dip_deg, fault.dip_direction_deg))
    sides = math.sin(direction), math.cos(direction)
    normal = np.array([*(math.sin(dip) * side for side in sides), math.cos(dip)])
    through = (np.array(fault.through_m) + change * normal).tolist()
    faults[number] = fault.model_copy(update={"through_m": through})
    return _with_mesh(project, faults=faults)
