"""Scores over many cases: shares with their bounds, tables by family and by length of effects."""

import numpy as np
from scipy import stats

from .plan import FAMILY, NULLS
from .rows import VISIBLE

CLEAR = 8.0  # d' from which an effect must be found
STRATA = ((0.0, 4.0), (4.0, 8.0), (8.0, 20.0), (20.0, np.inf))
DRAWS = 1000
BINS = 10
QUANTILES = 0.5, 0.9, 0.95, 1.0


def shares(hits, seed=0) -> dict:
    """Return a share of cases with its 90 % bootstrap interval and its 95 % upper bound.

    Parameters
    ----------
    hits : sequence of bool or float
    seed : int

    Returns
    -------
    dict
        ``n``, ``share``, ``low``, ``high``; ``bound`` is one-sided, exact, of yes and no alone.
    """
    values = np.array(hits, dtype=float)
    n = len(values)
    if not n:
        return {"n": 0, "share": None, "low": None, "high": None, "bound": None}
    drawn = np.random.default_rng(seed).choice(values, (DRAWS, n)).mean(axis=1)
    low, high = np.quantile(drawn, [0.05, 0.95])
    bound = None
    if set(values.tolist()) <= {0.0, 1.0}:
        count = int(values.sum())
        bound = 1.0 if count == n else float(stats.beta.ppf(0.95, count + 1, n - count))
    return {"n": n, "share": float(values.mean()), "low": float(low), "high": float(high),
            "bound": bound}  # fmt: skip


def medians(values, seed=0) -> dict:
    """Return a median with its 90 % bootstrap interval."""
    values = np.array([value for value in values if value is not None], dtype=float)
    if not len(values):
        return {"n": 0, "median": None, "low": None, "high": None}
    drawn = np.random.default_rng(seed).choice(values, (DRAWS, len(values)))
    low, high = np.quantile(np.median(drawn, axis=1), [0.05, 0.95])
    return {"n": len(values), "median": float(np.median(values)), "low": float(low),
            "high": float(high)}  # fmt: skip


def scores(rows: list[dict]) -> dict:
    """Return all scores of a benchmark.

    Parameters
    ----------
    rows : list of dict
        As of `row_of`.
    """
    nulls, hard = (_block(rows, block) for block in NULLS)
    single, two = _block(rows, "single"), _block(rows, "two")
    outside, poor = _block(rows, "out of library"), _block(rows, "poor")
    clear = _clear(rows)
    unseen = [row for row in single if (row["length"] or 0.0) < VISIBLE]
    named = [row for row in rows if row["named"]]
    found = [row for row in clear if row["some"]]
    return {
        "cases": len(rows), "crashes": sum(row["outcome"] == "CRASH" for row in rows),
        "false alarm": shares([row["alarm"] for row in nulls]),
        "false alarm, hard": shares([row["alarm"] for row in hard]),
        "false alarm, invisible": shares([row["alarm"] for row in unseen]),
        "null leaves": _spread([row["worst"] for row in nulls]),
        "null said NULL": shares([row["outcome"] == "NULL" for row in nulls]),
        "precision when named": shares([row["right_name"] for row in named]),
        "top-1": shares([row["all"] for row in clear]),
        "top-2": shares([row["held"] for row in clear]),
        "first in rank": shares([row["ranked"] for row in clear]),
        "family": shares([row["family"] for row in clear]),
        "two: some": shares([row["right_name"] for row in two]),
        "two: both": shares([row["all"] for row in two]),
        "outside: unknown or partial": shares(
            [row["outcome"] in ("UNKNOWN", "PARTIAL") for row in outside]
        ),
        "outside: not named wrongly": shares([not row["alarm"] for row in outside]),
        "poor: nothing named wrongly": shares(
            [row["outcome"] != "CRASH" and (not row["named"] or row["right_name"]) for row in poor]
        ),
        "located": shares([row["located"] for row in found if row["located"] is not None]),
        "planes off, m": medians([row["metres"] for row in rows]),
        "90 % intervals hold": shares([np.mean(r["covered"]) for r in found if r["covered"]]),
        "gain": medians([row["gain"] for row in clear]),
        "Brier": _mean([row["brier"] for row in rows]),
        "calibration error": calibration_error(rows),
        "cpu_s": medians([row["cpu_s"] for row in rows]),
        "runs": medians([row["runs"] for row in rows]),
        "by label": {label: _by_label(rows, label) for label in FAMILY},
        "by length": [
            {"from": low, "to": high if np.isfinite(high) else None,
             **_short([r for r in single if low <= (r["length"] or 0.0) < high])}
            for low, high in STRATA
        ],
        "curve": risk_curve([r for r in rows if r["lead"] is not None and r["lead"] >= 0.0]),
    }  # fmt: skip


def by_program(rows: list[dict]) -> list[dict]:
    """Return the main counts of the answers of each program, in the order of their cases."""
    return [_counts([row for row in rows if row["code"] == code])
            for code in dict.fromkeys(row["code"] for row in rows)]  # fmt: skip


def _counts(rows):
    """Return the counts that the targets are about."""
    nulls = [row for row in rows if row["block"] in NULLS]
    named = [row for row in rows if row["named"]]
    clear = _clear(rows)
    return {
        "first": rows[0]["case"], "last": rows[-1]["case"], "cases": len(rows),
        "nulls": len(nulls), "alarms": sum(row["alarm"] for row in nulls),
        "named": len(named), "right": sum(row["right_name"] for row in named),
        "clear": len(clear), "found": sum(row["all"] for row in clear),
    }  # fmt: skip


def calibration_error(rows) -> float | None:
    """Return the mean gap between probability and share of right answers, over ten bins."""
    some = [r for r in rows if r["confidence"] is not None and r["sure_right"] is not None]
    if not some:
        return None
    sure = np.array([row["confidence"] for row in some])
    right = np.array([row["sure_right"] for row in some], dtype=float)
    bins = np.minimum((sure * BINS).astype(int), BINS - 1)
    gaps = [
        np.sum(bins == b) * abs(sure[bins == b].mean() - right[bins == b].mean())
        for b in np.unique(bins)
    ]
    return float(np.sum(gaps) / len(some))


def risk_curve(rows) -> list[dict]:
    """Return how many answers are wrong as those with less lead over chance are kept back.

    Parameters
    ----------
    rows : list of dict
        In which the search had a best effect.

    Returns
    -------
    list of dict
        ``coverage``: share of the rows that are answered; ``risk``: share of these whose best
        effect is not true; ``lead`` in nats of the last that is answered.
    """
    ordered = sorted(rows, key=lambda row: -row["lead"])
    wrong = np.cumsum([not row["leader_right"] for row in ordered])
    return [
        {"coverage": (k + 1) / len(ordered), "risk": float(wrong[k] / (k + 1)), "lead": row["lead"]}
        for k, row in enumerate(ordered)
    ]


def _by_label(rows, label):
    """Return the scores of single effects of one label, and how it was misused."""
    here = [row for row in _block(rows, "single") if row["true"] == [label]]
    clear = _clear(here)
    wrongly = sum(label in row["named"] and label not in row["true"] for row in rows)
    return {"family": FAMILY[label], "cases": len(here), "wrongly named": wrongly,
            "clear": _short(clear), "gain": medians([row["gain"] for row in clear])}  # fmt: skip


def _short(rows):
    """Return counts of single effects."""
    return {
        "n": len(rows), "named": sum(bool(row["named"]) for row in rows),
        "right": sum(row["all"] for row in rows), "held": sum(row["held"] for row in rows),
        "family right": sum(row["family"] for row in rows),
        "silent": sum(row["outcome"] == "NULL" for row in rows),
    }  # fmt: skip


def _block(rows, block):
    """Return the rows of a block."""
    return [row for row in rows if row["block"] == block]


def _clear(rows):
    """Return the rows of single effects that must be found."""
    return [row for row in _block(rows, "single") if (row["length"] or 0.0) >= CLEAR]


def _spread(values):
    """Return quantiles of what is there."""
    values = [value for value in values if value is not None]
    each = np.quantile(values, QUANTILES) if values else [None] * len(QUANTILES)
    return {"n": len(values), **dict(zip(map(str, QUANTILES), each, strict=True))}


def _mean(values):
    """Return the mean of what is there, or None."""
    values = [value for value in values if value is not None]
    return float(np.mean(values)) if values else None
