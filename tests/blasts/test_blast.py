import numpy as np
import pytest

from pyblast.blasts.blast import Blast, Firing
from pyblast.errors import InputError

PAPER = Firing.rows(4, 15, 0.040)


def blast(n_holes=4, **changes):
    collar = np.column_stack([7.5 * np.arange(n_holes), np.zeros(n_holes), np.zeros(n_holes)])
    values = {
        "name": "test",
        "collar": collar,
        "toe": collar - [0.0, 0.0, 17.0],
        "charge": 450.0,
        "times": 0.040 * np.arange(n_holes),
        "diameter": 0.25,
    }
    return Blast(**{**values, **changes})


def sentences(**changes):
    return " ".join(blast(**changes).checks())


def test_rows_fire_sixty_impulses_at_four_instants():
    instants, counts = np.unique(PAPER.times, return_counts=True)

    assert instants == pytest.approx([0.0, 0.04, 0.08, 0.12], abs=1e-15)
    assert list(counts) == [15] * 4


def test_the_paper_fires_6750_kg_per_delay():
    production = Blast("paper", np.zeros((60, 3)), np.zeros((60, 3)), 450.0, PAPER.times)

    assert production.charge_per_window() == 6750.0


@pytest.mark.parametrize("hz", [6.25, 12.5, 18.75])
def test_the_comb_of_the_paper_is_zero_at(hz):
    assert PAPER.comb_spectrum(hz) == pytest.approx([0.0], abs=1e-14)


@pytest.mark.parametrize(
    ("hz", "level", "tolerance"),
    [
        (0.0, 1.0, 1e-12),
        (2.85, 0.5**0.5, 2e-3),
        (4.0, 0.47, 1e-3),
        (9.15, 0.27, 3e-3),
        (15.85, 0.27, 3e-3),
        (20.0, 0.25, 1e-12),
        (25.0, 1.0, 1e-12),
    ],
)
def test_the_comb_of_the_paper_has_its_levels(hz, level, tolerance):
    assert PAPER.comb_spectrum(hz) == pytest.approx([level], abs=tolerance)


def test_the_comb_is_the_closed_form_of_equal_rows():
    hz = np.linspace(0.1, 24.9, 777)
    exact = np.abs(np.sin(4 * np.pi * hz * 0.04) / (4 * np.sin(np.pi * hz * 0.04)))

    assert PAPER.comb_spectrum(hz) == pytest.approx(exact, abs=1e-12)


def test_scatter_lowers_the_comb_as_its_expectation_says():
    sigma, hz, generator = 0.004, 20.0, np.random.default_rng(5)
    draws = [PAPER.scattered(sigma, generator).comb_spectrum(hz)[0] ** 2 for _ in range(3000)]

    kept = np.exp(-((2 * np.pi * hz * sigma) ** 2))
    expected = kept * PAPER.comb_spectrum(hz)[0] ** 2 + (1 - kept) / 60.0
    assert np.mean(draws) == pytest.approx(expected, rel=0.05)


def test_the_window_is_half_open():
    assert blast(times=[0.0, 0.008, 0.016, 0.024]).charge_per_window(0.008) == 450.0


def test_the_window_may_begin_at_any_hole():
    assert blast(times=[0.0, 0.005, 0.012, 0.0129]).charge_per_window(0.008) == 3 * 450.0


def test_scales_follow_the_charge_to_the_exponent():
    firing = blast(charge=[100.0, 200.0, 400.0, 800.0]).firing(200.0, exponent=0.5)

    assert firing.scales == pytest.approx([0.5**0.5, 1.0, 2.0**0.5, 2.0])


def test_without_a_reference_all_scales_are_one():
    assert np.all(blast().firing().scales == 1.0)


def test_a_missing_charge_is_named_when_it_is_needed():
    unknown = blast(charge=[450.0, np.nan, 450.0, 450.0])

    with pytest.raises(InputError, match="missing for hole 2"):
        unknown.firing(450.0)


def test_the_centre_of_a_deck_lies_between_its_top_and_base():
    assert blast(deck=[[6.0, 17.0]] * 4).centres[0] == pytest.approx([0.0, 0.0, -11.5])


def test_the_charge_of_the_paper_fills_10_8_of_17_m():
    assert blast().charge_length == pytest.approx(10.8, abs=0.05)
    assert "does not fit" not in sentences()


def test_a_denser_explosive_fills_less_and_acts_lower():
    dense = blast(explosive_density=1275.0)

    assert dense.charge_length == pytest.approx(blast().charge_length / 1.5)
    assert dense.centres[0, 2] == pytest.approx(-17.0 + 0.5 * dense.charge_length[0])


def test_checks_give_times_and_charge_first():
    first, second, *_ = blast().checks()

    assert first == ("4 charges fire at 4 instants, the first at 0 ms, the last at 120 ms.")
    assert second.startswith("The largest charge in any 8 ms window is 450 kg, from 0 ms on")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"hole_ids": ("A", "B", "A", "C")}, "Hole names that occur more than once: A"),
        ({"times": [0.0, 0.04, 0.04, 0.12]}, "Up to 2 charges share one instant"),
        ({"charge": [1.0, 2.0, np.nan, 4.0]}, "charge is missing for hole 3"),
        ({"charge": 900.0}, "does not fit as ANFO"),
        ({"stated_length": [17.0, 17.0, 18.5, 17.0]}, "18.5 m against 17 m"),
        ({"stated_inclination": np.radians(90.0)}, "counts from the horizontal"),
        ({"stated_inclination": np.radians(20.0)}, "differs from collar and toe"),
        ({"notes": ("The reader saw something.",)}, "The reader saw something."),
    ],
)
def test_checks_say_what_is_doubtful(changes, sentence):
    assert sentence in sentences(**changes)


def test_checks_find_two_charges_at_one_place():
    places = np.array([[0.0, 0, 0], [0, 0, 0], [9, 0, 0], [18, 0, 0]])

    assert "within 1 cm" in sentences(collar=places, toe=places)


def test_checks_find_a_hole_far_away():
    places = np.array([[0.0, 0, 0], [5, 0, 0], [9, 0, 0], [18000, 0, 0]])

    assert "More than 1 km" in sentences(collar=places, toe=places)


def test_checks_say_that_45_degrees_is_ambiguous():
    toe = blast().collar + np.array([12.0, 0.0, -12.0])

    assert "near 45 degrees" in sentences(toe=toe, stated_inclination=np.radians(45.0))


def test_checks_are_silent_about_a_sound_table():
    assert len(blast(stated_length=17.0, stated_inclination=0.0).checks()) == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"collar": np.zeros((4, 2))}, "collar: need shape"),
        ({"times": [0.0, 0.1]}, r"times: need shape \(4,\)"),
        ({"times": [0.0, 0.1, -0.1, 0.2]}, "times: must not be negative, got -0.1 at hole 3"),
        ({"charge": -1.0}, "charge: must be >= 0 kg"),
        ({"diameter": 250.0}, "diameter: must be 0.01 to 10 m, is the unit right"),
        ({"times": 5000.0}, "is the unit right"),
        ({"collar": np.full((4, 3), 1e300)}, "within 1e8 m"),
        ({"toe": np.full((4, 3), np.nan)}, "toe: must be finite"),
        ({"hole_ids": ("A",)}, "1 names for 4 holes"),
        ({"deck": [[9.0, 5.0]] * 4}, "deck: top must lie above base"),
    ],
)
def test_a_wrong_blast_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        blast(**changes)


@pytest.mark.parametrize(
    ("times", "scales", "message"),
    [([], [], "one time per hole"), ([np.nan], [1.0], "firing.times: must be finite")],
)
def test_a_wrong_firing_is_refused(times, scales, message):
    with pytest.raises(InputError, match=message):
        Firing(times, scales)


def test_a_charge_sits_on_the_toe_and_its_middle_follows():
    length = 10.0
    mass_per_metre = 850.0 * np.pi / 4.0 * 0.1**2
    blast = Blast("B", [[0, 0, 0]], [[0, 0, -length]], [4.0 * mass_per_metre], [0.0], [0.1])

    assert blast.centres[0] == pytest.approx([0.0, 0.0, -8.0])
