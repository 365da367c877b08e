"""Tables of a project file about sources: holes inside, forces, moment tensors, pressures."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..blasts.site_law import scaled_distance_ppv
from .keys import (
    Charge,
    ChargeExponent,
    Exponent,
    Law,
    Name,
    Peak,
    Place,
    Point,
    Positive,
    Radius,
    Speed,
    Usual,
)
from .section import Section

Tensor = Annotated[list[float], Field(min_length=6, max_length=6)]


class SiteLawConfig(Section):
    """Scaled-distance law of the site: peak velocity k (R / W^charge_exponent)^-exponent."""

    k_mm_per_s: Positive
    exponent: Exponent
    charge_exponent: ChargeExponent = 0.5

    def ppv(self, distance: float, charge: float) -> float:
        """Return the peak velocity in m/s at a distance in m from a charge in kg."""
        law = 1e-3 * self.k_mm_per_s, self.exponent, self.charge_exponent
        return float(scaled_distance_ppv(distance, charge, *law))


def refuse_two_levels(section) -> None:
    """Refuse two levels of a charged hole; without one it follows from a published law."""
    keys = ("pressure_mpa", "peak_mm_per_s", "law", "site_law")
    stated = [key for key in keys if getattr(section, key) is not None]
    if len(stated) > 1:
        raise ValueError(f"give {stated[0]} or {stated[1]}, not both")


class ChargedHoleConfig(Section):
    """The moment of a charged hole in closed form; its pulse by frequency, or by peak time."""

    material: Name
    charge_kg: Charge
    radius_m: Radius
    peak_time_ms: Peak | None = None
    frequency_hz: Positive | None = None
    pressure_mpa: Positive | None = None
    peak_mm_per_s: Positive | None = None
    law: Law | None = None
    site_law: SiteLawConfig | None = None
    distance_m: Positive | None = None

    @model_validator(mode="after")
    def _one_level(self):
        """Ask for at most one level; a measured peak needs its distance."""
        refuse_two_levels(self)
        if self.peak_time_ms is not None and self.frequency_hz is not None:
            raise ValueError("give peak_time_ms or frequency_hz, not both")
        if self.pressure_mpa is not None and self.distance_m is not None:
            raise ValueError("distance_m goes with a peak or a law, not with pressure_mpa")
        if self.peak_mm_per_s is not None and self.distance_m is None:
            raise ValueError("distance_m is missing beside peak_mm_per_s")
        return self


class HolesInsideConfig(Section):
    """The holes of the blast as sources inside the model: points, or columns that detonate."""

    moment_rate_file: str | None = None
    charged_hole: ChargedHoleConfig | None = None
    low_pass_hz: Positive | Literal["mesh", "none"] | None = None
    zero_phase: bool = False
    spread_m: Positive | None = None
    detonation_m_per_s: Annotated[Speed, Usual(1000.0, 10000.0)] | None = None
    primed_at: Literal["toe", "collar"] | None = None
    core_m: Positive | None = None

    @model_validator(mode="after")
    def _one_moment(self):
        """Ask for one of the two, and for columns that are whole."""
        self._one_of(("moment_rate_file",), ("charged_hole",))
        if self.zero_phase and self.low_pass_hz == "none":
            raise ValueError("zero_phase is of a low-pass; give low_pass_hz or leave it out")
        if self.primed_at is not None and self.detonation_m_per_s is None:
            raise ValueError("detonation_m_per_s is missing beside primed_at")
        if self.spread_m is not None and self.detonation_m_per_s is not None:
            raise ValueError("spread_m and detonation_m_per_s exclude one another; keep one")
        return self


class PointForceConfig(Section):
    """A force at a point; without height it acts on the surface "top"."""

    position_m: Place
    direction: Point
    file: str

    @model_validator(mode="after")
    def _somewhere(self):
        """Refuse a direction without length."""
        if not any(self.direction):
            raise ValueError("direction must not be [0, 0, 0]")
        return self


class MomentTensorConfig(Section):
    """A moment tensor at a point."""

    position_m: Point
    tensor: Tensor
    file: str
    spread_m: Positive | None = None

    @model_validator(mode="after")
    def _something(self):
        """Refuse a tensor that is nothing."""
        if not any(self.tensor):
            raise ValueError("tensor must not be zero")
        return self


class PressureConfig(Section):
    """A pressure on a surface; with a start and a speed it runs over it."""

    surface: Name
    file: str
    start_m: Point | None = None
    speed_m_per_s: Positive | None = None

    @model_validator(mode="after")
    def _both(self):
        """Ask for both, where it begins and how fast it runs."""
        if (self.start_m is None) != (self.speed_m_per_s is None):
            raise ValueError("start_m and speed_m_per_s go together")
        return self


class AirBlastConfig(Section):
    """Pressure through the air over a free surface, from the collars of the blast."""

    surface: Name = "top"
    file: str | None = None
    pressure_kpa: Positive | None = None
    duration_ms: Positive | None = None
    reference_m: Positive = 1.0
    reference_charge_kg: Positive | None = None
    exponent: Exponent = 1.0
    charge_exponent: ChargeExponent | None = None
    speed_m_per_s: Annotated[Speed, Usual(250.0, 450.0)] = 340.0

    @model_validator(mode="after")
    def _one_pulse(self):
        """Ask for a pulse, as a file or in closed form, and for both or none of the charge."""
        self._one_of(("file",), ("pressure_kpa", "duration_ms"))
        if (self.reference_charge_kg is None) != (self.charge_exponent is None):
            raise ValueError("reference_charge_kg and charge_exponent go together")
        return self
