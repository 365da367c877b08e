"""The table of docs/reference/hypotheses.md: what the library of a diagnosis holds."""

import sys
from pathlib import Path

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.project.result import write_text

BEGIN, END = "<!-- library -->", "<!-- end of library -->"
AXES = {"receivers": "receivers", "blasts": "blasts", "both": "receivers, blasts"}
PRICES = {"site": "runs", "holes": "none", "motion": "none"}
HEAD = "| label, form | claim | of each | runs | held out | parameters: prior, range | decided by |"


def table() -> str:
    """Return the hypotheses as a table in Markdown, by label."""
    rows = [_row(LIBRARY[name]) for name in sorted(LIBRARY)]
    return "\n".join([HEAD, "|---" * (HEAD.count("|") - 1) + "|", *rows])


def _row(one):
    """Return the row of one hypothesis."""
    label = f"`{one.label}`" + (f", {one.form}" if one.form else "")
    parameters = "; ".join(_parameter(each) for each in one.parameters)
    axis = AXES[one.axis]
    cells = label, one.claim, one.target, PRICES[one.on], axis, parameters, one.decided_by
    return f"| {' | '.join(cells)} |"


def _parameter(one):
    """Return a parameter with its prior and its bounds."""
    unit = f" {one.unit}" if one.unit else ""
    doubt = f"×/÷ {2.718281828**one.sigma:.2g}" if one.log else f"± {one.sigma:g}"
    each = " of each hole" if one.per_hole else ""
    return f"{one.name}{each} {one.mean:g} {doubt}{unit}, {one.low:g} to {one.high:g}"


def written(text: str) -> str:
    """Return the page with the table as it is now."""
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


if __name__ == "__main__":
    page = Path(sys.argv[1])
    write_text(page, written(page.read_text(encoding="utf-8")))
