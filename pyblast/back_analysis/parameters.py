"""Blasts, records and parameters that the table [back_analysis] of a project names."""

from collections.abc import Sequence

import numpy as np

from ..config.config import BackAnalysisConfig, required_table
from ..config.section import check_path
from ..errors import Finding, InputError, named_error
from ..inference.parameter import Parameter, set_all
from ..project.checks import carried_band
from ..project.places import NEAR, resolved_receivers
from ..project.project import CHEAP, Project, load_project
from ..signals.seismogram import Seismogram
from ..solver.assembly import time_step
from ..units import split_key

# Larger values of these keys never allow a longer time step, and no other cheap key affects it.
STIFFENING = {"kn", "ks", "cohesion", "friction", "tension", "ratio"}
LEAST_STEP = 0.5  # of a common time step, as a share of the longest one in the ranges


def table_of(project: Project) -> tuple[BackAnalysisConfig, str]:
    """Return table ``[back_analysis]`` of a project, and its place for messages.

    Raises
    ------
    InputError
        If it is missing.
    """
    table = required_table(project.config, "back_analysis", project.path)
    return table, f"{project.path.name}: back_analysis"


def all_blasts(project: Project) -> tuple[Project, ...]:
    """Return the blasts of a back-analysis, recorded or planned: a project and those it names.

    Raises
    ------
    InputError
        If a blast is named twice.
    """
    table, where = table_of(project)
    blasts = (project, *(load_project(project.folder / name) for name in table.blasts))
    blasts = tuple(blast.with_low_pass for blast in blasts)
    names = [blast.path.name for blast in blasts]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}.blasts: {name!r} is named twice")
    return blasts


def candidate_blasts(project: Project) -> tuple[Project, ...]:
    """Return the candidate blasts: those that could be fired and recorded too."""
    names = table_of(project)[0].candidate_blasts
    return tuple(load_project(project.folder / name) for name in names)


def survey_records(blast: Project, project: Project) -> dict[str, Seismogram | None]:
    """Return the records of a blast in a survey by receiver, None where a record is only planned.

    Receivers are those of back_analysis.receivers, else those with a record, else all, without
    those that stand near a source (D38).

    Raises
    ------
    InputError
        If there is no such receiver.
    """
    known = [receiver.name for receiver in blast.config.receivers]
    names = table_of(project)[0].receivers or list(blast.recorded) or known
    for name in names:
        if name not in known:
            raise InputError(
                f"{project.path.name}: back_analysis.receivers: {blast.path.name} has no receiver "
                f"{name!r}; it has {', '.join(known) or 'none'}"
            )
    if not names:
        raise InputError(f"{blast.path.name}: receivers: missing; a survey needs at least one")
    compared, far = blast.comparable, resolved_receivers(blast, names)
    return {name: compared[name].seismogram if name in compared else None for name in far}


def blasts_of(project: Project) -> tuple[Project, ...]:
    """Return the recorded blasts of a back-analysis.

    Raises
    ------
    InputError
        If a blast is named twice, has no record, or lacks that of a receiver in the table.
    """
    table, where = table_of(project)
    blasts = all_blasts(project)
    for blast in blasts:
        for name in table.receivers:
            if name not in blast.recorded:
                known = ", ".join(blast.recorded) or "none"
                raise InputError(
                    f"{where}.receivers: {name!r} has no record in {blast.path.name}; with a "
                    f"record are {known}"
                )
        if not blast.recorded:
            raise InputError(
                f"{blast.path.name}: receivers: none has a record to fit; add "
                "[receivers.recorded], or use backanalyse --design-survey, which needs none"
            )
    return blasts


def fitted_blasts(project: Project) -> tuple[tuple[Project, ...], Finding | None]:
    """Return the recorded blasts in the band that their meshes carry, and D40 where it is less.

    Raises
    ------
    InputError
        As `blasts_of`, and if the meshes carry nothing of the band.
    """
    blasts = blasts_of(project)
    asked = table_of(project)[0].receivers
    names = {name for blast in blasts for name in chosen_records(blast, asked)}
    band, finding = carried_band(blasts, blasts[0].compared_band, sorted(names))
    if finding is None:
        return blasts, None
    return tuple(blast.compared_in(band) for blast in blasts), finding


def chosen_records(blast: Project, names: Sequence[str]) -> dict[str, Seismogram]:
    """Return the records of a blast that a back-analysis uses, low-passed like what enters.

    See `left_out`.
    """
    unused = left_out([blast], names)
    return {
        name: record.seismogram for name, record in blast.comparable.items()
        if (blast.name, name) not in unused
    }  # fmt: skip


def left_out(blasts: Sequence[Project], names: Sequence[str]) -> dict[tuple[str, str], str]:
    """Return why records are not used, by blast and receiver: not named, or near a source (D38).

    Parameters
    ----------
    blasts : sequence of Project
    names : sequence of str
        Receivers whose records are used; all if empty.
    """
    unused = {}
    for blast in blasts:
        asked = tuple(name for name in blast.recorded if not names or name in names)
        far = resolved_receivers(blast, asked)
        unused |= {
            (blast.name, name): NEAR if name in asked else "back_analysis.receivers lacks it"
            for name in blast.recorded if name not in far
        }  # fmt: skip
    return unused


def is_cheap(parameter: Parameter) -> bool:
    """Tell whether a change leaves mesh and ground unchanged, so that runs can form a batch."""
    return parameter.name.split(".")[0] in CHEAP


def range_of(parameter: Parameter) -> dict:
    """Return a parameter as in result files: key, range, scale, laboratory range."""
    return {
        "path": parameter.name, "low": parameter.low, "high": parameter.high,
        "log": parameter.log, "laboratory": parameter.laboratory,
    }  # fmt: skip


def parameters_of(project: Project) -> tuple[Parameter, ...]:
    """Return the parameters of table ``[back_analysis]`` of a project.

    Raises
    ------
    InputError
        If the table is missing, or a range is not valid.
    """
    table, where = table_of(project)
    with named_error(where):
        return tuple(
            Parameter(
                row.path,
                row.low,
                row.high,
                row.log,
                laboratory=None
                if row.laboratory is None
                else (row.laboratory[0], row.laboratory[1]),
            )
            for row in table.parameters
        )


def check_parameters(project: Project, parameters: Sequence[Parameter]):
    """Check that a project has the parameters, and that its rules allow their ranges.

    Raises
    ------
    InputError
        With the key.
    """
    if not parameters:
        raise InputError("back_analysis.parameters: missing; name at least one key")
    paths = [parameter.name for parameter in parameters]
    for number, parameter in enumerate(parameters, start=1):
        with named_error(f"{project.path.name}: back_analysis.parameters[{number}].path"):
            check_path(project.config, parameter.name)
        if paths.count(parameter.name) > 1:
            raise InputError(
                f"{project.path.name}: back_analysis.parameters[{number}].path: "
                f"{parameter.name!r} is given twice; keep one"
            )
        for end in ("low", "high"):
            with named_error(f"{project.path.name}: back_analysis.parameters[{number}].{end}"):
                parameter.set(project, getattr(parameter, end))


def common_time_step(project: Project, parameters):
    """Return the time step, with its limit, at which all models of the ranges are stable.

    With a common step the result at a point does not depend on the others of its batch. None if
    models differ in more than stiffness, strength and damping, or if the shortest step is at most
    half of the longest (lagged damping).
    """
    stems = {split_key(parameter.name.split(".")[-1])[0] for parameter in parameters}
    if not (stems <= STIFFENING and all(is_cheap(parameter) for parameter in parameters)):
        return None
    project.model  # noqa: B018  variants stand on the mesh of a model that is there
    ends = np.array([[parameter.low, parameter.high] for parameter in parameters])
    shortest = time_step(set_all(project, parameters, ends[:, 1]).model)
    longest = time_step(set_all(project, parameters, ends[:, 0]).model)
    return shortest if shortest[0] > LEAST_STEP * longest[0] else None
