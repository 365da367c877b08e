"""Records as a diagnosis compares them: at the same instants, however they were sampled."""

from dataclasses import replace

import numpy as np
import pytest
from small_site import BEFORE, DT, SAMPLES, small_site

from pyblast.diagnosis.case import case_of
from pyblast.motion.seismogram import Seismogram
from pyblast.records.recordings import Recording

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
    return replace(site, records={b: dict.fromkeys(names, record) for b in site.blasts})


@pytest.mark.parametrize("share", [0.4, -0.3])
def test_records_between_the_instants_of_the_blast_are_read_at_them(share):
    whole, off = (case_of(site_with(part * DT)).motion for part in (0.0, share))

    wrong = np.sum((whole[..., :90] - off[..., :90]) ** 2) / np.sum(whole**2)

    assert wrong < 1e-6  # of the energy; 1.8 and 1.0 % when taken for the nearest instants
