"""What depends on a mesh is found once for models of equal meshes, and anew where they differ."""

import pickle

import numpy as np
import pytest

from pyblast.mesh.grid import structured_box
from pyblast.model.material import Material
from pyblast.model.model import Model
from pyblast.solver.time_step import model_frequencies, zone_stiffness

SIZE = (3.0, 2.1, 1.3)  # m


def model(density=2500.0, cs=2000.0, size=SIZE):
    mesh = structured_box((3, 2, 2), size, planes={"J": ("x", 1.0)})
    return Model(mesh, {"rock": Material.from_speeds(density, 4000.0, cs)}, quadratic=True)


@pytest.fixture
def solved(monkeypatch):
    """Return the numbers of zones that were solved for, one for each time."""
    calls, solve = [], np.linalg.eigvalsh
    monkeypatch.setattr(np.linalg, "eigvalsh", lambda a: calls.append(len(a)) or solve(a))
    return calls


def test_frequencies_of_equal_models_are_solved_for_once(solved):
    first = model_frequencies(model(cs=1500.0))
    times = len(solved)
    assert times > 0

    sent = pickle.loads(pickle.dumps(model(cs=1500.0)))

    assert np.array_equal(model_frequencies(sent), first)
    assert len(solved) == times


@pytest.mark.parametrize("changed", [{"cs": 1900.0}, {"size": (3.0, 2.1, 1.4)}])
def test_frequencies_follow_moduli_and_shape(changed, solved):
    one = model(**changed)
    model_frequencies(model())
    times = len(solved)
    found = model_frequencies(one)
    assert len(solved) > times

    lame, shear = one.stiffest_moduli()
    direct = np.linalg.eigvalsh(zone_stiffness(one.mesh.points, one.mesh.zones, lame, shear))
    # Zones that are alike to nine decimals share one eigenvalue.
    assert found == pytest.approx(direct[:, -1] / one.zone_values("density"), rel=1e-8)


def test_equal_meshes_share_their_quadratic_nodes_and_nobody_writes_to_them():
    one, other, third = model(), model(cs=1800.0), model(size=(3.0, 2.1, 1.5))

    assert one.mesh is not other.mesh
    assert one.nodes.points is other.nodes.points
    assert not np.array_equal(third.nodes.points, one.nodes.points)
    with pytest.raises(ValueError, match="read-only"):
        one.nodes.points[0] = 0.0
