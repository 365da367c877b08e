"""Parameters of a back-analysis: keys of a project file with ranges, over one or more blasts."""

from collections.abc import Sequence

import numpy as np

from ..errors import InputError, named_error
from ..inference.parameter import Parameter
from ..project.project import CHEAP, Project, load_project, vary
from ..project.section import check_path
from ..signals.seismogram import Seismogram


def foreseen_blasts(project: Project) -> tuple[Project, ...]:
    """Return a project and those that its back-analysis names beside it, recorded or not.

    Raises
    ------
    InputError
        If one is named twice.
    """
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    blasts = (project, *(load_project(project.folder / name) for name in table.blasts))
    names = [blast.path.name for blast in blasts]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}.blasts: {name!r} is named twice")
    return blasts


def candidates_of(project: Project) -> tuple[Project, ...]:
    """Return the blasts that could be fired and recorded too."""
    names = project.config.back_analysis.candidate_blasts
    return tuple(load_project(project.folder / name) for name in names)


def foreseen_records(blast: Project, project: Project) -> dict[str, Seismogram | None]:
    """Return the records of a blast that count, None where one is only foreseen.

    Those of the receivers that are asked for, else of those that have one, else of all.

    Raises
    ------
    InputError
        If there is no such receiver.
    """
    known = [one.name for one in blast.config.receivers]
    names = project.config.back_analysis.receivers or list(blast.recorded) or known
    for name in names:
        if name not in known:
            raise InputError(
                f"{project.path.name}: back_analysis.receivers: {blast.path.name} has no receiver "
                f"{name!r}; it has {', '.join(known) or 'none'}"
            )
    if not names:
        raise InputError(f"{blast.path.name}: receivers: missing; a plan needs at least one")
    return {name: blast.recorded.get(name) for name in names}


def blasts_of(project: Project) -> tuple[Project, ...]:
    """Return the blasts of a back-analysis, each with its records.

    Raises
    ------
    InputError
        If one is named twice, has no record, or lacks the record of a receiver that is asked for.
    """
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    blasts = foreseen_blasts(project)
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
                f"{blast.path.name}: receivers: none has a record to meet; add "
                "[receivers.recorded], or ask with backanalyse --design-survey, which needs none"
            )
    return blasts


def chosen_records(blast: Project, project: Project) -> dict[str, Seismogram]:
    """Return the records of a blast that count in the back-analysis of a project."""
    names = project.config.back_analysis.receivers or blast.recorded
    return {name: record for name, record in blast.recorded.items() if name in names}


def is_cheap(parameter: Parameter) -> bool:
    """Tell whether a change leaves mesh and ground as they are, so that runs form a batch."""
    return parameter.name.split(".")[0] in CHEAP


def range_of(parameter: Parameter) -> dict:
    """Return a parameter as result files show it: key, range, scale, range of the laboratory."""
    return {
        "path": parameter.name, "low": parameter.low, "high": parameter.high,
        "log": parameter.log, "laboratory": parameter.laboratory,
    }  # fmt: skip


def parameters_of(project: Project) -> tuple[Parameter, ...]:
    """Return the unknowns that table ``[back_analysis]`` of a project names.

    Raises
    ------
    InputError
        If the table is missing, or a range is none.
    """
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    if table is None:
        raise InputError(f"{where}: missing; add the table with its parameters")
    with named_error(where):
        return tuple(
            Parameter(one.path, one.low, one.high, one.log, laboratory=one.laboratory)
            for one in table.parameters
        )


def check_parameters(project: Project, parameters: Sequence[Parameter]):
    """Refuse parameters that a project does not have, or that its rules forbid in the range.

    Raises
    ------
    InputError
        With the key.
    """
    if not parameters:
        raise InputError("back_analysis.parameters: missing; name at least one key to find")
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
                vary(project, {parameter.name: getattr(parameter, end)})


def with_values(project: Project, parameters: Sequence[Parameter], values) -> Project:
    """Return a project with the values (n,) of its parameters."""
    pairs = zip(parameters, np.asarray(values, dtype=np.float64).tolist(), strict=True)
    return vary(project, {parameter.name: value for parameter, value in pairs})
