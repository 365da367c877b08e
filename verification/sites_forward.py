"""Forward runs of sites with real geometry against noise-free records of an independent program.

    python -m verification.sites_forward [FOLDER] [--page] [--again] [--minutes N]

For each site the blasts S1, B2 and H1 (B2's file with H1's hole table), as the project files
believe them. The error of a receiver is the energy of the difference over that of the record, all
components together: in the band in which the project compares (3 to 30 Hz, below which the other
program states its accuracy), and beside it without a filter. Writes the rows that
``verification/sites_forward.json`` lacks and the table of docs/quality/verification.md; ``--page``
writes the table alone.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
import obspy

from pyblast.config.config import Config
from pyblast.files import write_text
from pyblast.project.project import load_project, make_project
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

from .markdown import between
from .rows import each_row, options, read_rows

ROOT = Path(__file__).resolve().parents[1]
SITES = Path(os.environ.get("PYBLAST_SITES", ROOT.parent / "shared" / "sites"))
OUT = Path(__file__).with_suffix(".json")
PAGE = ROOT / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- sites: from verification/sites_forward.json -->", "<!-- end of sites -->"
BLASTS = {"S1": "S1.toml", "B2": "B2.toml", "H1": "B2.toml"}
BEFORE = 0.25  # s, from the start of a record to the zero of its blast


def compared(path, record, holes=None):
    """Return the row of one blast: elements, errors, seconds."""
    began, cpu = time.perf_counter(), time.process_time()
    project = load_project(path)
    if holes is not None:
        blast = project.config.blast.model_copy(update={"file": str(holes)})
        config: Config = project.config.model_copy(update={"blast": blast})
        project = make_project(config, project.path)
    run = simulate(
        project.model, project.duration, prepared=prepare(project.model, project.duration)
    )
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu
    in_band, unfiltered = misfits(run, project, record)
    return {
        "elements": project.meshed.reason,
        "error_median": float(np.median(in_band)),
        "error_worst": float(max(in_band)),
        "band_hz": list(project.config.run.compare_band_hz),
        "unfiltered_median": float(np.median(unfiltered)),
        "unfiltered_worst": float(max(unfiltered)),
        "seconds": seconds,
        "run_s": run.wall_seconds,
        "cpu_seconds": cpu_seconds,
        "nodes": len(project.model.nodes.points),
        "step_s": run.dt,
    }


def misfits(run, project, file):
    """Return energies of differences over those of records, by receiver: in band, in all.

    Records go through the low-pass of what enters.
    """
    stream, errors = obspy.read(str(file), format="MSEED"), []
    lead, band = project.lead, project.config.run.compare_band_hz
    for name, simulated in run.seismograms.items():
        traces = {t.stats.channel[-1]: t for t in stream if t.stats.station == name}
        if not traces:
            continue
        data = np.column_stack([traces[axis].data.astype(float) for axis in "ENZ"])
        record = Seismogram(data, traces["E"].stats.delta, -BEFORE)
        wanted = record.filtered_like(project.shot.low_pass).velocity.T
        times = traces["E"].stats.delta * np.arange(wanted.shape[1]) - BEFORE
        own = simulated.start - lead + simulated.dt * np.arange(len(simulated.velocity))
        within = times <= own[-1]
        got = np.array([np.interp(times, own, column, left=0.0) for column in simulated.velocity.T])
        power = [
            np.abs(np.fft.rfft(motion[:, within], axis=1)) ** 2 for motion in (got - wanted, wanted)
        ]
        frequency = np.fft.rfftfreq(int(within.sum()), traces["E"].stats.delta)
        inside = (frequency >= band[0]) & (frequency <= band[1])
        errors.append(
            [
                float(power[0][:, part].sum() / power[1][:, part].sum())
                for part in (inside, slice(None))
            ]
        )
    return np.array(errors).T


def in_order(rows):
    """Return rows by site, and by blast as they are run."""
    by_blast = list(BLASTS)
    names = sorted(rows, key=lambda name: (name.split("/")[0], by_blast.index(name.split("/")[1])))
    return {name: rows[name] for name in names}


def table(rows):
    """Return the lines of the table of the page."""
    median = 100.0 * np.median([row["error_median"] for row in rows.values()])
    worst = 100.0 * max(row["error_worst"] for row in rows.values())
    return [
        f"{len(rows)} blasts; in band: median of the medians {median:.2g} %, worst receiver "
        f"{worst:.2g} %.",
        "",
        "| blast | zones | nodes | in band: median %, worst % | unfiltered: the same | CPU s |",
        "|---|---|---|---|---|---|",
        *(
            f"| {name} | {row['elements'].split(', ')[0]} "
            f"| {row['nodes']} | {100 * row['error_median']:.2g}, {100 * row['error_worst']:.2g} "
            f"| {100 * row['unfiltered_median']:.2g}, {100 * row['unfiltered_worst']:.2g} "
            f"| {row['cpu_seconds']:.0f} |"
            for name, row in rows.items()
        ),
    ]


def paged(page, rows):
    """Return the page with the table of some rows."""
    return between(page, (BEGIN, END), table(in_order(rows)))


def measured(folder, name):
    """Return the row of a blast, such as "case-01/H1", of the sites in a folder."""
    site, blast = name.split("/")
    truth = folder / "truth" / site
    holes = truth / "H1_holes.csv" if blast == "H1" else None
    return compared(folder / site / BLASTS[blast], truth / f"believed_{blast}.mseed", holes)


def main(arguments):
    """Run what is missing and write the page."""
    arguments, limits = options(arguments)
    folders = [a for a in arguments if a != "--page"]
    folder = Path(folders[0]) if folders else SITES
    if "--page" in arguments:
        rows = read_rows(OUT)
    elif not folder.is_dir():
        sys.exit(f"sites_forward: no folder {folder}")
    else:
        sites = sorted(site.name for site in folder.glob("case-*"))
        names = [f"{site}/{blast}" for blast in BLASTS for site in sites]
        rows = each_row(OUT, names, lambda name: measured(folder, name), **limits)
    write_text(PAGE, paged(PAGE.read_text(), rows))


if __name__ == "__main__":
    main(sys.argv[1:])
