"""Tables of a project file about the ground: mesh, materials, joints, boundaries, sources."""

import math
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from ..units import plain_number
from .keys import (
    Band,
    Bearing,
    Box,
    Coordinate,
    Count,
    Density,
    Dip,
    Factor,
    Fraction,
    FrictionAngle,
    Infill,
    Modulus,
    Name,
    NotNegative,
    Point,
    Positive,
    Quality,
    Seed,
    Share,
    Size,
    Speed,
    Usual,
    range_of_property,
)
from .section import Section

LengthUnit = Literal["m", "km", "cm", "mm", "ft", "us_ft", "in"]


class LayerConfig(Section):
    """A layer of ground, from the top down; without thickness the rest down to the bottom."""

    material: Name
    thickness_m: Positive | None = None
    follows_surface: bool = False
    edge_m: Positive | None = None
    edges_per_wavelength: Factor | None = None


class FillConfig(Section):
    """A box of other ground in the place of layers, such as fill in a trench."""

    material: Name
    box_m: Box


class RefinementConfig(Section):
    """A box with shorter edges, such as the soil around a receiver."""

    name: Name
    box_m: Box
    edge_m: Positive


class JointSetConfig(Section):
    """Parallel joints, cut to layers."""

    name: Name
    joint: Name | None = None
    dip_deg: Dip
    dip_direction_deg: Bearing
    spacing_m: Positive
    origin_m: Point | None = None
    regions: list[Name] = Field([])
    persistence: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class FaultConfig(Section):
    """A single plane that cuts everything within its extent."""

    name: Name
    joint: Name | None = None
    dip_deg: Dip
    dip_direction_deg: Bearing
    through_m: Point
    radius_m: Positive | None = None
    extent_m: Annotated[list[Positive], Field(min_length=2, max_length=2)] | None = None


class FractureConfig(Section):
    """Fractures of limited extent that share a joint: mapped in a file, or drawn from laws."""

    name: Name
    joint: Name | None = None
    file: str | None = None
    file_unit: LengthUnit | None = None
    dip_deg: Dip | None = None
    dip_direction_deg: Bearing | None = None
    fisher_kappa: Factor | None = None
    p32: Factor | None = None
    radius_law: Literal["constant", "exponential", "lognormal", "power"] = "constant"
    radius_m: Positive | None = None
    radius_deviation_m: Positive | None = None
    radius_exponent: Factor | None = None
    radius_range_m: Band | None = None
    seed: Seed = 0
    ends_at: list[Name] = Field([])

    @model_validator(mode="after")
    def _file_or_laws(self):
        """Ask for a file, or for the laws of a set."""
        self._one_of(("file",), ("dip_deg", "dip_direction_deg", "fisher_kappa", "p32"))
        if self.file is None and self.file_unit is not None:
            raise ValueError("file_unit goes with file")
        needs = {"power": ("radius_exponent", "radius_range_m")}.get(
            self.radius_law,
            ("radius_m", "radius_deviation_m") if self.radius_law == "lognormal" else ("radius_m",),
        )
        sizes = ("radius_m", "radius_deviation_m", "radius_exponent", "radius_range_m")
        given = {key for key in sizes if getattr(self, key) is not None}
        if self.file is not None:
            needs = ()
        missing = [key for key in needs if key not in given]
        allowed = {*needs, "radius_range_m"} if self.file is None else set()
        if self.radius_law == "constant":
            allowed.discard("radius_range_m")
        if missing or given - allowed:
            wrong = missing or sorted(given - allowed)
            what = "is missing with" if missing else "does not go with"
            law = "file" if self.file is not None else f"radius_law = {self.radius_law!r}"
            raise ValueError(f"{wrong[0]} {what} {law}")
        return self


class BenchConfig(Section):
    """A bench: its crest, and its toe or the height and dip of its face; several of a drawing."""

    crest_m: list[Point] | None = None
    crest_file: str | None = None
    crest_layer: str | None = None
    toe_m: list[Point] | None = None
    toe_file: str | None = None
    toe_layer: str | None = None
    file_unit: LengthUnit | None = None
    height_m: Positive | None = None
    face_dip_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 90.0

    @model_validator(mode="after")
    def _lines(self):
        """Ask for one crest and one toe."""
        self._one_of(("crest_m",), ("crest_file",))
        self._one_of(("toe_m",), ("toe_file",), ("height_m",))
        if self.height_m is None and "face_dip_deg" in self.model_fields_set:
            raise ValueError("face_dip_deg goes with height_m; the toe gives the dip")
        if self.file_unit is not None and self.crest_file is None and self.toe_file is None:
            raise ValueError("file_unit goes with crest_file or toe_file")
        for line in ("crest", "toe"):
            if getattr(self, f"{line}_layer") is not None and getattr(self, f"{line}_file") is None:
                raise ValueError(f"{line}_layer goes with {line}_file, a drawing")
        return self


class MeshConfig(Section):
    """The ground: a box or a surveyed surface with layers and joints, or a mesh file."""

    size_m: Size | None = None
    origin_m: Point = Field([0.0, 0.0, 0.0])
    grid_cells: Annotated[list[Count], Field(min_length=3, max_length=3)] | None = None
    surface_file: str | None = None
    surface_unit: LengthUnit | None = None
    surface_layers: list[str] = Field([])
    benches: list[BenchConfig] = Field([])
    fractures: list[FractureConfig] = Field([])
    edge_m: Positive | None = None
    edges_per_wavelength: Factor | None = None
    frequency_hz: Positive | None = None
    layers: list[LayerConfig] = Field([])
    fills: list[FillConfig] = Field([])
    refinements: list[RefinementConfig] = Field([])
    joint_sets: list[JointSetConfig] = Field([])
    faults: list[FaultConfig] = Field([])
    tolerance_m: Positive | None = None
    kind: Literal["auto", "hexahedra", "tetrahedra"] = "auto"
    order: Annotated[int, Field(ge=2, le=8)] | None = None
    accuracy: Annotated[float, Field(ge=1e-4, le=0.1)] = 0.01
    near_source_work: Annotated[float, Field(ge=1.0, le=1e6)] = 10.0
    minutes: Annotated[float, Field(gt=0.0, le=1e6)] = 60.0
    quadratic: bool = False
    padding_m: Positive | None = None
    padding_edge_m: Positive | None = None
    seed: Seed = 0
    file: str | None = None
    file_groups: dict[str, Name] = Field({})
    file_joints: dict[str, Name] = Field({})
    file_welded: list[Name] = Field([])

    @model_validator(mode="after")
    def _complete(self):
        """Ask for layers and an edge length of a box; a file needs nothing else."""
        self._one_of(("size_m",), ("file",))
        for file, keys in (("surface_file", ("surface_unit", "surface_layers")),
                           ("file", ("file_groups", "file_joints", "file_welded"))):  # fmt: skip
            if getattr(self, file) is None and any(getattr(self, key) for key in keys):
                raise ValueError(f"{' and '.join(keys)} go with {file}")
        if self.file is not None:
            if self.surface_file is not None or self.benches or self.fractures or self.fills:
                raise ValueError("surface_file, benches, fills and fractures do not go with file")
            return self
        if not self.layers:
            raise ValueError("layers is missing; give [[mesh.layers]] with a material")
        if self.surface_file is None and any(part.follows_surface for part in self.layers):
            raise ValueError("layers.follows_surface goes with surface_file")
        if self.fills and self.surface_file is not None:
            raise ValueError("fills go without surface_file, where the ground is level or benches")
        twice = {part.material for part in self.fills} & {part.material for part in self.layers}
        if twice:
            raise ValueError(f"fills: {min(twice)!r} is the material of a layer, too; name another")
        wanted = any(part.edges_per_wavelength is not None for part in [self, *self.layers])
        if wanted and self.frequency_hz is None:
            raise ValueError("frequency_hz is missing beside edges_per_wavelength")
        if (self.padding_m is None) != (self.padding_edge_m is None):
            raise ValueError("padding_m and padding_edge_m go together")
        if self.benches and (self.surface_file is not None or self.kind == "hexahedra"):
            raise ValueError("benches are cut into tetrahedra, without surface_file or hexahedra")
        names = [part.name for part in (*self.joint_sets, *self.faults, *self.fractures)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(
                    f"the name {name!r} is given to two joint sets, faults or fractures"
                )
        return self

    @model_validator(mode="after")
    def _faults_within(self):
        """Refuse faults that miss the box, or end beyond it; not those under a surveyed surface."""
        if self.size_m is None or self.surface_file is not None:
            return self
        out = self.padding_m or 0.0
        half = [0.5 * size + out for size in self.size_m]
        centre = [a + 0.5 * b for a, b in zip(self.origin_m, self.size_m, strict=True)]
        half[2], centre[2] = half[2] - 0.5 * out, centre[2] - 0.5 * out  # no padding on top
        for fault in self.faults:
            dip, azimuth = math.radians(fault.dip_deg), math.radians(fault.dip_direction_deg)
            east, north = math.sin(azimuth), math.cos(azimuth)
            normal = math.sin(dip) * east, math.sin(dip) * north, math.cos(dip)
            parts = zip(normal, centre, fault.through_m, strict=True)
            at = sum(n * (c - p) for n, c, p in parts)
            reach = sum(abs(n * h) for n, h in zip(normal, half, strict=True))
            if abs(at) > reach:
                raise ValueError(
                    f"faults.{fault.name}: its plane passes the box of the mesh at "
                    f"{plain_number(abs(at) - reach)} m; move through_m, or leave the fault out"
                )
            away = zip(half, centre, fault.through_m, strict=True)
            corner = math.hypot(*(h + abs(c - p) for h, c, p in away))
            key = "extent_m" if fault.radius_m is None else "radius_m"
            sizes = fault.extent_m or [2.0 * (fault.radius_m or 0.0)]
            if 0.5 * min(sizes) >= corner:
                raise ValueError(
                    f"faults.{fault.name}.{key}: reaches beyond the box of the mesh on all sides, "
                    f"whose farthest corner is at {plain_number(corner)} m; leave it out"
                )
        return self

    @property
    def files(self) -> list[str | None]:
        """Return the files that the ground is read from."""
        lines = [name for part in self.benches for name in (part.crest_file, part.toe_file)]
        return [self.file, self.surface_file, *lines, *(part.file for part in self.fractures)]


class DampingConfig(Section):
    """Rayleigh damping."""

    ratio: Annotated[float, Field(ge=0.0, lt=1.0)]
    frequency_hz: Positive
    mass: bool = True
    stiffness: bool = True
    corner_hz: Positive | None = None
    lagged: bool = False

    @model_validator(mode="after")
    def _corner_above(self):
        """Refuse a low-pass that would take what it shall damp, or that is asked for and not."""
        if self.lagged and self.corner_hz is not None:
            raise ValueError("give corner_hz or lagged = true, not both")
        if self.corner_hz is not None and not self.corner_hz > self.frequency_hz:
            raise ValueError(f"corner_hz must exceed frequency_hz, got {self.corner_hz:g}")
        return self


class YieldingConfig(Section):
    """Mohr-Coulomb ground: flow and softening beside the strength of the material."""

    dilation_angle_deg: FrictionAngle = 0.0
    cohesion_residual_kpa: NotNegative | None = None
    friction_residual_angle_deg: FrictionAngle | None = None
    dilation_residual_angle_deg: FrictionAngle | None = None
    tension_residual_kpa: NotNegative | None = None
    shear_strain_percent: NotNegative = 0.0
    tensile_strain_percent: NotNegative = 0.0


class HoekBrownConfig(Section):
    """Ground that yields by Hoek and Brown."""

    sigci_mpa: Annotated[Positive, Usual(0.1, 1000.0)]
    mi: Annotated[float, Field(gt=0.0, le=100.0)]
    gsi: Annotated[float, Field(ge=5.0, le=100.0)]
    disturbance: Fraction = 0.0
    dilation_angle_deg: FrictionAngle = 0.0
    tension_kpa: NotNegative | None = None
    m_residual: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    s_residual: Fraction | None = None
    tension_residual_kpa: NotNegative | None = None
    shear_strain_percent: NotNegative = 0.0
    tensile_strain_percent: NotNegative = 0.0


class UbiquitousConfig(Section):
    """Elastic rock that slips and opens on parallel planes everywhere."""

    dip_deg: Dip
    dip_direction_deg: Bearing
    cohesion_kpa: NotNegative
    friction_angle_deg: FrictionAngle
    dilation_angle_deg: FrictionAngle = 0.0
    tension_kpa: NotNegative = 0.0


class TransverseConfig(Section):
    """Elastic constants of ground that is isotropic in planes: schist, thin layers."""

    dip_deg: Dip
    dip_direction_deg: Bearing
    young_mpa: Modulus
    young_normal_mpa: Modulus
    poisson: Annotated[float, Field(gt=-1.0, lt=1.0)]
    poisson_normal: Annotated[float, Field(ge=-10.0, le=10.0)]
    shear_normal_mpa: Modulus


class MediumJointsConfig(Section):
    """Parallel joints that are not meshed but part of the stiffness of their rock."""

    dip_deg: Dip
    dip_direction_deg: Bearing
    spacing_m: Positive
    kn_gpa_per_m: Annotated[Positive, Usual(1e-4, 1e5)]
    ks_gpa_per_m: Annotated[Positive, Usual(1e-5, 1e5)]


SOFT, HEAVY = 150.0, 2300.0  # speed of shear waves in m/s that no rock has which is denser, kg/m3


class MaterialConfig(Section):
    """Density, elastic constants in one of four ways, strength, quality, own damping."""

    density_kg_per_m3: Density
    bulk_mpa: Modulus | None = None
    shear_mpa: Modulus | None = None
    young_mpa: Modulus | None = None
    poisson: Annotated[float, Field(gt=-1.0, lt=0.5)] | None = None
    cp_m_per_s: Speed | None = None
    cs_m_per_s: Annotated[Speed, Usual(10.0, 7500.0)] | None = None
    cohesion_kpa: NotNegative | None = None
    tension_kpa: NotNegative | None = None
    friction_angle_deg: FrictionAngle | None = None
    qp: Quality | None = None
    qs: Quality | None = None
    quality_band_hz: Band | None = None
    quality_reference_hz: Positive | None = None
    damping: DampingConfig | None = None
    yielding: YieldingConfig | None = None
    hoek_brown: HoekBrownConfig | None = None
    ubiquitous: UbiquitousConfig | None = None
    transverse: TransverseConfig | None = None
    joints: list[MediumJointsConfig] = Field([])

    @model_validator(mode="after")
    def _two_constants(self):
        """Ask for one pair of elastic constants, or those of transverse ground."""
        speeds = "cp_m_per_s", "cs_m_per_s"
        self._one_of(("bulk_mpa", "shear_mpa"), ("young_mpa", "poisson"), speeds, ("transverse",))
        key, shear, unit = "shear_mpa", self.shear_mpa, "GPa"
        if self.young_mpa is not None:
            key, shear = "young_mpa", 0.5 * self.young_mpa / (1.0 + self.poisson)
        if self.cs_m_per_s is not None:
            key, unit = "cs_m_per_s", "km/s"
            shear = 1e-6 * self.density_kg_per_m3 * self.cs_m_per_s**2
        if shear is not None and self.density_kg_per_m3 > HEAVY:
            slow = math.sqrt(1e6 * shear / self.density_kg_per_m3)
            if slow < SOFT:
                raise ValueError(
                    f"{key}: {getattr(self, key):g} gives shear waves of {slow:.3g} m/s, but rock "
                    f"of {self.density_kg_per_m3:g} kg/m3 has {SOFT:g} and more; is it in {unit}?"
                )
        return self

    @model_validator(mode="after")
    def _one_law(self):
        """Refuse two laws for the same zones; ask for the strength of ground that yields."""
        laws = {
            "qp": self.qp is not None,
            "yielding": self.yielding is not None,
            "hoek_brown": self.hoek_brown is not None,
            "ubiquitous": self.ubiquitous is not None,
            "transverse or joints": self.transverse is not None or bool(self.joints),
        }
        chosen = [name for name, wanted in laws.items() if wanted]
        if len(chosen) > 1:
            raise ValueError(f"{chosen[0]} and {chosen[1]} exclude one another; keep one")
        if self.yielding is not None and self.cohesion_kpa is None:
            raise ValueError("cohesion_kpa is missing beside yielding")
        return self

    @model_validator(mode="after")
    def _both_qualities(self):
        """Ask for both quality factors and the band in which they hold, or none of them."""
        quality = "qp", "qs", "quality_band_hz"
        if any(getattr(self, key) is not None for key in (*quality, "quality_reference_hz")):
            missing = [key for key in quality if getattr(self, key) is None]
            if missing:
                raise ValueError(f"{missing[0]} is missing; qp, qs, quality_band_hz go together")
        return self


class JointConfig(Section):
    """A joint law and its properties; which ones, the law table of the core says."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]
    law: Name = "coulomb"
    insitu_pressure_kpa: NotNegative = 0.0
    insitu_gradient_mpa_per_m: NotNegative = 0.0
    insitu_level_m: Coordinate | None = None
    insitu_shear_kpa: Point = Field([0.0, 0.0, 0.0])
    infill_mm: Infill | None = None
    fill_density_kg_per_m3: Density | None = None
    fill_thickness_mm: Positive | None = None
    water_aperture_mm: Positive | None = None

    @model_validator(mode="after")
    def _both(self):
        """Ask for both numbers of a heavy fill, and for properties within their ranges."""
        for key, value in (self.model_extra or {}).items():
            try:
                range_of_property(key).check(value)
            except ValueError as error:
                raise ValueError(f"{key}: {error}") from None
        if (self.fill_density_kg_per_m3 is None) != (self.fill_thickness_mm is None):
            raise ValueError("fill_density_kg_per_m3 and fill_thickness_mm go together")
        if (self.insitu_gradient_mpa_per_m > 0.0) != (self.insitu_level_m is not None):
            raise ValueError("insitu_gradient_mpa_per_m and insitu_level_m go together")
        return self


class BoundariesConfig(Section):
    """Which outer surface has which condition."""

    viscous: list[Name] = Field(default=[])
    free_field: list[Name] = Field(default=[])
    roller: list[Name] = Field(default=[])
    fixed: list[Name] = Field(default=[])
    free: list[Name] = Field(default=[])
    viscous_and_fixed: bool = False
    jointed_faces: bool = False

    @model_validator(mode="after")
    def _once(self):
        """Refuse a surface that stands in two lists."""
        every = [*self.viscous, *self.free_field, *self.roller, *self.fixed, *self.free]
        for name in every:
            if every.count(name) > 1:
                raise ValueError(
                    f"the surface {name!r} stands in two lists; for the literal reading of the "
                    "paper keep it in viscous and set viscous_and_fixed = true"
                )
        return self


Stress = Annotated[list[Annotated[float, Usual(-500.0, 500.0)]], Field(min_length=6, max_length=6)]


class InSituConfig(Section):
    """Weight and horizontal stress before the blast."""

    gravity_m_per_s2: NotNegative = 9.81
    horizontal_ratio: Annotated[float, Field(ge=0.0, le=1e3), Usual(0.0, 10.0)] = 0.5
    stress_mpa: Stress = Field([0.0] * 6)
    water_table_m: Coordinate | None = None
    water_density_kg_per_m3: Annotated[Density, Usual(900.0, 1300.0)] = 1000.0


class AbsorbingLayerConfig(Section):
    """Absorbing layer: ground outside a box that damps outgoing waves."""

    box_m: Box
    width_m: Positive
    lowest_hz: Positive | None = None


class GradientConfig(Section):
    """Wave speeds that grow with depth."""

    reduction: Share
    length_m: Positive
    top_m: Coordinate | None = None


class DamagedZoneConfig(Section):
    """Ground that blasting has damaged around the holes of the blast."""

    reduction: Share
    length_m: Positive
    radius_m: Positive | None = None
    material: Name | None = None

    @model_validator(mode="after")
    def _both(self):
        """Ask for both, the radius and the material within it."""
        if (self.radius_m is None) != (self.material is None):
            raise ValueError("radius_m and material go together")
        return self


class HeterogeneityConfig(Section):
    """Random wave speeds."""

    deviation: Share
    length_m: Positive
    seed: Seed = 0
    hurst: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5


class GroundConfig(Section):
    """Factors on the wave speeds of all materials."""

    gradient: GradientConfig | None = None
    damaged_zone: DamagedZoneConfig | None = None
    heterogeneity: HeterogeneityConfig | None = None


def with_unused_ground(table: dict) -> dict:
    """Return the tables of a project file with a ground and a run where it has none.

    For commands that superpose and build no mesh: the box of one cell is never used. A file with
    holes inside stays as it is, since it needs its own ground.
    """
    if "holes_inside" in table:
        return table
    rock = {"density_kg_per_m3": 2700, "young_mpa": 50000, "poisson": 0.25}
    materials = table.get("materials") or {"rock": rock}
    layers = [{"material": name} for name in list(materials)[:1]]
    box = {"size_m": [1, 1, 1], "grid_cells": [1, 1, 1], "layers": layers}
    return {"mesh": box, "materials": materials, "run": {"duration_s": 1.0}} | table
