"""Jumps of contacts and strains of zones as matrices, and how stress follows strain in time."""

import numpy as np
from scipy import signal, sparse

from .kernels import ZONE_LAWS
from .stability import shape_gradients

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
        """Read stiffness damping, and the mechanisms of a law that fades."""
        one = zones[0]
        self._lag = constants["zone_beta"][one] / constants["dt"]
        self._last, self._memory, self._mechanisms = None, None, []
        number = constants["zone_set"][one]
        if constants["set_law"][number] == ZONE_LAWS["viscoelastic"].number:
            rate, p, s = constants["set_property"][number][:9].reshape(3, 3)
            x = 0.5 * constants["dt"] * rate
            self._mechanisms = [row for row in zip(x, p, s, strict=True) if row[0] > 0.0]

    def __call__(self, motion):
        """Return what belongs to P and to S modulus, for the next motion (n, ...) in time."""
        if self._last is None:
            self._last = np.zeros_like(motion[:1])
            self._memory = [np.zeros_like(motion[:1]) for _ in self._mechanisms]
        earlier = np.concatenate([self._last, motion[:-1]])
        self._last = motion[-1:].copy()
        p = motion + self._lag * (motion - earlier)
        s = p.copy() if self._mechanisms else p
        for number, (x, share_p, share_s) in enumerate(self._mechanisms):
            gain = x / (1.0 + x)
            faded, self._memory[number] = signal.lfilter(
                [gain, gain], [1.0, -(1.0 - x) / (1.0 + x)], motion, axis=0,
                zi=self._memory[number],
            )  # fmt: skip
            p = p - share_p * faded
            s = s - share_s * faded
        return p, s
