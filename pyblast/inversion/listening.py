"""Where else motion could be recorded: receivers of a project and a grid on its surface."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..projects.config import ReceiverConfig
from ..projects.places import on_ground
from ..projects.project import Project, make_project


@dataclass(frozen=True)
class Place:
    """A receiver that counts, or one that could.

    Parameters
    ----------
    name : str
    position : tuple of 3 float, m
    counts : bool
        Whether its records are there or foreseen.
    gridded : bool
        Whether it is a place of the grid.
    """

    name: str
    position: tuple[float, float, float]
    counts: bool
    gridded: bool = False


def places_of(projects, counting, apart) -> list[Place]:
    """Return the receivers of projects, those that count first, and a grid on the surface.

    Parameters
    ----------
    projects : sequence of Project
        The first one says how fine the grid is.
    counting : sequence of str
    apart : float, m
        Places of the grid stand at least so far from the receivers.
    """
    known = {one.name: one for project in projects[::-1] for one in project.receivers}
    own = [Place(one.name, one.position, one.name in counting) for one in known.values()]
    own.sort(key=lambda place: not place.counts)
    stand = np.array([place.position for place in own])
    found = []
    for place in _grid(projects[0]):
        away = np.linalg.norm(stand - place, axis=1)
        if np.min(away) >= apart:
            found.append(Place(f"{place[0]:.0f}, {place[1]:.0f} m", tuple(place), False, True))
    return [*own, *found]


def _grid(project):
    """Return the middles of a grid on the surface "top", outside of the rim."""
    mesh, rim = project.mesh, project.rim
    if "top" not in mesh.surfaces:
        return []
    corners = mesh.points[np.unique(mesh.surfaces["top"])][:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    counts = project.config.back_analysis.candidate_grid
    axes = [low[k] + (np.arange(n) + 0.5) / n * (high[k] - low[k]) for k, n in enumerate(counts)]
    found = []
    for x in axes[0]:
        for y in axes[1]:
            try:
                place = on_ground(mesh, (float(x), float(y)))
            except InputError:  # the surface does not fill its rectangle
                continue
            if rim is None or not rim.alpha(np.array([place]), 1.0).any():
                found.append(place)
    return found


def listening(project: Project, places) -> Project:
    """Return a project with receivers at places, on the same mesh; its own keep their axes."""
    own = {one.name: one for one in project.config.receivers}
    receivers = [
        own[place.name].model_copy(update={"recorded": None})
        if place.name in own
        else ReceiverConfig(name=place.name, position_m=[float(x) for x in place.position])
        for place in places
    ]
    config = project.config.model_copy(update={"receivers": receivers})
    found = make_project(config, project.path)
    vars(found)["mesh"] = project.mesh
    return found
