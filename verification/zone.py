"""One zone led through strains by hand: what tests and cases of zone laws share."""

from dataclasses import replace

import numpy as np

from pyblast import core
from pyblast.model.anisotropy import HoekBrown, UbiquitousJoints, jointed
from pyblast.model.material import Material, MohrCoulomb

ROCK = Material.from_speeds(2600.0, 4000.0, 2300.0, cohesion=1e6, friction=0.5, tension=4e5)
MATERIALS = {
    "elastic": ROCK,
    "anisotropic": jointed(ROCK, (1.0, 0.3, 0.5), 3.0, 1e10, 4e9),
    "mohr-coulomb": replace(ROCK, law=MohrCoulomb(0.2, cohesion_residual=3e5, shear_strain=2e-3)),
    "ubiquitous": replace(ROCK, law=UbiquitousJoints((0.6, 0.0, 0.8), 2e5, 0.4, 0.1, 1e5)),
    "hoek-brown": replace(
        ROCK, law=HoekBrown(2e7, 2.0, 0.01, 0.51, 0.1, m_residual=1.0, shear_strain=2e-3)
    ),
}
COLUMN = ([0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1])
INITIAL = -1e6 * np.array([1.0, 0.8, 1.3, 0.1, 0.0, -0.2])


class Zone:
    """One zone led through strains; it keeps its state and adds up work and loss in J/m3."""

    def __init__(self, name, initial=INITIAL, material=None):
        law, material = core.ZONE_LAWS[name], material or MATERIALS[name]
        self.number = law.number + 1
        properties = material.law.properties(material)
        self.row = core.property_row(law, properties, core.N_ZONE_PROPERTIES)
        self.moduli, self.initial = material.law.moduli(material), initial
        self.state, self.lost = np.zeros(core.N_ZONE_STATE), np.zeros(1)
        self.at, self.work = np.zeros(6), 0.0
        self.stress, self.stored = self._law(self.at)

    def _law(self, strain):
        return core._core.pyblast_zone_laws.zone_stress(
            self.number, self.row, *self.moduli, self.initial, strain, self.state, self.lost
        )

    def strain(self, strain):
        """Strain to (6,), shear doubled; return the stress (6,) in Pa."""
        stress, self.stored = self._law(strain)
        self.work += 0.5 * (stress + self.stress) @ (strain - self.at)
        self.at, self.stress = strain, stress
        return stress


def turned_column(turn, column, shear=1.0):
    """Return stress, or strain with its shear doubled (``shear`` 2), in turned axes."""
    factor = np.array([1.0] * 3 + [shear] * 3)
    matrix = np.zeros((3, 3))
    matrix[COLUMN] = matrix[COLUMN[::-1]] = np.asarray(column) / factor
    return (turn @ matrix @ turn.T)[COLUMN] * factor


def turned_material(name, turn):
    """Return the material of a law, turned by a matrix (3, 3)."""
    material = MATERIALS[name]
    if name == "anisotropic":
        material = replace(material, law=material.law.turned(turn))
    if name == "ubiquitous":
        normal = tuple(turn @ material.law.normal)
        material = replace(material, law=replace(material.law, normal=normal))
    return material


def turned_zone(name, turn):
    """Return a zone whose ground and initial stress are turned by a matrix (3, 3)."""
    return Zone(name, turned_column(turn, INITIAL), turned_material(name, turn))


def strain_cycle(seed, steps=400, size=6e-5):
    """Return a random closed path of strains (steps, 6) that begins and ends at none."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(scale=size, size=(steps, 6)), axis=0)
    walk -= walk[0]
    return walk - np.linspace(0.0, 1.0, steps)[:, None] * walk[-1]
