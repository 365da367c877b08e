"""Assembly of a model into kernel arrays, named as the arguments of the kernels."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ..core import (
    JOINT_LAWS,
    N_JOINT_PROPERTIES,
    N_JOINT_STATE,
    N_SUMS,
    N_ZONE_PROPERTIES,
    N_ZONE_STATE,
    ZONE_LAWS,
    advance,
    property_row,
    stored_at_rest,
    to_fortran,
)
from ..mesh.mesh import locate_in_zones, zone_volumes
from ..mesh.nodes import MOST, Nodes, stored
from ..mesh.tetrahedra import shape_gradients
from ..mesh.tetrahedra import volumes as tetrahedron_volumes
from ..model.material import Elastic
from ..model.model import Model
from ..model.source import TimeFunction
from .edge_springs import edge_arrays
from .hexahedra import layer_arrays, no_layer, no_packs, pack_arrays, stiff_alone
from .implicit_zones import explicit_product, moved_nodes, no_implicit_zones
from .loads import (
    Loads,
    dynamic_conditions,
    joined_loads,
    model_loads,
    no_conditions,
    surface_impedance,
)
from .time_step import MOST as MOST_PRODUCTS
from .time_step import (
    CriticalStep,
    Product,
    assembled_step,
    critical_step,
    critical_step_of_hexahedra,
)

Step = tuple[float, CriticalStep]  # time step in s, and the limit behind it
DOMAIN_ZONES = 1024
QUADRATIC_ZONES = 512
MOST_SHARED = 100_000  # nodes of models that share arrays, so that these take little memory


def domain_arrays(
    nodes: Nodes, patch: np.ndarray, contact_node: np.ndarray
) -> dict[str, np.ndarray]:
    """Partition the zones into domains and assign slots to their nodes.

    Parameters
    ----------
    nodes : Nodes
        Of a mesh whose zones are ordered group by group.
    patch : (n_zones,) int64
        Patch of each zone, -1 for none.
    contact_node : (n_contacts, 2) int32

    Returns
    -------
    dict
        Kernel arrays of domains, slots, zones and of the contributions to nodal forces.
    """
    n_nodes, n_zones = len(nodes.points), len(nodes.zone_nodes)
    group, corners = nodes.mesh.zone_group, nodes.zone_nodes.shape[1]
    starts = _starts(group, patch, QUADRATIC_ZONES if nodes.quadratic else DOMAIN_ZONES)
    domain = np.searchsorted(starts, np.arange(n_zones), side="right") - 1
    keys = domain[:, None].astype(np.int64) * n_nodes + nodes.zone_nodes
    slots, of_zone = np.unique(keys, return_inverse=True)
    slot_start = np.searchsorted(slots, np.arange(len(starts)) * n_nodes)
    slot_node = slots % n_nodes
    origin = np.repeat(nodes.points[slot_node[slot_start[:-1]]], np.diff(slot_start), axis=0)
    part_node = np.concatenate([slot_node, contact_node.ravel()])
    order = np.argsort(part_node, kind="stable")
    return {
        "domain_zone_start": starts.astype(np.int32),
        "domain_slot_start": slot_start.astype(np.int32),
        "domain_set": group[starts[:-1]].astype(np.int32),
        "slot_node": slot_node.astype(np.int32),
        "slot_place": nodes.points[slot_node] - origin,
        "zone_slot": (of_zone.reshape(-1, corners) - slot_start[domain][:, None]).T.astype(
            np.int32
        ),
        "zone_patch": _numbers(patch, starts),
        "node_part": order.astype(np.int32),
        "node_start": np.searchsorted(part_node[order], np.arange(n_nodes + 1)).astype(np.int32),
    }


def _starts(group, patch, size):
    """Return the first zone of each domain: at changes of group, else near equal sizes."""
    ends = np.append(np.flatnonzero(np.diff(group)) + 1, len(group))
    cuts = []
    for low, high in pairwise(np.append(0, ends)):
        cuts.append(low)
        for cut in range(low + size, high, size):
            first = max(low, cut - MOST)
            within = np.count_nonzero(patch[first:cut] == patch[cut])
            cuts.append(cut - (within if patch[cut] >= 0 else 0))
    return np.append(cuts, len(group))


def _numbers(patch, starts):
    """Return the number of each patch within its domain, -1 for none."""
    numbers = np.full(len(patch), -1, dtype=np.int32)
    for low, high in pairwise(starts):
        members = low + np.flatnonzero(patch[low:high] >= 0)
        numbers[members] = np.unique(patch[members], return_inverse=True)[1]
    return numbers


def patch_arrays(nodes: Nodes, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the patches of averaged dilation with their nodes; theory.md (2.41).

    Parameters
    ----------
    nodes : Nodes
    arrays : dict
        Kernel arrays of domains and zones.

    Returns
    -------
    dict
        Kernel arrays: bulk modulus times volume in J of each patch; slot and derivative of the
        dilation in 1/m of each of its nodes.
    """
    starts = arrays["domain_zone_start"]
    zones = np.flatnonzero(arrays["zone_patch"] >= 0)
    domain = np.searchsorted(starts, zones, side="right") - 1
    _, first, patch = np.unique(
        domain * (len(arrays["zone_patch"]) + 1) + arrays["zone_patch"][zones],
        return_index=True, return_inverse=True,
    )  # fmt: skip
    count = max(1, len(first))
    corners = nodes.zone_nodes[zones][:, :4]
    volume = tetrahedron_volumes(nodes.points, corners)
    slot = arrays["zone_slot"].T[zones][:, :4]
    n_slots = np.int64(slot.max(initial=0) + 1)
    keys, end = np.unique(patch[:, None] * n_slots + slot, return_inverse=True)
    inner = shape_gradients(nodes.points, corners)
    area = volume[:, None, None] * np.concatenate(
        [-inner.sum(axis=1, keepdims=True), inner], axis=1
    )
    whole = np.bincount(patch, volume, minlength=count)
    sums = [
        np.bincount(end.ravel(), a.ravel(), minlength=len(keys)) for a in np.moveaxis(area, 2, 0)
    ]
    of = keys // n_slots
    bulk = arrays["zone_lambda"][zones] + 2.0 / 3.0 * arrays["zone_shear"][zones]
    return {
        "domain_patch_start": np.searchsorted(domain[first], np.arange(len(starts))).astype(
            np.int32
        ),
        "patch_start": np.searchsorted(of, np.arange(count + 1)).astype(np.int32),
        "patch_slot": (keys % n_slots).astype(np.int32),
        "patch_gradient": np.stack(sums, axis=1) / whole[of][:, None],
        "patch_bulk": np.bincount(patch, bulk * volume, minlength=count).astype(float),
    }


def time_step(model: Model, progress: Callable | None = None) -> Step:
    """Return the time step of a model in s, and the `CriticalStep` that limits it.

    The last ones are stored. ``progress`` is called with ("step", products, the most of them).
    """
    return _stored_step(model, progress)


def _time_step(model, progress):
    """Search for the time step of a model."""
    mass = model.zone_values("density") * zone_volumes(model.mesh)
    if model.mesh.hexahedral:
        most = MOST_PRODUCTS * (1 if model.mesh.layer is None else 2)
        product_of = _counted(zone_products(model), progress, most)
        limit = critical_step_of_hexahedra(model, mass, product_of)
    else:
        limit = critical_step(model)
        if model.quadratic:
            mass = model.nodes.sums(mass)
            product = explicit_product(model, limit.implicit, mass, zone_product)
            product = _counted(lambda: product, progress, MOST_PRODUCTS)()
            limit = assembled_step(model, limit, mass, product)
    return model.step_factor * limit.dt * _local_damping_factor(model), limit


def _counted(product_of, progress, most):
    """Return ``product_of``, whose products report how many of the most there were."""
    if progress is None:
        return product_of
    done = 0

    def reported(product, *motion, **rate):
        nonlocal done
        done = min(done + 1, most)
        progress("step", done, most)
        return product(*motion, **rate)

    return lambda *of: partial(reported, product_of(*of))


def zone_product(model: Model, mass: np.ndarray) -> Product:
    """Return the function of all zones of `zone_products`, for masses (n_nodes,) of nodes, kg."""
    return zone_products(model)(mass)


def zone_products(model: Model) -> Callable[..., Product]:
    """Return functions that multiply a motion (n_nodes, 3) by M^-1 K of its zones, in 1/s2.

    They are made from the masses (n_nodes,) of nodes in kg, for all zones or the active ones
    (n_zones,) bool of hexahedra. Given a rate in 1/s too, they add the rate times their stiffness
    damping. Ground that may yield counts as elastic, without its patches, which only soften it: a
    product that yields is not linear.

    It is one step of the core from rest, without joints, loads and boundaries; springs that relax
    act in full, in hexahedra as moduli, without their memory.
    """
    alone = _no_contact()
    elastic = {
        name: replace(rock, law=Elastic()) if rock.yields else rock
        for name, rock in model.materials.items()
    }
    plain = replace(model, single=False, materials=elastic)
    laws = zone_laws(plain)
    relaxing = [group for group in model.mesh.groups if model.branches(group)]
    if relaxing and model.mesh.hexahedral:
        plain = replace(plain, materials=_unrelaxed(model, relaxing))
        laws |= _branches([()] * len(model.mesh.groups))
    if model.mesh.hexahedral:
        zones, member = pack_arrays(plain, alone["contact_node"], layered=False)
        zones |= no_layer(False, len(zones["pack_set"]), model.mesh.order + 1)
    else:
        zones = _tetrahedra(plain, alone["contact_node"])
    n_nodes = len(model.nodes.points)
    constants = {
        "dt": 1.0,
        "node_mass": np.ones(n_nodes),
        "node_alpha": np.zeros(n_nodes),
        "local_damping": 0.0,
        "node_load": np.zeros((n_nodes, 3)),
        **alone,
        **laws,
        **zones,
        **zero_loads(2),
        **no_conditions(),
        **no_implicit_zones(),
        "receiver_node": np.zeros((0, model.nodes.zone_nodes.shape[1]), dtype=np.int32),
        "receiver_weight": np.zeros((0, model.nodes.zone_nodes.shape[1])),
    }
    rest = initial_state(constants)

    def of_zones(mass, active=None):
        stiff = {} if active is None else stiff_alone(zones, member, active)
        views = to_fortran({**constants, "node_mass": mass, **stiff})

        def product(motion, rate=0.0):
            state = {name: value.copy() for name, value in rest.items()}
            state["displacement"][:] = motion
            state["velocity"][:] = rate * motion
            advance(views, state, 0, 1, 1)
            return rate * motion - state["velocity"]

        return product

    return of_zones


def _unrelaxed(model, groups):
    """Return the materials with the moduli that groups with springs that relax have at once."""
    materials = dict(model.materials)
    for group in groups:
        lame, shear = model.law(group).moduli(materials[group])
        of_s, of_p = (
            1.0 + sum(getattr(branch, wave) for branch in model.branches(group))
            for wave in ("shear", "compression")
        )
        bulk = of_p * (lame + 2.0 * shear) - 4.0 / 3.0 * of_s * shear
        materials[group] = replace(
            materials[group], bulk=float(bulk), shear=float(of_s * shear), law=Elastic()
        )
    return materials


def geometry_arrays(
    model: Model, step: Step | None = None, progress: Callable | None = None
) -> tuple[dict[str, Any], CriticalStep]:
    """Return the arrays common to all stages, and the `CriticalStep` of the time step.

    ``step`` is the result of `time_step`, or the same with a shorter time step. Successive models
    that differ only in sources, receivers and boundaries, such as the blasts of a site, share them.
    """
    few, step = len(model.nodes.points) <= MOST_SHARED, step or time_step(model, progress)
    arrays, limit = (_shared_arrays if few else _ground_arrays)(model, step)
    return dict(arrays), limit


def _ground_arrays(model, step):
    """Return the arrays that depend on mesh, materials and joints."""
    mesh, nodes = model.mesh, model.nodes
    dt, limit = step
    mass = model.zone_values("density") * zone_volumes(mesh)
    node_mass = nodes.sums(mass) + _fill_mass(model)
    drag = nodes.sums(model.zone_damping("alpha") * mass)
    contacts = _contacts(model)
    common = {"dt": dt, "node_mass": node_mass, "node_alpha": drag / node_mass}
    common |= {**contacts, **no_implicit_zones()}
    if mesh.hexahedral:
        packs, member = pack_arrays(model, contacts["contact_node"])
        arrays = {**common, **zone_laws(model), **packs}
        return {**arrays, **layer_arrays(model, arrays, member)}, limit
    return {**common, **_tetrahedra(model, contacts["contact_node"])}, limit


def _ground(model, step):
    """Return what the arrays of `_ground_arrays` depend on."""
    return replace(model, sources=(), receivers=(), boundaries=()), moved_nodes(model), step


_shared_arrays = stored(_ground_arrays, _ground)
_stored_step = stored(_time_step, lambda model, _: _ground(model, None))


def _tetrahedra(model, contact_node):
    """Return the kernel arrays of the zones of a mesh of tetrahedra."""
    patch = model.patches() if model.yielding().any() else np.full(len(model.mesh.zones), -1)
    arrays = {
        **no_packs(model.single),
        **domain_arrays(model.tetrahedral, patch, contact_node),
        **dict(zip(("zone_lambda", "zone_shear"), model.zone_moduli(), strict=True)),
        **zone_laws(model),
    }
    return {**arrays, **stiffness_arrays(model.tetrahedral, arrays)}


def stiffness_arrays(nodes: Nodes, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return edge springs, patches and packs of zones, which depend on moduli and laws."""
    packs = zone_packs(nodes, arrays) if nodes.quadratic else {}
    return {**edge_arrays(nodes, arrays), **patch_arrays(nodes, arrays), **packs}


def zone_packs(nodes: Nodes, arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return the packs of quadratic zones that are computed together; theory.md (2.34).

    Parameters
    ----------
    nodes : Nodes
    arrays : dict
        Kernel arrays of domains and zones, and the width of packs in ``pack_node``.
    """
    width, corners = arrays["pack_node"].shape[-1], nodes.zone_nodes[:, :4]
    inner = shape_gradients(nodes.points, corners)
    volume = tetrahedron_volumes(nodes.points, corners)
    zone = np.empty((len(volume), 11))
    zone[:, :9] = (-2.0 * (inner.sum(axis=1, keepdims=True) - inner)).reshape(-1, 9)
    zone[:, 9] = -volume * arrays["zone_lambda"]
    zone[:, 10] = -volume * arrays["zone_shear"]
    starts = arrays["domain_zone_start"]
    counts = -(-np.diff(starts) // width)
    packs = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    member = np.repeat(starts[:-1], counts)[:, None] + width * packs[:, None] + np.arange(width)
    last = np.repeat(starts[1:], counts)[:, None] - 1
    metric = zone[np.minimum(member, last)]
    metric[member > last, 9:] = 0.0
    return {"pack_metric": np.ascontiguousarray(metric.transpose(0, 2, 1)[:, None])}


def _local_damping_factor(model):
    """Return the factor of local damping on the time step."""
    raised = 1.0 + model.local_damping
    return 1.0 / (raised if model.group_damping("beta").any() else np.sqrt(raised))


def zone_laws(model: Model) -> dict[str, np.ndarray]:
    """Return laws and damping of the sets of zones (one per group), and rows of internal state."""
    materials = [model.materials[group] for group in model.mesh.groups]
    laws = [ZONE_LAWS[material.law.name] for material in materials]
    rows = [
        property_row(law, material.law.properties(material), N_ZONE_PROPERTIES)
        for law, material in zip(laws, materials, strict=True)
    ]
    has_state = np.array([bool(law.state) for law in laws])[model.mesh.zone_group]
    row = np.where(has_state, np.cumsum(has_state) - 1, -1).astype(np.int32)
    return {
        "zone_row": row,
        "set_law": np.array([law.number for law in laws], dtype=np.int32),
        "set_property": np.array(rows),
        "set_beta": model.group_damping("beta"),
        **_branches([model.branches(group) for group in model.mesh.groups]),
        "row_initial": np.zeros((max(1, int(has_state.sum())), 6)),
    }


def _branches(by_set):
    """Return the distinct relaxation rates, and the stiffness of each set at each rate."""
    rates = sorted({branch.rate for branches in by_set for branch in branches})
    table = np.zeros((len(by_set), max(1, len(rates)), 2))
    for number, branches in enumerate(by_set):
        for branch in branches:
            table[number, rates.index(branch.rate)] += branch.shear, branch.compression
    return {"set_branch": table, "memory_rate": np.array(rates or [0.0])}


def _contacts(model):
    """Return the arrays of contacts and of the laws of their joints."""
    contacts = model.nodes.contacts
    if contacts is None or not contacts.names:
        return _no_contact()
    by_name = {joint.surface: joint for joint in model.joints}
    joints = [by_name[name] for name in contacts.names]
    laws = [JOINT_LAWS[joint.law] for joint in joints]
    table = [
        property_row(law, joint.properties, N_JOINT_PROPERTIES)
        for law, joint in zip(laws, joints, strict=True)
    ]
    pressure = initial_pressures(model)
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


def initial_pressures(model: Model) -> np.ndarray:
    """Return the normal pressure (n_contacts,) in Pa of joints before the blast, as they state."""
    contacts, pressure = model.nodes.contacts, np.zeros(len(model.nodes.contacts.area))
    height = model.nodes.points[contacts.minus, 2]
    by_name = {joint.surface: joint for joint in model.joints}
    for number, name in enumerate(contacts.names):
        own = contacts.joint == number
        pressure[own] = by_name[name].pressure_at(height[own])
    return pressure


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
    """Return one contact of zero area, of a node with itself: the core takes no empty tables."""
    return {
        "joint_law": np.zeros(1, dtype=np.int32),
        "joint_property": np.ones((1, N_JOINT_PROPERTIES)),
        "contact_node": np.zeros((1, 2), dtype=np.int32),
        "contact_normal": np.array([[1.0, 0.0, 0.0]]),
        "contact_area": np.zeros(1),
        "contact_joint": np.zeros(1, dtype=np.int32),
        "contact_initial": np.zeros((1, 3)),
    }


def dynamic_arrays(
    model: Model,
    geometry: dict[str, Any],
    n_steps: int,
    sides: Sequence[tuple[np.ndarray, np.ndarray, TimeFunction]] = (),
    entry: tuple[tuple[int, ...], dict[str, np.ndarray]] | None = None,
) -> dict[str, Any]:
    """Return loads, dashpots, prescribed motion and receivers of the dynamic stage.

    ``sides`` holds (nodes, forces, TimeFunction) of free-field sides; ``entry`` the numbers of
    injected sources and their load arrays.
    """
    injected = () if entry is None else entry[0]
    loads = model_loads(model, lambda surface: surface_impedance(model, surface), injected)
    for nodes, forces, history in sides:
        loads.add(nodes, forces, loads.add_history(history))
    conditions = dynamic_conditions(model, geometry, loads)
    nodes = model.nodes
    none = np.zeros((0, nodes.zone_nodes.shape[1]))
    node, weight = none.astype(np.int32), none
    if model.receivers:
        zone, weight = locate_in_zones(
            model.mesh, [receiver.position for receiver in model.receivers]
        )
        node, weight = nodes.zone_nodes[zone], nodes.shapes(weight)
    arrays = loads.arrays(geometry["dt"] * np.arange(n_steps))
    return {
        "local_damping": model.local_damping,
        "node_load": np.zeros_like(nodes.points),
        **conditions,
        **(arrays if entry is None else joined_loads(arrays, entry[1])),
        "receiver_node": node,
        "receiver_weight": weight,
    }


def zero_loads(n_steps: int) -> dict[str, np.ndarray]:
    """Return the load arrays of zero load over ``n_steps``."""
    return Loads().arrays(np.zeros(n_steps))


def initial_state(
    constants: dict[str, Any], contact_state: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Return the state at rest, with tractions and stresses at their initial values."""
    n_nodes, n_contacts = len(constants["node_mass"]), len(constants["contact_area"])
    n_rows = len(constants["row_initial"])
    if contact_state is None:
        contact_state = np.zeros((n_contacts, N_JOINT_STATE))
    size, width = constants["pack_node"].shape[1:]
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
        "slab_memory": np.zeros((len(constants["slab_axis"]), size, 10, width)),
        "node_memory": np.zeros((len(constants["stretch_row"]), 3)),
        "node_past": np.zeros((len(constants["layer_node"]), 3)),
        "crossing_memory": np.zeros((len(constants["crossing_part"]), 3, 3)),
        "sums": np.zeros(N_SUMS),
    }
