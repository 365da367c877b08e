"""Copies of the source that are built and tested apart, with other options or with defects."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CASE = "tests/verification/test_suite.py::test_the_first_mesh_of_a_case_is_as_good_as_it_was"
# In every process that has the copy on its path: the copy, not the installed package.
UNINSTALL = """
import sys
sys.meta_path[:] = [m for m in sys.meta_path if "editable" not in type(m).__module__]
"""
# In a process of its own: what failed, as one line of JSON.
RUN_TESTS = """
import json, sys
from pathlib import Path
import pytest, pyblast
assert Path(pyblast.__file__).is_relative_to(Path.cwd()), pyblast.__file__
failed = []
class Failures:
    def pytest_runtest_logreport(self, report):
        if report.failed:
            failed.append(report.nodeid)
    def pytest_collectreport(self, report):
        if report.failed:
            failed.append(report.nodeid)
pytest.main(sys.argv[1:], plugins=[Failures()])
print("\\n" + json.dumps(failed))
"""


class Copy:
    """Copy of what git knows in ``build/NAME``, with options of meson."""

    def __init__(self, name, *options):
        self.folder, self.options = ROOT / "build" / name, options
        self.source = self.folder / "source"
        listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for each in names.splitlines():
            if (ROOT / each).is_file():
                self._put(each)
        (self.source / "sitecustomize.py").write_text(UNINSTALL, encoding="utf-8")

    def _put(self, name):
        """Copy a file unless the copy is the same, so that no more is built than changed."""
        path, raw = self.source / name, (ROOT / name).read_bytes()
        if not path.is_file() or path.read_bytes() != raw:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(raw)

    def build(self):
        """Build the copy and put its cores into its package; return whether that worked."""
        made, package = self.folder / "objects", self.source / "pyblast"
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        tools = {**os.environ, "PATH": path}
        if not (made / "build.ninja").is_file():
            setup = ["meson", "setup", str(made), str(self.source), *self.options]
            subprocess.run(setup, check=True, env=tools, stdout=subprocess.DEVNULL)
        ninja = ["ninja", "-C", str(made)]
        if subprocess.run(ninja, env=tools, capture_output=True, check=False).returncode:
            return False
        for core in (made / "fortran").glob("_core*.so"):
            shutil.copy2(core, package / core.name)
        shutil.copy2(self.source / "fortran" / "arrays.toml", package)
        program = made / "fortran" / "pyblast-run"
        if program.is_file():
            (package / "bin").mkdir(exist_ok=True)
            shutil.copy2(program, package / "bin" / program.name)
        return True

    def failures(self, tests, most=0, longest=900.0, **environment):
        """Return the tests of the copy that fail, at most so many, or what ended them.

        ``longest`` is the time in s that they may take.
        A test ``suite:N`` is the quick part of case N of the verification suite.
        """
        named = [f"{CASE}[{t[6:]}]" if t.startswith("suite:") else t for t in tests]
        options = ["-q", "-n0", "--tb=short", f"--maxfail={most}", "-p", "no:cacheprovider"]
        try:
            done = self.python(["-c", RUN_TESTS, *options, *named], longest, **environment)
        except subprocess.TimeoutExpired as late:
            (self.folder / "tests.log").write_bytes(late.stdout or b"")
            return ["time limit"]
        said = done.stdout + done.stderr
        (self.folder / "tests.log").write_text(said, encoding="utf-8")
        if done.returncode:
            return [f"end of the process, {done.returncode}"]
        return json.loads(done.stdout.strip().splitlines()[-1])

    def python(self, arguments, longest=900.0, **environment):
        """Run Python in the copy, on one thread and for so many s at most; return how it ended."""
        quiet = {"OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
        environment = {**quiet, "PYTHONPATH": str(self.source), **environment}
        return subprocess.run(
            [sys.executable, *arguments], cwd=self.source, text=True, capture_output=True,
            env={**os.environ, **environment}, check=False, timeout=longest,
        )  # fmt: skip
