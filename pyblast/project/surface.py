"""What cuts the ground of a project beside planes: benches, surveyed surfaces, fractures."""

from dataclasses import replace

import numpy as np

from ..config.section import read_columns
from ..errors import Finding, InputError, named_error
from ..mesh.faces import face_vectors
from ..mesh.grid import Fault, upward_normal
from ..mesh.mesh import inner_facets
from ..model.fractures import (
    FractureSet,
    SizeLaw,
    area_within,
    read_fractures,
    refuse_many,
    terminated,
)
from ..model.terrain import Bench, bench_triangles, bending, burdens, toe_of, walked
from ..readers.geometry import (
    SurveyedSurface,
    read_content,
    read_lines,
    read_surface,
    surface_format,
)

LARGEST_LEAN = 0.5  # degrees from the plane of a joint, mean over its area
LEAST_LEAN = 0.05  # degrees, below which the worst facet gets no note


def make_surface(config, folder, log=None) -> np.ndarray | None:
    """Return the ground surface of a `MeshConfig`: places, triangles of benches, None if flat."""
    if config.benches:
        with named_error("mesh"):
            return bench_triangles(benches_of(config, folder, log), box_of(config))
    if config.surface_file is None:
        return None
    return survey_of(config, folder, log).values


def box_of(config) -> np.ndarray:
    """Return the box (3, 2) in m of a `MeshConfig`, without padding."""
    low = np.array(config.origin_m)
    return np.column_stack([low, low + config.size_m])


def survey_of(config, folder, log=None) -> SurveyedSurface:
    """Read the surveyed surface of a `MeshConfig`, a table or any format of `read_surface`.

    Raises
    ------
    ReadError
        If the file can't be read or holds no surface.
    InputError
        If its unit can't be decided, or it does not fit the box.
    """
    path = folder / config.surface_file
    with named_error("mesh.surface_file"):
        if surface_format(path, read_content(path)) is None:
            values = read_columns(path, ("x_m,y_m,z_m",))
            return SurveyedSurface(values, np.empty((0, 2)))
        return read_surface(
            path, box=box_of(config), unit=config.surface_unit, layers=config.surface_layers,
            log=log,
        )  # fmt: skip


def benches_of(config, folder, log=None) -> list[Bench]:
    """Return the benches of a `MeshConfig`, from the highest down."""
    benches = []
    for number, part in enumerate(config.benches, start=1):
        with named_error(f"benches[{number}]"):
            crests = _lines(part, "crest", config, folder, log)
            if part.height_m is not None:
                dip = np.radians(part.face_dip_deg)
                toes = [toe_of(crest, part.height_m, dip) for crest in crests]
            else:
                toes = _lines(part, "toe", config, folder, log)
            if len(crests) != len(toes):
                raise InputError(
                    f"the drawing holds {len(crests)} crests and {len(toes)} toes; join the pieces "
                    "of each line, or put the lines of other benches on layers of their own"
                )
            pairs = zip(crests, toes, strict=True)
            if _is_drawing(part.crest_file) or _is_drawing(part.toe_file):
                pairs = (walked(crest, toe) for crest, toe in pairs)
            benches += [Bench(crest, toe) for crest, toe in pairs]
    return benches


def make_fractures(config, folder) -> list[Fault]:
    """Return the fractures of a `MeshConfig`, read or drawn."""
    faults = {part.name: part for part in config.faults}
    fractures = []
    for part in config.fractures:
        with named_error(f"mesh.fractures.{part.name}"):
            ends = []
            for name in part.ends_at:
                fault = faults.get(name)
                if fault is None or fault.radius_m is not None or fault.extent_m is not None:
                    raise InputError(
                        f"ends_at: {name!r} must be a fault of [[mesh.faults]] without radius_m "
                        "and extent_m"
                    )
                dip, azimuth = np.radians([fault.dip_deg, fault.dip_direction_deg])
                ends.append(Fault(name, dip, azimuth, tuple(fault.through_m)))
            fractures += terminated(_fractures(part, config, folder), ends)
    return fractures


def _fractures(part, config, folder):
    """Return the fractures of one table as far as they reach into the box."""
    box = np.column_stack([config.origin_m, np.add(config.origin_m, config.size_m)])
    if part.file is None:
        low, high = part.radius_range_m or (0.0, np.inf)
        sizes = SizeLaw(
            part.radius_law, part.radius_m or 1.0, part.radius_deviation_m or 0.0,
            part.radius_exponent or 0.0, (low, high),
        )  # fmt: skip
        dip, azimuth = np.radians([part.dip_deg, part.dip_direction_deg])
        kappa, density = part.fisher_kappa, part.p32
        return FractureSet(part.name, dip, azimuth, kappa, density, sizes, part.seed).draw(box)
    read = read_fractures(folder / part.file, part.name, box=box, unit=part.file_unit)
    mapped = [replace(f, name=part.name) for f in read]
    return refuse_many(part.name, [each for each in mapped if area_within(each, box) > 0.0])


def _is_drawing(file):
    """Tell whether lines come from a drawing, in which they run in any sense."""
    return file is not None and file.lower().endswith(".dxf")


def _lines(part, name, config, folder, log):
    """Return the crests or toes (n, 3) in m of a bench, given or read, from the highest down."""
    file = getattr(part, f"{name}_file")
    if file is None:
        return [np.array(getattr(part, f"{name}_m"))]
    if not _is_drawing(file):
        return [read_columns(folder / file, ("x_m,y_m,z_m",))]
    layer = getattr(part, f"{name}_layer")
    return read_lines(
        folder / file, layer, box=box_of(config), unit=part.file_unit, log=log
    )  # fmt: skip


def welded_surfaces(config, mesh) -> list[str]:
    """Return the tagged surfaces inside a mesh file that are no joints: welded, and no sides.

    Raises
    ------
    InputError
        If one lies within a single material and is listed neither as a joint nor as welded.
    """
    welded = []
    for name in mesh.surfaces if config.file is not None else ():
        inner, zones = inner_facets(mesh, name)
        if name in config.file_joints or not inner.any():
            continue
        alike = mesh.zone_group[zones[:, 0]] == mesh.zone_group[zones[:, 1]]
        if alike.any() and name not in config.file_welded:
            group = mesh.groups[mesh.zone_group[zones[np.argmax(alike), 0]]]
            raise InputError(
                f"mesh.file: the surface {name!r} lies inside {group!r}; say what it is: a joint "
                f"by file_joints = {{ {name} = ... }}, or no joint by file_welded = [{name!r}]"
            )
        welded.append(name)
    return welded


def joint_planes(project):
    """Return by how much the facets of each joint lean from its plane: mean and worst, rad."""
    config, mesh = project.config.mesh, project.mesh
    if config.file is not None:
        return {}
    return {
        part.name: bending(
            mesh, part.name, upward_normal(*np.radians([part.dip_deg, part.dip_direction_deg]))
        )
        for part in (*config.joint_sets, *config.faults)
        if part.name in mesh.surfaces and len(mesh.surfaces[part.name])
    }


def ground_notes(project, leaning):
    """Say how plane the joints are, and how far the holes stand behind the faces of benches."""
    notes, blast = [], project.blast
    for name, angles in leaning.items():
        mean, worst = np.degrees(angles)
        if worst > LEAST_LEAN:
            notes.append(
                f"Joint {name}: facets lean by {mean:.2g}° on average over their area, by "
                f"{worst:.2g}° at most."
            )
    for part in project.config.mesh.fractures:
        faces = project.mesh.surfaces.get(part.name, np.empty((0, 3), dtype=int))
        area = np.linalg.norm(face_vectors(project.mesh.points, faces), axis=1).sum()
        volume = np.prod(project.config.mesh.size_m)
        drawn = "" if part.file else f", drawn with seed {part.seed}"
        notes.append(
            f"Fractures {part.name}: {area:.4g} m2, P32 {area / volume:.3g} 1/m of the box{drawn}."
        )
    for name in welded_surfaces(project.config.mesh, project.mesh):
        notes.append(f"Surface {name} of the mesh file lies inside: welded, no joint and no side.")
    if project.config.mesh.benches and blast is not None:
        burden = burdens(benches_of(project.config.mesh, project.folder), blast.centres)
        burden = burden[np.isfinite(burden)]
        if len(burden):
            notes.append(
                f"Burden of {len(burden)} of {len(blast.centres)} holes, from the middle of the "
                f"charge to the nearest bench face at its height: {burden.min():.3g} to "
                f"{burden.max():.3g} m."
            )
    return tuple(notes)


def bent_joint(name, mean, worst):
    """D37: a joint whose facets lean from its plane by more than half a degree over its area."""
    mean, worst = float(np.degrees(mean)), float(np.degrees(worst))
    if mean <= LARGEST_LEAN:
        return None
    return Finding(
        "D37",
        "A joint is bent by the mesh",
        f"The facets of {name} lean from its plane by {mean:.2g}° on average over their area and "
        f"by {worst:.2g}° at most, because the mesh is stretched to the surface or bends joints to "
        "corners: cut the surface into tetrahedra (mesh.kind), or take a smaller mesh.tolerance_m.",
        numbers={"mean_deg": mean, "worst_deg": worst},
    )
