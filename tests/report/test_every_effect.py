"""Every effect of the library at every target on every ground can be stated, ranked and drawn."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
from grounds import GROUNDS, case_on

import pyblast.diagnosis.library  # noqa: F401  fills the library
from pyblast.config.ground import FaultConfig
from pyblast.diagnosis.calibration import Baseline
from pyblast.diagnosis.cross_validation import CrossValidation
from pyblast.diagnosis.decision import Decision
from pyblast.diagnosis.effects import Effect, Scene
from pyblast.diagnosis.error import usual_energy
from pyblast.diagnosis.fitting import Fit
from pyblast.diagnosis.forward import simulation_of
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.library import geometry
from pyblast.diagnosis.search import Search
from pyblast.diagnosis.summary import diagnosis_lines, summarise_diagnosis
from pyblast.inference.error_model import Posterior
from pyblast.inference.fit import FitState
from pyblast.project.uncertain_ground import factors_of
from pyblast.report.diagnosis import (
    claims,
    hole_rows,
    parameter_rows,
    ranking_rows,
    render_diagnosis,
)
from pyblast.report.diagnosis_figures import drawn_planes, fault_outline

NOTES = {
    "case": "pit", "runs": 11, "wall_s": 2.5, "kept_runs": 0, "kept_s": 0.0, "seed": 1,
    "minutes_allowed": 4.0, "minutes_spent": 1.0, "finished": True, "provenance": {"pyblast": "0"},
}  # fmt: skip
BOX = np.array([[0.0, 100.0], [0.0, 80.0], [-60.0, 0.0]])


@dataclass
class Answer:
    """What the report needs of a diagnosis."""

    search: Search
    decision: Decision


def effects_on(case):
    """Yield an effect of each hypothesis at each of its targets."""
    for entry in LIBRARY.values():
        for target in entry.targets(case):
            own = case.project.blasts.get(target)
            n = 1 if own is None else len(own.times)
            yield Effect(
                entry.name,
                target,
                tuple((p.starts[0],) * (n if p.per_hole else 1) for p in entry.parameters),
            )


def scene_on(ground):
    """Return the scene of a ground as if its records had been simulated."""
    case = case_on(ground)
    parameters = factors_of(case.project)
    n, motion = len(parameters), case.motion
    baseline = Baseline(
        case, parameters, np.zeros(n), np.eye(n), case.project, motion,
        np.zeros((n, *motion.shape)), motion, np.zeros_like(motion), usual_energy(case),
    )  # fmt: skip
    return Scene(simulation_of(case), baseline, {})


def fitted(scene, *effects):
    """Return a fit of effects at their values."""
    n, motion = len(scene.baseline.values), scene.case.motion
    x = [
        parameter.standardised(value)
        for effect in effects
        for parameter, values in zip(effect.hypothesis.parameters, effect.values, strict=True)
        for value in values
    ]
    x = np.array([0.0] * n + x)
    own, size = FitState(x, motion, np.zeros((len(x), *motion.shape))), np.ones(len(x))
    posterior = Posterior(
        x, np.diag(size), size, 0.01, 20.0 * bool(effects), {}, np.zeros(motion.shape[:2]),
        np.array([[0.01, 0.0], [0.1, -1.0]]),
    )  # fmt: skip
    return Fit(effects, np.zeros(n), own, posterior, np.ones(motion.shape[:2]))


def answer_with(scene, *effects):
    """Return a diagnosis whose answer is some effects, and its summary."""
    none, fit = fitted(scene), fitted(scene, *effects)
    found = Search(scene, lambda *_: None, none, [fit], [], fit)
    outcome = "COMPOSITE" if len(fit.labels) > 1 else "NAMED"
    tested = CrossValidation(())
    decision = Decision(outcome, fit, (), dict.fromkeys(fit.labels, 0.9), 0.9, tested, fit)
    return Answer(found, decision), summarise_diagnosis(found, decision) | NOTES


@pytest.mark.long
@pytest.mark.parametrize("ground", GROUNDS)
def test_every_effect_at_every_target_is_stated_and_ranked(ground):
    scene = scene_on(ground)
    answer, summary = answer_with(scene, next(effects_on(scene.case)))
    labels = set()
    for effect in effects_on(scene.case):
        fit = fitted(scene, effect)
        own = Answer(replace(answer.search, fits=[fit]), replace(answer.decision, fit=fit))

        ((label, claim),) = claims(fit)
        rows = parameter_rows(fit) + hole_rows(fit)
        lines = diagnosis_lines(
            summary | {"effects": [vars(effect) | {"label": label, "claim": claim}]}
        )

        labels.add(label)
        assert len(claim) > 20
        assert f"this {effect.hypothesis.target}" not in claim.lower() or not effect.target
        assert len(rows) == len(effect.hypothesis.parameters)
        assert ranking_rows(own)[0]["chosen"]
        assert claim in "\n".join(lines)
    assert len(labels) >= 10


@pytest.mark.parametrize("ground", GROUNDS)
def test_a_page_of_several_effects_lacks_nothing(ground, monkeypatch):
    monkeypatch.setattr("pyblast.report.diagnosis_figures._uri", lambda _: "data:image/png;base64,")
    monkeypatch.setattr(geometry, "_as_meshed", lambda _, changed: changed)
    monkeypatch.setattr("pyblast.diagnosis.effects.holds", lambda *_: True)
    scene = scene_on(ground)
    site = {e.label: e for e in effects_on(scene.case) if e.hypothesis.on == "site"}
    chosen = [site[k] for k in ("missing_joint", "joint_slip") if k in site] or list(site.values())

    page = render_diagnosis(*answer_with(scene, *chosen[:2]))

    assert "<h3>Not computed</h3>" not in page
    assert len(re.findall('<img|class="plot"', page)) >= 3


@pytest.mark.parametrize("ground", [name for name in GROUNDS if name not in ("survey", "bench")])
def test_every_accused_plane_is_drawn_whatever_its_dip(ground, monkeypatch):
    monkeypatch.setattr(geometry, "_as_meshed", lambda _, changed: changed)
    case = case_on(ground)
    for effect in effects_on(case):
        if effect.label in ("missing_joint", "wrong_geometry"):
            changed = effect.hypothesis.apply(case.project, effect.target, **effect.parameters)
            planes = drawn_planes(case.project, changed, {effect.target})
        elif effect.hypothesis.target == "joint":
            planes = drawn_planes(case.project, None, {effect.target})
        else:
            continue
        strong = [plane for plane in planes if plane.strong]

        assert strong, effect
        assert all(len(polygon) >= 3 for plane in strong for polygon in plane.polygons)


@pytest.mark.parametrize(("dip", "length"), [(90.0, 60.0), (60.0, 60.0 / np.sin(np.pi / 3))])
def test_a_plane_across_the_box_has_its_area(dip, length):
    fault = FaultConfig(
        name="F", dip_deg=dip, dip_direction_deg=90.0, through_m=[40.0, 30.0, -10.0]
    )

    outline = fault_outline(fault, BOX)
    area = 0.5 * np.linalg.norm(np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0))

    assert area == pytest.approx(80.0 * length)
    assert np.all(outline >= BOX[:, 0] - 1e-9)
    assert np.all(outline <= BOX[:, 1] + 1e-9)


def test_a_disc_is_round_and_a_plane_outside_of_the_box_is_not_drawn():
    disc = {"name": "F", "dip_deg": 50.0, "dip_direction_deg": 20.0, "radius_m": 15.0}
    inside = FaultConfig(**disc, through_m=[40.0, 30.0, -30.0])
    outside = FaultConfig(**disc, through_m=[400.0, 30.0, -30.0])

    radius = np.linalg.norm(fault_outline(inside, BOX) - inside.through_m, axis=1)

    np.testing.assert_allclose(radius, 15.0)
    assert len(fault_outline(outside, BOX)) == 0
