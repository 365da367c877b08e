"""Model: mesh, materials, joints, boundaries, sources and receivers of a run."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..mesh.mesh import Mesh, zone_edge_lengths, zone_volumes
from ..mesh.nodes import Nodes, make_patches, nodes_of, renumbered
from ..mesh.spectral_nodes import SpectralNodes, View, spectral_nodes, view
from ..signals.seismogram import Seismogram
from ..units import check_angle
from .boundary import Boundary, SpongeLayer, StressInput, Viscous, check_boundaries
from .ground_fields import GroundField
from .joint import Joint
from .material import Branch, Damping, Material, ZoneLaw
from .source import Column, Hole, MomentTensor, PointForce, Source
from .thin_layers import carried_by_thin_layers, nearest_receiver

HEX_NODES = 5.0  # of hexahedra per S wavelength, for an error of about one per cent


@dataclass(frozen=True)
class Receiver:
    """Receiver: a place at which the motion is recorded.

    Parameters
    ----------
    name : str
    position : (3,) float, m
        Of two numbers where it stands on the ground, until it is placed in a mesh.
    azimuth : float or None, rad
        Direction of the longitudinal component, clockwise from north; None: east and north.
    normal : (3,) float or None
        Unit vector along which alone it measures: its motion is what lies along this direction.

    Raises
    ------
    InputError
        If the azimuth is in degrees, both are given, or the normal has no length.
    """

    name: str
    position: tuple[float, ...]
    azimuth: float | None = None
    normal: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Check the azimuth, and make the normal a unit vector."""
        if self.azimuth is not None:
            check_angle(f"receiver {self.name!r}.azimuth", self.azimuth)
        if self.normal is None:
            return
        length = float(np.linalg.norm(self.normal))
        if self.azimuth is not None or len(self.normal) != 3 or not 0.0 < length < np.inf:
            raise InputError(
                f"receiver {self.name!r}.normal: must be three numbers that are not all zero, "
                f"without azimuth, got {self.normal}"
            )
        unit = tuple(float(each / length) for each in self.normal)
        object.__setattr__(self, "normal", unit)

    def measured(self, motion: Seismogram) -> Seismogram:
        """Return a motion along east, north and vertical as this receiver measures it."""
        if self.normal is not None:
            return motion.along(self.normal)
        return motion if self.azimuth is None else motion.rotated(self.azimuth)


@dataclass(frozen=True)
class InSitu:
    """In-situ stress: overburden, ratio of horizontal to vertical stress, uniform stress.

    Parameters
    ----------
    gravity : float, m/s2
    horizontal_ratio : float
        Both horizontal stresses over the vertical one.
    stress : tuple of 6 float, Pa
        Uniform stress in addition to the overburden: xx yy zz yz zx xy, tension positive.
    water_table : float or None, m
        Height below which water under hydrostatic pressure fills joints and pores; None: dry.
        Overburden and uniform stress are total; joints and ground slip, open and yield by the
        effective stress, total plus pressure (tension positive). The pressure stays as it is
        during the run.
    water_density : float, kg/m3

    Raises
    ------
    InputError
        If the stress is not six finite numbers, the height is not finite, or gravity, the ratio
        or the density is negative.
    """

    gravity: float = 9.81
    horizontal_ratio: float = 0.5
    stress: tuple[float, ...] = (0.0,) * 6
    water_table: float | None = None
    water_density: float = 1000.0

    def __post_init__(self) -> None:
        """Check gravity, ratio, stress and water."""
        if self.water_table is not None and not np.isfinite(self.water_table):
            raise InputError(f"insitu.water_table: must be finite, got {self.water_table} m")
        numbers = ("gravity", " m/s2"), ("horizontal_ratio", ""), ("water_density", " kg/m3")
        for name, unit in numbers:
            value = getattr(self, name)
            if not 0.0 <= value < np.inf:
                raise InputError(f"insitu.{name}: must not be negative, got {value:g}{unit}")
        object.__setattr__(self, "stress", tuple(map(float, self.stress)))
        if len(self.stress) != 6 or not np.isfinite(self.stress).all():
            raise InputError(
                f"insitu.stress: must be six finite numbers xx yy zz yz zx xy, got {self.stress}"
            )

    def pore_pressure(self, height: np.ndarray) -> np.ndarray:
        """Return the pressure (n,) in Pa of the water at heights (n,) in m."""
        height = np.asarray(height, dtype=float)
        if self.water_table is None:
            return np.zeros_like(height)
        return self.water_density * self.gravity * np.maximum(self.water_table - height, 0.0)


@dataclass(frozen=True, eq=False)
class Model:
    """Model: mesh, materials, joints, boundaries, sources and receivers.

    Parameters
    ----------
    mesh : Mesh
        Split along the surfaces of ``joints``; it is renumbered along a space-filling curve.
    materials : dict of str to Material
        One for each group of the mesh.
    joints : sequence of Joint
    boundaries : sequence of boundary conditions
    damping : Damping or dict of str to Damping, optional
    sources : sequence of Source
        `Hole`, `Column`, `PointForce`, `MomentTensor`, `Pressure`, `AirBlast` or `PlaneWave`.
    receivers : sequence of Receiver
    sponge : SpongeLayer, optional
        Damped ground around a model of tetrahedra.
    ground : sequence of Gradient, DamagedZone, Body or Heterogeneity
        Fields of factors on the wave speeds.
    insitu : InSitu, optional
        In-situ stress; a static stage then precedes the dynamic one.
    step_factor : float
        Time step over the critical one.
    quadratic : bool
        Tetrahedra of 15 nodes instead of 4, which need 2 to 3 edges per wavelength instead of 10.
        Linear isotropic ground only, joints of any law; theory.md (2.33) to (2.38).
    injected : bool
        Whether explosions enter as the field of a half-space at the boundary of a patch of
        elements around them; theory.md (5.25). Only in hexahedra, see `solver.injection.patch_of`.
    single : bool
        Single precision: a third faster, accurate to about 1e-4 of the peak motion.
    local_damping : float
        Fraction of the unbalanced force on each node that opposes its motion (Cundall). Only for
        quasi-static loading, without waves: 0.8 converges fastest.

    Raises
    ------
    InputError
        If parts are inconsistent; the message names the part.

    Examples
    --------
    >>> from pyblast.mesh.builder import structured_box
    >>> mesh = structured_box((4, 4, 4), (40.0, 40.0, 40.0))
    >>> rock = Material.from_speeds(2700.0, 5000.0, 3000.0)
    >>> model = Model(mesh, {"rock": rock}, boundaries=[Viscous("bottom")])
    >>> round(float(model.highest_frequency()["rock"]), 1)
    23.8
    """

    mesh: Mesh
    materials: dict[str, Material]
    joints: tuple[Joint, ...] = ()
    boundaries: tuple[Boundary, ...] = ()
    damping: Damping | dict[str, Damping] | None = None
    sources: tuple[Source, ...] = ()
    receivers: tuple[Receiver, ...] = ()
    sponge: SpongeLayer | None = None
    ground: tuple[GroundField, ...] = ()
    insitu: InSitu | None = None
    step_factor: float = 0.8
    local_damping: float = 0.0
    quadratic: bool = False
    single: bool = False
    injected: bool = False
    _ordered: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        """Check the parts; renumber nodes and zones for locality in memory."""
        for name in ("joints", "boundaries", "sources", "receivers", "ground"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        self._check_materials()
        self._check_joints()
        check_boundaries(self.boundaries, self.mesh)
        if len({r.name for r in self.receivers}) < len(self.receivers):
            raise InputError("receivers: two receivers have the same name; rename one")
        if not 0.0 < self.step_factor <= 1.0:
            raise InputError(f"step_factor: must lie in 0 to 1, got {self.step_factor:g}")
        if not 0.0 <= self.local_damping < 1.0:
            raise InputError(f"local_damping: must lie in 0 to 1, got {self.local_damping:g}")
        if not self._ordered:
            patch = self.patches() if self.yielding().any() else None
            object.__setattr__(self, "mesh", renumbered(self.mesh, patch))
            object.__setattr__(self, "_ordered", True)

    @property
    def nodes(self) -> Nodes | SpectralNodes:
        """Nodes of the zones: linear or quadratic tetrahedra, or spectral hexahedra."""
        return self.spectral if self.mesh.hexahedral else self.tetrahedral

    @cached_property
    def spectral(self) -> SpectralNodes:
        """Nodes of a mesh of hexahedra."""
        return spectral_nodes(self.mesh)

    @cached_property
    def tetrahedral(self) -> Nodes:
        """Nodes of a mesh of tetrahedra, linear or quadratic."""
        return nodes_of(self.mesh, self.quadratic)

    @cached_property
    def shown(self) -> View:
        """Tetrahedra that show the model in figures and files."""
        return view(self.mesh, self.nodes.zone_nodes)

    def _check_materials(self):
        """Check that every group has a material valid for its law, and its damping."""
        for group in self.mesh.groups:
            if group not in self.materials:
                raise InputError(f"materials.{group}: missing; the mesh has a group of that name")
            if isinstance(self.damping, dict) and group not in self.damping:
                raise InputError(f"damping.{group}: missing; the mesh has a group of that name")
            self.law(group).properties(self.materials[group])
            if self.mesh.hexahedral and self.law(group).name != "elastic":
                raise InputError(
                    f"mesh: zones of '{group}' follow the law '{self.law(group).name}', which "
                    "hexahedra do not have; use a mesh of tetrahedra"
                )
            if self.quadratic and self.law(group).name != "elastic":
                raise InputError(
                    f"model.quadratic: zones of '{group}' follow the law '{self.law(group).name}', "
                    "which needs zones of constant strain; leave quadratic out"
                )

    def _check_joints(self):
        """Check that joints and split surfaces are the same set."""
        split = self.mesh.contacts.names if self.mesh.contacts is not None else ()
        surfaces = [joint.surface for joint in self.joints]
        for name in surfaces:
            if name not in split or surfaces.count(name) > 1:
                raise InputError(
                    f"joints.{name}: must be one split surface of the mesh, split are "
                    f"{', '.join(split) or 'none'}"
                )
        for name in split:
            if name not in surfaces:
                raise InputError(f"joints.{name}: the mesh is split there, but no joint is given")

    @property
    def numbered_joints(self) -> list[Joint]:
        """Joints in the order of the contacts' numbers."""
        table = {joint.surface: joint for joint in self.joints}
        split = self.mesh.contacts.names if self.mesh.contacts is not None else ()
        return [table[name] for name in split]

    def with_joint(self, surface: str, **properties: float) -> "Model":
        """Return the model with changed properties (SI) of one joint."""
        joints = tuple(
            replace(j, properties={**j.properties, **properties}) if j.surface == surface else j
            for j in self.joints
        )
        return replace(self, joints=joints)

    def zone_values(self, name: str) -> np.ndarray:
        """Return a property of the materials for every zone, (n_zones,) float64."""
        values = [float(getattr(self.materials[group], name)) for group in self.mesh.groups]
        power = {"density": 0.0, "cp": 1.0, "cs": 1.0}.get(name, 2.0)
        return np.array(values)[self.mesh.zone_group] * self.speed_factor**power

    @cached_property
    def speed_factor(self) -> np.ndarray:
        """Factor of the ground fields on the wave speeds, (n_zones,) or a scalar 1."""
        if not self.ground:
            return np.float64(1.0)  # pyright: ignore[reportReturnType]
        centres = self.mesh.points[self.mesh.zones].mean(axis=1)
        edges = zone_edge_lengths(self.mesh).mean(axis=1)
        return np.prod([field.factor(centres, edges) for field in self.ground], axis=0)

    def speed_factor_at(self, places: np.ndarray, zone: np.ndarray) -> np.ndarray:
        """Return the factor (n,) on the wave speeds at places (n, 3) of zones (n,).

        In hexahedra it varies from node to node, in tetrahedra from zone to zone.
        """
        if not self.ground or not self.mesh.hexahedral:
            return np.broadcast_to(self.speed_factor, len(self.mesh.zones))[zone]
        edges = (zone_edge_lengths(self.mesh).mean(axis=1) / self.mesh.order)[zone]
        return np.prod([field.factor(places, edges) for field in self.ground], axis=0)

    def law(self, group: str) -> ZoneLaw:
        """Return the constitutive law of a group."""
        return self.materials[group].law

    def branches(self, group: str) -> tuple[Branch, ...]:
        """Return the relaxation mechanisms of a group, of its law and of its damping."""
        damping = self.damping[group] if isinstance(self.damping, dict) else self.damping
        return self.law(group).branches + (damping.branches if damping is not None else ())

    def yielding(self) -> np.ndarray:
        """Return whether the law of each zone is plastic, (n_zones,) bool."""
        yields = [self.materials[group].yields for group in self.mesh.groups]
        return np.array(yields)[self.mesh.zone_group]

    def patches(self) -> np.ndarray:
        """Return the patch of each zone, (n_zones,) from 0, -1 where the law is not plastic."""
        return make_patches(self.mesh, self.yielding())

    def zone_moduli(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the relaxed Lame moduli of each zone, (n_zones,) Pa."""
        pairs = [self.law(group).moduli(self.materials[group]) for group in self.mesh.groups]
        return tuple(np.array(pairs)[self.mesh.zone_group].T * self.speed_factor**2)

    def node_moduli(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the relaxed Lame moduli at the nodes of hexahedra, (n_zones, n) Pa."""
        pairs = [self.law(group).moduli(self.materials[group]) for group in self.mesh.groups]
        lame, shear = np.array(pairs)[self.mesh.zone_group].T
        n_zones, n = self.mesh.node_places.shape[:2]
        zone = np.repeat(np.arange(n_zones), n)
        factor = self.speed_factor_at(self.mesh.node_places.reshape(-1, 3), zone)
        factor = factor.reshape(n_zones, n)
        return lame[:, None] * factor**2, shear[:, None] * factor**2

    def stiffest_moduli(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the unrelaxed Lame moduli of each zone, (n_zones,) Pa."""
        lame, shear = self.zone_moduli()
        mechanisms = [self.branches(group) for group in self.mesh.groups]
        of_s, of_p = (
            1.0 + np.array([sum(getattr(b, wave) for b in branches) for branches in mechanisms])
            for wave in ("shear", "compression")
        )
        stiff = of_s[self.mesh.zone_group] * shear
        return of_p[self.mesh.zone_group] * (lame + 2.0 * shear) - 2.0 * stiff, stiff

    def group_damping(self, name: str) -> np.ndarray:
        """Return ``alpha`` (1/s) or ``beta`` (s) of the damping for every group, (n_groups,)."""
        damping = self.damping
        if damping is None:
            return np.zeros(len(self.mesh.groups))
        by_group = damping if isinstance(damping, dict) else None
        parts = [by_group[g] if by_group is not None else damping for g in self.mesh.groups]
        return np.array([getattr(part, name) for part in parts])

    def zone_damping(self, name: str) -> np.ndarray:
        """Return ``alpha`` (1/s) or ``beta`` (s) of the damping for every zone, (n_zones,)."""
        values = self.group_damping(name)[self.mesh.zone_group]
        if self.sponge is not None and name == "alpha":
            centres = self.mesh.points[self.mesh.zones].mean(axis=1)
            values += self.sponge.alpha(centres, self.zone_values("cs"))
        return values

    def mean_edges(self) -> dict[str, float]:
        """Return the mean edge of each group in m, weighted by volume.

        Zones in the absorbing layer only count if a group has no others.
        """
        edge, weight = zone_edge_lengths(self.mesh).mean(axis=1), zone_volumes(self.mesh)
        group = self.mesh.zone_group
        if self.sponge is not None:
            inside = self.sponge.alpha(self.mesh.points[self.mesh.zones].mean(axis=1), 1.0) == 0.0
            weight = weight * (inside | ~np.isin(group, group[inside]))
        mean = np.bincount(group, edge * weight) / np.bincount(group, weight)
        return dict(zip(self.mesh.groups, mean, strict=True))

    @property
    def edges_per_wavelength(self) -> float:
        """Edges per S wavelength for an error of a few per cent: eq. (1), or a third of it."""
        if self.mesh.hexahedral:
            return HEX_NODES / self.mesh.order
        return 3.0 if self.quadratic else 10.0

    def highest_frequency(self) -> dict[str, float]:
        """Return the highest frequency of each group in Hz: Cs over 10 mean edges, eq. (1).

        Thin layers of flat hexahedra carry more: `carried_by_thin_layers`.
        """
        return {
            group: max(
                self.materials[group].cs / (self.edges_per_wavelength * edge),
                self.thin_layers.get(group, 0.0),
            )
            for group, edge in self.mean_edges().items()
        }

    @cached_property
    def thin_layers(self) -> dict[str, float]:
        """Highest frequency in Hz that flat hexahedra of thin layers at the top carry."""
        return carried_by_thin_layers(
            self.mesh, self.materials, self.edges_per_wavelength, self._clearance()
        )

    def _clearance(self):
        """Return the least distance in m of receivers from sources, zero from loads on surfaces."""
        starts = []
        for source in self.sources:
            if isinstance(source, Column):
                starts += [source.primed, source.end]
            elif isinstance(source, Hole | PointForce | MomentTensor):
                starts.append(source.position)
            else:
                return 0.0
        return nearest_receiver(starts, [receiver.position for receiver in self.receivers])

    def doubles(self, boundary: StressInput) -> bool:
        """Return whether a stress input is doubled: as given, or if the surface is viscous."""
        if boundary.doubled is not None:
            return boundary.doubled
        viscous = [b.surface for b in self.boundaries if isinstance(b, Viscous)]
        return boundary.surface in viscous
