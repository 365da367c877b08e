"""Files as engineers keep them: every one is read rightly or refused, and the page says so."""

import json

import pytest

from verification import field_files

pytest.importorskip("openpyxl")


@pytest.mark.parametrize("file", field_files.FILES, ids=lambda file: file.name)
def test_a_field_file_is_read_rightly_or_refused(tmp_path, file):
    said, right = field_files.outcome(file, tmp_path)

    assert right, said


def test_the_page_of_field_files_is_up_to_date():
    before = json.loads(field_files.BEFORE.read_text(encoding="utf-8"))

    assert field_files.PAGE.read_text(encoding="utf-8") == field_files.page(
        field_files.outcomes(), before
    )
