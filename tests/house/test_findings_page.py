"""docs/reference/findings.md lists the findings that the program can give, and no other."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Numbers given out before their findings are written, with a word of their row of the page. The
# next finding takes the number after the last.
GIVEN_OUT = {
    "D38": "source",  # a receiver too near to a source
    "D39": "built",  # the ground as built is not the ground asked for; D37 goes with it
    "D40": "band",
    "D42": "elastic",  # radius of the elastic ground round a hole
    "D43": "converged",
    "D44": "lack of fit",
}


def test_the_page_lists_all_findings_and_those_that_may_fail():
    given, failing = set(), set()
    for path in (ROOT / "pyblast").rglob("*.py"):
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Finding":
                code = call.args[0].value
                given.add(code)
                if len(call.args) > 3 or any(word.arg == "failed" for word in call.keywords):
                    failing.add(code)
    page = ROOT / "docs" / "reference" / "findings.md"
    rows = re.findall(r"^\| (D\d+)[^|]*\|[^|]*\|(.*)\|$", page.read_text(encoding="utf-8"), re.M)

    assert {code for code, _ in rows} == given
    assert {code for code, fails in rows if fails.strip()} == failing


def test_new_findings_have_the_numbers_that_were_given_out():
    page = (ROOT / "docs" / "reference" / "findings.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (D\d+)[^|]*\|([^|]*)\|", page, re.M))

    for code, row in rows.items():
        if int(code[1:]) > 37:
            assert GIVEN_OUT.get(code, "?") in row, code
