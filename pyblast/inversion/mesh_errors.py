"""The error of the mesh of projects, foreseen from runs on one with longer edges."""

from dataclasses import replace

import numpy as np

from ..errors import InputError, PyblastError
from ..projects.key_paths import number_paths, value_at
from ..projects.places import on_ground
from ..projects.project import Project
from ..projects.variants import vary
from ..residuals.nuisances import mesh_error
from .forward import simulate
from .listening import listening
from .waveforms import gathered

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
