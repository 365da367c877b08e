"""Critical time step, largest frequency of a model, mass scaling of small tetrahedra."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from ..mesh import tetrahedra
from ..mesh.mesh import Contacts
from ..mesh.tetrahedra import shape_gradients
from ..model.anisotropy import Anisotropic
from ..model.model import Model

# Product of M^-1 (K + rate C) with a motion (n_nodes, 3), in 1/s2, from the motion and the rate.
Product = Callable[..., np.ndarray]
MOST = 40  # products for the largest eigenvalue
LEAST = 20  # the value can stand still before the fastest place is found
ROUNDS = 3  # for the step of a damped model
TIGHT = 1e-3  # its relative change between the last products
ABOVE = 1.005  # factor on the eigenvalue found, which is a lower bound
GRID = 1.01  # ratio of the values to which it is raised, so that its last digits do not matter

# Slivers reduce the step more than tenfold; deliberately fine zones shall keep their mass.
LEAST_GAIN = 1.5  # of the time step, for mass to be added
PLACE = 256  # consecutive zones along the curve of `renumbered`
IN_ONE_PLACE = 20.0  # allowed multiples of ``added_mass`` in such a place
THIN = 0.25  # smallest altitude over longest edge below which a zone is a sliver
FEW = 64  # consecutive zones whose non-slivers are limited to FINE multiples
FINE = 4.0
QUADRATIC = 3.2  # frequency of a quadratic zone over that of constant strain; theory.md (2.38)
CHUNK = 2**13  # zones whose shapes are computed at once


@dataclass(frozen=True)
class CriticalStep:
    """Critical time step: a lower bound of the longest stable step, with its cause.

    Parameters
    ----------
    dt : float, s
    undamped : float, s
        Without stiffness damping.
    limited_by : str
        The zone or contact that limits it.
    added_mass : (n_zones,) float64, kg
        Mass added by selective mass scaling.
    added_share : dict of str to float
        Added mass over mass, by group.
    unscaled : float, s
        Without added mass.
    """

    dt: float
    undamped: float
    limited_by: str
    added_mass: np.ndarray
    added_share: dict[str, float]
    unscaled: float


def zone_frequencies(
    points: np.ndarray,
    zones: np.ndarray,
    first_lame: np.ndarray,
    shear: np.ndarray,
    density: np.ndarray,
) -> np.ndarray:
    """Return the square of each zone's largest angular frequency, (n_zones,) 1/s2.

    Notes
    -----
    With S = sum of g g^T over the shape gradients g, eigenvalues s1 >= s2 >= s3, it is
    ``4/rho max(eig(2 mu diag(s) + lambda r r^T), mu (s1 + s2))``, r = sqrt(s): exact for an
    isotropic tetrahedron with a quarter of its mass at each node; theory.md (2.12).
    """
    gradient = shape_gradients(points, zones)
    gradients = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    s = np.maximum(np.linalg.eigvalsh(np.einsum("zai,zaj->zij", gradients, gradients)), 0.0)
    root = np.sqrt(s)
    matrix = first_lame[:, None, None] * root[:, :, None] * root[:, None, :]
    matrix[:, range(3), range(3)] += 2.0 * shear[:, None] * s
    largest = np.maximum(np.linalg.eigvalsh(matrix)[:, -1], shear * (s[:, 1] + s[:, 2]))
    return 4.0 * largest / density


def anisotropic_frequencies(
    points: np.ndarray, zones: np.ndarray, stiffness: np.ndarray, density: np.ndarray
) -> np.ndarray:
    """Return `zone_frequencies` of anisotropic zones with stiffness (n_zones, 6, 6) in Pa.

    Notes
    -----
    With the strain B u of the corner displacements u: ``4/rho`` times the largest eigenvalue of
    B B^T C, exact; theory.md (2.24).
    """
    gradient = shape_gradients(points, zones)
    gradients = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    x, y, z = np.moveaxis(gradients, 2, 0)
    o = np.zeros_like(x)
    parts = [[x, o, o], [o, y, o], [o, o, z], [o, z, y], [z, o, x], [y, x, o]]
    strain = np.stack([np.concatenate(row, axis=1) for row in parts], axis=1)
    root = np.linalg.cholesky(stiffness)
    lengths = np.einsum("zji,zjk->zik", root, strain)
    return 4.0 / density * np.linalg.eigvalsh(lengths @ np.swapaxes(lengths, 1, 2))[:, -1]


def model_frequencies(model: Model) -> np.ndarray:
    """Return the square of the largest angular frequency of each zone of a model, (n_zones,).

    Of quadratic zones an estimate, which may be 10 to 20 % off.
    """
    mesh, density, (lame, shear) = model.mesh, model.zone_values("density"), model.stiffest_moduli()
    squared = zone_frequencies(mesh.points, mesh.zones, lame, shear, density)
    if model.quadratic:
        return QUADRATIC**2 * squared
    for number, group in enumerate(mesh.groups):
        law = model.law(group)
        if isinstance(law, Anisotropic):
            here = mesh.zone_group == number
            scale = shear[here] / model.materials[group].shear
            stiffness = scale[:, None, None] * law.stiffness
            zones = mesh.zones[here]
            squared[here] = anisotropic_frequencies(mesh.points, zones, stiffness, density[here])
    return squared


def critical_step(model: Model) -> CriticalStep:
    """Return the critical time step of a model with zones, contacts and damping.

    Parameters
    ----------
    model : Model

    Returns
    -------
    CriticalStep

    Notes
    -----
    For a step T every node reserves the fraction ``phi = T^2 d / (2 m)`` of its mass for its
    contacts of stiffness d, so that no contact limits the step (Anderson & Morley 1985). The zones
    have the remaining mass (Irons & Treharne 1971) and added mass as required. The step is the
    longest whose added mass is within its limit in each group, within 20 times that limit in any
    neighbourhood, 4 times for small zones that are not slivers: theory.md (2.13). No mass is added
    if the step would grow by less than one half.
    """
    mesh = model.mesh
    density = model.zone_values("density")
    zone = model_frequencies(model)
    beta = model.zone_damping("beta")
    mass = density * tetrahedra.volumes(mesh.points, mesh.zones)
    nodes = model.nodes
    node_mass = nodes.sums(mass)
    stiffness, viscosity = (
        (2.0 * part / node_mass)[nodes.zone_nodes].max(axis=1) for part in contact_bounds(model)
    )

    needs = _MassNeed(zone, beta, stiffness, viscosity)
    search = _Search(needs, mass, _parts(mesh, mass))
    dt = unscaled = search.longest(0.0)
    share = model.added_mass
    allowed = share > 0.0 and search.within(search.added(LEAST_GAIN * unscaled), share)
    if allowed and (scaled := search.longest(share)) >= LEAST_GAIN * unscaled:
        dt = scaled
    else:
        share = 0.0
    undamped = dt
    if beta.any():
        undamped = replace(search, needs=replace(needs, beta=0.0 * beta)).longest(share)
    need = needs(dt)
    added = mass * np.maximum(0.0, need - 1.0) if share else np.zeros_like(mass)
    limited_by = _limit(model, int(need.argmax()), share > 0.0, needs.reserved(dt))
    part, own, _ = search.parts[0]
    by_group = _shares(part, added, own).tolist()
    shares = dict(zip(mesh.groups, by_group, strict=True))
    return CriticalStep(dt, undamped, limited_by, added, shares, unscaled)


def assembled_step(
    model: Model, limit: CriticalStep, mass: np.ndarray, product_of: Callable[..., Product]
) -> CriticalStep:
    """Return the critical step of linear zones from the largest frequency of the whole model.

    Parameters
    ----------
    model : Model
    limit : CriticalStep
        From single zones, with the added mass.
    mass : (n_zones,) float64, kg
        Without added mass.
    product_of : callable
        From the mass of nodes to the function that multiplies a motion with the stiffness of all
        zones over the mass.

    Notes
    -----
    Joints act with their stiffest springs and their whole viscosity. Where damping differs from
    place to place, the step is found from below: theory.md (2.48).
    """
    beta, viscosity = model.group_damping("beta"), contact_bounds(model)[1]

    def steps(added):
        node_mass = model.nodes.sums(mass + added)
        product = with_joints(model, product_of(node_mass), node_mass)
        squared = largest_eigenvalue(product, node_mass)
        drag = float((2.0 * viscosity / node_mass).max())
        dt = longest_step(squared, drag, float(beta.max()))
        if np.ptp(beta) > 0.0 or viscosity.any():
            dt = damped_step(product, node_mass, dt)
        return dt, max(dt, longest_step(squared, drag))

    dt, undamped = steps(limit.added_mass)
    unscaled = steps(0.0)[0] if limit.added_mass.any() else dt
    return replace(limit, dt=dt, undamped=undamped, unscaled=unscaled)


@dataclass(frozen=True, eq=False)
class _MassNeed:
    """Required over available mass of zones for a time step, (n_zones,)."""

    zone: np.ndarray
    beta: np.ndarray
    stiffness: np.ndarray
    viscosity: np.ndarray

    def reserved(self, dt):
        """Return the fraction of the mass of each zone that is reserved for contacts."""
        return self.stiffness * dt**2 / 4.0 + self.viscosity * dt / 2.0

    def __call__(self, dt):
        """Return the required over the available mass; it increases with the step."""
        free = np.maximum(1.0 - self.reserved(dt), 1e-12)
        return self.zone * (dt**2 / 4.0 + dt * self.beta / 2.0) / free

    def of(self, zones):
        """Return the need of a subset of zones."""
        return _MassNeed(*(part[zones] for part in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Search:
    """Bisection for the longest step with limited added mass in each part of a model.

    ``parts`` holds the part of each zone, the mass of every part in kg, and the allowed multiple of
    ``added_mass``.
    """

    needs: _MassNeed
    mass: np.ndarray
    parts: tuple[tuple[np.ndarray, np.ndarray, float], ...]

    def longest(self, share):
        """Return the longest step in s."""
        low, high, search = 0.0, 2.0 / np.sqrt(self.needs.zone.min()), self
        for _ in range(60):
            middle = 0.5 * (low + high)
            added = search.added(middle)
            if search.within(added, share):
                low = middle
            else:  # zones without added mass need none for a shorter step
                high, search = middle, search.of(np.flatnonzero(added))
        return low

    def added(self, dt):
        """Return the added mass of each zone for a step, (n_zones,) kg."""
        return self.mass * np.maximum(0.0, self.needs(dt) - 1.0)

    def within(self, added, share):
        """Return whether the added mass is within the limit of each part."""
        if not share:
            return not added.any()
        return all(
            _shares(part, added, own).max() <= most * share for part, own, most in self.parts
        )

    def of(self, zones):
        """Return the search for a subset of zones."""
        parts = tuple((part[zones], own, most) for part, own, most in self.parts)
        return _Search(self.needs.of(zones), self.mass[zones], parts)


def _parts(mesh, mass):
    """Return the parts with limited mass: groups, and sequences of consecutive zones.

    Slivers are excluded from the shorter sequences.
    """
    (cell, count), (few, n_few) = (_places(len(mass), size) for size in (PLACE, FEW))
    sliver = _thinness(mesh) < THIN
    limits = ((mesh.zone_group, len(mesh.groups), 1.0), (cell, count, IN_ONE_PLACE))
    return (
        *((part, np.bincount(part, mass, count), most) for part, count, most in limits),
        (np.where(sliver, n_few, few), np.append(np.bincount(few, mass), np.inf), FINE),
    )


def _places(n_zones, size):
    """Return the sequence (n_zones,) of each zone, and the number of sequences of a size."""
    count = max(1, n_zones // size)
    return np.minimum(np.arange(n_zones) // size, count - 1), count


def _thinness(mesh):
    """Return the smallest altitude of each zone over its longest edge, (n_zones,)."""
    thinness = np.empty(len(mesh.zones))
    for start in range(0, len(thinness), CHUNK):
        zones = mesh.zones[start : start + CHUNK]
        gradient = shape_gradients(mesh.points, zones)
        gradients = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
        altitude = 1.0 / np.linalg.norm(gradients, axis=2).max(axis=1)
        longest = tetrahedra.edge_lengths(mesh.points, zones).max(axis=1)
        thinness[start : start + CHUNK] = altitude / longest
    return thinness


def _shares(part, added, own):
    """Return the added over the original mass of each part; ``part`` (n_zones,)."""
    return np.bincount(part, added, len(own)) / np.maximum(own, np.finfo(float).tiny)


def contact_bounds(model: Model) -> np.ndarray:
    """Return largest stiffness (N/m) and viscosity (N s/m) summed over the contacts of nodes."""
    total = np.zeros((2, len(model.nodes.points)))
    contacts = model.nodes.contacts
    if contacts is None:
        return total
    by_name = {joint.surface: joint for joint in model.joints}
    bounds = np.array([by_name[name].bound() for name in contacts.names]).reshape(-1, 2)
    for sums, bound in zip(total, bounds.T, strict=True):
        spring = contacts.area * bound[contacts.joint]
        for side in (contacts.minus, contacts.plus):
            sums += np.bincount(side, spring, minlength=len(sums))
    return total


def _limit(model, worst, scaled, share):
    """Describe the zone that limits the step, or the joint that reserves most of its mass."""
    mesh = model.mesh
    x, y, z = mesh.points[mesh.zones[worst]].mean(axis=0)
    part = f"a zone of '{mesh.groups[mesh.zone_group[worst]]}'"
    contacts = model.nodes.contacts
    if contacts is not None and share[worst] > 0.5:
        pairs = np.stack([contacts.minus, contacts.plus])
        contact = int(np.isin(pairs, model.nodes.zone_nodes[worst]).any(axis=0).argmax())
        part = f"a contact of joint '{contacts.names[contacts.joint[contact]]}'"
    note = " and others as short, after adding mass" if scaled else ""
    return f"{part} at ({x:.1f}, {y:.1f}, {z:.1f}) m{note}"


def with_joints(model: Model, product: Product, mass: np.ndarray) -> Product:
    """Return the product of a whole model: that of its zones, and its joints at their stiffest."""
    contacts = model.nodes.contacts
    if contacts is None:
        return product
    by_name = {joint.surface: joint for joint in model.joints}
    bounds = np.array([by_name[name].bound() for name in contacts.names]).reshape(-1, 2)
    bound = bounds[contacts.joint]

    def whole(motion, rate=0.0):
        spring = contacts.area * (bound[:, 0] + rate * bound[:, 1])
        return product(motion, rate) + joint_product(contacts, spring, motion) / mass[:, None]

    return whole


def joint_product(contacts: Contacts, stiffness: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return the forces (n_nodes, 3) in N of springs (n_contacts,) in N/m against a motion."""
    force = np.zeros_like(motion)
    jump = stiffness[:, None] * (motion[contacts.plus] - motion[contacts.minus])
    np.add.at(force, contacts.plus, jump)
    np.subtract.at(force, contacts.minus, jump)
    return force


def longest_step(squared: float, drag: float, beta: float = 0.0) -> float:
    """Return the longest stable step in s.

    Parameters
    ----------
    squared : float, 1/s2
        Square of the largest angular frequency.
    drag : float, 1/s
        Largest damping force over mass and velocity.
    beta : float, s
        Stiffness damping.

    Notes
    -----
    The root of ``squared T^2/4 + (drag + squared beta) T/2 = 1``; theory.md (2.48).
    """
    drag = drag + squared * beta
    return float((np.sqrt(drag**2 / 4.0 + squared) - drag / 2.0) * 2.0 / squared)


def damped_step(product: Product, mass: np.ndarray, shortest: float) -> float:
    """Return the longest stable step of damped zones and joints in s, at least ``shortest``.

    Notes
    -----
    A step T is stable if the largest eigenvalue of ``M^-1 (K + 2/T C)`` is at most ``4/T^2``. The
    eigenvalue falls with T, so that of a stable step gives a longer one: theory.md (2.48).
    """
    dt = shortest
    for _ in range(ROUNDS):
        squared = largest_eigenvalue(partial(product, rate=2.0 / dt), mass)
        dt = max(dt, longest_step(squared, 0.0))
    return dt


def largest_eigenvalue(product: Product, mass: np.ndarray) -> float:
    """Return the largest eigenvalue of M^-1 K in 1/s2, raised by what its search may miss.

    Notes
    -----
    Lanczos from a fixed start in the inner product of the mass; theory.md (2.48).
    """
    n_nodes = len(mass)
    motion = np.random.default_rng(0).standard_normal((n_nodes, 3))
    weight = mass[:, None]
    motion /= np.sqrt((weight * motion**2).sum())
    before, off, diagonal, beside, largest = 0.0 * motion, 0.0, [], [], 0.0
    for count in range(1, min(MOST, 3 * n_nodes) + 1):
        image = product(motion) - off * before
        diagonal.append(float((weight * image * motion).sum()))
        image -= diagonal[-1] * motion
        off = float(np.sqrt((weight * image**2).sum()))
        value = float(scipy.linalg.eigvalsh_tridiagonal(np.array(diagonal), np.array(beside))[-1])
        still = count >= LEAST and abs(value - largest) < TIGHT * value
        if still or off <= 1e-12 * value:
            return _raised(value)
        largest = value
        beside.append(off)
        before, motion = motion, image / off
    return _raised(largest)


def _raised(value):
    """Return the next value of a fixed sequence."""
    return float(GRID ** np.ceil(np.log(ABOVE * value) / np.log(GRID)))
