"""Sites recorded by an independent program, diagnosed, and only then set beside their truth.

    python -m verification.foreign [FOLDER OF CASES] [--keep FOLDER] [case ...]
    ./dev sites [FOLDER OF SITES] [--keep FOLDER] [case ...]

The first has flat layers and upright joints, as case folders that are first written as project
files; the second has real geometry (in ``PYBLAST_SITES`` by default), one at a time in this
process. Nothing of these truths enters the program: they are read here, after the answer is
written. Rows that ``verification/foreign.json`` or ``verification/sites.json`` has already are
kept, so a study that was stopped goes on; ``--again`` diagnoses them, too, and ``--minutes N``
begins no case after that time.
"""

import os
import sys
import tempfile
import time
import tomllib
from contextlib import nullcontext
from math import radians
from pathlib import Path

import numpy as np

from examples.case_folder import write_projects
from pyblast.errors import contained
from pyblast.files import write_text
from pyblast.inference.records import band_functions
from pyblast.project.project import load_project
from pyblast.recordings.recording import read_stations
from pyblast.runs.parallel import workers
from pyblast.workflows.diagnose import diagnose_file, predict_file

from .independent_cases import WRITTEN
from .rows import each_row, options, read_rows

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "quality" / "earlier_answers.md"
STUDIES = {"cases": "foreign.json", "sites": "sites.json"}
PROJECT = "B2.toml"
BLAST = "H1"
MISFIT = "misfit of the further blast, calibrated → diagnosed"
# What a truth says of parameters of the library: label, parameter, value by the truth's own.
COMPARED = (
    ("soft_surface_layer", "thickness", lambda truth: truth["thickness"]),
    ("soft_surface_layer", "slower", lambda truth: truth["factor"]),
    ("missing_joint", "kn", lambda truth: truth["kn"]),
    ("missing_joint", "ks", lambda truth: truth["ks"]),
    ("wrong_geometry", "dip", lambda t: radians(t["dip_deg"] - t["believed_dip_deg"])),
    ("topography", "height", lambda truth: truth["h"]),
    ("attenuation_Q", "q", lambda truth: truth["Qs"]),
    ("joint_nonlinear_closure", "closed", lambda truth: truth["r"]),
    ("joint_slip", "residual", lambda truth: truth["residual"]),
    ("joint_viscous_fill", "relaxation", lambda truth: truth["tau"]),
    ("misfire_or_charge_error", "radiated", lambda truth: truth["factor"]),
    ("damaged_zone", "reduction", lambda truth: 1.0 - truth["factor"]),
)


def judged(cases, name, keep, executor, before):
    """Diagnose one case, predict its further blast, and open its truth.

    The first answer stays that of the row ``before``, of the first program that gave one.
    """
    file, out = cases / name / PROJECT, keep / name
    if not file.is_file():
        file = write_projects(cases / name, WRITTEN / name)
    began = time.process_time()
    answer = diagnose_file(file, out, executor=executor, progress=_told)
    spent = time.process_time() - began
    truth_folder = cases / "truth" / name
    misfits, failures = {}, {}
    for model, baseline in (("diagnosed", False), ("calibrated", True)):
        path, misfits[model] = out / f"{model}.mseed", None
        with contained(failures, f"prediction, {model}"):
            predict_file(file, out, answer, truth_folder / f"{BLAST}_holes.csv", path, baseline)
            misfits[model] = _misfit(truth_folder / f"{BLAST}.mseed", path, file)
    truth = tomllib.loads((truth_folder / "truth.toml").read_text())
    labels = [one["label"] for one in answer["effects"]]
    first = before.get("outcome", answer["outcome"]), *before.get("labels", labels)
    geometry = {"geometry": truth["template"]} if "template" in truth else {}
    return {
        "truth": truth["effects"],
        **geometry,
        "first_answer": before.get("first_answer", " ".join(first)),
        "outcome": answer["outcome"],
        "acts": [one["act"] for one in answer["mistakes"]],
        "labels": labels,
        "named": [one["label"] for one in answer["effects"] if one["named"]],
        "targets": [one["target"] for one in answer["effects"]],
        "class": answer["class"],
        "best": answer["evidence"]["best_labels"],
        "fails": answer["fails"],
        "finished": answer["finished"],
        "delta_ln_evidence": answer["evidence"]["delta_ln_evidence"],
        "null_threshold": answer["evidence"]["null_threshold"],
        "explained": answer["evidence"]["explained_share"],
        "held_out_gain": None if answer["held_out"] is None
        else answer["held_out"]["delta_ln_likelihood"],
        "intervals": intervals(answer["effects"], truth.get("parameters", {})),
        "further_blast_misfit": misfits,
        "not_computed": [*(row["part"] for row in answer["not_computed"]), *failures],
        "runs": answer["runs"],
        "wall_s": answer["wall_s"],
        "kept_s": answer["kept_s"],
        **({} if executor is not None else {"processor_s": round(spent, 1)}),
    }  # fmt: skip


def intervals(effects, truth):
    """Return the true value of each parameter with a truth beside its estimate and interval.

    Parameters
    ----------
    effects : list of dict
        Of an answer.
    truth : dict of str to dict
        Parameters by label.

    Returns
    -------
    dict of str to dict
        ``true``, ``value``, ``low``, ``high`` by label and parameter.
    """
    rows = {}
    for effect in effects:
        for label, name, true in COMPARED:
            estimate = effect["parameters"].get(name)
            if label == effect["label"] and label in truth and isinstance(estimate, dict):
                rows[f"{label} {name}"] = {"true": round(true(truth[label]), 6)} | {
                    key: float(f"{estimate[key]:.4g}") for key in ("value", "low", "high")
                }
    return rows


def _told(stage, done, total):
    """Say how far it is, after the processor time."""
    print(f"  {time.process_time():.0f} s  {stage} {done}/{total}", flush=True)


def _misfit(recorded, predicted, file):
    """Return the median over receivers of the energy of the difference over that of the record.

    Of those that are predicted: not those near a source. Records go through the low-pass of what
    enters, as those of the diagnosis do.
    """
    there, here = (read_stations(path) for path in (recorded, predicted))
    project = load_project(file)
    misfits = []
    for name in there.keys() & here.keys():
        raw = there[name].seismogram
        passed = raw.filtered_like(project.shot.low_pass)  # earlier by its delay
        record = passed.sampled(raw.start, raw.dt, len(raw.velocity))
        band = band_functions(len(record.velocity), record.dt, project.config.band_hz)
        data, model = (v.T @ band.basis for v in (record.velocity, here[name].seismogram.velocity))
        misfits.append(np.sum((data - model) ** 2) / np.sum(data**2))
    return round(float(np.median(misfits)), 5)


def table(rows):
    """Return the lines of the table in the page."""
    last = "processor s" if any("processor_s" in row for row in rows.values()) else "min"
    heads = "case", "truth", "outcome", "effects reported", "explained", MISFIT, "runs", last
    if any("geometry" in row for row in rows.values()):
        heads = (heads[0], "geometry", *heads[1:])
    yield "| " + " | ".join(heads) + " |"
    yield "|---" * len(heads) + "|"
    for name, row in sorted(rows.items()):
        said = ", ".join(row["labels"]) or "–"
        where = f" | {row['geometry']}" if "geometry" in row else ""
        before, after = (
            "–" if row["further_blast_misfit"][k] is None
            else f"{100.0 * row['further_blast_misfit'][k]:.1f}"
            for k in ("calibrated", "diagnosed")
        )  # fmt: skip
        yield (
            f"| {name}{where} | {', '.join(row['truth']) or 'null'} | {row['outcome']} | {said} | "
            f"{row['explained']:.2f} | {before} → {after} % | {row['runs']} | "
            f"{_time(row):.0f} |"
        )


def _time(row):
    """Return the processor time of a row in s, else its wall time in min with that of kept runs."""
    wall = (row["wall_s"] + row.get("kept_s", 0.0) / os.cpu_count()) / 60.0
    return row.get("processor_s", wall)


def main(arguments):
    """Diagnose the cases that are asked for, and write the page."""
    arguments, limits = options(arguments)
    study = "sites" if "--sites" in arguments else "cases"
    arguments = [one for one in arguments if one != "--sites"]
    keep = None
    if "--keep" in arguments:
        at = arguments.index("--keep")
        keep = Path(arguments[at + 1])
        del arguments[at : at + 2]
    names = [one for one in arguments if one.startswith("case-")]
    folders = [one for one in arguments if one not in names]
    given = os.environ.get("PYBLAST_SITES") if study == "sites" else None
    cases = Path(folders[0] if folders else given or ROOT.parent / "shared" / study)
    if not (cases / "truth").is_dir():
        print(f"foreign: skipped, no case folders in {cases}")
        return
    out = ROOT / "verification" / STUDIES[study]
    names = names or sorted(folder.name for folder in cases.glob("case-*"))
    pool = nullcontext() if study == "sites" else workers()
    with tempfile.TemporaryDirectory() as temporary, pool as executor:
        kept = keep or Path(temporary)
        known = read_rows(out)

        def job(name):
            return judged(cases, name, kept, executor, known.get(name, {}))

        rows = each_row(out, names, job, **limits)
    _write_page(study, rows)


def _write_page(study, rows):
    """Write the table of a study into the page."""
    begin, end = f"<!-- {study}: from verification/{STUDIES[study]} -->", f"<!-- end of {study} -->"
    text = PAGE.read_text()
    before, after = text.split(begin)[0], text.split(end)[1]
    write_text(PAGE, before + "\n".join([begin, *table(rows), end]) + after)


if __name__ == "__main__":
    main(sys.argv[1:])
