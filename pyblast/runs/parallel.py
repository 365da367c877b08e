"""Many runs side by side, on the cores of a machine or on many machines, resumed by a cache."""

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
    """Run models, each at most once.

    Parameters
    ----------
    models : sequence of Model
    duration : float, s
    folder : path, optional
        Where runs are kept and found; workers on other machines must see it under this name.
        After an interruption the same call goes on with what is missing.
    executor : concurrent.futures.Executor, optional
        `workers` for this machine; for many machines any other, such as what
        ``dask.distributed.Client.get_executor`` returns. None runs one after the other.

    Returns
    -------
    list of KeptRun
        In the order of the models.

    Raises
    ------
    InputError, SolverError
        Those of the first model that fails.
    """
    if executor is None:
        return [cached_run(model, duration, folder) for model in models]
    kept = [find_run(model, duration, folder) for model in models]
    missing = [n for n, run in enumerate(kept) if run is None]
    here = _left_over(missing, models, executor)
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
    finally:  # after a failure or Ctrl-C what has not begun shall not begin
        for future in waiting.values():
            future.cancel()
    return [done.get(n, run) for n, run in enumerate(kept)]


def _left_over(missing, models, executor):
    """Return the last of the missing, which this process makes on all threads, one by one.

    What is left beyond equal shares of the pool, if it fills no more than half of it and steps of
    its models are worth sharing.
    """
    count = getattr(executor, "count", 0)
    rest = missing[len(missing) - len(missing) % count :] if count else []
    large = all(len(models[n].nodes.points) >= LEAST_SHARED for n in rest)
    return rest if large and 2 * len(rest) <= count else []


@contextmanager
def executor_of(count: int = 1, dask: str = "") -> Iterator[Executor | None]:
    """Open what runs models: None for one worker, processes, or the workers of a dask scheduler.

    Parameters
    ----------
    count : int
        Processes; not used with dask.
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
    """A pool that knows how many processes it has, ``count``."""

    def __init__(self, count: int) -> None:
        super().__init__(count, mp_context=get_context("spawn"))
        self.count = count


@contextmanager
def workers(count: int | None = None) -> Iterator[Processes]:
    """Open a pool of processes that share the cores of this machine.

    Parameters
    ----------
    count : int, optional
        None: one for each core, with one thread each, which beats few workers of many threads.

    Notes
    -----
    Processes start afresh: forking would copy threads of OpenMP that do not run in the copy. A
    script therefore needs ``if __name__ == "__main__":`` around its work.
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
