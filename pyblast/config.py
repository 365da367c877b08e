"""What a project file may say: names, units in the names, ranges; no physics."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Count = Annotated[int, Field(ge=1)]
Dip = Annotated[float, Field(ge=0.0, le=90.0)]
Bearing = Annotated[float, Field(ge=-360.0, le=360.0)]
FrictionAngle = Annotated[float, Field(ge=0.0, lt=89.0)]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Place = Annotated[list[float], Field(min_length=2, max_length=3)]
Size = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Band = Annotated[list[Positive], Field(min_length=2, max_length=2)]
Infill = Annotated[list[Positive], Field(min_length=1, max_length=2)]
Name = Annotated[str, Field(min_length=1, max_length=80)]


class Section(BaseModel):
    """One table of a project file: strict types, no unknown keys."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    def _one_of(self, *choices):
        """Raise an error unless exactly one group of keys is given, and given whole."""
        begun = [c for c in choices if any(getattr(self, key) is not None for key in c)]
        if len(begun) != 1:
            raise ValueError(f"give one of {'; '.join(' and '.join(c) for c in choices)}")
        missing = [key for key in begun[0] if getattr(self, key) is None]
        if missing:
            raise ValueError(f"{missing[0]} is missing beside {begun[0][0]}")


class LayerConfig(Section):
    """A layer of ground, from the top down; without thickness the rest down to the bottom."""

    material: Name
    thickness_m: Positive | None = None
    edge_m: Positive | None = None
    edges_per_wavelength: Positive | None = None


class JointSetConfig(Section):
    """Parallel joints, cut to layers."""

    name: Name
    joint: Name | None = None
    dip_deg: Dip
    dip_direction_deg: Bearing
    spacing_m: Positive
    origin_m: Point | None = None
    regions: list[Name] = []
    persistence: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0


class FaultConfig(Section):
    """A single plane that cuts everything within its extent."""

    name: Name
    joint: Name | None = None
    dip_deg: Dip
    dip_direction_deg: Bearing
    through_m: Point
    radius_m: Positive | None = None


class MeshConfig(Section):
    """The ground: a box or a surveyed surface with layers and joints, or a mesh file."""

    size_m: Size | None = None
    origin_m: Point = [0.0, 0.0, 0.0]
    grid_cells: Annotated[list[Count], Field(min_length=3, max_length=3)] | None = None
    surface_file: str | None = None
    edge_m: Positive | None = None
    edges_per_wavelength: Positive | None = None
    frequency_hz: Positive | None = None
    layers: list[LayerConfig] = []
    joint_sets: list[JointSetConfig] = []
    faults: list[FaultConfig] = []
    tolerance_m: Positive | None = None
    seed: Annotated[int, Field(ge=0)] = 0
    file: str | None = None
    file_groups: dict[str, Name] = {}
    file_joints: dict[str, Name] = {}

    @model_validator(mode="after")
    def _complete(self):
        """Ask for layers and an edge length of a box; a file needs nothing else."""
        self._one_of(("size_m",), ("file",))
        if self.file is not None:
            return self
        if not self.layers:
            raise ValueError("layers is missing; give [[mesh.layers]] with a material")
        wanted = any(part.edges_per_wavelength is not None for part in [self, *self.layers])
        if wanted and self.frequency_hz is None:
            raise ValueError("frequency_hz is missing beside edges_per_wavelength")
        if self.grid_cells is None and self.edge_m is None and self.edges_per_wavelength is None:
            raise ValueError("give one of edge_m; edges_per_wavelength; grid_cells")
        names = [part.name for part in (*self.joint_sets, *self.faults)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"the name {name!r} is given to two joint sets or faults")
        return self


class MaterialConfig(Section):
    """Density, two elastic constants in one of three ways, and strength."""

    density_kg_per_m3: Positive
    bulk_mpa: Positive | None = None
    shear_mpa: Positive | None = None
    young_mpa: Positive | None = None
    poisson: Annotated[float, Field(gt=-1.0, lt=0.5)] | None = None
    cp_m_per_s: Positive | None = None
    cs_m_per_s: Positive | None = None
    cohesion_kpa: NotNegative | None = None
    tension_kpa: NotNegative | None = None
    friction_angle_deg: FrictionAngle | None = None

    @model_validator(mode="after")
    def _two_constants(self):
        """Ask for one pair of elastic constants."""
        speeds = "cp_m_per_s", "cs_m_per_s"
        self._one_of(("bulk_mpa", "shear_mpa"), ("young_mpa", "poisson"), speeds)
        return self


class JointConfig(Section):
    """A joint law and its properties; which ones, the law table of the core says."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]
    law: Name = "coulomb"
    insitu_pressure_kpa: NotNegative = 0.0
    infill_mm: Infill | None = None


class BoundariesConfig(Section):
    """Which outer surface has which condition."""

    viscous: list[Name] = []
    roller: list[Name] = []
    fixed: list[Name] = []
    free: list[Name] = []
    viscous_and_fixed: bool = False

    @model_validator(mode="after")
    def _once(self):
        """Refuse a surface that stands in two lists."""
        every = [*self.viscous, *self.roller, *self.fixed, *self.free]
        for name in every:
            if every.count(name) > 1:
                raise ValueError(
                    f"the surface {name!r} stands in two lists; for the literal reading of the "
                    "paper keep it in viscous and set viscous_and_fixed = true"
                )
        return self


class DampingConfig(Section):
    """Rayleigh damping."""

    ratio: Annotated[float, Field(ge=0.0, lt=1.0)]
    frequency_hz: Positive
    mass: bool = True
    stiffness: bool = True


class InSituConfig(Section):
    """Weight and horizontal stress before the blast."""

    gravity_m_per_s2: NotNegative = 9.81
    horizontal_ratio: NotNegative = 0.5


class BlastConfig(Section):
    """Rows of holes, or a hole table."""

    rows: Count | None = None
    holes_per_row: Count | None = None
    delay_ms: NotNegative | None = None
    charge_kg: Positive | None = None
    diameter_mm: Positive | None = None
    depth_m: Positive | None = None
    burden_m: Positive | None = None
    spacing_m: Positive | None = None
    position_m: Point | None = None
    row_bearing_deg: Bearing = 0.0
    file: str | None = None
    mapping: str | None = None
    shift_m: Point = [0.0, 0.0, 0.0]
    explosive_kg_per_m3: Positive = 850.0
    reference_charge_kg: Positive | None = None
    charge_exponent: NotNegative = 1.0
    wave_speed_m_per_s: Positive | None = None
    scatter_ms: NotNegative = 0.0
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _rows_or_table(self):
        """Ask for all numbers of the rows, or a table."""
        rows = ("rows", "holes_per_row", "delay_ms", "charge_kg", "diameter_mm", "depth_m")
        self._one_of((*rows, "burden_m", "spacing_m", "position_m"), ("file",))
        return self


class RecordingConfig(Section):
    """A recorded seismogram: a file and what it does not say itself."""

    file: str
    format: str | None = None
    record: Count = 1
    mapping: str | None = None
    bearing_deg: Bearing | None = None
    full_scale_mm_per_s: Positive | None = None
    unit: str | None = None
    start_s: float | None = None


class CavityConfig(Section):
    """The closed form of a charged hole: a cavity under pressure in unbounded rock."""

    material: Name
    hole_m: Point
    receiver_m: Point
    charge_kg: Positive
    radius_m: Positive
    peak_time_ms: Positive
    pressure_mpa: Positive | None = None
    peak_mm_per_s: Positive | None = None
    duration_s: Positive = 1.0
    sampling_hz: Positive = 1024.0

    @model_validator(mode="after")
    def _one_level(self):
        """Refuse two levels; without one it follows from a scaled-distance law."""
        if self.pressure_mpa is not None and self.peak_mm_per_s is not None:
            raise ValueError("give pressure_mpa or peak_mm_per_s, not both")
        return self


class SignatureConfig(Section):
    """Seismogram of a single hole: recorded, or the closed form."""

    recorded: RecordingConfig | None = None
    cavity: CavityConfig | None = None

    @model_validator(mode="after")
    def _one_source(self):
        """Ask for one of the two."""
        self._one_of(("recorded",), ("cavity",))
        return self


class InputConfig(Section):
    """Where and how the blast enters the model."""

    face: Name = "west"
    low_pass_hz: Positive | None = 20.0
    distance_m: Positive | None = None


class ReceiverConfig(Section):
    """A place where motion is wanted; without height it stands on the surface "top"."""

    name: Annotated[str, Field(pattern=r"^[^/\x00]{1,60}$")]
    position_m: Place
    azimuth_deg: Bearing | None = None
    recorded: RecordingConfig | None = None


class RunConfig(Section):
    """How long and how the model is marched."""

    duration_s: Positive
    added_mass: Annotated[float, Field(ge=0.0, le=0.1)] = 0.005
    step_factor: Annotated[float, Field(gt=0.0, le=1.0)] = 0.8
    snapshots_s: list[NotNegative] = []
    compare_band_hz: Band | None = None


class Config(Section):
    """A whole project file."""

    title: Name
    assumed: list[Name] = []
    mesh: MeshConfig
    materials: dict[Name, MaterialConfig]
    joints: dict[Name, JointConfig] = {}
    boundaries: BoundariesConfig = BoundariesConfig()
    damping: DampingConfig | None = None
    insitu: InSituConfig | None = None
    blast: BlastConfig | None = None
    signature: SignatureConfig
    input: InputConfig = InputConfig()
    receivers: list[ReceiverConfig] = []
    run: RunConfig
