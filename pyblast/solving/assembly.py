"""From a model to the arrays that the kernels take; every name is that of a kernel argument."""

import numpy as np

from ..meshing import tetrahedra
from ..meshing.mesh import locate
from .conditions import dynamic_conditions, static_conditions, surface_impedance
from .domains import domain_arrays
from .edges import edge_arrays
from .insitu import insitu_stress, static_loads
from .joints import carried_over
from .kernels import (
    JOINT_LAWS,
    N_JOINT_PROPERTIES,
    N_JOINT_STATE,
    N_SUMS,
    N_ZONE_PROPERTIES,
    N_ZONE_STATE,
    ZONE_LAWS,
    property_row,
    stored_at_rest,
)
from .loads import Loads, model_loads
from .patch_tables import patch_arrays
from .stability import critical_step
from .yielding import settled_rows, stressed_rows

GAP = 5  # column of contact_state of every law that opens, m
LOCAL_DAMPING = 0.8
# Local damping raises the force that slows a node by 1.8, which shortens an elastic step by
# 1/sqrt(1.8), but a step ruled by stiffness damping by 1/1.8: that damping is left out.
STATIC_STEP_FACTOR = 0.7


def time_step(model):
    """Return the time step of a model in s, and the `CriticalStep` behind it."""
    limit = critical_step(model)
    return model.step_factor * limit.dt * _damped_share(model), limit


def geometry_arrays(model, step=None):
    """Return what all stages share, and the `CriticalStep` behind its time step.

    ``step`` is what `time_step` gave, or the same with a shorter time step.
    """
    mesh, nodes = model.mesh, model.nodes
    dt, limit = step or time_step(model)
    volume = tetrahedra.volumes(mesh.points, mesh.zones)
    mass = model.zone_values("density") * volume
    node_mass = nodes.sums(mass + limit.added_mass)
    node_mass += _fill_mass(model)
    drag = nodes.sums(model.zone_damping("alpha") * mass)
    contacts = _contacts(model)
    patch = model.patches() if model.yielding().any() else np.full(len(mesh.zones), -1)
    arrays = {
        "dt": dt,
        **domain_arrays(nodes, patch, contacts["contact_node"]),
        **dict(zip(("zone_lambda", "zone_shear"), model.zone_moduli(), strict=True)),
        **zone_laws(model),
        "node_mass": node_mass,
        "node_alpha": drag / node_mass,
        **contacts,
    }
    return {**arrays, **edge_arrays(nodes, arrays), **patch_arrays(nodes, arrays)}, limit


def _damped_share(model):
    """Return what local damping, which raises the force that slows a node, leaves of a step."""
    raised = 1.0 + model.local_damping
    return 1.0 / (raised if model.group_damping("beta").any() else np.sqrt(raised))


def zone_laws(model):
    """Return the laws and the damping of the sets of zones, one a group, and rows of memory."""
    materials = [model.materials[group] for group in model.mesh.groups]
    given = [model.law(group) for group in model.mesh.groups]
    laws = [ZONE_LAWS[law.name] for law in given]
    rows = [
        property_row(law, one.properties(material), N_ZONE_PROPERTIES)
        for law, one, material in zip(laws, given, materials, strict=True)
    ]
    remembers = np.array([bool(law.state) for law in laws])[model.mesh.zone_group]
    row = np.where(remembers, np.cumsum(remembers) - 1, -1).astype(np.int32)
    return {
        "zone_row": row,
        "set_law": np.array([law.number for law in laws], dtype=np.int32),
        "set_property": np.array(rows),
        "set_beta": model.group_damping("beta"),
        **_branches([model.branches(group) for group in model.mesh.groups]),
        "row_initial": np.zeros((max(1, int(remembers.sum())), 6)),
    }


def _branches(by_set):
    """Return the distinct rates of what relaxes, and the stiffness of each set at each of them."""
    rates = sorted({one.rate for branches in by_set for one in branches})
    table = np.zeros((len(by_set), max(1, len(rates)), 2))
    for number, branches in enumerate(by_set):
        for one in branches:
            table[number, rates.index(one.rate)] += one.shear, one.compression
    return {"set_branch": table, "memory_rate": np.array(rates or [0.0])}


def _contacts(model):
    """Contacts with the laws and properties of their joints."""
    contacts = model.nodes.contacts
    by_name = {joint.surface: joint for joint in model.joints}
    joints = [by_name[name] for name in contacts.names] if contacts is not None else []
    if not joints:
        return _no_contact()
    laws = [JOINT_LAWS[joint.law] for joint in joints]
    table = [
        property_row(law, joint.properties, N_JOINT_PROPERTIES)
        for law, joint in zip(laws, joints, strict=True)
    ]
    pressure = np.array([joint.insitu_pressure for joint in joints])[contacts.joint]
    shear = np.array([joint.insitu_shear for joint in joints])[contacts.joint]
    shear -= np.einsum("ci,ci->c", shear, contacts.normal)[:, None] * contacts.normal
    return {
        "joint_law": np.array([law.number for law in laws], dtype=np.int32),
        "joint_property": np.array(table),
        "contact_node": np.stack([contacts.minus, contacts.plus], axis=1).astype(np.int32),
        "contact_normal": contacts.normal,
        "contact_area": contacts.area,
        "contact_joint": contacts.joint.astype(np.int32),
        "contact_initial": shear - pressure[:, None] * contacts.normal,
    }


def _fill_mass(model):
    """Return the mass of fills on the nodes of their contacts, (n_nodes,) kg."""
    total = np.zeros(len(model.nodes.points))
    contacts = model.nodes.contacts
    by_name = {joint.surface: joint.fill_mass for joint in model.joints}
    if contacts is None or not any(by_name.values()):
        return total
    mass = 0.5 * contacts.area * np.array([by_name[n] for n in contacts.names])[contacts.joint]
    for side in (contacts.minus, contacts.plus):
        total += np.bincount(side, mass, minlength=len(total))
    return total


def _no_contact():
    """One contact of no area, of a node with itself: the core takes no empty tables."""
    return {
        "joint_law": np.zeros(1, dtype=np.int32),
        "joint_property": np.ones((1, N_JOINT_PROPERTIES)),
        "contact_node": np.zeros((1, 2), dtype=np.int32),
        "contact_normal": np.array([[1.0, 0.0, 0.0]]),
        "contact_area": np.zeros(1),
        "contact_joint": np.zeros(1, dtype=np.int32),
        "contact_initial": np.zeros((1, 3)),
    }


def dynamic_arrays(model, geometry, n_steps, sides=()):
    """Return loads, dashpots, prescribed motion and receivers of the dynamic stage.

    ``sides`` holds (nodes, forces, TimeFunction) of free-field sides.
    """
    loads = model_loads(model, lambda surface: surface_impedance(model, surface))
    for nodes, forces, history in sides:
        loads.add(nodes, forces, loads.add_history(history))
    conditions = dynamic_conditions(model, geometry, loads)
    nodes = model.nodes
    none = np.zeros((0, nodes.zone_nodes.shape[1]))
    node, weight = none.astype(np.int32), none
    if model.receivers:
        zone, weight = locate(model.mesh, [receiver.position for receiver in model.receivers])
        node, weight = nodes.zone_nodes[zone], nodes.shapes(weight)
    return {
        "local_damping": model.local_damping,
        "node_load": np.zeros_like(nodes.points),
        **conditions,
        **loads.arrays(geometry["dt"] * np.arange(n_steps)),
        "receiver_node": node,
        "receiver_weight": weight,
    }


def static_arrays(model, geometry):
    """Return weight, in-situ stress and rollers of the static stage, and the scale of forces."""
    node_load, contact_initial, scale = static_loads(model, geometry)
    joint_law = geometry["joint_law"]
    flows = joint_law == JOINT_LAWS["maxwell"].number  # it would never come to rest
    moduli = (model.zone_values("first_lame"), model.zone_values("shear"))
    arrays = {
        "dt": geometry["dt"] * min(1.0, STATIC_STEP_FACTOR / model.step_factor),
        "set_beta": np.zeros_like(geometry["set_beta"]),
        "set_branch": np.zeros_like(geometry["set_branch"]),
        "memory_rate": np.zeros_like(geometry["memory_rate"]),
        **dict(zip(("zone_lambda", "zone_shear"), moduli, strict=True)),
        "row_initial": stressed_rows(geometry, insitu_stress(model)),
        "joint_law": np.where(flows, JOINT_LAWS["elastic"].number, joint_law).astype("i4"),
        "node_alpha": np.zeros_like(geometry["node_alpha"]),
        "local_damping": LOCAL_DAMPING,
        "node_load": node_load,
        "contact_initial": contact_initial,
        **static_conditions(model, geometry),
        "receiver_node": np.zeros((0, model.nodes.zone_nodes.shape[1]), dtype=np.int32),
        "receiver_weight": np.zeros((0, model.nodes.zone_nodes.shape[1])),
    }
    both = {**geometry, **arrays}
    return {**arrays, **edge_arrays(model.nodes, both), **patch_arrays(model.nodes, both)}, scale


def still_loads(n_steps):
    """Return the arrays of no load at all over ``n_steps``."""
    return Loads().arrays(np.zeros(n_steps))


def initial_state(constants, contact_state=None):
    """Return the state at rest: no displacement, tractions and stresses at their initial values."""
    n_nodes, n_contacts = len(constants["node_mass"]), len(constants["contact_area"])
    n_rows = len(constants["row_initial"])
    if contact_state is None:
        contact_state = np.zeros((n_contacts, N_JOINT_STATE))
    return {
        "displacement": np.zeros((n_nodes, 3)),
        "velocity": np.zeros((n_nodes, 3)),
        "memory": np.zeros((n_nodes, len(constants["memory_rate"]), 3)),
        "row_state": np.zeros((n_rows, N_ZONE_STATE)),
        "row_lost": np.zeros(n_rows),
        "contact_traction": constants["contact_initial"].copy(),
        "contact_state": contact_state,
        "contact_stored": stored_at_rest(constants, contact_state),
        "contact_dissipated": np.zeros(n_contacts),
        "sums": np.zeros(N_SUMS),
    }


def after_static(constants, static, settled):
    """Start the dynamic stage from the tractions and joint states at the end of the static one.

    An open contact keeps its gap: its initial traction is the tension that a spring of its
    ``kn`` would have, balanced by a constant load, so it closes where it did before. A zone that
    can yield starts from its settled stress, strained no more but as hardened or softened as it is.

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
    opens = np.array(["gap" in one.state for one in JOINT_LAWS.values()])
    virtual = (opens[law] * kn * settled["contact_state"][:, GAP])[:, None] * normal
    initial = settled["contact_traction"] + virtual
    load = np.zeros_like(settled["displacement"])
    np.add.at(load, minus, area[:, None] * virtual)
    np.add.at(load, plus, -area[:, None] * virtual)
    stress, memory = settled_rows(constants, static, settled)
    begun = {"contact_initial": initial, "node_load": load, "row_initial": stress}
    constants = {**constants, **begun}
    contact_state = carried_over(law, settled["contact_state"])
    state = initial_state(constants, contact_state)
    state["contact_traction"] = settled["contact_traction"].copy()
    state["row_state"] = memory
    return constants, state
