"""Numbers and pictures of docs/quickstart.md, from the results of its commands.

`./dev docs --check` runs these commands and compares; `--write` writes them anew.
"""

import base64
import io
import json
import re
from pathlib import Path

from examples.fault_from_records.make_records import KN, KS, RATIO
from pyblast.diagnosis.summary import diagnosis_lines
from pyblast.project.result import Result, read_result
from pyblast.report import figures
from pyblast.report.survey_design import ranges_figure

TRUTH = {  # of examples/fault_from_records/make_records.py
    "joints.F1.kn_gpa_per_m": KN, "joints.F1.ks_gpa_per_m": KS,
    "materials.limestone.damping.ratio": RATIO,
}  # fmt: skip
RECEIVER, TOP = "house", 60.0  # -, Hz
CLOSED = 0.6  # of examples/04_hidden_closure.py


def sentence(summary: dict) -> str:
    """Return what the page says of the peaks at the house, from the summary of a run."""
    compared = summary["comparisons"][RECEIVER]
    parts = [
        f"{100.0 * value:+.0f} % ({name})"
        for name, value in zip(compared["components"], compared["ppv_deviation"], strict=True)
    ]
    return f"The simulated PPV differs by {parts[0]}, {parts[1]} and {parts[2]}."


def table(search: dict) -> str:
    """Return the table of the page from the result of the search, and what it cost."""
    rows = [
        f"After {search['runs']} runs, {100.0 * search['fit']['remaining']:.2g} % of the energy of "
        "the records is not explained:",
        "",
        "| parameter | range | best (90 % interval) | true | constrained |",
        "|---|---|---|---|---|",
    ]
    for row in search["parameters"]:
        path, (low, high) = row["path"], row["within"]
        rows.append(
            f"| `{path}` | {row['low']:g} to {row['high']:g} | {row['best']:.3g} ({low:.3g} to "
            f"{high:.3g}) | {TRUTH[path]:g} | {row['constraint']} |"
        )
    return "\n".join(rows)


def named(diagnosis: dict) -> str:
    """Return what the page says of the diagnosis: what it printed, and the value of the effect."""
    printed = [line for line in diagnosis_lines(diagnosis) if not line.startswith("  next:")]
    closed = diagnosis["effects"][0]["parameters"]["closed"]
    return "\n".join(
        [
            *(f"    {line}" for line in printed),
            "",
            f"The joint is closed by {closed['value']:.2g} of its largest closure (90 % interval "
            f"{closed['low']:.2g} to {closed['high']:.2g}); {CLOSED:g} is true.",
        ]
    )


def pictures(run: Result, search: dict, folder: Path) -> dict[str, bytes]:
    """Return the pictures of the page as PNG by name, of run, search and pages."""
    both = {kind: run.seismogram(kind, RECEIVER) for kind in ("recorded", "simulated")}
    motion = io.BytesIO()
    figures.draw_motion(both, [figures.RECORDED, figures.SIMULATED], TOP).savefig(motion)
    ranges = [
        {**row, "value": row["best"], "why": row["unidentifiable"]} for row in search["parameters"]
    ]
    first, found = (
        (folder / name / "001" / "report.html").read_text("utf-8") for name in ("first", "found")
    )
    return {
        "section": image_of(first, "Section"),
        "comparison": motion.getvalue(),
        "values": _bytes(ranges_figure({"parameters": ranges})),
        "residuals": image_of(found, "In plan and section"),
        "held_out": image_of(found, "Blast B2 held out"),
    }


def image_of(report: str, title: str) -> bytes:
    """Return a figure of the text of a page by its title."""
    return _bytes(re.findall(rf'<img alt="{re.escape(title)}"[^>]*? src="([^"]+)"', report)[0])


def _bytes(image):
    """Return the content of a data URI."""
    return base64.b64decode(image.split(",")[1])


def results(folder: Path) -> tuple[Result, dict, dict]:
    """Return run, search and diagnosis from where the commands of the page left them."""
    run = read_result(folder / "first" / "001")
    search = json.loads((folder / "search" / "001" / "back_analysis.json").read_text("utf-8"))
    return run, search, json.loads((folder / "found/001/diagnosis.json").read_text("utf-8"))
