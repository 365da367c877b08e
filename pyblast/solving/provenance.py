"""Where a number comes from: hash of the input, versions of everything that took part."""

import hashlib
import os
import platform
from importlib import metadata

import numpy as np


def fingerprint(*tables):
    """Return the SHA-256 of named arrays and numbers, in the order of their names."""
    digest = hashlib.sha256()
    for table in tables:
        for name in sorted(table):
            value = np.ascontiguousarray(table[name])
            digest.update(f"{name} {value.dtype.str} {value.shape}".encode())
            digest.update(value.tobytes())
    return digest.hexdigest()


def versions(input_hash):
    """Return the provenance of a result, all text."""
    libraries = ("numpy", "scipy", "obspy", "h5py", "meshio", "gmsh")
    return {
        "pyblast": metadata.version("pyblast"),
        "input_sha256": input_hash,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "threads": os.environ.get("OMP_NUM_THREADS", str(os.cpu_count())),
        **{name: metadata.version(name) for name in libraries},
    }
