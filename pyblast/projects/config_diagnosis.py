"""What a project file may say about a diagnosis: further blasts, band, where noise is alone."""

from pydantic import Field, model_validator

from .config_section import Band, Name, Section, Span


class DiagnosisConfig(Section):
    """Which records a diagnosis compares, and in which band."""

    blasts: list[Name] = Field([])
    band_hz: Band | None = None
    noise_window_s: Span | None = None

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
