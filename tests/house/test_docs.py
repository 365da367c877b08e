"""The documents: links resolve, lines are short, words are standard, the site builds."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
from words import WORDS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
WIDTH = 110
GENERATED = re.compile(r"<!-- library -->.*?<!-- end of library -->", re.DOTALL)
EACH = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def prose(text):
    """Return a page without code, pictures, links, quotations and tables written by the program."""
    text = GENERATED.sub(lambda found: "\n" * found[0].count("\n"), text)
    text = re.sub(r"^( *)(```+)[^\n]*\n.*?^\1\2", blank, text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^    .*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`]*`", blank, text)
    text = re.sub(r"\]\([^)]*\)", blank, text)
    return re.sub(r"<!--.*?-->", blank, text, flags=re.DOTALL)


def blank(found):
    """Return as many line breaks as there were."""
    return " " + "\n" * found[0].count("\n")


def anchors(page):
    """Return the anchors of the headings of a page."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@EACH
def test_relative_links_and_anchors_lead_somewhere(page):
    wrong = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        path, _, anchor = target.partition("#")
        aim = (page.parent / path).resolve() if path else page
        if "://" not in target and not (aim.exists() and (not anchor or anchor in anchors(aim))):
            wrong.append(target)

    assert not wrong


@EACH
def test_no_line_of_prose_is_longer_than_110_columns(page):
    fenced, long = False, []
    for number, line in enumerate(page.read_text(encoding="utf-8").split("\n"), 1):
        fenced ^= bool(re.match(r"\s*```", line))
        if not fenced and not re.match(r"\s*(\||!\[|    )", line) and len(line) > WIDTH:
            long.append(number)

    assert not long, f"wrap them: python -m verification.markdown {page.relative_to(ROOT)}"


@EACH
def test_words_are_the_standard_ones(page):
    text = prose(page.read_text(encoding="utf-8"))
    found = [
        f"line {text.count(chr(10), 0, hit.start()) + 1}: {hit[0]!r}, write {standard}"
        for word, standard in WORDS.items()
        for hit in re.finditer(rf"\b(?:{word})\b", text, re.IGNORECASE)
    ]

    assert not found, "\n".join(found)


@pytest.mark.long
@pytest.mark.skipif(
    any(importlib.util.find_spec(name) is None for name in ("sphinx", "myst_parser", "furo")),
    reason="pip install pyblast[docs]",
)
def test_the_site_builds_without_a_warning(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "--fail-on-warning", "--keep-going",
         "-d", tmp_path / "doctrees", DOCS, tmp_path / "site"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip

    assert done.returncode == 0, done.stderr
    assert 'class="sig' in (tmp_path / "site" / "reference" / "api.html").read_text()
