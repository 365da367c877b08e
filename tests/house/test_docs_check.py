"""`./dev docs --check`: commands, pictures and numbers of documents are those of the program."""

import io
import re

import numpy as np
import pytest
from matplotlib.image import imsave

from docs.check import (
    CHAPTERS,
    PAGES,
    QUICKSTART,
    ROOT,
    chapter_faults,
    command_lines,
    differs,
    main,
    quick_faults,
    shell_lines,
    unlike,
    wrong_command,
)


def test_the_documents_hold_as_far_as_no_run_is_needed():
    assert list(quick_faults(PAGES)) == []
    assert main(["--quick"]) == 0
    assert main(["nonsense"]) == 2


@pytest.mark.parametrize(
    ("line", "fault"),
    [("pyblast run project.toml --out first", ""),
     ("pyblast run project.toml --plan", "pyblast run has no option --plan"),
     ("pyblast plan project.toml", "pyblast has no command plan"),
     ("pyblast --help", ""),
     ("./dev sights", "./dev has no job sights"),
     ("./dev docs --check", ""),
     ("python examples/absent.py", "there is no examples/absent.py"),
     ("python -m docs.absent", "there is no module docs.absent"),
     ("OMP_NUM_THREADS=2 pyblast check project.toml --nothing",
      "pyblast check has no option --nothing")],
)  # fmt: skip
def test_a_command_that_does_not_exist_is_named(line, fault):
    assert wrong_command(line) == fault


def test_pages_with_wrong_commands_and_pictures_are_named(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("`pyblast run x --plan` ![a](figures/none.png)\n")

    faults = list(quick_faults([page]))

    assert len(faults) == 2
    assert "--plan" in faults[0]
    assert "makes none.png" in faults[1]


def test_commands_are_those_of_blocks_of_indented_lines_and_in_backticks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```sh\npyblast check a.toml   # first\n```\n    python b.py\nand `pyblast mesh c.toml`\n"
    )

    assert shell_lines(page) == ["pyblast check a.toml"]
    assert command_lines(page) == ["pyblast check a.toml", "python b.py", "pyblast mesh c.toml"]
    assert any(line.startswith("pyblast diagnose") for line in shell_lines(QUICKSTART))


@pytest.mark.parametrize(
    ("made", "other"),
    [("After 23 runs\n0.558 (0.495 to 0.629)", False),
     ("After 23 runs 0.565 (0.49 to 0.63)", False),
     ("After 23 runs 0.6 (0.495 to 0.629)", True), ("After 23 tries 0.558 (0.495 to 0.629)", True)],
)  # fmt: skip
def test_texts_are_the_same_up_to_the_error_of_numbers(made, other):
    assert differs("After 23 runs 0.558 (0.495 to 0.629)", made) == other


def test_the_index_of_examples_has_no_gaps_and_lists_all_of_them():
    text = (ROOT / "docs" / "examples.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| \[?`(examples/[^`]+)`", text, re.MULTILINE)
    scripts = sorted((ROOT / "examples").glob("[0-9]*.py"))
    projects = {path.parent for path in (ROOT / "examples").glob("*/project.toml")}

    assert [int(number) for number, _ in rows] == list(range(1, len(rows) + 1))
    assert all((ROOT / path).exists() for _, path in rows)
    assert [path.name[:3] for path in scripts] == [f"{n:02d}_" for n in range(1, len(scripts) + 1)]
    assert {*scripts, *projects} <= {ROOT / path for _, path in rows}


def png(image):
    file = io.BytesIO()
    imsave(file, image, format="png")
    return file.getvalue()


def test_pictures_are_the_same_to_the_eye():
    white = np.ones((40, 60, 3))
    dot, bar = white.copy(), white.copy()
    dot[10, 10], bar[10:20] = 0.0, 0.0

    assert not unlike(png(white), png(dot))
    assert unlike(png(white), png(bar))
    assert unlike(png(white), png(white[:-1]))


def test_a_chapter_whose_numbers_changed_is_named_and_written_anew(tmp_path, monkeypatch):
    page = tmp_path / "page.md"
    page.write_text("a\n\n<!-- part -->\n\nPPV 3 mm/s\n\n<!-- end of part -->\n\nb\n")
    made = {"part": "PPV 9 mm/s"}, {}
    chapter = type(CHAPTERS["demo"])(lambda _: made, {"part": page}, ())
    monkeypatch.setitem(CHAPTERS, "trial", chapter)

    (fault,) = chapter_faults("trial", write=True)

    assert "PPV 9 mm/s" in fault
    assert page.read_text() == "a\n\n<!-- part -->\n\nPPV 9 mm/s\n\n<!-- end of part -->\n\nb\n"
    assert list(chapter_faults("trial", write=False)) == []


@pytest.mark.parametrize("name", CHAPTERS)
def test_every_picture_of_a_chapter_is_there(name):
    for picture in CHAPTERS[name].pictures:
        assert (ROOT / "docs" / "figures" / picture).stat().st_size > 10_000
