"""A sponge lets waves out; what is narrow for them may not drag them."""

from dataclasses import replace

import numpy as np
import pytest
from small_site import BAND, CUT, DT, SAMPLES, small_site

from benchmarks.blind.flat_models import flat_model
from pyblast.errors import InputError
from pyblast.model.boundary import SpongeLayer
from pyblast.solver.run import simulate

BOX = ((0.0, 120.0), (0.0, 90.0), (-60.0, 0.0))
LOWEST = BAND[0]


def test_drag_grows_to_the_lesser_of_both_limits():
    places = np.array([[60.0, 45.0, -30.0], [150.0, 45.0, -30.0], [180.0, 45.0, -30.0]])
    speed = np.full(3, 1600.0)

    crossed = SpongeLayer(BOX, 60.0).alpha(places, speed)
    held = SpongeLayer(BOX, 60.0, lowest=LOWEST).alpha(places, speed)

    np.testing.assert_allclose(crossed, 3.0 * 1600.0 / 60.0 * np.array([0.0, 0.25, 1.0]))
    share = (60.0 * LOWEST / 1600.0 / 0.5) ** 4  # of S waves in the width, over a half
    np.testing.assert_allclose(held, share * crossed)


@pytest.mark.parametrize("angle", [0.0, 30.0, 60.0, 75.0])
def test_a_wide_layer_reflects_less_and_a_narrow_one_as_its_dashpots(angle):
    cosine, speed = np.cos(np.radians([angle])), 1600.0
    dashpots = float((1.0 - cosine[0]) / (1.0 + cosine[0]))

    back = [
        float(SpongeLayer(BOX, waves * speed / LOWEST, LOWEST).reflection(cosine, LOWEST, speed)[0])
        for waves in (0.25, 0.5, 1.0, 2.0)
    ]

    assert back[0] == pytest.approx(dashpots, abs=0.03)
    assert back[3] < back[2] < back[1]
    assert angle == 0.0 or back[3] < dashpots


@pytest.mark.long
def test_a_narrow_rim_sends_less_back_where_its_drag_is_held():
    site = small_site()
    wide = heard(site, replace(CUT, padding=600.0))  # 1.5 of the longest S wave
    held = heard(site, CUT)  # 0.15 of it
    crossed = heard(site, CUT, SpongeLayer(BOX, CUT.padding))

    back = [np.sum((one - wide) ** 2) / np.sum(wide**2) for one in (held, crossed)]
    assert back[0] < 0.5 * back[1]


def heard(site, cut, sponge=None):
    """Return what the receivers of a site hear of its first blast."""
    model = flat_model(site, "S1", cut)
    model = model if sponge is None else replace(model, sponge=sponge)
    seismograms = simulate(model, DT * SAMPLES).seismograms
    return np.stack([one.sampled(0.0, DT, SAMPLES).velocity for one in seismograms.values()])


def test_a_lowest_frequency_of_zero_is_refused():
    with pytest.raises(InputError, match=r"sponge\.lowest: must be positive, got 0 Hz"):
        SpongeLayer(BOX, 60.0, lowest=0.0)
