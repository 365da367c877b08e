"""Configuration: the tables of a project file about blast, input, run and analyses; its reader."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError, ValidationInfo, model_validator

from ..errors import InputError
from .ground import (
    AbsorbingLayerConfig,
    BoundariesConfig,
    DampingConfig,
    GroundConfig,
    InSituConfig,
    JointConfig,
    MaterialConfig,
    MeshConfig,
    with_unused_ground,
)
from .keys import (
    Band,
    Bearing,
    Charge,
    ChargeExponent,
    Count,
    Curve,
    Density,
    Exponent,
    Factor,
    Fraction,
    Inclination,
    Law,
    Name,
    NotNegative,
    Peak,
    Place,
    Point,
    Positive,
    Radius,
    Seed,
    Span,
    Speed,
    Usual,
)
from .section import (
    CandidateConfig,
    RecordingConfig,
    Section,
    merged,
    read_toml,
    sentence_of,
    value_at,
    with_candidate,
)
from .sources import (
    AirBlastConfig,
    HolesInsideConfig,
    MomentTensorConfig,
    PointForceConfig,
    PressureConfig,
    SiteLawConfig,
    refuse_two_levels,
)

DEFAULT_METHOD = "levenberg"  # docs/decisions.md, "Least squares by default"


class ParameterConfig(Section):
    """Parameter of a back-analysis: dotted path of a key and its range, in the unit of the key."""

    path: Name
    low: float
    high: float
    log: bool = False
    laboratory: Span | None = None


Candidates = Annotated[list[Annotated[int, Field(ge=1, le=100)]], Field(min_length=2, max_length=2)]


class BackAnalysisConfig(Section):
    """Back-analysis: parameters, records, method."""

    method: Name = DEFAULT_METHOD
    misfit: Name = "waveform"
    runs: Count = 60
    seed: Seed = 0
    receivers: list[Name] = Field([])
    blasts: list[Name] = Field([])
    noise_mm_per_s: Positive | None = None
    candidate_grid: Candidates = Field([5, 4])
    candidate_blasts: list[Name] = Field([])
    parameters: Annotated[list[ParameterConfig], Field(min_length=1)]


class PriorsConfig(Section):
    """Priors: standard deviations of what a project file states and nobody looks for."""

    speed_percent: NotNegative = 2.0
    density_percent: NotNegative = 3.0
    stiffness_percent: NotNegative = 30.0
    inverse_q: Fraction = 0.002
    thickness_m: NotNegative = 0.3
    dip_deg: NotNegative = 1.0
    dip_direction_deg: NotNegative = 2.0
    plane_m: NotNegative = 0.5
    receiver_m: NotNegative = 0.3
    clock_ms: NotNegative = 0.12
    trigger_ms: NotNegative = 0.15
    firing_ms: NotNegative = 0.12
    amplitude_percent: NotNegative = 3.0
    holes_percent: NotNegative = 20.0


Ends = Annotated[list[NotNegative], Field(min_length=2, max_length=2)]


class HouseConfig(Section):
    """House with its vibration limit: a receiver, or a position with a recorded single hole."""

    name: Name
    limit_mm_per_s: Positive | None = None
    limit_curve: Curve | None = None
    recorded: RecordingConfig | None = None
    position_m: Point | None = None

    @model_validator(mode="after")
    def _one_limit(self):
        """Ask for one limit."""
        self._one_of(("limit_mm_per_s",), ("limit_curve",))
        return self


class DelaysConfig(Section):
    """Delay optimisation: range of delays, uncertainty of the holes, houses."""

    between_holes_ms: Ends
    between_rows_ms: Ends
    step_ms: Positive = 1.0
    holes_per_row: Count | None = None
    band_hz: Band | None = None
    share_percent: Annotated[float, Field(gt=0.0, lt=100.0)] = 90.0
    max_charge_per_8ms_kg: Positive | None = None
    scatter_ms: NotNegative = 0.0
    scatter_percent: NotNegative = 0.0
    charge_percent: NotNegative = 20.0
    blast_percent: NotNegative = 0.0
    doubt: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    wave_speed_m_per_s: Speed | None = None
    draws: Count = 4000
    seed: Seed = 0
    houses: Annotated[list[HouseConfig], Field(min_length=1)]

    @model_validator(mode="after")
    def _whole(self):
        """Refuse ends that fall, names that repeat, and houses of two kinds."""
        for key in ("between_holes_ms", "between_rows_ms"):
            low, high = getattr(self, key)
            if low > high:
                raise ValueError(f"{key}: must be lowest and highest delay, got {[low, high]}")
        names = [house.name for house in self.houses]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"houses: {name!r} is named twice")
        recorded = [house.recorded is not None for house in self.houses]
        if any(recorded) and not all(recorded):
            name = names[recorded.index(False)]
            raise ValueError(f"houses: {name!r} has no recorded hole, but others have; record all")
        if self.wave_speed_m_per_s is not None:
            for house in self.houses:
                if house.position_m is None or house.recorded is None:
                    raise ValueError(
                        "wave_speed_m_per_s: moves recorded holes; each house needs position_m and "
                        f"recorded, {house.name!r} lacks one"
                    )
        return self


class DiagnosisConfig(Section):
    """Diagnosis: records, band, noise window and candidates."""

    blasts: list[Name] = Field([])
    band_hz: Band | None = None
    noise_window_s: Span | None = None
    candidates: list[CandidateConfig] = Field([])
    until_s: Positive | None = None
    trusted: list[Name] = Field([])
    held_out: list[Name] = Field([])
    early_s: Span | None = None
    source_s: Positive | None = None
    trigger_s: Positive | None = None
    calibrate: bool = True

    @model_validator(mode="after")
    def _one_role(self):
        """Refuse a blast in two lists, two ways of an unknown source, and a window of no shots."""
        both = sorted(set(self.trusted) & set(self.held_out))
        if both:
            raise ValueError(f"the blast {both[0]!r} is in trusted and in held_out; keep one")
        if self.source_s is not None and self.trigger_s is not None:
            raise ValueError("source_s and trigger_s exclude one another; keep one")
        if self.early_s is not None:
            first, last = self.early_s
            if not self.trusted:
                raise ValueError("early_s: is a window of trusted shots; name them in trusted")
            if not (first <= 0.0 < last):
                raise ValueError(
                    "early_s: must begin before the first arrival at 0 s and end after it, "
                    f"got {self.early_s}"
                )
        return self

    @model_validator(mode="after")
    def _named_once(self):
        """Refuse candidates of one name."""
        if len({each.name for each in self.candidates}) < len(self.candidates):
            raise ValueError("candidates: two have the same name; give each its own")
        return self

    @model_validator(mode="after")
    def _before(self):
        """Refuse a window of noise that ends before it begins or after the first hole."""
        if self.noise_window_s is not None:
            first, last = self.noise_window_s
            if not first < last <= 0.0:
                raise ValueError(
                    "noise_window_s: must rise and end before the first hole at 0 s, "
                    f"got {self.noise_window_s}"
                )
        return self


MOST_HOLES, MOST_SAMPLES = 100_000, 10_000_000


class BlastConfig(Section):
    """Blast: rows of holes, or a hole table."""

    rows: Count | None = None
    holes_per_row: Count | None = None
    delay_ms: NotNegative | None = None
    charge_kg: Charge | None = None
    diameter_mm: Annotated[Positive, Usual(5.0, 1500.0)] | None = None
    depth_m: Annotated[Positive, Usual(0.05, 300.0)] | None = None
    burden_m: Annotated[Positive, Usual(0.01, 100.0)] | None = None
    spacing_m: Annotated[Positive, Usual(0.01, 100.0)] | None = None
    position_m: Point | None = None
    row_bearing_deg: Bearing = 0.0
    file: str | None = None
    mapping: str | None = None
    sheet: str | None = None
    shift_m: Point = Field([0.0, 0.0, 0.0])
    explosive_kg_per_m3: Annotated[Density, Usual(200.0, 2500.0)] = 850.0
    reference_charge_kg: Positive | None = None
    charge_exponent: ChargeExponent = 1.0
    wave_speed_m_per_s: Speed | None = None
    scatter_ms: NotNegative = 0.0
    seed: Seed = 0

    @model_validator(mode="after")
    def _rows_or_table(self):
        """Ask for all numbers of the rows, or a table."""
        rows = ("rows", "holes_per_row", "delay_ms", "charge_kg", "diameter_mm", "depth_m")
        self._one_of((*rows, "burden_m", "spacing_m", "position_m"), ("file",))
        if self.rows is not None and self.rows * self.holes_per_row > MOST_HOLES:
            raise ValueError(
                f"rows and holes_per_row: must make at most {MOST_HOLES} holes, "
                f"got {self.rows} times {self.holes_per_row}"
            )
        return self


class CavityConfig(Section):
    """Closed form of a charged hole: a cavity under pressure in unbounded rock."""

    material: Name
    hole_m: Point
    receiver_m: Point
    charge_kg: Charge
    radius_m: Radius
    peak_time_ms: Peak
    pressure_mpa: Positive | None = None
    peak_mm_per_s: Positive | None = None
    law: Law | None = None
    site_law: SiteLawConfig | None = None
    duration_s: Positive = 1.0
    sampling_hz: Positive = 1024.0

    @model_validator(mode="after")
    def _one_level(self):
        """Refuse two levels, and more samples than a record has; without level one follows."""
        refuse_two_levels(self)
        if self.duration_s * self.sampling_hz > MOST_SAMPLES:
            raise ValueError(
                f"duration_s and sampling_hz: must make at most {MOST_SAMPLES} samples, "
                f"got {self.duration_s:g} times {self.sampling_hz:g}"
            )
        return self


class SignatureConfig(Section):
    """Signature: seismogram of a single hole, recorded or in closed form."""

    recorded: RecordingConfig | None = None
    cavity: CavityConfig | None = None
    scale: Factor = 1.0

    @model_validator(mode="after")
    def _one_source(self):
        """Ask for one of the two."""
        self._one_of(("recorded",), ("cavity",))
        return self


class InputConfig(Section):
    """Input: where and how the motion of a signature enters the model."""

    face: Name = "west"
    enters_as: Literal["stress", "velocity", "plane_wave"] = "stress"
    wave: Literal["P", "SV", "SH"] | None = None
    azimuth_deg: Bearing | None = None
    inclination_deg: Inclination | None = None
    free_surface: Name = "top"
    low_pass_hz: Positive | None = 20.0
    zero_phase: bool = False
    distance_m: Positive | None = None
    decay_exponent: Exponent | None = None

    @model_validator(mode="after")
    def _plane_wave(self):
        """Ask for all that says what a plane wave is, and refuse it beside another input."""
        needed = ("wave", "azimuth_deg", "inclination_deg")
        if self.enters_as == "plane_wave":
            for key in needed:
                if getattr(self, key) is None:
                    raise ValueError(f"{key} is missing beside enters_as = 'plane_wave'")
        if self.decay_exponent is not None and self.enters_as != "stress":
            raise ValueError("decay_exponent needs enters_as = 'stress', leave it out")
        if self.decay_exponent is not None and self.distance_m is None:
            raise ValueError("distance_m is missing beside decay_exponent")
        for key in (*needed, "free_surface"):
            if self.enters_as != "plane_wave" and key in self.model_fields_set:
                raise ValueError(f"{key} needs enters_as = 'plane_wave'; leave it out")
        return self


class ReceiverConfig(Section):
    """Receiver; without height it stands on the surface "top"."""

    name: Annotated[str, Field(pattern=r"^[^/\x00]{1,60}$")]
    position_m: Place
    azimuth_deg: Bearing | None = None
    normal: Point | None = None
    transfer: Annotated[Positive, Usual(0.1, 10.0)] | None = None
    recorded: RecordingConfig | None = None

    @model_validator(mode="after")
    def _one_direction(self):
        """Refuse a name of dots, a direction of length zero, and one beside an azimuth."""
        if not self.name.strip("."):
            raise ValueError(f"name: must not be dots alone, got {self.name!r}")
        if self.normal is not None and not any(self.normal):
            raise ValueError("normal: must not be zero in all components")
        if self.normal is not None and self.azimuth_deg is not None:
            raise ValueError("normal and azimuth_deg exclude one another; keep one")
        return self


class RunConfig(Section):
    """Run: duration, time step, snapshots, comparison."""

    duration_s: Annotated[Positive, Usual(5e-3, 60.0)]
    step_factor: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    local_damping: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    snapshots_s: list[NotNegative] = Field([])
    compare_band_hz: Band | None = None
    limit_curves: list[Curve] = Field([])

    @model_validator(mode="before")
    @classmethod
    def _no_added_mass(cls, given):
        """Refuse a key of earlier versions."""
        if isinstance(given, dict) and "added_mass" in given:
            raise ValueError("added_mass: small zones are implicit now and take no mass; remove it")
        return given

    @model_validator(mode="after")
    def _snapshots_within(self):
        """Refuse snapshots after the end."""
        late = [time for time in self.snapshots_s if time > self.duration_s]
        if late:
            raise ValueError(
                f"snapshots_s: must lie within duration_s = {self.duration_s:g}, got {late[0]:g}"
            )
        return self


class Config(Section):
    """Configuration: all tables of a project file."""

    title: Name
    assumed: list[Name] = Field([])
    mesh: MeshConfig
    materials: dict[Name, MaterialConfig]
    joints: dict[Name, JointConfig] = Field({})
    ground: GroundConfig = GroundConfig()
    boundaries: BoundariesConfig = BoundariesConfig()
    damping: DampingConfig | None = None
    absorbing_layer: AbsorbingLayerConfig | None = None
    insitu: InSituConfig | None = None
    blast: BlastConfig | None = None
    signature: SignatureConfig | None = None
    input: InputConfig = InputConfig()
    holes_inside: HolesInsideConfig | None = None
    point_forces: list[PointForceConfig] = Field([])
    moment_tensors: list[MomentTensorConfig] = Field([])
    pressures: list[PressureConfig] = Field([])
    air_blast: AirBlastConfig | None = None
    receivers: list[ReceiverConfig] = Field([])
    run: RunConfig
    priors: PriorsConfig = PriorsConfig()
    back_analysis: BackAnalysisConfig | None = None
    delays: DelaysConfig | None = None
    diagnosis: DiagnosisConfig | None = None

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Band in Hz in which motions are compared with records, None where none is given."""
        band = (self.diagnosis and self.diagnosis.band_hz) or self.run.compare_band_hz
        return None if band is None else (band[0], band[1])

    @model_validator(mode="after")
    def _what_enters(self, info: ValidationInfo):
        """Ask for something that moves the ground, and refuse tables that would do nothing."""
        holes, face = self.holes_inside is not None, self.signature is not None
        air, needed = self.air_blast is not None, (info.context or {}).get("ground", True)
        if needed and not (
            holes or face or air or self.point_forces or self.moment_tensors or self.pressures
        ):
            raise ValueError(
                "signature: missing; add it, or [holes_inside], [[point_forces]], "
                "[[moment_tensors]], [[pressures]] or [air_blast]"
            )
        if holes and face:
            raise ValueError("holes_inside: the blast enters twice; leave out [signature]")
        if holes and self.blast is None:
            raise ValueError("holes_inside: needs [blast] with places, charges and firing times")
        if air and self.blast is None:
            raise ValueError("air_blast: needs [blast] with collars and firing times")
        if needed and self.blast is not None and not (holes or face or air):
            raise ValueError(
                "blast: needs [signature], [holes_inside] or [air_blast] to enter the model"
            )
        if "input" in self.model_fields_set and not face:
            raise ValueError("input: needs [signature]; nothing else enters through a face")
        if holes and self.blast is not None and self.blast.reference_charge_kg is not None:
            raise ValueError("blast.reference_charge_kg: the moment rate is of 1 kg; leave it out")
        if holes and self.blast is not None and self.blast.wave_speed_m_per_s is not None:
            raise ValueError("blast.wave_speed_m_per_s: waves cross the model; leave it out")
        recorded = self.signature is not None and self.signature.recorded is not None
        if recorded and self.blast is not None and self.blast.wave_speed_m_per_s is not None:
            raise ValueError(
                "blast.wave_speed_m_per_s: a recorded signature does not say where hole and "
                "instrument stood, so no travel times follow; leave it out"
            )
        return self

    @model_validator(mode="after")
    def _in_the_box(self):
        """Refuse receivers and sources beyond the box of the ground and its padding."""
        mesh = self.mesh
        if mesh.size_m is None:
            return self
        out, box = mesh.padding_m or 0.0, zip("xy", mesh.origin_m, mesh.size_m, strict=False)
        ends = [(axis, start - out, start + size + out) for axis, start, size in box]
        for name in ("receivers", "point_forces", "moment_tensors"):
            for number, part in enumerate(getattr(self, name), start=1):
                for value, (axis, low, high) in zip(part.position_m, ends, strict=False):
                    if not low <= value <= high:
                        which = getattr(part, "name", None)
                        which = f"[{number}]" if which is None else f".{which}"
                        raise ValueError(
                            f"{name}{which}.position_m: lies outside of the ground, which "
                            f"reaches from {low:g} to {high:g} m along {axis}, got {value:g}"
                        )
        return self

    @model_validator(mode="after")
    def _known_damage(self):
        """Ask for the holes that damage the ground, and for the material of what is damaged."""
        zone = self.ground.damaged_zone
        if zone is not None and self.blast is None:
            raise ValueError("ground.damaged_zone: needs [blast] with the holes around which it is")
        if zone is not None and zone.material not in (None, *self.materials):
            raise ValueError(
                f"ground.damaged_zone.material: must be one of {', '.join(self.materials)}, "
                f"got {zone.material!r}"
            )
        return self

    @model_validator(mode="after")
    def _whole_candidates(self):
        """Refuse candidates with which this is no project file."""
        try:
            for each in self.diagnosis.candidates if self.diagnosis else ():
                with_candidate(self, each)
        except InputError as error:
            raise ValueError(str(error)) from None
        return self

    @model_validator(mode="after")
    def _free_field(self):
        """Refuse free-field sides that no input from below would reach."""
        if not self.boundaries.free_field:
            return self
        if self.signature is None:
            raise ValueError(
                "boundaries.free_field: needs [signature] that enters from below; for sources "
                "inside viscous sides do"
            )
        if self.input.enters_as == "plane_wave":
            raise ValueError(
                "boundaries.free_field: all viscous sides see a plane wave; move these to viscous"
            )
        return self

    @model_validator(mode="after")
    def _known_layers(self):
        """Refuse layers without a material and joint sets in no layer."""
        layers, known = [layer.material for layer in self.mesh.layers], ", ".join(self.materials)
        fills = [part.material for part in self.mesh.fills]
        for key, names in (("layers", layers), ("fills", fills)):
            for number, name in enumerate(names, start=1):
                if name not in self.materials:
                    raise ValueError(
                        f"mesh.{key}[{number}].material: must be one of {known}, got {name!r}"
                    )
        for part in self.mesh.joint_sets:
            for region in part.regions:
                if region not in layers:
                    raise ValueError(
                        f"mesh.joint_sets.{part.name}.regions: must be layers "
                        f"({', '.join(layers)}), got {region!r}"
                    )
        return self


VARIANT = "full"


def read_config(path, full=False, ground=True) -> Config:
    """Read and check a project file.

    Parameters
    ----------
    path : path
    full : bool
        Whether the table ``[full]`` of the file overrides the rest.
    ground : bool
        Whether the file must describe ground, run and what enters it.

    Returns
    -------
    Config

    Raises
    ------
    ReadError
        If the file can't be read.
    InputError
        If it is no TOML or breaks a rule; one sentence with file, key, rule and value.
    """
    path = Path(path)
    return check_config(read_toml(path), path.name, full, ground)


def required_table(config: Config, name: str, path):
    """Return a table of a configuration; raise InputError if its file lacks it."""
    table = getattr(config, name)
    if table is None:
        raise InputError(f"{Path(path).name}: {name}: missing; add the table with its parameters")
    return table


def check_config(table, name="project.toml", full=False, ground=True) -> Config:
    """Turn the tables of a project file, as nested dicts, into a `Config`."""
    table = dict(table)
    variant = table.pop(VARIANT, None)
    if full and variant is None:
        raise InputError(f"{name}: {VARIANT}: missing; the file has no table [{VARIANT}]")
    if full:
        table = merged(table, variant)
    try:
        table = table if ground else with_unused_ground(table)
        config = Config.model_validate(table, context={"ground": ground})
    except (ValidationError, RecursionError) as error:
        raise InputError(f"{name}: {sentence_of(error, Config)}") from None
    for key in config.assumed:
        if value_at(config, key) is None:
            raise InputError(f"{name}: assumed: {key!r} must name a key of this file")
    return config
