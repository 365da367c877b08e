"""Many runs side by side, on the cores of a machine or on many machines, resumed by a cache."""

import os
from collections.abc import Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

from ..solving.model import Model
from .run_cache import KeptRun, cached_run, find_run

THREADS = "OMP_NUM_THREADS"


def run_all(
    models: Sequence[Model], duration: float, *, folder=None, executor: Executor | None = None
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
    waiting = [
        executor.submit(cached_run, model, duration, folder) if run is None else None
        for model, run in zip(models, kept, strict=True)
    ]
    return [
        run if future is None else future.result()
        for run, future in zip(kept, waiting, strict=True)
    ]


@contextmanager
def workers(count: int | None = None):
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
        with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
            yield pool
    finally:
        if before is None:
            del os.environ[THREADS]
        else:
            os.environ[THREADS] = before
