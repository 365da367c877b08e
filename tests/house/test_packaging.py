"""Set-up and first words: one version, one list of kernels, a README that runs."""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from pyblast import core

ROOT = Path(__file__).resolve().parents[2]


def text(*parts):
    return ROOT.joinpath(*parts).read_text(encoding="utf-8")


def test_meson_and_citation_name_the_same_version():
    built = re.search(r"version: '([\d.]+)'", text("meson.build"))[1]
    cited = re.search(r"^version: ([\d.]+)$", text("CITATION.cff"), re.MULTILINE)[1]

    assert cited == built


def test_every_fortran_file_is_built():
    listed = set(re.findall(r"(?<!output: )'(\w+\.f90)'", text("fortran", "meson.build")))

    assert listed == {path.name for path in (ROOT / "fortran").glob("*.f90")}


def test_the_sizes_of_the_further_cores_are_those_that_python_knows():
    assert core.batch_core().pyblast_batch.n_batch == core.BATCH_SIZE
    assert core.single_core().pyblast_kinds.hex_width == core.HEX_WIDTH[True]


def test_a_core_is_missed_with_a_remedy_where_nothing_can_compile_it(tmp_path, monkeypatch):
    first = tmp_path / "fortran" / "_core.so"
    monkeypatch.setattr(core, "_core", SimpleNamespace(__file__=str(first)))

    with pytest.raises(ImportError, match="lacks _core_batch; install it again"):
        core._compiled("_core_batch")


def test_a_core_that_cannot_be_compiled_shows_what_the_compiler_says(tmp_path, monkeypatch):
    first = tmp_path / "fortran" / "_core.so"
    (tmp_path / "build.ninja").write_text("nothing to build\n")
    monkeypatch.setattr(core, "_core", SimpleNamespace(__file__=str(first)))

    with pytest.raises(ImportError, match=r"can't compile its further cores:\n.*\w"):
        core._compiled("_core_batch")


def test_dev_explains_itself_when_it_does_not_know_the_job():
    done = subprocess.run(
        ["/bin/sh", ROOT / "dev", "nonsense"], capture_output=True, text=True, check=False
    )

    assert done.returncode == 2
    assert done.stderr.startswith("usage: ./dev demo")


def test_the_python_example_of_the_readme_prints_the_closed_form(tmp_path):
    code = re.search(r"```python\n(.*?)```", text("README.md"), re.DOTALL)[1]

    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=False
    )

    assert done.stdout == "PPV 32.1 of 50 mm/s\n", done.stderr


def test_links_of_readme_and_documents_lead_somewhere():
    for page in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_readme_stays_within_three_screens():
    assert len(text("README.md").splitlines()) <= 140


def test_grids_need_no_gmsh_and_text_records_no_obspy():
    code = (
        "import sys, pyblast; pyblast.structured_box((2, 2, 2), (1.0, 1.0, 1.0)); "
        "import pyblast.recordings.recording; "
        "sys.exit(bool({'gmsh', 'obspy', 'matplotlib'} & set(sys.modules)))"
    )

    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_wrong_project_is_refused_before_the_slow_imports(tmp_path):
    (tmp_path / "project.toml").write_text('title = "nothing"')
    code = (
        "import sys\nfrom pyblast.cli.commands import app\n"
        "try:\n    app(['check', sys.argv[1]], prog_name='pyblast')\n"
        "except SystemExit as end:\n    assert end.code == 2\n"
        "slow = {'obspy', 'h5py', 'matplotlib', 'scipy.stats', 'scipy.signal', 'scipy.optimize'}\n"
        "sys.exit(str(slow & set(sys.modules)) if slow & set(sys.modules) else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "project.toml")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert done.returncode == 0, done.stderr
    assert "mesh, materials, run: missing; add them" in done.stderr
