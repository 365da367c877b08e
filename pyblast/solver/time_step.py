"""Critical time step, largest frequency of a model, choice of the implicit zones."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import scipy

from ..mesh import tetrahedra
from ..mesh.mesh import Contacts
from ..mesh.nodes import Nodes
from ..mesh.tetrahedra import shape_gradients
from ..model.anisotropy import Anisotropic
from ..model.model import Model
from .hexahedra import in_layer, layer_lags
from .implicit_zones import Implicit, clusters_of, contact_pairs, moved_nodes
from .line_implicit import SHARE, line_zones, steps_of_zones

# Product of M^-1 (K + rate C) with a motion (n_nodes, 3), in 1/s2, from the motion and the rate.
Product = Callable[..., np.ndarray]
MOST = 40  # products for the largest eigenvalue
LEAST = 20  # the value can stand still before the fastest place is found
ROUNDS = 3  # for the step of a damped model
TIGHT = 1e-3  # its relative change between the last products
ABOVE = 1.005  # factor on the eigenvalue found, which is a lower bound
GRID = 1.01  # ratio of the values to which it is raised, so that its last digits do not matter

LEAST_GAIN = 1.5  # of the cost of a run, for zones to become implicit
RATIO = 1.1  # between the steps that are compared
NODE_COST = 2.2  # of a node of implicit zones over that of an explicit zone, in a step
MOST_IMPLICIT = 0.1  # fraction of the zones
MOST_NODES = 5000  # in one cluster of implicit zones
MOST_OF_JOINT = 0.005  # fraction of the area of a joint
# Slivers reduce the step more than tenfold; zones that are small on purpose shall stay explicit.
PLACE = 64  # consecutive zones along the curve of `renumbered`
FINE = 2.0  # step over the median of the own steps in such a place
QUADRATIC = 3.2  # frequency of a quadratic zone over that of constant strain; theory.md (2.38)


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
    implicit : Implicit
        Zones and contacts that would need a shorter one.
    explicit : float, s
        Critical time step without implicit zones.
    joint : str
        The joint that limits it, empty where the zones do.
    price : float
        Factor on the number of steps by that joint.
    """

    dt: float
    undamped: float
    limited_by: str
    implicit: Implicit
    explicit: float
    joint: str = ""
    price: float = 1.0


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
    have the remaining mass (Irons & Treharne 1971): theory.md (2.13). The smallest zones become
    implicit where that makes a run cheaper by a third at least: theory.md (2.53).
    """
    zone, beta, nodes = model_frequencies(model), model.zone_damping("beta"), model.tetrahedral
    mass = model.zone_values("density") * tetrahedra.volumes(model.mesh.points, model.mesh.zones)
    joints = 2.0 * contact_bounds(model) / nodes.sums(mass)
    spring, viscosity = (part[nodes.zone_nodes].max(axis=1) for part in joints)
    own = longest_step(zone + spring, viscosity + zone * beta)
    choice = _Choice(nodes, own, longest_step(*joints), moved_nodes(model))
    implicit = choice.cheapest(FINE * float(_typical(own).min()))
    rest = np.flatnonzero(~implicit.zones)
    worst = rest[own[rest].argmin()]
    dt, undamped = own[worst], longest_step((zone + spring)[rest], viscosity[rest]).min()
    reserved = spring[worst] * dt**2 / 4.0 + viscosity[worst] * dt / 2.0
    joint = joint_at(model, nodes.zone_nodes[worst]) if reserved > 0.5 else ""
    limited_by = _limit(model, worst, joint, np.count_nonzero(implicit.zones))
    price = longest_step(zone[rest], (zone * beta)[rest]).min() / dt if joint else 1.0
    return CriticalStep(
        float(dt), float(undamped), limited_by, implicit, float(own.min()), joint, float(price)
    )


def assembled_step(
    model: Model, limit: CriticalStep, mass: np.ndarray, product: Product
) -> CriticalStep:
    """Return the critical step of linear zones from the largest frequency of the whole model.

    ``mass`` (n_nodes,) in kg; the product is that of all explicit zones.

    Notes
    -----
    Joints act with their stiffest springs and their whole viscosity. Where damping differs from
    place to place, the step is found from below: theory.md (2.48).
    """
    beta, viscosity = model.group_damping("beta"), contact_bounds(model, limit.implicit)[1]
    product = with_joints(model, product, mass, limit.implicit)
    squared = largest_eigenvalue(product, mass)
    drag = float((2.0 * viscosity / mass).max())
    dt = longest_step(squared, drag, float(beta.max()))
    if np.ptp(beta) > 0.0 or viscosity.any():
        dt = damped_step(product, mass, dt)
    explicit = dt * min(1.0, limit.explicit / limit.dt)
    return replace(limit, dt=dt, undamped=max(dt, longest_step(squared, drag)), explicit=explicit)


def critical_step_of_hexahedra(
    model: Model, mass: np.ndarray, product_of: Callable[..., Product]
) -> CriticalStep:
    """Return the critical time step of a model of hexahedra, from its largest frequency.

    Parameters
    ----------
    model : Model
    mass : (n_zones,) float64, kg
    product_of : callable
        Returns, for the masses (n_nodes,) of nodes, the function that multiplies a motion
        (n_nodes, 3) with the stiffness over the mass, of all zones or of those of a mask.

    Notes
    -----
    Lanczos on the assembled zones and joints, these with their stiffest springs: theory.md (2.48).
    The viscosity of the absorbing layer counts with the largest frequency of its own zones. Of
    line-implicit zones the bound (2.57) holds, with a part of their mass, and its viscosity; the
    rest has the mass that is left.
    """
    bounds = steps_of_zones(model)
    implicit = line_zones(model, bounds)
    lines, active = implicit.any(), (~implicit,) if implicit.any() else ()
    mass = model.nodes.sums(np.where(implicit, 1.0 - SHARE, 1.0) * mass)
    of_lines = bounds[1][implicit].min(initial=np.inf)
    spring, viscosity = contact_bounds(model)
    squared = largest_eigenvalue(with_joints(model, product_of(mass, *active), mass), mass)
    drag = float((2.0 * viscosity / mass).max())
    beta = float(model.group_damping("beta").max())
    within = in_layer(model).any(axis=1)
    if (within & implicit).any():
        lag = beta + float(layer_lags(model, np.flatnonzero(within & implicit)).max())
        across = (2.0 / float(bounds[1][within & implicit].min())) ** 2
        of_lines = min(of_lines, longest_step(across, 0.0, lag))
    own, of_layer = within & ~implicit, np.inf
    if own.any():
        lag = beta + float(layer_lags(model, np.flatnonzero(own)).max())
        of_layer = longest_step(largest_eigenvalue(product_of(mass, own), mass), drag, lag)
    dt = min(longest_step(squared, drag, beta), of_layer, of_lines)
    part, joint, price = "the shortest distance of nodes", "", 1.0
    if 2.0 * (spring / mass).max() > 0.5 * squared:  # both nodes of a contact move
        worst = int((spring / mass).argmax())
        x, y, z = model.nodes.points[worst]
        joint = joint_at(model, np.array([worst]))
        part = f"a contact of joint '{joint}' at ({x:.1f}, {y:.1f}, {z:.1f}) m"
        alone = longest_step(largest_eigenvalue(product_of(mass, *active), mass), 0.0, beta)
        price = min(alone, of_layer, of_lines) / dt
    explicit = dt
    if lines:
        part += f"; {np.count_nonzero(implicit)} zones of thin layers are line-implicit"
        explicit *= float(bounds[0].min() / bounds[0][~implicit].min())
    contacts = np.zeros(len(contact_pairs(model.nodes.contacts)), dtype=bool)
    undamped = min(longest_step(squared, drag), of_lines)
    return CriticalStep(dt, undamped, part, Implicit(implicit, contacts), explicit, joint, price)


def _typical(own):
    """Return the median (n_zones,) of the own steps of each `PLACE` of consecutive zones."""
    count = max(1, len(own) // PLACE)
    part = np.minimum(np.arange(len(own)) // PLACE, count - 1)
    order = np.lexsort((own, part))
    first = np.searchsorted(part, np.arange(count + 1))
    return own[order[(first[:-1] + first[1:]) // 2]][part]


@dataclass(frozen=True, eq=False)
class _Choice:
    """Choice of the implicit zones: own steps of zones (n_zones,) and of the contacts of nodes."""

    nodes: Nodes
    own: np.ndarray
    at_nodes: np.ndarray
    never: np.ndarray

    def below(self, step):
        """Return what is implicit at a step: zones and contacts with a shorter one."""
        weak = self.at_nodes < step
        return Implicit(self.own < step, weak[contact_pairs(self.nodes.contacts)].any(axis=1))

    def longest(self, most):
        """Return the longest step that leaves enough of the ground explicit."""
        of_zones = self.own[self.never[self.nodes.zone_nodes].any(axis=1)]
        pairs = contact_pairs(self.nodes.contacts)
        of_contacts = self.at_nodes[pairs[self.never[pairs].any(axis=1)]]
        limits = [of_zones.min(initial=most), of_contacts.min(initial=most)]
        return float(min(*limits, np.quantile(self.own, MOST_IMPLICIT)))

    def cheapest(self, most):
        """Return what is implicit in the cheapest run, nothing if little is won."""
        shortest = float(self.own.min())
        count = max(0, int(np.log(self.longest(most) / shortest) / np.log(RATIO)))
        steps = shortest * RATIO ** np.arange(1, count + 1)
        cost = np.array([self.cost(step) for step in steps])
        for choice in np.argsort(cost, kind="stable"):
            if cost[choice] * LEAST_GAIN * shortest > len(self.own):
                break
            implicit = self.below(steps[choice])
            if (
                self.few(implicit.contacts)
                and np.bincount(clusters_of(*implicit.nodes(self.nodes))[2]).max() <= MOST_NODES
            ):
                return implicit
        return self.below(0.0)

    def few(self, implicit):
        """Return whether little of every joint has implicit contacts, which resist slip."""
        contacts = self.nodes.contacts
        if contacts is None:
            return True
        whole, part = (np.bincount(contacts.joint, contacts.area * w) for w in (1.0, implicit))
        return bool((part <= MOST_OF_JOINT * whole).all())

    def cost(self, step):
        """Return the cost of a run over its duration, in explicit zones and 1/s."""
        groups = self.below(step).nodes(self.nodes)
        n_nodes = len(np.unique(np.concatenate([group.ravel() for group in groups])))
        return (len(self.own) + NODE_COST * n_nodes) / step


def contact_springs(model: Model, implicit: Implicit | None = None) -> np.ndarray:
    """Return largest stiffness (N/m) and viscosity (N s/m) of contacts, (2, n_contacts).

    Those that are implicit have none.
    """
    contacts = model.nodes.contacts
    if contacts is None:
        return np.zeros((2, 0))
    by_name = {joint.surface: joint for joint in model.joints}
    bounds = np.array([by_name[name].bound() for name in contacts.names]).reshape(-1, 2)
    springs = contacts.area * bounds[contacts.joint].T
    return springs if implicit is None else np.where(implicit.contacts, 0.0, springs)


def contact_bounds(model: Model, implicit: Implicit | None = None) -> np.ndarray:
    """Return the sums (2, n_nodes) of `contact_springs` over the contacts of nodes."""
    pairs, n = contact_pairs(model.nodes.contacts), len(model.nodes.points)
    springs = contact_springs(model, implicit)
    return sum(
        (np.array([np.bincount(side, part, minlength=n) for part in springs]) for side in pairs.T),
        np.zeros((2, n)),
    )


def joint_at(model: Model, nodes: np.ndarray) -> str:
    """Return the name of a joint that has one of some nodes, an empty one without."""
    contacts = model.nodes.contacts
    if contacts is None:
        return ""
    at = np.isin(np.stack([contacts.minus, contacts.plus]), nodes).any(axis=0)
    return contacts.names[contacts.joint[int(at.argmax())]] if at.any() else ""


def _limit(model, worst, joint, implicit):
    """Describe the zone that limits the step, or the joint that reserves most of its mass."""
    mesh = model.mesh
    x, y, z = mesh.points[mesh.zones[worst]].mean(axis=0)
    part = f"a zone of '{mesh.groups[mesh.zone_group[worst]]}'"
    if joint:
        part = f"a contact of joint '{joint}'"
    note = f" ({implicit} smaller zones are implicit)" if implicit else ""
    return f"{part} at ({x:.1f}, {y:.1f}, {z:.1f}) m{note}"


def with_joints(
    model: Model, product: Product, mass: np.ndarray, implicit: Implicit | None = None
) -> Product:
    """Return the product of a whole model: that of its zones, and its joints at their stiffest.

    Those that are implicit are left out.
    """
    contacts = model.nodes.contacts
    if contacts is None:
        return product
    stiffness, viscosity = contact_springs(model, implicit)

    def whole(motion, rate=0.0):
        spring = stiffness + rate * viscosity
        return product(motion, rate) + joint_product(contacts, spring, motion) / mass[:, None]

    return whole


def joint_product(contacts: Contacts, stiffness: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return the forces (n_nodes, 3) in N of springs (n_contacts,) in N/m against a motion."""
    force = np.zeros_like(motion)
    jump = stiffness[:, None] * (motion[contacts.plus] - motion[contacts.minus])
    np.add.at(force, contacts.plus, jump)
    np.subtract.at(force, contacts.minus, jump)
    return force


def longest_step(squared: Any, drag: Any, beta: Any = 0.0) -> Any:
    """Return the longest stable step in s, of numbers or arrays.

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
    drag, squared = drag + squared * beta, np.maximum(squared, np.finfo(float).tiny)
    return (np.sqrt(drag**2 / 4.0 + squared) - drag / 2.0) * 2.0 / squared


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
