"""Small Fortran sources, compiled for the machine at hand when they are first wanted."""

import ctypes
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
FLAGS = ("-O3", "-march=native", "-mprefer-vector-width=512", "-fopenmp")
FILLED = {"one": "1.0d0", "hex_width": "4", "kernel_width": "4", "isa": "", "wide": ""}


@cache
def compiled(*names):
    """Return the library of sources, paths from the root of the repository, in their order."""
    with TemporaryDirectory() as folder:
        made = Path(folder) / "made.so"
        sources = [str(_filled(folder, ROOT / name)) for name in names]
        command = ["gfortran", *FLAGS, "-shared", "-fPIC", *sources, "-o", str(made)]
        subprocess.run(command, check=True, cwd=folder)
        return ctypes.CDLL(str(made))


def _filled(folder, path):
    """Return a source, or what a template becomes in numbers of eight bytes."""
    if path.suffix != ".in":
        return path
    made = Path(folder) / path.stem
    text = path.read_text()
    for name, value in FILLED.items():
        text = text.replace(f"@{name}@", value)
    made.write_text(text)
    return made


def plain(table):
    """Return an array as the sources take it; what they write to is that already."""
    kind = np.int32 if np.issubdtype(table.dtype, np.integer) else np.float64
    return np.ascontiguousarray(table, dtype=kind)


def called(routine, counts, numbers, tables):
    """Call a routine of a library with integers, doubles and arrays that are `plain`."""
    routine(
        *map(ctypes.c_int, counts),
        *map(ctypes.c_double, numbers),
        *(ctypes.c_void_p(table.ctypes.data) for table in tables),
    )
