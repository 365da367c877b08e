"""What a project file may say: names, units in the names, ranges; no physics."""

from typing import Annotated

from pydantic import Field, model_validator

from .config_ground import (
    BoundariesConfig,
    DampingConfig,
    InSituConfig,
    JointConfig,
    MaterialConfig,
    MeshConfig,
)
from .config_section import (
    Band,
    Bearing,
    Count,
    Name,
    NotNegative,
    Place,
    Point,
    Positive,
    Section,
)


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
    shift_m: Point = Field([0.0, 0.0, 0.0])
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
    snapshots_s: list[NotNegative] = Field([])
    compare_band_hz: Band | None = None


class Config(Section):
    """A whole project file."""

    title: Name
    assumed: list[Name] = Field([])
    mesh: MeshConfig
    materials: dict[Name, MaterialConfig]
    joints: dict[Name, JointConfig] = Field({})
    boundaries: BoundariesConfig = BoundariesConfig()
    damping: DampingConfig | None = None
    insitu: InSituConfig | None = None
    blast: BlastConfig | None = None
    signature: SignatureConfig
    input: InputConfig = InputConfig()
    receivers: list[ReceiverConfig] = Field([])
    run: RunConfig
