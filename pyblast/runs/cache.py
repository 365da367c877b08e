"""Cache of runs: results in a folder, addressed by the content hash of their input."""

import hashlib
import json
import logging
import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ..errors import ReadError
from ..mesh.nodes import feed
from ..model.model import Model
from ..signals.seismogram import Seismogram
from ..solver.model_file import read_arrays, write_arrays
from ..solver.preparation import fingerprint
from ..solver.run import Run, simulate

PACKAGE = Path(__file__).parents[1]
# Code that a run depends on, and all code: paths within the package.
RUN_CODE = ("core.py", "signals", "mesh", "model", "solver", "runs")
WHOLE = ("",)


def input_hash(*inputs: Any) -> str:
    """Return the SHA-256 of inputs and of the code of a run.

    Parameters
    ----------
    inputs : Model, numbers, texts, arrays, None; sequences, dicts and dataclasses of them

    Raises
    ------
    InputError
        If an input has no content hash, such as a function.
    """
    digest = hashlib.sha256(code_hash().encode())
    feed(digest, inputs, "input")
    return digest.hexdigest()


@lru_cache
def code_hash(paths: tuple[str, ...] = RUN_CODE) -> str:
    """Return the SHA-256 of modules, of the compiled core, and of numpy's and scipy's version.

    Parameters
    ----------
    paths : tuple of str
        Modules and packages within pyblast.
    """
    digest = hashlib.sha256(f"numpy {np.__version__} scipy {scipy.__version__}".encode())
    files = [file for name in paths for file in _modules(PACKAGE / name)]
    cores = [name for name in sorted(sys.modules) if name.startswith("pyblast._core")]
    for file in [*files, *(Path(sys.modules[name].__file__ or "") for name in cores)]:
        if file.is_file():
            digest.update(file.name.encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _modules(path):
    """Return the modules at a path, sorted: one file, or all of a folder."""
    return sorted(path.rglob("*.py")) if path.is_dir() else [path]


log = logging.getLogger(__name__)


class Cache:
    """Cache folder of named arrays, one file for each key.

    Files are written atomically and contain the hash of their content. Unreadable files and files
    of another key are ignored, with a warning in the log.

    Parameters
    ----------
    folder : path
        Created if absent.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ReadError(f"{self.folder}: can't be made ({error.strerror})") from None

    def get(self, key: str) -> dict[str, np.ndarray] | None:
        """Return the arrays of a key, or None."""
        path = self._path(key)
        if not path.exists():
            return None
        try:
            groups, attributes = read_arrays(path)
        except ReadError as error:
            log.warning("cache: left aside, and made anew: %s", error)
            return None
        arrays = groups.get("kept", {})
        if attributes.get("key") != key or attributes.get("content") != fingerprint(arrays):
            log.warning("cache: %s is not what its name says; left aside, and made anew", path)
            return None
        return arrays

    def put(self, key: str, arrays: dict[str, np.ndarray]) -> None:
        """Store arrays under a key."""
        attributes = {"kind": "kept", "key": key, "content": fingerprint(arrays)}
        write_arrays(self._path(key), {"kept": arrays}, attributes)

    def __len__(self) -> int:
        return sum(1 for _ in self.folder.glob("*.h5"))

    @property
    def size(self) -> int:
        """Size of the folder in bytes; files may be deleted at any time."""
        return sum(path.stat().st_size for path in self.folder.glob("*.h5"))

    def _path(self, key):
        return self.folder / f"{key[:40]}.h5"


@dataclass(frozen=True, eq=False)
class KeptRun:
    """Cached run.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By receiver.
    energy : dict of str to (n_lines,) float64, J
        Terms of the energy balance, with ``time`` in s.
    balance_error, dt, wall_seconds : float
        As in `Run`; the wall time of the run, not of reading.
    provenance : dict of str to str
    found : bool
        Whether it was read from the cache.
    """

    seismograms: dict[str, Seismogram]
    energy: dict[str, np.ndarray]
    balance_error: float
    dt: float
    wall_seconds: float
    provenance: dict[str, str]
    found: bool


def cached_run(model: Model, duration: float, folder: str | Path | None = None) -> KeptRun:
    """Run a model, or read the bit-identical run from the cache.

    Parameters
    ----------
    model : Model
    duration : float, s
    folder : path, optional
        Cache folder; None: no cache.

    Returns
    -------
    KeptRun

    Raises
    ------
    InputError
        If a part of the model has no content hash, such as a function.
    ReadError
        If the folder can't be written.
    """
    return find_run(model, duration, folder) or _run(model, duration, folder)


def find_run(model: Model, duration: float, folder: str | Path | None) -> KeptRun | None:
    """Return the cached run of a model, or None."""
    arrays = Cache(folder).get(input_hash(model, duration)) if folder is not None else None
    return _from_arrays(arrays) if arrays else None


def _run(model, duration, folder):
    """Run a model and store it in the cache."""
    run = simulate(model, duration)
    if folder is not None:
        Cache(folder).put(input_hash(model, duration), _as_arrays(run))
    return KeptRun(
        run.seismograms, run.energy, run.balance_error, run.dt, run.wall_seconds,
        run.provenance, False,
    )  # fmt: skip


def _as_arrays(run: Run):
    """Return a run as named arrays; text and scalars as one JSON array."""
    heads = [
        {"name": name, "dt": s.dt, "start": s.start, "label": s.label, "components": s.components}
        for name, s in run.seismograms.items()
    ]
    plain = {
        "seismograms": heads,
        "provenance": run.provenance,
        **{name: getattr(run, name) for name in ("balance_error", "dt", "wall_seconds")},
    }
    return {
        "plain": np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8),
        **{f"energy_{name}": line for name, line in run.energy.items()},
        **{f"motion_{n}": s.velocity for n, s in enumerate(run.seismograms.values())},
    }


def _from_arrays(arrays):
    """Return the run of `_as_arrays`."""
    plain = json.loads(arrays["plain"].tobytes().decode())
    seismograms = {
        head["name"]: Seismogram(
            arrays[f"motion_{n}"], head["dt"], head["start"], head["label"],
            tuple(head["components"]),
        )
        for n, head in enumerate(plain["seismograms"])
    }  # fmt: skip
    energy = {
        name.removeprefix("energy_"): line
        for name, line in arrays.items()
        if name.startswith("energy_")
    }
    numbers = {name: plain[name] for name in ("balance_error", "dt", "wall_seconds")}
    return KeptRun(seismograms, energy, **numbers, provenance=plain["provenance"], found=True)
