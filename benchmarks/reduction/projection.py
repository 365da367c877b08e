"""Galerkin projection of a family on a basis, solved on a complex-frequency contour."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft, sparse
from scipy.linalg import lapack

from pyblast.errors import InputError
from pyblast.mesh.mesh import Mesh
from pyblast.mesh.tetrahedra import shape_gradients, volumes

from .families import Family
from .snapshots import orthonormal_basis

PADDING = 0.15  # of the duration, over which held sources are tapered off
ALIASED = 1e-4  # amplitude left of one period in the next
TAPER = 1.25  # highest frequency solved over the highest of the motion
SHEAR = np.array([2.0, 2.0, 2.0, 1.0, 1.0, 1.0])  # of xx yy zz and the engineering shears
# Row of the strain, component of the motion, axis of the gradient; theory.md (2.1).
STRAIN = (
    (0, 0, 0), (1, 1, 1), (2, 2, 2), (3, 1, 2), (3, 2, 1), (4, 2, 0), (4, 0, 2), (5, 0, 1),
    (5, 1, 0),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Contour:
    """Contour of complex frequencies z on a circle; symbols of the time-stepping scheme at z.

    Parameters
    ----------
    dt : float, s
    highest : float, Hz
    n_steps, n_period : int
        Of a seismogram, and of the period of the discrete transform.
    z : (n,) complex128
    weight : (n,) float64
        1 within the band, falling to 0 above.

    Notes
    -----
    theory.md (10.4) to (10.6).
    """

    dt: float
    highest: float
    n_steps: int
    n_period: int
    z: np.ndarray
    weight: np.ndarray

    @property
    def decay(self):
        """Exponential damping per step on the circle."""
        return math.log(1.0 / ALIASED) / self.n_period

    @property
    def rate(self):
        """Complex angular frequency of the differential equation, (n,) 1/s."""
        return np.log(self.z) / self.dt

    @property
    def mass(self):
        """Symbol of acceleration, (n,) 1/s2."""
        return (self.z - 2.0 + 1.0 / self.z) / self.dt**2

    @property
    def mean_rate(self):
        """Symbol of the mean velocity, (n,) 1/s."""
        return (self.z - 1.0 / self.z) / (2.0 * self.dt)

    @property
    def lagged_rate(self):
        """Symbol of the velocity half a step before, (n,) 1/s."""
        return (1.0 - 1.0 / self.z) / self.dt

    def relaxing(self, rate):
        """Return the symbol of springs that relax at a rate in 1/s, (n,)."""
        x = 0.5 * rate * self.dt
        return 1.0 - x * (1.0 + 1.0 / self.z) / (1.0 + x - (1.0 - x) / self.z)

    def velocity(self, displacement):
        """Return mid-step velocities for displacements, (n, ...) both."""
        shape = (-1,) + (1,) * (displacement.ndim - 1)
        return ((self.z - 1.0) / self.dt).reshape(shape) * displacement

    def energy(self, values):
        """Return the sum over the contour of squared values (n, m) within the band, (m,)."""
        return np.sum((self.weight[:, None] * np.abs(values)) ** 2, axis=0)

    def transform(self, histories):
        """Return histories (n_steps, m) at all frequencies (n_period / 2 + 1, m).

        The last value is held and tapered off over the padding.
        """
        taper = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, self.n_period - self.n_steps))
        whole = np.concatenate([histories, taper[:, None] * histories[-1]])
        damped = np.exp(-self.decay * np.arange(self.n_period))[:, None] * whole
        return fft.rfft(damped, axis=0)

    def to_time(self, values, count=None):
        """Return values (n, ...) on the contour in the time domain, up to the last step.

        With ``count`` samples per period instead of one a step.
        """
        count = count or self.n_period
        shape = (-1,) + (1,) * (values.ndim - 1)
        motion = fft.irfft(self.weight.reshape(shape) * values, count, axis=0)
        every = self.n_period / count
        motion = motion[: math.ceil(self.n_steps / every)] / every
        return np.exp(self.decay * every * np.arange(len(motion))).reshape(shape) * motion


def contour(dt, n_steps, highest):
    """Return the contour for seismograms of ``n_steps`` with motion up to ``highest`` Hz."""
    n_period = fft.next_fast_len(math.ceil((1.0 + PADDING) * n_steps), real=True)
    n_period += n_period % 2
    count = min(n_period // 2, math.ceil(TAPER * highest * n_period * dt)) + 1
    circle = 2j * np.pi * np.arange(count) / n_period + math.log(1.0 / ALIASED) / n_period
    hertz = np.arange(count) / (n_period * dt)
    excess = np.clip((hertz / highest - 1.0) / (TAPER - 1.0), 0.0, 1.0)
    weight = 0.5 + 0.5 * np.cos(np.pi * excess)
    return Contour(dt, highest, n_steps, n_period, np.exp(circle), weight)


MOST_ABOVE = 1e-3  # of the energy of the sources, above the highest frequency


def generalised_forces(constants, basis, contour):
    """Return the generalised forces of all loads, (n_frequencies, n_basis).

    Parameters
    ----------
    constants : dict
        Of a prepared model.
    basis : (3 n_nodes, n_basis) float64
    contour : Contour

    Raises
    ------
    InputError
        If the loads hold too much energy above the highest frequency.

    Notes
    -----
    Loads of one history and one delay are added first. Delays between steps are interpolated as
    in the kernel: a cubic through four samples.
    """
    vectors, delays = constants["load_vector"], constants["load_delay"]
    keys = np.stack([constants["load_history"], delays], axis=1)
    kinds, number = np.unique(keys, axis=0, return_inverse=True)
    columns = basis.reshape(-1, 3, basis.shape[1])
    force = np.zeros((len(kinds), basis.shape[1]))
    for kind in range(len(kinds)):
        here = np.flatnonzero(number.ravel() == kind)
        node = constants["load_node"][here]
        force[kind] = np.einsum("li,lir->r", vectors[here], columns[node])
    spectrum = contour.transform(constants["history"])
    _refuse_higher(spectrum, contour)
    spectrum = spectrum[: len(contour.z), kinds[:, 0].astype(int)]
    return (spectrum * _delay_symbol(contour.z[:, None], kinds[:, 1])) @ force


def _refuse_higher(spectrum, contour):
    """Raise InputError if histories hold much energy above the highest frequency."""
    hertz = np.arange(len(spectrum)) / (contour.n_period * contour.dt)
    energy = (hertz[:, None] * np.abs(spectrum)) ** 2
    above = energy[hertz > contour.highest].sum(axis=0)
    share = float(np.max(above / np.maximum(energy.sum(axis=0), np.finfo(float).tiny)))
    if share > MOST_ABOVE:
        raise InputError(
            f"reduced.highest: {100.0 * share:.2g} % of the energy of the sources lies above "
            f"{contour.highest:g} Hz; low-pass the sources or raise it"
        )


def _delay_symbol(z, delay):
    """Return the symbol of delays in steps, interpolated as in the kernel."""
    whole = np.floor(delay)
    x = delay - whole
    weights = (
        -x * (1.0 - x) * (2.0 - x) / 6.0,
        (1.0 - x**2) * (2.0 - x) / 2.0,
        x * (1.0 + x) * (2.0 - x) / 2.0,
        -x * (1.0 - x**2) / 6.0,
    )
    cubic = sum(weight * z ** (1 - k) for k, weight in enumerate(weights))
    return z**-whole * np.where(x > 0.0, cubic, 1.0)


CHUNK = 2048  # zones whose strains are formed at once


def projected_matrices(model, constants, left, right):
    """Return the projected matrices of a family between two bases; theory.md (10.3).

    Parameters
    ----------
    model : Model
    constants : dict
        Of the prepared model.
    left, right : (3 n_nodes, n_left), (3 n_nodes, n_right) float64
        Motions; ``right`` are the first of ``left``.

    Returns
    -------
    dict of tuple to (n_left, n_right) float64
        ``("mass",)``, ``("dashpots",)``, ``("sponge",)``; by group ``("drag", name)`` for a mass
        damping of 1/s, ``("p", name)`` and ``("s", name)`` for both moduli of the relaxed ground;
        by joint ``("kn", name)`` and ``("ks", name)`` for 1 Pa/m.
    """
    mesh, mass = model.mesh, constants["node_mass"]
    matrices = {("mass",): _weighted(left, right, mass)}
    node, impedance = constants["dashpot_node"], constants["dashpot_impedance"]
    at, to = (each.reshape(len(mass), 3, -1)[node] for each in (left, right))
    pushed = np.einsum("nij,njr->nir", impedance, to)
    matrices["dashpots",] = at.reshape(-1, left.shape[1]).T @ pushed.reshape(-1, right.shape[1])
    heavy = model.zone_values("density") * volumes(mesh.points, mesh.zones)
    for number, group in enumerate(mesh.groups):
        here = np.where(mesh.zone_group == number, heavy, 0.0)
        matrices["drag", group] = _weighted(left, right, model.nodes.sums(here))
        zones = np.flatnonzero(mesh.zone_group == number)
        matrices["p", group], matrices["s", group] = _stiffness(model, zones, left, right)
    if model.sponge is not None:
        centres = mesh.points[mesh.zones].mean(axis=1)
        drag = heavy * model.sponge.alpha(centres, model.zone_values("cs"))
        matrices["sponge",] = _weighted(left, right, model.nodes.sums(drag))
    if mesh.contacts is not None:
        matrices |= _joints(mesh.contacts, left, right)
    return matrices


def _weighted(left, right, weight):
    """Return the product of two bases with nodal weights."""
    return left.T @ (np.repeat(weight, 3)[:, None] * right)


def _stiffness(model, zones, left, right):
    """Return the projected stiffness of the P and S moduli of zones of one group."""
    p, s = np.zeros((2, left.shape[1], right.shape[1]))
    lame, shear = (each[zones] for each in model.zone_moduli())
    for first in range(0, len(zones), CHUNK):
        part = slice(first, first + CHUNK)
        corners = model.mesh.zones[zones[part]]
        nodes = np.unique(corners)
        rows = (3 * nodes[:, None] + np.arange(3)).ravel()
        matrix = strain_matrix(model.mesh, zones[part], nodes)
        strain = (matrix @ left[rows]).reshape(len(corners), 6, -1)
        volume = volumes(model.mesh.points, corners)
        compression, shearing = volume * (lame + 2.0 * shear)[part], volume * shear[part]
        dilation = strain[:, :3].sum(axis=1)
        p += dilation.T @ (compression[:, None] * dilation[:, : right.shape[1]])
        whole = (shearing[:, None] * SHEAR)[..., None] * strain[:, :, : right.shape[1]]
        s += strain.reshape(-1, left.shape[1]).T @ whole.reshape(-1, right.shape[1])
        s -= 2.0 * dilation.T @ (shearing[:, None] * dilation[:, : right.shape[1]])
    return p, s


def strain_matrix(mesh: Mesh, zones: np.ndarray, nodes: np.ndarray) -> sparse.csr_array:
    """Return the matrix (6 n_zones, 3 n_nodes) from motion to strains; theory.md (2.1)."""
    inner = shape_gradients(mesh.points, mesh.zones[zones])
    gradient = np.concatenate([-inner.sum(axis=1, keepdims=True), inner], axis=1)
    corner = 3 * np.searchsorted(nodes, mesh.zones[zones])
    first = 6 * np.arange(len(zones))[:, None]
    rows, columns, values = [], [], []
    for row, component, axis in STRAIN:
        rows.append(np.broadcast_to(first + row, corner.shape).ravel())
        columns.append((corner + component).ravel())
        values.append(gradient[:, :, axis].ravel())
    places = np.concatenate(rows), np.concatenate(columns)
    shape = (6 * len(zones), 3 * len(nodes))
    return sparse.csr_array((np.concatenate(values), places), shape=shape)


def _joints(contacts, left, right):
    """Return the projected unit stiffness of each joint, normal and shear."""
    found = {}
    for number, name in enumerate(contacts.names):
        jump, normal, area = joint_jumps(contacts, number, left)
        opening = np.einsum("cir,ci->cr", jump, normal)
        weighted = area[:, None] * opening[:, : right.shape[1]]
        found["kn", name] = opening.T @ weighted
        whole = (area[:, None, None] * jump[:, :, : right.shape[1]]).reshape(-1, right.shape[1])
        found["ks", name] = jump.reshape(-1, left.shape[1]).T @ whole - found["kn", name]
    return found


def joint_jumps(contacts, number, basis):
    """Return the jumps (n, 3, n_basis), normals and areas of the contacts of one joint."""
    here = np.flatnonzero(contacts.joint == number)
    at = basis.reshape(-1, 3, basis.shape[1])
    jump = at[contacts.plus[here]] - at[contacts.minus[here]]
    return jump, contacts.normal[here], contacts.area[here]


SKETCH = 64  # random directions that sketch the residual


@dataclass(frozen=True, eq=False)
class Projection:
    """Galerkin projection of a family of models on a basis.

    Parameters
    ----------
    family : Family
    contour : Contour
    directions : (3 n_nodes, size) float64
        The basis, orthonormal by the mass.
    matrices : dict of tuple to (size + n_sketch, size) float64
        From `projected_matrices`: rows of the basis, then random rows that sketch the residual.
    force : (n_frequencies, size + n_sketch) complex128
    receivers : (3 n_receivers, size) float64
    mass : float, kg
        Of the whole model.
    """

    family: Family
    contour: Contour
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
    """Project a family on the basis of the motion of its training runs.

    Parameters
    ----------
    family : Family
    modes : list of (3 n_nodes, n) float32
        Of each run.
    tolerance : float
        Fraction of the largest singular value below which vectors are dropped.
    seed : int
        Of the random directions.
    """
    middle = family.ranges.middle()
    model, constants = family.model(middle), family.prepared(middle).constants
    root = np.repeat(np.sqrt(family.mass), 3)[:, None]
    basis = orthonormal_basis(modes, tolerance)
    both = np.concatenate([basis, _residual_sketch(constants, seed)], axis=1) / root
    directions = np.ascontiguousarray(both[:, : basis.shape[1]])
    path = contour(family.dt, family.n_steps, family.highest)
    corners = directions.reshape(-1, 3, directions.shape[1])[constants["receiver_node"]]
    receivers = np.einsum("rk,rkic->ric", constants["receiver_weight"], corners)
    return Projection(
        family, path, directions, projected_matrices(model, constants, both, directions),
        generalised_forces(constants, both, path), receivers.reshape(-1, directions.shape[1]),
        float(family.mass.sum()),
    )  # fmt: skip


def _residual_sketch(constants, seed):
    """Return random directions (3 n_nodes, n_sketch) orthogonal to the supports."""
    shape = len(constants["node_mass"]), 3, SKETCH
    random = np.random.default_rng([seed, 2]).standard_normal(shape) / np.sqrt(SKETCH)
    node, direction = constants["fixed_node"], constants["fixed_direction"]
    held = np.einsum("ni,nik->nk", direction, random[node])
    np.subtract.at(random, node, direction[:, :, None] * held[:, None])
    return random.reshape(-1, SKETCH)


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of the projected system on the contour.

    Parameters
    ----------
    motion : (n_frequencies, size) complex128
        Coefficients of the basis.
    velocity : (n_frequencies, 3 n_receivers) complex128, m/s
    residual : float
        Of the full system over the motion of the receiver that moves least; theory.md (10.7).
    """

    motion: np.ndarray
    velocity: np.ndarray
    residual: float


def solve(projection: Projection, values) -> Solution:
    """Solve the projected system for given values on the contour; theory.md (10.4)."""
    n, force, path = projection.size, projection.force, projection.contour
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
    velocity = path.velocity(motion @ projection.receivers.T)
    size = np.sqrt(path.energy(rest / np.abs(path.rate)[:, None]).sum() / projection.mass)
    moved = np.sqrt(path.energy(velocity).reshape(-1, 3).sum(axis=1).min())
    return Solution(motion, velocity, float(size / max(moved, np.finfo(float).tiny)))


def _terms(projection, values):
    """Return the symbols of the matrices on the contour, and the matrices; theory.md (10.3)."""
    family, path, part = projection.family, projection.contour, projection.matrices
    model = family.ranges.model(family.base, values)
    rate, still, lagged, relaxing = part["dashpots",].copy(), 0.0, 0.0, {}
    if ("sponge",) in part:
        rate += part["sponge",]
    alpha, beta = model.group_damping("alpha"), model.group_damping("beta")
    for number, group in enumerate(model.mesh.groups):
        p, s = part["p", group], part["s", group]
        rate += alpha[number] * part["drag", group]
        still = still + p + s
        lagged = lagged + beta[number] * (p + s)
        for branch in model.branches(group):
            known = relaxing.get(branch.rate, 0.0)
            relaxing[branch.rate] = known + branch.compression * p + branch.shear * s
    for joint in model.joints:
        for name in ("kn", "ks"):
            still = still + joint.properties[name] * part[name, joint.surface]
    symbols = [path.mass, path.mean_rate, np.ones_like(path.z)]
    matrices = [part["mass",], rate, still]
    if np.any(lagged):
        symbols, matrices = [*symbols, path.lagged_rate], [*matrices, lagged]
    symbols += [path.relaxing(pace) for pace in relaxing]
    return np.array(symbols), np.array([*matrices, *relaxing.values()])


def check_sources(family):
    """Raise InputError for families without sources, or whose sources depend on the parameters.

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
