"""Markdown pages with lines of at most 110 columns.

    python -m verification.markdown PAGE ...

Paragraphs and list items are wrapped; tables, code, headings, pictures and comments stay.
"""

import re
import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path

WIDTH = 110
ITEM = re.compile(r"^( *)([-*+]|\d+[.)])( +)(?=\S)")
MARKER = re.compile(r"([-+*=>]|#+|\d+[.)]|\|.*)$")  # begins a list, heading or table in a new line
VERBATIM = re.compile(r"\s*(\||#|!\[|<!--|:::|\[\^)")
GLUE = "\x00"


def between(page: str, marks: tuple[str, str], lines: Iterable[str]) -> str:
    """Return a page with other lines between two marks, each of which it holds once."""
    begin, end = marks
    before, rest = page.split(begin)
    return f"{before}{begin}\n\n" + "\n".join(lines) + f"\n\n{end}" + rest.split(end)[1]


def reflow(text: str, width: int = WIDTH) -> str:
    """Return a page with its prose wrapped."""
    lines, held, fence = [], [], ""
    for line in text.split("\n"):
        mark = re.match(r"\s*(```+|~~~+)", line)
        if fence or mark:
            lines += _wrapped(held, width)
            held = []
            lines.append(line)
            if mark and (not fence or mark[1].startswith(fence)):
                fence = "" if fence else mark[1]
        elif _stands_alone(line, held):
            lines += _wrapped(held, width)
            held = []
            lines.append(line)
        elif ITEM.match(line):
            lines += _wrapped(held, width)
            held = [line]
        else:
            held.append(line)
    return "\n".join([*lines, *_wrapped(held, width)])


def _stands_alone(line, held):
    """Return whether a line is not prose: blank, table, heading, picture, comment or code."""
    indented = line.startswith("    ") and not held and not ITEM.match(line)
    return not line.strip() or indented or bool(VERBATIM.match(line))


def _wrapped(held, width):
    """Return the lines of a paragraph or of an item of a list."""
    if not held:
        return []
    item = ITEM.match(held[0])
    first = item[0] if item else re.match(r" *", held[0])[0]
    text = " ".join([held[0][len(first) :].strip(), *(line.strip() for line in held[1:])])
    code = re.sub(r"`[^`]+`", lambda span: span[0].replace(" ", GLUE), text)
    words = []
    for word in code.split():
        if words and MARKER.match(word):
            words[-1] += GLUE + word
        else:
            words.append(word)
    filled = textwrap.wrap(
        " ".join(words), width, initial_indent=first, subsequent_indent=" " * len(first),
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
    return [line.replace(GLUE, " ") for line in filled]


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        path.write_text(reflow(path.read_text(encoding="utf-8")), encoding="utf-8")
