"""The only table of unit factors: the suffix of a key says the unit, everything inside is SI."""

import math
from typing import overload

from .errors import InputError

FACTORS = {
    "gpa_per_m": 1e9,
    "mpa_per_m": 1e6,
    "pa_per_m": 1.0,
    "mpa_s_per_m": 1e6,
    "pa_s_per_m": 1.0,
    "kg_per_m3": 1.0,
    "m_per_s": 1.0,
    "mm_per_s": 1e-3,
    "cm_per_s": 1e-2,
    "um_per_s": 1e-6,
    "nm_per_s": 1e-9,
    "in_per_s": 0.0254,
    "m_per_s2": 1.0,
    "mm_per_s2": 1e-3,
    "cm_per_s2": 1e-2,
    "m3": 1.0,
    "m2": 1.0,
    "kpa": 1e3,
    "mpa": 1e6,
    "gpa": 1e9,
    "pa": 1.0,
    "kg": 1.0,
    "tonne": 1e3,
    "us": 1e-6,
    "ms": 1e-3,
    "s": 1.0,
    "minute": 60.0,
    "km": 1e3,
    "mm": 1e-3,
    "cm": 1e-2,
    "us_ft": 1200.0 / 3937.0,
    "ft": 0.3048,
    "in": 0.0254,
    "m": 1.0,
    "lb": 0.45359237,
    "khz": 1e3,
    "hz": 1.0,
    "kn": 1e3,
    "n": 1.0,
    "percent": 1e-2,
    "g": 9.80665,
    "mv": 1e-3,
    "v": 1.0,
}
# Of the properties of laws, by what the routines get: SI, "1" (pure number), "tan" (tangent of an
# angle). Their units in project files follow, the customary one first.
PROPERTY_UNITS = {
    "Pa/m": ("gpa_per_m", "mpa_per_m", "pa_per_m"),
    "Pa s/m": ("mpa_s_per_m", "pa_s_per_m"),
    "Pa": ("kpa", "mpa", "pa"),
    "m": ("mm", "m"),
    "s": ("ms", "s"),
    "tan": ("angle_deg",),
    "1": ("",),
}
STEEPEST = 84.0  # degrees, of friction and dilation; larger tangents are angles in degrees
_LONGEST_FIRST = sorted([*FACTORS, "angle_deg", "deg"], key=len, reverse=True)


def split_key(key: str) -> tuple[str, str]:
    """Split a key into its stem and its unit suffix; the suffix is empty where there is none."""
    for suffix in _LONGEST_FIRST:
        if key.endswith("_" + suffix):
            return key[: -len(suffix) - 1], suffix
    return key, ""


@overload
def to_si(key: str, value: float) -> tuple[str, float]: ...
@overload
def to_si(key: str, value: list[float] | tuple[float, ...]) -> tuple[str, list[float]]: ...
def to_si(key, value):
    """Convert ``kn_gpa_per_m = 1.3`` into ``("kn", 1.3e9)``.

    Parameters
    ----------
    key : str
        Name with its unit as suffix. ``_angle_deg`` becomes a tangent (friction, dilation),
        ``_deg`` becomes radians.
    value : float or list of float

    Returns
    -------
    stem : str
    value : float or list of float, SI

    Raises
    ------
    InputError
        If a friction or dilation angle lies outside 0 to 84 degrees.
    """
    stem, suffix = split_key(key)
    if isinstance(value, (list, tuple)):
        return stem, [to_si(key, item)[1] for item in value]
    if suffix == "angle_deg":
        if not 0.0 <= value <= STEEPEST:
            raise InputError(f"{key}: must lie between 0 and {STEEPEST:g} degrees, got {value:g}")
        return stem, math.tan(math.radians(value))
    if suffix == "deg":
        return stem, math.radians(value)
    return stem, value * FACTORS.get(suffix, 1.0)


LARGEST_ANGLE = 2.0 * math.pi * (1.0 + 1e-9)  # rad
LARGEST_TANGENT = math.tan(math.radians(STEEPEST)) * (1.0 + 1e-9)
SMALLEST_DENSITY = 100.0  # kg/m3
SMALLEST_MODULUS = 1e5  # Pa
SMALLEST_SPEED = 20.0  # m/s
SMALLEST_STIFFNESS = 1e4  # Pa/m
LARGEST_MODEL = 5e4  # m


def check_angle(where: str, angle: float) -> None:
    """Raise InputError for an angle beyond a full turn: it is in degrees, not in radians."""
    if abs(angle) > LARGEST_ANGLE:
        raise InputError(
            f"{where}: must lie between -2 pi and 2 pi rad, got {angle:g}, which looks like "
            "degrees; use math.radians"
        )


def check_tangent(where: str, tangent: float) -> None:
    """Raise InputError for the tangent of a friction or dilation angle above 84 degrees."""
    if LARGEST_TANGENT < tangent < math.inf:
        raise InputError(
            f"{where}: must be the tangent of an angle up to {STEEPEST:g} degrees, "
            f"{LARGEST_TANGENT:.4g}, got {tangent:g}, which looks like degrees; use "
            f"math.tan(math.radians({tangent:g}))"
        )


def check_density(where: str, density: float) -> None:
    """Raise InputError for a density below that of any ground: it is in t/m3 or g/cm3."""
    if 0.0 < density < SMALLEST_DENSITY:
        raise InputError(
            f"{where}: must be at least {SMALLEST_DENSITY:g} kg/m3, got {density:g}, which looks "
            "like t/m3; multiply by 1000"
        )


def check_modulus(where: str, modulus: float) -> None:
    """Raise InputError for an elastic modulus below that of any ground: it is in GPa or MPa."""
    if 0.0 < modulus < SMALLEST_MODULUS:
        unit, factor = ("GPa", "1e9") if modulus < 1e3 else ("MPa", "1e6")
        raise InputError(
            f"{where}: must be at least {SMALLEST_MODULUS:g} Pa, got {modulus:g}, which looks like "
            f"{unit}; multiply by {factor}"
        )


def check_speed(where: str, speed: float) -> None:
    """Raise InputError for a wave speed below that of any ground: it is in km/s."""
    if 0.0 < speed < SMALLEST_SPEED:
        raise InputError(
            f"{where}: must be at least {SMALLEST_SPEED:g} m/s, got {speed:g}, which looks like "
            "km/s; multiply by 1000"
        )


def check_stiffness(where: str, stiffness: float) -> None:
    """Raise InputError for a joint stiffness below that of any joint: it is in GPa/m."""
    if 0.0 < stiffness < SMALLEST_STIFFNESS:
        raise InputError(
            f"{where}: must be at least {SMALLEST_STIFFNESS:g} Pa/m, got {stiffness:g}, which "
            "looks like GPa/m; multiply by 1e9"
        )


def check_length(where: str, length: float) -> None:
    """Raise InputError for a model wider than any of a blast: it is in millimetres."""
    if length > LARGEST_MODEL:
        raise InputError(
            f"{where}: must be at most {LARGEST_MODEL:g} m wide, got {length:g}, which looks like "
            "millimetres; divide its coordinates by 1000"
        )


def plain_number(value: float, digits: int = 3) -> str:
    """Write a number for a sentence: significant digits, no positive exponent."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text else text


def in_minutes(minutes: float) -> str:
    """Return a time in words: seconds, minutes or hours.

    Examples
    --------
    >>> in_minutes(0.05), in_minutes(7.3), in_minutes(300.0)
    ('3 s', '7.3 min', '5 h')
    """
    if minutes < 1.0:
        return f"{plain_number(max(1.0, 60.0 * minutes), 2)} s"
    if minutes < 120.0:
        return f"{plain_number(minutes, 2)} min"
    return f"{plain_number(minutes / 60.0, 2)} h"
