"""BLAS of the commands has one thread, set before numpy is imported."""

import os
import subprocess
import sys

SPY = """
import os, sys
class Spy:
    def find_spec(self, name, path=None, target=None):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"))
sys.meta_path.insert(0, Spy())
import {module}
import numpy
"""


def told(module, **given):
    """Return what the variable is when a module first asks for numpy."""
    kept = {name: v for name, v in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", SPY.format(module=module)], env=kept | given, text=True,
        capture_output=True, check=True,
    )  # fmt: skip
    return done.stdout.split()[0]


def test_commands_have_one_thread_of_blas_unless_told_otherwise():
    assert told("pyblast.cli.commands") == "1"
    assert told("pyblast.cli.commands", OPENBLAS_NUM_THREADS="3") == "3"


def test_a_script_that_uses_pyblast_keeps_its_own():
    assert told("pyblast.signals.seismogram") == "None"
