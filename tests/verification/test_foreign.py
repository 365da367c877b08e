"""Rows of sites of an independent program: estimates beside what is true."""

from verification.foreign import intervals, table

EFFECT = {
    "label": "soft_surface_layer",
    "parameters": {
        "thickness": {"value": 5.55551, "low": 4.0, "high": 7.0, "unit": "m"},
        "slower": {"value": 0.7, "low": 0.6, "high": 0.8, "unit": ""},
    },
}
ROW = {
    "truth": [], "geometry": "fault", "outcome": "NULL", "labels": [], "explained": 0.0,
    "further_blast_misfit": {"calibrated": 0.012, "diagnosed": 0.01}, "runs": 43, "wall_s": 120.0,
    "kept_s": 0.0, "processor_s": 85.2,
}  # fmt: skip


def test_an_estimate_stands_beside_the_true_value():
    rows = intervals([EFFECT], {"soft_surface_layer": {"thickness": 6.0, "factor": 0.675077}})

    assert rows["soft_surface_layer thickness"] == {
        "true": 6.0, "value": 5.556, "low": 4.0, "high": 7.0,
    }  # fmt: skip
    assert rows["soft_surface_layer slower"]["true"] == 0.675077


def test_an_effect_that_is_not_true_has_no_true_value():
    assert intervals([EFFECT], {"joint_slip": {"residual": 0.8}}) == {}


def test_the_table_of_sites_gives_processor_time():
    lines = list(table({"case-04": ROW}))

    assert lines[0].endswith("runs | processor s |")
    assert lines[2].endswith("| 1.2 → 1.0 % | 43 | 85 |")
