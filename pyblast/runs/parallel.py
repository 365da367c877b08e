"""Parallel runs on the cores of a machine or on several machines, resumable by the cache."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from ..core import LEAST_SHARED
from ..errors import InputError, SolverError
from ..model.model import Model
from .cache import KeptRun, cached_run, find_run

THREADS = "OMP_NUM_THREADS"
DASK_SECONDS = 10.0


def run_all(
    models: Sequence[Model],
    duration: float,
    *,
    folder: str | Path | None = None,
    executor: Executor | None = None,
) -> list[KeptRun]:
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
    list of KeptRun
        In the order of the models.

    Raises
    ------
    InputError, SolverError
        Of the first model that fails.
    """
    if executor is None:
        return [cached_run(model, duration, folder) for model in models]
    cached = [find_run(model, duration, folder) for model in models]
    missing = [n for n, run in enumerate(cached) if run is None]
    here = _remainder(missing, models, executor)
    waiting = {
        n: executor.submit(cached_run, models[n], duration, folder)
        for n in missing if n not in here
    }  # fmt: skip
    try:
        done = {n: future.result() for n, future in waiting.items()}
        done |= {n: cached_run(models[n], duration, folder) for n in here}
    except BrokenProcessPool:
        raise SolverError(
            "runs: a process was lost, perhaps for want of memory; the same command goes on "
            "with what is missing"
        ) from None
    finally:  # cancel pending runs after a failure or Ctrl-C
        for future in waiting.values():
            future.cancel()
    return [done[n] if run is None else run for n, run in enumerate(cached)]


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
def executor_of(count: int = 1, dask: str = "") -> Iterator[Executor | None]:
    """Provide an executor: None for one worker, processes, or the workers of a dask scheduler.

    Parameters
    ----------
    count : int
        Number of processes; not used with dask.
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
    elif count > 1:
        with workers(count) as pool:
            yield pool
    else:
        yield None


def _dask_client(address):
    """Return a client of a dask scheduler."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--dask: dask is not installed; pip install 'pyblast[dask]'") from None
    try:
        return Client(address, timeout=DASK_SECONDS)
    except (OSError, ValueError) as error:
        raise InputError(f"--dask: no scheduler answers at {address} ({error})") from None


class Processes(ProcessPoolExecutor):
    """Process pool with its number of processes, ``count``."""

    def __init__(self, count: int) -> None:
        super().__init__(count, mp_context=get_context("spawn"))
        self.count = count


@contextmanager
def workers(count: int | None = None) -> Iterator[Processes]:
    """Provide a pool of processes that share the cores of this machine.

    Parameters
    ----------
    count : int, optional
        None: one per core, with one thread each, which is faster than few processes with many
        threads.

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
            yield pool
    finally:
        if before is None:
            del os.environ[THREADS]
        else:
            os.environ[THREADS] = before
