"""What a project file may say about delays that are sought: limits, houses, scatter."""

from typing import Annotated

from pydantic import Field, model_validator

from .config_recording import RecordingConfig
from .config_section import Band, Count, Curve, Name, NotNegative, Point, Positive, Section

Ends = Annotated[list[NotNegative], Field(min_length=2, max_length=2)]


class HouseConfig(Section):
    """A house with its limit: a receiver, or a place where a single hole was recorded."""

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
    """Between which delays the best are sought, and what is uncertain about holes."""

    between_holes_ms: Ends
    between_rows_ms: Ends
    step_ms: Positive = 1.0
    holes_per_row: Count | None = None
    band_hz: Band | None = None
    share_percent: Annotated[float, Field(gt=0.0, lt=100.0)] = 90.0
    most_charge_kg: Positive | None = None
    scatter_ms: NotNegative = 0.0
    scatter_percent: NotNegative = 0.0
    charge_percent: NotNegative = 0.0
    blast_percent: NotNegative = 0.0
    doubt: NotNegative = 0.0
    wave_speed_m_per_s: Positive | None = None
    draws: Count = 4000
    seed: Annotated[int, Field(ge=0)] = 0
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
