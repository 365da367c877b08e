"""Secondary sources: change of motion by what the ground of a bank lacks, to first order."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh import hexahedra
from ..model.source import Column
from .bank import Bank
from .greens import PointSource, history, unit_loads, unit_source

SAMPLES = 64  # of a history per period of the highest frequency
TOGETHER = 48  # zones at once, for the memory they need
STEEP = 0.9  # vertical part of a normal, above which a joint is nearly level
THIRD = 1.0 / 3.0  # of an edge, in reference coordinates
ONE = np.ones(1, np.float32)
DOUBLED = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5], np.float32)  # e : e of engineering strains
STRAINS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
ROCK = ("cp", "cs", "density")  # of the changes by rock


@dataclass(frozen=True, eq=False)
class SecondarySources:
    """Secondary sources: cells of rock or patches of a joint, and the change of motion by each.

    Parameters
    ----------
    centres : (n, 3) float64, m
    sizes : (n,) float64, m3 or m2
    spectra : (n, n_kinds, n_shots, n_forces, n_frequencies) complex64, m/s times s
        Change by one unit of the logarithm of each property, see `Bank.by_receiver`.
    names : tuple of n str
        Surface of the joint of each patch; empty for rock.
    """

    centres: np.ndarray
    sizes: np.ndarray
    spectra: np.ndarray
    names: tuple[str, ...] = ()


def by_rock(bank: Bank) -> SecondarySources:
    """Return the changes of motion by wave speeds and density of the rock, cell by cell.

    Cells are thirds of the edges of the zones of a bank. Properties are those of `ROCK`: logarithms
    of cp and of cs at one density, and of the density at one stiffness; theory.md (9.11).
    """
    model, shares = bank.model, _parts(bank.model.mesh.order)
    density, cp, cs = (model.zone_values(name)[bank.zones] for name in ("density", "cp", "cs"))
    stretch, shear = density * cp**2, density * cs**2
    weights = model.nodes.volumes[bank.zones][:, None] * shares
    places = model.nodes.points[model.nodes.zone_nodes[bank.zones]]
    sizes = weights.sum(axis=-1)
    centres = np.einsum("zoq,zqi->zoi", weights, places) / sizes[..., None]
    counts = len(bank.zones), len(shares), len(ROCK), len(bank.shots), len(bank.forces)
    spectra = np.zeros((*counts, len(bank.transform.s)), np.complex64)
    for own, k, (dilation, strain, motion) in _products(bank, weights):
        each = [values[own, None, None, None] for values in (stretch, shear, density)]
        changes = (
            2.0 * each[0] * dilation, each[1] * (4.0 * strain - 4.0 * dilation),
            bank.transform.s[k] ** 2 * each[2] * motion,
        )  # fmt: skip
        for n, change in enumerate(changes):
            spectra[own, :, n, :, :, k] = -change.swapaxes(2, 3)
    flat = spectra.reshape(-1, *spectra.shape[2:])
    return SecondarySources(centres.reshape(-1, 3), sizes.ravel(), flat)


def _parts(order):
    """Return which of the nodes of a zone lie in each of its parts, (n_parts, (order + 1)^3)."""
    points, _ = hexahedra.lobatto(order)
    thirds = np.array([points < -THIRD, np.abs(points) <= THIRD, points > THIRD], float)
    own = thirds[thirds.any(axis=1)]
    n = len(own) ** 3
    return np.einsum("ck,bj,ai->cbakji", own, own, own).reshape(n, -1)


def _products(bank, weights) -> Iterator[tuple[slice, int, tuple]]:
    """Yield zones, frequency, and the products of the fields of forces and shots in each part.

    Of dilations, of strains and of motions, each (n_zones, n_parts, n_forces, n_shots).
    """
    nodes, n_forces = bank.model.nodes, len(bank.forces)
    for first in range(0, len(bank.zones), TOGETHER):
        own = slice(first, first + TOGETHER)
        zones = bank.zones[own]
        rows = bank.row[nodes.zone_nodes[zones]]
        inverse = np.linalg.inv(nodes.jacobian[zones]).astype(np.float32)
        for k in range(len(bank.transform.s)):
            field = np.concatenate([bank.forces[:, k], bank.shots[:, k]])[:, rows]
            strain = _strains(field, inverse, bank.model.mesh.order)
            dilation = strain[..., :3].sum(axis=-1, keepdims=True)
            yield (
                own,
                k,
                tuple(
                    _in_parts(each[:n_forces], each[n_forces:] * scale, weights[own])
                    for each, scale in ((dilation, ONE), (strain, DOUBLED), (field, ONE))
                ),
            )


def _in_parts(forces, shots, weights):
    """Return the integrals (n_zones, n_parts, n_forces, n_shots) of products of two fields."""
    forces, shots = forces.swapaxes(0, 1), shots.swapaxes(0, 1)  # zones first
    (n_zones, n_forces), n_shots = forces.shape[:2], shots.shape[1]
    whole = np.empty((n_zones, weights.shape[1], n_forces, n_shots), np.complex64)
    for part in range(weights.shape[1]):
        used = np.flatnonzero(weights[0, part])
        weighted = shots[:, :, used] * weights[:, None, part, used, None].astype(np.float32)
        first = forces[:, :, used].reshape(n_zones, n_forces, -1)
        whole[:, part] = first @ weighted.reshape(n_zones, n_shots, -1).swapaxes(1, 2)
    return whole


def _strains(field, inverse, order):
    """Return engineering strains (n_runs, n_zones, n_nodes, 6) of fields (..., n_nodes, 3)."""
    n, line = order + 1, hexahedra.slopes_on_line(order).astype(np.float32)
    grid = field.reshape(*field.shape[:2], n, n, n, 3)
    slopes = [
        np.einsum("iq,xzkjqc->xzkjic", line, grid, optimize=True),
        np.einsum("jq,xzkqic->xzkjic", line, grid, optimize=True),
        np.einsum("kq,xzqjic->xzkjic", line, grid, optimize=True),
    ]
    by_reference = np.stack(slopes, axis=-1).reshape(*field.shape, 3)
    slope = by_reference @ inverse
    return np.stack(
        [slope[..., i, j] if i == j else slope[..., i, j] + slope[..., j, i] for i, j in STRAINS],
        axis=-1,
    )


def by_joint(bank: Bank, size: float) -> SecondarySources:
    """Return the changes of motion by the springs of all joints, patch by patch.

    By the logarithms of their normal and of their shear stiffness; theory.md (9.10).

    Parameters
    ----------
    bank : Bank
    size : float, m
        Of the patches.
    """
    contacts, n = bank.model.nodes.contacts, len(bank.transform.s)
    counts = len(bank.shots), len(bank.forces), n
    centres, sizes, names, spectra = [], [], [], []
    for number, joint in enumerate(bank.model.numbered_joints):
        if not {"kn", "ks"} <= joint.properties.keys():
            continue
        held = (bank.row[contacts.minus] >= 0) & (bank.row[contacts.plus] >= 0)
        own = np.flatnonzero((contacts.joint == number) & held)
        places, normals = bank.model.nodes.points[contacts.minus], contacts.normal
        for patch in _patches(own, places, normals, size):
            area = contacts.area[patch]
            opened, slid = _jumps(bank, patch)
            spectra.append([-joint.properties["kn"] * opened, -joint.properties["ks"] * slid])
            centres.append(np.average(places[patch], axis=0, weights=area))
            sizes.append(area.sum())
            names.append(joint.surface)
    return SecondarySources(
        np.reshape(centres, (-1, 3)), np.array(sizes),
        np.reshape(spectra, (-1, 2, *counts)).astype(np.complex64), tuple(names),
    )  # fmt: skip


def _jumps(bank, patch):
    """Return the integrals (n_shots, n_forces, n_frequencies) of products of the jumps of fields.

    Of those along the normal of contacts, and of those beside it.
    """
    contacts = bank.model.nodes.contacts
    plus, minus = bank.row[contacts.plus[patch]], bank.row[contacts.minus[patch]]
    normal = contacts.normal[patch].astype(np.float32)
    area = contacts.area[patch].astype(np.float32)
    forces, shots = (each[:, :, plus] - each[:, :, minus] for each in (bank.forces, bank.shots))
    opened = [np.einsum("xkci,ci->xkc", jump, normal) for jump in (forces, shots)]
    along = np.einsum("pkc,bkc->bpk", opened[0], opened[1] * area)
    whole = np.einsum("pkci,bkci->bpk", forces, shots * area[:, None], optimize=True)
    return along, whole - along


def _patches(own, places, normals, size):
    """Return the contacts of each patch of a joint, of about a size in m along both its axes."""
    if not len(own):
        return []
    middle = normals[own].mean(axis=0)
    along = np.cross([0.0, 0.0, 1.0] if abs(middle[2]) < STEEP else [1.0, 0.0, 0.0], middle)
    axes = np.array([along, np.cross(middle, along)])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    _, number = np.unique(np.floor(places[own] @ axes.T / size), axis=0, return_inverse=True)
    return [own[number.ravel() == n] for n in range(number.max() + 1)]


def by_hole(bank: Bank, source: PointSource) -> np.ndarray:
    """Return the spectra (n_forces, n_frequencies) of the velocity by a hole at any place.

    Exact, by reciprocity: the fields of the receivers at its loads; theory.md (9.3), (9.9).

    Raises
    ------
    InputError
        If it is a column.
    """
    if isinstance(source, Column):
        raise InputError("bank: points of a column fire one after another; give holes")
    transform, spectra = bank.transform, np.zeros(1)
    dt = 1.0 / (SAMPLES * transform.frequencies[-1])
    times = dt * np.arange(int(transform.duration / dt) + 1)
    for width, load in unit_loads(bank.model, unit_source(source), 2, dt):
        rate = np.diff(history(source, times, width)) / dt
        drive = transform.kernel(times[:-1] + 0.5 * dt, dt) @ rate
        field = bank.forces[:, :, bank.row[load["load_node"]]]
        along = np.einsum("pkai,ai->pk", field, load["load_vector"])
        spectra = spectra + along * drive
    return spectra
