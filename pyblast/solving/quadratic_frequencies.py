"""How fast a quadratic zone alone can vibrate, which bounds the time step."""

import numpy as np

from ..meshing.contents import kept
from ..meshing.elements import VOLUME_SHARE, stiffness_table
from ..meshing.tetrahedra import shape_gradients

_CHUNK = 1000
_ALIKE = 9  # decimals of shape and moduli by which zones count as similar


def quadratic_frequencies(points, zones, first_lame, shear, density):
    """Return the square of each zone's largest angular frequency, (n_zones,) 1/s2.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zones : (n_zones, 4) int32, corners
    first_lame, shear : (n_zones,) float64, Pa
    density : (n_zones,) float64, kg/m3

    Notes
    -----
    The largest eigenvalue of the 45 by 45 problem with the zone's own lumped mass; no frequency of
    the model is higher (Irons & Treharne 1971): theory.md (2.38). It depends on the products of
    the gradients alone, so zones that are turned or scaled copies of another share it.
    """
    return _per_density(points, zones, first_lame, shear) / density


@kept
def _per_density(points, zones, first_lame, shear):
    """Return the squares for a density of one, (n_zones,)."""
    gradient = shape_gradients(points, zones)
    products = np.einsum("zia,zja->zij", gradient, gradient).reshape(-1, 9)
    scale = products[:, ::4].sum(axis=1)
    stiffest = first_lame + 2.0 * shear
    alike = np.column_stack([products / scale[:, None], shear / stiffest]).round(_ALIKE)
    _, first, kind = np.unique(alike, axis=0, return_index=True, return_inverse=True)
    squared = np.empty(len(first))
    for start in range(0, len(first), _CHUNK):
        some = first[start : start + _CHUNK]
        moduli = first_lame[some] / stiffest[some], shear[some] / stiffest[some]
        matrix = zone_stiffness(points, zones[some], *moduli)
        squared[start : start + _CHUNK] = np.linalg.eigvalsh(matrix)[:, -1] / scale[some]
    return squared[kind.ravel()] * scale * stiffest


def zone_stiffness(points, zones, first_lame, shear):
    """Return the stiffness (n_zones, 45, 45) over the volume of each zone and lumped shares.

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
