"""Case: the records of a project and of its further blasts, gathered into arrays."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..inference.records import Records
from ..project.checks import carried_band
from ..project.places import NEAR, longest_path, resolved_receivers, survey_positions
from ..project.project import Project


@dataclass(frozen=True, eq=False, kw_only=True)
class Case(Records):
    """Case: the records of blasts of a project, from the first hole of each blast on.

    Blasts are ordered from the smallest charge to the largest.

    Parameters
    ----------
    project : Project
        The reference ground with its blasts; all receivers are given, in geographic axes where
        both horizontals were recorded.
    carried : str
        Why only a part of the band is compared; empty where the mesh carries all.
    gain : (n_receivers,) float64, optional
        Factor on simulated motion, as trusted shots show it.
    clock : (n_receivers,) float64, optional
        By how many s records are late, as first arrivals of trusted shots show it.
    share : (n_receivers,) float64, optional
        Model error, share of the energy of a record, as trusted shots show it.
    """

    project: Project
    carried: str = ""
    gain: np.ndarray | None = None
    clock: np.ndarray | None = None
    share: np.ndarray | None = None


def case_of(project: Project, blasts=None) -> Case:
    """Gather the records of a project and of its further blasts.

    Parameters
    ----------
    project : Project
    blasts : sequence of str, optional
        Names of blasts; all by default.

    Raises
    ------
    InputError
        If a blast does not exist or has no record, records differ in sampling, none begins before
        the blast, the band is missing or comes near half the sampling rate, or the description of
        a flat box is contradictory.
    """
    limits = project.config.band_hz
    if limits is None:
        raise InputError(
            f"{project.path.name}: diagnosis.band_hz: missing; give lowest and highest frequency, "
            "such as [4, 30]"
        )
    project = _with_mesh(project, limits[1])
    held = replace(project.survey, shots=project.held_shots)
    project = replace(project, survey=held.geographic())
    names = tuple(blasts or project.blasts)
    for name in names:
        project.survey.shot(name)
    names = tuple(sorted(names, key=lambda name: float(np.nansum(project.blasts[name].charge))))
    recorded = set().union(*(project.survey.recordings[name] for name in names))
    receivers = tuple(r.name for r in project.stations if r.name in recorded)
    if not receivers:
        raise InputError("case: none of the receivers has a record")
    own = [project.of(name) for name in names]
    far = [set(resolved_receivers(each, receivers, injected=False)) for each in own]
    near = [name for name in receivers if not all(name in each for each in far)]
    receivers = tuple(name for name in receivers if name not in near)
    if not receivers:
        raise InputError(
            "case: every receiver stands near a source of some blast, where the mesh makes errors "
            "above 20 % (D38); name blasts that leave one"
        )
    limits, carried = carried_band(own, limits, receivers)
    assert limits is not None  # a case has a band
    table = project.config.diagnosis
    survey = replace(project.survey, shots=tuple(project.survey.shot(name) for name in names))
    records = survey.records(
        receivers, limits,
        until=(table and table.until_s) or np.inf, noise=table and table.noise_window_s,
        unused={(blast, name): NEAR for blast in names for name in near},
    )  # fmt: skip
    return Case(**vars(records), project=project, carried="" if carried is None else carried.text)


def _with_mesh(project, highest):
    """Return a project with meshed blasts for a band; all share the ground.

    The ground reaches half the longest of the shortest S wavelengths beyond holes and receivers, so
    that receivers can be moved.
    """
    reach = 0.5 * max(material.cs for material in project.materials.values()) / highest
    aside = reach * np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
    positions = np.concatenate([survey_positions(project) + step for step in aside])
    project = replace(project, span=longest_path(positions))
    return project.changed(mesh=project.for_band(highest))
