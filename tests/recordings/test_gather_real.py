"""Real recordings beside the repository: read, repeated, superposed, fired."""

import csv
import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from firing_times import firing_times

from pyblast.blasts.blast import Firing
from pyblast.blasts.hole_tables import read_blast
from pyblast.blasts.signature import superpose
from pyblast.recordings.recording import read_gather
from pyblast.signals.comparison import compare
from pyblast.signals.seismogram import Seismogram

README = Path(__file__).parents[2] / "examples" / "real" / "README.md"
PLACES = {-5.0: "6", -10.0: "11", -20.0: "16", 51.0: "26", 56.0: "31", 66.0: "36"}
BAND = (10.0, 40.0)
FIRING = Firing(0.042 * np.arange(12), 1.0)


def hit(folder, number, channel):
    gather = read_gather(folder / "wghs" / f"{number}.dat")
    vertical = gather.data[channel] - gather.data[channel].mean()
    unknown = np.full(len(vertical), np.nan)
    return Seismogram(
        np.column_stack([unknown, unknown, vertical]), gather.dt, gather.start
    ).windowed(-0.1, 0.9)


def listed_files():
    return re.findall(r"^\| (\S+) \| `([0-9a-f]{64})` \|$", README.read_text(), re.MULTILINE)


def test_every_file_used_is_listed_with_its_digest():
    names = [name for name, _ in listed_files()]

    assert len([n for n in names if n.startswith("wghs/") and n.endswith(".dat")]) == 30
    assert len([n for n in names if n.startswith("blast_plans/")]) == 3


def test_files_are_those_that_the_studies_were_made_with(recordings):
    found = {
        name: hashlib.sha256((recordings / name).read_bytes()).hexdigest()
        for name, _ in listed_files()
    }

    assert found == dict(listed_files())


@pytest.mark.parametrize(("place", "number"), PLACES.items())
def test_gather_says_where_the_hammer_and_the_geophones_were(recordings, place, number):
    gather = read_gather(recordings / "wghs" / f"{number}.dat")

    assert gather.source_position[0] == place
    assert gather.receiver_positions[:, 0].tolist() == list(range(0, 48, 2))
    assert (gather.dt, gather.start, gather.unit) == (1e-3, -0.5, "V")
    assert not gather.dead.any()
    assert not gather.clipped.any()


def test_first_arrival_comes_later_at_every_farther_geophone_of_the_near_half(recordings):
    gather = read_gather(recordings / "wghs" / "28.dat")
    noise = np.std(gather.data[:, gather.times < -0.02], axis=1)
    loud = (np.abs(gather.data) > 8.0 * noise[:, None]) & (gather.times > 0.0)
    first = gather.times[np.argmax(loud, axis=1)][::-1][:8]

    assert 0.01 < first[0] < 0.02
    assert np.all(np.diff(first) >= 0.0)


def test_repeating_one_hit_adds_nothing_but_rounding(recordings):
    one = hit(recordings, 28, 12)
    motion = superpose(one, FIRING).velocity[:, 2]
    by_hand = np.zeros_like(motion)
    for n in range(12):
        by_hand[42 * n : 42 * n + len(one.velocity)] += one.velocity[:, 2]

    assert motion == pytest.approx(by_hand, abs=1e-14 * np.max(np.abs(by_hand)))


def test_one_real_hit_predicts_the_sum_of_twelve_others_only_in_part(recordings):
    firsts = [int(number) for number in PLACES.values()]
    signatures = [hit(recordings, first, 18) for first in firsts] * 2
    others = [hit(recordings, first + n, 18) for n in (1, 2) for first in firsts]
    truth = superpose(signatures[0], FIRING, signatures=others)
    predicted = superpose(signatures[0], FIRING, signatures=signatures)

    misfit = compare(truth, predicted, BAND, time_frequency=False).waveform_misfit

    assert np.isnan(misfit[:2]).all()
    assert 0.02 < misfit[2] < 0.6


def test_hidden_firing_times_are_found_from_real_hits(recordings):
    channels, plan = range(0, 24, 3), 0.042 * np.arange(6)
    delays = 1e-3 * np.array([4.0, -3.0, 5.0, -4.0, 2.0, -5.0])
    known, other = (
        [[hit(recordings, int(n) + k, c).bandpassed(10.0, 80.0) for c in channels]
         for n in PLACES.values()] for k in (0, 1)
    )  # fmt: skip
    firing = Firing(0.02 + plan + delays, 1.0)
    sums = [superpose(other[0][c], firing, signatures=[o[c] for o in other])
            for c in range(len(channels))]  # fmt: skip
    record = np.array([s.velocity[:, 2] for s in sums])
    greens = np.array([[s.velocity[:, 2] for s in one] for one in known])
    begin = 0.02 + known[0][0].start - sums[0].start

    found = firing_times(greens, record, 1e-3, plan + begin, sigma=0.004)

    errors = np.abs(found.times - begin - plan - delays)
    assert np.median(errors) < 0.0008  # the triggers differ by 0 to 1.9 ms
    assert found.misfit_after < 0.25 < 0.5 < found.misfit_before


@pytest.mark.parametrize(
    ("plan", "holes", "charge", "in_8_ms", "last"),
    [
        ("KAB_BLAST_ALLCOL", 410, 41321.0, 542.0, 1.641),
        ("blastlogic_kirra_S4_226_401", 404, 135590.0, 4263.0, 2.546),
        ("blastlogic_kirra_S4_226_414P", 54, 567.0, 567.0, 0.0),
    ],
)
def test_real_plan_is_read_with_its_charge_and_times(
    recordings, plan, holes, charge, in_8_ms, last
):
    blast = read_blast(recordings / "blast_plans" / f"{plan}.csv")

    assert len(blast.times) == holes
    assert blast.charge.sum() == pytest.approx(charge, abs=1.0)
    assert blast.charge_per_window() == pytest.approx(in_8_ms, abs=0.5)
    assert blast.times.max() == pytest.approx(last)


def test_times_added_up_along_the_ties_are_those_that_the_plan_states(recordings):
    path = recordings / "blast_plans" / "KAB_BLAST_ALLCOL.csv"
    with path.open(newline="") as table:
        stated = [1e-3 * float(row["holeTime"]) for row in csv.DictReader(table)]

    assert read_blast(path).times == pytest.approx(stated, abs=1e-9)
