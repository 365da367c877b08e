import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.signals.comparison import LimitCurve, load_limits

LIMITS = load_limits()


def test_no_curve_claims_to_be_verified():
    assert not any(curve.verified for curve in LIMITS.values())


def test_every_curve_names_its_source():
    assert all(curve.source for curve in LIMITS.values())


@pytest.mark.parametrize(("key", "flat"), [("usbm_plaster", 12.7), ("usbm_drywall", 19.05)])
def test_usbm_curve_is_its_formula_everywhere(key, flat):
    hz = np.geomspace(1.0, 250.0, 4000)
    ramp = 2 * np.pi * hz
    exact = np.minimum(50.8, np.minimum(ramp * 0.762, np.maximum(flat, ramp * 0.2032)))

    assert 1e3 * LIMITS[key].limit(hz) == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize(
    ("hz", "limit"),
    [
        (1, 4.8),
        (2, 9.6),
        (4, 12.7),
        (7, 12.7),
        (10, 12.8),
        (12, 15.3),
        (15, 19.2),
        (20, 25.5),
        (30, 38.3),
        (40, 50.8),
        (200, 50.8),
    ],
)
def test_usbm_plaster_at_the_published_points(hz, limit):
    assert 1e3 * LIMITS["usbm_plaster"].limit(hz) == pytest.approx(limit, abs=0.06)


@pytest.mark.parametrize(
    ("key", "hz", "limit"),
    [
        ("din_4150_dwelling", [5, 10, 30, 50, 75, 100, 150], [5, 5, 10, 15, 17.5, 20, 20]),
        ("din_4150_industrial", [10, 50, 100], [20, 40, 50]),
        ("din_4150_sensitive", [10, 50, 100], [3, 8, 10]),
        ("bs_7385_residential", [2, 4, 9.5, 15, 40, 100], [7.54, 15, 17.5, 20, 50, 50]),
        ("osmre_chart", [4, 8, 11, 30, 60], [19.05, 19.05, 19.05, 50.8, 50.8]),
        ("sn_640312a_occasional", [10, 45, 90], [15, 20, 30]),
        ("dgms_domestic", [5, 20, 40], [5, 10, 15]),
    ],
)
def test_corners_lie_where_the_table_has_them(key, hz, limit):
    assert 1e3 * LIMITS[key].limit(hz) == pytest.approx(limit, abs=0.05)


def test_log_log_interpolation_is_a_power_law():
    middle = LIMITS["osmre_chart"].limit(np.sqrt(11.0 * 30.0))

    assert 1e3 * middle == pytest.approx(np.sqrt(19.05 * 50.8), rel=1e-9)


@pytest.mark.parametrize("hz", [8.0, 25.0])
def test_a_step_takes_its_lower_value(hz):
    below, at, above = LIMITS["dgms_domestic"].limit([hz - 1e-6, hz, hz + 1e-6])

    assert at == min(below, above)


def test_below_its_first_corner_a_curve_says_nothing():
    assert np.isnan(LIMITS["usbm_plaster"].limit(0.5))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"corners": [[10, 0.1], [5, 0.2]]}, "frequencies must rise"),
        ({"corners": [[10, -0.1]]}, "must be positive"),
        ({"corners": [1, 2]}, "shape"),
        ({"interpolation": "spline"}, "interpolation"),
        ({"quantity": "feeling"}, "quantity"),
    ],
)
def test_a_wrong_curve_is_refused(changes, message):
    entry = {"corners": [[1, 0.1]], "interpolation": "linear", "quantity": "peak component"}

    with pytest.raises(InputError, match=message):
        LimitCurve("test", "none", False, **{**entry, **changes})
