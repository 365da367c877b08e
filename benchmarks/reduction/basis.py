"""Main directions of motion: proper orthogonal decomposition weighted by mass."""

import numpy as np

CHUNK = 8192  # rows whose products are formed at once, in double precision


def main_directions(motion, smallest):
    """Return orthogonal directions of motion times their size, the largest first.

    Parameters
    ----------
    motion : (n_dof, n) float32
        Displacements weighted by the root of the mass.
    smallest : float
        Share of the largest size below which directions are dropped.

    Returns
    -------
    (n_dof, n_kept) float32
        ``motion motion^T`` is that of the result, but for what is dropped: theory.md (10.2).
    """
    size, turn = _sizes(motion)
    kept = size > smallest * size[0] if size[0] > 0.0 else size > 0.0
    return motion @ turn[:, kept].astype(motion.dtype)


def basis(modes, smallest):
    """Return one orthonormal basis for the motion of several runs; theory.md (10.1).

    Parameters
    ----------
    modes : list of (n_dof, n) float32
        Of each run, from `main_directions`.
    smallest : float
        Share of the largest size below which directions are dropped.

    Returns
    -------
    (n_dof, n_basis) float64
    """
    every = np.concatenate(modes, axis=1)
    size, turn = _sizes(every)
    kept = size > smallest * size[0]
    directions = every @ (turn[:, kept] / size[kept]).astype(every.dtype)
    return np.linalg.qr(directions.astype(np.float64))[0]


def _sizes(motion):
    """Return singular values and right singular vectors of columns, the largest first."""
    gram = np.zeros((motion.shape[1], motion.shape[1]))
    for first in range(0, len(motion), CHUNK):
        rows = motion[first : first + CHUNK].astype(np.float64)
        gram += rows.T @ rows
    squared, turn = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(squared[::-1], 0.0)), turn[:, ::-1]
