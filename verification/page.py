"""The table of all cases in docs/quality/verification.md, and a figure for each case."""

from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from .markdown import reflow
from .rows import program
from .suite import SMALLEST, small

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures" / "verification"
PAGE = ROOT / "docs" / "quality" / "verification.md"
BEGIN = "<!-- suite: from verification/results.json -->"
END = "<!-- end of suite -->"
DEFECTS = "<!-- defects: from verification/mutants.json -->", "<!-- end of defects -->"
MOST_CURVES = 3
FAILS = '<span class="fails">✗</span>'
OLD, WEEK = "†", timedelta(days=7)


def by_number(name):
    """Sort 1 to 36, then L1 to L12."""
    return (name.startswith("L"), int(name.lstrip("L")))


def draw(name, result, curves):
    """Draw what was expected and measured on the last mesh, and error against mesh."""
    rows = [r for r in result.get("quantities", ()) if len(r["error"]) > 1]
    shown = curves[:MOST_CURVES]
    count = len(shown) + bool(rows)
    if not count:
        return
    figure, axes = plt.subplots(1, count, figsize=(4.0 * count, 3.2), layout="constrained",
                                squeeze=False)  # fmt: skip
    for axis, curve in zip(axes[0], shown, strict=False):
        few = len(curve.x) <= 40
        axis.plot(curve.x, curve.expected, "k-", lw=2.2, alpha=0.45, label="expected")
        axis.plot(curve.x, curve.measured, "C3o" if few else "C3-", ms=4, lw=0.9, label="measured")
        axis.set_title(curve.label, fontsize=8)
        axis.set_xlabel(curve.x_label, fontsize=8)
        axis.set_ylabel(curve.y_label, fontsize=8)
        axis.legend(fontsize=7)
        axis.tick_params(labelsize=7)
    if rows:
        _draw_errors(axes[0, -1], result, rows)
    FIGURES.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURES / f"{name}.png", dpi=80)
    plt.close(figure)


def _draw_errors(axis, result, rows):
    """Draw errors against the mesh, with their tolerances."""
    for number, row in enumerate(rows[:8]):
        errors = np.maximum(np.abs(row["error"]), 1e-16)
        axis.loglog(result["meshes"], errors, f"C{number}o-", ms=3, lw=1.0, label=row["quantity"])
        axis.axhline(row["tolerance"], color=f"C{number}", lw=0.6, ls=":")
    axis.set_xlabel(result["unit"], fontsize=8)
    axis.set_ylabel("error; dotted: tolerance", fontsize=8)
    axis.legend(fontsize=5)
    axis.tick_params(labelsize=7)


def write_table(results, problems):
    """Put the table of all cases between its two marks in the page."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    names = sorted({*problems, *results}, key=by_number)
    passed = sum(bool(results.get(n, {}).get("pass")) for n in names)
    as_asked = sum(bool(results.get(n, {}).get("as_asked")) for n in names)
    today = datetime.now(UTC).date()
    lines = [
        f"{as_asked} of {len(names)} cases meet the tolerance asked of them on the mesh asked for; "
        f"{passed} meet their tolerance on the finest mesh of their study. {FAILS} marks a "
        "quantity whose last error exceeds its tolerance, or whose order is below the minimum "
        "given after it (≥). Small: every error is below a tenth of the tolerance or "
        f"{SMALLEST:g}, so no order is judged; not judged: the case exempts the quantity. Gates: "
        "R blocks a release, E is required for the diagnosis, C for a claim.",
        "",
        f"Written on {today} for program {program()}. Column *of*: when and with which program "
        f"the case was measured; {OLD} marks another program, a date more than {WEEK.days} days "
        "earlier, or neither known.",
        "",
        "| case | problem | gate | of | quantity | error on each mesh | order | tolerance | |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        lines += _rows(name, results[name], today) if name in results else [
            f"| {name} | {problems[name]} | | | not built | | | | – |"
        ]  # fmt: skip
    lines += ["", "### Asked and judged", "", *_asked_table(names, results)]
    notes = [f"- **{n}** {results[n]['note']}" for n in names if results.get(n, {}).get("note")]
    lines += ["", "### Notes", "", *notes, "", "### Figures", ""]
    lines += [
        f"**{n}** {results[n]['title']} ({results[n]['source']})\n\n"
        f"![case {n}](../figures/verification/{n}.png)\n"
        for n in names
        if n in results and (FIGURES / f"{n}.png").is_file()
    ]
    page = before + BEGIN + "\n\n" + "\n".join(lines) + "\n" + END + after
    PAGE.write_text(reflow(page), encoding="utf-8")


def write_defects(tried, count):
    """Put what became of the defects that were tried, of ``count``, into the page."""
    text = PAGE.read_text(encoding="utf-8")
    before, rest = text.split(DEFECTS[0])
    after = rest.split(DEFECTS[1])[1]
    survivors = [f"{one['name']} (`{one['file']}`)" for one in tried if not one["caught_by"]]
    lines = [f"{len(tried)} of {count} defects were tried; tests caught all but {len(survivors)}."]
    lines += ["", "Survivors:", "", *(f"- {one}" for one in survivors)] if survivors else []
    page = before + DEFECTS[0] + "\n\n" + "\n".join(lines) + "\n\n" + DEFECTS[1] + after
    PAGE.write_text(reflow(page), encoding="utf-8")


def _rows(name, result, today):
    """Return the lines of one case."""
    of = _measured(result, today)
    if "failure" in result:
        head = f"| {name} | {result['title']} | {result['gate']} | {of}"
        return [f"{head} | {result['failure']} | | | | {FAILS} |"]
    lines = []
    meshes = ", ".join(f"{mesh:g}" for mesh in result["meshes"])
    title = f"{result['title']}" + (f" ({meshes} {result['unit']})" if meshes else "")
    for row in result["quantities"]:
        bounds = row["tolerance"], small(row["tolerance"])
        errors = ", ".join(shown(error, *bounds) for error in row["error"])
        mark = "✓" if row["pass"] else FAILS
        quantity = row["quantity"].replace("|", r"\|")
        head = f"| {name} | {title} | {result['gate']} | {of}" if not lines else "| | | | "
        lines.append(
            f"{head} | {quantity} | {errors} | {_order(row)} | {row['tolerance']:g} | {mark} |"
        )
    return lines


def _measured(result, today):
    """Return when and of which program a case was measured, with a mark if that is old."""
    return f"{result.get('date', '')} {result.get('program', '')} {old(result, today)}".strip()


def old(row, today=None):
    """Return a mark if a row is of another program, more than a week old, or says neither."""
    today = today or datetime.now(UTC).date()
    fresh = "date" in row and today - date.fromisoformat(row["date"]) <= WEEK
    return "" if fresh and row["program"] == program() else OLD


def _order(row):
    """Return an observed order beside the least one, or why none is judged."""
    order, least = row["order"], row["least_order"]
    found = "none" if order is None else f"{order:.1f}"
    if least is None:
        return f"{found}, {row['unordered']}" if row["unordered"] else ""
    if order is not None:
        found = shown(order, least, sign="")
    return f"{found} ≥ {least:g}"


def shown(value, *bounds, sign="+"):
    """Return a number in two digits, or as many as leave it on its side of each bound.

    >>> shown(0.0504, 0.05), shown(-0.0504, 0.5)
    ('+0.0504', '-0.05')
    """
    sides = [abs(value) <= bound for bound in bounds]
    for digits in range(2, 18):
        text = f"{value:{sign}.{digits}g}"
        if [abs(float(text)) <= bound for bound in bounds] == sides:
            break
    return text


def _asked_table(names, results):
    """Return the lines of the table of what was asked, what it is judged by, and why."""
    lines = [
        "*Asked* is what the verification plan, set before the measurement, asks for: a "
        "tolerance on a mesh, or on the finest mesh of the study where it names none. *Judged* "
        "is what the study uses, in the table above. *Met from* is the coarsest mesh from which "
        f"on the tolerance asked for is met. {FAILS} marks an error on the mesh asked for that "
        "exceeds that tolerance; *lacking* is the mesh that would meet it at the observed order, "
        "or by how much it is missed.",
        "",
        "| case | quantity | asked | error there | judged | met from | | lacking |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        result = results.get(name, {})
        for row in result.get("quantities", ()):
            lines.append(_asked_row(name, row))
        for missing in result.get("not_measured", ()):
            lines.append(f"| {name} | {missing} | asked | not measured | – | – | {FAILS} | |")
    return lines


def _asked_row(name, row):
    """Return the line of one quantity."""
    quantity, asked = row["quantity"].replace("|", r"\|"), row["asked"]
    judged = _on(row["judged"])
    if asked is None:
        return f"| {name} | {quantity} | – | | {judged} | | | {row['reason']} |"
    mesh = "no mesh" if len(row["error"]) < 2 else asked["met_on"]
    met = mesh if isinstance(mesh, str) else "none" if mesh is None else f"{mesh:g}"
    mark = "✓" if row["as_asked"] else FAILS
    error = shown(asked["error"], asked["tolerance"])
    return (
        f"| {name} | {quantity} | {_on(asked)} | {error} | {judged} | {met} | {mark} "
        f"| {row['reason']} |"
    )


def _on(limit):
    """Return a tolerance and its mesh in words."""
    mesh = "" if limit["mesh"] is None else f" at {limit['mesh']:g}"
    return f"{limit['tolerance']:g}{mesh}"
