"""Jumps of contacts and strains of zones as matrices, and how stress follows strain in time."""

import numpy as np
from scipy import signal, sparse

from ..meshing.tetrahedra import shape_gradients

NORMAL = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
SHEAR = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])  # of xx yy zz and the engineering shears
# Row of the strain, component of the motion, axis of the gradient; theory.md (2.1).
STRAIN = (
    (0, 0, 0), (1, 1, 1), (2, 2, 2), (3, 1, 2), (3, 2, 1), (4, 2, 0), (4, 0, 2), (5, 0, 1),
    (5, 1, 0),
)  # fmt: skip


def flat(motion):
    """Return motion (n, n_nodes, 3) as columns (3 n_nodes, n)."""
    return motion.reshape(len(motion), -1).T


def local(nodes, table):
    """Return where the entries of a table of nodes stand in ascending ``nodes``."""
    return np.searchsorted(nodes, table)


def jump_matrix(contacts, nodes):
    """Return the matrix (3 n_contacts, 3 n_nodes) from motion to jumps: plus less minus side."""
    n = len(contacts.area)
    rows = np.arange(3 * n)
    sides = [
        (3 * local(nodes, side)[:, None] + np.arange(3)).ravel()
        for side in (contacts.plus, contacts.minus)
    ]
    values = np.concatenate([np.ones(3 * n), -np.ones(3 * n)])
    places = np.concatenate([rows, rows]), np.concatenate(sides)
    return sparse.csr_array((values, places), shape=(3 * n, 3 * len(nodes)))


def strain_matrix(mesh, zones, nodes):
    """Return the matrix (6 n_zones, 3 n_nodes) from motion to strains; theory.md (2.1)."""
    inner = shape_gradients(mesh.points, mesh.zones[zones])
    gradient = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    corner = 3 * local(nodes, mesh.zones[zones])
    first = 6 * np.arange(len(zones))[:, None]
    rows, columns, values = [], [], []
    for row, component, axis in STRAIN:
        rows.append(np.broadcast_to(first + row, corner.shape).ravel())
        columns.append((corner + component).ravel())
        values.append(gradient[:, :, axis].ravel())
    places = np.concatenate(rows), np.concatenate(columns)
    shape = (6 * len(zones), 3 * len(nodes))
    return sparse.csr_array((np.concatenate(values), places), shape=shape)


class Answer:
    """What the stress of a group makes of motion in time, apart for the P and the S modulus.

    Linear, the same at all times, and zero before the first step, so that it can act on the
    motion of a run or, in reversed time, on that of its adjoint: theory.md (8.5).

    Parameters
    ----------
    constants : dict
        Of a prepared model.
    zones : (n,) int
        Of one group.
    """

    def __init__(self, constants, zones):
        """Read stiffness damping, and what relaxes."""
        domain = np.searchsorted(constants["domain_zone_start"], zones[0], side="right") - 1
        number = constants["domain_set"][domain]
        self._lag = constants["set_beta"][number] / constants["dt"]
        self._last, self._memory = None, None
        x = 0.5 * constants["dt"] * constants["memory_rate"]
        rows = zip(x, *constants["set_branch"][number].T, strict=True)
        self._branches = [row for row in rows if any(row[1:])]

    def __call__(self, motion):
        """Return what belongs to P and to S modulus, for the next motion (n, ...) in time."""
        if self._last is None:
            self._last = np.zeros_like(motion[:1])
            self._memory = [np.zeros_like(motion[:1]) for _ in self._branches]
        earlier = np.concatenate([self._last, motion[:-1]])
        self._last = motion[-1:].copy()
        p = motion + self._lag * (motion - earlier)
        s = p.copy() if self._branches else p
        for number, (x, of_s, of_p) in enumerate(self._branches):
            gain = x / (1.0 + x)
            faded, self._memory[number] = signal.lfilter(
                [gain, gain], [1.0, -(1.0 - x) / (1.0 + x)], motion, axis=0,
                zi=self._memory[number],
            )  # fmt: skip
            p = p + of_p * (motion - faded)
            s = s + of_s * (motion - faded)
        return p, s
