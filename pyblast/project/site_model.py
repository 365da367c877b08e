"""Sites as models: ground cut into cells that grow outside the box, and damped out there."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..mesh.builder import Layer, structured_box
from ..mesh.grid import GROWTH, graded_axis
from ..mesh.mesh import Mesh
from ..model.boundary import Viscous
from ..model.material import ConstantQ
from ..model.model import Model, Rim
from ..model.source import Hole
from .site import Site

BEYOND_BAND = 3.0  # how far beyond the band of the records, both ways, a quality factor holds


@dataclass(frozen=True)
class Cut:
    """How the ground of a site is cut into zones.

    Parameters
    ----------
    edge : float, m
        Of the cells inside the box.
    padding : float, m
        How far the ground goes on beyond the sides and the bottom.
    growth : float
        Of each cell over the one before it, out there.
    quadratic : bool
        Zones of 15 nodes, in cells cut around their centres.
    single : bool
        March in numbers of four bytes.

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
        """Refuse what cuts nothing."""
        for name, unit in (("edge", " m"), ("padding", " m")):
            if not 0.0 < getattr(self, name) < np.inf:
                raise InputError(f"cut.{name}: must be positive, got {getattr(self, name):g}{unit}")
        if not 1.0 <= self.growth <= 2.0:
            raise InputError(f"cut.growth: must lie in 1 to 2, got {self.growth:g}")

    @property
    def pattern(self):
        """How cells are cut, as of `structured_box`."""
        return "centred" if self.quadratic else "alternating"

    @property
    def spread(self):
        """Radius in m over which each hole is spread: the distance of nodes."""
        return 0.5 * self.edge if self.quadratic else self.edge

    def of(self, site: Site):
        """Return the cut that a site needs: a fabric has no zones but those of constant strain.

        Of a third of the length, which cost about as much.
        """
        plain = site.fabric is not None and self.quadratic
        if not plain:
            return self
        return replace(self, edge=self.edge / 3.0, quadratic=False, single=False)


def site_mesh(site: Site, cut: Cut) -> Mesh:
    """Mesh the ground of a site, with its joints split."""
    cut = cut.of(site)
    every = [*((j.axis, j.position) for j in site.joints), *site.marks]
    planes = {axis: [place for along, place in every if along == axis] for axis in "xy"}
    rims = {axis: [j.extent for j in site.joints if j.axis != axis] for axis in "xy"}
    depths = [(-j.depth[0], -j.depth[1]) for j in site.joints]
    heights = -np.cumsum([t for _, t, _ in site.layers[:-1]])
    axes = [
        _axis(site.box[0], planes["x"], rims["x"], cut, cut.padding),
        _axis(site.box[1], planes["y"], rims["y"], cut, cut.padding),
        _axis(site.box[2], heights, depths, cut, 0.0),
    ]
    layers = [Layer(name, thickness) for name, thickness, _ in site.layers]
    joints = {j.joint.surface: (j.axis, j.position) for j in site.joints}
    mesh = structured_box(*axes, layers=layers, planes=joints, pattern=cut.pattern)
    surfaces = dict(mesh.surfaces)
    for j in site.joints:
        faces = surfaces[j.joint.surface]
        centre = mesh.points[faces].mean(axis=1)
        along = centre[:, 1 if j.axis == "x" else 0]
        inside = (along > j.extent[0]) & (along < j.extent[1])
        inside &= (-centre[:, 2] > j.depth[0]) & (-centre[:, 2] < j.depth[1])
        if not np.any(inside):
            raise InputError(
                f"joints.{j.joint.surface}: is too small for cells of {cut.edge:.3g} m; extend it, "
                "or leave it out"
            )
        surfaces[j.joint.surface] = faces[inside]
    return replace(mesh, surfaces=surfaces).split([j.joint.surface for j in site.joints])


def _axis(limits, planes, rims, cut, after):
    """Return the grid along an axis; ends of joints and of the box give way to what is near.

    Planes are kept. Rims, the two ends of each joint, are left out where something else is nearer
    than half a cell and half the shortest joint, so that the joint ends there, and ends of the box
    likewise.
    """
    kept = sorted({float(p) for p in planes if limits[0] < p < limits[1]})
    ends = list(limits)
    lengths = [float(np.ptp(np.clip(pair, *limits))) for pair in rims]
    near = 0.5 * min([cut.edge, *(length for length in lengths if length > 0.0)])
    if not after:
        kept.append(float(ends.pop()))
    for rim in (end for pair in rims for end in pair):
        if limits[0] < rim < limits[1] and _apart(rim, kept, near):
            kept.append(float(rim))
    stops = sorted(kept + [float(end) for end in ends if _apart(end, kept, near)])
    return graded_axis((stops[0], stops[-1]), stops, cut.edge, cut.padding, after, cut.growth)


def _apart(place, others, near):
    """Tell whether a place is at least so far in m away from others."""
    return all(abs(place - other) >= near for other in others)


def site_model(site: Site, blast: str, cut: Cut, mesh: Mesh | None = None) -> Model:
    """Model one blast of a site with its holes as isotropic sources, but for misfires (charge 0).

    Parameters
    ----------
    site : Site
    blast : str
    cut : Cut
    mesh : Mesh, optional
        That of `site_mesh`, if it is there already.
    """
    holes, cut = site.blasts[blast], cut.of(site)
    sources = [
        Hole(place, charge, time, site.moment_rate, site.exponent, cut.spread)
        for place, charge, time in zip(holes.centres, holes.charge, holes.times, strict=True)
        if charge > 0.0
    ]
    materials = {name: material for name, _, material in site.layers}
    if site.fabric is not None:
        materials = {name: site.fabric.of(material) for name, material in materials.items()}
    if site.quality is not None:
        low, high = site.band
        law = ConstantQ(*site.quality, (low / BEYOND_BAND, high * BEYOND_BAND))
        materials = {name: replace(m, law=law) for name, m in materials.items()}
    return Model(
        site_mesh(site, cut) if mesh is None else mesh,
        materials,
        joints=[j.joint for j in site.joints],
        boundaries=[Viscous(side) for side in ("west", "east", "south", "north", "bottom")],
        rim=Rim(tuple(map(tuple, site.box)), cut.padding, site.band[0]),
        sources=sources,
        receivers=site.receivers,
        ground=site.ground,
        quadratic=cut.quadratic,
        single=cut.single,
    )
