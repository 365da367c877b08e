"""What a diagnosed site predicts of records that no fit has used."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.blind.sites import HIDDEN
from benchmarks.blind.worlds import delayed
from pyblast.blasts.hole_effects import Pattern
from pyblast.diagnosis.case import case_of
from pyblast.diagnosis.effects import PredictionScene, changed_site, with_motion_effects
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.hypotheses import blast_and_hole
from pyblast.model.model import Receiver
from pyblast.project.project import Project, load_project, with_further
from pyblast.workflows.prediction import predict


def predictions(case, asked, values, effects, folder) -> dict:
    """Predict the further blast at the known receivers, all blasts at the further receiver.

    Returns
    -------
    dict
        ``blast`` (n_receivers, 3, n_samples) and ``receiver`` (n_blasts, 3, n_samples), m/s, as
        lists of few digits, and the names of ``blasts`` and ``receivers``.
    """
    blast, place = asked
    further = predict(case, blast, values, effects, folder)
    there = case.project.changed(receivers=(Receiver(HIDDEN, place),))
    project = changed_site(there, values, effects)
    assert project is not None  # or the further blast was refused
    hidden_case = replace(case, project=there, receivers=(HIDDEN,))
    simulation = simulation_of(hidden_case, folder, finer=True)
    changed = [_fired(project, name, effects) for name in case.blasts]
    hidden = np.stack([
        delayed(simulation.motion(one, [name])[0], -lead)
        for (one, lead), name in zip(changed, case.blasts, strict=True)
    ])  # fmt: skip
    everywhere = [effect for effect in effects if effect.target not in case.receivers]
    hidden = with_motion_effects(
        PredictionScene(simulation, hidden_case, project), hidden, everywhere
    )
    return {
        "blasts": list(case.blasts), "receivers": list(case.receivers),
        "blast": _short(further), "receiver": _short(hidden[:, 0]),
    }  # fmt: skip


def _fired(project, name, effects):
    """Return the project with what was found of the holes of a blast, all late by a lead in s."""
    blast = project.blasts[name]
    times, charge = blast.times, blast.charge
    exponent = project.config.blast.charge_exponent
    for effect in effects:
        if effect.hypothesis.on == "holes" and blast_and_hole(effect.target)[0] == name:
            pattern = Pattern(blast, np.zeros((1, 3)))
            change = effect.hypothesis.apply(pattern, effect.target, **effect.parameters)
            times = times + np.ravel(change.delay)
            charge = charge * np.ravel(change.scale) ** (1.0 / exponent)
    lead = max(0.0, -float(times.min()))
    changed = replace(blast, times=times + lead, charge=charge)
    return project.changed(blasts={**project.blasts, name: changed}), lead


def _short(motion):
    """Return motion as lists of numbers of few digits."""
    return [[[float(f"{v:.6g}") for v in row] for row in three] for three in motion]


def project_in(store: Path, name: str) -> Project:
    """Return the project of a case in a store, of its first blast with the further ones."""
    first, only = (store / "cases" / name / f"{blast}.toml" for blast in ("S1", "B2"))
    return with_further(load_project(first if first.is_file() else only))


def case_in(store: Path, name: str):
    """Return the case of a folder."""
    return case_of(project_in(store, name))
