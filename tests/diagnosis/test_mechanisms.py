"""What is missing from ground that is not flat scores most there, and nothing else does."""

import pytest
from grounds import site_on
from library_scene import library_of
from small_fits import with_holes
from small_site import recorded, scene_of

from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.diagnosis.scores import SiteScores, members_of

RIVALS = "joint_viscous_fill", "joint_nonlinear_closure"


def classes(ground, names, truth=None):
    """Return the score of each class of some names and their rivals, and the threshold."""
    site = site_on(ground)
    scene = with_holes(scene_of(recorded(site, truth and truth(site))))
    with library_of((*RIVALS, *names)):
        members = tuple(members_of(scene))
    scores = SiteScores(scene, members, seed=1)
    assert {LIBRARY[name].label for name in names} <= {member.label for member in members}
    by_class = scores.by_class(scores.log_bayes(scores.prior[None]))
    return {label: float(value[0]) for label, value in by_class.items()}, scores.threshold


def hidden(name, target, **values):
    """Return a function that puts an effect into a site."""
    return lambda site: LIBRARY[name].apply(site, target, **values)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target", "values"),
    [("attenuation_Q", "", {"q": 12.0}),
     ("anisotropy", "", {"azimuth": 0.5, "normal": 0.2, "shear": 0.2}),
     ("partial_joint", "J1", {"depth": 20.0}),
     ("water_table", "", {"depth": 12.0, "faster": 1.3})],
)  # fmt: skip
def test_what_is_missing_beside_a_dipping_fault_is_seen(name, target, values):
    scored, threshold = classes("dipping", [name], hidden(name, target, **values))

    assert max(scored, key=scored.get) == name
    assert scored[name] > threshold


@pytest.mark.long
def test_a_joint_across_a_dipping_fault_is_seen():
    joint = hidden("missing_joint/dipping", "dip 60 to 130 at 8.6", offset=4.0, turn=0.1,
                   steeper=0.0, kn=1.5e8, ks=6e7)  # fmt: skip
    scored, threshold = classes("dipping", ["missing_joint/dipping", "attenuation_Q"], joint)

    assert max(scored, key=scored.get) == "missing_joint"
    assert scored["missing_joint"] > threshold


@pytest.mark.long
def test_nothing_scores_beside_a_dipping_fault_where_nothing_is_missing():
    scored, threshold = classes(
        "dipping",
        ["attenuation_Q", "anisotropy", "missing_joint/dipping", "partial_joint", "water_table"],
    )

    assert max(scored.values()) < threshold
