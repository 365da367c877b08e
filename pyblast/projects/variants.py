"""The same project with other values, keeping what these do not change: above all its mesh."""

from dataclasses import replace

from .config import Config
from .config_file import check_config
from .ground import make_damping
from .key_paths import changed_tables
from .project import Project, make_project

CHEAP = {"joints", "damping"}


def vary(project: Project, changes: dict[str, float]) -> Project:
    """Return a project with other values at some keys.

    Parameters
    ----------
    project : Project
    changes : dict of str to float
        By dotted path, in the units of the keys: ``{"joints.fault.kn_gpa_per_m": 0.2}``.

    Returns
    -------
    Project
        Where only joints and damping differ, its model stands on the same mesh, so that `run_many`
        marches it beside others. Where nothing moves the mesh, it is not built again.

    Raises
    ------
    InputError
        If a path names no number, or a value breaks a rule of the project file.
    """
    name = project.path.name
    config = check_config(changed_tables(project.config, changes), name)
    varied, known = make_project(config, project.path), vars(project)
    tables = {
        table
        for table in Config.model_fields
        if getattr(config, table) != getattr(project.config, table)
    }
    kept = [name for name, needs in _needs(config).items() if not tables & needs]
    vars(varied).update({name: known[name] for name in kept if name in known})
    if tables <= CHEAP and "model" in known and not config.boundaries.jointed_faces:
        vars(varied).update(
            {name: known[name] for name in ("blast", "firing", "signature", "input", "inside",
             "sources", "rim") if name in known}
        )  # fmt: skip
        model = replace(project.model, joints=varied.joints, damping=make_damping(config))
        vars(varied)["model"] = model
    return varied


def _needs(config):
    """Return which tables decide what takes long to make."""
    mesh = {"mesh", "ground"}
    parts = [config.mesh, *config.mesh.layers]
    if any(part.edges_per_wavelength is not None for part in parts):
        mesh |= {"materials"}
    if config.ground.damaged_zone is not None:
        mesh |= {"blast", "materials"}
    return {"mesh": mesh, "receivers": mesh | {"receivers"}, "records": {"receivers"}}
