"""Sides: what lies beyond a face of the model, free, welded, roller, fixed, viscous or a joint."""

import math

import numpy as np

from ...config.ground import BoundariesConfig, FaultConfig
from ...model.joint import Joint
from ...project.project import Project
from ..hypotheses import hypothesis, remeshable

KINDS = "free", "roller", "fixed", "viscous"
OUTWARD = {"west": (0, -1), "east": (0, 1), "south": (1, -1), "north": (1, 1), "bottom": (2, -1)}
UNDER = "under "
BEYOND = 1.0  # S wavelengths at the lowest frequency, of ground modelled beyond a joint at a side


def of_body(case) -> tuple[str, ...]:
    """Name the sides of the body itself: not "top", nor where the model is a cut of wider ground.

    "under" a layer: its lower face, with all taken away that the model has beneath.
    """
    return sides_of(case.project)


def sides_of(project: Project) -> tuple[str, ...]:
    """Name the sides of the body of a project, see `of_body`."""
    config = project.config
    cut = {*config.boundaries.viscous, *config.boundaries.free_field, "top"}
    if config.signature is not None:
        cut.add(config.input.face)
    sides = tuple(side for side in OUTWARD if side not in cut)
    under = tuple(UNDER + layer.material for layer in config.mesh.layers[:-1])
    return (*sides, *under) if sides else ()


def bounded(case) -> str:
    """Require a body with sides of its own."""
    if of_body(case):
        return ""
    return (
        "every side is a cut through wider ground: name those of a body free, roller or fixed in "
        "[boundaries]"
    )


def kind_of_side(project: Project, side: str) -> str:
    """Return the condition of an outer side, of `KINDS`; free where none is given."""
    table = project.config.boundaries
    return next((kind for kind in KINDS if side in getattr(table, kind)), "free")


def with_kind(project: Project, side: str, kind: str) -> Project | None:
    """Return a project with one of `KINDS` at a side of its body, see `of_body`.

    None where that is so already.
    """
    if side.startswith(UNDER):
        project = without_ground_under(project, side.removeprefix(UNDER))
        side = "bottom"
        if kind_of_side(project, side) == kind:
            return project
    elif kind_of_side(project, side) == kind:
        return None
    return project.changed(boundaries=_moved(project.config.boundaries, side, kind))


def _moved(table: BoundariesConfig, side, kind):
    """Return a `BoundariesConfig` with a side in the list of a kind, and in no other."""
    lists = {name: [each for each in getattr(table, name) if each != side] for name in KINDS}
    lists[kind] = [*lists[kind], side]
    return table.model_copy(update=lists)


def without_ground_under(project: Project, material: str) -> Project:
    """Return a project that ends at the lower face of a layer."""
    mesh, depth, (origin, size) = (
        project.config.mesh,
        _depth_under(project, material),
        _box(project),
    )
    names = [layer.material for layer in mesh.layers]
    layers = mesh.layers[: names.index(material) + 1]
    origin[2], size[2] = origin[2] + size[2] - depth, depth
    update = {"size_m": size.tolist(), "origin_m": origin.tolist(), "layers": layers}
    return project.changed(mesh=mesh.model_copy(update=update))


def _box(project):
    """Return lowest corner and lengths of the box of a project, (3,) m each."""
    mesh = project.config.mesh
    return np.array(mesh.origin_m, dtype=float), np.array(mesh.size_m, dtype=float)


def _depth_under(project, material):
    """Return the depth in m of the lower face of a layer."""
    depth = 0.0
    for layer in project.config.mesh.layers:
        depth += layer.thickness_m
        if layer.material == material:
            return depth
    raise AssertionError(material)


def _springs(project, material, stiffness, ratio):
    """Return kn and ks in Pa/m of a joint whose normal stiffness is in units of ``pi f Z``.

    Z is the P impedance of the ground, f the middle of the band; there a joint in it passes 0.71.
    """
    band, rock = project.config.band_hz, project.materials[material]
    assert band is not None  # a case has one
    kn = stiffness * math.pi * math.sqrt(band[0] * band[1]) * rock.density * rock.cp
    return {"kn": kn, "ks": kn / ratio}


def with_joint(project: Project, side: str, stiffness: float, ratio: float) -> Project:
    """Return a project with a joint at a side of its body.

    Under a layer what the model has beneath stays; elsewhere ground like that of the side goes on
    beyond the joint.
    """
    mesh, (origin, size) = project.config.mesh, _box(project)
    through = origin + 0.5 * size
    if side.startswith(UNDER):
        material = side.removeprefix(UNDER)
        through[2] = origin[2] + size[2] - _depth_under(project, material)
        dip, direction = 0.0, 0.0
    else:
        axis, sign = OUTWARD[side]
        material = mesh.layers[-1 if axis == 2 else 0].material
        through[axis] += 0.5 * sign * size[axis]
        dip = 0.0 if axis == 2 else 90.0
        direction = 90.0 if axis == 0 else 0.0
        mesh = _wider(project, axis, sign)
        sides = _moved(project.config.boundaries, side, "viscous")
        project = project.changed(boundaries=sides)
    springs = _springs(project, material, stiffness, ratio)
    name = f"joint {side}"
    fault = FaultConfig(
        name=name, dip_deg=dip, dip_direction_deg=direction, through_m=through.tolist()
    )
    mesh = mesh.model_copy(update={"faults": [*mesh.faults, fault]})
    joint = Joint(name, "elastic", springs)
    return project.changed(mesh=mesh, joints=(*project.joints, joint))


def _wider(project, axis, sign):
    """Return the `MeshConfig` of a box that goes on beyond a side."""
    mesh, band = project.config.mesh, project.config.band_hz
    assert band is not None  # a case has one
    used = [project.materials[layer.material].cs for layer in mesh.layers]
    width = BEYOND * max(used) / band[0]
    origin, size = _box(project)
    whole = float(size[2])
    size[axis] += width
    if sign < 0:
        origin[axis] -= width
    layers = mesh.layers
    if axis == 2 and layers[-1].thickness_m is None:
        rest = whole - sum(layer.thickness_m for layer in layers[:-1])
        layers = [*layers[:-1], layers[-1].model_copy(update={"thickness_m": float(rest)})]
    elif axis != 2:
        return mesh.model_copy(update={"size_m": size.tolist(), "origin_m": origin.tolist()})
    layers = [*layers, layers[-1].model_copy(update={"thickness_m": None})]
    update = {"size_m": size.tolist(), "origin_m": origin.tolist(), "layers": layers}
    return mesh.model_copy(update=update)


def _enter(kind, claim):
    """Enter a kind of side into the library."""

    def apply(project: Project, target):
        return with_kind(project, target, kind)

    apply.__doc__ = claim
    hypothesis(
        "side",
        form=kind,
        family="path",
        on="site",
        target="side",
        targets=of_body,
        axis="both",
        parameters=[],
        decided_by="a look at what touches this side, or a receiver on it",
        simulated=(bounded, remeshable),
    )(apply)


_enter("free", "Nothing touches this side of the body.")
_enter("roller", "This side of the body stands on something stiff along which it slides.")
_enter("fixed", "This side of the body is held by something stiff.")
_enter("viscous", "This side of the body passes waves into ground like its own.")


@hypothesis(
    "side",
    form="joint",
    family="path",
    on="site",
    target="side",
    targets=of_body,
    axis="both",
    decided_by="a look at what touches this side, or a receiver on it",
    simulated=(bounded, remeshable),
)
def touching_side(project: Project, target, stiffness, ratio):
    """This side of the body touches what lies beyond through a joint."""
    return with_joint(project, target, stiffness, ratio)
