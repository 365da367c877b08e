"""What all tables of a project file share: strictness and ranges."""

from contextlib import contextmanager
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from ..errors import InputError, ReadError
from ..motion.limits import load_limits

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]
Quality = Annotated[float, Field(ge=2.0)]
Count = Annotated[int, Field(ge=1)]
Dip = Annotated[float, Field(ge=0.0, le=90.0)]
Bearing = Annotated[float, Field(ge=-360.0, le=360.0)]
Inclination = Annotated[float, Field(ge=0.0, le=180.0)]
FrictionAngle = Annotated[float, Field(ge=0.0, lt=89.0)]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Place = Annotated[list[float], Field(min_length=2, max_length=3)]
Size = Annotated[list[Positive], Field(min_length=3, max_length=3)]
Span = Annotated[list[float], Field(min_length=2, max_length=2)]
Box = Annotated[list[Span], Field(min_length=3, max_length=3)]
Band = Annotated[
    list[Positive], Field(min_length=2, max_length=2), AfterValidator(lambda band: _rising(band))
]
Infill = Annotated[list[Positive], Field(min_length=1, max_length=2)]
Name = Annotated[str, Field(min_length=1, max_length=80)]
Curve = Annotated[str, AfterValidator(lambda key: _known(key))]


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


@contextmanager
def named_error(where):
    """Put a place of the project file before the message of an error in it or in its files."""
    try:
        yield
    except (InputError, ReadError) as error:
        raise type(error)(f"{where}: {error}") from None


def _known(key):
    """Refuse a limit curve that does not come with pyblast."""
    if key not in load_limits():
        raise ValueError(f"must be one of {', '.join(load_limits())}, got {key!r}")
    return key


def _rising(band):
    """Refuse a band that does not rise."""
    if not band[0] < band[1]:
        raise ValueError(f"must rise from the lowest to the highest frequency, got {band}")
    return band
