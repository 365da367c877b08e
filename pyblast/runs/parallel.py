"""Many runs: cached by the hash of their input, in parallel processes, or in one batch."""

import hashlib
import json
import logging
import os
import signal
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.synchronize import Event
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np

from .. import core
from ..core import JOINT_LAWS, LEAST_SHARED
from ..errors import InputError, LostProcessError, ReadError, SolverError
from ..files import code_hash
from ..laws import of_laws
from ..mesh.nodes import feed
from ..model.model import Model
from ..signals.seismogram import Seismogram
from ..solver.assembly import initial_state
from ..solver.model_file import read_arrays, write_arrays
from ..solver.preparation import LEDGER_EVERY, Prepared
from ..solver.run import Run, simulate


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


log = logging.getLogger(__name__)


class Cache:
    """Cache folder of named arrays, one file for each key.

    Files are written atomically, with checksums. Unreadable files and files of another key are
    ignored, with a warning in the log.

    Parameters
    ----------
    folder : path
        Created if absent.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def get(self, key: str) -> dict[str, np.ndarray] | None:
        """Return the arrays of a key, or None."""
        path = self._path(key)
        if not path.exists():
            return None
        try:
            groups, attributes = read_arrays(path)
        except ReadError as error:
            log.warning("cache: ignored, and computed again: %s", error)
            return None
        if attributes.get("key") != key:
            log.warning("cache: %s does not match its name; ignored, and computed again", path)
            return None
        return groups.get("cached", {})

    def put(self, key: str, arrays: dict[str, np.ndarray]) -> None:
        """Store arrays under a key."""
        attributes = {"kind": "cached", "key": key}
        write_arrays(self._path(key), {"cached": arrays}, attributes)

    def __len__(self) -> int:
        return sum(1 for _ in self.folder.glob("*.h5"))

    @property
    def size(self) -> int:
        """Size of the folder in bytes; files may be deleted at any time."""
        return sum(path.stat().st_size for path in self.folder.glob("*.h5"))

    def _path(self, key):
        return self.folder / f"{key[:40]}.h5"


@dataclass(frozen=True, eq=False)
class CachedRun:
    """Cached run: seismograms and energy, without the state.

    Parameters
    ----------
    seismograms : dict of str to Seismogram
        By receiver.
    energy : dict of str to (n_lines,) float64, J
        Terms of the energy balance, with ``time`` in s.
    balance_error, dt, wall_seconds : float
        As in `Run`; the wall time of the run, not of reading.
    provenance : dict of str to str
    from_cache : bool
        Whether it was read from the cache.
    """

    seismograms: dict[str, Seismogram]
    energy: dict[str, np.ndarray]
    balance_error: float
    dt: float
    wall_seconds: float
    provenance: dict[str, str]
    from_cache: bool


def is_single(model: Model) -> bool:
    """Tell whether a fit runs a model in single precision: one without a static stage.

    Not on tetrahedra of constant strain, which may yield.
    """
    return (model.quadratic or model.mesh.hexahedral) and model.insitu is None


def cached_run(model: Model, duration: float, folder: str | Path | None = None) -> CachedRun:
    """Run a model, or read the bit-identical run from the cache.

    Parameters
    ----------
    model : Model
    duration : float, s
    folder : path, optional
        Cache folder; None: no cache.

    Returns
    -------
    CachedRun

    Raises
    ------
    InputError
        If a part of the model has no content hash, such as a function.
    ReadError
        If the folder can't be written.
    """
    return find_run(model, duration, folder) or _run(model, duration, folder)


def find_run(model: Model, duration: float, folder: str | Path | None) -> CachedRun | None:
    """Return the cached run of a model, or None."""
    arrays = Cache(folder).get(input_hash(model, duration)) if folder is not None else None
    return _from_arrays(arrays) if arrays else None


def _run(model, duration, folder):
    """Run a model and store it in the cache."""
    run = simulate(model, duration)
    if folder is not None:
        Cache(folder).put(input_hash(model, duration), _as_arrays(run))
    return CachedRun(
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
    return CachedRun(
        seismograms, energy, **numbers, provenance=plain["provenance"], from_cache=True
    )


THREADS = "OMP_NUM_THREADS"
DASK_SECONDS = 10.0


def run_all(
    models: Sequence[Model],
    duration: float,
    *,
    folder: str | Path | None = None,
    executor: Executor | None = None,
) -> list[CachedRun]:
    """Run many models in parallel, each at most once.

    Parameters
    ----------
    models : sequence of Model
    duration : float, s
    folder : path, optional
        Cache folder, shared with workers on other machines. After an interruption the same call
        computes the missing runs.
    executor : concurrent.futures.Executor, optional
        `workers` for this machine; for several machines e.g. the result of
        ``dask.distributed.Client.get_executor``. None: sequentially.

    Returns
    -------
    list of CachedRun
        In the order of the models.

    Raises
    ------
    InputError, SolverError
        Of the first model that fails.
    LostProcessError
        If a process of the executor has ended.
    """
    if executor is None:
        return [cached_run(model, duration, folder) for model in models]
    folder = shared_folder(folder)
    cached = [find_run(model, duration, folder) for model in models]
    missing = [n for n, run in enumerate(cached) if run is None]
    here = _remainder(missing, models, executor)
    waiting = {}
    try:
        for n in missing:
            if n not in here:
                waiting[n] = executor.submit(cached_run, models[n], duration, folder)
        done = {n: future.result() for n, future in waiting.items()}
        done |= {n: cached_run(models[n], duration, folder) for n in here}
    except BrokenProcessPool:
        raise lost_process(executor) from None
    finally:  # cancel pending runs after a failure or Ctrl-C
        for future in waiting.values():
            future.cancel()
    return [done[n] if run is None else run for n, run in enumerate(cached)]


def shared_folder(folder: str | Path | None) -> Path | None:
    """Return a folder by its whole path, which workers that began elsewhere find, too."""
    return None if folder is None else Path(folder).resolve()


def lost_process(executor: Executor) -> LostProcessError:
    """Return the error of an executor that lost a process, or whose processes never began."""
    if isinstance(executor, Processes) and not executor.begun.is_set():
        return LostProcessError(
            "workers: no process began; each reads the script that starts it, so put its work "
            'under if __name__ == "__main__":'
        )
    return LostProcessError(
        "runs: a process was lost, perhaps for lack of memory; the same command computes the "
        "missing runs"
    )


def _remainder(missing, models, executor):
    """Return the last missing runs, which this process computes on all threads, one by one.

    The remainder after equal shares of the pool, if it fills at most half of the pool and the
    models are large enough for several threads.
    """
    count = getattr(executor, "count", 0)
    rest = missing[len(missing) - len(missing) % count :] if count else []
    large = all(len(models[n].nodes.points) >= LEAST_SHARED for n in rest)
    return rest if large and 2 * len(rest) <= count else []


@contextmanager
def executor_of(count: int | None = 1, dask: str = "") -> Iterator[Executor | None]:
    """Provide an executor: None for one worker, processes, or the workers of a dask scheduler.

    Parameters
    ----------
    count : int, optional
        Number of processes, None for one per core; not used with dask.
    dask : str
        Address of a scheduler, such as ``tcp://host:8786``.

    Raises
    ------
    InputError
        If dask is not installed or nothing answers there.
    """
    if dask:
        with _dask_client(dask) as client:
            yield client.get_executor()
    elif count != 1:
        with workers(count) as pool:
            yield pool
    else:
        yield None


def _dask_client(address):
    """Return a client of a dask scheduler."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask: dask is not installed; pip install 'dask[distributed]'") from None
    try:
        return Client(address, timeout=DASK_SECONDS)
    except (OSError, ValueError) as error:
        raise InputError(f"--dask: no scheduler answers at {address} ({error})") from None


class Processes(ProcessPoolExecutor):
    """Process pool with its number of processes, ``count``, that end with the process of the pool.

    Each process waits in a thread for the end of a pipe that only the process of the pool holds
    open: at its end, by any signal, or at `stop`, it ends in the middle of its run.
    """

    def __init__(self, count: int) -> None:
        context = get_context("spawn")
        ends_with, self._held = context.Pipe(duplex=False)
        self.begun = context.Event()  # set by the first process that has read its script
        super().__init__(count, context, _ends_with, (ends_with, self.begun))
        self.count = count

    def stop(self) -> None:
        """End all processes at once, whatever they run."""
        self._held.close()


def _ends_with(pipe: Connection, begun: Event) -> None:
    """Let a process end with a pipe, and leave Ctrl-C to the process that holds its other side."""
    begun.set()
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait():
        pipe.poll(None)
        os._exit(1)

    Thread(target=wait, daemon=True).start()


@contextmanager
def workers(count: int | None = None) -> Iterator[Processes]:
    """Provide a pool of processes that share the cores of this machine; Ctrl-C ends them at once.

    Parameters
    ----------
    count : int, optional
        None: one per core, with one thread each, which is faster than few processes with many
        threads.

    Raises
    ------
    LostProcessError
        If a process is lost, or the script lacks its guard, whatever is asked of the pool.

    Notes
    -----
    Processes are spawned, since forking does not work with OpenMP threads. A script therefore needs
    ``if __name__ == "__main__":`` around its work.
    """
    cores = os.cpu_count() or 1
    count = count or cores
    before = os.environ.get(THREADS)
    os.environ[THREADS] = str(max(1, cores // count))  # read by each process when it starts
    try:
        with Processes(count) as pool:
            try:
                yield pool
            except (KeyboardInterrupt, SystemExit):
                pool.stop()
                raise
            except BrokenProcessPool:
                raise lost_process(pool) from None
    finally:
        if before is None:
            del os.environ[THREADS]
        else:
            os.environ[THREADS] = before


STRETCH_VALUES = 2**23  # numbers in one stretch: 64 MB


def at_rest(constants: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return constants and state of a linear model at rest, without loads and initial stress."""
    law = constants["joint_law"]
    sticks = of_laws(JOINT_LAWS, law, "sticks")
    unloaded = {
        **constants,
        "joint_law": np.where(sticks, JOINT_LAWS["elastic"].number, law).astype("i4"),
        **{n: np.zeros_like(constants[n]) for n in ("contact_initial", "node_load", "row_initial")},
        "fixed_history": np.full_like(constants["fixed_history"], -1),
    }
    return unloaded, initial_state(unloaded)


def node_receivers(constants: dict[str, Any], nodes: np.ndarray) -> dict[str, np.ndarray]:
    """Return the receivers of a model, followed by one at every chosen node."""
    corners = constants["receiver_node"].shape[1]  # or all nodes of a quadratic zone
    node, weight = np.repeat(nodes[:, None], corners, axis=1), np.eye(corners)[:1]
    weight = weight.repeat(len(node), axis=0)
    return {
        "receiver_node": np.concatenate([constants["receiver_node"], node]).astype(np.int32),
        "receiver_weight": np.concatenate([constants["receiver_weight"], weight]),
    }


def stretches(n_steps: int, values: int) -> list[tuple[int, int]]:
    """Return (first, count) of stretches of bounded memory, for a number of values per step."""
    count = int(min(n_steps, max(1, STRETCH_VALUES // max(1, values))))
    return [(first, min(count, n_steps - first)) for first in range(0, n_steps, count)]


def run_loads(
    prepared: Prepared, loads: Sequence[dict[str, np.ndarray]], n_steps: int, nodes: np.ndarray
) -> Iterator[np.ndarray]:
    """Run a linear model from rest under each of several loads, in one batch.

    The sources of the model are left out; a single load is not run as a batch.

    Parameters
    ----------
    prepared : Prepared
    loads : sequence of dict
        Load arrays of up to `core.BATCH_SIZE` runs, each with one history.
    n_steps : int
    nodes : (n_nodes,) int
        Recorded in addition to the receivers of the model.

    Yields
    ------
    (n, n_receivers + n_nodes, 3, n_loads) float64, m/s
        Motion at mid-steps, stretch by stretch.

    Raises
    ------
    SolverError
        If a run is unstable.
    """
    constants, state = at_rest(prepared.constants)
    constants = {**constants, **node_receivers(constants, nodes), **_merged_loads(loads)}
    if len(loads) == 1:
        views, advance = core.to_fortran(prepared.in_run_precision(constants)), core.advance
        state = prepared.in_run_precision(state)
    else:
        views, state = core.to_fortran_batch(_repeated(constants)), _repeated(state)
        advance = core.advance_batch
    for first, count in stretches(n_steps, 3 * core.BATCH_SIZE * len(constants["receiver_node"])):
        motion, _, failed = advance(views, state, first, count, LEDGER_EVERY)
        if failed is not None:
            raise SolverError(f"run: unstable at step {first + len(motion)}")
        yield motion.reshape(*motion.shape[:3], -1)[..., : len(loads)]


def _merged_loads(loads):
    """Return the loads of all members of a batch as one table."""
    merged = {
        name: np.concatenate([load[name] for load in loads])
        for name in ("load_node", "load_vector", "load_delay")
    }
    member = np.repeat(
        np.arange(len(loads), dtype=np.int32), [len(load["load_node"]) for load in loads]
    )
    history = np.hstack([load["history"] for load in loads])
    return {**merged, "load_history": member, "load_member": member, "history": history}


def _repeated(arrays):
    """Return arrays repeated for each member of a batch, where members differ."""
    return {
        name: np.stack([value] * core.BATCH_SIZE, axis=core.BATCH_AXIS[name])
        if name in core.BATCH_AXIS
        else value
        for name, value in arrays.items()
    }
