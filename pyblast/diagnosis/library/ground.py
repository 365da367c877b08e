"""Ground that differs from the model: soft layers, damaged zones, unlisted joints."""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...errors import InputError
from ...inference.parameter import Parameter
from ...model.anisotropy import anisotropic, jointed, stiffness_of
from ...model.joint import Joint
from ...model.material import Material
from ...project.config_ground import FaultConfig, LayerConfig
from ...project.flat_box import (
    band_of,
    constant_q,
    flat_box,
    is_anisotropic,
    quality_of,
)
from ..calibration import scaled
from ..hypotheses import (
    flat_layers,
    ground_without_loss,
    hypothesis,
    receivers_with_room,
    room_around_receivers,
    three_directions,
    unknown_quality,
)

NONE = 1e-9  # a weakness that changes nothing


@dataclass(frozen=True)
class Fabric:
    """Fabric: parallel fissures that make ground weaker across them; theory.md (2.21).

    Parameters
    ----------
    azimuth : float, rad
        Of their normal, from east to north.
    normal, shear : float
        Weaknesses in 0 to 1: the share of the compliance across them, or of that of sliding along
        them, that the fissures bring.

    Raises
    ------
    InputError
        If a weakness is none.
    """

    azimuth: float
    normal: float
    shear: float

    def __post_init__(self):
        """Refuse weaknesses that leave no stiffness."""
        for name in ("normal", "shear"):
            if not 0.0 <= getattr(self, name) < 1.0:
                value = getattr(self, name)
                raise InputError(f"fabric.{name}: must lie in 0 to 1, got {value:g}")

    def of(self, material: Material) -> Material:
        """Return elastic ground with these fissures, its mean shear modulus as it was."""
        across = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        modulus = material.first_lame + 2.0 * material.shear
        normal, shear = max(self.normal, NONE), max(self.shear, NONE)
        kn, ks = modulus * (1.0 / normal - 1.0), material.shear * (1.0 / shear - 1.0)
        weak = jointed(material, across, 1.0, kn, ks)
        stiffness = stiffness_of(weak) * (material.shear / weak.shear)
        strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
        return anisotropic(material.density, stiffness, **strength)


@hypothesis(
    "attenuation_Q",
    family="path",
    on="site",
    target="site",
    axis="both",
    parameters=[
        Parameter("q", mean=20.0, sigma=0.8, log=True, starts=(8.0, 25.0), low=4.0, high=300.0)
    ],
    settled_by="receivers at distances of three to one, without a joint between them",
    needs=(unknown_quality,),
    simulated=(flat_layers,),
)
def attenuation_q(project, target, q):
    """The ground takes energy from all waves alike, as constant Q of S waves does."""
    del target
    if quality_of(project) is not None or is_anisotropic(project.materials):
        return None
    law = constant_q(1.3 * q, q, band_of(project.config))
    return project.changed(
        materials={name: replace(one, law=law) for name, one in project.materials.items()}
    )


def _with_fabric(project, fabric):
    """Return the project with a fabric in all its ground."""
    return project.changed(
        materials={name: fabric.of(one) for name, one in project.materials.items()}
    )


def _as_stiff(project, target, azimuth, normal, shear):
    """Return the project meshed as with a fabric, as stiff in all directions."""
    del target, normal, shear
    return _with_fabric(project, Fabric(0.5 * np.pi - azimuth, 0.0, 0.0))


@hypothesis(
    "anisotropy",
    family="path",
    on="site",
    target="site",
    axis="both",
    bare=_as_stiff,
    parameters=[
        Parameter(
            "azimuth",
            mean=0.0,
            sigma=2.0,
            unit="rad",
            starts=(0.0, 0.79, 1.57, 2.36),
            low=-7.0,
            high=7.0,
        ),
        Parameter("normal", mean=0.2, sigma=0.15, starts=(0.25,), low=0.0, high=0.8),
        Parameter("shear", mean=0.2, sigma=0.15, starts=(0.15,), low=0.0, high=0.8),
    ],
    settled_by="receivers in five or more directions from the blast",
    needs=(ground_without_loss, three_directions),
    simulated=(flat_layers,),
)
def anisotropy(project, target, azimuth, normal, shear):
    """Upright fissures slow waves across them, at an azimuth from north, more than along them."""
    del target
    if quality_of(project) is not None or is_anisotropic(project.materials):
        return None
    return _with_fabric(project, Fabric(0.5 * np.pi - azimuth, normal, shear))


EDGES = 3.0  # of the cells by which planes are apart, to a shortest S wave in the fastest layer
NEAREST = 2.0  # m that an unlisted joint keeps from listed ones


def planes(case):
    """List planes on which a joint may be missing: vertical, between holes and receivers.

    They keep half a spacing from listed joints and holes, and are spread evenly in between; a gap
    of half a spacing or more has one in its middle.
    """
    project, listed = case.project, []
    ground = flat_box(project)
    fastest = max(project.materials[name].cs for name, _ in ground.layers)
    apart = fastest / (EDGES * case.band.high)
    for axis, along in (("x", 0), ("y", 1)):
        holes = np.concatenate([b.centres[:, along] for b in project.blasts.values()])
        places = [r.position[along] for r in project.receivers if r.name in case.receivers]
        taken = [one.position for one in ground.planes if one.axis == axis]
        low, high = min(*places, *holes), max(*places, *holes)
        stops = [low, *sorted(p for p in (*holes, *taken) if low < p < high), high]
        for before, after in pairwise(stops):
            if after - before > 0.5 * apart:
                room = max(after - before - apart, 0.0)
                count = max(int(np.ceil(room / apart)), 1)
                steps = 0.5 * (before + after - room) + room * (np.arange(count) + 0.5) / count
                listed += [f"{axis}={place:.1f}" for place in steps]
    return tuple(listed)


def _plane(project, target, offset):
    """Return axis and place of a plane; None outside of the box or too near a listed joint."""
    axis, place = target[0], float(target[2:]) + offset
    ground = flat_box(project)
    low, high = ground.box["xy".index(axis)]
    listed = [one.position for one in ground.planes if one.jointed and one.axis == axis]
    near = any(abs(place - other) < NEAREST for other in listed)
    return (axis, place) if low < place < high and not near else None


def _with_plane(project, name, axis, place, *joints):
    """Return the project with one more upright plane, and perhaps with a joint there."""
    mesh = project.config.mesh
    middle = [low + 0.5 * size for low, size in zip(mesh.origin_m, mesh.size_m, strict=True)]
    middle["xy".index(axis)] = place
    fault = FaultConfig(
        name=name, dip_deg=90.0, dip_direction_deg=90.0 if axis == "x" else 0.0, through_m=middle
    )
    mesh = mesh.model_copy(update={"faults": [*mesh.faults, fault]})
    return project.changed(mesh=mesh, joints=(*project.joints, *joints))


def _cut_there(project, target, offset, kn, ks):
    """Return the project with zones that end on the plane before it was moved."""
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
    bare=_cut_there,
    parameters=[
        Parameter("offset", mean=0.0, sigma=5.0, unit="m", starts=(0.0,), low=-25.0, high=25.0),
        Parameter(
            "kn", mean=1e9, sigma=1.5, unit="Pa/m", log=True, starts=(1e9,), low=2e7, high=5e10
        ),
        Parameter(
            "ks", mean=4e8, sigma=1.5, unit="Pa/m", log=True, starts=(4e8,), low=1e7, high=2e10
        ),
    ],
    settled_by="receivers close to the plane on both sides, or a blast on its other side",
    simulated=(flat_layers,),
)
def missing_joint(project, target, offset, kn, ks):
    """A vertical joint that the site does not list crosses it at this plane."""
    plane = _plane(project, target, offset)
    if plane is None:
        return None
    joint = Joint(f"missing {target}", "elastic", {"kn": kn, "ks": ks})
    return _with_plane(project, joint.surface, *plane, joint)


USUAL = 5.0  # m
APART = 1.4  # ratio of a thickness to start from
THIN, THICK = 1.0, 20.0  # m
SLOWEST, FASTEST = 0.1, 0.9  # factors on the speeds of the ground
FINER = 8  # frequencies of a spectrum in place of one
ALIKE = 2.0  # ratio of thicknesses whose zones differ by less than small errors of the theory


def _layered(project, thickness, slower):
    """Return the project with a slower layer on top; None where there is no room for it."""
    ground = flat_box(project)
    name, first = ground.layers[0]
    if thickness > 0.9 * (first or np.ptp(ground.box[2])):
        return None
    own, rock = "soft", project.materials[name]
    while own in project.materials:
        own = f"unlisted {own}"
    if is_anisotropic({name: rock}):
        soft = scaled(rock, slower)
    else:
        soft = Material.from_speeds(rock.density, slower * rock.cp, slower * rock.cs)
        soft = replace(soft, law=rock.law)
    mesh, rest = project.config.mesh, None if first is None else first - thickness
    layers = [
        LayerConfig(material=own, thickness_m=float(thickness)),
        mesh.layers[0].model_copy(update={"thickness_m": rest}),
        *mesh.layers[1:],
    ]
    return project.changed(
        mesh=mesh.model_copy(update={"layers": layers}), materials={**project.materials, own: soft}
    )


def _as_fast(project, target, thickness, slower):
    """Return the project with a layer that is no slower, of one of few thicknesses."""
    del target, slower
    near = USUAL * ALIKE ** round(math.log(thickness / USUAL, ALIKE))
    return _layered(project, near, 1.0) or _layered(project, thickness, 1.0)


def _ringing(scene):
    """Return thickness and factor of a layer that rings where the records miss most.

    A soft layer rings at a quarter of a wave, f = c_s / (4 H) (Kramer 1996, section 7.2.1.1), and
    slow soil on rock for so long that one of another frequency explains nothing.
    """
    case, project = scene.case, scene.baseline.project
    rock = project.materials[flat_box(project).layers[0][0]]
    recorded, simulated = (case.in_band(one) for one in (case.motion, scene.baseline.motion))
    size = np.linalg.norm(recorded, axis=(2, 3), keepdims=True)
    shares = (recorded - simulated)[:, :, :2] / np.maximum(size, np.finfo(float).tiny)
    length = FINER * case.n_samples
    spectrum = np.sum(np.abs(np.fft.rfft(shares, length)) ** 2, axis=(0, 1, 2))
    per_metre = 4.0 * np.fft.rfftfreq(length, case.dt)[max(1, np.argmax(spectrum))] / rock.cs
    slower = float(np.clip(USUAL * per_metre, SLOWEST, FASTEST))
    return float(np.clip(slower / per_metre, THIN, THICK)), slower


@hypothesis(
    "soft_surface_layer",
    family="receiver",
    on="site",
    target="site",
    axis="both",
    bare=_as_fast,
    begins=_ringing,
    parameters=[
        Parameter(
            "thickness",
            mean=USUAL,
            sigma=0.5,
            unit="m",
            log=True,
            starts=(USUAL / APART, USUAL * APART),
            low=THIN,
            high=THICK,
        ),
        Parameter(
            "slower", mean=0.4, sigma=0.4, log=True, starts=(0.4,), low=SLOWEST, high=FASTEST
        ),
    ],
    settled_by="a receiver on bare rock beside one on the ground, or a hammer test",
    simulated=(flat_layers,),
)
def soft_surface_layer(project, target, thickness, slower):
    """A slower layer that the site does not list lies on top."""
    del target
    return _layered(project, thickness, slower)


@hypothesis(
    "wrong_coordinates",
    form="receiver",
    family="receiver",
    on="motion",
    target="receiver",
    targets=receivers_with_room,
    axis="blasts",
    parameters=[
        Parameter("east", mean=0.0, sigma=8.0, unit="m", starts=(0.0,), low=-30.0, high=30.0),
        Parameter("north", mean=0.0, sigma=8.0, unit="m", starts=(0.0,), low=-30.0, high=30.0),
    ],
    settled_by="a survey of the receiver",
    simulated=(room_around_receivers,),
)
def moved_receiver(scene, motion, target, east, north):
    """This receiver was elsewhere."""
    at = scene.case.receivers.index(target)
    motion = motion.copy()
    motion[:, at] += scene.surroundings.change(at, east, north)
    return motion
