"""The commands, called in this process or started in one of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path

from typer.testing import CliRunner

from pyblast.cli.commands import app


def call(*arguments):
    return CliRunner().invoke(app, [str(a) for a in arguments])


def spawn(*arguments, **options):
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "pyblast", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, **options)  # fmt: skip


def python(script, *arguments, threads=1):
    """Run a script in a process of its own; return what its last line holds as JSON."""
    here = Path(__file__).resolve().parent
    path = os.pathsep.join([str(here.parents[1]), str(here)])
    environment = os.environ | {"OMP_NUM_THREADS": str(threads), "PYTHONPATH": path}
    command = [sys.executable, "-c", script, *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.strip().splitlines()[-1])
