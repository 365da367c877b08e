"""Laws of nature that every law of zones obeys."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pyblast.solving import kernels
from pyblast.solving.anisotropy import jointed
from pyblast.solving.attenuation import ConstantQ
from pyblast.solving.materials import Material
from pyblast.solving.plasticity import MohrCoulomb

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0, cohesion=1e6, friction=0.5, tension=4e5)
MATERIALS = {
    "elastic": ROCK,
    "viscoelastic": replace(ROCK, law=ConstantQ(25.0, 12.0)),
    "anisotropic": jointed(ROCK, (1.0, 0.3, 0.5), 3.0, 1e10, 4e9),
    "mohr-coulomb": replace(ROCK, law=MohrCoulomb(0.2, cohesion_residual=3e5, shear_strain=2e-3)),
}
EACH = pytest.mark.parametrize("name", kernels.ZONE_LAWS)
COLUMN = ([0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1])
INITIAL = -1e6 * np.array([1.0, 0.8, 1.3, 0.1, 0.0, -0.2])


class Zone:
    """One zone led through strains."""

    def __init__(self, name, initial=INITIAL, material=None):
        self.number = kernels.ZONE_LAWS[name].number + 1
        material = material or MATERIALS[name]
        properties = material.law.properties(material)
        law = kernels.ZONE_LAWS[name]
        self.row = kernels.property_row(law, properties, kernels.N_ZONE_PROPERTIES)
        self.moduli, self.initial = material.law.moduli(material), initial
        self.state, self.lost = np.zeros(kernels.N_ZONE_STATE), np.zeros(1)

    def strain(self, strain):
        return kernels._core.pyblast_zone_laws.zone_stress(
            self.number, self.row, *self.moduli, 1e-3, self.initial, strain, self.state, self.lost
        )


def path(seed, steps=400, size=6e-5):
    """Return a random closed path of strains (steps, 6) that begins and ends at none."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(scale=size, size=(steps, 6)), axis=0)
    walk -= walk[0]
    return walk - np.linspace(0.0, 1.0, steps)[:, None] * walk[-1]


def led(zone, strains):
    """Return the work (J/m3) done on a zone along strains, the energy stored, the last stress."""
    before, at, work = zone.strain(np.zeros(6))[0], np.zeros(6), 0.0
    for strain in strains:
        stress, stored = zone.strain(strain)
        work += 0.5 * (stress + before) @ (strain - at)
        before, at = stress, strain
    return work, stored, stress


def test_every_law_is_tried_here():
    assert set(MATERIALS) == set(kernels.ZONE_LAWS)


@EACH
def test_signatures_fit_into_the_tables(name):
    law = kernels.ZONE_LAWS[name]

    assert len(law.properties) <= kernels.N_ZONE_PROPERTIES
    assert set(law.properties) == set(MATERIALS[name].law.properties(MATERIALS[name]))


@EACH
def test_untouched_ground_has_its_initial_stress_and_holds_no_energy(name):
    stress, stored = Zone(name).strain(np.zeros(6))

    assert stress == pytest.approx(INITIAL, rel=1e-12)
    assert stored == pytest.approx(0.0, abs=1e-9)


@EACH
@pytest.mark.parametrize("seed", range(4))
def test_work_is_what_is_stored_and_lost(name, seed):
    zone = Zone(name)

    work, stored, _ = led(zone, path(seed))

    scale = 1e10 * np.abs(path(seed)).max() ** 2
    assert work == pytest.approx(stored + zone.lost[0], abs=1e-9 * scale)


@EACH
@pytest.mark.parametrize("seed", range(4))
def test_no_closed_path_gives_energy(name, seed):
    zone, strains = Zone(name), path(seed)

    there, back = led(zone, strains), led(zone, strains[::-1])

    scale = 1e10 * np.abs(strains).max() ** 2
    assert there[0] >= -1e-9 * scale
    assert there[0] + back[0] >= -1e-9 * scale
    assert (zone.lost[0] > 0.0) == (name in ("viscoelastic", "mohr-coulomb"))


@EACH
def test_turned_ground_answers_turned_strains_alike(name):
    turn = Rotation.random(rng=np.random.default_rng(4)).as_matrix()
    material = MATERIALS[name]
    if name == "anisotropic":
        material = replace(material, law=material.law.turned(turn))

    def turned(column, shear):
        matrix = np.zeros((3, 3))
        matrix[COLUMN] = matrix[COLUMN[::-1]] = np.asarray(column) / ([1.0] * 3 + [shear] * 3)
        return (turn @ matrix @ turn.T)[COLUMN] * ([1.0] * 3 + [shear] * 3)

    strains = path(1, steps=50, size=1e-4)
    *_, stress = led(Zone(name), strains)
    zone = Zone(name, turned(INITIAL, 1.0), material)
    *_, other = led(zone, [turned(strain, 2.0) for strain in strains])

    assert other == pytest.approx(turned(stress, 1.0), abs=1e-9 * np.abs(stress).max())
