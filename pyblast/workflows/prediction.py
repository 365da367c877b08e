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
    changed_site,
    of_all_holes,
    with_motion_effects,
)
from ..diagnosis.forward import hole_motion, simulation_of
from ..diagnosis.hypotheses import pattern_of
from ..errors import InputError
from ..inference.variation import (
    ENDS,
    Charges,
    DrawnFactor,
    Scatter,
    peaks_of_drawn_blasts,
    peaks_with_and_without,
)
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
        own, *linear = _holes(case, blast, values, effects, folder, finer=True)
        motion = motion + _scene_of_holes(*linear).change_by_holes(FURTHER, changes, own)
    received = PredictionScene(simulation, further, project)
    return with_motion_effects(received, motion, effects)[0]


class FurtherHoles(NamedTuple):
    """Holes of a further blast.

    Parameters
    ----------
    charges : Charges
        With the effects on holes of the site.
    learned : callable or None
        Draws those effects; see `peaks_of_drawn_blasts`.
    """

    charges: Charges
    learned: DrawnFactor | None = None


def predicted_holes(
    case: Case, blast: Blast, values, effects: Sequence[Effect] = (), covariance=(), folder=None
) -> FurtherHoles | None:
    """Predict the motion of each hole of a further blast on the mesh of the diagnosis.

    Parameters
    ----------
    case, blast, values, effects, folder
        As of `predict`.
    covariance : (n, n) array_like
        Posterior covariance of the standardised parameters of effects on holes of the site; they
        are taken for certain without.

    Returns
    -------
    FurtherHoles or None
        None where holes do not superpose; joints that close or slip by an effect move as elastic.
    """
    own, *linear = _holes(case, blast, values, effects, folder)
    if own is None:
        return None
    changes, learned = _changes_of_rows(case, blast, effects), None
    if changes is not None:
        scene = _scene_of_holes(*linear)
        own = scene.changed_holes(own, changes)
        if len(covariance):
            learned = drawn_rows(scene, pattern_of(case, blast), of_all_holes(effects), covariance)
    return FurtherHoles(Charges(own, blast.times - blast.times.min(), blast.centres), learned)


def drawn_rows(scene, pattern, rows, covariance):
    """Return the function that draws rows, as the factor on what they send as fitted."""
    parameters = [p for row in rows for p in row.hypothesis.parameters]
    known = np.array([value for row in rows for (value,) in row.values])
    middle = np.array([p.standardised(x) for p, x in zip(parameters, known, strict=True)])
    root = np.linalg.cholesky(np.asarray(covariance) + 1e-12 * np.eye(len(middle)))

    def change(values):
        each = iter(values)
        return _together(
            pattern, rows, [{p.name: next(each) for p in row.hypothesis.parameters} for row in rows]
        )

    fitted = change(known)

    def drawn(rng, omega):
        values = (
            np.clip(p.value(x), p.low, p.high) for p, x in zip(
                parameters, middle + root @ rng.standard_normal(len(middle)), strict=True
            )
        )  # fmt: skip
        return scene.factor(change(values).over(fitted), omega)

    return drawn


def _further(case, blast, values, effects, folder, finer=False):
    """Return simulation, case and project of a further blast on the site of a diagnosis."""
    answer = changed_site(case.project, values, effects)
    if answer is None:
        named = ", ".join(f"{effect.label} {effect.target}".rstrip() for effect in effects)
        raise InputError(f"{named}: impossible in this project")
    reference, project = (with_blast(each, FURTHER, blast) for each in (case.project, answer))
    further = replace(case, project=reference, blasts=(FURTHER,))
    return simulation_of(further, folder, finer=finer), further, project


def _holes(case, blast, values, effects, folder, finer=False):
    """Return the motion of each hole of a further blast, with what `_further` returns.

    Without effects under which holes do not superpose: a joint that closes or slips. None in place
    of the motion where holes do not superpose in the project itself.
    """
    linear = [effect for effect in effects if effect.hypothesis.linear]
    simulation, further, project = _further(case, blast, values, linear, folder, finer)
    own = hole_motion(simulation, further, project).get(FURTHER)
    return own, simulation, further, project


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
    rows = of_all_holes(effects)
    if not rows:
        return None
    return _together(pattern_of(case, blast), rows, [row.parameters for row in rows])


def _together(pattern, rows, parameters):
    """Return what rows with parameters, a dict for each, change of the holes of a pattern."""
    return together([
        row.hypothesis.apply(pattern, row.target, **own)
        for row, own in zip(rows, parameters, strict=True)
    ])  # fmt: skip


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


def bands_of_peaks(case: Case, motion, holes: FurtherHoles, level: float, share: float):
    """Return the largest peak of a component at each receiver, with its 90 % bands."""
    priors, peaks = case.project.config.priors, np.abs(motion).max(axis=(1, 2))
    scatter = Scatter(level, 1e-3 * priors.firing_ms, 1e-2 * priors.amplitude_percent, share)
    (planned,) = peaks_of_drawn_blasts(holes.charges, case.band, Scatter(0.0, 0.0), 1).max(axis=-1)
    drawn = peaks_with_and_without(holes.charges, case.band, scatter, holes.learned).max(axis=-1)
    low, high = peaks / planned * np.quantile(drawn, ENDS, axis=1)
    return {
        name: PeakBand(*map(float, each))
        for name, *each in zip(case.receivers, peaks, low[0], high[0], low[1], high[1], strict=True)
    }
