"""What cuts the ground of a project beside planes: benches, surveyed surfaces, fractures."""

from dataclasses import replace

import numpy as np
import scipy

from ..errors import InputError, named_error
from ..mesh.grid import Fault
from ..mesh.mesh import inner_facets
from ..model.fractures import (
    FractureSet,
    SizeLaw,
    area_within,
    read_fractures,
    refuse_many,
    terminated,
)
from ..model.terrain import Bench, bench_triangles, toe_of, walked
from ..readers.geometry import SurveyedSurface, read_lines, read_surface

HALF_CELL = 0.51  # of the diagonal of a cell, with which a survey reaches beyond its places


def make_surface(config, folder, log=None) -> np.ndarray | None:
    """Return the ground surface of a `MeshConfig`: places, triangles of benches, None if flat."""
    if config.benches:
        with named_error("mesh"):
            return bench_triangles(benches_of(config, folder, log), box_of(config))
    if config.surface_file is None:
        return None
    surface = survey_of(config, folder, log).values
    if surface.ndim == 2:
        with named_error(config.surface_file):
            refuse_uncovered(surface, box_of(config))
    return surface


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
    with named_error("mesh.surface_file"):
        return read_surface(
            folder / config.surface_file, box=box_of(config), unit=config.surface_unit,
            layers=config.surface_layers, log=log,
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


def make_fractures(config, folder, log=None) -> list[Fault]:
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
            fractures += terminated(_fractures(part, config, folder, log), ends)
    return fractures


def _fractures(part, config, folder, log):
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
    read = read_fractures(folder / part.file, part.name, box=box, unit=part.file_unit, log=log)
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


def refuse_uncovered(places, box):
    """Refuse a survey that leaves a part of a box without heights in plan.

    Parameters
    ----------
    places : (n, 3) float64, m
        Of a regular grid, in which places may be missing, or scattered.
    box : (3, 2) float64, m

    Raises
    ------
    InputError
        If a place of the box lies more than half a cell away from all places of a grid, or outside
        of scattered ones by more than their mean distance.
    """
    plan = np.asarray(places, dtype=float)[:, :2]
    lines = [np.unique(plan[:, axis].round(6)) for axis in (0, 1)]
    if min(map(len, lines)) < 2 or np.linalg.matrix_rank(plan - plan[0], tol=1e-6) < 2:
        raise InputError("surface: its places lie on a line; add some beside it")
    hull, gridded = scipy.spatial.Delaunay(plan), len(plan) > 0.5 * len(lines[0]) * len(lines[1])
    if gridded:
        cell = np.array([np.median(np.diff(line)) for line in lines])
        reach = HALF_CELL * np.hypot(*cell)
    else:
        corners = hull.points[hull.simplices]
        area = 0.5 * np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])).sum()
        reach = np.sqrt(area / len(plan))
        cell = np.full(2, reach)
    counts = np.clip(np.ceil(2.0 * np.ptp(box[:2], axis=1) / cell), 20, 400).astype(int) + 1
    axes = [
        np.linspace(low, high, count) for (low, high), count in zip(box[:2], counts, strict=True)
    ]
    wanted = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    away = scipy.spatial.KDTree(plan).query(wanted)[0]
    empty = away > reach
    if not gridded:
        empty &= hull.find_simplex(wanted) < 0
    if empty.any():
        x, y = wanted[np.where(empty, away, -1.0).argmax()]
        covered = 100.0 * (1.0 - empty.mean())
        raise InputError(
            f"surface: must cover the box of the mesh in plan, covers {covered:.3g} % of it; the "
            f"nearest height to ({x:g}, {y:g}) m is {away[empty].max():.4g} m away; extend the "
            "survey, fill its holes, or move the box"
        )
