"""Strengths that records can't tell, because nothing slips."""

from ..projects.ground import joint_of_surface
from ..units import split_key
from .parameters import with_values
from .strength import STRENGTH


def is_strength(parameter) -> bool:
    """Tell whether a parameter is a strength of a joint."""
    table, *_, key = parameter.path.split(".")
    return table == "joints" and split_key(key)[0].removesuffix("_residual") in STRENGTH


def weakest(project, parameters, values):
    """Return the joints with the lowest strengths of the ranges, the rest as given."""
    lowest = [
        one.low if is_strength(one) else value
        for one, value in zip(parameters, values, strict=True)
    ]
    return with_values(project, parameters, lowest).joints


def insensitive(parameter, projects, strengths) -> str:
    """Say why records can't tell a strength: nothing slipped in any blast; else nothing.

    Parameters
    ----------
    parameter : Parameter
    projects : sequence of Project
        One for each blast.
    strengths : sequence of dict of str to Strength
        For each blast by joint surface.
    """
    if not is_strength(parameter):
        return ""
    entry = parameter.path.split(".")[1]
    found = [
        strength[surface]
        for project, strength in zip(projects, strengths, strict=True)
        for surface in surfaces_of(project, entry)
        if surface in strength
    ]
    if not found or any(one.failed for one in found):
        return ""
    least = min(one.weakest_factor for one in found)
    over = "whatever its value in the range" if least > 1.0 else "though lower values would slip"
    return f"no contact of '{entry}' slipped or opened, {over}"


def surfaces_of(project, entry) -> list[str]:
    """Return the joint surfaces that an entry of ``[joints]`` stands for."""
    return [name for name, one in joint_of_surface(project.config.mesh).items() if one == entry]
