"""Power of the scores: at which energy an effect on a site of an independent program is named.

    ./dev power [--minutes 20] [--again] [--keep FOLDER OF RUNS] [site ...]

For sites in ``PYBLAST_SITES``, with what their truths conceal. Records are drawn: the reference
simulated by the independent program, so that the numerical error of pyblast is in each draw, with
nuisances within the ranges of the truths and noise; then the effect of the truth is added at a few
strengths. Nothing is fitted: a draw is named if the label that scores most is above the threshold
of the site and leads by `LEAD`. ``verification/power.json`` has a row for each site; a study that
was stopped goes on.
"""

import os
import sys
import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import obspy
from scipy import fft

from pyblast.diagnosis.case import Case, case_of
from pyblast.diagnosis.error import with_calibrated
from pyblast.diagnosis.scores import SiteScores, main_blasts, members_of, of_speeds
from pyblast.diagnosis.thresholds import LEAD
from pyblast.inference.error_model import Change
from pyblast.model.material import Material
from pyblast.workflows.diagnose import prepared, read_case

from .rows import each_row, options

ROOT = Path(__file__).resolve().parents[1]
PATH = ROOT / "verification" / "power.json"
SITES = Path(os.environ.get("PYBLAST_SITES", ROOT.parent / "shared" / "sites"))
NAMES = ("04", "07", "02", "20", "17", "06", "08", "03", "01", "13", "15")
STRENGTHS = (1 / 32, 1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
DRAWS, POWER = 100, 0.8
RESOLVED = 8.0  # d' at which the bound is taken
# Half ranges of the truths by group of nuisances, in the units of [priors].
RANGES = {"amplitude": 2.0, "receiver": 0.5, "clock": 0.2, "firing": 0.2}
SPEED, STIFFNESS = 0.015, 0.05  # of the calibrated values


def row(site, folder):
    """Return the row of one site."""
    case = case_of(read_case(SITES / f"case-{site}" / "B2.toml"))
    scene, _ = prepared(case, folder)
    members = members_of(scene)
    scene.error = with_calibrated(scene.error, of_speeds(scene, members))
    scores = SiteScores(scene, tuple(members), 1)
    truth = tomllib.loads((SITES / "truth" / f"case-{site}" / "truth.toml").read_text())
    label = truth["effects"][0]
    null, effect = _null_and_effect(scene, site, truth)
    drawn = null + _errors(scores, np.random.default_rng(5))
    at, recorded = list(main_blasts(case)), case.band.project(case.motion)
    share = 100.0 * np.sum(effect[at] ** 2) / np.sum(recorded[at] ** 2)
    alarms = _largest(scores, drawn)
    result = {
        "effect": label, "members": len(scores.members), "runs": scene.simulation.runs,
        "thresholds": {k: round(v, 1) for k, v in scores.thresholds.items()},
        "null_draws": {"alarms": float(np.mean(alarms > scores.threshold)),
                       "largest": round(float(alarms.max()), 1)},
    }  # fmt: skip
    if label == "null":
        return result
    rows = {}
    for strength in STRENGTHS:
        named = _named(scores, drawn + strength * effect)
        rows[f"{share * strength**2:.3g}"] = {
            "alarm": _share(named, lambda name: name is not None),
            "right": _share(named, lambda name: name == label),
            "wrong": _share(named, lambda name: name not in (label, "", None)),
            "wrong_without_its_class": _share(
                _named(scores, drawn + strength * effect, without=label),
                lambda name: name not in ("", None),
            ),
        }
    length = float(scores.of([Change(effect[None])], at, 0.0 * effect[None]).length[0][0, 0])
    return result | {
        "by_energy_percent": rows,
        "named_at_percent": _crossing({float(k): v["right"] for k, v in rows.items()}),
        "bound_percent": float(f"{share * RESOLVED**2 / length:.3g}"),
    }


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


def _by_class(scores, residuals, without=None):
    """Return the labels and their scores (n_labels, n_data)."""
    by_class = scores.by_class(scores.log_bayes(residuals))
    labels = [label for label in by_class if label != without]
    return labels, np.array([by_class[label] for label in labels])


def _largest(scores, residuals):
    """Return the largest score of each residual."""
    return _by_class(scores, residuals)[1].max(axis=0)


def _named(scores, residuals, without=None):
    """Return the label that each residual names; empty without a lead, None below the threshold."""
    labels, values = _by_class(scores, residuals, without)
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
