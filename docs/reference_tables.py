"""Tables of docs/reference: hypotheses and thresholds of a diagnosis, limit curves.

`python -m docs.reference_tables PAGE` writes those of a page anew, `--grounds` that of hypotheses
by ground, too, for which the small site of the tests is meshed on each ground.
"""

import re
import sys
from pathlib import Path

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.thresholds import threshold_rows
from pyblast.files import write_text
from pyblast.signals.comparison import load_limits

AXES = {"receivers": "receivers", "blasts": "blasts", "both": "receivers, blasts"}
PRICES = {"site": "runs", "holes": "none", "motion": "none"}
HYPOTHESES = (
    "| label, form | claim | of each | runs | held out | parameters: prior, range | decided by |"
)
THRESHOLDS = "| threshold | value | unit | meaning | origin |"
CURVES = "| key | curve | judges | from, to Hz | lowest, highest mm/s | entered from |"


def hypotheses() -> str:
    """Return the hypotheses as a table in Markdown, by label."""
    return _table(HYPOTHESES, [_row(LIBRARY[name]) for name in sorted(LIBRARY)])


def thresholds() -> str:
    """Return the thresholds as a table in Markdown, in the order in which they are met."""
    return _table(
        THRESHOLDS,
        [
            f"| `{row.name}` | {row.value:.3g} | {row.unit} | {row.meaning} | {row.measured_on} |"
            for row in threshold_rows()
        ],
    )


def curves() -> str:
    """Return the limit curves as a table in Markdown, by key."""
    rows = []
    for key, curve in sorted(load_limits().items()):
        frequency, limit = curve.corners.T
        ends = f"{min(frequency):g}, {max(frequency):g}" if len(limit) > 1 else "all"
        limits = f"{1e3 * min(limit):.4g}, {1e3 * max(limit):.4g}"
        rows.append(
            f"| `{key}` | {curve.name} | {curve.quantity} | {ends} | {limits} | {curve.source} |"
        )
    return _table(CURVES, rows)


TABLES = {"library": hypotheses, "thresholds": thresholds, "curves": curves}


def grounds() -> str:
    """Return the number of targets of each hypothesis on each ground as a table in Markdown.

    Of those that differ; the others are asked on every ground.
    """
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "cases"))
    from grounds import GROUNDS, case_on  # the small site of the tests

    cases = [case_on(ground) for ground in GROUNDS]
    rows = []
    for name, entry in sorted(LIBRARY.items()):
        cells = [str(len(entry.targets(case)) or "–") for case in cases]
        if "–" in cells:
            rows.append(f"| `{name}` | {' | '.join(cells)} |")
    return _table(f"| hypothesis | {' | '.join(GROUNDS)} |", rows)


def _table(head, rows):
    """Return a table in Markdown."""
    return "\n".join([head, "|---" * (head.count("|") - 1) + "|", *rows])


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


def written(text: str, tables=None) -> str:
    """Return a page with its tables as they are now, between comments with their names."""
    for name, table in (tables or TABLES).items():
        pattern = rf"(?s)<!-- {name} -->.*<!-- end of {name} -->"
        if f"<!-- {name} -->" not in text:
            continue
        made = f"<!-- {name} -->\n{table()}\n<!-- end of {name} -->"
        text = re.sub(pattern, lambda _, made=made: made, text)
    return text


if __name__ == "__main__":
    page = Path(sys.argv[-1])
    asked = TABLES | ({"grounds": grounds} if "--grounds" in sys.argv else {})
    write_text(page, written(page.read_text(encoding="utf-8"), asked))
