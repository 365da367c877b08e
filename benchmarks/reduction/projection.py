"""A family of models seen through a basis: small systems, their solution and what it leaves."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from pyblast.errors import InputError

from .basis import basis
from .driving import driving
from .family import Family
from .galerkin import seen
from .line import Line, line

SKETCH = 64  # random directions in which the residual is watched


@dataclass(frozen=True, eq=False)
class Projection:
    """A family of models seen through a basis.

    Parameters
    ----------
    family : Family
    line : Line
    directions : (3 n_nodes, size) float64
        The basis, orthonormal by the mass.
    matrices : dict of tuple to (size + n_sketch, size) float64
        From `seen`: first the rows of the basis, then random directions that watch the residual.
    force : (n_frequencies, size + n_sketch) complex128
    receivers : (3 n_receivers, size) float64
    mass : float, kg
        Of the whole model.
    """

    family: Family
    line: Line
    directions: np.ndarray
    matrices: dict
    force: np.ndarray
    receivers: np.ndarray
    mass: float

    @property
    def size(self):
        """Number of directions of the basis."""
        return self.directions.shape[1]


def project(family: Family, modes, tolerance, seed) -> Projection:
    """Make a basis of the motion of some runs and look at the family through it.

    Parameters
    ----------
    family : Family
    modes : list of (3 n_nodes, n) float32
        Of each run.
    tolerance : float
        Share of the largest size of motion below which directions are dropped.
    seed : int
        Of the random directions.

    """
    middle = family.ranges.middle()
    model, constants = family.model(middle), family.prepared(middle).constants
    root = np.repeat(np.sqrt(family.mass), 3)[:, None]
    found = basis(modes, tolerance)
    both = np.concatenate([found, _watching(constants, seed)], axis=1) / root
    directions = np.ascontiguousarray(both[:, : found.shape[1]])
    on = line(family.dt, family.n_steps, family.highest)
    corners = directions.reshape(-1, 3, directions.shape[1])[constants["receiver_node"]]
    receivers = np.einsum("rk,rkic->ric", constants["receiver_weight"], corners)
    return Projection(
        family, on, directions, seen(model, constants, both, directions),
        driving(constants, both, on), receivers.reshape(-1, directions.shape[1]),
        float(family.mass.sum()),
    )  # fmt: skip


def _watching(constants, seed):
    """Return random directions (3 n_nodes, n_sketch) that feel no reaction of a support."""
    shape = len(constants["node_mass"]), 3, SKETCH
    random = np.random.default_rng([seed, 2]).standard_normal(shape) / np.sqrt(SKETCH)
    node, direction = constants["fixed_node"], constants["fixed_direction"]
    held = np.einsum("ni,nik->nk", direction, random[node])
    np.subtract.at(random, node, direction[:, :, None] * held[:, None])
    return random.reshape(-1, SKETCH)


@dataclass(frozen=True, eq=False)
class Solution:
    """How a small system moves on the line of complex frequencies.

    Parameters
    ----------
    motion : (n_frequencies, size) complex128
        Of the directions of the basis.
    velocity : (n_frequencies, 3 n_receivers) complex128, m/s
    residual : float
        Of the whole system over the motion of the quietest receiver; theory.md (10.7).
    """

    motion: np.ndarray
    velocity: np.ndarray
    residual: float


def solve(projection: Projection, values) -> Solution:
    """Solve the small system of some values on the line; theory.md (10.4)."""
    n, force, on = projection.size, projection.force, projection.line
    symbols, matrices = _terms(projection, values)
    flat = matrices[:, :n].reshape(len(matrices), -1)
    motion, system = np.empty((len(force), n), dtype=complex), np.empty(n * n, dtype=complex)
    for k, factor in enumerate(symbols.T):
        system.real, system.imag = factor.real @ flat, factor.imag @ flat
        # Symmetric, so rows are columns. numpy.linalg.solve is up to 50 times slower beside load.
        motion[k] = lapack.zgesv(system.reshape(n, n).T, force[k, :n], overwrite_a=True)[2]
    rest = force[:, n:].copy()
    for factor, matrix in zip(symbols, matrices, strict=True):
        rest -= factor[:, None] * (motion @ matrix[n:].T)
    velocity = on.velocity(motion @ projection.receivers.T)
    size = np.sqrt(on.energy(rest / np.abs(on.rate)[:, None]).sum() / projection.mass)
    moved = np.sqrt(on.energy(velocity).reshape(-1, 3).sum(axis=1).min())
    return Solution(motion, velocity, float(size / max(moved, np.finfo(float).tiny)))


def _terms(projection, values):
    """Return what multiplies each matrix on the line, and the matrices; theory.md (10.3)."""
    family, on, part = projection.family, projection.line, projection.matrices
    model = family.ranges.model(family.base, values)
    rate, still, lag, relaxes = part["dashpots",].copy(), 0.0, 0.0, {}
    if ("rim",) in part:
        rate += part["rim",]
    alpha, beta = model.group_damping("alpha"), model.group_damping("beta")
    for number, group in enumerate(model.mesh.groups):
        p, s = part["p", group], part["s", group]
        rate += alpha[number] * part["drag", group]
        still = still + p + s
        lag = lag + beta[number] * (p + s)
        for one in model.branches(group):
            known = relaxes.get(one.rate, 0.0)
            relaxes[one.rate] = known + one.compression * p + one.shear * s
    for joint in model.joints:
        for name in ("kn", "ks"):
            still = still + joint.properties[name] * part[name, joint.surface]
    symbols, found = [on.mass, on.mean_rate, np.ones_like(on.z)], [part["mass",], rate, still]
    if np.any(lag):
        symbols, found = [*symbols, on.lagged_rate], [*found, lag]
    symbols += [on.relaxing(pace) for pace in relaxes]
    return np.array(symbols), np.array([*found, *relaxes.values()])


def refuse_led(family):
    """Refuse families that nothing moves, or whose sources follow what varies.

    Raises
    ------
    InputError
    """
    low, high = (family.prepared(family.ranges.corner(end)).constants for end in (0, 1))
    size = np.abs(high["load_vector"]).max(initial=0.0)
    if size * np.abs(high["history"]).max(initial=0.0) == 0.0:
        raise InputError("reduced: the model has no source that moves it; give it one")
    for name in ("load_vector", "load_delay", "history"):
        least = 1e-9 * np.abs(high[name]).max(initial=0.0)
        if low[name].shape != high[name].shape or (np.abs(low[name] - high[name]) > least).any():
            raise InputError(
                "reduced: a source or a free-field side follows the damping that varies, which a "
                "reduced model does not know; vary the joints only, or drive it otherwise"
            )
