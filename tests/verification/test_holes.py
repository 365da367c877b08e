"""Production blasts by a closed form: its waves, what is hidden, and the table of the page."""

import numpy as np
import pytest

from pyblast.blasts.hole_effects import ROWS, Pattern
from verification import holes


def patterns():
    """Return the patterns of three blasts."""
    fired = holes.blasts(np.random.default_rng(3))[:3]
    return [Pattern(blast, holes.PLACES, 70.0) for blast in fired]


def test_waves_are_radial_and_decay_as_those_of_a_centre_of_dilatation():
    (own, *_), (_, omega) = patterns(), holes.grid()
    ray = np.array([2.0, 1.0, 0.5]) / np.linalg.norm([2.0, 1.0, 0.5])
    away = np.array([100.0, 200.0])
    near, far = np.moveaxis(
        holes.spectra(own.blast, omega, own.blast.centres[0] + np.outer(away, ray))[0], 0, 0
    )
    rate = holes.MOMENT * own.blast.charge[0] / (1.0 + 1j * omega * holes.PULSE) ** 2
    size = 4.0 * np.pi * holes.DENSITY * holes.CP**3

    for r, moved in ((100.0, near), (200.0, far)):
        along = ray @ moved
        np.testing.assert_allclose(moved, ray[:, None] * along, atol=1e-12 * np.abs(along).max())
        wanted = rate * (1j * omega / r + holes.CP / r**2) / size
        np.testing.assert_allclose(along * np.exp(1j * omega * r / holes.CP), wanted)


@pytest.mark.parametrize("name", ["charge_exponent", "screening/delay"])
def test_a_row_is_hidden_at_three_per_cent_of_the_energy(name):
    own, (_, omega) = patterns(), holes.grid()
    row = next(each for each in ROWS if each.name == name)
    theta = holes.strength_of(row, own, omega)
    inside = (omega > 2.0 * np.pi * holes.BAND[0]) & (omega < 2.0 * np.pi * holes.BAND[1])
    shares = []
    for pattern in own:
        plan, moved = (
            holes.fired_at(holes.changed(each, pattern, theta, omega), pattern.blast.times, omega)
            for each in (None, row)
        )
        energy = [np.sum(np.abs(x[..., inside]) ** 2, axis=(1, 2)) for x in (moved - plan, plan)]
        shares.append(energy[0] / energy[1])

    assert np.mean(shares) == pytest.approx(holes.SHARE, rel=0.02)


def test_holes_vary_by_what_is_said():
    own = patterns()[0]
    factors = [holes.varied(own.blast, 0.2, np.random.default_rng(seed), 8) for seed in range(30)]
    _, omega = holes.grid()
    inside = (omega > 2.0 * np.pi * holes.BAND[0]) & (omega < 2.0 * np.pi * holes.BAND[1])
    size = np.sqrt(np.mean(np.log(np.abs(np.array(factors)[..., inside])) ** 2))

    assert size == pytest.approx(0.2, rel=0.15)


def test_the_table_counts_nulls_with_a_name():
    row = {"effect": "", "outcome": "NULL", "labels": [], "found": [0.21, 0.18, 0.24]}
    wrong = row | {"outcome": "NAMED", "labels": ["screening"], "found": [0.4, 0.3, 0.5]}
    lines = holes.table({"site 0": row, "null 20 %, 0": row, "null 20 %, 1": wrong})

    assert lines[2] == "| site 0 | nothing | NULL | 21 (18 to 24) |"
    assert lines[3].startswith(
        "| nulls: 2 | holes vary by 20 % | 1 with a name | 30 in the median, 50"
    )
