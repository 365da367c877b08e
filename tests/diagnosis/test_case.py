"""Records as a diagnosis compares them: at the same instants, however they were sampled."""

from dataclasses import replace

import numpy as np
import pytest
from small_site import BEFORE, DT, SAMPLES, TABLES, small_site, with_records

from pyblast.config.config import check_config
from pyblast.diagnosis.case import case_of
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram

RICKER = 12.0  # Hz


def site_with(shift):
    """Return the small site with one pulse in all records, sampled ``shift`` s late."""
    times = DT * np.arange(-BEFORE, SAMPLES) + shift
    noise = np.random.default_rng(1).normal(size=(len(times), 3)) * (times < -0.02)[:, None]
    turn = (np.pi * RICKER * (times - 0.2)) ** 2
    velocity = ((1.0 - 2.0 * turn) * np.exp(-turn))[:, None] + 1e-6 * noise
    record = Recording(
        Seismogram(velocity, DT, -BEFORE * DT + shift), "", "", None,
        np.zeros(velocity.shape, dtype=bool),
    )  # fmt: skip
    site = small_site()
    names = [r.name for r in site.receivers]
    return with_records(site, {b: dict.fromkeys(names, record) for b in site.blasts})


def record_without(record, count, offset):
    """Return a record whose vertical stays at an offset for so many samples."""
    velocity = record.seismogram.velocity.copy()
    velocity[:, 2] += offset
    velocity[:count, 2] = offset
    return replace(record, seismogram=replace(record.seismogram, velocity=velocity))


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, -3.0, 4.0), (1.0, 1.0, -1.0)])
def test_a_sensor_of_one_component_is_one_channel_whatever_its_direction(normal):
    site = site_with(0.0)
    record = site.survey.recordings["S1"]["R0"]
    alone = replace(record.seismogram, velocity=record.seismogram.velocity * [np.nan, np.nan, 1.0])
    records = {b: dict.fromkeys(table, replace(record, seismogram=alone))
               for b, table in site.survey.recordings.items()}  # fmt: skip
    up = with_records(site, records)
    receivers = tuple(replace(each, normal=normal) for each in up.survey.receivers)
    turned = replace(up, survey=replace(up.survey, receivers=receivers))

    case, up = case_of(turned), case_of(up)

    column = int(np.argmax(np.abs(normal)))
    part = normal[column] / np.linalg.norm(normal)
    assert case.valid.any(axis=-1).sum(axis=-1).max() == 1
    assert case.valid.sum() == up.valid.sum()
    np.testing.assert_allclose(case.motion[..., column, :], part * up.motion[..., 2, :])
    np.testing.assert_allclose(
        case.noise.variance[:, column], part**2 * up.noise.variance[:, 2], rtol=1e-9
    )


@pytest.mark.parametrize("share", [0.4, -0.3])
def test_records_between_the_instants_of_the_blast_are_read_at_them(share):
    whole, off = (case_of(site_with(part * DT)).motion for part in (0.0, share))

    wrong = np.sum((whole[..., :90] - off[..., :90]) ** 2) / np.sum(whole**2)

    assert wrong < 1e-6  # of the energy; 1.8 and 1.0 % when taken for the nearest instants


@pytest.mark.parametrize("offset", [0.0, 1e-3])
def test_a_channel_that_is_still_before_the_blast_is_dead_only_if_it_stays_so(offset):
    site = site_with(0.0)
    some = site.survey.recordings
    live, up = (record_without(some["S1"]["R0"], count, offset) for count in (BEFORE, None))
    records = {name: {**some[name], "R1": live, "R2": up} for name in site.blasts}
    plain, case = case_of(site), case_of(with_records(site, records))

    assert case.unused == {"R2 up": "it never moves"}
    assert case.valid[:, 1].all()
    assert not case.valid[:, 2, 2].any()
    np.testing.assert_allclose(case.noise.variance[1, 2], plain.noise.variance[0].max(), rtol=1e-6)
    assert np.abs(case.noise.correlation[1, :2, 2]).max() < 0.9  # not a copy of its neighbour's


def test_a_channel_that_stands_still_in_one_blast_has_no_part_in_that_blast():
    site = site_with(0.0)
    some = site.survey.recordings
    lost = record_without(site.survey.recordings["B1"]["R1"], None, 1e-3)
    lame = with_records(site, some | {"B1": some["B1"] | {"R1": lost}})
    plain, case = case_of(site), case_of(lame)

    assert case.unused == {"R1 up in B1": "it never moves"}
    assert not case.valid[case.blasts.index("B1"), 1, 2].any()
    assert case.valid.sum() == plain.valid.sum() - case.n_samples
    more = case.noise.variance / plain.noise.variance
    assert 1.0 < more[1, 2] < 2.0  # one window tells of it now: nu / (nu - 2) of half as many
    assert np.delete(more, 5) == pytest.approx(1.0)


def test_what_enters_is_read_once_whatever_becomes_of_the_ground(monkeypatch):
    enters = {
        "signature": {"cavity": {
            "material": "rock", "hole_m": [-40, 45, -10], "receiver_m": [0, 45, -10],
            "charge_kg": 60, "radius_m": 2, "peak_time_ms": 60,
        }},
        "input": {"face": "west"},
    }  # fmt: skip
    site, tables = site_with(0.0), check_config({**TABLES, **enters, "holes_inside": None})
    config = {name: getattr(tables, name) for name in ("signature", "input", "holes_inside")}
    config = site.config.model_copy(update=config)
    shot = replace(site.shots[0], config=config, held=None)
    site = replace(site, config=config, survey=replace(site.survey, shots=(shot,)))
    project = case_of(site, ["S1"]).project
    motion, lead = project.input.motion, project.lead
    monkeypatch.setattr("pyblast.sources.shot.make_signature", None)

    finer = project.config.mesh.model_copy(update={"edge_m": 20.0})
    other = project.changed(mesh=finer).of("S1")

    assert other.input.motion is motion
    assert other.lead == lead
