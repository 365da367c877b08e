"""Titles of tables in ten languages: quantity, unit, and which of two titles says it."""

import re
import tomllib
import unicodedata
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import resources
from typing import NamedTuple

from ..errors import ReadError
from ..units import FACTORS

_DATA = tomllib.loads(
    resources.files("pyblast.readers").joinpath("titles.toml").read_text(encoding="utf-8")
)
_UNITS = {word: name for name, words in _DATA["units"].items() for word in words.split()}
HARMLESS = frozenset(_DATA["harmless"].split())
TOTALS = frozenset(_DATA["totals"].split())


class Quantity(NamedTuple):
    """Quantity that is wanted of a table: titles, units, and which of two titles says it.

    ``units`` are suffixes of keys, the first for examples; none for text, "*" for any.
    ``default`` is taken where the title has none. Words ``says`` in a title say that it is this
    quantity ("actual"), ``version`` another one ("design"), ``part`` a part of it ("booster").
    A table must have what is ``needed``, every row what is a ``key`` unless it is a total. What
    ``adds`` can't be repeated over merged cells, a ``clock`` may hold times of day, rows with a
    bound such as "<0.5" are left out where ``bounded``.
    """

    words: str
    units: tuple[str, ...] = ()
    default: str = ""
    needed: bool = False
    key: bool = False
    says: str = ""
    version: str = ""
    part: str = ""
    adds: bool = False
    clock: bool = False
    bounded: bool = False


SAYS, PLAIN, VERSION, PART = 3, 2, 1, 0


class Title(NamedTuple):
    """Title of a column: its quantity, empty where unknown, the unit as written, and its rank."""

    quantity: str
    unit: str = ""
    rank: int = PLAIN


class Wanted:
    """Quantities that are wanted of a table, by name, with an index of their titles."""

    def __init__(self, quantities: Mapping[str, Quantity]) -> None:
        self.quantities = dict(quantities)
        self.words: dict[str, list[str]] = {}
        for name, q in quantities.items():
            for word in q.words.split():
                self.words.setdefault(plain_word(word), []).append(name)
        self.ranks = {
            (name, plain_word(word)): rank
            for name, q in quantities.items()
            for rank, words in ((SAYS, q.says), (VERSION, q.version), (PART, q.part))
            for word in words.split()
        }

    def title(self, text: str) -> Title:
        """Split the title of a column into quantity, unit and rank.

        Examples
        --------
        >>> wanted_by("holes").title("Actual charge (kg)")
        Title(quantity='charge', unit='kg', rank=3)
        >>> wanted_by("holes").title("Bench height (m)").quantity
        ''
        """
        titles = []
        for stem, unit in title_splits(" ".join(text.strip().strip('"').split())):
            for name, rank in self._named(stem, unit):
                titles.append(Title(name, unit, rank))
                if unit_name(unit) in self.quantities[name].units:
                    return titles[-1]
        titles.sort(key=lambda t: bool(t.unit) and self.quantities[t.quantity].units != ("*",))
        return titles[0] if titles else Title("")

    def _named(self, stem, unit):
        """Return the quantities of a title without its unit, and how well the title says them."""
        whole = plain_word(stem)
        if whole in self.words:
            return [(name, self.ranks.get((name, whole), PLAIN)) for name in self.words[whole]]
        words = re.split(r"[\W_]+", re.sub(r"(?<=[^\W\d_A-Z])(?=[A-Z])", " ", stem))
        words = [w for w in map(plain_word, words) if w and w not in HARMLESS]
        matches = [
            (name, rank)
            for name in self.quantities
            if (rank := self._rank(name, words, unit)) is not None
        ]
        return matches if len(matches) == 1 else []

    def _rank(self, name, words, unit):
        """Return how well words say a quantity, None where one of them says something else."""
        ranks = [self.ranks[name, w] for w in words if (name, w) in self.ranks]
        rest = [w for w in words if (name, w) not in self.ranks]
        joined = "".join(rest or words)
        known = [name in self.words.get(w, ()) for w in rest or words]
        if rest and not (name in self.words.get(joined, ()) or all(known)):
            return None
        if not rest and not any(known) and name not in self.words.get(joined, ()) and not (
            ranks and unit_name(unit) in self.quantities[name].units
        ):  # fmt: skip
            return None
        ranks += [self.ranks[name, joined]] if (name, joined) in self.ranks else []
        return PART if PART in ranks else max(ranks, default=PLAIN)


@cache
def wanted_by(door: str) -> Wanted:
    """Return the quantities that a door wants, by a table of ``titles.toml``."""
    quantities = {}
    for name, entry in _DATA[door].items():
        if like := entry.pop("like", ""):
            words = _DATA[door][like]["words"].split()
            beside = _DATA["toe"].split()
            entry["words"] = " ".join(f"{w}{t} {t}{w}" for w in words for t in beside)
        entry["units"] = tuple(entry.get("units", ()))
        quantities[name] = Quantity(**entry)
    return Wanted(quantities)


def plain_word(text: str) -> str:
    """Write a title in lower case without accents, blanks and signs: "Höhe [m]" is "hohem"."""
    spread = unicodedata.normalize("NFKD", text.replace("ı", "i").replace("ł", "l").casefold())
    return "".join(c for c in spread if c.isalnum())


def unit_name(text: str) -> str:
    """Return a unit as the suffix of a key, such as "mm_per_s" for "mm/sec"; "" if unknown."""
    plain = text.strip()
    if plain in FACTORS or plain == "Nm_per_s":
        return plain
    plain = plain.lower().replace("µ", "u").replace("μ", "u").replace("²", "2").replace("³", "3")
    plain = re.sub(r"^(\w+)[ .*·]?s\^?[-−]1$", r"\1/s", plain)
    parts = [_UNITS.get(part, part) for part in re.split(r"\s*/\s*|_per_| per ", plain)]
    name = "_per_".join(parts)
    return name if name in FACTORS or name == "deg" else ""


def unit_factor(symbol: str, where: str) -> float:
    """Return the SI factor of a printed unit such as ``mm/s`` or of a suffix like ``mm_per_s``."""
    name = unit_name(symbol)
    if name not in FACTORS:
        raise ReadError(f"{where}: unknown unit '{symbol[:40]}', expected one such as mm/s or in/s")
    return FACTORS[name]


def title_splits(text: str) -> Iterator[tuple[str, str]]:
    """Yield the ways to split a title into stem and unit."""
    for match in reversed([*re.finditer(r"[\[(]\s*([^\[(\])]*?(?:\([^)]*\))?)\s*[\])]", text)]):
        yield f"{text[: match.start()]} {text[match.end() :]}".strip(" _,:/"), match[1]
    for unit in ("Nm_per_s", *sorted(FACTORS, key=len, reverse=True)):
        if text.endswith(f"_{unit}") or text.lower().endswith(f"_{unit}"):
            yield text[: -len(unit) - 1], unit
    head, _, tail = text.rpartition(" ")
    if head and (unit_name(tail) or is_pressure(tail)):
        yield head.rstrip(" ,:/-"), tail
    yield text, ""


def title_unit(text: str) -> str:
    """Return the unit in the title of a column, whatever its quantity; "" if it has none."""
    return next((unit_name(unit) for _, unit in title_splits(text) if unit_name(unit)), "")


def is_pressure(text: str) -> bool:
    """Tell whether a text is a unit of air overpressure, decibels included."""
    return bool(re.match(r"(?i)(k?pa|h?pa|m?bar|mb|psi|db)\b", text.strip()))
