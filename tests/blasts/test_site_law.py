"""The law of a site: least squares, prediction lines that hold what they say, refusals."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from pyblast import InputError, fit_site_law
from pyblast.blasts.site_law import (
    read_site_records,
    scaled_distance_ppv,
    site_law_of_exponent,
)
from pyblast.cli.commands import app
from pyblast.errors import ReadError

K, BETA, S = 1.2, 1.6, 0.2


def records(generator, n=20, s=S):
    distance, charge = generator.uniform(80.0, 900.0, n), generator.uniform(20.0, 300.0, n)
    scatter = 10.0 ** generator.normal(0.0, s, n)
    return distance, charge, scaled_distance_ppv(distance, charge, K, BETA) * scatter


def test_records_without_scatter_give_their_law_back():
    law = fit_site_law(*records(np.random.default_rng(0), s=0.0))

    assert law.k == pytest.approx(K, rel=1e-12)
    assert law.beta == pytest.approx(BETA, rel=1e-12)
    assert law.peak(200.0, 50.0).level(0.5) == pytest.approx(
        scaled_distance_ppv(200.0, 50.0, K, BETA)
    )


def test_fit_is_that_of_linear_regression():
    distance, charge, ppv = records(np.random.default_rng(1))

    law = fit_site_law(distance, charge, ppv, charge_exponent=1.0 / 3.0)

    wanted = stats.linregress(np.log10(distance / np.cbrt(charge)), np.log10(ppv))
    half = stats.t.ppf(0.95, 18) * wanted.stderr
    assert -law.beta == pytest.approx(wanted.slope, rel=1e-12)
    assert np.log10(law.k) == pytest.approx(wanted.intercept, rel=1e-12)
    assert law.r2 == pytest.approx(wanted.rvalue**2, rel=1e-12)
    assert law.beta_interval() == pytest.approx((law.beta - half, law.beta + half), rel=1e-12)


@pytest.mark.parametrize("n", [8, 40])
def test_lines_hold_the_share_of_new_blasts_that_they_say(n):
    generator, below, inside = np.random.default_rng(n), [], 0
    places, scaled = np.geomspace(5.0, 200.0, n), np.geomspace(5.0, 200.0, 10)
    for _ in range(1000):
        peaks = K * places**-BETA * 10.0 ** generator.normal(0.0, S, n)
        law = fit_site_law(places, 1.0, peaks)
        fresh = K * scaled**-BETA * 10.0 ** generator.normal(0.0, S, 10)
        below.append([fresh < law.peak(scaled, 1.0).level(share) for share in (0.5, 0.95)])
        low, high = law.beta_interval(0.9)
        inside += low < BETA < high

    shares = np.mean(below, axis=(0, 2))
    assert shares == pytest.approx([0.5, 0.95], abs=0.01)  # 10^4 blasts
    assert inside / 1000 == pytest.approx(0.9, abs=0.03)


def test_charge_of_a_limit_meets_the_limit_on_the_line():
    law = fit_site_law(*records(np.random.default_rng(3)))

    charge = law.largest_charge(300.0, 0.005, 0.95)

    assert law.peak(300.0, charge).level(0.95) == pytest.approx(0.005, rel=1e-5)
    with pytest.raises(InputError, match=r"900 mm/s is not between .* record nearer"):
        law.largest_charge(300.0, 0.9)


def test_parallel_line_of_other_programs_is_below_the_prediction_line():
    law = fit_site_law(*records(np.random.default_rng(4), 8))
    scaled = np.geomspace(*law.reach, 9)

    assert law.k95 == pytest.approx(law.k * 10.0 ** (1.6448536 * law.s))
    assert (law.k95 * scaled**-law.beta < law.peak(scaled, 1.0).level(0.95)).all()


def test_doubts_are_told():
    generator = np.random.default_rng(5)
    few = fit_site_law(*records(generator, 12))
    scaled = np.geomspace(5.0, 500.0, 40)
    bent = scaled**-1.0 * 10.0 ** (-0.5 * np.log10(scaled / 50.0) ** 2)

    assert "12 records" in few.notes[0]
    assert fit_site_law(*records(generator, 50)).notes == ()
    assert "bend away" in fit_site_law(scaled, 1.0 + 0.0 * scaled, bent).notes[0]


@pytest.mark.parametrize(
    ("scaled", "ppv", "message"),
    [
        ([10, 20, 40, 80, 160], [5, 4, 3, 2, 1], "5 records; at least 6"),
        ([10, 11, 12, 13, 14, 90], [9, 8, 7, 6, 5, 1], "without one record .* factor of 1.4"),
        ([10, 20, 40, 80, 160, 320], [1, 2, 3, 4, 5, 6], "it may not fall"),
        ([10, 20, 40, 80, 160, 320], [1, 9, 1, 9, 1, 5], "it may not fall"),
        ([10, 20, 40, 80, 160, 320], [9, 8, 0, 6, 5, 4], "ppv must be positive, got 0 in record 3"),
        ([10, 20, -4, 80, 160, 320], [9, 8, 7, 6, 5, 4], "distance must be positive, got -4 in re"),
        ([10, 20, 40, 80, 160, 320], [9, 8], "one distance, charge and ppv for each"),
    ],
)
def test_fits_that_the_data_do_not_support_are_refused(scaled, ppv, message):
    with pytest.raises(InputError, match=message):
        fit_site_law(scaled, np.ones(len(scaled)), ppv)


def test_law_is_not_used_far_outside_its_records():
    law = fit_site_law(*records(np.random.default_rng(6)))

    law.peak(1.5 * law.reach[1], 1.0)
    with pytest.raises(InputError, match=r"got .* to"):
        law.peak(1.6 * law.reach[1], 1.0)


def test_table_is_read_with_its_units(tmp_path):
    table = tmp_path / "peaks.csv"
    table.write_text("blast,distance_ft,charge_lb,ppv_in_per_s\nA,100,10,0.5\n\nB,200,20,0.1\n")

    found = read_site_records(table)

    assert found.distance == pytest.approx([30.48, 60.96])
    assert found.charge == pytest.approx([4.5359237, 9.0718474])
    assert found.ppv == pytest.approx([0.0127, 0.00254])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("distance_m,charge_kg,ppv\n1,2,3\n", "column 3 'ppv' needs its unit, mm/s or m/s"),
        (
            "distance_m,charge_kg,ppv_mm_per_s\n1,2,much\n",
            "line 2, .* expected a number, got 'much'",
        ),
        ("distance_m,charge_kg,ppv_mm_per_s\n", "a header but no rows"),
    ],
)
def test_table_that_can_not_be_read_is_refused(tmp_path, text, message):
    table = tmp_path / "peaks.csv"
    table.write_text(text)

    with pytest.raises(ReadError, match=message):
        read_site_records(table)


def test_law_of_a_published_table_is_found(recordings):
    table = recordings / "ppv_law" / "fgbastante_ppv_law.txt"
    if not table.is_file():
        pytest.skip("the table of peaks is absent; examples/real/README.md says where to fetch it")
    scaled, peak = 10.0 ** np.loadtxt(table, skiprows=1).T

    law = fit_site_law(scaled, np.ones(len(scaled)), peak)

    assert (law.n, law.notes) == (50, ())
    assert law.k == pytest.approx(1384.0, abs=0.5)
    assert law.beta == pytest.approx(1.629, abs=5e-4)
    assert law.s * np.sqrt(48 / 50) == pytest.approx(0.231, abs=5e-4)  # told with n, not n - 2


def test_command_prints_the_law_and_the_charges_of_a_limit():
    table = Path(__file__).parents[2] / "examples" / "site_peaks.csv"

    done = CliRunner().invoke(app, ["sitelaw", str(table), "--limit", "5"])

    assert done.exit_code == 0, done.output
    assert "90 % interval of the exponent" in done.output
    assert "charge kg in 8 ms for 5 mm/s" in done.output


def test_example_ends_with_a_figure(tmp_path):
    script = Path(__file__).parents[2] / "examples" / "02_site_law.py"
    figure = tmp_path / "law.png"
    environment = os.environ | {"PYTHONPATH": str(script.parents[1]), "MPLBACKEND": "agg"}
    table = script.with_name("site_peaks.csv")

    done = subprocess.run([sys.executable, script, table, figure], env=environment, text=True,
                          capture_output=True, timeout=60, check=True)  # fmt: skip

    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "PPV = " in done.stdout


@pytest.mark.parametrize("factor", [3.4, 0.2])
def test_a_record_that_the_law_of_the_others_does_not_allow_is_named(factor):
    rng = np.random.default_rng(3)
    distance = np.linspace(80.0, 500.0, 12)
    ppv = 0.9 * (distance / 8.0) ** -1.5 * 10.0 ** rng.normal(0.0, 0.06, 12)
    clean = fit_site_law(distance, np.full(12, 64.0), ppv)
    ppv[6] *= factor

    (said,) = [
        note for note in fit_site_law(distance, np.full(12, 64.0), ppv).notes if "lies" in note
    ]

    others = fit_site_law(np.delete(distance, 6), np.full(11, 64.0), np.delete(ppv, 6))
    times = ppv[6] / others.peak(distance[6], 64.0).level(0.5)
    assert not any("lies" in note for note in clean.notes)
    assert f"record 7 lies {max(times, 1.0 / times):.2g} times" in said
    assert ("above" in said) == (factor > 1.0)


def test_an_outlier_is_named_where_it_hides_the_law():
    distance = np.array([100.0, 120.0, 150.0, 180.0, 210.0, 240.0])
    ppv = 0.9 * (distance / 8.0) ** -1.5 * np.array([1.02, 0.97, 1.03, 0.98, 1.02, 9.0])

    with pytest.raises(InputError, match=r"may not fall at all.*record 6 lies .* above the law"):
        fit_site_law(distance, np.full(6, 64.0), ppv)


def test_of_sites_without_an_outlier_one_in_twenty_names_one():
    rng = np.random.default_rng(1)
    distance, named = np.geomspace(50.0, 500.0, 15), 0
    for _ in range(400):
        ppv = 0.9 * (distance / 8.0) ** -1.5 * 10.0 ** rng.normal(0.0, 0.15, 15)
        law = fit_site_law(distance, np.full(15, 64.0), ppv)
        named += any("law of the others" in note for note in law.notes)

    assert 8 <= named <= 32  # 20 expected, standard deviation 4.4


def test_peaks_below_the_trigger_do_not_bend_the_law():
    generator = np.random.default_rng(5)
    found = {"left out": [], "as bounds": []}
    for _ in range(40):
        distance = np.geomspace(60.0, 600.0, 80)
        ppv = 0.5 * (distance / 5.0) ** -1.5 * 10.0 ** generator.normal(0.0, 0.2, 80)
        level = 0.5 * (300.0 / 5.0) ** -1.5
        below = ppv < level
        charge = np.full(80, 25.0)
        found["left out"].append(fit_site_law(distance[~below], charge[~below], ppv[~below]))
        found["as bounds"].append(
            fit_site_law(distance, charge, np.where(below, level, ppv), below=below)
        )

    beta = {name: np.mean([law.beta for law in laws]) for name, laws in found.items()}
    assert beta["as bounds"] == pytest.approx(1.5, abs=0.03)
    assert beta["left out"] < 1.4
    assert np.mean([law.s for law in found["as bounds"]]) == pytest.approx(0.2, rel=0.05)


def test_law_of_a_given_exponent_has_the_level_of_its_records():
    distance = np.linspace(100.0, 110.0, 8)
    ppv = 0.7 * (distance / 5.0) ** -1.6 * 10.0 ** np.resize([0.1, -0.1], 8)

    law = site_law_of_exponent(distance, np.full(8, 25.0), ppv, 1.6)

    assert law.k == pytest.approx(0.7)
    assert law.n_free == 7
    assert law.s == pytest.approx(0.1 * np.sqrt(8 / 7))
    assert law.peak(105.0, 25.0).level(0.5) == pytest.approx(0.7 * 21.0**-1.6)
    with pytest.raises(InputError, match="5 records; at least 6"):
        site_law_of_exponent(distance[:5], np.full(5, 25.0), ppv[:5], 1.6)
