"""In-situ stress, and the static stage that brings it into equilibrium."""

from typing import Any

import numpy as np
import scipy

from ..core import JOINT_LAWS, ZONE_LAWS
from ..errors import InputError
from ..laws import of_laws
from ..mesh.mesh import zone_volumes
from ..mesh.spectral_nodes import SpectralNodes
from ..mesh.tetrahedra import shape_gradients
from ..model.joint import carried_over
from ..model.model import InSitu, Model
from .assembly import initial_pressures, initial_state, stiffness_arrays, zone_product
from .hexahedra import without_layer
from .loads import static_conditions
from .time_step import contact_bounds, largest_eigenvalue, model_frequencies, with_joints

BINS = 200
TENSOR = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def overburden_stress(model: Model, places: np.ndarray | None = None) -> np.ndarray:
    """Return the overburden stress (n_zones, 6) in Pa; xx yy zz yz zx xy.

    Parameters
    ----------
    model : Model
    places : (n, 3) float64, m, optional
        Default: centres of the zones.

    Notes
    -----
    Weight of the mean density at each level, up to the surface "top" above the place. The static
    stage removes the remaining imbalance.
    """
    mesh, insitu = model.mesh, _insitu(model)
    centres = mesh.points[mesh.zones].mean(axis=1)
    at = centres if places is None else places
    volume = zone_volumes(mesh)
    low, high = mesh.points[:, 2].min(), mesh.points[:, 2].max()
    levels = np.linspace(low, high, BINS + 1)
    weight = np.histogram(centres[:, 2], levels, weights=volume * model.zone_values("density"))[0]
    space = np.histogram(centres[:, 2], levels, weights=volume)[0]
    filled = space > 0.0
    density = np.interp(np.arange(BINS), np.flatnonzero(filled), (weight[filled] / space[filled]))
    column = np.append(0.0, np.cumsum(density * np.diff(levels)))
    top = np.full(len(at), high)
    if "top" in mesh.surfaces:
        surface = mesh.points[np.unique(mesh.surfaces["top"])]
        top = surface[scipy.spatial.KDTree(surface[:, :2], leafsize=16).query(at[:, :2])[1], 2]
    above = np.interp(top, levels, column) - np.interp(at[:, 2], levels, column)
    vertical = -insitu.gravity * np.maximum(above, 0.0)
    stress = np.zeros((len(at), 6))
    stress[:, :2] = insitu.horizontal_ratio * vertical[:, None]
    stress[:, 2] = vertical
    return stress


def _insitu(model) -> InSitu:
    """Return the in-situ stress of a model; raise InputError if it has none."""
    if model.insitu is None:
        raise InputError("model.insitu: missing; give the stress before the blast")
    return model.insitu


def insitu_stress(model: Model, places: np.ndarray | None = None) -> np.ndarray:
    """Return the in-situ stress (n_zones, 6) in Pa: overburden and uniform part.

    At the centres of the zones, or at places (n, 3) in m.
    """
    return overburden_stress(model, places) + np.asarray(_insitu(model).stress, dtype=float)


def corner_forces(model: Model) -> np.ndarray:
    """Return the nodal forces (n_zones, n, 3) in N of the in-situ stress in zones; theory.md (2.3).

    The stress is that at the centre of a zone; in quadratic zones it is linear between corners.
    """
    nodes, mesh = model.nodes, model.mesh
    if isinstance(nodes, SpectralNodes):
        stress = insitu_stress(model, nodes.points)[nodes.zone_nodes]
        return nodes.stress_forces(stress[:, :, TENSOR])
    volume = zone_volumes(mesh)
    zones = np.arange(len(volume))
    if model.quadratic:
        at = insitu_stress(model, mesh.points)[mesh.zones]
        pairs = zip(np.moveaxis(at, 1, 0), nodes.corner_slopes(zones), strict=True)
    else:
        pairs = [(insitu_stress(model), nodes.mean_slopes(zones))]
    force = sum(np.einsum("zij,zkj->zki", s[:, TENSOR], slopes) for s, slopes in pairs)
    return -volume[:, None, None] * np.asarray(force)


def joint_tractions(model: Model) -> np.ndarray:
    """Return the in-situ traction (n_contacts, 3) in Pa of each contact.

    From the mean stress around it; with quadratic zones from the stress at its position.
    """
    nodes, contacts = model.nodes, model.nodes.contacts
    if contacts is None:
        return np.zeros((0, 3))
    if nodes.quadratic:
        at = insitu_stress(model, nodes.points[contacts.minus])
        return np.einsum("cij,cj->ci", at[:, TENSOR], contacts.normal)
    stress = insitu_stress(model)
    volume = zone_volumes(nodes.mesh)
    mean = np.stack([nodes.sums(volume * stress[:, k]) for k in range(6)], axis=1)
    both = mean[contacts.minus] + mean[contacts.plus]
    space = nodes.sums(volume)
    both /= (space[contacts.minus] + space[contacts.plus])[:, None]
    return np.einsum("cij,cj->ci", both[:, TENSOR], contacts.normal)


def effective_tractions(model: Model, traction: np.ndarray) -> np.ndarray:
    """Return tractions (n_contacts, 3) in Pa less the pressure of the water in the joints."""
    contacts = model.nodes.contacts
    if contacts is None or _insitu(model).water_table is None:
        return traction
    pressure = _insitu(model).pore_pressure(model.nodes.points[contacts.minus, 2])
    return traction + pressure[:, None] * contacts.normal


def effective_stress(model: Model) -> np.ndarray:
    """Return the in-situ stress (n_zones, 6) in Pa less the pressure of the water in the pores."""
    mesh = model.mesh
    pressure = _insitu(model).pore_pressure(mesh.points[mesh.zones, 2].mean(axis=1))
    return insitu_stress(model) + pressure[:, None] * [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


def joint_pressures(model: Model) -> dict[str, float]:
    """Return the mean effective in-situ normal pressure in Pa of each joint, by surface."""
    pressures = {joint.surface: joint.insitu_pressure for joint in model.joints}
    contacts = model.nodes.contacts
    alike = model.insitu is None and not any(joint.insitu_gradient for joint in model.joints)
    if alike or contacts is None:
        return pressures
    if model.insitu is None:
        normal = initial_pressures(model)
    else:
        traction = effective_tractions(model, joint_tractions(model))
        normal = -np.einsum("ci,ci->c", traction, contacts.normal)
    area = np.bincount(contacts.joint, contacts.area, len(contacts.names))
    mean = np.bincount(contacts.joint, contacts.area * normal, len(contacts.names)) / area
    return dict(zip(contacts.names, map(float, mean), strict=True))


def static_loads(model: Model, geometry: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Return nodal loads, joint tractions and the force scale of the static stage.

    Returns
    -------
    node_load : (n_nodes, 3) float64, N
    contact_initial : (n_contacts, 3) float64, Pa, effective
    scale : float, N
        Sum of the corner forces of the in-situ stress.
    """
    nodes = model.nodes
    corner = corner_forces(model)
    load = np.zeros_like(nodes.points)
    np.add.at(load, nodes.zone_nodes, corner)
    mass = model.zone_values("density") * zone_volumes(model.mesh)
    load[:, 2] -= _insitu(model).gravity * nodes.sums(mass)
    traction = geometry["contact_initial"]
    if nodes.contacts is not None and nodes.contacts.names:
        traction = joint_tractions(model)
        force = nodes.contacts.area[:, None] * traction
        np.add.at(load, nodes.contacts.minus, force)
        np.add.at(load, nodes.contacts.plus, -force)
        traction = effective_tractions(model, traction)
    return load, traction, float(np.linalg.norm(corner, axis=2).sum())


GAP = 5  # column of contact_state of every law that opens, m
LOCAL_DAMPING = 0.8
# Local damping reduces the critical step of elastic zones by 1/sqrt(1.8), but that of stiffness
# damping by 1/1.8: the static stage has no stiffness damping.
STATIC_STEP_FACTOR = 0.7


def _pace(model, dt):
    """Return the step of the static stage, and masses of nodes that let all settle at one pace.

    Each node of tetrahedra has the mass that the step just allows: theory.md (4.19).
    """
    if model.mesh.hexahedral:
        return {"dt": dt * min(1.0, STATIC_STEP_FACTOR / model.step_factor)}
    nodes = model.nodes
    own = model.zone_values("density") * zone_volumes(model.mesh) * model_frequencies(model)
    mass = nodes.sums(own) + 2.0 * contact_bounds(model)[0]
    if model.quadratic:  # their frequencies are estimates
        product = with_joints(model, zone_product(model, mass), mass)
        mass *= largest_eigenvalue(product, mass)
    return {"dt": dt, "node_mass": mass * (0.5 * dt / STATIC_STEP_FACTOR) ** 2}


def static_arrays(model: Model, geometry: dict[str, Any]) -> tuple[dict[str, Any], float]:
    """Return loads, in-situ stress and supports of the static stage, and the force scale."""
    node_load, contact_initial, scale = static_loads(model, geometry)
    joint_law = geometry["joint_law"]
    flows = of_laws(JOINT_LAWS, joint_law, "flows")  # would never reach equilibrium
    arrays = {
        **_pace(model, geometry["dt"]),
        "set_beta": np.zeros_like(geometry["set_beta"]),
        "set_branch": np.zeros_like(geometry["set_branch"]),
        "memory_rate": np.zeros_like(geometry["memory_rate"]),
        "joint_law": np.where(flows, JOINT_LAWS["elastic"].number, joint_law).astype("i4"),
        "node_alpha": np.zeros_like(geometry["node_alpha"]),
        "local_damping": LOCAL_DAMPING,
        "node_load": node_load,
        "contact_initial": contact_initial,
        **static_conditions(model, geometry),
        "receiver_node": np.zeros((0, model.nodes.zone_nodes.shape[1]), dtype=np.int32),
        "receiver_weight": np.zeros((0, model.nodes.zone_nodes.shape[1])),
    }
    if model.mesh.hexahedral:
        return {**arrays, **without_layer(geometry)}, scale
    moduli = {
        "zone_lambda": model.zone_values("first_lame"),
        "zone_shear": model.zone_values("shear"),
    }
    arrays["row_initial"] = stressed_rows(geometry, effective_stress(model))
    if all(np.array_equal(geometry[name], value) for name, value in moduli.items()):
        return arrays, scale  # with the springs that the dynamic stage has
    arrays |= moduli
    return {**arrays, **stiffness_arrays(model.tetrahedral, {**geometry, **arrays})}, scale


STRAIN, HARDENING = slice(6, 12), slice(12, 14)  # columns of row_state of plastic zones


def can_yield(constants: dict[str, Any]) -> np.ndarray:
    """Return whether the law of each zone is plastic, (n_zones,) bool."""
    yields = of_laws(ZONE_LAWS, constants["set_law"], "yields")
    return np.repeat(yields[constants["domain_set"]], np.diff(constants["domain_zone_start"]))


def stressed_rows(constants: dict[str, Any], stress: np.ndarray) -> np.ndarray:
    """Return ``row_initial`` with the stress (n_zones, 6) of plastic zones."""
    yields = can_yield(constants)
    initial = constants["row_initial"].copy()
    initial[constants["zone_row"][yields]] = stress[yields]
    return initial


def settled_rows(
    constants: dict[str, Any], static: dict[str, Any], settled: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``row_initial`` and ``row_state`` after the static stage.

    Plastic zones start from the static stress, with zero strain but with their hardening.
    """
    yields = can_yield(constants)
    rows = constants["zone_row"][yields]
    initial, memory = constants["row_initial"].copy(), np.zeros_like(settled["row_state"])
    initial[rows] = static["row_initial"][rows] + excess_stress(static, settled)[yields]
    memory[rows, HARDENING] = settled["row_state"][rows, HARDENING]
    return initial, memory


def yield_states(
    constants: dict[str, Any], state: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stress and plastic strain of the plastic zones.

    Parameters
    ----------
    constants : dict
        Of a `Prepared`.
    state : dict
        Of a `Run` or `Prepared`.

    Returns
    -------
    zone : (n,) int64
    stress : (n, 6) float64, Pa
        Stress by the law of the zone, before averaging over patches; theory.md (2.32). Under a
        water table it is the effective stress.
    plastic : (n, 2) float64
        Accumulated plastic shear and tensile strain.
    """
    zone = np.flatnonzero(can_yield(constants))
    row = constants["zone_row"][zone]
    memory = state["row_state"][row]
    stress = constants["row_initial"][row] + excess_stress(constants, state)[zone]
    return zone, stress, memory[:, HARDENING]


def excess_stress(constants: dict[str, Any], state: dict[str, Any]) -> np.ndarray:
    """Return the stress increment over the initial stress, at the last force evaluation.

    Parameters
    ----------
    constants, state : dict
        Of a run.

    Returns
    -------
    (n_zones, 6) float64, Pa
        By Hooke's law, mean strains of patches and plastic strains; theory.md (2.32).
    """
    motion = state["displacement"] - constants["dt"] * state["velocity"]
    domain = np.repeat(
        np.arange(len(constants["domain_set"])), np.diff(constants["domain_zone_start"])
    )
    slot = constants["zone_slot"].T[:, :4] + constants["domain_slot_start"][domain][:, None]
    corners = motion[constants["slot_node"][slot]]
    slope = np.einsum(
        "zki,zkj->zij",
        corners[:, 1:] - corners[:, :1],
        shape_gradients(constants["slot_place"], slot),
    )
    strain = (slope + slope.transpose(0, 2, 1))[:, (0, 1, 2, 1, 2, 0), (0, 1, 2, 2, 0, 1)]
    strain[:, :3] *= 0.5
    patch, shared = constants["zone_patch"], constants["zone_patch"] >= 0
    mean = _dilations(constants, motion)[(patch + constants["domain_patch_start"][domain])[shared]]
    strain[shared, :3] += ((mean - strain[shared, :3].sum(axis=1)) / 3.0)[:, None]
    yields = can_yield(constants)
    strain[yields] -= state["row_state"][constants["zone_row"][yields], STRAIN]
    stress = constants["zone_shear"][:, None] * strain * ([2.0] * 3 + [1.0] * 3)
    stress[:, :3] += (constants["zone_lambda"] * strain[:, :3].sum(axis=1))[:, None]
    return stress


def _dilations(constants, motion):
    """Return the dilation of patches (n_patches,) for nodal displacements (n_nodes, 3)."""
    starts = constants["domain_patch_start"]
    patch = np.repeat(np.arange(starts[-1]), np.diff(constants["patch_start"])[: starts[-1]])
    domain = np.searchsorted(starts, patch, side="right") - 1
    slot = constants["patch_slot"] + constants["domain_slot_start"][domain]
    parts = (constants["patch_gradient"] * motion[constants["slot_node"][slot]]).sum(axis=1)
    return np.bincount(patch, parts, minlength=starts[-1])


def after_static(
    constants: dict[str, Any], static: dict[str, Any], settled: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Return constants and state of the dynamic stage after the static stage.

    An open contact keeps its gap: its initial traction is the tension of a spring ``kn`` stretched
    by the gap, balanced by a constant load. Plastic zones start from the static stress, with zero
    strain but with their hardening.

    Parameters
    ----------
    constants : dict
        Of the dynamic stage.
    static, settled : dict
        Constants and final state of the static stage.

    Returns
    -------
    constants, state : dict
    """
    normal, area = static["contact_normal"], static["contact_area"]
    minus, plus = static["contact_node"].T
    kn = static["joint_property"][static["contact_joint"], 0]
    law = constants["joint_law"][static["contact_joint"]]
    opens = of_laws(JOINT_LAWS, law, "opens")
    virtual = (opens * kn * settled["contact_state"][:, GAP])[:, None] * normal
    initial = settled["contact_traction"] + virtual
    load = np.zeros_like(settled["displacement"])
    np.add.at(load, minus, area[:, None] * virtual)
    np.add.at(load, plus, -area[:, None] * virtual)
    stress, memory = constants["row_initial"], np.zeros_like(settled["row_state"])
    if can_yield(constants).any():
        stress, memory = settled_rows(constants, static, settled)
    initial_values = {"contact_initial": initial, "node_load": load, "row_initial": stress}
    constants = {**constants, **initial_values}
    contact_state = carried_over(law, settled["contact_state"])
    state = initial_state(constants, contact_state)
    state["contact_traction"] = settled["contact_traction"].copy()
    state["row_state"] = memory
    return constants, state
