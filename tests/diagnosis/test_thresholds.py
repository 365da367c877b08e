"""Thresholds of a diagnosis: each has one name, one value and what it rests on."""

from pyblast.diagnosis import thresholds
from pyblast.diagnosis.thresholds import threshold_rows


def test_each_threshold_is_entered_once_under_the_name_that_the_code_imports():
    names = [row.name for row in threshold_rows()]

    assert len(set(names)) == len(names)
    assert all(getattr(thresholds, row.name) == row.value for row in threshold_rows())


def test_each_threshold_says_what_it_means_and_was_measured_on():
    assert all(row.meaning and row.measured_on for row in threshold_rows())
