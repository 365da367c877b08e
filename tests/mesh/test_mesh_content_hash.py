"""What depends on a mesh is found once for models of equal meshes, and anew where they differ."""

import numpy as np
import pytest

from pyblast.mesh.grid import structured_box
from pyblast.model.material import Material
from pyblast.model.model import Model

SIZE = (3.0, 2.1, 1.3)  # m


def model(density=2500.0, cs=2000.0, size=SIZE):
    mesh = structured_box((3, 2, 2), size, planes={"J": ("x", 1.0)})
    return Model(mesh, {"rock": Material.from_speeds(density, 4000.0, cs)}, quadratic=True)


def test_equal_meshes_share_their_quadratic_nodes_and_nobody_writes_to_them():
    one, other, third = model(), model(cs=1800.0), model(size=(3.0, 2.1, 1.5))

    assert one.mesh is other.mesh
    assert one.nodes.points is other.nodes.points
    assert not np.array_equal(third.nodes.points, one.nodes.points)
    with pytest.raises(ValueError, match="read-only"):
        one.nodes.points[0] = 0.0
