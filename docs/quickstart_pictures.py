"""Pictures and numbers of docs/quickstart.md, from the results of its commands.

    pyblast run examples/fault_from_records/project.toml --out first
    pyblast backanalyse examples/fault_from_records/project.toml --out search
    python -m docs.quickstart_pictures first/001 search/001

writes section.png, comparison.png and values.png of docs/figures/quickstart and prints the sentence
and the table of the page, which a test compares with runs of its own.
"""

import base64
import json
import sys
from pathlib import Path

from examples.fault_from_records.make_records import KN, KS, RATIO
from pyblast.project.result import Result, read_result, write_bytes
from pyblast.report import figures
from pyblast.report.survey_design import ranges_figure

FIGURES = Path(__file__).parent / "figures" / "quickstart"
TRUTH = {  # of examples/fault_from_records/make_records.py
    "joints.F1.kn_gpa_per_m": KN, "joints.F1.ks_gpa_per_m": KS,
    "materials.limestone.damping.ratio": RATIO,
}  # fmt: skip
NORTH, RECEIVER, TOP = 20.0, "house", 60.0  # m, -, Hz


def sentence(comparison: dict) -> str:
    """Return what the page says of the peaks at the house, from a comparison of the summary."""
    longitudinal, transverse, vertical = (
        f"{100.0 * value:+.0f}" for value in comparison["ppv_deviation"]
    )
    return (
        f"The PPV of the three components is off by {longitudinal}, {transverse} and {vertical} % "
        "in the band that is compared."
    )


def table(search: dict) -> str:
    """Return the table of the page from the result of the search."""
    rows = [
        "| parameter | range | found (90 % interval) | true | constrained |",
        "|---|---|---|---|---|",
    ]
    for row in search["parameters"]:
        path, (low, high) = row["path"], row["within"]
        rows.append(
            f"| `{path}` | {row['low']:g} to {row['high']:g} | {row['best']:.3g} ({low:.3g} to "
            f"{high:.3g}) | {TRUTH[path]:g} | {row['constraint']} |"
        )
    return "\n".join(rows)


def draw_values(search: dict) -> None:
    """Write the values of a search with their intervals, in their ranges."""
    rows = [
        {**row, "value": row["best"], "why": row["unidentifiable"]} for row in search["parameters"]
    ]
    image = ranges_figure({"parameters": rows})
    write_bytes(FIGURES / "values.png", base64.b64decode(image.split(",")[1]))


def draw(result: Result) -> None:
    """Write the section and the comparison of a run of the example."""
    image = figures.section_figure(result, NORTH)
    write_bytes(FIGURES / "section.png", base64.b64decode(image.split(",")[1]))
    both = {kind: result.seismogram(kind, RECEIVER) for kind in ("recorded", "simulated")}
    colours = [figures.RECORDED, figures.SIMULATED]
    figures.draw_motion(both, colours, TOP).savefig(FIGURES / "comparison.png")


if __name__ == "__main__":
    run = read_result(sys.argv[1])
    draw(run)
    sys.stdout.write(f"{sentence(run.summary['comparisons'][RECEIVER])}\n")
    found = json.loads((Path(sys.argv[2]) / "back_analysis.json").read_text(encoding="utf-8"))
    draw_values(found)
    sys.stdout.write(f"{table(found)}\n")
