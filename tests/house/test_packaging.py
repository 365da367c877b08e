"""Set-up and first words: one version, one list of kernels, a README that runs."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def text(*parts):
    return ROOT.joinpath(*parts).read_text(encoding="utf-8")


def test_meson_and_citation_name_the_same_version():
    built = re.search(r"version: '([\d.]+)'", text("meson.build"))[1]
    cited = re.search(r"^version: ([\d.]+)$", text("CITATION.cff"), re.MULTILINE)[1]

    assert cited == built


def test_every_fortran_file_is_built():
    listed = set(re.findall(r"'(\w+\.f90)'", text("fortran", "meson.build")))

    assert listed == {path.name for path in (ROOT / "fortran").glob("*.f90")}


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
