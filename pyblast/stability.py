"""The longest stable time step, and what limits it; mass added to zones that would shorten it."""

from dataclasses import dataclass

import numpy as np

from . import tetrahedra


@dataclass(frozen=True)
class CriticalStep:
    """A safe bound of the longest stable step.

    Parameters
    ----------
    dt : float, s
    undamped : float, s
        The same without stiffness damping.
    limited_by : str
        The part that sets it.
    added_mass : (n_zones,) float64, kg
        What selective mass scaling put on.
    """

    dt: float
    undamped: float
    limited_by: str
    added_mass: np.ndarray


def zone_frequencies(points, zones, first_lame, shear, density):
    """Return the square of each zone's largest angular frequency, (n_zones,) 1/s2.

    Notes
    -----
    With S = sum of g g^T over the shape gradients g, eigenvalues s1 >= s2 >= s3, it is
    ``4/rho max(eig(2 mu diag(s) + lambda r r^T), mu (s1 + s2))``, r = sqrt(s): exact for an
    isotropic tetrahedron with a quarter of its mass at each node; theory.md (2.12).
    """
    gradient = shape_gradients(points, zones)
    every = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    s = np.maximum(np.linalg.eigvalsh(np.einsum("zai,zaj->zij", every, every)), 0.0)
    root = np.sqrt(s)
    matrix = first_lame[:, None, None] * root[:, :, None] * root[:, None, :]
    matrix[:, range(3), range(3)] += 2.0 * shear[:, None] * s
    largest = np.maximum(np.linalg.eigvalsh(matrix)[:, -1], shear * (s[:, 1] + s[:, 2]))
    return 4.0 * largest / density


def shape_gradients(points, zones):
    """Return the gradients of shape functions 2 to 4, (n_zones, 3, 3) 1/m, last axis x y z."""
    sides = points[zones[:, 1:]] - points[zones[:, :1]]
    return np.swapaxes(np.linalg.inv(sides), 1, 2)


def node_sums(zones, values, n_nodes):
    """Give a quarter of a value of each zone to each of its nodes, (n_nodes,)."""
    return np.bincount(zones.ravel(), np.repeat(0.25 * values, 4), minlength=n_nodes)


def critical_step(model):
    """Bound the longest stable step of a model from zones, contacts and damping together.

    Parameters
    ----------
    model : Model

    Returns
    -------
    CriticalStep

    Notes
    -----
    Every node lends a share phi of its mass to its contacts and the rest to its zones, so the
    largest frequency is at most that of the worst zone or contact alone (Irons & Treharne 1971,
    Anderson & Morley 1985 for the contacts): theory.md (2.13).
    """
    mesh = model.mesh
    density = model.zone_values("density")
    zone = zone_frequencies(
        mesh.points, mesh.zones, model.zone_values("first_lame"), model.zone_values("shear"), density
    )
    beta = model.zone_damping("beta")
    mass = density * tetrahedra.volumes(mesh.points, mesh.zones)
    stiffness = contact_stiffness(model)
    node_mass = node_sums(mesh.zones, mass, len(mesh.points))
    contact = 2.0 * stiffness / node_mass
    around = np.zeros(len(mesh.points))
    np.maximum.at(around, mesh.zones.ravel(), np.repeat(zone, 4))
    share = contact / (contact + around)
    free = 1.0 - share[mesh.zones].max(axis=1)
    factor, scaled = _mass_factors(zone / free, beta, mass, model.added_mass)
    steps = _steps(zone / free / factor, beta)
    undamped = _steps(zone / free / factor, 0.0 * beta).min()

    worst = int(steps.argmin())
    limits = [(steps[worst], _worst_zone(model, worst, scaled, share))]
    if mesh.contacts is not None and len(mesh.contacts.area):
        pair = 0.5 * (contact / np.maximum(share, 1e-300))
        both = pair[mesh.contacts.minus] + pair[mesh.contacts.plus]
        worst = int(both.argmax())
        joint = mesh.contacts.names[mesh.contacts.joint[worst]]
        limits.append((2.0 / np.sqrt(both[worst]), f"a contact of joint '{joint}'"))
    longest, limited_by = min(limits)
    return CriticalStep(float(longest), float(undamped), limited_by, mass * (factor - 1.0))


def contact_stiffness(model):
    """Return the largest spring stiffness at each node, summed over its contacts, (n_nodes,) N/m."""
    total = np.zeros(len(model.mesh.points))
    contacts = model.mesh.contacts
    if contacts is None:
        return total
    by_name = {joint.surface: joint.properties for joint in model.joints}
    largest = np.array([max(by_name[n]["kn"], by_name[n]["ks"]) for n in contacts.names])
    spring = contacts.area * largest[contacts.joint]
    for side in (contacts.minus, contacts.plus):
        total += np.bincount(side, spring, minlength=len(total))
    return total


def _steps(frequency_squared, beta):
    """Solve (dt/2)^2 w + dt beta w / 2 = 1: central differences with lagged stiffness damping."""
    return 4.0 / frequency_squared / (beta + np.sqrt(beta**2 + 4.0 / frequency_squared))


def _mass_factors(frequency_squared, beta, mass, share):
    """Return the factors (n_zones,) of mass that lift the shortest steps, and whether any does.

    The step is the longest for which the added mass stays within its share (bisection).
    """
    ones = np.ones(len(mass))
    steps = _steps(frequency_squared, beta)
    if share == 0.0:
        return ones, False
    low, high = float(steps.min()), float(steps.max())
    for _ in range(60):
        middle = 0.5 * (low + high)
        factor = np.maximum(1.0, frequency_squared * (middle**2 / 4.0 + middle * beta / 2.0))
        fits = float(mass @ (factor - 1.0)) <= share * float(mass.sum())
        low, high = (middle, high) if fits else (low, middle)
    factor = np.maximum(1.0, frequency_squared * (low**2 / 4.0 + low * beta / 2.0))
    return factor, bool(factor.max() > 1.0)


def _worst_zone(model, worst, scaled, share):
    """Describe the zone that sets the step, or the joint whose contacts have most of its mass."""
    mesh = model.mesh
    x, y, z = mesh.points[mesh.zones[worst]].mean(axis=0)
    node = mesh.zones[worst][share[mesh.zones[worst]].argmax()]
    what = f"a zone of '{mesh.groups[mesh.zone_group[worst]]}'"
    if share[node] > 0.5:
        contact = int(((mesh.contacts.minus == node) | (mesh.contacts.plus == node)).argmax())
        what = f"a contact of joint '{mesh.contacts.names[mesh.contacts.joint[contact]]}'"
    note = " and others as short, after adding mass" if scaled else ""
    return f"{what} at ({x:.1f}, {y:.1f}, {z:.1f}) m{note}"
