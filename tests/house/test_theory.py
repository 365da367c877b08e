"""Every equation that the code cites stands in docs/theory.md, numbered without gaps."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CODE = (
    "pyblast/**/*.py",
    "fortran/*.f90",
    "examples/**/*.py",
    "verification/*.py",
    "tests/**/*.py",
)
NUMBER = r"\((\d+)\.(\d+)\)"
CITATION = re.compile(rf"theory\.md[\s!]*({NUMBER}(?:(?:,| and| to)[\s!]*{NUMBER})*)")


def equations():
    """List the numbers at the ends of the formulas of theory.md, in order."""
    text = (ROOT / "docs" / "theory.md").read_text(encoding="utf-8")
    return [(int(s), int(n)) for s, n in re.findall(rf"^    .*{NUMBER}$", text, re.MULTILINE)]


def citations():
    """List (file, section, number) of every equation that code cites."""
    found = []
    for pattern in CODE:
        for path in ROOT.glob(pattern):
            for match in CITATION.finditer(path.read_text(encoding="utf-8")):
                for section, number in re.findall(NUMBER, match[1]):
                    found.append((path.name, int(section), int(number)))
    return found


def test_every_cited_equation_exists():
    known = set(equations())

    missing = [f"{name} ({s}.{n})" for name, s, n in citations() if (s, n) not in known]

    assert len(citations()) > 20
    assert missing == []


def test_equations_are_numbered_without_gaps():
    numbers = equations()

    wanted = []
    for section in sorted({s for s, _ in numbers}):
        count = sum(s == section for s, _ in numbers)
        wanted += [(section, n) for n in range(1, count + 1)]
    assert numbers == wanted
