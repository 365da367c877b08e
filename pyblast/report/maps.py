"""Maps and grids: the plan of a run, peak velocity over its surface, files for ParaView and GIS."""

from pathlib import Path

import meshio
import numpy as np

from ..errors import ReadError
from ..mesh.mesh import edge_lengths
from ..project.checks_ground import carried_frequency
from ..project.result import write_text
from ..solver.initial_stress import yield_states


def zone_fields(model):
    """Return the fields of zones: group, block, highest frequency carried; dict of (n_zones,)."""
    mesh = model.mesh
    edge = edge_lengths(mesh).mean(axis=1)
    return {
        "group": mesh.zone_group.astype(np.int32),
        "block": mesh.blocks().astype(np.int32),
        "f_max": carried_frequency(model.zone_values("cs"), edge, model.edges_per_wavelength),
    }


def yield_fields(run):
    """Return stress (Pa) and plastic strains of plastic zones, nan elsewhere; empty without any.

    The stress has ParaView's order xx yy zz xy yz zx.
    """
    constants = run.prepared.constants
    if constants["hex_order"]:
        return {}
    zone, stress, plastic = yield_states(constants, run.state)
    if not len(zone):
        return {}
    values = np.full((len(constants["zone_row"]), 8), np.nan)
    values[zone] = np.hstack([stress, plastic])
    return {
        "stress": values[:, [0, 1, 2, 5, 3, 4]],
        "plastic_shear": values[:, 6],
        "plastic_tension": values[:, 7],
    }


def write_zones(path, points, zones, fields, node_fields=None):
    """Write tetrahedra with values per zone and per node.

    Parameters
    ----------
    path : path
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32
    fields, node_fields : dict of str to array
    """
    cells = [("tetra", zones)]
    mesh = meshio.Mesh(points, cells, node_fields or {}, {n: [v] for n, v in fields.items()})
    _write(path, mesh)


def write_joints(path, mesh, displacement=None):
    """Write joint surfaces with their number and the displacement jump of each node.

    Parameters
    ----------
    path : path
    mesh : Mesh
        Split.
    displacement : (n_nodes, 3) float64, m, optional
    """
    names = mesh.contacts.names if mesh.contacts is not None else ()
    triangles = np.concatenate([np.empty((0, 3), np.int32), *(mesh.surfaces[n] for n in names)])
    number = np.repeat(np.arange(len(names)), [len(mesh.surfaces[n]) for n in names])
    fields = {}
    contacts = mesh.contacts
    if displacement is not None and contacts is not None and len(names):
        jump = np.zeros_like(mesh.points)
        jump[contacts.minus] = displacement[contacts.plus] - displacement[contacts.minus]
        fields["jump"] = jump
    joints = {"joint": [number.astype(np.int32)]}
    _write(path, meshio.Mesh(mesh.points, [("triangle", triangles)], fields, joints))


def write_motion(folder, points, zones, snapshots):
    """Write node velocities at some instants, and a ParaView collection of them.

    Parameters
    ----------
    folder : Path
    points, zones : arrays of the mesh
    snapshots : dict of float (s) to (n_nodes, 3) float32, m/s
    """
    lines = []
    for number, (time, velocity) in enumerate(sorted(snapshots.items())):
        name = f"motion_{number:03d}.vtu"
        write_zones(Path(folder) / name, points, zones, {}, {"velocity": velocity})
        lines.append(f'<DataSet timestep="{time:.9g}" file="{name}"/>')
    if lines:
        body = "\n".join(lines)
        write_text(
            Path(folder) / "motion.pvd",
            '<VTKFile type="Collection" version="0.1"><Collection>\n'
            f"{body}\n</Collection></VTKFile>\n",
        )


def _write(path, mesh):
    """Write to a temporary file and rename it; `ReadError` if the path can't be written."""
    path = Path(path)
    beside = path.with_name(f".{path.stem}.part.vtu")
    try:
        mesh.write(beside, file_format="vtu")
        beside.replace(path)
    except OSError as error:
        raise ReadError(f"{path}: can't be written ({error.strerror or error})") from None
    finally:
        beside.unlink(missing_ok=True)
