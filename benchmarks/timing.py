"""Times of things done in turn, and what the machine itself can do meanwhile."""

import ctypes
import os
import platform
import time
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np

from .compiled import called, compiled

ROUNDS = 5
TRIAD_ENTRIES = 48_000_000  # three arrays of 384 MB
FLOPS_A_ROUND = 192
FMA_ROUNDS = 40_000_000
THREADS = (1, 2)


def interleaved(works, rounds=None, clock=time.perf_counter):
    """Do things in turn, round after round, so that load on the machine meets all of them.

    Parameters
    ----------
    works : dict of str to callable
    rounds : int, optional
        `ROUNDS` by default, which is one where the parts are only tried.
    clock : callable
        Of the wall, or of the processor for work on one thread.

    Returns
    -------
    dict of str to (rounds,) float64, s
    """
    for work in works.values():
        work()
    took = {name: [] for name in works}
    for turn in range(rounds or ROUNDS):
        names = list(works)
        for name in names if turn % 2 == 0 else names[::-1]:
            began = clock()
            works[name]()
            took[name].append(clock() - began)
    return {name: np.array(times) for name, times in took.items()}


def ratio(over, under):
    """Return the median over rounds of one time over another of the same round."""
    return float(np.median(over / under))


def median(times):
    """Return the median of times."""
    return float(np.median(times))


def threads(count):
    """Let what follows use a number of threads."""
    _openmp().omp_set_num_threads(count)


@cache
def _openmp():
    """Return the library of OpenMP that the cores use."""
    return ctypes.CDLL("libgomp.so.1")


def on(count, work):
    """Return the work on a number of threads."""

    def done():
        threads(count)
        work()

    return done


class Probes:
    """A triad from memory and multiply-add from registers, on one thread and on two."""

    def __init__(self):
        self.arrays = [np.zeros(TRIAD_ENTRIES), np.ones(TRIAD_ENTRIES), np.ones(TRIAD_ENTRIES)]
        self.total = np.zeros(max(THREADS))

    def works(self):
        """Return what to time beside other things, by name."""
        pairs = (("triad", self._triad), ("multiply_add", self._multiply_add))
        return {
            f"{name}_{count}": on(count, lambda work=work, count=count: work(count))
            for name, work in pairs
            for count in THREADS
        }

    def _triad(self, _):
        """Stream three arrays."""
        library = compiled("benchmarks/probes.f90")
        called(library.triad, (TRIAD_ENTRIES,), (0.5,), self.arrays)

    def _multiply_add(self, count):
        """Multiply and add in registers on each thread."""
        library = compiled("benchmarks/probes.f90")
        called(library.multiply_add, (FMA_ROUNDS, count), (0.9999,), (self.total,))

    @staticmethod
    def found(took):
        """Return rates and what a second thread adds, from the times of `interleaved`."""
        bytes_moved, flops = 24.0 * TRIAD_ENTRIES, float(FLOPS_A_ROUND) * FMA_ROUNDS
        return {
            "triad_gb_per_s": [bytes_moved / median(took[f"triad_{n}"]) / 1e9 for n in THREADS],
            "multiply_add_gflops": [
                n * flops / median(took[f"multiply_add_{n}"]) / 1e9 for n in THREADS
            ],
            "triad_two_threads": ratio(took["triad_1"], took["triad_2"]),
            "multiply_add_two_threads": 2.0 * ratio(took["multiply_add_1"], took["multiply_add_2"]),
        }


def machine():
    """Return what can be known of the machine: processor, compiler's view, memory."""
    text = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    named = [line.split(":")[1].strip() for line in text.splitlines() if "model name" in line]
    return {"processor": named[0] if named else platform.processor(), "threads": len(named) or 1}


def stamp():
    """Return on what, how busy and when something was measured, to be kept with its numbers."""
    return {
        "machine": machine(),
        "load": round(os.getloadavg()[1], 1),
        "date": datetime.now(UTC).date().isoformat(),
    }
