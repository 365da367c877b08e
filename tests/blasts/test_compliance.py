import math
from dataclasses import replace

import numpy as np
import pytest

from pyblast import Seismogram
from pyblast.blasts.compliance import (
    ComponentPeaks,
    assess,
    assess_all,
    compliance_csv,
    conclusion,
    explain,
    free_field,
    peaks_under,
    share_at_level,
)
from pyblast.blasts.peaks import PeaksOfLaw
from pyblast.blasts.published_laws import BY_NAME
from pyblast.signals.comparison import load_limits

TIME = np.arange(0.0, 2.0, 1e-3)


def sines(*parts):
    columns = [a * np.exp(-TIME) * np.sin(2.0 * np.pi * hz * TIME) for a, hz in parts]
    return Seismogram(np.column_stack(columns), 1e-3, label="R1")


def test_the_component_nearest_to_its_limit_counts_not_the_largest():
    motion = sines((0.010, 60.0), (0.006, 8.0), (0.001, 8.0))

    row = assess(motion, "din_4150_dwelling")

    assert row.quantity == motion.components[1]
    assert row.limit == pytest.approx(0.005)
    assert row.share == pytest.approx(motion.ppv[1] / 0.005)


def test_a_quantity_limits_its_own_components_and_the_sum_has_the_frequency_of_the_largest():
    peaks = ComponentPeaks(("east", "north", "vertical"), (2.0, 3.0, 5.0), (8.0, 9.0, 30.0), 6.0)

    assert peaks_under(peaks, "horizontal component") == [("east", 2.0, 8.0), ("north", 3.0, 9.0)]
    assert peaks_under(peaks, "vertical component") == [("vertical", 5.0, 30.0)]
    assert len(peaks_under(peaks, "peak component")) == 3
    ((_, size, hz),) = peaks_under(peaks, "vector sum")
    assert (size, hz) == (6.0, 30.0)


def test_a_transfer_to_a_building_concerns_what_is_simulated_alone():
    key = next(key for key in load_limits() if free_field([key], ["R1"]) is not None)
    motion = sines((0.004, 10.0), (0.003, 10.0), (0.001, 10.0))
    motions = {kind: {"R1": motion} for kind in ("recorded", "simulated")}

    def peaks(**more):
        return {row.kind: row.peak for row in assess_all(motions, {}, [key], **more)}

    plain, moved = peaks(), peaks(transfers={"R1": 2.5})

    assert moved["recorded"] == plain["recorded"]
    assert moved["simulated"] == pytest.approx(2.5 * plain["simulated"])


def test_the_share_is_proportional_to_the_motion():
    one = assess(sines((0.002, 20.0), (0.0, 1.0), (0.0, 1.0)), "usbm_plaster")
    two = assess(sines((0.004, 20.0), (0.0, 1.0), (0.0, 1.0)), "usbm_plaster")

    assert two.share == pytest.approx(2.0 * one.share)
    assert one.limit == two.limit


def test_a_vector_sum_is_limited_as_such():
    motion = sines((0.01, 20.0), (0.01, 20.0), (0.0, 1.0))

    row = assess(motion, "sn_640312a_occasional")

    assert (row.quantity, row.peak) == ("vector sum", motion.pvs)
    assert row.limit == 0.015


def test_without_a_frequency_the_lowest_limit_holds():
    ramp = Seismogram(np.outer(np.linspace(0.0, 1.0, 50), [0.01, 0.0, 0.0]), 1e-3)

    row = assess(ramp, "din_4150_dwelling")

    assert math.isnan(row.frequency)
    assert row.limit == pytest.approx(0.005)
    assert "lowest" in " ".join(explain(row.table()))


def test_a_still_motion_has_no_assessment_and_a_curve_that_begins_above_no_share():
    still = Seismogram(np.zeros((50, 3)), 1e-3)
    slow = assess(sines((0.01, 2.0), (0.0, 1.0), (0.0, 1.0)), "bs_7385_framed")

    assert assess(still, "din_4150_dwelling") is None
    assert math.isnan(slow.share)
    assert "begins at 4 Hz" in explain(slow.table())[-1]
    assert conclusion([slow.table()], True).startswith("Not assessed")


def test_the_charge_that_would_pass_gives_the_limit_by_the_law_it_names():
    row = assess(sines((0.02, 20.0), (0.0, 1.0), (0.0, 1.0)), "as_2187_sensitive",
                 window=(100.0, 400.0))  # fmt: skip
    charge = 400.0 * row.share ** (-2.0 / 1.6)

    text = explain(row.table())

    assert row.scaled_distance == pytest.approx(5.0)
    assert f"about {charge:.3g} kg" in text[-1]
    assert "at 20 Hz" in text[3] or "lowest value" in text[3]
    assert "= 20 Hz" in text[1]


def test_the_conclusion_says_what_is_allowed_and_how_far():
    quiet, loud = (
        assess(sines((size, 20.0), (0.0, 1.0), (0.0, 1.0)), "as_2187_sensitive", receiver=name)
        for size, name in ((0.002, "far"), (0.02, "near"))
    )

    assert conclusion([quiet.table()], True).startswith("Allowed: at most ")
    assert conclusion([quiet.table(), loud.table()], True).startswith("Not allowed at near: ")
    assert "No standard is chosen" in conclusion([quiet.table()], False)


def test_the_table_has_a_line_for_each_place_kind_and_curve_and_is_read_again():
    motion = sines((0.002, 20.0), (0.001, 20.0), (0.0, 1.0))
    rows = assess_all(
        {"recorded": {'a,"b': motion}, "simulated": {'a,"b': motion}},
        {'a,"b': (50.0, 100.0)},
        ["as_2187_sensitive", "usbm_plaster"],
    )

    lines = compliance_csv([row.table() for row in rows]).splitlines()

    assert len(rows) == 4
    assert len(lines) == 5
    assert lines[1].startswith('"a,""b",recorded,as_2187_sensitive,')
    assert "50,100,5," in lines[1]


@pytest.mark.parametrize("key", sorted(load_limits()))
def test_every_curve_explains_itself_without_powers_of_ten(key):
    row = assess(sines((0.02, 20.0), (0.01, 31.0), (0.01, 70.0)), key, window=(90.0, 250.0))

    text = " ".join(explain(row.table()))

    assert load_limits()[key].name in text
    assert "e+" not in text


def test_a_simulated_peak_is_judged_by_what_95_percent_of_such_blasts_stay_below():
    motion = sines((0.002, 20.0), (0.0, 1.0), (0.0, 1.0))
    error = PeaksOfLaw(1.0, 0.4, 0.4), "the site's own law"
    pair = {"simulated": {"house": motion}}, {"house": (100.0, 50.0)}

    row = assess_all(*pair, ["din_4150_dwelling"], {"house": error})[0].table()

    assert row["share"] < 1.0 < share_at_level(row)
    assert row["high"] == pytest.approx(row["peak"] * 10.0 ** (0.4 * 1.6448536))
    assert conclusion([row], True).startswith("Not allowed at house: ")
    assert f"about {50.0 * share_at_level(row) ** (-2.0 / 1.6):.3g} kg" in explain(row)[-1]


def test_a_level_by_a_published_law_alone_is_not_to_be_signed_but_a_record_is():
    motion, law = sines((0.0005, 20.0), (0.0, 1.0), (0.0, 1.0)), BY_NAME["AS 2187.2-2006"]
    errors = {"house": (replace(law.peak(100.0, 50.0), median=1.0), law.name)}

    simulated, recorded = (
        assess_all({kind: {"house": motion}}, {}, ["din_4150_dwelling"], errors)[0].table()
        for kind in ("simulated", "recorded")
    )

    assert simulated["high"] == pytest.approx(4.0 * simulated["peak"])
    words = conclusion([simulated], True)
    assert words.startswith("Not to be signed: the level stands on a published law alone (AS 2187")
    assert "recorded blast" in words
    assert f"allowed: at most {400.0 * simulated['share']:.3g} %" in words
    assert math.isnan(recorded["high"])
    assert conclusion([recorded], True).startswith(
        f"Allowed: at most {100.0 * recorded['share']:.3g} %"
    )


def test_the_foundation_takes_the_transfer_and_the_ground_does_not():
    motion = sines((0.004, 20.0), (0.0, 1.0), (0.0, 1.0))
    foundation, ground = (
        (assess(motion, key), assess(motion, key, transfer=0.6))
        for key in ("din_4150_dwelling", "usbm_plaster")
    )

    assert foundation[1].peak == pytest.approx(0.6 * foundation[0].peak)
    assert foundation[1].share == pytest.approx(0.6 * foundation[0].share)
    assert foundation[1].frequency == foundation[0].frequency
    assert "0.6 times those of the free ground, for the foundation" in " ".join(
        explain(foundation[1].table())
    )
    assert (ground[1].peak, ground[1].transfer) == (ground[0].peak, 1.0)


def test_free_ground_beside_a_limit_of_the_building_is_said():
    found = free_field(["din_4150_dwelling", "usbm_plaster"], ["house"])

    assert found.code == "D51"
    assert "dwellings, foundation (foundation)" in found.text
    assert "USBM" not in found.text
    assert free_field(["usbm_plaster"], ["house"]) is None
    assert free_field(["din_4150_dwelling"], []) is None


def test_a_spectrum_that_decides_otherwise_is_said():
    row = assess(sines((0.004, 20.0), (0.0, 1.0), (0.0, 1.0)), "din_4150_dwelling").table()

    alike, apart = (
        conclusion(
            [row | {"peak": 6e-3, "share": 0.6, "limit": 0.01, "spectral_limit": limit}], True
        )
        for limit in (0.008, 0.005)
    )

    assert row["spectral_frequency"] == pytest.approx(20.0, rel=0.02)
    assert row["spectral_limit"] == pytest.approx(row["limit"], rel=0.02)
    assert "spectrum" not in alike
    assert "the limit is 5 mm/s and the share 120 % of it" in apart
