"""Say what a published model of a block of rock leaves out, from real records of a known source.

    python examples/ball_drops/diagnose.py [FOLDER]

Reads the tables and records beside this file, runs the block as it is published and as it may be
otherwise, and writes ``diagnosis.json`` and ``report.html`` to FOLDER (``results`` beside this
file).
"""

import hashlib
import json
import re
import sys
import time
from concurrent.futures import Executor
from pathlib import Path

import numpy as np
from judge import (
    BAND,
    COARSE,
    FINALISTS,
    RATIOS,
    Bank,
    compared,
    compared_records,
    judge,
    judged,
)
from page import located, write_page
from survey import (
    DT,
    HERE,
    STIFFNESSES,
    members,
    motions,
    read_survey,
    reference_project,
    with_speeds,
)

from pyblast.files import code_hash
from pyblast.project.reciprocity import Responses
from pyblast.runs.parallel import workers

TABLES = "block.toml", "drops.csv", "sensors.csv", "source_force.csv"
CODE = "survey.py", "judge.py", "diagnose.py"


def digest(code=CODE) -> str:
    """Return the digest of the program and of the tables that it reads."""
    text = hashlib.sha256(code_hash().encode())
    for name in (*TABLES, *code):
        text.update((HERE / name).read_bytes())
    return text.hexdigest()[:16]


def stored(folder: Path, name: str, compute) -> list[Responses]:
    """Return responses of a run that is stored under a name, or compute and store them."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / (re.sub(r"[^A-Za-z0-9.]+", "_", name) + ".npz")
    key = digest(())
    if path.exists():
        with np.load(path) as file:
            if str(file["key"]) == key:
                return [Responses(v.astype(float), DT, int(file["runs"])) for v in file["velocity"]]
    three = compute()
    velocity = np.array([each.velocity for each in three], dtype=np.float32)
    np.savez(path, velocity=velocity, runs=three[0].runs, key=key)
    return three


def _member(folder: Path, name: str, ratio: float) -> int:
    """Compute and store the responses of a member; return the runs that it took."""
    survey, reference = read_survey(), reference_project()
    project = members(reference)[name][1]
    if ratio != 1.0:
        project = with_speeds(project, ratio)
    three = stored(folder, f"{name} at {ratio:g}", lambda: motions(survey, project, None))
    return three[0].runs


def bank_of(survey, folder: Path, band=BAND) -> Bank:
    """Return the bank of motion of all members, with what is stored in a folder."""
    known = members(reference_project())

    def responses(name, ratio):
        def compute():
            project = known[name][1]
            return motions(survey, project if ratio == 1.0 else with_speeds(project, ratio), None)

        return stored(folder, f"{name} at {ratio:g}", compute)

    return Bank({name: label for name, (label, _) in known.items()}, responses, band)


def filled(folder: Path, executor: Executor, states) -> int:
    """Run what a folder lacks of states (member, ratio) at once; return the number of runs."""
    waiting = [executor.submit(_member, folder, name, ratio) for name, ratio in states]
    return sum(each.result() for each in waiting)


def stiffness_interval(answer: dict, records, bank: Bank) -> dict | None:
    """Return the stiffnesses of a joint that the records allow, in units of pi f Z."""
    used = compared_records(answer, records)
    totals = {}
    for name, label in bank.classes.items():
        if label.endswith("joint"):
            states = [(name, 1.0, factor) for factor in COARSE]
            totals[float(name.rpartition(" ")[2])] = judged(records, used, bank, name, states).total
    if not totals:
        return None
    best = max(totals.values())
    inside = [value for value, total in totals.items() if best - total < 10.0]
    return {
        "log_likelihood": {f"{value:g}": round(total - best, 1) for value, total in totals.items()},
        "interval": [min(inside), max(inside)],
        "open_below": min(inside) == STIFFNESSES[0], "open_above": max(inside) == STIFFNESSES[-1],
    }  # fmt: skip


UNTESTABLE = (
    "The two ends: records are compared until the first echo of an end could come. The top face: "
    "it is struck. Motion above 100 kHz, and the level of a record: each sensor has its own gain. "
    "A loss is asked by energies alone."
)


def sentences(answer: dict) -> dict[str, str]:
    """Return the sentences of the page: what is named and when the published model ends."""
    begins = answer["located"]["first_window_below_0.7_us"]
    when = "in every window" if begins is None else f"up to {begins[0]} µs after P"
    text = f"The published model explains more than 0.7 of the energy {when}. "
    first, gain = answer["classes"][0], answer.get("gain_held_out")
    if answer["outcome"] == "NAMED":
        text += f"What it lacks: {', '.join(answer['named'])}. "
    elif answer["outcome"] == "AMBIGUOUS":
        text += (
            f"It lacks one of these, which cannot be told apart: {', '.join(answer['rivals'])}. "
        )
    else:
        text += "Nothing that was asked explains more with certainty. "
    if gain:
        text += (
            f"{first['name']} leads by {gain['behind']} ± {gain['error']} in log likelihood of "
            f"drops that its fit did not use; {gain['drops_that_gain']} of {gain['drops']} gain."
        )
    near = [row for row in answer["classes"][1:6]]
    rivals = "; ".join(f"{row['name']} behind by {row['behind']} ± {row['error']}" for row in near)
    return {"sentence": text, "rivals_sentence": f"Behind {first['name']}: {rivals}.",
            "untestable": UNTESTABLE}  # fmt: skip


def main(arguments):
    """Diagnose the drops and write the answer and its page."""
    begin = time.process_time()
    folder = Path(arguments[0]) if arguments else HERE / "results"
    survey = read_survey()
    records, bank = compared(survey), bank_of(survey, folder)
    with workers() as executor:
        runs = filled(folder, executor, [(name, 1.0) for name in bank.classes])
        answer = judge(records, bank, prepare=lambda states: filled(folder, executor, states))
    answer["stiffness"] = stiffness_interval(answer, records, bank)
    answer["located"] = located(answer, records, bank, survey)
    answer |= {"runs": runs, "processor_s": round(time.process_time() - begin, 1),
               "program": digest(), "finalists": FINALISTS, "ratios": list(RATIOS)}  # fmt: skip
    answer |= sentences(answer)
    write_page(folder / "report.html", answer, records, bank, survey)
    (folder / "diagnosis.json").write_text(json.dumps(answer, indent=1) + "\n")
    print(answer["outcome"], ", ".join(answer["named"] or answer["rivals"]) or "no effect")
    print(f"written: {folder / 'diagnosis.json'}, {folder / 'report.html'}")


if __name__ == "__main__":
    main(sys.argv[1:])
