"""The longest stable time step, and what limits it; mass added to zones that would shorten it."""

from dataclasses import dataclass

import numpy as np

from ..meshing import tetrahedra
from ..meshing.tetrahedra import shape_gradients
from .quadratic_frequencies import quadratic_frequencies

# Slivers shorten the step more than tenfold; ground that is fine on purpose shall keep its mass.
WORTH = 1.5
PLACE = 256  # zones that follow one another along the curve of `renumbered`
IN_ONE_PLACE = 20.0


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
    added_share : dict of str to float
        The same over the mass, by material.
    unscaled : float, s
        The step without added mass.
    """

    dt: float
    undamped: float
    limited_by: str
    added_mass: np.ndarray
    added_share: dict[str, float]
    unscaled: float


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


def anisotropic_frequencies(points, zones, stiffness, density):
    """Return what `zone_frequencies` does for stiffnesses (n_zones, 6, 6) in Pa; also exact.

    Notes
    -----
    With the strain B u of the corner motions u it is ``4/rho`` times the largest eigenvalue of
    B B^T C: theory.md (2.24).
    """
    gradient = shape_gradients(points, zones)
    every = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    x, y, z = np.moveaxis(every, 2, 0)
    o = np.zeros_like(x)
    parts = [[x, o, o], [o, y, o], [o, o, z], [o, z, y], [z, o, x], [y, x, o]]
    strain = np.stack([np.concatenate(row, axis=1) for row in parts], axis=1)
    root = np.linalg.cholesky(stiffness)
    lengths = np.einsum("zji,zjk->zik", root, strain)
    return 4.0 / density * np.linalg.eigvalsh(lengths @ np.swapaxes(lengths, 1, 2))[:, -1]


def model_frequencies(model):
    """Return the square of the largest angular frequency of each zone of a model, (n_zones,)."""
    mesh, density, (lame, shear) = model.mesh, model.zone_values("density"), model.stiffest_moduli()
    if model.quadratic:
        return quadratic_frequencies(mesh.points, mesh.zones, lame, shear, density)
    squared = zone_frequencies(mesh.points, mesh.zones, lame, shear, density)
    for number, group in enumerate(mesh.groups):
        law = model.law(group)
        if law.name == "anisotropic":
            here = mesh.zone_group == number
            scale = shear[here] / model.materials[group].shear
            stiffness = scale[:, None, None] * law.stiffness
            zones = mesh.zones[here]
            squared[here] = anisotropic_frequencies(mesh.points, zones, stiffness, density[here])
    return squared


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
    For a step T every node lends its contacts the share ``phi = T^2 d / (2 m)`` of its mass, d
    being the stiffness of its springs: no contact then limits the step (Anderson & Morley 1985).
    Its zones keep the rest (Irons & Treharne 1971) and take added mass where they need it. The
    step is the longest whose added mass stays within its share of each group, and within 20 shares
    of any place: theory.md (2.13). Where that wins less than a half no mass is added.
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

    def lent(dt):
        """Share of its mass that each zone lends to contacts."""
        return stiffness * dt**2 / 4.0 + viscosity * dt / 2.0

    def needs(dt, beta):
        """Mass over its own that each zone needs for a step."""
        free = np.maximum(1.0 - lent(dt), 1e-12)
        return zone * (dt**2 / 4.0 + dt * beta / 2.0) / free

    def longest(beta, share):
        """Bisect for the step whose added mass stays within a share."""
        low, high = 0.0, 2.0 / np.sqrt(zone.min())
        for _ in range(60):
            middle = 0.5 * (low + high)
            added = mass * np.maximum(0.0, needs(middle, beta) - 1.0)
            fits = _fits(mesh, added, mass, share)
            low, high = (middle, high) if fits else (low, middle)
        return low

    dt = unscaled = longest(beta, 0.0)
    share = model.added_mass
    if share > 0.0 and (scaled := longest(beta, share)) >= WORTH * unscaled:
        dt = scaled
    else:
        share = 0.0
    need = needs(dt, beta)
    added = mass * np.maximum(0.0, need - 1.0) if share else np.zeros_like(mass)
    limited_by = _limit(model, int(need.argmax()), share > 0.0, lent(dt))
    by_group = dict(zip(mesh.groups, _group_shares(mesh, added, mass).tolist(), strict=True))
    return CriticalStep(dt, longest(0.0 * beta, share), limited_by, added, by_group, unscaled)


def _shares(part, count, added, mass):
    """Return added over own mass (count,) of parts of a model; ``part`` has one for each zone."""
    added, mass = (np.bincount(part, kg, count) for kg in (added, mass))
    return added / np.maximum(mass, np.finfo(float).tiny)


def _group_shares(mesh, added, mass):
    """Return the share of added mass of each group, (n_groups,)."""
    return _shares(mesh.zone_group, len(mesh.groups), added, mass)


def _fits(mesh, added, mass, share):
    """Tell whether added mass stays within a share of each group, and 20 shares of any place."""
    count = max(1, len(mass) // PLACE)
    place = np.minimum(np.arange(len(mass)) // PLACE, count - 1)
    within = _group_shares(mesh, added, mass).max() <= share
    return within and _shares(place, count, added, mass).max() <= IN_ONE_PLACE * share


def contact_bounds(model):
    """Sum the largest stiffness (N/m) and the viscosity (N s/m) of the contacts of each node."""
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
    """Describe the zone that sets the step, or the joint whose contacts have most of its mass."""
    mesh = model.mesh
    x, y, z = mesh.points[mesh.zones[worst]].mean(axis=0)
    what = f"a zone of '{mesh.groups[mesh.zone_group[worst]]}'"
    if share[worst] > 0.5:
        contacts = model.nodes.contacts
        pairs = np.stack([contacts.minus, contacts.plus])
        contact = int(np.isin(pairs, model.nodes.zone_nodes[worst]).any(axis=0).argmax())
        what = f"a contact of joint '{contacts.names[contacts.joint[contact]]}'"
    note = " and others as short, after adding mass" if scaled else ""
    return f"{what} at ({x:.1f}, {y:.1f}, {z:.1f}) m{note}"
