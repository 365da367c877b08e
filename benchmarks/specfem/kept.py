"""Runs of a case kept on disk, so that a case that was stopped goes on with its next run."""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .solver import simulated


def kept(folder: Path, run: Callable = simulated) -> Callable:
    """Return ``run`` that takes from a folder what it has, and runs one blast at a time.

    Parameters
    ----------
    folder : path
        Of runs under the SHA-256 of all that they depend on.
    run : callable
        As `benchmarks.specfem.solver.simulated`.
    """

    def again(ground, mesh, blasts, pulse, exponent, places, until):
        found = {}
        for name, holes in blasts.items():
            lists = {key: np.asarray(value).tolist() for key, value in holes.items()}
            lines = [line.tolist() for line in mesh.lines]
            asked = ground, lines, lists, pulse, exponent, np.asarray(places).tolist(), until
            file = folder / f"{hashlib.sha256(repr(asked).encode()).hexdigest()}.npz"
            if not file.is_file():
                done = run(ground, mesh, {name: holes}, pulse, exponent, places, until)[name]
                folder.mkdir(parents=True, exist_ok=True)
                beside = file.with_suffix(f".{os.getpid()}.npz")
                np.savez(beside, times=done[0], motion=done[1])
                beside.rename(file)
            with np.load(file) as stored:
                found[name] = stored["times"], stored["motion"]
        return found

    return again
