"""The problem that peers solve: read, and what they found written. Knows nothing but NumPy."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np


def given():
    """Return the problem that the command line names first; SI, nodes from 0."""
    with np.load(sys.argv[1]) as file:
        problem = SimpleNamespace(**{name: file[name] for name in file.files})
    problem.folder = Path(sys.argv[1]).parent
    problem.dt = float(problem.dt)
    return problem


def solve(problem, step, displacement):
    """March with ``step(i)``, keep what ``displacement()`` (n_receivers, 3) tells, and write.

    The command line names the number of steps and where to write after the problem.

    Seconds are those of the processor: all march on one thread.
    """
    n_steps = int(sys.argv[2])
    moved = np.zeros((n_steps + 1, len(problem.receivers), 3))
    began = time.process_time()
    for i in range(n_steps):
        step(i)
        moved[i + 1] = displacement()
    seconds = time.process_time() - began
    np.savez(sys.argv[3], velocity=np.diff(moved, axis=0) / problem.dt, seconds=seconds)
