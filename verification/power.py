"""Power of the scores: at which energy an effect on a site of an independent program is named.

    ./dev power [--minutes 20] [--again] [--keep FOLDER OF RUNS] [site ...]

For sites in ``PYBLAST_SITES``, with what their truths conceal. Records are drawn: the reference
simulated by the independent program, so that the numerical error of pyblast is in each draw, with
nuisances within the ranges of the truths and noise; then the effect of the truth is added at a few
strengths. Nothing is fitted: a draw is named if the label that scores most is above the threshold
of the site and leads by `LEAD`. Of the strongest, the vetoes are asked too: sources anywhere and a
body at one place explain more (`OPEN_SET`, `body_explains_more`), with and without the label in the
library. The right label has the evidence of the true change, as a good fit has; another one
`FITTED` times its score. Effects by runs are asked in the order of what they decide for their
price, for `RUNS_S` of processor; a row lists what was asked, and a right label that was not scores
as its true change. ``verification/power.json`` has a row for each site; a study that was stopped
goes on.
"""

import os
import sys
import tempfile
import time
import tomllib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import obspy
from scipy import fft
from scipy.special import logsumexp

from pyblast.diagnosis.case import Case, case_of
from pyblast.diagnosis.decision import sources_anywhere
from pyblast.diagnosis.error import with_calibrated
from pyblast.diagnosis.forward import quarter_wave
from pyblast.diagnosis.scores import SiteScores, main_blasts, members_of, of_speeds
from pyblast.diagnosis.search import IN_ROCK
from pyblast.diagnosis.thresholds import LEAD, OPEN_SET
from pyblast.inference.error_model import Change
from pyblast.inference.location import FREE, TOGETHER, Located, directions_of
from pyblast.model.material import Material
from pyblast.workflows.diagnose import prepared, read_case

from .rows import each_row, options

ROOT = Path(__file__).resolve().parents[1]
PATH = ROOT / "verification" / "power.json"
SITES = Path(os.environ.get("PYBLAST_SITES", ROOT.parent / "shared" / "sites"))
NAMES = ("02", "07", "14", "16", "20", "21", "04", "17", "06", "08", "03", "01", "13", "15")
STRENGTHS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
DRAWS, POWER = 100, 0.8
RUNS_S = 60.0  # of processor, after which no further effect is run
VETOED, ASKED = 3, 30  # strongest, and draws of each, of which the vetoes are asked
FITTED = 1.5  # evidence of a fit over its score: sites 02 and 07, 1.2 to 1.5
RESOLVED = 8.0  # d' at which the bound is taken
# Half ranges of the truths by group of nuisances, in the units of [priors].
RANGES = {"amplitude": 2.0, "receiver": 0.5, "clock": 0.2, "firing": 0.2}
SPEED, STIFFNESS = 0.015, 0.05  # of the calibrated values


def row(site, folder):
    """Return the row of one site."""
    case = case_of(read_case(SITES / f"case-{site}" / "B2.toml"))
    scene, _ = prepared(case, folder)
    ends = time.process_time() + RUNS_S
    members = members_of(scene, runs_left=lambda: time.process_time() < ends)
    scene.error = with_calibrated(scene.error, of_speeds(scene, members))
    scores = SiteScores(scene, tuple(members), 1)
    truth = tomllib.loads((SITES / "truth" / f"case-{site}" / "truth.toml").read_text())
    label = truth["effects"][0]
    null, effect = _null_and_effect(scene, site, truth)
    drawn = null + _errors(scores, np.random.default_rng(5))
    at, recorded = list(main_blasts(case)), case.band.project(case.motion)
    share = 100.0 * np.sum(effect[at] ** 2) / np.sum(recorded[at] ** 2)
    alarms = _by_class(scores, drawn)[1].max(axis=0)
    result = {
        "effect": label, "members": len(scores.members), "runs": scene.simulation.runs,
        "asked": sorted({each.label for each in scores.members}),
        "thresholds": {k: round(v, 1) for k, v in scores.thresholds.items()},
        "null_draws": {"alarms": float(np.mean(alarms > scores.threshold)),
                       "largest": round(float(alarms.max()), 1)},
    }  # fmt: skip
    if label == "null":
        return result
    with_effect = np.concatenate([drawn + strength * effect for strength in STRENGTHS])
    labels, values = _by_class(scores, with_effect)
    of_truth = scores.of([Change(effect[None])], at, with_effect).log_bayes
    if label not in labels:
        labels, values = [*labels, label], np.vstack([values, of_truth])
    named = np.array(_named(scores, labels, values)).reshape(len(STRENGTHS), DRAWS)
    others = _named(scores, *_without(labels, values, label))
    others = np.array(others).reshape(len(STRENGTHS), DRAWS)
    rows = {
        f"{share * strength**2:.3g}": {
            "alarm": _share(named[k], lambda name: name is not None),
            "right": _share(named[k], lambda name: name == label),
            "wrong": _share(named[k], lambda name: name not in (label, "", None)),
            "wrong_without_its_class": _share(others[k], lambda name: name not in ("", None)),
        }
        for k, strength in enumerate(STRENGTHS)
    }
    strongest = [DRAWS * k + n for k in range(len(rows))[-VETOED:] for n in range(ASKED)]
    free, body = _of_places(scores, with_effect[strongest])
    for k, own in enumerate(list(rows.values())[-VETOED:]):
        part, first = slice(ASKED * k, ASKED * (k + 1)), len(rows) - VETOED + k
        own |= _after_vetoes(
            (free[part], body[part]), (labels, values[:, strongest][:, part]),
            of_truth[0, strongest][part],
            named[first], others[first], label,
        )  # fmt: skip
    length = float(scores.of([Change(effect[None])], at, 0.0 * effect[None]).length[0][0, 0])
    return result | {
        "by_energy_percent": rows,
        "named_at_percent": _crossing({float(k): v["right"] for k, v in rows.items()}),
        "bound_percent": float(f"{share * RESOLVED**2 / length:.3g}"),
    }


def _after_vetoes(places, known, true, named, others, label):
    """Return what the vetoes leave of the right names, and of the wrong ones without their class.

    Parameters
    ----------
    places : (free, body)
        Evidence of sources anywhere, and of one body, (n,) each.
    known : (labels, values)
        Scores of each label, (n_labels, n).
    true : (n,) float64
        Evidence of the true change.
    named, others : list of str
        With the label in the library, and without it.
    label : str
    """
    labels, values = known
    evidence = {each: FITTED * own for each, own in zip(labels, values, strict=True)}
    evidence[label] = np.maximum(true, values[labels.index(label)])
    right = [n for n, _ in enumerate(true) if named[n] == label]
    wrong = [n for n, _ in enumerate(true) if others[n] not in ("", None)]
    costs = [_vetoes(places, evidence[label], label, n) for n in right]
    left = [n for n in wrong if not any(_vetoes(places, evidence[others[n]], others[n], n))]
    return {
        "right_asked": len(right),
        "cost_of_open_set": round(sum(own[0] for own in costs) / max(len(right), 1), 2),
        "cost_of_body": round(sum(own[1] for own in costs) / max(len(right), 1), 2),
        "wrong_without_after_vetoes": round(len(left) / len(true), 2),
        "these_names": dict(Counter(others[n] for n in left)),
    }


def _vetoes(places, evidence, name, n):
    """Tell whether each veto stands against the name of a draw: open set, body."""
    free, body = places[0][n], places[1][n]
    return free > evidence[n] / OPEN_SET, name != "body" and body > evidence[n] + LEAD


def _of_places(scores, residuals):
    """Return the evidence of sources anywhere, and of one body, of each residual, (n,) each."""
    scene, main = scores.scene, main_blasts(scores.scene.case)
    everywhere = sources_anywhere(scene)
    changes = directions_of(everywhere, np.sqrt(np.mean(residuals**2, axis=0)))
    free = scores.of([Change(sigma * changes) for sigma in FREE], main, residuals).log_bayes
    rock = everywhere[0][0]
    bodies = rock.spread(quarter_wave(scene.baseline.project, scene.case)).shapes
    bayes = np.concatenate([
        scores.of(
            [Change(IN_ROCK * own.astype(float)) for own in bodies[first : first + TOGETHER]],
            main, residuals,
        ).log_bayes
        for first in range(0, len(bodies), TOGETHER)
    ])  # fmt: skip
    kinds = np.zeros((len(bodies), bodies.shape[1]))
    body = [Located(rock, own, kinds, len(main)).score for own in bayes.T]
    return logsumexp(free, axis=0) - np.log(len(FREE)), np.array(body)


def _share(names, wanted):
    """Return the share of names that are wanted."""
    return round(float(np.mean([wanted(name) for name in names])), 2)


def _crossing(power):
    """Return the energy at which a power first stays above `POWER`, between the tried ones."""
    energies = np.array(sorted(power))
    values = np.array([power[energy] for energy in energies])
    below = np.flatnonzero(values < POWER)
    if len(below) == 0 or below[-1] == len(values) - 1:
        return float(energies[0]) if len(below) == 0 else None
    k = below[-1]
    part = (POWER - values[k]) / (values[k + 1] - values[k])
    return float(f"{energies[k] * (energies[k + 1] / energies[k]) ** part:.3g}")


def _by_class(scores, residuals):
    """Return the labels and their scores (n_labels, n_data)."""
    by_class = scores.by_class(scores.log_bayes(residuals))
    return list(by_class), np.array([*by_class.values()])


def _without(labels, values, label):
    """Return labels and their scores without those of one."""
    others = [k for k, each in enumerate(labels) if each != label]
    return [labels[k] for k in others], values[others]


def _named(scores, labels, values):
    """Return the label that each residual names; empty without a lead, None below the threshold."""
    best, second = np.argmax(values, axis=0), np.sort(values, axis=0)[-2]
    names = []
    for n, k in enumerate(best):
        name = labels[k] if values[k, n] - second[n] >= LEAD else ""
        names.append(name if values[k, n] >= scores.threshold else None)
    return names


def _null_and_effect(scene, site, truth):
    """Return the residual of the reference without noise, and the change by the effect."""
    case, project = scene.case, scene.case.band.project
    reference, clean = (project(_simulated(case, site, kind)) for kind in ("believed", "clean"))
    nuisances = project(_nuisances(scene, truth["nuisance"]))
    null, effect = reference - project(scene.baseline.reference), clean - reference - nuisances
    for part in (null, effect):  # a blast that the truth lacks shows neither
        part[~reference.any(axis=(1, 2, 3))] = 0.0
    return null, effect


def _simulated(case: Case, site, kind):
    """Return the motion of the independent program at the instants of records, zero without."""
    motion = np.zeros(case.motion.shape)
    folder = SITES / "truth" / f"case-{site}"
    for b, name in enumerate(case.blasts):
        path = folder / f"{kind}_{name[-2:]}.mseed"
        if not path.is_file():
            continue
        traces = obspy.read(path, format="MSEED")
        table = {(t.stats.station, t.stats.channel[-1]): t.data for t in traces}
        first = round(0.25 / case.dt)
        for r, receiver in enumerate(case.receivers):
            for c, axis in enumerate("ENZ"):
                data = table[receiver, axis][first : first + case.n_samples]
                motion[b, r, c, : len(data)] = data
    return motion


def _nuisances(scene, truth):
    """Return the change of the reference by the nuisances of a truth, m/s."""
    case, baseline = scene.case, scene.baseline
    project, mats = case.project, {}
    for (name, rock), (density, cp, cs) in zip(
        project.materials.items(), truth["material_factors_rho_vp_vs"], strict=False
    ):
        faster = Material.from_speeds(rock.density * density, rock.cp * cp, rock.cs * cs)
        mats[name] = replace(faster, law=rock.law)
    joints = [
        replace(joint, properties={**joint.properties, "kn": kn * joint.properties["kn"],
                                   "ks": ks * joint.properties["ks"]})
        for joint, (kn, ks) in zip(project.joints, truth["joint_factors_kn_ks"], strict=False)
    ]  # fmt: skip
    changed = project.changed(materials={**project.materials, **mats}, joints=joints)
    change = scene.simulation.motion(changed) - (baseline.reference - baseline.correction)
    motion = baseline.reference + change
    for r, name in enumerate(case.receivers):
        number = int(name[1:]) - 1
        east, north, _ = truth["receiver_offsets_m"][number]
        late = truth["receiver_clock_s"][number] * np.gradient(motion[:, r], case.dt, axis=-1)
        change[:, r] += scene.surroundings.change(r, east, north) - late
    for b, name in enumerate(case.blasts):
        change[b] += _late(scene, name, truth["hole_time_s"][name[-2:]])
    return change


def _late(scene, blast, seconds):
    """Return the change of a blast whose holes are late."""
    case, holes = scene.case, scene.holes.get(blast)
    if holes is None:
        return 0.0
    times = case.project.blasts[blast].times
    size = fft.next_fast_len(3 * case.n_samples, real=True)
    turns = 2j * np.pi * fft.rfftfreq(size, case.dt)
    spectrum = sum(
        fft.rfft(hole, size) * np.exp(-turns * time) * (np.exp(-turns * shift) - 1.0)
        for hole, time, shift in zip(holes, times, seconds, strict=True)
    )
    return fft.irfft(spectrum, size)[..., : case.n_samples]


def _errors(scores: SiteScores, rng):
    """Return draws of nuisances within the ranges of the truths, and of noise."""
    nuisances, case, baseline = scores.error.nuisances, scores.scene.case, scores.scene.baseline
    priors = case.project.config.priors
    deviation = {
        "amplitude": priors.amplitude_percent, "receiver": priors.receiver_m,
        "clock": priors.clock_ms, "firing": priors.firing_ms,
    }  # fmt: skip
    half, calibrated = np.zeros(len(nuisances.groups)), 0
    for n, group in enumerate(nuisances.groups):
        if group == "calibrated" and calibrated < len(baseline.parameters):
            speed = baseline.parameters[calibrated].name[-2:] in ("cp", "cs")
            half[n] = (SPEED if speed else STIFFNESS) / baseline.sigma[calibrated]
            calibrated += 1
        elif group in RANGES:
            half[n] = RANGES[group] / deviation[group]
    drawn = np.tensordot(rng.uniform(-half, half, (DRAWS, len(half))), nuisances.columns, 1)
    return drawn + scores.error.blocks.draws(rng, DRAWS, 0.0, 0.0).reshape(drawn.shape)


def main(arguments):
    """Compute the rows that are missing."""
    names, limits = options(arguments)
    if not (SITES / "truth").is_dir():
        print(f"power: skipped, no sites in {SITES}")
        return
    kept = None
    if "--keep" in names:
        at = names.index("--keep")
        kept = names[at + 1]
        del names[at : at + 2]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(kept or temporary)
        each_row(PATH, names or NAMES, lambda name: row(name, folder / name), **limits)


if __name__ == "__main__":
    main(sys.argv[1:])
