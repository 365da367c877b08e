"""The blasts of a back-analysis: projects of the same ground, each with its own records."""

from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..projects.project import Project, load_project


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
                "[receivers.recorded], or ask with backanalyse --plan, which needs none"
            )
    return blasts


def chosen_records(blast: Project, project: Project) -> dict[str, Seismogram]:
    """Return the records of a blast that count in the back-analysis of a project."""
    names = project.config.back_analysis.receivers or blast.recorded
    return {name: record for name, record in blast.recorded.items() if name in names}
