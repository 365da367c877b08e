"""The wheel, installed where nothing of the checkout is seen: demo, program, tests."""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TESTS = "blasts", "inference", "model", "recordings", "signals"  # of the package alone
pytestmark = pytest.mark.long


def run(*command, cwd):
    own = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    own.pop("PYTHONPATH", None)
    own["OMP_NUM_THREADS"] = str(os.cpu_count())  # tests have one each
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=own, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    run(
        sys.executable, "-m", "pip", "wheel", ROOT, "--no-deps", "--no-build-isolation", "--quiet",
        "--wheel-dir", folder, f"--config-settings=builddir={folder / 'build'}", cwd=folder,
    )  # fmt: skip
    (built,) = folder.glob("pyblast-*.whl")
    return built


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """Python of an environment with the wheel and the libraries, without the checkout."""
    home = tmp_path_factory.mktemp("environment")
    venv.create(home, with_pip=False)
    python = home / "bin" / "python"
    run(sys.executable, "-m", "pip", "--python", python, "install", "--no-deps", "--quiet", wheel,
        cwd=home)  # fmt: skip
    packages = Path(run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))",
                        cwd=home).strip())  # fmt: skip
    # A folder that another's file of paths names is searched; its own such files are not read.
    (packages / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    said = run(python, "-c", "import pyblast; print(pyblast.__file__)", cwd=home)
    assert Path(said.strip()).is_relative_to(home)
    return python


def test_the_wheel_has_the_program_and_all_cores(wheel):
    names = zipfile.ZipFile(wheel).namelist()

    for core in ("_core", "_core_batch", "_core_single"):
        assert any(Path(name).name.startswith(f"{core}.") for name in names), core
    if shutil.which("h5fc") is not None:
        assert "pyblast/bin/pyblast-run" in names


def test_the_demo_runs_from_the_wheel(python, tmp_path):
    example = tmp_path / "mine"
    shutil.copytree(
        ROOT / "examples" / "gol_e_gohar", example, ignore=shutil.ignore_patterns("results")
    )

    run(python, "-m", "pyblast", "run", example / "project.toml", cwd=tmp_path)

    (report,) = example.rglob("report.html")
    assert report.stat().st_size > 1e5


def test_the_tests_of_the_package_pass_from_the_wheel(python, tmp_path):
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for part in ("benchmarks", "examples", "tests", "verification"):
        shutil.copytree(ROOT / part, tmp_path / part)

    said = run(python, "-m", "pytest", "-n", "0", *(f"tests/{part}" for part in TESTS),
               cwd=tmp_path)  # fmt: skip

    assert int(re.search(r"(\d+) passed", said)[1]) > 300
