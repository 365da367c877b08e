"""Home-made words stay out: the sources say the standard terms of the field.

`PYTHONPATH=tests/cases python tests/house/test_words.py` lists every place, file by file.
"""

import ast
import re
import sys
from pathlib import Path

import pytest
from words import NAMES, WORDS

ROOT = Path(__file__).resolve().parents[2]
PYTHON = sorted((ROOT / "pyblast").rglob("*.py"))
FORTRAN = sorted((ROOT / "fortran").glob("*.f90"))
TEMPLATES = sorted((ROOT / "pyblast").rglob("*.html"))
BANNED = [re.compile(rf"(?<![^\W_])({word})(?![^\W_])", re.IGNORECASE) for word in WORDS]
DECLARED = re.compile(
    r"^\s*(?:[\w ()=]*\b(?:subroutine|function|module|program)\s+(\w+)|[^!]*::([^!]*))"
)


def words_in(text):
    """Yield line, word and standard term for each home-made word, in names as in sentences."""
    flat = re.sub(r"\s", " ", text)
    for pattern, term in zip(BANNED, WORDS.values(), strict=True):
        for match in pattern.finditer(flat):
            yield text.count("\n", 0, match.start()) + 1, match[0].lower(), term


def names_of_python(path):
    """Yield line and name for all that a module binds."""
    yield 1, path.stem
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id if isinstance(node, ast.Name) else node.attr


def names_of_fortran(path):
    """Yield line and name for all procedures and variables that a file declares."""
    yield 1, path.stem
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        if declared := DECLARED.match(line):
            for name in re.findall(r"[A-Za-z]\w*", re.sub(r"\(.*?\)|=.*", "", "".join(
                part for part in declared.groups() if part
            ))):  # fmt: skip
                yield number, name


def offences(path):
    """Return what is home-made in a file: (line, word, standard term), in order."""
    text = path.read_text(encoding="utf-8")
    places = list(words_in(text))
    names = {".py": names_of_python, ".f90": names_of_fortran}.get(path.suffix, lambda _: ())
    places += [(line, name, NAMES[name]) for line, name in names(path) if name in NAMES]
    return sorted(set(places))


@pytest.mark.parametrize(
    "path", [*PYTHON, *TEMPLATES, *FORTRAN], ids=lambda path: str(path.relative_to(ROOT))
)
def test_a_file_says_the_standard_terms(path):
    lines = [f"line {line}: {word} -> {term}" for line, word, term in offences(path)]

    assert not lines, "\n".join([str(path.relative_to(ROOT)), *lines])


@pytest.mark.parametrize(
    ("text", "words"),
    [("The march of knobs", ["knobs", "march"]), ("march_of(x)", ["march"]), ("primrose", []),
     ("errors of\nthe theory", ["errors of the theory"]), ("margin, remarks", [])],
)  # fmt: skip
def test_words_are_seen_in_names_and_sentences_and_nowhere_else(text, words):
    assert sorted(word for _, word, _ in words_in(text)) == words


if __name__ == "__main__":
    listing = [
        f"{path.relative_to(ROOT)}:{line}: {word} -> {term}\n"
        for path in [*PYTHON, *TEMPLATES, *FORTRAN]
        for line, word, term in offences(path)
    ]
    sys.stdout.writelines([*listing, f"{len(listing)} places\n"])
