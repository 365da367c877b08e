"""paper.md has a head that pandoc reads, and cites exactly what paper.bib holds."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAPER = (ROOT / "paper.md").read_text(encoding="utf-8")
ENTRIES = dict(
    re.findall(r"^@\w+\{(\w+),(.*?)^\}", (ROOT / "paper.bib").read_text("utf-8"), re.M | re.S)
)


def test_the_head_names_title_authors_and_bibliography_each_on_a_line_of_its_own():
    head = re.match(r"---\n(.*?\n)---\n", PAPER, re.DOTALL)[1]

    keys = dict(re.findall(r"^(\w+):(.*)$", head, re.MULTILINE))
    assert {"title", "tags", "authors"} < set(keys)
    assert (ROOT / keys["bibliography"].strip()).is_file()


def test_every_citation_has_an_entry_and_every_entry_is_cited():
    assert set(re.findall(r"@(\w+)", PAPER)) == set(ENTRIES)


def test_every_entry_has_author_title_year_and_where_it_appeared():
    for key, entry in ENTRIES.items():
        fields = set(re.findall(r"^  (\w+) +=", entry, re.MULTILINE))
        assert {"author", "title", "year"} <= fields, key
        assert fields & {"journal", "institution", "publisher"}, key
