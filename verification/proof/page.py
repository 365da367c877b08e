"""Page of the proof in docs/quality/diagnosis.md, its picture, and the lines of README."""

from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pyblast.files import write_text
from verification.markdown import reflow
from verification.rows import Rows, program

from .answers import first_answers, versions
from .cases import KNOWN
from .registered import KINDS, changed_thresholds, registered
from .scores import (
    CLEAR,
    ENERGIES,
    LENGTHS,
    TARGETS,
    answer_word,
    clopper_pearson,
    confusion,
    gains,
    in_library_words,
    met,
    percent,
    power,
    right,
    shares,
    truth_word,
    with_gains,
)

ROOT = Path(__file__).resolve().parents[2]
PAGE, README = ROOT / "docs" / "quality" / "diagnosis.md", ROOT / "README.md"
FIGURE = ROOT / "docs" / "figures" / "proof.png"
BEGIN, END = "<!-- proof: from verification/proof.json -->", "<!-- end of proof -->"
README_BEGIN, README_END = "<!-- first answers -->", "<!-- end of first answers -->"
NOT_ANSWERED = "not answered"
VERDICT = {True: "met", False: "**missed**", None: "too few cases"}


def write_pages(rows: Rows):
    """Write what the first answers of the version to be shown say."""
    version = shown(versions(rows), program())
    answers = first_answers(rows, version) if version else {}
    if answers:
        _draw(in_library_words(answers))
    _between(PAGE, BEGIN, END, page(rows, version, answers))
    _between(README, README_BEGIN, README_END, summary(version, answers))


def shown(counts: dict[str, int], present: str) -> str | None:
    """Return the present version, unless another has answered more than twice as many cases.

    Parameters
    ----------
    counts : dict of str to int
        First answers by version, most first.
    present : str

    Returns
    -------
    str or None
        None where there is no answer.
    """
    most = next(iter(counts), None)
    return present if most and 2 * counts.get(present, 0) >= counts[most] else most


def page(rows: Rows, version: str | None, answers: Rows) -> str:
    """Return the part of the page that rows write.

    Parameters
    ----------
    rows : dict
        All that were ever given.
    version : str or None
    answers : dict
        First answers of that version by case.
    """
    cases = registered()["cases"]
    parts = [
        f"{summary(version, answers)} [Rules, thresholds and the list of cases](registration.md) "
        "were registered before.", _kinds(cases, answers), "### What was to be reached",
        _targets(answers, _unseen(rows, version, answers)), *_all_versions(rows),
    ]  # fmt: skip
    if answers and version != program():
        parts.append("The program has changed since; its present version has answered few cases.")
    changed = changed_thresholds()
    if changed:
        parts.append(f"Thresholds changed since registration: {'; '.join(changed)}.")
    if answers:
        own = in_library_words(answers)
        parts += [
            "### Truth against answer",
            "![Confusion matrix of first answers](../figures/proof.png)", matrix(own),
            "### Power", _power(own), _detected(own), "### Records that no fit has used",
            _predicted(answers), "### Numbers", _numbers(own),
            "### First answers", _answers(rows, version, answers),
        ]  # fmt: skip
    return reflow("\n\n".join(parts))


def summary(version: str | None, answers: Rows) -> str:
    """Say which version answered how many cases when, and how many rightly."""
    cases = registered()["cases"]
    if not answers:
        return f"None of {len(cases)} registered cases is answered by this version yet."
    dates = sorted({row["date"] for row in answers.values()})
    days = " to ".join(dict.fromkeys((dates[0], dates[-1])))
    own = in_library_words(answers)
    nulls = [row for row in own if not row["truth"]]
    single = [row for row in own if row["block"] == "single"]
    crashed = sum(row["outcome"] == "CRASH" for row in answers.values())
    called, clear = Counter(row["outcome"] for row in nulls), shares(answers)["named"]
    return (
        f"Version `{version}` has answered {len(answers)} of {len(cases)} registered cases "
        f"({days}), each once; {len(answers) - len(own)} are drops. It calls {called['NULL']} of "
        f"{len(nulls)} nulls NULL and {called['UNKNOWN']} UNKNOWN, names {sum(map(right, single))} "
        f"of {len(single)} single effects ({sum(clear)} of {len(clear)} of d′ ≥ {CLEAR:g}), and "
        f"crashed {crashed} times. {_verdicts(answers)}"
    )


def _verdicts(answers):
    """Say which targets are met and missed."""
    told, lists = shares(answers), {}
    for target in TARGETS:
        hits = told[target.name]
        short = target.words.partition(":")[0]
        if hits:
            share = percent(np.mean(hits))
            short += f" ({share} of {len(hits)}; {target.sign} {percent(target.share)})"
        lists.setdefault(met(target, hits), []).append(short)
    words = {True: "Met", False: "Missed"}
    said = [f"{words[key]}: {'; '.join(lists[key])}." for key in words if key in lists]
    few = len(lists.get(None, ()))
    if few:
        said.append(f"Too few cases for {few} of {len(TARGETS)} targets.")
    return " ".join(said)


def matrix(rows: list[dict]) -> str:
    """Return the confusion matrix as a table."""
    truths, answers, counts = confusion(rows)
    head = " | ".join(map(_code, answers))
    lines = [f"| truth | {head} | all |", "|---" * (len(answers) + 2) + "|"]
    for truth, own in zip(truths, counts, strict=True):
        cells = " | ".join(str(n) if n else "" for n in own)
        lines.append(f"| {_code(truth)} | {cells} | {own.sum()} |")
    return "\n".join(lines)


def _unseen(rows, version, answers):
    """Return the answers to cases of unknown truth that no other version has answered."""
    others = {key.split()[0] for key in rows if key.split()[1] != version}
    blind = {name: row for name, row in answers.items() if not KNOWN[name.partition("-")[0]]}
    return {name: row for name, row in blind.items() if name not in others}


def _all_versions(rows):
    """Return what each version answered, where several did."""
    counts = versions(rows)
    if len(counts) < 2:
        return []
    heads = ("version", "from", "answers", "false alarms", "answers with a wrong name",
             "single effects named")  # fmt: skip
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for version in counts:
        own = first_answers(rows, version)
        told, words = shares(own), in_library_words(own)
        single = [right(row) for row in words if row["block"] == "single"]
        cells = map(_count, (told["alarms"], [not each for each in told["right names"]], single))
        date = min(row["date"] for row in own.values())
        lines.append(f"| `{version}` | {date} | {len(own)} | {' | '.join(cells)} |")
    return ["Each version answers once; the next one includes what its wrong answers taught:",
            "\n".join(lines)]  # fmt: skip


def _kinds(cases, answers):
    """Return how many cases of each kind are answered."""
    lines = ["| kind | cases | answered | right (nulls: NULL) |", "|---|---|---|---|"]
    for kind, words in KINDS.items():
        own = [row for name, row in answers.items() if name.startswith(f"{kind}-")]
        count = sum(name.startswith(f"{kind}-") for name in cases)
        good = sum(right(row) or (not row["truth"] and row["outcome"] == "NULL") for row in own)
        lines.append(f"| {words} | {count} | {len(own) or NOT_ANSWERED} | {good if own else ''} |")
    return "\n".join(lines)


def _targets(answers, unseen):
    """Return the shares beside what they were to reach, of all answers and of unseen cases."""
    heads = ("", "target", "share", "95 % interval", "cases", "", "of unseen cases")
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    told, blind = shares(answers), shares(unseen)
    for target in TARGETS:
        hits = told[target.name]
        cells = f"{NOT_ANSWERED} | | 0"
        if hits:
            low, high = clopper_pearson(sum(hits), len(hits))
            span = f"{percent(low, 1)} to {percent(high, 1)}"
            cells = f"{percent(np.mean(hits))} | {span} | {len(hits)}"
        verdict = VERDICT[met(target, hits)]
        of = f" of {target.least} needed" if hits and len(hits) < target.least else ""
        lines.append(f"| {target.words} | {target.sign} {percent(target.share)} | {cells}{of} "
                     f"| {verdict} | {_count(blind[target.name])} |")  # fmt: skip
    lines += ["", "Unseen cases are those whose truth the authors did not know and which no other "
              f"version has answered: {len(unseen)} of {len(answers)}."]  # fmt: skip
    return "\n".join(lines)


def _power(rows):
    """Return how many effects were named, by label and share of energy that they change."""
    edges = [f"{100 * low:g} to {100 * high:g} %" if np.isfinite(high) else f"over {100 * low:g} %"
             for low, high in pairwise(ENERGIES)]  # fmt: skip
    words = (
        "Single effects named, and nothing else, by the share of energy that they change: on "
        "drawn sites of the record that changes most, elsewhere the mean of the records that "
        "change:"
    )
    return _classes(words, edges, power(rows))


def _detected(rows):
    """Return how many drawn effects were named, by label and distance d' from no effect."""
    edges = [f"{low:g} to {high:g}" if np.isfinite(high) else f"over {low:g}"
             for low, high in pairwise(LENGTHS)]  # fmt: skip
    words = (
        "Single effects on drawn sites by d′, the size of the effect in standard deviations of "
        "noise and of this version's model error, after removal of what calibration can absorb:"
    )
    return _classes(words, edges, power(rows, "length", LENGTHS))


def _classes(words, edges, table):
    """Return a table of pairs by label and class."""
    if not table:
        return f"{words} {NOT_ANSWERED}."
    lines = [words, "", "| effect | " + " | ".join(edges) + " |", "|---" * (len(edges) + 1) + "|"]
    for label, pairs in table.items():
        lines.append(f"| `{label}` | {' | '.join(map(_of, pairs))} |")
    every = np.sum(list(table.values()), axis=0)
    lines.append(f"| all | {' | '.join(map(_of, every))} |")
    spans = (" to ".join(map(percent, clopper_pearson(*pair))) if pair[1] else "" for pair in every)
    lines.append(f"| 95 % interval | {' | '.join(spans)} |")
    return "\n".join(lines)


def _of(pair):
    """Return hits of a count in words; nothing where there is none."""
    hits, count = pair
    return f"{hits} of {count}" if count else ""


def _count(hits):
    """Return a list of yes and no as hits of a count."""
    return f"{sum(hits)} of {len(hits)}"


def _predicted(answers):
    """Return which share of unseen records models of the cases with names explain."""
    models = {"before": "calibrated", "after": "as answered", "second": "second best effect",
              "right": "right effect, fitted"}  # fmt: skip
    words = (
        "Share of the energy explained, for cases with an effect whose answer names effects; "
        "real hits that a model explains less than before are PARTIAL, and not listed. The "
        "second-best effect is the one of the others with the most evidence, fitted likewise."
    )
    lines = [f"| case | answer | {' | '.join(models.values())} |", "|---" * (len(models) + 2) + "|"]
    told = {name: row for name, row in answers.items() if with_gains([row])}
    for name, row in told.items():
        cells = (f"{row['held_out'][key]:.3f}" if key in row["held_out"] else "" for key in models)
        lines.append(f"| {name} | {_code(answer_word(row))} | {' | '.join(cells)} |")
    medians = (_median(gains(told.values(), key), ".3f", "") for key in list(models)[1:])
    lines.append(f"| median gain | | | {' | '.join(medians)} |")
    return "\n".join([words, "", *lines])


def _numbers(rows):
    """Return located distances, coverage and time."""
    metres = [row["metres"] for row in rows if row.get("metres") is not None]
    covered = [hit for row in rows for hit in row.get("covered", ())]
    seconds = [row["processor_s"] for row in rows if row.get("processor_s") is not None]
    inside = NOT_ANSWERED
    if covered:
        low, high = clopper_pearson(sum(covered), len(covered))
        share, low, high = map(percent, (np.mean(covered), low, high))
        inside = f"{share} ({low} to {high}) of {len(covered)}"
    placed = [hit for row in rows for hit in row.get("placed", ())]
    lines = ["| | |", "|---|---|",
             f"| right names with the right receiver, blast, joint or plane | {_count(placed)} |",
             f"| location error, median | {_median(metres, '.1f', ' m')} |"]  # fmt: skip
    lines.append(f"| parameters inside their 90 % intervals | {inside} |")
    lines.append(f"| processor time per case, median | {_median(seconds, '.0f', ' s')} |")
    return "\n".join(lines)


def _answers(rows, version, answers):
    """Return the table of all first answers, with those of other versions beside."""
    lines = ["| case | truth | answer | processor s | other answers |", "|---|---|---|---|---|"]
    for name, row in answers.items():
        others = Counter(
            answer_word(other) for key, other in rows.items()
            if key.split()[0] == name and key != f"{name} {version}"
        )  # fmt: skip
        beside = ", ".join(f"{_code(word)}{f' ({n}×)' * (n > 1)}" for word, n in others.items())
        spent = row.get("processor_s")
        seconds = NOT_ANSWERED if spent is None else f"{spent:.0f}"
        lines.append(f"| {name} | {_code(truth_word(row))} | {_code(answer_word(row))} | {seconds} "
                     f"| {beside} |")  # fmt: skip
    return "\n".join(lines)


def _median(values, form, unit):
    """Return a median with its count in words."""
    return f"{np.median(values):{form}}{unit} (of {len(values)})" if len(values) else NOT_ANSWERED


def _code(word):
    """Return labels as code; outcomes and words as they are."""
    return f"`{word}`" if "_" in word else word


def _draw(rows):
    """Draw the confusion matrix."""
    truths, answers, counts = confusion(rows)
    figure = Figure(figsize=(4.0 + 0.4 * len(answers), 2.5 + 0.3 * len(truths)))
    axes, part = figure.subplots(), counts / counts.sum(axis=1, keepdims=True)
    axes.imshow(part, cmap="Blues", vmin=0.0, vmax=1.0)
    for (row, column), count in np.ndenumerate(counts):
        if count:
            shade = "white" if part[row, column] > 0.5 else "black"
            axes.text(column, row, str(count), ha="center", va="center", fontsize=8, color=shade)
    axes.set_xticks(range(len(answers)), answers, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(truths)), truths, fontsize=7)
    axes.set(xlabel="answer", ylabel="truth")
    figure.savefig(FIGURE, dpi=100, bbox_inches="tight")


def _between(file, begin, end, text):
    """Put a text between two marks of a page."""
    before, rest = file.read_text(encoding="utf-8").split(begin)
    after = rest[rest.index(end) :]
    write_text(file, f"{before}{begin}\n\n{reflow(text)}\n\n{after}")
