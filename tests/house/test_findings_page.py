"""docs/reference/findings.md lists the findings that the program can give, and no other."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]


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
