"""A box whose inner nodes lie at random places."""

import numpy as np

from pyblast.mesh.builder import structured_box


def crooked(seed=0, layers=None, shape=(3, 4, 3)):
    """Return a box whose inner nodes are moved at random: an unstructured mesh."""
    mesh = structured_box(shape, np.array(shape, dtype=float), layers=layers)
    rng = np.random.default_rng(seed)
    inside = ((mesh.points > 0.0) & (mesh.points < mesh.points.max(axis=0))).all(axis=1)
    mesh.points[inside] += rng.uniform(-0.2, 0.2, size=(np.count_nonzero(inside), 3))
    return mesh
