"""The tables of docs/reference are those of the program, and the example can be used."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from docs.reference_tables import TABLES, grounds, written
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.recordings.tables import TEXT_FORMATS

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
PAGE = REFERENCE / "hypotheses.md"
PAGES = {
    "library": PAGE, "thresholds": REFERENCE / "thresholds.md", "curves": REFERENCE / "results.md"
}  # fmt: skip


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_that_of_the_program(name):
    text = PAGES[name].read_text(encoding="utf-8")

    anew = f"run: python -m {written.__module__} {PAGES[name].relative_to(REFERENCE.parents[1])}"
    assert TABLES[name]() in text, anew
    assert written(text) == text, anew


@pytest.mark.long
def test_the_table_of_grounds_is_that_of_the_small_site_on_each():
    assert grounds() in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", TEXT_FORMATS)
def test_the_guide_names_each_text_format_that_is_recognised(name):
    guide = (REFERENCE.parent / "guide" / "recordings.md").read_text(encoding="utf-8")

    assert name.split("_")[0] in guide.upper(), "name it in docs/guide/recordings.md"


def test_all_say_what_would_settle_them():
    assert all(one.decided_by for one in LIBRARY.values())


def test_the_example_enters_the_library_and_does_what_it_claims():
    (example,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    try:
        exec(example, {})
        entry = LIBRARY["crosstalk"]
    finally:
        LIBRARY.pop("crosstalk", None)
    scene = SimpleNamespace(case=SimpleNamespace(receivers=("R1", "R2")))
    motion = np.arange(24.0).reshape(1, 2, 3, 4)
    changed = entry.apply(scene, motion, "R2", 0.5)

    assert len(example.splitlines()) <= 30
    assert entry.claim == "The vertical of this receiver leaks into its horizontals."
    np.testing.assert_array_equal(changed[0, 1, 0], motion[0, 1, 0] + 0.5 * motion[0, 1, 2])
    np.testing.assert_array_equal(changed[:, 0], motion[:, 0])
