"""Flat boxes: ground of flat layers with vertical joints, its mesh and its models."""

from dataclasses import dataclass

import numpy as np

from ..blasts.blast import Blast
from ..config.section import value_at
from ..errors import InputError
from ..mesh.block_cutter import SIDES
from ..model.material import ConstantQ, Material
from ..model.model import Receiver
from .places import make_absorbing_layer
from .project import Project

BEYOND_BAND = 3.0  # factor by which the band of constant Q exceeds that of the records, both ways
SPEEDS = 30.0, 10_000.0  # m/s, of waves in ground
EARLY = 1e-3  # share of its peak that a moment rate may reach before its hole fires
NEAR = 1e-6  # m, tolerance for positions outside of the box
OUTER = "west", "east", "south", "north", "bottom"

# Keys that a flat box excludes, with the reason.
OTHER = {
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
OF_MATERIALS = {
    "damping": "is damping of one frequency",
    "yielding": "makes ground that yields",
    "hoek_brown": "makes ground that yields",
    "ubiquitous": "makes ground that slips",
    "transverse": "makes ground stiffer in some directions",
    "joints": "makes ground stiffer in some directions",
}


@dataclass(frozen=True)
class Plane:
    """Vertical plane ``axis`` = ``position`` between zones, unbounded or a rectangle.

    Parameters
    ----------
    name : str
    axis : str
        "x" or "y".
    position : float, m
    extent : tuple of 2 float, m
        Along the other horizontal axis.
    depth : tuple of 2 float, m
        Below the ground, positive down.
    jointed : bool
        Whether the plane is a joint; otherwise it only aligns the mesh.
    """

    name: str
    axis: str
    position: float
    extent: tuple[float, float] = (-np.inf, np.inf)
    depth: tuple[float, float] = (-np.inf, np.inf)
    jointed: bool = True


@dataclass(frozen=True, eq=False)
class FlatBox:
    """Flat box: geometry of flat layers with vertical joints.

    Parameters
    ----------
    box : (3, 2) float64, m
        The top is the free surface; padding continues beyond sides and bottom.
    layers : tuple of (name, thickness m or None)
        From the top down.
    planes : tuple of Plane
    """

    box: np.ndarray
    layers: tuple[tuple[str, float | None], ...]
    planes: tuple[Plane, ...] = ()

    @property
    def top(self) -> float:
        """Height of the ground, m."""
        return float(self.box[2, 1])


def is_anisotropic(materials: dict[str, Material]) -> bool:
    """Return whether a material is anisotropic."""
    return any(material.law.name == "anisotropic" for material in materials.values())


def not_flat(project: Project) -> str:
    """Return why the ground of a project is not a flat box with holes inside; empty if it is.

    A flat box has flat layers of different isotropic elastic materials, with or without quality
    factors, elastic joints on vertical planes along x or y, holes as points inside, and viscous
    sides and bottom.
    """
    configs = (each.config for each in (project, *project.further))
    return next(filter(None, (_not_flat(config, project) for config in configs)), "")


def _not_flat(config, project):
    """Return why one project is not a flat box."""
    for key, what in OTHER.items():
        if value_at(config, key):
            return f"{key} {what}"
    if config.holes_inside is None:
        return "holes_inside is missing"
    for side in OUTER:
        if side not in config.boundaries.viscous:
            return f"boundaries.viscous lacks {side!r}"
    for name, material in config.materials.items():
        for key, what in OF_MATERIALS.items():
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
    rate = project.inside.moment_rate
    if rate is not None and moment_begins(rate) < 0.0:
        return "the moment rate of holes_inside begins before a hole fires"
    return ""


def band_of(config) -> tuple[float, float] | None:
    """Return the band in Hz that a `Config` compares, None where it gives none."""
    band = (config.diagnosis and config.diagnosis.band_hz) or config.run.compare_band_hz
    return None if band is None else (band[0], band[1])


def flat_box(project: Project) -> FlatBox:
    """Return the geometry of a project that is a flat box, see `not_flat`."""
    mesh = project.config.mesh
    low = np.array(mesh.origin_m)
    box = np.column_stack([low, low + mesh.size_m])
    top, layer = box[2, 1], make_absorbing_layer(project.config)
    if layer is not None:
        box = np.array(layer.box, dtype=float)
    box[2, 1] = top
    thicknesses = [*(layer.thickness_m for layer in mesh.layers[:-1]), None]
    names = [layer.material for layer in mesh.layers]
    jointed = {joint.surface for joint in project.joints}
    planes = tuple(_plane(fault, float(top), fault.name in jointed) for fault in mesh.faults)
    return FlatBox(box, tuple(zip(names, thicknesses, strict=True)), planes)


def _plane(fault, top, jointed):
    """Return a vertical fault as a plane."""
    axis, (x, y, z) = ("y" if fault.dip_direction_deg % 180.0 == 0.0 else "x"), fault.through_m
    position, middle = (x, y) if axis == "x" else (y, x)
    if fault.extent_m is None:
        return Plane(fault.name, axis, float(position), jointed=jointed)
    along, down = (0.5 * length for length in fault.extent_m)
    depth = top - z
    return Plane(
        fault.name, axis, float(position), (middle - along, middle + along),
        (depth - down, depth + down), jointed,
    )  # fmt: skip


def constant_q(qp, qs, band) -> ConstantQ:
    """Return quality factors that are constant from a third to three times a band in Hz."""
    return ConstantQ(qp, qs, (band[0] / BEYOND_BAND, band[1] * BEYOND_BAND))


def quality_of(project: Project) -> tuple[float, float] | None:
    """Return the first pair Qp, Qs of the materials of a project, None where none has one."""
    laws = [material.law for material in project.materials.values()]
    return next(((law.qp, law.qs) for law in laws if isinstance(law, ConstantQ)), None)


def moment_begins(rate) -> float:
    """Return the time in s at which a moment rate begins."""
    size = np.abs(rate.values)
    return float(rate.start + rate.dt * np.argmax(size > EARLY * np.max(size)))


def place_in_box(parts, ground: FlatBox) -> tuple[Receiver, ...]:
    """Turn a list of `ReceiverConfig` into receivers; those without height stand on the ground."""
    positions = [(*part.position_m, ground.top)[:3] for part in parts]
    return tuple(
        Receiver(
            part.name, (float(x), float(y), float(z)),
            None if part.azimuth_deg is None else float(np.radians(part.azimuth_deg)),
            None if part.normal is None else tuple(part.normal),
        )
        for part, (x, y, z) in zip(parts, positions, strict=True)
    )  # fmt: skip


def check_flat(project: Project):
    """Refuse an inconsistent flat box; the message names the part.

    Raises
    ------
    InputError
    """
    ground = flat_box(project)
    if not np.all(ground.box[:, 0] < ground.box[:, 1]):
        raise InputError(f"box: each axis must go from low to high, got {ground.box.tolist()}")
    _check_thicknesses(ground)
    for name, _ in ground.layers:
        rock = project.materials[name]
        if not SPEEDS[0] <= rock.cs < rock.cp <= SPEEDS[1]:
            raise InputError(
                f"layers.{name}: speeds must lie in {SPEEDS[0]:g} to {SPEEDS[1]:g} m/s, "
                f"got vp {rock.cp:g}, vs {rock.cs:g}"
            )
    for plane in ground.planes:
        if plane.name in SIDES:
            raise InputError(f"joints.{plane.name}: is a side of the box; take another name")
        refuse_beyond(plane.name, plane.position, ground.box["xy".index(plane.axis)])
        _check_extents(ground, plane)
    for receiver in project.receivers:
        refuse_outside_box(ground.box, f"receivers.{receiver.name}", receiver.position)
    for name, blast in project.blasts.items():
        check_holes(ground.box, name, blast)


def refuse_beyond(name, position, sides):
    """Refuse an upright joint that does not lie between two sides of the box (2,) in m."""
    if not sides[0] < position < sides[1]:
        raise InputError(
            f"joints.{name}.position: must lie within the box, {sides[0]:g} to {sides[1]:g} m, "
            f"got {position:g}"
        )


def _check_thicknesses(ground):
    """Refuse layers that do not fit the height of the box; the last fills the rest."""
    top, bottom = 0.0, ground.box[2, 0] - ground.box[2, 1]
    for name, thickness in ground.layers[:-1]:
        if thickness is None or not thickness > 0.0:
            raise InputError(f"layers.{name}.thickness_m: must be positive, got {thickness}")
        top -= thickness
        if top <= bottom:
            raise InputError(
                f"layers.{name}: ends {-top:g} m below the ground, at or below the bottom of the "
                f"box at {-bottom:g} m; leave out the layers below it, or give a deeper box"
            )


def _check_extents(ground, plane):
    """Refuse a `Plane` no part of which lies in the box."""
    box = ground.box
    along, down = box["yx".index(plane.axis)], ground.top - box[2, ::-1]
    for name, part, limits in (("extent", plane.extent, along), ("depth", plane.depth, down)):
        low, high = np.clip(part, *limits)
        if not low < high:
            raise InputError(
                f"joints.{plane.name}.{name}: must go from low to high and reach into the box, "
                f"{limits[0]:g} to {limits[1]:g} m, got {part[0]:g} to {part[1]:g}"
            )


def check_holes(box, name, blast: Blast):
    """Refuse a blast with a hole outside of a box (3, 2) m or of unknown charge."""
    for hole, centre, charge in zip(blast.hole_ids, blast.centres, blast.charge, strict=True):
        refuse_outside_box(box, f"{name}: hole {hole}", centre)
        if np.isnan(charge):
            raise InputError(f"{name}: hole {hole}: its charge is missing; give kg, 0 for a dud")
    if not np.any(blast.charge > 0.0):
        raise InputError(f"{name}: no hole has a charge")


def refuse_outside_box(box, name, position):
    """Refuse a position in m outside of a box (3, 2) m; the message begins with a name."""
    low, high = np.array(box).T
    if not (np.all(np.array(position) >= low - NEAR) and np.all(np.array(position) <= high + NEAR)):
        raise InputError(f"{name}: lies outside of the box of the ground; move it into it")


def extent_of(project: Project) -> np.ndarray:
    """Return the box (3, 2) in m of the ground of a project without padding or absorbing layer."""
    if not not_flat(project):
        return flat_box(project).box
    mesh, layer = project.config.mesh, make_absorbing_layer(project.config)
    if layer is not None:
        return np.array(layer.box, dtype=float)
    if mesh.size_m is not None:
        low = np.array(mesh.origin_m)
        return np.column_stack([low, low + mesh.size_m])
    points = project.mesh.points
    return np.column_stack([points.min(axis=0), points.max(axis=0)])


def ground_materials(project: Project) -> list[str]:
    """Return the names of the materials in the ground, layers from the top down."""
    layers = [layer.material for layer in project.config.mesh.layers]
    return list(dict.fromkeys(layers or project.mesh.groups))
