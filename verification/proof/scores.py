"""Scores of first answers: confusion matrix, shares with exact intervals, power against energy."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

CLEAR = 8.0  # d' from which an effect must be named
# Edges of the classes of power: of the energy of a record, and of d'.
ENERGIES, LENGTHS = (0.0, 0.01, 0.05, 0.15, 0.4, np.inf), (0.0, 4.0, 6.0, CLEAR, 16.0, np.inf)
LEVEL = 0.95
SILENT = ("NULL", "UNKNOWN")
NAMES = ("NAMED", "COMPOSITE", "MISTAKE")
NULLS, OUTSIDE = ("null", "hard null"), ("outside", "out of library")
# Effects outside of the library that its `body` ("softer or stiffer, or nearly a void") means.
BODIES = "void", "tunnel", "dyke", "basin"


class Target(NamedTuple):
    """What a share of answers is to reach.

    Parameters
    ----------
    name : str
        Of a share, see `shares`.
    words : str
    sign : str
        "≤" or "≥".
    share : float
    least : int
        Cases below which nothing is said.
    """

    name: str
    words: str
    sign: str
    share: float
    least: int


TARGETS = (
    Target("alarms", "false alarms on nulls", "≤", 0.02, 60),
    Target("right names", "answers with names in which every name is right", "≥", 0.95, 20),
    Target("named", f"single effects of d′ ≥ {CLEAR:g}: named, nothing else", "≥", 0.75, 20),
    Target("wrong outside", "wrong names on effects outside of the library", "≤", 0.05, 6),
    Target("both", "two effects: both named, and nothing else", "≥", 0.4, 10),
    Target("real", "effects concealed in real records: named, and nothing else", "≥", 2 / 3, 20),
)


def answer_word(row: dict) -> str:
    """Return what an answer says: the names, or the outcome where it gives none."""
    named = " + ".join(sorted(row["named"])) if row["outcome"] in NAMES else ""
    return named or row["outcome"]


def truth_word(row: dict) -> str:
    """Return what is true: labels, or "nothing"."""
    outside = "outside: " if row["block"] in OUTSIDE else ""
    return outside + " + ".join(sorted(row["truth"])) if row["truth"] else "nothing"


def confusion(rows: list[dict]) -> tuple[list[str], list[str], np.ndarray]:
    """Return the confusion matrix of answers.

    Returns
    -------
    truths, answers : list of str
        Those that occur; "nothing" first, and the outcomes without a name behind the names.
    counts : (n_truths, n_answers) int64
    """
    pairs = Counter((truth_word(row), answer_word(row)) for row in rows)
    truths = sorted({truth for truth, _ in pairs}, key=lambda word: (word != "nothing", word))
    answers = sorted({answer for _, answer in pairs}, key=lambda word: (word.isupper(), word))
    counts = np.array([[pairs[truth, answer] for answer in answers] for truth in truths], int)
    return truths, answers, counts.reshape(len(truths), len(answers))


def clopper_pearson(hits: int, count: int, level: float = LEVEL) -> tuple[float, float]:
    """Return the exact interval of a share (Clopper & Pearson, Biometrika 26, 1934).

    Parameters
    ----------
    hits, count : int
        ``count`` is positive.
    level : float
        Both sides have half of what is left.
    """
    tail = 0.5 * (1.0 - level)
    low = stats.beta.ppf(tail, hits, count - hits + 1) if hits else 0.0
    high = stats.beta.ppf(1.0 - tail, hits + 1, count - hits) if hits < count else 1.0
    return float(low), float(high)


def percent(share: float, digits: int = 0) -> str:
    """Return a share as text in per cent."""
    return f"{100.0 * share:.{digits}f} %"


def alarm(row: dict) -> bool:
    """Tell whether something is claimed: every outcome but NULL and UNKNOWN."""
    return row["outcome"] not in SILENT


def right(row: dict) -> bool:
    """Tell whether all that is true is named, and nothing else."""
    return bool(row["named"]) and set(row["named"]) == set(row["truth"])


def wrong(row: dict) -> bool:
    """Tell whether something is named that is not true, or the diagnosis crashed."""
    true = {*row["truth"], *(["body"] if set(row["truth"]) & set(BODIES) else [])}
    return row["outcome"] == "CRASH" or not set(row["named"]) <= true


def shares(rows: dict[str, dict]) -> dict[str, list[bool]]:
    """Return for each name of `TARGETS` yes or no for each case that counts.

    A crash counts as clear, since it leaves no d'.

    Parameters
    ----------
    rows : dict of str to dict
        First answers by case.
    """
    real = [row for name, row in rows.items() if name.startswith("real-")]
    others = in_library_words(rows)
    clear = [row for row in others if row["block"] == "single"
             and ((row.get("length") or 0.0) >= CLEAR or row["outcome"] == "CRASH")]  # fmt: skip
    return {
        "alarms": [alarm(row) for row in others if row["block"] in NULLS],
        "right names": [not wrong(row) for row in others if row["named"]],
        "named": [right(row) for row in clear],
        "wrong outside": [wrong(row) for row in others if row["block"] in OUTSIDE],
        "both": [right(row) for row in others if row["block"] == "two"],
        "real": [right(row) for row in real if row["truth"]],
    }  # fmt: skip


def in_library_words(rows: dict[str, dict]) -> list[dict]:
    """Return the rows whose effects have labels of the library: all but those of the drops."""
    return [row for name, row in rows.items() if not name.startswith("drop-")]


def met(target: Target, hits: list[bool]) -> bool | None:
    """Tell whether a target is met; None while too few cases are answered."""
    if len(hits) < target.least:
        return None
    share = float(np.mean(hits))
    return share <= target.share if target.sign == "≤" else share >= target.share


def power(
    rows: list[dict], key: str = "energy", edges: Sequence[float] = ENERGIES
) -> dict[str, list[tuple[int, int]]]:
    """Return by label how many single effects were named of how many, in classes.

    Parameters
    ----------
    rows : list of dict
    key : str
        ``energy`` or ``length``; rows without it are left out.
    edges : sequence of float
        Of the classes, n + 1.

    Returns
    -------
    dict of str to list of (int, int)
        Rightly named and all, n pairs.
    """
    single = [row for row in rows if row["block"] == "single" and row.get(key) is not None]
    table = {}
    for label in sorted({row["truth"][0] for row in single}):
        own = [row for row in single if row["truth"][0] == label]
        at = np.digitize([row[key] for row in own], edges[1:-1])
        table[label] = [
            (sum(right(row) for row, k in zip(own, at, strict=True) if k == each),
             int(np.sum(at == each)))
            for each in range(len(edges) - 1)
        ]  # fmt: skip
    return table


def with_gains(rows: Iterable[dict]) -> list[dict]:
    """Return the rows of sites with an effect whose answer names effects and predicts by them.

    An answer MISTAKE stops before a model is changed.
    """
    return [row for row in rows if row["truth"] and row["named"] and row["outcome"] != "MISTAKE"
            and row.get("held_out")]  # fmt: skip


def gains(rows: Iterable[dict], key: str = "after") -> list[float]:
    """Return by how much more energy of unseen records a model explains than the calibrated one.

    Of the rows `with_gains` that have that model: ``after`` the diagnosis, with the ``second``
    best effect, or the ``right`` one.
    """
    told = [row["held_out"] for row in with_gains(rows)]
    return [each[key] - each["before"] for each in told if {key, "before"} <= set(each)]
