"""The hash of everything that decides the bits of a run, worked out without preparing it."""

import hashlib
import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy

from ..meshing.contents import feed

PACKAGE = Path(__file__).parents[1]
MARCHES = ("motion", "meshing", "solving", "ensembles")
WHOLE = ("",)  # all rooms, and what stands above them


def input_hash(*inputs) -> str:
    """Return the SHA-256 of inputs and of the code that works on them.

    Parameters
    ----------
    inputs : Model, numbers, texts, arrays, None; sequences, dicts and dataclasses of them

    Raises
    ------
    InputError
        If something is none of these, such as a function: its content can't be told.
    """
    digest = hashlib.sha256(code_hash().encode())
    feed(digest, inputs, "input")
    return digest.hexdigest()


@lru_cache
def code_hash(rooms=MARCHES) -> str:
    """Return the SHA-256 of rooms of modules, of the core, and of numpy's and scipy's version."""
    digest = hashlib.sha256(f"numpy {np.__version__} scipy {scipy.__version__}".encode())
    files = [file for name in rooms for file in sorted((PACKAGE / name).rglob("*.py"))]
    cores = [name for name in sorted(sys.modules) if name.startswith("pyblast._core")]
    for file in [*files, *(Path(sys.modules[name].__file__ or "") for name in cores)]:
        if file.is_file():
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
