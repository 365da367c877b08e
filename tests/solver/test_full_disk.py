import subprocess
import sys

import pytest
from small_project import written

pytest.importorskip("resource")  # a limit of the size of files stands for a full disk

LIMIT = "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)"
WRITE = f"""
import resource, sys
import numpy as np
from pyblast.errors import ReadError
from pyblast.solver.model_file import write_arrays
{LIMIT}
try:
    write_arrays(sys.argv[2], dict(a=dict(x=np.ones(400000), y=np.arange(9))), dict(kind="test"))
except ReadError as error:
    sys.exit("told: " + str(error))
"""
RUN = f"""
import resource, sys
import pyblast.workflows.run
from pyblast.cli.commands import main
{LIMIT}
sys.argv = ["pyblast", "run", sys.argv[2], "--accept-findings"]
main()
"""


def python(code, *values):
    command = [sys.executable, "-c", code, *map(str, values)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("size", [0, 1000, 3_000_000])
def test_a_full_disk_is_told_and_leaves_the_old_file(tmp_path, size):
    path = tmp_path / "result.h5"
    path.write_bytes(b"old")

    done = python(WRITE, size, path)

    assert done.returncode == 1, done.stderr
    assert done.stderr.startswith(f"told: {path}: can't be written (")
    assert "\n" not in done.stderr.strip()
    assert [each.name for each in tmp_path.iterdir()] == ["result.h5"]
    assert path.read_bytes() == b"old"


@pytest.mark.long
def test_a_run_on_a_full_disk_ends_with_2_and_keeps_earlier_results(tmp_path):
    path = written(tmp_path)
    earlier = tmp_path / "results" / "001"
    earlier.mkdir(parents=True)
    (earlier / "result.h5").write_bytes(b"old")

    done = python(RUN, 20_000, path)

    assert done.returncode == 2, done.stderr
    assert "can't be written" in done.stderr.strip().splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert [each.name for each in (tmp_path / "results").iterdir()] == ["001"]
    assert (earlier / "result.h5").read_bytes() == b"old"
