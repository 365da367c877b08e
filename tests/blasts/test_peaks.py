"""Distributions of peaks: quantiles against closed forms, shares and charges that invert them."""

import numpy as np
import pytest
from scipy import stats

from pyblast import InputError, fit_site_law
from pyblast.blasts.peaks import DrawnPeaks, PeaksOfLaw
from pyblast.blasts.published_laws import BY_NAME, LAWS


def law_of(generator, n=12, charge=60.0):
    distance = generator.uniform(60.0, 900.0, n)
    ppv = 0.9 * (distance / charge**0.5) ** -1.5 * 10.0 ** generator.normal(0.0, 0.2, n)
    return distance, ppv, fit_site_law(distance, np.full(n, charge), ppv)


def test_level_of_a_site_law_is_the_prediction_limit_of_a_regression():
    distance, ppv, law = law_of(np.random.default_rng(7))
    at, x, y = 130.0, np.log10(distance / 60.0**0.5), np.log10(ppv)
    columns = np.column_stack([np.ones_like(x), x])
    fitted, squares = np.linalg.lstsq(columns, y, rcond=None)[:2]
    row = np.array([1.0, np.log10(at / 40.0**0.5)])
    variance = squares[0] / 10 * (1.0 + row @ np.linalg.inv(columns.T @ columns) @ row)

    level = law.peak(at, 40.0).level(0.95)

    wanted = row @ fitted + stats.t.ppf(0.95, 10) * variance**0.5
    assert np.log10(level) == pytest.approx(wanted, rel=1e-10)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.name)
def test_a_published_law_has_its_published_ends_and_half_of_the_blasts_below_it(law):
    peak = law.peak(120.0, 60.0)

    ends = np.array([peak.level(0.05), peak.level(0.95)]) / law.ppv(120.0, 60.0)

    assert ends == pytest.approx(law.factors)
    assert peak.share_below(law.ppv(120.0, 60.0)) == 0.5


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.95, 0.999])
def test_share_and_charge_invert_the_level(share):
    for law in (BY_NAME["AS 2187.2-2006"], law_of(np.random.default_rng(8))[2]):
        limit = law.peak(120.0, 60.0).level(share)

        assert law.peak(120.0, 60.0).share_below(limit) == pytest.approx(share)
        assert law.peak(120.0, 60.0).charge_below(limit, share) == pytest.approx(60.0, rel=1e-4)


def test_the_allowed_charge_raises_the_level_to_the_limit_by_its_power():
    known = PeaksOfLaw(0.010, 0.2, 0.25, charge=40.0, exponent=0.8)

    allowed = known.charge_below(0.015)

    grown = PeaksOfLaw(0.010 * (allowed / 40.0) ** 0.8, 0.2, 0.25)
    assert grown.level(0.95) == pytest.approx(0.015, rel=1e-12)


def test_few_degrees_of_freedom_need_more_room_above_than_below_the_median_alike():
    few, many = PeaksOfLaw(0.01, 0.2, 0.2, 3.0), PeaksOfLaw(0.01, 0.2, 0.2)

    assert few.level(0.95) / many.level(0.95) == pytest.approx(
        10.0 ** (0.2 * (stats.t.ppf(0.95, 3) - stats.norm.ppf(0.95)))
    )
    assert few.level(0.95) * few.level(0.05) == pytest.approx(1e-4)


def test_drawn_peaks_have_their_own_quantiles_and_shares():
    peaks = DrawnPeaks(("a", "b"), np.sort(np.random.default_rng(9).random((999, 2)), axis=0))

    assert peaks.share_below(peaks.level(0.9)) == pytest.approx(0.9, abs=0.002)
    assert np.isnan(peaks.charge_below(0.5)).all()
    with pytest.raises(InputError, match=r"share must lie between 0 and 1, got 95"):
        peaks.level(95)


def test_the_error_of_a_level_widens_drawn_peaks_to_its_own_quantiles():
    drawn = DrawnPeaks(("one", "two"), np.full((3, 2), 2e-3))
    error = PeaksOfLaw(1.0, 0.3, 0.2)

    wide = drawn.under([error, None])

    assert wide.level(0.95)[0] == pytest.approx(2e-3 * error.level(0.95), rel=0.02)
    assert wide.share_below(np.array([2e-3 * error.level(0.8), 3e-3])) == pytest.approx(
        [0.8, 1.0], abs=0.01
    )
    assert np.all(wide.peaks[:, 1] == 2e-3)
