"""The matrices of a family of models seen through a basis, apart for everything that varies."""

import numpy as np

from pyblast.mesh.tetrahedra import volumes
from pyblast.solver.perturbation import SHEAR, strain_matrix

CHUNK = 2048  # zones whose strains are formed at once


def seen(model, constants, left, right):
    """Return the matrices of a family between two bases, theory.md (10.3).

    Parameters
    ----------
    model : Model
    constants : dict
        Of it prepared.
    left, right : (3 n_nodes, n_left), (3 n_nodes, n_right) float64
        Motions; ``right`` are the first of ``left``.

    Returns
    -------
    dict of tuple to (n_left, n_right) float64
        ``("mass",)``, ``("dashpots",)``, ``("rim",)``; by group ``("drag", name)`` for a mass
        damping of 1/s, ``("p", name)`` and ``("s", name)`` for both moduli of the relaxed ground;
        by joint ``("kn", name)`` and ``("ks", name)`` for 1 Pa/m.
    """
    mesh, mass = model.mesh, constants["node_mass"]
    found = {("mass",): _weighted(left, right, mass)}
    node, impedance = constants["dashpot_node"], constants["dashpot_impedance"]
    at, to = (each.reshape(len(mass), 3, -1)[node] for each in (left, right))
    pushed = np.einsum("nij,njr->nir", impedance, to)
    found["dashpots",] = at.reshape(-1, left.shape[1]).T @ pushed.reshape(-1, right.shape[1])
    heavy = model.zone_values("density") * volumes(mesh.points, mesh.zones)
    for number, group in enumerate(mesh.groups):
        here = np.where(mesh.zone_group == number, heavy, 0.0)
        found["drag", group] = _weighted(left, right, model.nodes.sums(here))
        zones = np.flatnonzero(mesh.zone_group == number)
        found["p", group], found["s", group] = _stiffness(model, zones, left, right)
    if model.rim is not None:
        centres = mesh.points[mesh.zones].mean(axis=1)
        drag = heavy * model.rim.alpha(centres, model.zone_values("cs"))
        found["rim",] = _weighted(left, right, model.nodes.sums(drag))
    if mesh.contacts is not None:
        found |= _joints(mesh.contacts, left, right)
    return found


def _weighted(left, right, weight):
    """Return the product of two bases weighted by a number for each node."""
    return left.T @ (np.repeat(weight, 3)[:, None] * right)


def _stiffness(model, zones, left, right):
    """Return what P and S moduli of some zones of a group add to the stiffness."""
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
        bulk, slide = volume * (lame + 2.0 * shear)[part], volume * shear[part]
        dilation = strain[:, :3].sum(axis=1)
        p += dilation.T @ (bulk[:, None] * dilation[:, : right.shape[1]])
        whole = (slide[:, None] * SHEAR)[..., None] * strain[:, :, : right.shape[1]]
        s += strain.reshape(-1, left.shape[1]).T @ whole.reshape(-1, right.shape[1])
        s -= 2.0 * dilation.T @ (slide[:, None] * dilation[:, : right.shape[1]])
    return p, s


def _joints(contacts, left, right):
    """Return what unit stiffness of each joint adds, along normals and in planes."""
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
