"""Keys: each has a range that is kept, and values that are unusual are named."""

import math

import pytest
from small_project import INSIDE, TEXT, written

from pyblast.config.config import Config, read_config
from pyblast.config.keys import keys, numbers_given, numbers_in, range_of_key, section_in, unusual
from pyblast.errors import InputError
from pyblast.model.material import Material

KEYS = keys(Config)


def finding_of(folder, *changes, text=TEXT):
    return unusual(read_config(written(folder, *changes, text=text)))


@pytest.mark.parametrize("path", list(KEYS))
def test_every_number_has_a_range_and_usual_values_within_it(path):
    known = KEYS[path]

    assert -math.inf < known.low < known.high < math.inf
    if known.usual is not None:
        assert known.low <= known.usual.low < known.usual.high <= known.high
    for end, beyond in ((known.low, -1.0), (known.high, 1.0)):
        with pytest.raises(ValueError, match="must be at"):
            known.check(end + beyond * max(1.0, abs(end)))


def test_defaults_are_usual():
    def tables(section):
        yield section
        for field in section.model_fields.values():
            inner = section_in(field.annotation)
            if inner is not None:
                yield from tables(inner)

    for table in tables(Config):
        for key, field in table.model_fields.items():
            known = range_of_key(table, key)
            for value in numbers_in(field.default):
                known.check(value)
                assert known.usual is None or known.usual.low <= value <= known.usual.high, key


def test_the_numbers_of_a_file_are_all_looked_at(tmp_path):
    values = {path: value for path, _, value in numbers_given(read_config(written(tmp_path)))}

    assert values["materials.rock.young_mpa"] == 18720
    assert values["joints.F1.kn_gpa_per_m"] == 0.114
    assert values["mesh.layers.1.thickness_m"] == 10
    assert values["run.duration_s"] == 0.1


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("size_m = [60, 20, 30]", "size_m = [60, 2e6, 30]", "size_m: must be at most 1000000, got"),
        ("thickness_m = 10", "thickness_m = 1e-300", "thickness_m: must be at least 1e-06, got"),
        ("duration_s = 0.1", "duration_s = 1e9", "run.duration_s: must be at most 100000, got"),
        ("kn_gpa_per_m = 0.114", "kn_gpa_per_m = 1e20", "kn_gpa_per_m: must be at most 100000000"),
        ("grid_cells = [6, 2, 3]", "grid_cells = [6, 2, 9999999]", "must be at most 1000000, got"),
        ("frequency_hz = 4", "frequency_hz = 1e-30", "frequency_hz: must be at least 1e-06, got"),
        ("through_m = [30, 0, 0]", "through_m = [1e30, 0, 0]", "must be at most 100000000, got"),
        ("shear_mpa = 57.7\n", "shear_mpa = 57.7\nqp = 1e12\n", "qp: must be at most 1000000"),
        ("peak_time_ms = 30", "peak_time_ms = 30\nsampling_hz = 1e8", "at most 10000000 samples"),
        ("[run]", "[insitu]\nstress_mpa = [-5e6, -5e6, -5e6, 0, 0, 0]\n[run]", "must be at least"),
    ],
)
def test_a_value_beyond_its_range_is_refused(tmp_path, old, new, sentence):
    with pytest.raises(InputError, match=sentence):
        read_config(written(tmp_path, (old, new)))


@pytest.mark.parametrize(
    ("text", "old", "new", "sentence"),
    [
        (TEXT, "duration_s = 0.1", "duration_s = 200", "run.duration_s is 200, usual are"),
        (TEXT, "[run]", "[insitu]\nhorizontal_ratio = 99\n[run]", "horizontal_ratio is 99"),
        (INSIDE, "radius_m = 0.5", "radius_m = 57", "radius_m is 57, usual are 0.02 to 20"),
        (INSIDE, "peak_time_ms = 40", "peak_time_ms = 5000", "peak_time_ms is 5000, usual"),
    ],
)
def test_an_unusual_value_is_a_finding(tmp_path, text, old, new, sentence):
    assert finding_of(tmp_path, text=text) is None
    assert sentence in finding_of(tmp_path, (old, new), text=text).text


@pytest.mark.parametrize(
    ("cp", "cs", "density", "sentence"),
    [
        (3000.0, 2200.0, 2600.0, "cp/cs is 1.36"),
        (3000.0, 150.0, 1900.0, "cp/cs is 20"),
        (45.0, 25.0, 1900.0, "cp is 45 m/s"),
        (1500.0, 60.0, 1700.0, ""),
        (3800.0, 2200.0, 2600.0, ""),
    ],
)
def test_speeds_that_no_ground_has_are_a_finding(tmp_path, cp, cs, density, sentence):
    materials = {"rock": Material.from_speeds(density, cp, cs)}

    found = unusual(read_config(written(tmp_path)), materials)

    assert (found is None) if not sentence else (sentence in found.text)
