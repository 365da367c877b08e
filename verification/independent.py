"""Sites recorded by an independent program, simulated with and without what they conceal.

    python -m verification.independent [FOLDER OF CASES] [--again] [--minutes N]

Three models of each site: as it is believed; believed, with the physics that its truth file
names; and with the true nuisances as well (velocities, stiffnesses, places, times), where only
method and mesh differ. Rows that ``verification/independent.json`` has already are kept, so a
study that was stopped goes on.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from benchmarks.blind.flat_models import Discretization, flat_box, flat_mesh, flat_model
from pyblast.signals.comparison import compare
from pyblast.solver.run import simulate

from .independent_cases import (
    air_blasts,
    case_project,
    effects_of,
    true_site,
    truth_of,
    with_effect,
    with_open_ground,
)
from .rows import each_row, options

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "verification" / "independent.json"
PAGE = ROOT / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- cases: from verification/independent.json -->", "<!-- end of cases -->"
FIGURE = ROOT / "docs" / "figures" / "independent.png"
BLASTS = {
    "case-11": ("S1", "B2"),
    "case-10": ("S1", "B2"),
    "case-01": ("S1",),
    "case-05": ("B2",),
    "case-06": ("B2",),
    "case-08": ("B2",),
    "case-12": ("S1", "B2"),
}
EDGES = (12.0, 8.0, 5.5)
MODELS = ("believed", "effect", "true")
LABELS = {"believed": "reference"}
DURATION = 1.2


def site_of(cases, case, model):
    """Return a site as one of `MODELS` has it."""
    site = case_project(cases, case)
    truth = truth_of(cases, site)
    if model == "true":
        site = true_site(cases, site)
    return site if model == "believed" else with_effect(site, truth)


def measured(site, blast, edge, air=()):
    """Run one blast on one mesh, with air blasts; return a row of results and the seismograms."""
    cut = Discretization(edge)
    mesh = with_open_ground(flat_mesh(flat_box(site), cut), flat_box(site).box)
    model = flat_model(site, blast, cut, mesh)
    done = simulate(replace(model, sources=(*model.sources, *air)), DURATION)
    misfits = {
        name: compare(
            recording.seismogram, done.seismograms[name], site.config.band_hz, time_frequency=False
        ).total_waveform_misfit
        for name, recording in site.of(blast).records.items()
    }
    row = {
        "median": float(np.median(list(misfits.values()))),
        "per_receiver": {name: round(value, 5) for name, value in misfits.items()},
        "zones": len(done.prepared.constants["zone_row"]),
        "steps": done.prepared.n_steps,
        "wall_s": round(done.wall_seconds, 1),
        "balance_error": done.balance_error,
    }
    return row, done.seismograms


def planned(cases):
    """List what the study consists of."""
    for case, blasts in BLASTS.items():
        effects = effects_of(truth_of(cases, case_project(cases, case)))
        for blast in blasts:
            for model in MODELS:
                if model == "effect" and not effects:
                    continue
                for edge in EDGES:
                    yield {"case": case, "blast": blast, "model": model, "edge_m": edge}


def study(cases, limits):
    """Run what is missing; return all rows."""
    jobs = {", ".join(map(str, what.values())): what for what in planned(cases)}
    return list(each_row(OUT, jobs, lambda name: compared(cases, jobs[name]), **limits).values())


def compared(cases, what):
    """Return the row of a case, blast, model and edge."""
    site = site_of(cases, what["case"], what["model"])
    truth = truth_of(cases, site)
    air = () if what["model"] == "believed" else air_blasts(site, what["blast"], truth)
    row, _ = measured(site, what["blast"], what["edge_m"], air)
    return {
        **what, "effects": effects_of(truth), **row,
        "independent_believed": truth["misfit_believed"][what["blast"]]["median"],
        "noise_alone": truth["misfit_floor_true_no_noise"][what["blast"]]["median"],
    }  # fmt: skip


def draw(rows, path):
    """Draw misfit against edge for every case."""
    figure, axes = plt.subplots(2, 5, figsize=(17, 6.5), sharex=True, layout="constrained")
    keys = dict.fromkeys((r["case"], r["blast"]) for r in rows)
    styles = {"believed": "ko-", "effect": "C0s-", "true": "C2^-"}
    for axis, key in zip(axes.flat, keys, strict=False):
        chosen = [r for r in rows if (r["case"], r["blast"]) == key]
        for model, style in styles.items():
            here = sorted((r["edge_m"], 100.0 * r["median"]) for r in chosen if r["model"] == model)
            if here:
                axis.loglog(*np.transpose(here), style, label=LABELS.get(model, model))
        for name, line in (("independent_believed", ":"), ("noise_alone", "--")):
            axis.axhline(100.0 * chosen[0][name], color="0.5", ls=line, lw=0.9)
        axis.set_title(f"{key[0]} {key[1]}: {', '.join(chosen[0]['effects']) or 'nothing hidden'}",
                       fontsize=9)  # fmt: skip
        axis.set_xscale("log")
        axis.set_xticks(EDGES, [f"{edge:g}" for edge in EDGES])
        axis.set_xticks([], minor=True)
    for axis in list(axes.flat)[len(keys) :]:
        axis.remove()
    axes.flat[len(keys) - 1].legend(fontsize=8)
    figure.supxlabel("edge of the cells [m]")
    figure.supylabel("median misfit, 3-30 Hz [% of energy]")
    figure.savefig(path, dpi=90)


def write_table(rows):
    """Put the table of misfits between its two marks in the page."""
    lines = [
        "| case, blast | hidden | model | 12 m | 8 m | 5.5 m | theirs, reference | noise alone |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for case, blasts in BLASTS.items():
        for blast in blasts:
            for model in MODELS:
                here = {r["edge_m"]: r for r in rows
                        if (r["case"], r["blast"], r["model"]) == (case, blast, model)}  # fmt: skip
                if not here:
                    continue
                one = next(iter(here.values()))
                first = model == "believed"
                cells = [f"{100 * here[e]['median']:.1f}" if e in here else "–" for e in EDGES]
                lines.append("| " + " | ".join([
                    f"{case}, {blast}" if first else "",
                    (", ".join(one["effects"]) or "nothing") if first else "",
                    LABELS.get(model, model), *cells,
                    f"{100 * one['independent_believed']:.1f}" if first else "",
                    f"{100 * one['noise_alone']:.2f}" if first else "",
                ]) + " |")  # fmt: skip
    before, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    after = rest.split(END)[1]
    table = "\n".join(lines)
    PAGE.write_text(f"{before}{BEGIN}\n\n{table}\n\n{END}{after}", encoding="utf-8")


def main(arguments):
    """Run the study, write its results and draw them."""
    folders, limits = options(arguments)
    cases = Path(folders[0]) if folders else ROOT.parent / "shared" / "cases"
    if not (cases / "case-11" / "site.toml").is_file():
        print(f"independent: skipped, no case folders in {cases}")
        return
    rows = study(cases, limits)
    draw(rows, FIGURE)
    write_table(rows)
    print(f"independent: {OUT.name} and docs/figures/{FIGURE.name} written")


if __name__ == "__main__":
    main(sys.argv[1:])
