"""Plots of pages as data: axes, lines, dots and segments that plots.js draws, and their tables.

A plot is ``{"alt": words, "columns": n, "panels": [...]}`` of plain numbers and text. The script of
the page draws it as SVG with values under the pointer; without the script a table says the same.
"""

import math

import numpy as np

from ..files import plain
from ..units import plain_number

INK, RECORDED, SIMULATED, FAULT = "#2b2b2b", "#2b2b2b", "#c2410c", "#b91c1c"
MOST_POINTS = 800  # of a line in a page
MOST_ROWS = 24  # of a line in a table
DIGITS = 5  # of a value in a page


def axis_of(label, low=None, high=None, *, log=False, ticks=None) -> dict:
    """Return an axis of a plot.

    Parameters
    ----------
    label : str
        Quantity with its unit in brackets.
    low, high : float, optional
        Its ends; by default those of what is drawn.
    log : bool
    ticks : dict of float to str, optional
        Places with a name, such as those of categories.
    """
    places = None if ticks is None else [[at, name] for at, name in ticks.items()]
    return plain({"label": label, "low": low, "high": high, "log": log, "ticks": places})


def line(x, y, name=None, colour="#2b2b2b", **style) -> dict:
    """Return a line; a long one keeps least and greatest of each interval.

    Parameters
    ----------
    x, y : (n,) float
        In the units of the axes; no point where either is not finite.
    name : str, optional
        In the legend.
    colour : str
    **style
        ``width`` in px, ``opacity``, ``dash`` and ``fill`` (down to the axis), bool.
    """
    x, y = (np.asarray(values, dtype=float) for values in (x, y))
    if len(x) > MOST_POINTS:
        chosen = np.unique([0, *_ends(y, -(-2 * len(x) // MOST_POINTS)), len(x) - 1])
        x, y = x[chosen], y[chosen]
    return _mark("line", name, colour, {"x": x, "y": y}, style)


def _ends(y, step):
    """Return where least and greatest of each interval of at most ``step`` values stand."""
    count = -(-len(y) // step)
    size, longer = divmod(len(y), count)  # the first intervals are longer by one
    at, ends = longer * (size + 1), []
    for first, part in ((0, y[:at].reshape(longer, size + 1)), (at, y[at:].reshape(-1, size))):
        start = first + part.shape[1] * np.arange(len(part))
        ends += [start + part.argmin(axis=1), start + part.argmax(axis=1)]
    return np.concatenate(ends)


def dots(x, y, name=None, colour="#2b2b2b", **style) -> dict:
    """Return dots.

    Parameters
    ----------
    x, y : (n,) float
    name : str, optional
    colour : str
    **style
        ``radius`` in px; ``text``, one beside each; ``values``, coloured by the panel's scale;
        ``ring`` and ``quiet`` (no text drawn, only under the pointer), bool.
    """
    return _mark("dots", name, colour, {"x": x, "y": y}, style)


def segments(x, y, to_x, to_y, name=None, colour="#2b2b2b", **style) -> dict:
    """Return segments with blunt ends: bars, intervals, limits.

    Parameters
    ----------
    x, y, to_x, to_y : (n,) float
    name : str, optional
    colour : str
    **style
        ``width`` in px, ``opacity``, ``text`` at the end of each.
    """
    return _mark("segments", name, colour, {"x": x, "y": y, "to_x": to_x, "to_y": to_y}, style)


def _mark(kind, name, colour, places, style):
    """Return a mark with rounded values."""
    rounded = {key: _rounded(values) for key, values in places.items()}
    if "values" in style:
        style["values"] = _rounded(style["values"])
    return plain({"kind": kind, "name": name, "colour": colour, **rounded, **style})


def _rounded(values):
    """Return values with some digits, None where they are not finite."""
    return [
        float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None
        for value in np.atleast_1d(np.asarray(values, dtype=float)).tolist()
    ]


def panel(x, y, marks, height=300, *, share=1.0, equal=False, scale=None) -> dict:
    """Return a panel of a plot.

    Parameters
    ----------
    x, y : dict
        Of `axis`.
    marks : sequence of dict
        Of `line`, `dots`, `segments`, drawn in this order.
    height : int, px
    share : float
        Of the width of its row, relative to the panels beside it.
    equal : bool
        Whether both axes have one scale, as in a map.
    scale : dict, optional
        ``label``, ``low``, ``high`` and ``colours`` ("viridis", "greys", "darker") of dots with
        values.
    """
    return {"x": x, "y": y, "marks": list(marks), "height": height, "share": share,
            "equal": equal, "scale": plain(scale)}  # fmt: skip


def page_plot(alt, *panels, columns=1) -> dict:
    """Return a plot of panels, and the words for those who don't see it."""
    return {"alt": alt, "columns": columns, "panels": list(panels)}


def tables(drawn) -> list[dict]:
    """Return the content of a plot as tables, one a panel: heads and rows of text.

    Lines of more than 24 points show their largest value and every so many of the others.
    """
    shown = []
    for part in drawn["panels"]:
        heads = ["", part["x"]["label"], part["y"]["label"]]
        marks = [mark for mark in part["marks"] if mark["x"]]
        if any("to_x" in mark for mark in marks):
            heads.append("to")
        if any("values" in mark for mark in marks):
            heads.append(part["scale"]["label"])
        rows = [row for mark in marks for row in _rows(part, mark, heads)]
        if rows:
            shown.append({"heads": heads, "rows": rows})
    return shown


def _rows(part, mark, heads):
    """Yield the rows of a mark: name, place, and what the heads after them ask for."""
    chosen = _chosen(mark["y"]) if mark["kind"] == "line" else range(len(mark["x"]))
    for k in chosen:
        text = mark["text"][k] if mark.get("text") else None
        row = [": ".join(word for word in (mark["name"], text) if word)]
        row += [_said(part[name], mark[name][k]) for name in ("x", "y")]
        if "to" in heads:
            ends = [(n, mark[f"to_{n}"][k]) for n in "xy" if "to_x" in mark]
            row.append(", ".join(_said(part[n], at) for n, at in ends if at != mark[n][k]))
        if len(row) < len(heads):
            row.append(plain_number(mark["values"][k]) if "values" in mark else "")
        yield row


def _chosen(values):
    """Return which points of a line a table shows."""
    known = [k for k, value in enumerate(values) if value is not None]
    if len(known) <= MOST_ROWS:
        return known
    largest = max(known, key=lambda k: abs(values[k]))
    even = [known[k] for k in np.linspace(0, len(known) - 1, MOST_ROWS - 1).astype(int).tolist()]
    return sorted({*even, largest})


def _said(along, value):
    """Return a value of an axis in words: its name if it has one."""
    if value is None:
        return "–"
    named = {at: name for at, name in along["ticks"] or ()}
    return named.get(value) or plain_number(value, DIGITS)
