"""What cuts the ground of a project beside planes: benches, surveyed surfaces, fractures."""

from dataclasses import replace

import numpy as np
from scipy.spatial import Delaunay, KDTree

from ..config.section import read_columns
from ..errors import InputError, named_error
from ..mesh.faces import face_vectors
from ..mesh.grid import Fault
from ..model.fractures import (
    FractureSet,
    SizeLaw,
    area_within,
    read_fractures,
    refuse_many,
    terminated,
)
from ..model.terrain import Bench, bench_triangles, burdens, read_terrain, toe_of

HALF_CELL = 0.51  # of the diagonal of a cell, with which a survey reaches beyond its places


def make_surface(config, folder) -> np.ndarray | None:
    """Return the ground surface of a `MeshConfig`: places, triangles of benches, None if flat."""
    if config.benches:
        low = np.array(config.origin_m)
        with named_error("mesh"):
            benches = benches_of(config, folder)
            return bench_triangles(benches, np.column_stack([low, low + config.size_m]))
    if config.surface_file is None:
        return None
    surface = read_surface(folder / config.surface_file)
    if surface.ndim == 2:
        low = np.array(config.origin_m)
        with named_error(config.surface_file):
            refuse_uncovered(surface, np.column_stack([low, low + config.size_m]))
    return surface


def benches_of(config, folder) -> list[Bench]:
    """Return the benches of a `MeshConfig`, from the highest down."""
    benches = []
    for number, part in enumerate(config.benches, start=1):
        with named_error(f"benches[{number}]"):
            crest = _line(part.crest_m, part.crest_file, folder)
            if part.height_m is not None:
                toe = toe_of(crest, part.height_m, np.radians(part.face_dip_deg))
            else:
                toe = _line(part.toe_m, part.toe_file, folder)
            benches.append(Bench(crest, toe))
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
    mapped = [replace(f, name=part.name) for f in read_fractures(folder / part.file, part.name)]
    return refuse_many(part.name, [each for each in mapped if area_within(each, box) > 0.0])


def _line(places, file, folder):
    """Return a line (n, 3) in m, given or read."""
    return np.array(places) if file is None else read_columns(folder / file, ("x_m,y_m,z_m",))


def read_surface(path):
    """Read a surveyed surface; return its places (n, 3) or triangles (n, 3, 3) in m.

    A table has lines ``x_m,y_m,z_m``; for other suffixes see `pyblast.model.terrain.read_terrain`.

    Raises
    ------
    ReadError
        If the file can't be read or a line holds something else than three numbers.
    """
    if path.suffix.lower() in (".asc", ".dxf", ".stl"):
        return read_terrain(path)
    return read_columns(path, ("x_m,y_m,z_m",))


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
    hull, gridded = Delaunay(plan), len(plan) > 0.5 * len(lines[0]) * len(lines[1])
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
    away = KDTree(plan).query(wanted)[0]
    bare = away > reach
    if not gridded:
        bare &= hull.find_simplex(wanted) < 0
    if bare.any():
        x, y = wanted[np.where(bare, away, -1.0).argmax()]
        covered = 100.0 * (1.0 - bare.mean())
        raise InputError(
            f"surface: must cover the box of the mesh in plan, covers {covered:.3g} % of it; the "
            f"nearest height to ({x:g}, {y:g}) m is {away[bare].max():.4g} m away; extend the "
            "survey, fill its holes, or move the box"
        )


def ground_notes(project):
    """Say what the fractures add up to, and how far holes stand behind the faces of benches."""
    notes, blast = [], project.blast
    for part in project.config.mesh.fractures:
        faces = project.mesh.surfaces.get(part.name, np.empty((0, 3), dtype=int))
        area = np.linalg.norm(face_vectors(project.mesh.points, faces), axis=1).sum()
        volume = np.prod(project.config.mesh.size_m)
        drawn = "" if part.file else f", drawn with seed {part.seed}"
        notes.append(
            f"Fractures {part.name}: {area:.4g} m2, P32 {area / volume:.3g} 1/m of the box{drawn}."
        )
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
