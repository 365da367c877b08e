"""Prediction of a further blast by the site of a diagnosis, and the band of its peaks."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..blasts.blast import Blast
from ..blasts.hole_effects import together
from ..diagnosis.calibration import Baseline
from ..diagnosis.case import Case
from ..diagnosis.effects import (
    Effect,
    PredictionScene,
    Scene,
    acting_on,
    changed_site,
    with_motion_effects,
)
from ..diagnosis.forward import hole_motion, simulation_of
from ..diagnosis.hypotheses import pattern_of
from ..errors import InputError
from ..inference.variation import DRAWS, ENDS, Charges, Scatter, peaks_of_drawn_blasts
from ..project.places import NEAR, resolved_receivers
from ..project.project import Project

FURTHER = "further blast"


class PeakBand(NamedTuple):
    """Largest peak of a component at a receiver, m/s, and the central 90 % of such blasts.

    Parameters
    ----------
    peak : float
        Of the prediction itself.
    low, high : float
        With holes that vary.
    low_alike, high_alike : float
        If all holes radiated as their charge says.
    """

    peak: float
    low: float
    high: float
    low_alike: float
    high_alike: float


class Prediction(NamedTuple):
    """Prediction of a further blast, beside the motion that is written.

    Parameters
    ----------
    low_pass : float or None, Hz
        Corner of the low-pass of what enters, which a record goes through, too, before it is set
        beside the prediction (`Seismogram.filtered_like`).
    holes_percent : float
        Variation from hole to hole.
    source : str
        What that is known by.
    bands : dict of str to PeakBand
        By receiver; empty where nothing fires by hole.
    """

    low_pass: float | None
    holes_percent: float
    source: str
    bands: dict[str, PeakBand]


def predict(
    case: Case,
    blast: Blast,
    values,
    effects: Sequence[Effect] = (),
    folder=None,
) -> np.ndarray:
    """Predict the motion of a further blast at the receivers of a case, by one run.

    Parameters
    ----------
    case : Case
    blast : Blast
    values : (n_calibrated,) float
        Values of a diagnosis.
    effects : sequence of Effect
        Effects on the holes of a blast are ignored: they belong to another one. Those of all holes
        of the site are applied, by the motion of each.
    folder : path, optional
        Folder of stored runs.

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s
        From the first hole on.

    Raises
    ------
    InputError
        If an effect is impossible in this project.
    SolverError
        If the run fails.
    """
    simulation, further, project = _further(case, blast, values, effects, folder, finer=True)
    motion, changes = simulation.motion(project), _changes_of_rows(case, blast, effects)
    if changes is not None:
        own = hole_motion(simulation, further, project)[FURTHER]
        scene = _scene_of_holes(simulation, further, project)
        motion = motion + scene.change_by_holes(FURTHER, changes, own)
    received = PredictionScene(simulation, further, project)
    return with_motion_effects(received, motion, effects)[0]


def predicted_charges(
    case: Case, blast: Blast, values, effects: Sequence[Effect] = (), folder=None
) -> Charges | None:
    """Predict the motion of each hole of a further blast on the mesh of the diagnosis.

    Parameters
    ----------
    case, blast, values, effects, folder
        As of `predict`.

    Returns
    -------
    Charges or None
        With the effects on holes of the site; None where holes do not superpose.
    """
    simulation, further, project = _further(case, blast, values, effects, folder)
    own = hole_motion(simulation, further, project).get(FURTHER)
    if own is None:
        return None
    changes = _changes_of_rows(case, blast, effects)
    if changes is not None:
        own = _scene_of_holes(simulation, further, project).changed_holes(own, changes)
    return Charges(own, blast.times - blast.times.min(), blast.centres)


def _further(case, blast, values, effects, folder, finer=False):
    """Return simulation, case and project of a further blast on the site of a diagnosis."""
    answer = changed_site(case.project, values, effects)
    if answer is None:
        named = ", ".join(f"{effect.label} {effect.target}".rstrip() for effect in effects)
        raise InputError(f"{named}: impossible in this project")
    reference, project = (with_blast(each, FURTHER, blast) for each in (case.project, answer))
    further = replace(case, project=reference, blasts=(FURTHER,))
    return simulation_of(further, folder, finer=finer), further, project


def _scene_of_holes(simulation, further, project):
    """Return the scene of a further blast on which changes of its holes act; nothing is run."""
    motion = np.zeros((1, *further.motion.shape[1:]))
    baseline = Baseline(
        further, (), np.zeros(0), np.zeros((0, 0)), project, motion,
        np.zeros((0, *motion.shape)), motion, motion, np.ones(motion.shape[:2]),
    )  # fmt: skip
    return Scene(simulation, baseline, {})


def _changes_of_rows(case, blast, effects):
    """Return what effects on the holes of the site change of a further blast; None without."""
    rows = [effect for effect in acting_on(effects, "holes") if not effect.target]
    pattern = pattern_of(case, blast)
    each = [e.hypothesis.apply(pattern, e.target, **e.parameters) for e in rows]
    return together(each) if each else None


def at_further(case: Case, blast: Blast) -> Case:
    """Return a case with the receivers at which a further blast is predicted.

    They are those of the case and those that it leaves out near its own holes, where they stand
    far enough from those of the further blast. Gains and sources that records show are theirs.
    """
    table = case.project.config.diagnosis
    shown = table is not None and (table.source_s is not None or table.trigger_s is not None)
    near = [name for name, reason in case.unused.items() if reason == NEAR]
    if not near or shown or case.gain is not None:
        return case
    far = resolved_receivers(
        with_blast(case.project, FURTHER, blast), (*case.receivers, *near), injected=False
    )
    chosen = {*case.receivers, *far}
    names = tuple(r.name for r in case.project.stations if r.name in chosen)
    return replace(case, receivers=names)


def with_blast(project: Project, name: str, blast: Blast) -> Project:
    """Return a project with a single blast in place of its own."""
    shot = replace(project.held_shots[0], name=name, fired=blast)
    survey = replace(project.survey, shots=(shot,), recorded={})
    return replace(project, survey=survey)


def bands_of_peaks(case, motion, charges, level, share):
    """Return the largest peak of a component at each receiver, with its 90 % bands."""
    priors, peaks = case.project.config.priors, np.abs(motion).max(axis=(1, 2))
    rest = 1e-3 * priors.firing_ms, 1e-2 * priors.amplitude_percent, share
    planned, with_holes, without = (
        peaks_of_drawn_blasts(charges, case.band, scatter, n_draws).max(axis=-1)
        for scatter, n_draws in (
            (Scatter(0.0, 0.0), 1), (Scatter(level, *rest), DRAWS), (Scatter(0.0, *rest), DRAWS)
        )
    )  # fmt: skip
    ends = [peaks / planned[0] * np.quantile(each, ENDS, axis=0) for each in (with_holes, without)]
    return {
        name: PeakBand(float(peak), *own.tolist())
        for name, peak, own in zip(case.receivers, peaks, np.concatenate(ends).T, strict=True)
    }
