"""Registration: digests of truths, rules and thresholds, fixed before any case is answered."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks.blind.plan import FRESH_SEED
from benchmarks.specfem.plan import SEED as SPECFEM_SEED
from pyblast.diagnosis.thresholds import threshold_rows
from pyblast.errors import InputError
from pyblast.files import write_text
from verification.markdown import reflow
from verification.rows import program

from .cases import KNOWN, digest_of, truth_of
from .scores import TARGETS, percent

FILE = Path(__file__).with_name("registered.json")
PAGE = Path(__file__).resolve().parents[2] / "docs" / "quality" / "registration.md"
KINDS = {
    "site": "sites with real geometry, from an independent spectral-element program",
    "flat": "flat sites, from an independent finite-difference program",
    "specfem": "sites drawn with a seed, recorded by SPECFEM3D (`python -m benchmarks.specfem`); a "
    "third of them nulls whose receivers, holes or ground differ by more than usual",
    "drawn": "sites drawn with a seed, simulated by pyblast with other errors and laws; real noise",
    "fresh": "sites drawn likewise with a later seed, after earlier versions had answered some of "
    "the former",
    "mine": "trials at the mine of Gol-e-Gohar on a smaller model, simulated by pyblast on a finer "
    "mesh",
    "real": "real hits on a line of geophones, some of whose records are altered; two simulated "
    "layers",
    "drop": "drops of a ball on a rock bar, simulated with drawn sensors and noise",
}
WORDS = """# Registration of the proof

Written by `./dev proof register` on {date} for program `{program}` (digest of the source: Python,
Fortran and the tables of limits, layouts, titles and priors). It states, before the cases are
answered, what counts. `./dev proof` answers each case once and writes [what came
out](diagnosis.md).

## Rules

1. A version of the program is the digest of its source. It answers each case once, with the default
   options. Drops are judged by `examples/ball_drops/judge.py`, which uses the program but is not
   part of the digest: they count towards no target.
2. The first answer of a version to a case stays in `verification/proof.json` for ever. A later one
   is kept beside it and does not count.
3. A truth is compared with its digest before a case is answered; nothing of it reaches the
   diagnosis. A case whose truth has changed is refused.
4. A crash is an answer, and wrong. A case without a row is not answered: it counts neither for nor
   against.
5. On a null every outcome but NULL and UNKNOWN is a false alarm. An answer is right if it names all
   that is true and nothing else. A name is wrong if it is not true. Names count, not places: how
   many right names have the right place is counted separately.
6. Cases may be added to the list with another seed. None is changed or removed; only the truths of
   four SPECFEM3D cases were replaced, within five minutes and before any was simulated
   ([decisions](../decisions.md)). The program may be changed because of a wrong answer; the row
   stays.
7. The truths of the sites, flat sites, mine and drops were known to the authors when this page was
   written, and earlier versions had answered many of them: these are not blind cases. The drawn
   truths, those of SPECFEM3D and those concealed in real hits had been neither simulated nor looked
   at; their truths follow from seeds {seed}, {fresh} (also of the real hits) and {specfem}, so that
   anybody can check their digests. A digest of a drawn truth seals its effects, its noise and the
   level of its errors; the site and its errors follow from the seed and the generator's code.
8. Once wrong answers to drawn cases have changed the program, the next version answers cases that
   no version has answered before; the page says which drawn cases earlier versions have answered.
   (Added with the later seed, before any of its cases was simulated.)

On 2026-11-28 the words of rules 1, 3, 5, 6 and 7 were made exact after a review, and the English of
all rules was edited; every share is counted as before, except that `body`, by which the library
means softer or stiffer rock or nearly a void, is not a wrong name for a void, a tunnel, a dyke or a
basin. No answer had named it.

## What is to be reached

{targets}

Each is given with its 95 % Clopper–Pearson interval, whether met or not.

## Thresholds

As they stood in `pyblast/diagnosis/thresholds.py`; the meaning and origin of each are in
[thresholds](../reference/thresholds.md).

{thresholds}

## Cases

{kinds}

A digest is the SHA-256 of a truth file, or of a drawn truth written as JSON with numbers of nine
digits.

{cases}
"""


def registered() -> dict[str, Any]:
    """Return the registration: ``date``, ``program``, ``thresholds``, ``cases``; empty at first."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.is_file() else {"cases": {}}


def register(truths: Iterable[tuple[str, Any]], answered: bool, seed: int):
    """Add cases to the registration and write its page.

    Parameters
    ----------
    truths : iterable of (str, object)
        Name and truth.
    answered : bool
        Whether a case has an answer already: then rules, date and thresholds stay.
    seed : int
        Of the drawn cases.

    Raises
    ------
    InputError
        If the truth of a registered case is another one now.
    """
    before = registered()
    new = {name: digest_of(truth) for name, truth in truths}
    changed = [name for name in new if before["cases"].get(name, new[name]) != new[name]]
    if changed:
        raise InputError(f"proof: truths of {', '.join(changed)} are not those registered; "
                         "registered cases are never changed, add others")  # fmt: skip
    table = before | {"cases": dict(sorted((before["cases"] | new).items()))}
    if not answered:
        table |= {
            "date": datetime.now(UTC).date().isoformat(), "program": program(), "seed": seed,
            "thresholds": {row.name: row.value for row in threshold_rows()},
        }  # fmt: skip
    write_text(FILE, json.dumps(table, indent=1) + "\n")
    write_text(PAGE, page(table))


def checked(name: str):
    """Refuse a case that isn't registered, or whose truth is another one than registered.

    Raises
    ------
    InputError
    """
    sealed = registered()["cases"].get(name)
    if sealed is None:
        raise InputError(f"proof: {name} is not registered; run ./dev proof register first")
    if digest_of(truth_of(name)) != sealed:
        raise InputError(f"proof: the truth of {name} is not the one that was registered")


def page(table: dict) -> str:
    """Return the page of a registration."""
    count = {kind: sum(name.startswith(f"{kind}-") for name in table["cases"]) for kind in KINDS}
    kinds = "\n".join(
        f"- `{kind}`: {count[kind]} {words}; truths {'known' if KNOWN[kind] else 'not known'}."
        for kind, words in KINDS.items()
    )
    rows = "\n".join(f"| {name} | `{sealed}` |" for name, sealed in table["cases"].items())
    limits = "\n".join(f"| `{name}` | {value:.4g} |" for name, value in table["thresholds"].items())
    targets = "\n".join(f"- {target.words}: {target.sign} {percent(target.share)}, of at least "
                        f"{target.least} cases." for target in TARGETS)  # fmt: skip
    return reflow(WORDS.format(
        date=table["date"], program=table["program"], seed=table["seed"], fresh=FRESH_SEED,
        specfem=SPECFEM_SEED, targets=targets, kinds=kinds,
        thresholds=f"| threshold | value |\n|---|---|\n{limits}",
        cases=f"| case | digest of its truth |\n|---|---|\n{rows}",
    ))  # fmt: skip


def changed_thresholds() -> list[str]:
    """Return the thresholds that are others now than registered, in words."""
    before = registered().get("thresholds", {})
    now = {row.name: row.value for row in threshold_rows()}
    return [
        f"`{name}` {_value(before.get(name))} → {_value(now.get(name))}"
        for name in dict.fromkeys((*before, *now)) if before.get(name) != now.get(name)
    ]  # fmt: skip


def _value(threshold):
    """Return a threshold in words."""
    return "none" if threshold is None else f"{threshold:.4g}"
