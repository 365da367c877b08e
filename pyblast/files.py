"""Files of results: written whole or not at all, plain values, hash and versions of the code."""

import hashlib
import json
import math
import os
import platform
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from . import core
from .errors import ReadError

LIBRARIES = ("numpy", "scipy", "obspy", "h5py", "meshio", "gmsh")
installed = cache(metadata.version)  # reads files of the library, at every run otherwise
PACKAGE = Path(__file__).parent
# Code that a run depends on, and all code: paths within the package.
RUN_CODE = ("core.py", "signals", "mesh", "model", "solver", "runs")
WHOLE = ("",)


def write_text(path, text):
    """Write a text file atomically."""
    write_bytes(path, text.encode("utf-8", "replace"))  # a name may hold half a letter


def write_bytes(path, content):
    """Write a file atomically: to a temporary file, flushed and renamed.

    A folder that is gone is made again; letters that the file system lacks become underscores.
    """
    path = Path(path)
    try:
        os.fsencode(path)
    except UnicodeEncodeError:
        path = path.with_name(path.name.encode("ascii", "replace").decode().replace("?", "_"))
    with replacing(path) as beside, beside.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside a file, which replaces it at the end, whole or not at all.

    A folder that is gone is made again.

    Raises
    ------
    ReadError
        If the file can't be written.
    """
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield beside
        beside.replace(path)
    except OSError as error:
        reason = os.strerror(error.errno) if error.errno else error  # that of HDF5 is a paragraph
        raise ReadError(f"{path}: can't be written ({reason})") from None
    finally:
        with suppress(OSError):
            beside.unlink()


def write_summary(path, summary):
    """Write the summary as indented JSON."""
    write_text(path, json.dumps(plain(summary), indent=1) + "\n")


def plain(value) -> Any:
    """Convert numpy numbers and arrays for JSON; NaN and infinity become null."""
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    return value


def versions(input_hash: str) -> dict[str, str]:
    """Return the provenance of a result, all text."""
    return {
        "pyblast": installed("pyblast"),
        "input_sha256": input_hash,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "threads": str(core.n_threads()),
        **{name: installed(name) for name in LIBRARIES},
    }


@lru_cache
def code_hash(paths: tuple[str, ...] = RUN_CODE) -> str:
    """Return the SHA-256 of code and its tables, of the core, and of numpy's and scipy's version.

    Parameters
    ----------
    paths : tuple of str
        Modules and packages within pyblast.
    """
    digest = hashlib.sha256(f"numpy {np.__version__} scipy {scipy.__version__}".encode())
    files = [file for name in paths for file in _modules(PACKAGE / name)]
    core_file = sys.modules["pyblast._core"].__file__ or ""  # the others are of its source
    for file in [*files, Path(core_file)]:
        if file.is_file():
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _modules(path):
    """Return the modules and tables at a path, sorted: one file, or all of a folder."""
    if not path.is_dir():
        return [path]
    return sorted(file for file in path.rglob("*") if file.suffix in (".py", ".toml"))
