"""Published laws: what each prints, and the range that they find plausible together."""

from pathlib import Path

import numpy as np
import pytest

from pyblast.blasts.published_laws import (
    BY_NAME,
    LAWS,
    plausible_ppv,
)
from pyblast.blasts.site_law import read_site_records
from pyblast.errors import InputError

DISTANCE, CHARGE = 120.0, 60.0


@pytest.mark.parametrize(
    ("name", "law"),
    [
        ("AS 2187.2-2006", lambda r, w: 1140.0 * (r / w**0.5) ** -1.6),
        ("AS 2187.2-1993", lambda r, w: 500.0 * (r / w**0.5) ** -1.6),
        ("Luedeling-Hinzen 1986 sedimentary", lambda r, w: 969.0 * w**0.6 * r**-1.5),
        ("Luedeling-Hinzen 1986 crystalline", lambda r, w: 206.0 * w**0.8 * r**-1.3),
        ("Holmberg-Persson 1979", lambda r, w: 700.0 * w**0.7 * r**-1.5),
    ],
)
def test_a_law_is_the_one_that_its_source_prints(name, law):
    assert 1e3 * BY_NAME[name].ppv(DISTANCE, CHARGE) == pytest.approx(law(DISTANCE, CHARGE))


def test_bounds_of_oriard_are_24_and_242_inches_per_second():
    feet, pounds = DISTANCE / 0.3048, CHARGE / 0.45359237

    ends = BY_NAME["Oriard 1972"].peak(DISTANCE, CHARGE).band(0.9) / 0.0254

    scaled = (feet / pounds**0.5) ** -1.6
    assert ends == pytest.approx([24.0 * scaled, 242.0 * scaled])


def test_ends_of_as_2187_2_are_two_fifths_and_four_times_its_law():
    law = BY_NAME["AS 2187.2-2006"]

    ends = law.peak(DISTANCE, CHARGE).band(0.9)

    assert ends == pytest.approx([0.4 * law.ppv(DISTANCE, CHARGE), 4.0 * law.ppv(DISTANCE, CHARGE)])


@pytest.mark.parametrize(("distance", "charge"), [(20.0, 5.0), (120.0, 60.0), (1500.0, 800.0)])
def test_the_range_reaches_over_every_law_and_no_farther(distance, charge):
    ends = np.array([law.peak(distance, charge).band(0.9) for law in LAWS])

    plausible = plausible_ppv(distance, charge)

    assert (plausible.low, plausible.high) == (ends.min(), ends.max())
    assert plausible.laws == tuple(law.name for law in LAWS)


def test_the_range_falls_with_distance_and_rises_with_charge():
    near, far, more = (plausible_ppv(*pair) for pair in ((80, 60), (160, 60), (160, 120)))

    assert near.low > more.low > far.low
    assert near.high > more.high > far.high


@pytest.mark.parametrize(("factor", "excess"), [(0.01, 0.01), (1.0, 1.0), (100.0, 100.0)])
def test_excess_counts_from_the_nearer_end(factor, excess):
    plausible = plausible_ppv(DISTANCE, CHARGE)
    end = plausible.low if factor < 1.0 else plausible.high

    assert plausible.excess(factor * end) == pytest.approx(excess)


def test_a_peak_a_hundred_times_off_lies_outside_wherever_laws_reach():
    for scaled in np.geomspace(0.51, 449.0, 30):
        plausible = plausible_ppv(scaled, 1.0)

        middle = (plausible.low * plausible.high) ** 0.5
        assert plausible.excess(0.01 * middle) < 0.2
        assert plausible.excess(100.0 * middle) > 5.0


def test_no_law_speaks_of_what_lies_farther_than_its_chart_and_near_ones_go_on():
    assert plausible_ppv(500.0, 1.0) is None
    assert plausible_ppv(0.2, 1.0).low > plausible_ppv(0.51, 1.0).low


def test_the_range_of_one_law_is_its_own():
    law = BY_NAME["AS 2187.2-2006"]

    plausible = plausible_ppv(DISTANCE, CHARGE, [law])

    assert (plausible.low, plausible.high) == tuple(law.peak(DISTANCE, CHARGE).band(0.9))
    assert plausible.laws == (law.name,)


def test_a_charge_that_is_none_is_refused():
    with pytest.raises(InputError, match="charge must be positive, got 0"):
        plausible_ppv(100.0, 0.0)


def test_the_peak_of_a_quarry_that_read_far_too_low_is_described():
    words = plausible_ppv(DISTANCE, CHARGE).describe(8.3e-6)

    assert words.startswith("0.0083 mm/s, 240 times below the 2 to 57 mm/s")
    assert words.endswith("60 kg in 8 ms at 120 m")


@pytest.mark.parametrize("charge", [10.0, 100.0, 1000.0])
def test_published_peaks_are_plausible_and_in_another_unit_are_not(recordings, charge):
    table = recordings / "ppv_law" / "fgbastante_ppv_law.txt"
    if not table.is_file():
        pytest.skip("the table of peaks is absent; examples/real/README.md says where to fetch it")
    scaled, millimetres = 10.0 ** np.loadtxt(table, skiprows=1).T
    ranges = [plausible_ppv(each * charge**0.5, charge) for each in scaled]

    share = {
        factor: np.mean(
            [r.excess(factor * v) != 1.0 for r, v in zip(ranges, 1e-3 * millimetres, strict=True)]
        )
        for factor in (1.0, 1e-3, 1e3)
    }

    assert share[1.0] <= 0.1
    assert share[1e-3] == share[1e3] == 1.0


def test_the_made_up_peaks_of_the_site_law_example_are_plausible():
    table = read_site_records(Path(__file__).parents[2] / "examples" / "site_peaks.csv")

    outside = [plausible_ppv(r, w).excess(v) != 1.0 for r, w, v in zip(*table, strict=True)]

    assert np.mean(outside) <= 0.1
