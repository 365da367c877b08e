"""The longest stable time step, and added mass for tetrahedra that would shorten it."""

from dataclasses import dataclass, replace

import numpy as np

from ..mesh import tetrahedra
from ..mesh.nodes import kept
from ..mesh.tetrahedra import VOLUME_SHARE, shape_gradients, stiffness_table
from ..model.model import Model

_CHUNK = 1000
_ALIKE = 9  # decimals of shape and moduli by which zones count as similar


def quadratic_frequencies(
    points: np.ndarray,
    zones: np.ndarray,
    first_lame: np.ndarray,
    shear: np.ndarray,
    density: np.ndarray,
) -> np.ndarray:
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


def zone_stiffness(
    points: np.ndarray, zones: np.ndarray, first_lame: np.ndarray, shear: np.ndarray
) -> np.ndarray:
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


# Slivers shorten the step more than tenfold; ground that is fine on purpose shall keep its mass.
WORTH = 1.5
PLACE = 256  # zones that follow one another along the curve of `renumbered`
IN_ONE_PLACE = 20.0
THIN = 0.25  # smallest altitude over longest edge of what counts as a sliver
FEW = 64  # zones of a place whose zones that are no slivers may take FINE shares only
FINE = 4.0
TOGETHER = 2**13  # zones whose shapes are looked at at once


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
    every = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
    s = np.maximum(np.linalg.eigvalsh(np.einsum("zai,zaj->zij", every, every)), 0.0)
    root = np.sqrt(s)
    matrix = first_lame[:, None, None] * root[:, :, None] * root[:, None, :]
    matrix[:, range(3), range(3)] += 2.0 * shear[:, None] * s
    largest = np.maximum(np.linalg.eigvalsh(matrix)[:, -1], shear * (s[:, 1] + s[:, 2]))
    return 4.0 * largest / density


def anisotropic_frequencies(
    points: np.ndarray, zones: np.ndarray, stiffness: np.ndarray, density: np.ndarray
) -> np.ndarray:
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


def model_frequencies(model: Model) -> np.ndarray:
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


def critical_step(model: Model) -> CriticalStep:
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
    of any place, 4 where zones are small but no slivers: theory.md (2.13). Where that wins less
    than a half no mass is added.
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

    needs = _Needs(zone, beta, stiffness, viscosity)
    search = _Search(needs, mass, _parts(mesh, mass))
    dt = unscaled = search.longest(0.0)
    share = model.added_mass
    worth = share > 0.0 and search.within(search.added(WORTH * unscaled), share)
    if worth and (scaled := search.longest(share)) >= WORTH * unscaled:
        dt = scaled
    else:
        share = 0.0
    undamped = dt
    if beta.any():
        undamped = replace(search, needs=replace(needs, beta=0.0 * beta)).longest(share)
    need = needs(dt)
    added = mass * np.maximum(0.0, need - 1.0) if share else np.zeros_like(mass)
    limited_by = _limit(model, int(need.argmax()), share > 0.0, needs.lent(dt))
    part, own, _ = search.parts[0]
    by_group = _shares(part, added, own).tolist()
    shares = dict(zip(mesh.groups, by_group, strict=True))
    return CriticalStep(dt, undamped, limited_by, added, shares, unscaled)


@dataclass(frozen=True, eq=False)
class _Needs:
    """What zones need for a step: the mass that it asks for over what they have, (n_zones,)."""

    zone: np.ndarray
    beta: np.ndarray
    stiffness: np.ndarray
    viscosity: np.ndarray

    def lent(self, dt):
        """Share of its mass that each zone lends to contacts."""
        return self.stiffness * dt**2 / 4.0 + self.viscosity * dt / 2.0

    def __call__(self, dt):
        """Mass over its own that each zone needs; it grows with the step."""
        free = np.maximum(1.0 - self.lent(dt), 1e-12)
        return self.zone * (dt**2 / 4.0 + dt * self.beta / 2.0) / free

    def of(self, some):
        """Return the same of some zones."""
        return _Needs(*(part[some] for part in vars(self).values()))


@dataclass(frozen=True, eq=False)
class _Search:
    """Bisection for the step whose added mass stays within a share of each part of a model.

    ``parts`` holds the part of each zone, the mass of every part in kg, and how many shares it
    may take.
    """

    needs: _Needs
    mass: np.ndarray
    parts: tuple[tuple[np.ndarray, np.ndarray, float], ...]

    def longest(self, share):
        """Return the longest step in s."""
        low, high, left = 0.0, 2.0 / np.sqrt(self.needs.zone.min()), self
        for _ in range(60):
            middle = 0.5 * (low + high)
            added = left.added(middle)
            if left.within(added, share):
                low = middle
            else:  # what needs nothing now will need nothing for a shorter step
                high, left = middle, left.of(np.flatnonzero(added))
        return low

    def added(self, dt):
        """Return the mass that each zone takes for a step, (n_zones,) kg."""
        return self.mass * np.maximum(0.0, self.needs(dt) - 1.0)

    def within(self, added, share):
        """Tell whether added mass stays within a share of each part."""
        if not share:
            return not added.any()
        found = (_shares(part, added, own).max() <= most * share for part, own, most in self.parts)
        return all(found)

    def of(self, some):
        """Return the same for some zones."""
        parts = tuple((part[some], own, most) for part, own, most in self.parts)
        return _Search(self.needs.of(some), self.mass[some], parts)


def _parts(mesh, mass):
    """Return the parts whose mass is limited: the groups, and places of zones that follow.

    Slivers are in no place of the last kind, so that there only other zones count.
    """
    (place, count), (few, n_few) = (_places(len(mass), size) for size in (PLACE, FEW))
    sliver = _thinness(mesh) < THIN
    limits = ((mesh.zone_group, len(mesh.groups), 1.0), (place, count, IN_ONE_PLACE))
    return (
        *((part, np.bincount(part, mass, count), most) for part, count, most in limits),
        (np.where(sliver, n_few, few), np.append(np.bincount(few, mass), np.inf), FINE),
    )


def _places(n_zones, size):
    """Return the place (n_zones,) of each zone, and how many of a size there are."""
    count = max(1, n_zones // size)
    return np.minimum(np.arange(n_zones) // size, count - 1), count


def _thinness(mesh):
    """Return the smallest altitude of each zone over its longest edge, (n_zones,)."""
    found = np.empty(len(mesh.zones))
    for start in range(0, len(found), TOGETHER):
        zones = mesh.zones[start : start + TOGETHER]
        gradient = shape_gradients(mesh.points, zones)
        every = np.concatenate([-gradient.sum(axis=1, keepdims=True), gradient], axis=1)
        altitude = 1.0 / np.linalg.norm(every, axis=2).max(axis=1)
        longest = tetrahedra.edge_lengths(mesh.points, zones).max(axis=1)
        found[start : start + TOGETHER] = altitude / longest
    return found


def _shares(part, added, own):
    """Return added over own mass of each part; ``part`` has one for each zone."""
    return np.bincount(part, added, len(own)) / np.maximum(own, np.finfo(float).tiny)


def contact_bounds(model: Model) -> np.ndarray:
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
