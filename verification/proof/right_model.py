"""What the right model would have reached: the ceiling of gains, and how long effects are."""

from pathlib import Path

import numpy as np
from scipy import signal

from benchmarks.blind.case_files import read_asked
from benchmarks.blind.sites import BAND, BEFORE, DT, FURTHER
from pyblast.diagnosis.calibration import calibrate
from pyblast.diagnosis.effects import Scene, starting_effects
from pyblast.diagnosis.error import with_calibrated
from pyblast.diagnosis.fitting import fit
from pyblast.diagnosis.forward import hole_motion, simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY, blast_and_hole
from pyblast.inference.error_model import Change

from .predictions import case_in, predictions


def right(store: Path, name: str, truth: dict) -> dict:
    """Fit the right effects, started where they are, to the records of a case.

    Returns
    -------
    dict
        ``length``: d', the length of the effects in units of errors after calibration has taken
        what it can; ``predicted`` as of the answer, None where an effect is in no library.
    """
    case = case_in(store, name)
    runs = store / "runs" / name
    simulation = simulation_of(case, runs)
    baseline = calibrate(case, simulation, simulation_of(case, runs, finer=True))
    motion = motion_of(store, name)
    scene = Scene(simulation, baseline, hole_motion(simulation, case, baseline.project))
    found = {"length": length(scene, motion), "predicted": None}
    hidden, *others = truth["effects"]
    fitted = None if others else _best_fit(scene, hidden)
    if fitted is not None:
        found["predicted"] = predictions(
            case, read_asked(store / "asked" / name), fitted.values, fitted.effects, runs
        )
    return found


def motion_of(store: Path, name: str) -> dict:
    """Return the true motion: ``clean`` and ``without`` effects, by blast, from hole one on."""
    with np.load(store / "truth" / name / "motion.npz", allow_pickle=False) as arrays:
        return {key: arrays[key][..., BEFORE:].astype(float) for key in arrays.files}


def length(scene, motion) -> float:
    """Return d' of all effects of a case together."""
    case = scene.case
    names = [r.name for r in case.project.receivers]
    at = [names.index(name) for name in case.receivers]
    change = np.stack(
        [(motion[f"clean {b}"] - motion[f"without {b}"])[at] for b in case.blasts]
    )  # fmt: skip
    shape = scene.seen(change[..., : case.n_samples])
    columns = scene.seen(scene.baseline.slopes * scene.baseline.sigma[:, None, None, None, None])
    residual = case.band.project(case.residual(scene.baseline.motion))
    scores = with_calibrated(scene.error, columns).scores(residual[None], [Change(shape[None])])
    return float(np.sqrt(scores.length[0][0, 0]))


def _best_fit(scene, hidden):
    """Return the fit of most evidence of the effect that is hidden, or None."""
    fits = []
    for hypothesis in LIBRARY.values():
        if hypothesis.label != hidden["label"]:
            continue
        on_site = hypothesis.on == "site"
        home = np.zeros(len(scene.baseline.values)) if on_site else scene.baseline.values
        for target in _there(hypothesis.targets(scene.case), hidden["target"]):
            for one in starting_effects(hypothesis, target, scene):
                fitted = fit(scene, (one,), home)
                if fitted is not None:
                    fits.append(fitted)
    return max(fits, key=lambda each: each.log_evidence, default=None)


def _there(targets, wanted):
    """Return those targets that mean a true one: the same, a hole of it, or the nearest plane."""
    if "=" not in wanted:
        return [target for target in targets if blast_and_hole(target)[0] == wanted]
    axis, place = wanted.split("=")
    same = [target for target in targets if target.startswith(f"{axis}=")]
    return sorted(same, key=lambda target: abs(float(target[2:]) - float(place)))[:1]


def reductions(motion, told) -> dict:
    """Return the shares of the energy of unseen records that are predicted, means over records.

    Parameters
    ----------
    motion : dict
        As of `motion_of`.
    told : dict
        As of `predicted`, with the names of its blasts and receivers.
    """
    band = signal.butter(3, BAND, "band", fs=1.0 / DT, output="sos")

    def explained(true, said):
        n = min(true.shape[-1], said.shape[-1])
        wrong = true[..., :n] - said[..., :n]
        true, left = (signal.sosfiltfilt(band, v) for v in (true[..., :n], wrong))
        return 1.0 - np.sum(left**2, axis=(-2, -1)) / np.sum(true**2, axis=(-2, -1))

    known, blasts = told["receivers"], told["blasts"]
    true = motion[f"clean {FURTHER}"]
    further = explained(true[: len(known)], np.array(told["blast"]))
    hidden = np.stack([motion[f"clean {b}"][-1] for b in blasts])
    return {
        "blasts": float(np.mean(further)),
        "receivers": float(np.mean(explained(hidden, np.array(told["receiver"])))),
    }
