"""Flat boxes in cells of tetrahedra that grow outwards: their meshes and models."""

from dataclasses import dataclass, replace

import numpy as np

from pyblast.errors import InputError
from pyblast.ground.tables import is_anisotropic
from pyblast.mesh.builder import Layer, structured_box
from pyblast.mesh.grid import GROWTH, graded_axis
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import Viscous
from pyblast.model.material import ConstantQ
from pyblast.model.model import Model, SpongeLayer
from pyblast.model.source import Hole
from pyblast.project.places import axis_limits, make_absorbing_layer
from pyblast.project.project import Project

OUTER = "west", "east", "south", "north", "bottom"


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


@dataclass(frozen=True)
class Discretization:
    """Discretization of a flat box: edge length, padding, element.

    Parameters
    ----------
    edge : float, m
        Of the cells inside the box.
    padding : float, m
        Width of the ground beyond the sides and the bottom.
    growth : float
        Ratio of neighbouring cells in the padding.
    quadratic : bool
        Zones of 15 nodes, in cells cut around their centres.
    single : bool
        Run in single precision.

    Raises
    ------
    InputError
        If a length is not positive or cells shrink.
    """

    edge: float
    padding: float = 220.0
    growth: float = GROWTH
    quadratic: bool = False
    single: bool = False

    def __post_init__(self):
        """Refuse lengths and growth out of range."""
        for name, unit in (("edge", " m"), ("padding", " m")):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"cut.{name}: must be positive, got {getattr(self, name):g}{unit}")
        if not 1.0 <= self.growth <= 2.0:
            raise InputError(f"cut.growth: must lie in 1 to 2, got {self.growth:g}")

    @property
    def pattern(self):
        """Pattern of tetrahedra in a cell, as in `structured_box`."""
        return "centred" if self.quadratic else "alternating"

    @property
    def spread(self):
        """Radius in m over which each hole is spread: the spacing of the nodes."""
        return 0.5 * self.edge if self.quadratic else self.edge

    def of(self, materials):
        """Return the discretization for materials.

        Anisotropic materials need constant-strain zones: edges of a third cost about as much.
        """
        if not (self.quadratic and is_anisotropic(materials)):
            return self
        return replace(self, edge=self.edge / 3.0, quadratic=False, single=False)


def flat_box(project: Project) -> FlatBox:
    """Return the geometry of a project that is a flat box, see `not_flat` of the library."""
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


def flat_mesh(ground: FlatBox, cut: Discretization) -> Mesh:
    """Mesh a flat box and split it along its joints; cells grow outside of the box."""
    jointed = [plane for plane in ground.planes if plane.jointed]
    every = [*jointed, *(plane for plane in ground.planes if not plane.jointed)]
    planes = {axis: [plane.position for plane in every if plane.axis == axis] for axis in "xy"}
    extents = {axis: [joint.extent for joint in jointed if joint.axis != axis] for axis in "xy"}
    depths = [(-joint.depth[0], -joint.depth[1]) for joint in jointed]
    heights = -np.cumsum(np.array([thickness for _, thickness in ground.layers[:-1]], dtype=float))
    below = ground.box[2] - ground.top
    axes = [
        _axis(ground.box[0], planes["x"], extents["x"], cut, cut.padding),
        _axis(ground.box[1], planes["y"], extents["y"], cut, cut.padding),
        _axis(below, heights, depths, cut, 0.0),
    ]
    layers = [Layer(name, thickness) for name, thickness in ground.layers]
    joints = {joint.name: (joint.axis, joint.position) for joint in jointed}
    mesh = structured_box(*axes, layers=layers, planes=joints, pattern=cut.pattern)
    surfaces = dict(mesh.surfaces)
    for joint in jointed:
        faces = surfaces[joint.name]
        centre = mesh.points[faces].mean(axis=1)
        along = centre[:, 1 if joint.axis == "x" else 0]
        inside = (along > joint.extent[0]) & (along < joint.extent[1])
        inside &= (-centre[:, 2] > joint.depth[0]) & (-centre[:, 2] < joint.depth[1])
        if not np.any(inside):
            raise InputError(
                f"joints.{joint.name}: is too small for cells of {cut.edge:.3g} m; extend it, or "
                "leave it out"
            )
        surfaces[joint.name] = faces[inside]
    points = mesh.points
    if ground.top:
        points = points + np.array([0.0, 0.0, ground.top])
    return replace(mesh, points=points, surfaces=surfaces).split([joint.name for joint in jointed])


def _axis(limits, planes, extents, cut, after):
    """Return the grid along an axis that aligns with planes, joint ends and box ends.

    Planes are always aligned. The two ends of a joint, and the ends of the box, are left out where
    something else is nearer than half a cell and half the shortest joint, which they then join.
    """
    stops = sorted({float(p) for p in planes if limits[0] < p < limits[1]})
    ends = list(limits)
    lengths = [float(np.ptp(np.clip(pair, *limits))) for pair in extents]
    near = 0.5 * min([cut.edge, *(length for length in lengths if length > 0.0)])
    if not after:
        stops.append(float(ends.pop()))
    for end in (end for pair in extents for end in pair):
        if limits[0] < end < limits[1] and _apart(end, stops, near):
            stops.append(float(end))
    stops = sorted(stops + [float(end) for end in ends if _apart(end, stops, near)])
    return graded_axis((stops[0], stops[-1]), stops, cut.edge, cut.padding, after, cut.growth)


def _apart(position, others, near):
    """Return whether a position is at least a distance in m away from others."""
    return all(abs(position - other) >= near for other in others)


def flat_model(
    project: Project, blast: str, cut: Discretization, mesh: Mesh | None = None
) -> Model:
    """Make the model of one blast in a flat box: its charged holes are isotropic sources.

    Parameters
    ----------
    project : Project
        A flat box.
    blast : str
    cut : Discretization
    mesh : Mesh, optional
        That of `flat_mesh`, made if not given.
    """
    ground, own, band = flat_box(project), project.of(blast), project.config.band_hz
    names = [name for name, _ in ground.layers]
    materials = {name: _in_band(project.materials[name], band) for name in names}
    cut, rate = cut.of(materials), own.inside.moment_rate
    holes, exponent = own.blast, _charge_exponent(own.config)
    sources = [
        Hole(centre, charge, time, rate, exponent, cut.spread)
        for centre, charge, time in zip(holes.centres, holes.charge, holes.times, strict=True)
        if charge > 0.0
    ]
    return Model(
        flat_mesh(ground, cut) if mesh is None else mesh,
        materials,
        joints=project.joints,
        boundaries=tuple(Viscous(side) for side in OUTER),
        sponge=SpongeLayer(axis_limits(ground.box), cut.padding, None if band is None else band[0]),
        sources=tuple(sources),
        receivers=own.receivers,
        ground=project.fields,
        quadratic=cut.quadratic,
        single=cut.single,
    )


def _charge_exponent(config):
    """Return the charge exponent of the moment of the holes."""
    return 1.0 if config.blast is None else config.blast.charge_exponent


def _in_band(material, band):
    """Return a material whose quality factors cover a band in Hz."""
    if not isinstance(material.law, ConstantQ):
        return material
    return replace(material, law=ConstantQ.around(material.law.qp, material.law.qs, band))
