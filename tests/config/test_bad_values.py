"""Values that nothing has, names that break terminals, and input that is nothing are refused."""

from inspect import Parameter, signature
from typing import get_type_hints

import pytest
from small_project import INSIDE, TEXT, written
from typer.testing import CliRunner

from pyblast.cli.commands import Finite, app
from pyblast.config.config import read_config
from pyblast.errors import InputError, ReadError
from pyblast.project.project import load_project

DENSITY, PLACE = "density_kg_per_m3 = 2660", "position_m = [-39, 10, 30]"
FORCE = '\n[[point_forces]]\nposition_m = [1, 1]\ndirection = [0, 0, 1]\nfile = "f.csv"\n'


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (DENSITY, "density_kg_per_m3 = 1e300", "density_kg_per_m3: must be at most 25000, got"),
        ("young_mpa = 18720", "young_mpa = 60", "young_mpa: 60 gives shear waves of 93.1 m/s"),
        ("young_mpa = 18720\npoisson = 0.3", "cp_m_per_s = 166\ncs_m_per_s = 96", "is it in km/s"),
        (PLACE, f"{PLACE}\ncharge_exponent = 1e6", "charge_exponent: must be at most 2, got"),
        ("rows = 4", "rows = 1_000_000", "must make at most 100000 holes"),
        (DENSITY, "density_kg_per_m3 = 1979-05-27T07:32:00Z", "got 1979-05-27T07:32:00Z"),
        (DENSITY, "density_kg_per_m3 = [true]", r"a number, got \[true\]"),
        (DENSITY, f"density_kg_per_m3 = 1{'0' * 5000}", r"line \d+ holds a number of too many"),
        ('"Small column"', r'"\u001b[31m"', r"title: must not hold control characters, got '\\x1b"),
        ("[run]", r'[joints."a\u0001"]' + "\n[run]", "joints: must not hold control"),
        ("[run]", '[joints.""]\n[run]', "joints: a name must not be empty"),
        ("[run]", f"{FORCE.replace('f.csv', chr(92) + 'u0000')}[run]", "file: must not hold con"),
        ("[run]", '[[receivers]]\nname = "."\nposition_m = [1, 1]\n[run]', "not be dots alone"),
    ],
)
def test_a_bad_value_is_refused_in_one_printable_sentence(tmp_path, old, new, sentence):
    with pytest.raises(InputError, match=sentence) as caught:
        read_config(written(tmp_path, (old, new)))

    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("lines", "rule"),
    [
        ("0,0\n0.1,0\n0.2,0\n0.3,0\n", "is zero throughout"),
        ("0,1\n1e-300,2\n2e-300,1\n3e-300,0\n", "line 3: times must grow by equal steps"),
    ],
)
def test_a_force_that_moves_nothing_is_refused(tmp_path, lines, rule):
    (tmp_path / "f.csv").write_text(f"time_s,force_n\n{lines}")

    with pytest.raises(ReadError, match=rf"f\.csv.* {rule}"):
        _ = load_project(written(tmp_path, ("[run]", f"{FORCE}[run]"))).inside


@pytest.mark.parametrize(("text", "reference"), [(TEXT, ""), (TEXT, "reference_charge_kg = 50"),
                                                 (INSIDE, "")])  # fmt: skip
def test_charges_of_zero_do_not_enter(tmp_path, text, reference):
    head, rest = text.split("[blast]\n")
    table, rest = rest[: rest.index("[")], rest[rest.index("\n[") :]
    assert "charge_kg" in table
    file = f'[blast]\nfile = "holes.csv"\n{reference}\n'
    (tmp_path / "holes.csv").write_text(
        "hole,x_m,y_m,z_m,depth_m,charge_kg,time_ms\nH1,14,10,30,12,0,0\nH2,18,10,30,12,0,25\n"
    )
    project = load_project(written(tmp_path, text=f"{head}{file}{rest}"))

    with pytest.raises(InputError, match=r"all charges are zero, so nothing|no hole has a charge"):
        _ = project.model


@pytest.mark.parametrize("size", ["radius_m = 500", "extent_m = [500, 400]"])
def test_a_fault_that_ends_beyond_its_box_is_refused(tmp_path, size):
    with pytest.raises(InputError, match=r"faults\.F1\.\w+: reaches beyond the box"):
        read_config(written(tmp_path, ("through_m", f"{size}\nthrough_m")))


@pytest.mark.parametrize(("wave", "azimuth"), [("SH", 90), ("SV", 0)])
def test_a_plane_wave_needs_motion_along_it(wave, azimuth):
    import numpy as np

    from pyblast.config.config import InputConfig
    from pyblast.signals.seismogram import Seismogram
    from pyblast.sources.face import make_entry

    upright = np.outer(np.hanning(9), [0.0, 0.0, 1.0] if wave == "SH" else [1.0, 0.0, 0.0])
    config = InputConfig(
        enters_as="plane_wave", wave=wave, azimuth_deg=azimuth, inclination_deg=10.0
    )

    with pytest.raises(InputError, match=f"no motion along {wave}"):
        make_entry(config, Seismogram(upright, 1e-3))


def _numbers():
    """Return words of each command and option that takes real numbers, with how many of them."""
    found = []
    for command in app.registered_commands:
        parts = signature(command.callback).parameters.values()
        files = ["x"] * sum(part.default is Parameter.empty for part in parts)
        name = command.name or command.callback.__name__.replace("_", "-")
        for key, kind in get_type_hints(command.callback).items():
            if count := str(kind).count("float"):
                found.append(([name, *files], f"--{key.replace('_', '-')}", count))
    return found


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
@pytest.mark.parametrize(("words", "option", "count"), _numbers())
def test_numbers_of_the_command_line_are_finite(words, option, count, value):
    done = CliRunner().invoke(app, [*words, option, *[value] * count])

    assert done.exit_code == 2
    assert f"{option}: must be a finite number, got {value}" in done.output


def test_every_command_asks_for_finite_numbers():
    assert all(command.cls is Finite for command in app.registered_commands)
    assert len(_numbers()) > 5
