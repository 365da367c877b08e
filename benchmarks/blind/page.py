"""Page and figure of the blind benchmark."""

from pathlib import Path

from matplotlib.figure import Figure

from pyblast.files import write_text
from verification.markdown import reflow

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, FIGURE = DOCS / "quality" / "blind_benchmark.md", DOCS / "figures" / "blind.png"
WORDS = """# Blind benchmark of the diagnosis

Written by `python -m benchmarks.blind` (`./dev blind`). {cases} cases, seed {seed}{kind}. A
generator draws small sites and hides effects in them, stronger and weaker than the prior of the
diagnosis, or none; the records contain real noise. Truths were sealed before the run (hash of all
seals {roots}), and answers were frozen before the truths were opened. {count} answered the cases;
an answer is never replaced, even where a later version would do better.

How the truth differs from the reference model and the numerics of the diagnosis:

- Wave speeds ±2 or ±5 %, joint stiffness ±20 % or ×/÷ 1.5, receivers ±0.5 or ±1 m, random
  heterogeneity of 0.5 to 3 %, which the diagnosis never models: the larger ones twice in hard
  nulls. Densities ±2 %, firing times and clocks ±0.2 ms.
- Zones of constant strain, nine edges a wavelength, where the diagnosis has zones of 15 nodes.
- Effects by other laws: Barton–Bandis closure, slip by weakening, fill with a mass or by Maxwell,
  Rayleigh damping, fissures meshed one by one, soil with a gradient, damage with an edge, a
  quasi-static air wave, geophones in the time domain.
- Noise: quiet windows of geophones before hammer blows (see `examples/real/README.md`), peak over
  noise 5 to 40.

Intervals are 90 %, by 1000 bootstrap draws of cases. d′ is the length of an effect in units of
errors after calibration has absorbed what it can: below {visible:g} it cannot be detected, from
{clear:g} on it should be found. Parameters that were drawn in another sense than the parameter of
that name are left out of the intervals. The Brier score is Σ(p − y)²/2 over labels, no effect and
something unknown; no effect is the truth for effects that cannot be detected. Gains are of records
in which the effect is detectable, where the right model explains at least 2 % more of them. The
truth and the diagnosis share the program that solves the wave equation, and so its errors.

{table}

## By version

{programs}

## By label, single effects of d′ ≥ {clear:g}

{labels}

## By d′, single effects

{lengths}

## Risk and coverage

![Share of wrong answers against share of cases answered](../figures/blind.png)

Cases in which effects exceed the required evidence, named or not, are answered from the largest
lead down; risk is the share of those whose effects are not all true. At full coverage: {risk}.

A case takes {cpu} of one core and {runs} runs (medians).
"""
TARGETS = {
    "false alarm": ("on nulls, some physics claimed", "≤ 5 %"),
    "false alarm, hard": ("the same on hard nulls", ""),
    "false alarm, invisible": ("the same on effects of d′ < 4, which cannot be detected", ""),
    "null said NULL": ("nulls that are called NULL", ""),
    "precision when named": ("answers with names in which every name is right", "≥ 90 %"),
    "top-1": ("named, and right, of d′ ≥ 8", "≥ 75 %"),
    "top-2": ("named or in the class, of d′ ≥ 8", ""),
    "first in rank": ("best evidence of all single effects, of d′ ≥ 8", ""),
    "family": ("family right, of d′ ≥ 8", ""),
    "two: some": ("two effects: one or both named, nothing else", ""),
    "two: both": ("two effects: both named, nothing else", ""),
    "outside: unknown or partial": ("in no library: UNKNOWN or PARTIAL", ""),
    "outside: not named wrongly": ("in no library: no physics claimed", "≥ 85 %"),
    "poor: nothing named wrongly": ("one blast, one receiver: no wrong name, by rule", ""),
    "located": ("right place (planes within 20 m), of right names of d′ ≥ 8", ""),
    "90 % intervals hold": ("parameters within their 90 % intervals, mean of these", ""),
}


def write_page(found: dict):
    """Write docs/quality/blind_benchmark.md and its figure."""
    _figure(found["scores"]["curve"])
    s = found["scores"]
    risk = f"{s['curve'][-1]['risk']:.0%}" if s["curve"] else "nothing was found"
    text = WORDS.format(
        cases=s["cases"], seed=found["seed"], table=_table(s),
        roots=", ".join(f"`{root}`" for root in found["roots"]),
        kind="" if found["test"] else ", of development: no figure here is a proof",
        labels=_labels(s["by label"]), lengths=_lengths(s["by length"]), risk=risk,
        programs=_programs(found["programs"]), count=_count(found["programs"]),
        visible=found["visible"], clear=found["clear"], cpu=_middle(s["cpu_s"], " s"),
        runs=_middle(s["runs"], ""),
    )  # fmt: skip
    write_text(PAGE, reflow(text))


def _table(s):
    """Return the table of all scores."""
    lines = ["| | share | interval | of | target |", "|---|---|---|---|---|"]
    for key, (words, target) in TARGETS.items():
        one = s[key]
        if one["n"]:
            bound = f"; below {one['bound']:.0%} (95 %)" if "alarm" in key else ""
            span = f"{one['low']:.0%} to {one['high']:.0%}{bound}"
            lines.append(f"| {words} | {one['share']:.0%} | {span} | {one['n']} | {target} |")
    gain = s["gain"]
    if gain["n"]:
        span = f"{gain['low']:.2f} to {gain['high']:.2f}"
        lines.append(f"| gain on unseen records over the right model's, median, d′ ≥ 8 "
                     f"| {gain['median']:.2f} | {span} | {gain['n']} | ≥ 0.7 |")  # fmt: skip
    left = s["null leaves"]
    if left["n"]:
        lines.append(f"| size of residuals at the worst receiver or blast of nulls, median, 95 % "
                     f"| {left['0.5']:.1f} | {left['0.95']:.1f} | {left['n']} | |")  # fmt: skip
    off = s["planes off, m"]
    if off["n"]:
        span = f"{off['low']:.1f} to {off['high']:.1f} m"
        lines.append("| planes of missing joints, on the right axis, are off by, median "
                     f"| {off['median']:.1f} m | {span} | {off['n']} | |")  # fmt: skip
    for key in ("Brier", "calibration error"):
        if s[key] is not None:
            lines.append(f"| {key} | {s[key]:.2f} | | | |")
    lines.append(f"| crashes | {s['crashes']} | | {s['cases']} | |")
    return "\n".join(lines)


def _count(programs):
    """Say how many versions answered."""
    return "One version" if len(programs) == 1 else f"{len(programs)} versions of the program"


def _programs(table):
    """Return the table by program."""
    lines = ["| cases | nulls | physics claimed | names | all right | d′ ≥ 8 | named and right |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for one in table:
        lines.append(
            f"| {one['first']} to {one['last']} | {one['nulls']} | {one['alarms']} "
            f"| {one['named']} | {one['right']} | {one['clear']} | {one['found']} |"
        )
    return "\n".join(lines)


def _labels(table):
    """Return the table by label."""
    lines = ["| label | family | cases | d′ ≥ 8 | named | right | silent | wrongly | gain |",
             "|---|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for label, one in table.items():
        c, gain = one["clear"], one["gain"]["median"]
        gain = "" if gain is None else f"{gain:.2f}"
        lines.append(
            f"| `{label}` | {one['family']} | {one['cases']} | {c['n']} | {c['named']} "
            f"| {c['right']} | {c['silent']} | {one['wrongly named']} | {gain} |"
        )
    return "\n".join(lines)


def _lengths(strata):
    """Return the table by d'."""
    lines = ["| d′ | cases | named | right | right or in the class | silent |",
             "|---|---|---|---|---|---|"]  # fmt: skip
    for one in strata:
        span = f"{one['from']:g} to {one['to']:g}" if one["to"] else f"over {one['from']:g}"
        lines.append(f"| {span} | {one['n']} | {one['named']} | {one['right']} | {one['held']} "
                     f"| {one['silent']} |")  # fmt: skip
    return "\n".join(lines)


def _middle(one, unit):
    """Return a median in words."""
    return "nothing" if one["median"] is None else f"{one['median']:.0f}{unit}"


def _figure(curve):
    """Draw risk against coverage."""
    figure = Figure(figsize=(6.0, 3.6))
    axes = figure.subplots()
    axes.step([one["coverage"] for one in curve], [one["risk"] for one in curve], where="post")
    axes.set(xlim=(0.0, 1.0), ylim=(-0.02, 1.0), xlabel="share of cases answered",
             ylabel="share of these that is wrong")  # fmt: skip
    figure.tight_layout()
    figure.savefig(FIGURE, dpi=100)
