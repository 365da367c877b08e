"""What a project file may say about a back-analysis: unknowns, ranges, method."""

from typing import Annotated

from pydantic import Field

from .config_section import Count, Name, Positive, Section, Span

DEFAULT_METHOD = "levenberg"  # won on twins: docs/decisions.md, "Least squares by default"


class ParameterConfig(Section):
    """An unknown: the dotted path of a key and its range, in the unit of the key."""

    path: Name
    low: float
    high: float
    log: bool = False
    laboratory: Span | None = None


class BackAnalysisConfig(Section):
    """What is to be found, from which records, how."""

    method: Name = DEFAULT_METHOD
    misfit: Name = "paper"
    runs: Count = 21
    seed: Annotated[int, Field(ge=0)] = 0
    receivers: list[Name] = Field([])
    blasts: list[Name] = Field([])
    posterior: bool = False
    noise_mm_per_s: Positive | None = None
    candidate_grid: Annotated[list[Count], Field(min_length=2, max_length=2)] = Field([5, 4])
    candidate_blasts: list[Name] = Field([])
    parameters: Annotated[list[ParameterConfig], Field(min_length=1)]
