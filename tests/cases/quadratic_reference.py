"""Stiffness of quadratic zones by exact integrals, with the weights of their strain modes."""

import numpy as np

from pyblast.mesh.tetrahedra import (
    POWERS,
    VOLUME_SHARE,
    _shape_table,
    corner_slopes,
    integral,
    product_slopes,
    shape_gradients,
)


def stiffness_table():
    """Return the means (4, 4, 15, 15) over a zone of products of the slopes of two functions.

    Notes
    -----
    With the gradients g of the coordinates, a scalar Laplacian has the stiffness
    ``V sum_ij g_i.g_j K_ij``. The linear part of the slopes counts in full, the mode that all
    corners share not at all, the rest by half: theory.md (2.36).
    """
    whole, unit = np.zeros((4, 4, len(POWERS), len(POWERS))), np.eye(4, dtype=int)
    for i, j in np.ndindex(4, 4):
        lower = [np.maximum(POWERS - unit[axis], 0) for axis in (i, j)]
        mean = integral(lower[0][:, None, :] + lower[1][None, :, :])
        whole[i, j] = POWERS[:, None, i] * POWERS[None, :, j] * mean
    shape = _shape_table()
    whole = np.einsum("ab,ijbc,dc->ijad", shape, whole, shape)
    corners = corner_slopes()
    inverse = np.linalg.inv((np.ones((4, 4)) + np.eye(4)) / 20.0)  # of the means of coordinates
    linear = np.einsum("kai,kl,lbj->ijab", corners, inverse, corners)
    squares = integral(2 * (unit[:, None] + unit)).sum() - 0.16  # of the sum of squares, less 2/5
    shared = product_slopes(2 * unit).sum(axis=0) - 0.4 * corners.sum(axis=0)
    common = np.einsum("ai,bj->ijab", shared, shared) / squares
    return 0.5 * (whole + linear - common)


def zone_stiffness(points, zones, first_lame, shear):
    """Return the stiffness (n_zones, 45, 45) over zone volume and lumped volume fractions.

    Rows and columns run over nodes, then x y z; each is divided by the root of its volume share.
    """
    gradient = shape_gradients(points, zones)
    g = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    pairs = np.einsum("zip,zjq->zpqij", g, g).reshape(-1, 9, 16)
    scale = 1.0 / np.sqrt(np.outer(VOLUME_SHARE, VOLUME_SHARE))
    table = (stiffness_table() * scale).reshape(16, -1)
    slopes = (pairs @ table).reshape(-1, 3, 3, 15, 15)
    laplacian = np.einsum("zppab->zab", slopes)
    matrix = first_lame[:, None, None, None, None] * slopes
    matrix += shear[:, None, None, None, None] * np.swapaxes(slopes, 1, 2)
    matrix[:, range(3), range(3)] += (shear[:, None, None] * laplacian)[:, None]
    return matrix.transpose(0, 3, 1, 4, 2).reshape(-1, 45, 45)
