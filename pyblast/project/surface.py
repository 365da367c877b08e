"""The ground surface of a project: benches, or a survey of points or triangles."""

import numpy as np

from ..errors import named_error
from ..model.terrain import Bench, bench_triangles, read_terrain, toe_of
from .section import read_columns


def make_surface(config, folder) -> np.ndarray | None:
    """Return the ground surface of a `MeshConfig`: places, triangles of benches, None if flat."""
    if config.benches:
        low = np.array(config.origin_m)
        with named_error("mesh"):
            benches = benches_of(config, folder)
            return bench_triangles(benches, np.column_stack([low, low + config.size_m]))
    return None if config.surface_file is None else read_surface(folder / config.surface_file)


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
