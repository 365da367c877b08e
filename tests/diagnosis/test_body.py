"""A body that the site does not list is named, with its place, size and sign; a null has none."""

from functools import cache

import numpy as np
import pytest
from library_scene import library_of
from small_site import recorded, small_site

from pyblast.diagnosis.decision import body_explains_more
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.thresholds import OPEN_SET
from pyblast.model.ground_fields import Body
from pyblast.workflows.diagnose import diagnose

ASKED = {name for name, each in LIBRARY.items() if each.on != "site"} | {"attenuation_Q"}
BODIES = {
    "soft": Body((85.0, 45.0, -25.0), -0.5, 15.0),
    "stiff": Body((85.0, 45.0, -25.0), 0.35, 15.0),
    "beside R3": Body((95.0, 40.0, -15.0), -0.7, 15.0),
}


@cache
def diagnosed(name, asked=True):
    """Diagnose the small site with a body, recorded on a finer mesh; None without one."""
    site, body = small_site(), BODIES.get(name)
    with library_of(ASKED | ({"body"} if asked else set())):
        truth = site if body is None else site.changed(fields=(body,))
        return diagnose(recorded(site, truth, fine=True).project)


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    ["stiff", *(pytest.param(name, marks=pytest.mark.long) for name in ("soft", "beside R3"))],
)
def test_a_body_is_named_with_its_place_size_and_sign(name):
    done, truth = diagnosed(name), BODIES[name]
    (effect,) = done.summary["effects"]
    (fitted,) = done.decision.fit.effects
    found = LIBRARY["body"].apply(small_site(), fitted.target, **fitted.parameters).fields[-1]

    assert (done.summary["outcome"], effect["label"]) == ("NAMED", "body")
    assert np.linalg.norm(np.subtract(found.centre, truth.centre)) < 8.0  # zones are 45 m long
    assert found.change == pytest.approx(truth.change, rel=0.4)
    assert found.reach == pytest.approx(truth.reach, rel=0.3)
    assert done.summary["held_out"]["improves"]


@pytest.mark.long
def test_a_body_without_its_class_is_located_although_an_error_at_its_receiver_passes_all_else():
    done = diagnosed("beside R3", asked=False)
    decision = done.decision
    (wrong,) = decision.best.effects

    assert decision.outcome == "UNKNOWN"
    assert not done.summary["effects"]
    assert wrong.target == "R3"
    assert decision.cross_validation.supports
    assert decision.open_set > OPEN_SET
    assert body_explains_more(done.search, decision.best)
    (point,) = done.summary["located"]["points"]
    away = np.linalg.norm([point[axis] for axis in "xyz"] - np.array(BODIES["beside R3"].centre))
    assert away < point["within_m"] < 50.0
    assert point["change"]["cs"] < -0.05
    assert len(done.summary["located"]["cells"]["score"]) > 20
    assert any("a change of the rock at one place alone" in each for each in done.summary["fails"])


@pytest.mark.long
def test_without_a_body_none_is_found_and_its_limits_are_given():
    done = diagnosed("")
    (limit,) = [
        row for row in done.summary["detection_limits"]
        if (row["label"], row["parameter"]) == ("body", "change")
    ]  # fmt: skip

    assert done.summary["outcome"] == "NULL"
    assert 0.0 < abs(limit["value"]) < 1.0
