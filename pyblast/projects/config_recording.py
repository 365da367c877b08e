"""What a project file may say about recorded motion."""

from .config_section import Bearing, Count, Positive, Section


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
