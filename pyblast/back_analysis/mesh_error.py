"""Mesh error at receivers and possible receivers, from a run on a coarser mesh."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, PyblastError
from ..inference.error_model import mesh_error
from ..project.config import ReceiverConfig
from ..project.places import on_ground
from ..project.project import Project, make_project, vary
from ..project.section import number_paths, value_at
from .trials import simulate
from .waveforms import gathered


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
    """Return the middles of a grid on the surface "top", outside of the absorbing layer."""
    mesh, layer = project.mesh, project.absorbing_layer
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
            if layer is None or not layer.alpha(np.array([place]), 1.0).any():
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
    return make_project(config, project.path, {"mesh": project.mesh})


COARSER = 1.5  # edges of the other mesh over those of the working one
EDGES = {"edge_m": COARSER, "edges_per_wavelength": 1.0 / COARSER}


def coarser(project: Project) -> Project:
    """Return a project whose mesh has edges 1.5 times as long.

    Raises
    ------
    InputError
        If its mesh is a file or a regular grid, which have no edges to lengthen.
    """
    mesh, name = project.config.mesh, project.path.name
    for key in ("file", "grid_cells"):
        if getattr(mesh, key) is not None:
            raise InputError(
                f"{name}: mesh.{key}: such a mesh can't be made coarser; give mesh.edge_m"
            )
    factors = {
        path: EDGES[path.rpartition(".")[-1]]
        for path in number_paths(project.config)
        if path.startswith("mesh.") and path.rpartition(".")[-1] in EDGES
    }
    changes = {path: value_at(project.config, path) * factor for path, factor in factors.items()}
    return vary(project, changes)


def mesh_errors_of(projects, motion, receivers, window, places=None):
    """Return what the mesh does to the motion of projects, and if that can't be told, why.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast, with the values that the motion was made with.
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    receivers : sequence of str
    window : Window
    places : sequence of Place, optional
        Where these receivers stand, if the projects do not say so.

    Returns
    -------
    tuple of (n_blasts, n_receivers, 3, n_samples) float64, m/s
        One error, or none.
    str
        Why there is none, else nothing.

    Notes
    -----
    theory.md (7.15).
    """
    found = []
    for project in projects:
        try:
            other = coarser(project)
            if places is not None:
                other = listening(other, [_moved(place, project, other) for place in places])
            found += simulate(other, (), [()])
        except PyblastError as error:
            return (), f"the error of the mesh is not foreseen: {error}"
    return (mesh_error(motion, gathered(found, receivers, window), COARSER),), ""


def _moved(place, project, other):
    """Return a place of the surface of one mesh on that of another."""
    if place.name in {one.name for one in project.config.receivers}:
        return place
    return replace(place, position=tuple(np.array(on_ground(other.mesh, place.position[:2]))))
