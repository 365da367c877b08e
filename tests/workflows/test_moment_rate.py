"""Moment rate from the records of a signature shot: the truth found again, refusals, files."""

import json

import numpy as np
import pytest
from small_project import INSIDE, written

from pyblast.back_analysis.waveforms import spline
from pyblast.errors import InputError
from pyblast.project.project import load_project
from pyblast.project.result import write_csv
from pyblast.solver.run import simulate
from pyblast.workflows.back_analysis import find_moment_rate

PLACES = {"house": (52, 10), "near": (40, 6)}


def shot(folder, noise=0.0):
    """Write a project whose records are its own motion times 1.5, with noise."""
    receivers = "".join(
        f'[[receivers]]\nname = "{name}"\nposition_m = [{x}, {y}]\n'
        f'recorded = {{ file = "{name}.csv" }}\n'
        for name, (x, y) in PLACES.items()
    )
    text = INSIDE[: INSIDE.index("[[receivers]]")] + "RECEIVERS" + INSIDE[INSIDE.index("[run]") :]
    for old, new in (("duration_s = 0.1", "duration_s = 0.8"), ("time_ms = 40", "time_ms = 80")):
        assert old in text
        text = text.replace(old, new)
    bare = receivers.replace("recorded", "# recorded")
    project = load_project(written(folder, ("RECEIVERS", bare), text=text))
    run = simulate(project.model, project.duration)
    random = np.random.default_rng(5)
    for name, motion in run.seismograms.items():
        scale = noise * motion.ppv.max()
        shaken = 1.5 * motion.velocity + scale * random.normal(size=motion.velocity.shape)
        shifted = motion.shifted(-project.lead)
        write_csv(folder / f"{name}.csv", type(shifted)(shaken, shifted.dt, shifted.start))
    return project, written(folder, ("RECEIVERS", receivers), text=text)


@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_moment_rate_that_made_the_records_is_found_again(tmp_path, noise):
    truth, path = shot(tmp_path, noise)

    fit, folder = find_moment_rate(path, length=0.45)

    rate = truth.inside.moment_rate
    times = rate.start + rate.dt * np.arange(len(rate.values))
    wanted = 1.5 * np.interp(fit.times, times, rate.values, 0.0, 0.0)
    error = np.abs(fit.rate - wanted)
    assert error.max() < (0.04 if noise == 0.0 else 0.06) * wanted.max()
    assert max(fit.misfit.values()) < (1e-3 if noise == 0.0 else 0.05)
    if noise:
        assert np.mean(error < 3.0 * fit.deviation) > 0.8
    assert json.loads((folder / "source.json").read_text())["misfit"] == pytest.approx(fit.misfit)


def test_the_table_is_the_moment_rate_of_the_next_project(tmp_path):
    truth, path = shot(tmp_path)
    _, folder = find_moment_rate(path, length=0.45)
    text = path.read_text()
    start = text.index("[holes_inside")
    table = f'[holes_inside]\nmoment_rate_file = "{folder}/moment_rate.csv"\n'
    path.write_text(text[:start] + table + text[text.index("[[receivers]]") :])

    found = load_project(path)

    peaks = [project.inside.moment_rate.values.max() for project in (truth, found)]
    assert peaks[1] == pytest.approx(1.5 * peaks[0], rel=0.05)


def test_splines_add_up_to_one():
    x = np.linspace(3.0, 6.0, 13)

    assert spline(x[:, None] - np.arange(7)).sum(axis=1) == pytest.approx(1.0)


def test_without_records_or_holes_there_is_no_moment_rate(tmp_path):
    with pytest.raises(InputError, match=r"add receivers\.recorded and the table \[holes_inside"):
        find_moment_rate(written(tmp_path, text=INSIDE))


def test_a_length_too_short_for_the_band_is_refused(tmp_path):
    _, path = shot(tmp_path)

    with pytest.raises(InputError, match="length: must be at least"):
        find_moment_rate(path, length=0.001)
