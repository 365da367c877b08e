"""The blasts of a back-analysis: projects of the same ground, each with its own records."""

from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..projects.project import Project, load_project


def blasts_of(project: Project) -> tuple[Project, ...]:
    """Return a project and those that its back-analysis names beside it.

    Raises
    ------
    InputError
        If one is named twice, has no record, or lacks the record of a receiver that is asked for.
    """
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    blasts = (project, *(load_project(project.folder / name) for name in table.blasts))
    names = [blast.path.name for blast in blasts]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}.blasts: {name!r} is named twice")
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
                f"{blast.path.name}: receivers: none has a record to meet; add [receivers.recorded]"
            )
    return blasts


def chosen_records(blast: Project, project: Project) -> dict[str, Seismogram]:
    """Return the records of a blast that count in the back-analysis of a project."""
    names = project.config.back_analysis.receivers or blast.recorded
    return {name: record for name, record in blast.recorded.items() if name in names}
