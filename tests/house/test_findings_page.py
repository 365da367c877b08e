"""docs/reference/findings.md lists the findings that the program can give, and no other."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE_NAME = "docs/reference/findings.md"
PAGE = (ROOT / PAGE_NAME).read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (D\d+)(?:, (D\d+))? \|[^|]*\|(.*)\|$", PAGE, re.MULTILINE)


def calls():
    """Return where each finding of the program is made, and the call."""
    return [
        (f"{path.relative_to(ROOT)}:{call.lineno}", call)
        for path in sorted((ROOT / "pyblast").rglob("*.py"))
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Finding"
    ]


def number(code):
    return int(code[1:])


def codes(calls):
    return {call.args[0].value for _, call in calls}


def can_fail(call):
    return any(word.arg == "failed" for word in call.keywords)


def test_a_finding_has_a_number_that_is_written_where_it_is_made():
    wrong = [
        where for where, call in calls()
        if not re.fullmatch(r"D\d+", str(getattr(call.args[0], "value", "")))
    ]  # fmt: skip

    assert wrong == [], 'the first argument is a text such as "D7", see CONTRIBUTING.md'


def test_the_page_lists_all_findings_and_those_that_may_fail():
    given, failing = codes(calls()), codes(call for call in calls() if can_fail(call[1]))
    rows = {code for code, _, _ in ROWS}

    assert sorted(given - rows, key=number) == [], f"add a row for each to {PAGE_NAME}"
    assert sorted(rows - given, key=number) == [], f"nothing gives them: say so in {PAGE_NAME}"
    assert {code for code, _, fails in ROWS if fails.strip()} == failing, (
        f"the third column of {PAGE_NAME} says when a finding fails: Finding(failed=...)"
    )


def test_findings_are_numbered_one_after_the_other():
    listed = [code for row in ROWS for code in row[:2] if code]
    (gone,) = re.findall(r"([^.]*) are no longer given\.", PAGE)
    withdrawn = re.findall(r"D\d+", gone)

    numbers = [number(code) for code in (*listed, *withdrawn)]
    free = sorted(set(range(1, max(numbers))) - set(numbers))
    assert listed == sorted(listed, key=number), f"the rows of {PAGE_NAME} are in order"
    assert free == [], f"a new finding takes the number after the last: D{free[0]}"
    assert len(set(numbers)) == len(numbers), "a number stands for one finding"
