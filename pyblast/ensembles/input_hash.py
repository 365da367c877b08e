"""The hash of everything that decides the bits of a run, worked out without preparing it."""

import hashlib
import sys
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import scipy

from ..errors import InputError

PACKAGE = Path(__file__).parents[1]
MARCHES = ("motion", "meshing", "solving", "ensembles")


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
    _feed(digest, inputs, "input")
    return digest.hexdigest()


def _feed(digest, value, where):
    """Add a value with its kind and its length, so that no two inputs read the same."""
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype != object:
        digest.update(f"array {value.dtype.str} {value.shape};".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif value is None or isinstance(value, (bool, int, float, str)):
        text = repr(value)
        digest.update(f"{type(value).__name__} {len(text)} {text};".encode())
    elif isinstance(value, (list, tuple)):
        digest.update(f"sequence {len(value)};".encode())
        for number, item in enumerate(value):
            _feed(digest, item, f"{where}[{number}]")
    elif isinstance(value, dict):
        digest.update(f"dict {len(value)};".encode())
        for key in sorted(value, key=repr):
            _feed(digest, key, where)
            _feed(digest, value[key], f"{where}.{key}")
    elif is_dataclass(value) and not isinstance(value, type):
        digest.update(f"{type(value).__module__}.{type(value).__qualname__};".encode())
        for field in fields(value):
            _feed(digest, getattr(value, field.name), f"{where}.{field.name}")
    else:
        raise InputError(
            f"{where}: a {type(value).__name__} has no content that could be compared with that "
            "of a kept run; give samples, or run without a cache"
        )


@lru_cache
def code_hash() -> str:
    """Return the SHA-256 of the modules that march, of the core, and of numpy's version."""
    digest = hashlib.sha256(f"numpy {np.__version__} scipy {scipy.__version__}".encode())
    files = [file for name in MARCHES for file in sorted((PACKAGE / name).glob("*.py"))]
    cores = [name for name in sorted(sys.modules) if name.startswith("pyblast._core")]
    for file in [*files, *(Path(sys.modules[name].__file__ or "") for name in cores)]:
        if file.is_file():
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
