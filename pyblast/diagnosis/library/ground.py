"""Ground that differs from the model: soft layers, bodies, unlisted joints."""

import math
import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...config.ground import FaultConfig
from ...config.section import value_at
from ...errors import InputError
from ...ground.tables import is_anisotropic, quality_of
from ...model.anisotropy import anisotropic, jointed, stiffness_of
from ...model.ground_fields import Body
from ...model.joint import Joint
from ...model.material import ConstantQ, Material
from ...project.places import extent_of, on_ground
from ...project.project import Project
from ...project.uncertain_ground import scaled_material
from ...runs.secondary_sources import ROCK
from ..forward import quarter_wave
from ..hypotheses import (
    PRIORS,
    elastic_materials,
    ground_without_loss,
    hypothesis,
    kept_fields,
    receivers_with_space,
    remeshable,
    space_around_receivers,
    three_directions,
    unknown_quality,
    zones_of_constant_strain,
)
from .geometry import BOTH_SIDES

NONE = 1e-9  # a weakness without effect


@dataclass(frozen=True)
class Fabric:
    """Fabric: parallel fissures that make ground anisotropic; theory.md (2.21).

    Parameters
    ----------
    azimuth : float, rad
        Azimuth of their normal, from east to north.
    normal, shear : float
        Weaknesses in 0 to 1: the share of the fissures in the normal and the shear compliance.

    Raises
    ------
    InputError
        If a weakness is not in 0 to 1.
    """

    azimuth: float
    normal: float
    shear: float

    def __post_init__(self):
        """Refuse weaknesses without remaining stiffness."""
        for name in ("normal", "shear"):
            if not 0.0 <= getattr(self, name) < 1.0:
                value = getattr(self, name)
                raise InputError(f"fabric.{name}: must lie in 0 to 1, got {value:g}")

    def of(self, material: Material) -> Material:
        """Return elastic ground with these fissures and the same mean shear modulus."""
        across = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        modulus = material.first_lame + 2.0 * material.shear
        normal, shear = max(self.normal, NONE), max(self.shear, NONE)
        kn, ks = modulus * (1.0 / normal - 1.0), material.shear * (1.0 / shear - 1.0)
        weak = jointed(material, across, 1.0, kn, ks)
        stiffness = stiffness_of(weak) * (material.shear / weak.shear)
        strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
        return anisotropic(material.density, stiffness, **strength)


_LOSS = {
    "family": "path", "on": "site", "axis": "both", "needs": (unknown_quality,),
    "simulated": (elastic_materials,),
    "decided_by": "receivers at distances of three to one, without a joint between them",
}  # fmt: skip


def _with_loss(project, q, materials):
    """Return a project with constant Q in materials by name, on the zones that it has."""
    if quality_of(project.materials) is not None or is_anisotropic(project.materials):
        return None
    law = ConstantQ.around(1.3 * q, q, project.config.band_hz)
    rocks = {name: rock for name, rock in materials.items() if rock.law.name == "elastic"}
    lossy = {name: replace(rock, law=law) for name, rock in rocks.items()}
    mesh = project.config.mesh
    if mesh.file is None and not project.mesh.hexahedral:  # loss would make soft soil hexahedra
        mesh = mesh.model_copy(update={"kind": "tetrahedra"})
    return project.changed(materials={**project.materials, **lossy}, mesh=mesh)


@hypothesis("attenuation_Q", target="site", **_LOSS)
def attenuation_q(project, target, q):
    """The ground takes energy from all waves alike, as constant Q of S waves does."""
    del target
    return _with_loss(project, q, project.materials)


def one_of_materials(case) -> tuple[str, ...]:
    """Name the materials of ground of more than one."""
    names = tuple(case.project.ground_materials)
    return names if len(names) > 1 else ()


@hypothesis(
    "attenuation_Q",
    form="one material",
    target="material",
    targets=one_of_materials,
    **_LOSS,
)
def attenuation_of_material(project, target, q):
    """One material of the ground takes energy from waves, as constant Q does, the others none."""
    return _with_loss(project, q, {target: project.materials[target]})


def _with_fabric(project, fabric):
    """Return a project with a fabric in all its ground."""
    return project.changed(
        materials={name: fabric.of(rock) for name, rock in project.materials.items()}
    )


def _as_stiff(project, target, azimuth, normal, shear):
    """Return the mesh control of anisotropy: a fabric without weakness."""
    del target, normal, shear
    return _with_fabric(project, Fabric(0.5 * np.pi - azimuth, 0.0, 0.0))


@hypothesis(
    "anisotropy",
    family="path",
    on="site",
    target="site",
    axis="both",
    mesh_control=_as_stiff,
    decided_by="receivers in five or more directions from the blast",
    needs=(ground_without_loss, three_directions),
    simulated=(elastic_materials, zones_of_constant_strain),
)
def anisotropy(project, target, azimuth, normal, shear):
    """Upright fissures slow waves across them, at an azimuth from north, more than along them."""
    del target
    if quality_of(project.materials) is not None or is_anisotropic(project.materials):
        return None
    return _with_fabric(project, Fabric(0.5 * np.pi - azimuth, normal, shear))


# Keys without which ground is a flat box with holes inside, with the reason.
NOT_FLAT = {
    "mesh.file": "is an imported mesh",
    "mesh.surface_file": "is a surveyed surface",
    "mesh.benches": "are benches",
    "mesh.fractures": "are fractures of limited extent",
    "mesh.joint_sets": "are joints at any angle",
    "signature": "enters through a face",
    "point_forces": "is no hole",
    "moment_tensors": "is no hole",
    "pressures": "is no hole",
    "air_blast": "is no hole",
    "holes_inside.detonation_m_per_s": "makes columns of holes",
    "blast.scatter_ms": "draws firing times",
    "ground.gradient": "changes speeds within layers",
    "ground.damaged_zone": "changes speeds within layers",
    "ground.heterogeneity": "changes speeds within layers",
    "damping": "is damping of one frequency",
    "insitu": "needs a static stage",
    "run.local_damping": "damps all motion",
}
NOT_OF_MATERIALS = {
    "damping": "is damping of one frequency",
    "yielding": "makes ground that yields",
    "hoek_brown": "makes ground that yields",
    "ubiquitous": "makes ground that slips",
    "transverse": "makes ground stiffer in some directions",
    "joints": "makes ground stiffer in some directions",
}


def not_flat(project: Project) -> str:
    """Return why the ground of a project is not a flat box with holes inside; empty if it is.

    A flat box has flat layers of different isotropic elastic materials, with or without quality
    factors, elastic joints on vertical planes along x or y, holes as points inside, and viscous
    sides and bottom.
    """
    return next(filter(None, (_not_flat(o.config) for o in project.shots)), "")


def _not_flat(config):
    """Return why the ground of one project is not that of a flat box with holes inside."""
    for key, what in NOT_FLAT.items():
        if value_at(config, key):
            return f"{key} {what}"
    if config.holes_inside is None:
        return "holes_inside is missing"
    for side in ("west", "east", "south", "north", "bottom"):
        if side not in config.boundaries.viscous:
            return f"boundaries.viscous lacks {side!r}"
    for name, material in config.materials.items():
        for key, what in NOT_OF_MATERIALS.items():
            if getattr(material, key):
                return f"materials.{name}.{key} {what}"
    names = [layer.material for layer in config.mesh.layers]
    for name in names:
        if names.count(name) > 1:
            return f"mesh.layers has {name!r} twice"
    for fault in config.mesh.faults:
        if fault.dip_deg != 90.0 or fault.dip_direction_deg % 180.0 not in (0.0, 90.0):
            return (
                f"mesh.faults.{fault.name} has dip_deg {fault.dip_deg:g}, dip_direction_deg "
                f"{fault.dip_direction_deg:g}"
            )
        if fault.radius_m is not None:
            return f"mesh.faults.{fault.name} is a disc"
        entry = config.joints.get(fault.joint or fault.name)
        if entry is not None and entry.law != "elastic":
            return f"joints.{fault.joint or fault.name}.law is {entry.law!r}"
    return ""


def flat_layers(case):
    """Require a flat box with holes inside, which is meshed again with each change."""
    why = not_flat(case.project)
    if not why:
        return ""
    return (
        f"{why}: it is simulated only in flat layers with vertical elastic joints along x or y and "
        "holes inside"
    )


def _uprights(project, axis):
    """Return the positions in m of the faults across an axis of a flat box, by name."""
    return {
        fault.name: float(fault.through_m["xy".index(axis)])
        for fault in project.config.mesh.faults
        if fault.dip_direction_deg % 180.0 == (90.0 if axis == "x" else 0.0)
    }


EDGES = 3.0  # candidate planes per shortest S wavelength in the fastest layer
NEAREST = 2.0  # m, least distance of an unlisted joint from listed ones


def planes(case):
    """List candidate planes of a missing joint: vertical, between holes and receivers.

    They are at least half a spacing from listed joints and holes, and evenly spaced in between; a
    gap of half a spacing or more has one in its middle.
    """
    project, candidates = case.project, []
    fastest = max(project.materials[name].cs for name in project.ground_materials)
    spacing = fastest / (EDGES * case.band.high)
    for axis, along in (("x", 0), ("y", 1)):
        holes = np.concatenate([b.centres[:, along] for b in project.blasts.values()])
        receivers = [r.position[along] for r in project.receivers if r.name in case.receivers]
        joints = _uprights(project, axis).values()
        low, high = min(*receivers, *holes), max(*receivers, *holes)
        stops = [low, *sorted(p for p in (*holes, *joints) if low < p < high), high]
        for before, after in pairwise(stops):
            if after - before > 0.5 * spacing:
                span = max(after - before - spacing, 0.0)
                count = max(int(np.ceil(span / spacing)), 1)
                steps = 0.5 * (before + after - span) + span * (np.arange(count) + 0.5) / count
                candidates += [f"{axis}={position:.1f}" for position in steps]
    return tuple(candidates)


def plane_at(target, offset, **_):
    """Return a plane with its fitted position.

    Examples
    --------
    >>> plane_at("x=50.0", -2.5)
    'x=47.5'
    """
    return f"{target[:2]}{float(target[2:]) + offset:.1f}"


def _plane(project, target, offset):
    """Return axis and position of a plane; None outside the box or too near a listed joint."""
    axis, position = target[0], float(target[2:]) + offset
    low, high = extent_of(project)["xy".index(axis)]
    jointed = {joint.surface for joint in project.joints}
    planes = _uprights(project, axis).items()
    near = any(abs(position - other) < NEAREST for name, other in planes if name in jointed)
    return (axis, position) if low < position < high and not near else None


def _with_plane(project, name, axis, position, *joints):
    """Return a project with one more vertical plane, and with joints on it."""
    mesh = project.config.mesh
    middle = [low + 0.5 * size for low, size in zip(mesh.origin_m, mesh.size_m, strict=True)]
    middle["xy".index(axis)] = position
    fault = FaultConfig(
        name=name, dip_deg=90.0, dip_direction_deg=90.0 if axis == "x" else 0.0, through_m=middle
    )
    mesh = mesh.model_copy(update={"faults": [*mesh.faults, fault]})
    return project.changed(mesh=mesh, joints=(*project.joints, *joints))


def _cut_there(project, target, offset, kn, ks):
    """Return the mesh control of a missing joint: zones that end on the candidate plane."""
    del offset, kn, ks
    plane = _plane(project, target, 0.0)
    return project if plane is None else _with_plane(project, f"cut {target}", *plane)


@hypothesis(
    "missing_joint",
    family="path",
    on="site",
    target="plane",
    targets=planes,
    axis="both",
    mesh_control=_cut_there,
    decided_by=BOTH_SIDES,
    described=plane_at,
    simulated=(flat_layers,),
)
def missing_joint(project, target, offset, kn, ks):
    """A vertical joint that the site does not list crosses it at this plane."""
    plane = _plane(project, target, offset)
    if plane is None:
        return None
    joint = Joint(f"missing {target}", "elastic", {"kn": kn, "ks": ks})
    return _with_plane(project, joint.surface, *plane, joint)


THICKNESS, SLOWER = PRIORS["soft_surface_layer"]
USUAL = float(THICKNESS.value(0.0))  # m
PADDING = 8  # factor on the length of a spectrum, by zeros
ALIKE = 2.0  # ratio of thicknesses whose meshes differ by less than the model error


def _layered(project, thickness, slower):
    """Return a project with a slower layer on top; None if the first layer is too thin for it."""
    mesh = project.config.mesh
    name, first = mesh.layers[0].material, mesh.layers[0].thickness_m
    if thickness > 0.9 * (first or mesh.size_m[2]):
        return None
    own, rock = "soft", project.materials[name]
    while own in project.materials:
        own = f"unlisted {own}"
    if is_anisotropic({name: rock}):
        soft = scaled_material(rock, slower)
    else:
        soft = Material.from_speeds(rock.density, slower * rock.cp, slower * rock.cs)
        soft = replace(soft, law=rock.law)
    rest = None if first is None else first - thickness
    layers = [
        mesh.layers[0].model_copy(update={"material": own, "thickness_m": float(thickness)}),
        mesh.layers[0].model_copy(update={"thickness_m": rest}),
        *mesh.layers[1:],
    ]
    return project.changed(
        mesh=mesh.model_copy(update={"layers": layers}), materials={**project.materials, own: soft}
    )


def _as_fast(project, target, thickness, slower):
    """Return the mesh control of a soft layer: one that is not slower, of a rounded thickness."""
    del target, slower
    near = USUAL * ALIKE ** round(math.log(thickness / USUAL, ALIKE))
    return _layered(project, near, 1.0) or _layered(project, thickness, 1.0)


def _resonant_layer(scene):
    """Return thickness and speed factor of a layer that resonates where the residual is largest.

    A soft layer resonates at a quarter wavelength, f = c_s / (4 H) (Kramer 1996, section
    7.2.1.1); slow soil on rock does so for so long that a start at another frequency fails.
    """
    case, project = scene.case, scene.baseline.project
    rock = project.materials[project.config.mesh.layers[0].material]
    recorded, simulated = (case.in_band(each) for each in (case.motion, scene.baseline.motion))
    size = np.linalg.norm(recorded, axis=(2, 3), keepdims=True)
    shares = (recorded - simulated)[:, :, :2] / np.maximum(size, np.finfo(float).tiny)
    length = PADDING * case.n_samples
    spectrum = np.sum(np.abs(np.fft.rfft(shares, length)) ** 2, axis=(0, 1, 2))
    per_metre = 4.0 * np.fft.rfftfreq(length, case.dt)[max(1, np.argmax(spectrum))] / rock.cs
    slower = float(np.clip(USUAL * per_metre, SLOWER.low, SLOWER.high))
    return float(np.clip(slower / per_metre, THICKNESS.low, THICKNESS.high)), slower


@hypothesis(
    "soft_surface_layer",
    family="receiver",
    on="site",
    target="site",
    axis="both",
    mesh_control=_as_fast,
    begins=_resonant_layer,
    decided_by="a receiver on bare rock beside one on the ground, or a hammer test",
    simulated=(remeshable,),
)
def soft_surface_layer(project, target, thickness, slower):
    """A slower layer that the site does not list lies on top."""
    del target
    return _layered(project, thickness, slower)


def _saturated(project, depth, faster):
    """Return a project with faster P waves below a depth under the top of the box."""
    mesh, layers, materials = project.config.mesh, [], dict(project.materials)
    above = depth
    for layer in mesh.layers:
        dry = above if layer.thickness_m is None else min(above, layer.thickness_m)
        rest = None if layer.thickness_m is None else layer.thickness_m - dry
        if dry > 0.0:
            layers.append(layer.model_copy(update={"thickness_m": float(dry)}))
        if rest is None or rest > 0.0:
            own, rock = f"{layer.material} with water", project.materials[layer.material]
            wet = Material.from_speeds(rock.density, faster * rock.cp, rock.cs)
            materials[own] = replace(rock, bulk=wet.bulk, shear=wet.shear)
            layers.append(layer.model_copy(update={"material": own, "thickness_m": rest}))
        above -= dry
    if depth >= mesh.size_m[2]:
        return None
    return project.changed(mesh=mesh.model_copy(update={"layers": layers}), materials=materials)


def _as_dry(project, target, depth, faster):
    """Return the mesh control of a water table: P waves as fast below it as above."""
    del target, faster
    return _saturated(project, depth, 1.0) or project


@hypothesis(
    "water_table",
    family="path",
    on="site",
    target="site",
    axis="both",
    mesh_control=_as_dry,
    decided_by="the level of water in a borehole, or a refraction survey of P waves",
    simulated=(remeshable, elastic_materials),
)
def water_table(project, target, depth, faster):
    """Water fills the ground below a depth: P waves are faster there, S waves are not."""
    del target
    if is_anisotropic(project.materials):
        return None
    return _saturated(project, depth, faster)


APART = 1.25  # quarter waves between places, in each direction
MOST_PLACES = 250  # of which more would be farther apart
SHORTEST = 2.0  # m, of a quarter wave, for bodies of metres
WIDE = 0.75  # reach of a body over the distance of places
NEARLY_VOID = 0.35  # of the speed of the rock, at most


def waves_of_metres(case):
    """Require waves that bodies of metres can scatter."""
    length = quarter_wave(case.project, case)
    if length >= SHORTEST:
        return ""
    return f"a quarter of the shortest wave is {length:.2g} m: a body is sought in ground of metres"


def _grid(case):
    """Return the places (n, 3) in m of bodies, in the ground, and how far they are apart."""
    project = case.project
    box = extent_of(project)
    size = np.ptp(box, axis=1)
    apart = max(APART * quarter_wave(project, case), (size.prod() / MOST_PLACES) ** (1.0 / 3.0))
    axes = [
        low + (np.arange(n) + 0.5) * length / n
        for (low, _), length, n in zip(box, size, np.ceil(size / apart).astype(int), strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    if "top" in project.mesh.surfaces:
        tops = [on_ground(project.mesh, at)[2] for at in grid[:, :, 0, :2].reshape(-1, 2)]
        inside = grid[..., 2] < np.reshape(tops, grid.shape[:2])[..., None]
        return grid[inside], apart
    return grid.reshape(-1, 3), apart


def places_of_bodies(case):
    """Name places in the ground, a little more than a quarter of the shortest wave apart."""
    return tuple(f"east {x:.0f}, north {y:.0f}, height {z:.0f}" for x, y, z in _grid(case)[0])


def _centre(target, east=0.0, north=0.0, up=0.0):
    """Return the place (3,) in m of a target, moved."""
    centre = np.array([float(number) for number in re.findall(r"-?\d+", target)])
    return centre + np.array([east, north, up])


def body_at(target, east, north, up, change, **_):
    """Return the fitted place of a body, and what it is.

    Examples
    --------
    >>> body_at("east 50, north 60, height -20", 4.0, 0.0, -3.0, -0.5)
    'east 54, north 60, height -23 (soft, speeds 39 % lower)'
    """
    x, y, z = _centre(target, east, north, up)
    percent = 100.0 * np.expm1(change)
    kind = "stiff" if change > 0.0 else "soft" if np.exp(change) > NEARLY_VOID else "nearly void"
    side = "higher" if change > 0.0 else "lower"
    return (
        f"east {x:.0f}, north {y:.0f}, height {z:.0f} ({kind}, speeds {abs(percent):.0f} % {side})"
    )


def _by_fields(scene):
    """Return the values of a body and its change of motion at each place, to first order."""
    change, reach = PRIORS["body"][3].sigma, WIDE * _grid(scene.case)[1]
    places = np.array([_centre(target) for target in places_of_bodies(scene.case)])
    shapes = scene.secondary_places[0].around(places, reach)
    speeds = shapes[:, ROCK.index("cp")] + shapes[:, ROCK.index("cs")]
    return (0.0, 0.0, 0.0, change, reach), change * speeds


@hypothesis(
    "body",
    family="path",
    on="site",
    target="place",
    targets=places_of_bodies,
    axis="both",
    decided_by="a borehole or a seismic survey there, or receivers on both sides of it",
    described=body_at,
    simulated=(kept_fields, waves_of_metres),
    stored=_by_fields,
)
def body(project, target, east, north, up, change, reach):
    """Softer or stiffer rock, or nearly a void, that the site does not list lies at this place."""
    centre = _centre(target, east, north, up)
    box = extent_of(project)
    if np.any(centre < box[:, 0]) or np.any(centre > box[:, 1]):
        return None
    own = Body(tuple(centre.tolist()), change, reach)
    return project.changed(fields=(*project.fields, own))


@hypothesis(
    "wrong_coordinates",
    form="receiver",
    family="receiver",
    on="motion",
    target="receiver",
    targets=receivers_with_space,
    axis="blasts",
    decided_by="a survey of the receiver",
    simulated=(space_around_receivers,),
)
def moved_receiver(scene, motion, target, east, north):
    """This receiver was elsewhere."""
    at = scene.case.receivers.index(target)
    motion = motion.copy()
    motion[:, at] += scene.surroundings.change(at, east, north)
    return motion
