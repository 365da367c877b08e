"""Pictures and numbers of docs/quickstart.md, from the results of its commands.

    pyblast run examples/fault_from_records/project.toml --out first
    python -m docs.quickstart_pictures first/001

writes section.png and comparison.png of docs/figures/quickstart and prints the sentence of the
page, which a test compares with a run of its own.
"""

import base64
import sys
from pathlib import Path

from pyblast.project.result import Result, read_result, write_bytes
from pyblast.report import figures

FIGURES = Path(__file__).parent / "figures" / "quickstart"
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
