"""The law that yields: its surface, its flow, its energy, its softening."""

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from pyblast import core
from pyblast.errors import InputError
from pyblast.model.material import Material, MohrCoulomb
from verification.solutions.plasticity import flow_number

LAW = core.ZONE_LAWS["mohr-coulomb"]
KINDS = {
    "cut off": {"cohesion": 1e6, "friction": 0.6, "tension": 3e5, "dilation": 0.2},
    "to the tip": {"cohesion": 1e6, "friction": 0.6, "dilation": 0.6},
    "clay": {"cohesion": 1e6, "friction": 0.0, "tension": 5e5},
    "clay that holds any tension": {"cohesion": 1e6},
    "sand": {"cohesion": 0.0, "friction": 0.7},
    "no tension": {"cohesion": 1e6, "friction": 0.6, "tension": 0.0},
}
EACH = pytest.mark.parametrize("kind", KINDS)


def ground(kind, **law):
    given = dict(KINDS[kind])
    law = MohrCoulomb(given.pop("dilation", 0.0), **law)
    return Material(2500.0, 1e10, 6e9, law=law, **given)


class Zone:
    """One zone led through strains."""

    def __init__(self, material, initial=None):
        properties = material.law.properties(material)
        self.row = core.property_row(LAW, properties, core.N_ZONE_PROPERTIES)
        self.moduli, self.state = material.law.moduli(material), np.zeros(core.N_ZONE_STATE)
        self.lost, self.initial = np.zeros(1), np.zeros(6) if initial is None else initial

    def strain(self, strain):
        return core._core.pyblast_zone_laws.zone_stress(
            LAW.number + 1, self.row, *self.moduli, self.initial, strain, self.state,
            self.lost,
        )  # fmt: skip


def tensor(column, shear=1.0):
    return np.where(np.eye(3), 1.0, shear) * np.asarray(column)[[[0, 5, 4], [5, 1, 3], [4, 3, 2]]]


def planes(number):
    """Return the normals (6, 3) of the planes of the surface in ordered principal stresses."""
    shear = [[number, 0.0, -1.0], [0.0, number, -1.0], [number, -1.0, 0.0]]
    return np.array([*shear, *np.eye(3)])


def excess(stress, material):
    """Return how far a stress lies outside each plane of the surface, (6,) Pa."""
    number = flow_number(material.friction)
    cutoff = material.law.properties(material)["tension"]
    limits = [2.0 * material.cohesion * np.sqrt(number)] * 3 + [cutoff] * 3
    return planes(number) @ np.linalg.eigvalsh(tensor(stress))[::-1] - limits


def any_strain(rng):
    strain = rng.normal(size=6) * 10 ** rng.uniform(-4.5, -2.0)
    return strain + rng.normal() * 1e-3 * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@EACH
def test_no_stress_leaves_the_yield_surface(kind):
    rng, material = np.random.default_rng(1), ground(kind)
    for _ in range(300):
        strain = any_strain(rng)
        stress, _ = Zone(material).strain(strain)

        assert excess(stress, material).max() < 1e-12 * 1e10 * np.abs(strain).max()


@EACH
def test_ground_flows_along_the_planes_that_hold_it(kind):
    rng, material = np.random.default_rng(2), ground(kind)
    ways = planes(flow_number(material.law.dilation))
    yielded = 0
    for _ in range(200):
        zone = Zone(material)
        stress, _ = zone.strain(any_strain(rng))
        flow = tensor(zone.state[6:12], 0.5)
        if not flow.any():
            continue
        yielded += 1
        held = np.abs(excess(stress, material)) < 1e-9 * (np.abs(stress).max() + 1e6)
        _, rest = nnls(ways[held].T, np.linalg.eigvalsh(flow)[::-1])

        assert rest < 1e-8 * np.abs(flow).max()
        assert tensor(stress) @ flow == pytest.approx(
            flow @ tensor(stress), abs=1e-9 * np.abs(flow).max() * (np.abs(stress).max() + 1e6)
        )

    assert yielded > 30


def test_ground_that_dilates_as_it_rubs_takes_the_nearest_stress():
    rng, material = np.random.default_rng(3), ground("to the tip")
    lame, shear = material.law.moduli(material)
    for _ in range(60):
        strain = any_strain(rng)
        zone, rival = Zone(material), Zone(material)
        stress, _ = zone.strain(strain)
        trial = tensor(lame * strain[:3].sum() * np.array([1, 1, 1, 0, 0, 0])) + (
            2.0 * shear * tensor(strain, 0.5)
        )
        other, _ = rival.strain(strain * rng.uniform(0.0, 1.0) + 1e-4 * rng.normal(size=6))

        def distance(column, trial=trial):
            gap = trial - tensor(column)
            return np.sum(gap**2) - lame / (3 * lame + 2 * shear) * np.trace(gap) ** 2

        assert distance(stress) <= distance(other) * (1.0 + 1e-9)


def test_below_its_strength_ground_is_elastic_and_forgets_nothing():
    zone = Zone(ground("cut off"))
    strain = 1e-6 * np.array([1.0, -2.0, 0.5, 0.3, 0.1, -0.4])

    stress, stored = zone.strain(strain)

    lame, shear = zone.moduli
    wanted = lame * strain[:3].sum() * np.array([1, 1, 1, 0, 0, 0]) + shear * strain * [
        2,
        2,
        2,
        1,
        1,
        1,
    ]
    assert stress == pytest.approx(wanted, rel=1e-12)
    assert stored == pytest.approx(0.5 * wanted @ strain, rel=1e-12)
    assert not zone.lost[0]
    assert not zone.state[6:].any()


@pytest.mark.parametrize("softens", [False, True])
@EACH
def test_work_is_stored_or_lost_and_never_gained(kind, softens):
    soft = {"cohesion_residual": 0.0, "tension_residual": 0.0, "shear_strain": 1e-3}
    initial = -2e6 * np.array([1.0, 0.7, 1.2, 0.0, 0.1, 0.0])
    zone, rng = Zone(ground(kind, **(soft if softens else {})), initial), np.random.default_rng(3)
    before, strain = zone.strain(np.zeros(6))[0], np.zeros(6)
    at_rest, work = zone.strain(strain)[1], 0.0
    for step in rng.normal(scale=2e-5, size=(3000, 6)):
        flown = zone.state[6:12].copy()
        stress, stored = zone.strain(strain + step)
        work += 0.5 * (stress + before) @ step
        before, strain = stress, strain + step
        assert stress @ (zone.state[6:12] - flown) >= -1e-12 * 1e7 * np.abs(step).max()
    lost = zone.lost[0]

    assert work == pytest.approx(lost + stored - at_rest, rel=1e-9)
    assert lost > 0.0


@pytest.mark.parametrize("seed", range(3))
def test_a_turned_strain_gives_a_turned_stress(seed):
    rng = np.random.default_rng(seed)
    turn, material = Rotation.random(rng=rng).as_matrix(), ground("cut off")

    def column(matrix, shear):
        return matrix[[0, 1, 2, 1, 2, 0], [0, 1, 2, 2, 0, 1]] * ([1.0] * 3 + [shear] * 3)

    strain = 1e-3 * rng.normal(size=6)
    stress, _ = Zone(material).strain(strain)
    turned, _ = Zone(material).strain(column(turn @ tensor(strain, 0.5) @ turn.T, 2.0))

    wanted = turn @ tensor(stress) @ turn.T
    assert tensor(turned) == pytest.approx(wanted, abs=1e-10 * np.abs(stress).max())


def test_strength_falls_with_plastic_strain_and_stays_at_the_residual():
    material = ground("clay that holds any tension", cohesion_residual=2e5, shear_strain=4e-3)
    zone, found = Zone(material), []
    for shear in np.linspace(0.0, 0.01, 2001):
        stress, _ = zone.strain(shear * np.eye(6)[5])
        found.append((zone.state[12], abs(stress[5])))
    spent, strength = np.array(found).T

    assert strength.max() == pytest.approx(1e6, rel=2e-3)
    middle = (spent > 1e-3) & (spent < 3.9e-3)
    wanted = 1e6 - 8e5 * spent[middle] / 4e-3
    assert strength[middle] == pytest.approx(wanted, rel=5e-3)
    assert strength[-1] == pytest.approx(2e5, rel=1e-9)


def test_pulled_ground_breaks_and_leaves_no_tension():
    material = ground("cut off", tension_residual=0.0)
    zone = Zone(material)

    pulls = [zone.strain(pull * np.eye(6)[0])[0][0] for pull in np.linspace(0.0, 1e-3, 101)]

    assert max(pulls) <= 3e5 * (1.0 + 1e-12)
    assert pulls[-1] == pytest.approx(0.0, abs=1.0)
    assert zone.state[13] > 0.0


def test_plastic_shear_is_the_largest_engineering_shear_of_the_plastic_strain():
    material = Material(2500.0, 1e10, 6e9, cohesion=1e6, friction=0.6, tension=3e5,
                        law=MohrCoulomb(0.3))  # fmt: skip
    zone = Zone(material)

    for share in np.linspace(0.0, 1.0, 50):
        zone.strain(share * np.array([8e-4, -2e-4, -2e-3, 0.0, 0.0, 0.0]))

    plastic = zone.state[6:9]
    assert plastic.min() < -1e-4
    assert zone.state[12] == pytest.approx(plastic.max() - plastic.min(), rel=1e-9)


def test_softened_ground_holds_no_more_tension_than_its_cohesion_over_its_friction():
    material = Material(2500.0, 1e10, 6e9, cohesion=1e6, friction=0.5, tension=4e5,
                        law=MohrCoulomb(cohesion_residual=1e5, tension_residual=4e5))  # fmt: skip
    zone = Zone(material)
    zone.strain(np.array([0.0, 0.0, -2e-3, 0.0, 0.0, 0.0]))

    stress, _ = zone.strain(np.array([5e-3, 5e-3, 5e-3, 0.0, 0.0, 0.0]))

    assert stress[:3] == pytest.approx(3 * [1e5 / 0.5], rel=1e-6)


def test_values_that_are_no_strength_are_refused():
    with pytest.raises(InputError, match=r"material\.cohesion: missing"):
        Material(2500.0, 1e10, 6e9, law=MohrCoulomb()).law.properties(Material(2500.0, 1e10, 6e9))
    slippery = Material(2500.0, 1e10, 6e9, 1e6, 0.3, law=MohrCoulomb(0.5))
    with pytest.raises(InputError, match=r"material\.dilation: must not exceed friction of 0.3"):
        slippery.law.properties(slippery)
    with pytest.raises(InputError, match=r"material\.shear_strain: must not be negative"):
        MohrCoulomb(shear_strain=-1.0)
