"""Sites recorded by an independent program, diagnosed, and only then set beside their truth.

    python -m verification.foreign [FOLDER OF CASES] [--keep FOLDER] [case ...]

Nothing of these truths enters the program: they are read here, after the answer is written. Rows
that ``verification/foreign.json`` has already are kept, so a study that was stopped goes on.
"""

import json
import os
import sys
import tempfile
import tomllib
from pathlib import Path

import numpy as np

from benchmarks.timing import machine
from pyblast.inference.records import band_functions
from pyblast.project.result import write_text
from pyblast.recordings.recording import read_stations
from pyblast.runs.parallel import workers
from pyblast.workflows.diagnose import diagnose_folder, predict_file

ROOT = Path(__file__).resolve().parents[1]
OUT = ROOT / "verification" / "foreign.json"
TIMES = ROOT / "benchmarks" / "results.json"
PAGE = ROOT / "docs" / "quality" / "diagnosis.md"
BEGIN, END = "<!-- cases: from verification/foreign.json -->", "<!-- end of cases -->"
BLAST = "H1"
MISFIT = "misfit of the further blast, calibrated → diagnosed"


def judged(cases, name, keep, executor):
    """Diagnose one case, predict its further blast, and open its truth."""
    folder, out = cases / name, keep / name
    answer = diagnose_folder(folder, out, executor=executor, progress=_told)
    truth_folder = cases / "truth" / name
    misfits = {}
    for model, baseline in (("diagnosed", False), ("calibrated", True)):
        path = out / f"{model}.mseed"
        predict_file(folder, out, answer, truth_folder / f"{BLAST}_holes.csv", path, baseline)
        misfits[model] = _misfit(truth_folder / f"{BLAST}.mseed", path, folder)
    truth = tomllib.loads((truth_folder / "truth.toml").read_text())
    return {
        "truth": truth["effects"],
        "outcome": answer["outcome"],
        "labels": [one["label"] for one in answer["effects"]],
        "named": [one["label"] for one in answer["effects"] if one["named"]],
        "targets": [one["target"] for one in answer["effects"]],
        "class": answer["class"],
        "best": answer["evidence"]["best_labels"],
        "delta_ln_evidence": answer["evidence"]["delta_ln_evidence"],
        "null_threshold": answer["evidence"]["null_threshold"],
        "explained": answer["evidence"]["explained_share"],
        "further_blast_misfit": misfits,
        "runs": answer["runs"],
        "wall_s": answer["wall_s"],
        "kept_s": answer["kept_s"],
        "machine": machine(),
        "load": round(os.getloadavg()[1], 1),
    }


def times(rows):
    """Return the median and the longest time of diagnoses with their machine and load.

    Kept runs count as if they had been run again on all processors.
    """
    seconds = [row["wall_s"] + row["kept_s"] / os.cpu_count() for row in rows]
    return {
        "median_s": round(float(np.median(seconds)), 1), "worst_s": round(max(seconds), 1),
        "cases": len(rows), "machine": rows[-1]["machine"],
        "load": max(row["load"] for row in rows),
    }  # fmt: skip


def _told(stage, done, total):
    """Say how far it is."""
    print(f"  {stage} {done}/{total}", flush=True)


def _misfit(recorded, predicted, folder):
    """Return the median over receivers of the energy of the difference over that of the record."""
    table = tomllib.loads((folder / "site.toml").read_text())["recording"]
    there, here = (read_stations(path) for path in (recorded, predicted))
    found = []
    for name, one in there.items():
        record = one.seismogram
        band = band_functions(len(record.velocity), record.dt, table["band_hz"])
        data, model = (v.T @ band.basis for v in (record.velocity, here[name].seismogram.velocity))
        found.append(np.sum((data - model) ** 2) / np.sum(data**2))
    return round(float(np.median(found)), 5)


def table(rows):
    """Return the lines of the table in the page."""
    heads = "case", "truth", "outcome", "effects reported", "explained", MISFIT, "runs", "min"
    yield "| " + " | ".join(heads) + " |"
    yield "|---|---|---|---|---|---|---|---|"
    for name, row in sorted(rows.items()):
        said = ", ".join(row["labels"]) or "–"
        before, after = (
            100.0 * row["further_blast_misfit"][k] for k in ("calibrated", "diagnosed")
        )
        yield (
            f"| {name} | {', '.join(row['truth'])} | {row['outcome']} | {said} | "
            f"{row['explained']:.2f} | {before:.1f} → {after:.1f} % | {row['runs']} | "
            f"{(row['wall_s'] + row.get('kept_s', 0.0) / os.cpu_count()) / 60.0:.0f} |"
        )


def main(arguments):
    """Diagnose the cases that are asked for, and write the page."""
    keep = None
    if "--keep" in arguments:
        at = arguments.index("--keep")
        keep = Path(arguments[at + 1])
        del arguments[at : at + 2]
    names = [one for one in arguments if one.startswith("case-")]
    folders = [one for one in arguments if one not in names]
    cases = Path(folders[0] if folders else ROOT.parent / "shared" / "cases")
    if not (cases / "truth").is_dir():
        print(f"foreign: skipped, no case folders in {cases}")
        return
    rows = json.loads(OUT.read_text()) if OUT.is_file() else {}
    with tempfile.TemporaryDirectory() as temporary, workers() as executor:
        for name in names or sorted(p.name for p in cases.glob("case-*")):
            if name in rows:
                continue
            print(name, flush=True)
            rows[name] = judged(cases, name, keep or Path(temporary), executor)
            print(f"  {rows[name]}", flush=True)
            write_text(OUT, json.dumps(dict(sorted(rows.items())), indent=1) + "\n")
    timed = [row for row in rows.values() if "machine" in row]
    if timed:
        results = json.loads(TIMES.read_text())
        results["diagnosis"] = times(timed)
        write_text(TIMES, json.dumps(results, indent=1) + "\n")
    text = PAGE.read_text()
    before, after = text.split(BEGIN)[0], text.split(END)[1]
    write_text(PAGE, before + "\n".join([BEGIN, *table(rows), END]) + after)


if __name__ == "__main__":
    main(sys.argv[1:])
