"""Kinds of files by their first bytes: what is read, what to export."""

import re
import tomllib
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from ..errors import ReadError

_HEAD = 4096  # bytes that say the kind
_SEEN = 65536  # bytes among which control characters are counted
_MOST_CONTROLS = 3, 0.01  # of them in text, which a damaged file may hold
_BEFORE = r"<\?.*?\?>|<!--.*?-->|<!DOCTYPE(?:[^>\[]|\[.*?\])*>"
_ROOT = re.compile(rf"(?:\s|{_BEFORE})*<(?:\w+:)?([A-Za-z_]\w*)[\s/>]", re.DOTALL)
_CONTROLS = bytes({*range(32), 127} - {*b"\t\n\v\f\r\x1a"})


class Kind(NamedTuple):
    """Kind of a file: its name, what it holds, the doors at which it is read, what to do else.

    ``begins`` is a regular expression of its first bytes, ``root`` the names of its first element
    of XML, ``holds`` text anywhere in it; ``suffix`` says it where these fit no kind, ``binary``
    only if it is no text.
    """

    name: str
    what: str = ""
    doors: frozenset[str] = frozenset()
    export: str = ""
    begins: re.Pattern | None = None
    root: frozenset[str] = frozenset()
    holds: bytes = b""
    suffix: frozenset[str] = frozenset()
    binary: frozenset[str] = frozenset()


_DATA = tomllib.loads(
    resources.files("pyblast.readers").joinpath("kinds.toml").read_text(encoding="utf-8")
)
EXPORTS: dict[str, str] = _DATA["exports"]
_SETS = ("doors", "root", "suffix", "binary")


def _kind(name, row):
    """Return the kind of a row of the table."""
    sets = {key: frozenset(row[key].split()) for key in _SETS if key in row}
    begins = re.compile(row["begins"], re.DOTALL | re.ASCII) if "begins" in row else None
    return Kind(name, **row | sets | {"begins": begins, "holds": row.get("holds", "").encode()})


KINDS = tuple(_kind(name, row) for name, row in _DATA["kinds"].items())
TEXT, BINARY = KINDS[-2:]


def is_text(content: bytes) -> bool:
    """Tell whether content is text, also damaged, in UTF-8, Latin-1 or UTF-16 with its mark."""
    seen = content[:_SEEN]
    n_controls = len(seen) - len(seen.translate(None, _CONTROLS))
    few, share = _MOST_CONTROLS
    marked = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    return marked or n_controls <= max(few, share * len(seen))


def kind_of(content: bytes, suffix: str = "", door: str = "") -> Kind:
    r"""Return the kind of a file by its content, by its suffix where that says nothing.

    Parameters
    ----------
    content : bytes
    suffix : str
        Such as ".dxf".
    door : str
        At which it is to be read. Where plain text is read, text is not named by its suffix.

    Returns
    -------
    Kind
        `TEXT` or `BINARY` if nothing says more.

    Examples
    --------
    >>> kind_of(b"ply\nformat ascii 1.0\n").name
    'PLY'
    >>> kind_of(b"Hole,Easting,Northing\n", ".csv").name
    'text'
    """
    marked = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    head = content[:_HEAD].decode("utf-16" if marked else "latin-1", "replace").lstrip("ï»¿")
    root = _ROOT.match(head)
    for kind in KINDS:
        named = root is not None and (root[1] in kind.root or "*" in kind.root)
        if (named or (kind.begins and kind.begins.match(head))) and kind.holds in content:
            return kind
    text, name = is_text(content), suffix.lower().lstrip(".")
    for kind in KINDS:
        if not text and name in kind.suffix | kind.binary:
            return kind
        if name in kind.suffix and (door in kind.doors or not kind.doors or door not in TEXT.doors):
            return kind
    return TEXT if text else BINARY


def expect(where: Path | str, content: bytes, door: str) -> Kind:
    """Return the kind of a file that is read at a door.

    Parameters
    ----------
    where : Path or str
        For messages, with the suffix.
    content : bytes
    door : str
        Such as "table", "surface" or "record": a key of `EXPORTS`.

    Raises
    ------
    ReadError
        If it is of another kind; says which, and what to export.
    """
    kind = kind_of(content, Path(where).suffix, door)
    if door in kind.doors:
        return kind
    remedy = EXPORTS.get(kind.export, kind.export) or EXPORTS[door]
    what = f" ({kind.what})" if kind.what else ""
    raise ReadError(f"{where}: is {kind.name}{what}; {remedy}")
