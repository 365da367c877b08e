"""Laws of nature that every law of zones obeys: case L12 in the small."""

import copy

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast import core
from verification.zone import INITIAL, MATERIALS, Zone, strain_cycle, turned_column, turned_zone

EACH = pytest.mark.parametrize("name", core.ZONE_LAWS)
LOSING = ("mohr-coulomb", "hoek-brown", "ubiquitous")


def led(zone, strains):
    """Lead a zone along strains; return it."""
    for strain in strains:
        zone.strain(strain)
    return zone


def test_every_law_is_tried_here():
    assert set(MATERIALS) == set(core.ZONE_LAWS)


@EACH
def test_signatures_fit_into_the_tables(name):
    law = core.ZONE_LAWS[name]

    assert len(law.properties) <= core.N_ZONE_PROPERTIES
    assert set(law.properties) == set(MATERIALS[name].law.properties(MATERIALS[name]))


@EACH
def test_untouched_ground_has_its_initial_stress_and_holds_no_energy(name):
    zone = Zone(name)

    assert zone.stress == pytest.approx(INITIAL, rel=1e-12)
    assert zone.stored == pytest.approx(0.0, abs=1e-9)


@EACH
@pytest.mark.parametrize("seed", range(4))
def test_work_is_what_is_stored_and_lost(name, seed):
    zone = led(Zone(name), strain_cycle(seed))

    scale = 1e10 * np.abs(strain_cycle(seed)).max() ** 2
    assert zone.work == pytest.approx(zone.stored + zone.lost[0], abs=1e-9 * scale)


@EACH
@pytest.mark.parametrize("seed", range(4))
def test_no_closed_path_gives_energy(name, seed):
    zone, strains = Zone(name), strain_cycle(seed)

    there = led(zone, strains).work
    back = led(zone, strains[::-1]).work

    scale = 1e10 * np.abs(strains).max() ** 2
    assert there >= -1e-9 * scale
    assert back >= -1e-9 * scale
    assert (zone.lost[0] > 0.0) == (name in LOSING)


@EACH
def test_turned_ground_answers_turned_strains_alike(name):
    turn = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    zone, other = Zone(name), turned_zone(name, turn)

    for strain in strain_cycle(1, steps=50, size=1e-4):
        wanted = turned_column(turn, zone.strain(strain))
        found = other.strain(turned_column(turn, strain, 2.0))
        assert found == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
    assert other.lost == pytest.approx(zone.lost, rel=1e-9, abs=1e-9)


@EACH
def test_a_zone_goes_on_from_what_it_keeps_with_the_same_bits(name):
    strains = strain_cycle(2)
    zone = led(Zone(name), strains[:200])
    again = copy.deepcopy(zone)

    for strain in strains[200:]:
        assert zone.strain(strain).tobytes() == again.strain(strain).tobytes()
    assert zone.lost.tobytes() == again.lost.tobytes()
