"""What a project file may say about ground that is not the same everywhere."""

from typing import Annotated

from pydantic import Field, model_validator

from .config_section import Name, Positive, Section

Share = Annotated[float, Field(ge=0.0, lt=1.0)]


class GradientConfig(Section):
    """Wave speeds that grow with depth."""

    reduction: Share
    length_m: Positive
    top_m: float | None = None


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
    seed: Annotated[int, Field(ge=0)] = 0
    hurst: Annotated[float, Field(gt=0.0, le=1.0)] = 0.5


class GroundConfig(Section):
    """Factors on the wave speeds of all materials."""

    gradient: GradientConfig | None = None
    damaged_zone: DamagedZoneConfig | None = None
    heterogeneity: HeterogeneityConfig | None = None
