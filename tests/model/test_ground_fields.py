"""Fields of the ground and fluids in rock."""

import numpy as np
import pytest

from pyblast.errors import InputError
from pyblast.mesh.builder import structured_box
from pyblast.model.ground_fields import Body, DamagedZone, Gradient, Heterogeneity, damaged_group
from pyblast.model.material import Material
from pyblast.model.model import Model
from pyblast.solver.time_step import critical_step
from verification.columns import ROCK

RNG = np.random.default_rng(0)
HOLES = np.array([[[10.0, 10.0, 0.0], [10.0, 10.0, 20.0]]])


def box(n=8, size=40.0):
    return structured_box((n, n, n), (size, size, size))


def test_a_gradient_is_that_of_its_formula():
    depth = np.array([0.0, 5.0, 50.0])
    places = np.stack([0 * depth, 0 * depth, 3.0 - depth], axis=1)

    found = Gradient(0.4, 5.0, top=3.0).factor(places, None)

    assert found == pytest.approx(1.0 - 0.4 * np.exp(-depth / 5.0))


def test_damage_fades_with_the_distance_to_the_nearest_hole():
    zone = DamagedZone(HOLES, 0.3, 4.0)
    places = np.array([[10.0, 10.0, 10.0], [14.0, 10.0, 10.0], [10.0, 10.0, 24.0]])

    assert zone.factor(places, None) == pytest.approx(1.0 - 0.3 * np.exp([0.0, -1.0, -1.0]))


def test_speeds_and_moduli_follow_the_field_and_density_stays():
    model = Model(box(), {"rock": ROCK}, ground=[Gradient(0.5, 10.0, top=40.0)])
    plain = Model(box(), {"rock": ROCK})
    factor = model.speed_factor

    assert model.zone_values("cs") == pytest.approx(factor * ROCK.cs)
    assert model.zone_values("shear") == pytest.approx(factor**2 * ROCK.shear)
    assert model.zone_moduli()[0] == pytest.approx(factor**2 * ROCK.first_lame)
    assert (model.zone_values("density") == ROCK.density).all()
    assert critical_step(model).dt >= critical_step(plain).dt


@pytest.mark.long
def test_heterogeneity_has_its_deviation_and_correlation():
    field = Heterogeneity(0.05, 10.0, seed=4)
    places = RNG.uniform(0.0, 400.0, size=(20000, 3))
    along = places + np.array([10.0, 0.0, 0.0])

    both = np.log(field.factor(np.concatenate([places, along]), np.ones(1)))
    here, there = np.split(both, 2)

    assert here.std() == pytest.approx(0.05, rel=0.12)
    correlation = np.corrcoef(here, there)[0, 1]
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.1)


def test_the_same_seed_gives_the_same_ground():
    places = RNG.uniform(0.0, 50.0, size=(50, 3))
    one, two, other = (
        Heterogeneity(0.05, 10.0, seed=s).factor(places, np.ones(1)) for s in (1, 1, 2)
    )

    assert one.tolist() == two.tolist() != other.tolist()


def test_a_mesh_too_coarse_for_its_heterogeneity_is_refused():
    model = Model(box(), {"rock": ROCK}, ground=[Heterogeneity(0.05, 10.0, seed=1)])

    with pytest.raises(InputError, match="fewer than three edges"):
        model.zone_values("cs")


def test_damaged_zones_can_have_a_material_of_their_own():
    mesh = damaged_group(box(), DamagedZone(HOLES, 0.0, 1.0), 8.0)
    model = Model(mesh, {"rock": ROCK, "damaged": Material.from_speeds(2400.0, 3000.0, 1500.0)})

    assert np.unique(model.zone_values("cs")) == pytest.approx([1500.0, ROCK.cs])


def test_a_body_changes_its_middle_and_keeps_its_whole_in_longer_zones():
    body = Body((5.0, -3.0, -20.0), -0.4, 12.0)
    middle = np.array([body.centre])
    assert body.factor(middle, np.zeros(1))[0] == pytest.approx(np.exp(-0.4))
    wholes = []
    for edge in (2.0, 8.0):
        line = np.arange(-96.0, 96.0 + edge, edge)
        places = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3) + middle
        wholes.append(edge**3 * np.log(body.factor(places, np.full(len(places), edge))).sum())
    assert wholes[0] == pytest.approx(wholes[1], rel=1e-3)
    assert wholes[0] == pytest.approx(-0.4 * (2.0 * np.pi) ** 1.5 * 12.0**3, rel=1e-3)
