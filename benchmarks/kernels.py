"""Steps by edges and by zones against the stream of their own data, a naive loop, batches, orders.

Ground that is linear marches by its edges; what it would cost by zones is timed beside it.
"""

import numpy as np

from pyblast.mesh.mesh import Mesh
from pyblast.mesh.nodes import renumbered
from pyblast.mesh.tetrahedra import volumes
from pyblast.model.material import Damping

from .bare import bare, library
from .compiled import called, compiled, plain
from .marching import (
    LEDGER_EVERY,
    ROCK,
    March,
    by_zones,
    cube,
    prepared,
    rock_model,
    rounds_of_ledger,
)
from .timing import Probes, interleaved, median, on, ratio

TITLE = "Kernels"
CELLS = {"0.2 M": 33, "1 M": 55}
ZONE_STEPS = 10_000_000  # of one timing
DAMPING = Damping(0.02, 10.0, corner=150.0)
KERNELS = {
    "zones": "zones alone", "step": "step by zones", "damped": "damped step by zones",
    "edges": "step by edges", "edges_damped": "damped step by edges",
}  # fmt: skip
BY_EDGES = {"step": "edges", "damped": "edges_damped"}
LEAST = 59.0  # bytes a zone and step that no kernel of this kind can do without (the design)


def measure(effort):
    """Return rates, shares of the roof and ratios by size of the mesh."""
    found = {}
    for name, cells in CELLS.items():
        if effort == "quick" and cells > 33:
            continue
        found[name] = of_size(cube(20 if effort == "quick" else cells))
    return found


def of_size(mesh):
    """Return what one mesh gives."""
    mesh, n_steps = renumbered(mesh), rounds_of_ledger(len(mesh.zones), ZONE_STEPS)
    probes, models = Probes(), full_steps(mesh, n_steps)
    works = {
        **probes.works(),
        "naive_1": on(1, Naive(mesh, n_steps)),
        "zones_1": on(1, zones_alone(mesh, n_steps)),
        "random_1": on(1, March(prepared(rock_model(shuffled(mesh)), n_steps), n_steps)),
        "unordered_1": on(1, March(unordered(mesh, n_steps), n_steps)),
    }
    for name, model in models.items():
        works |= by_threads(name, March(model, n_steps))
    took = interleaved(works)
    del works
    machine = probes.found(took)
    batch = in_batch(models, n_steps)
    rates = {
        name: len(mesh.zones) * n_steps / median(times) / 1e6
        for name, times in took.items()
        if not name.startswith(("triad", "multiply"))
    }
    own = bytes_per_zone(models["edges"].constants)
    stream = machine["triad_gb_per_s"][0] * 1e3
    return {
        "zones": len(mesh.zones), "nodes": len(mesh.points), "steps": n_steps, "probes": machine,
        "million_zone_steps_per_s": rates, "bytes_per_zone": own,
        "share_of_own_roof": {f"{name}_1": rates[f"{name}_1"] * own[name] / stream
                              for name in KERNELS},
        "share_of_least_roof": {f"{name}_1": rates[f"{name}_1"] * LEAST / stream
                                for name in KERNELS},
        "over_naive": {f"{name}_1": ratio(took["naive_1"], took[f"{name}_1"])
                       for name in KERNELS},
        "edges_over_zones": {name: ratio(took[f"{name}_1"], took[f"{by}_1"])
                             for name, by in BY_EDGES.items()},
        "two_threads": {name: ratio(took[f"{name}_1"], took[f"{name}_2"]) for name in models},
        "random_over_ordered": ratio(took["edges_1"], took["random_1"]),
        "unordered_over_ordered": ratio(took["edges_1"], took["unordered_1"]),
        "batch_of_8": batch,
    }  # fmt: skip


def full_steps(mesh, n_steps):
    """Return models prepared to march by zones and by edges, without damping and with it."""
    still = prepared(rock_model(mesh), n_steps)
    damped = prepared(rock_model(mesh, damping=DAMPING), n_steps)
    return {"step": by_zones(still), "damped": by_zones(damped),
            "edges": still, "edges_damped": damped}  # fmt: skip


def by_threads(name, work):
    """Return a march on one thread and on two."""
    return {f"{name}_{count}": on(count, work) for count in (1, 2)}


def unordered(mesh, n_steps):
    """Return the model on a shuffled mesh that is left as it came."""
    return prepared(rock_model(shuffled(mesh), _ordered=True), n_steps)


def in_batch(models, n_steps):
    """Return the throughput of eight models side by side over that of one, by threads."""
    found = {}
    for name, model in models.items():
        one, eight = March(model, n_steps), March(model, LEDGER_EVERY, lanes=True)
        took = interleaved({**by_threads("one", one), **by_threads("eight", eight)})
        share = 8.0 * eight.n_steps / one.n_steps
        for count in (1, 2):
            gained = share * ratio(took[f"one_{count}"], took[f"eight_{count}"])
            found[f"{name}_{count}"] = gained
    return found


def zones_alone(mesh, n_steps):
    """Return a march of zones and nodes alone, without boundaries, receivers and energies."""
    box = bare(mesh, ROCK)
    motion = tuple(1e-6 * np.random.default_rng(0).normal(size=(2, *box.points.shape)))
    (counts, tables), *_ = box.arguments(n_steps, motion)
    return lambda: called(library().march, counts, (1e-5,), tables)


class Naive:
    """The naive loop over a mesh whose nodes and zones are in good order already."""

    def __init__(self, mesh, n_steps):
        n_nodes, n_zones = len(mesh.points), len(mesh.zones)
        mass = ROCK.density * np.bincount(
            mesh.zones.ravel(), np.repeat(0.25 * volumes(mesh.points, mesh.zones), 4), n_nodes
        )
        moving = 1e-6 * np.random.default_rng(0).normal(size=(n_nodes, 3))
        moduli = [np.full(n_zones, modulus) for modulus in (ROCK.first_lame, ROCK.shear)]
        tables = [mesh.zones + 1, *moduli, mesh.points, mass, np.full(n_nodes, 0.1),
                  np.zeros((n_nodes, 3)), moving, np.zeros((n_nodes, 3))]  # fmt: skip
        self.tables, self.counts = [plain(one) for one in tables], (n_nodes, n_zones, n_steps)

    def __call__(self):
        """March."""
        called(self.library().naive_march, self.counts, (1e-5,), self.tables)

    @staticmethod
    def library():
        """Return the compiled loop."""
        return compiled("benchmarks/naive.f90")


def shuffled(mesh):
    """Return the mesh with nodes and zones in random order."""
    generator = np.random.default_rng(0)
    order = generator.permutation(len(mesh.points))
    new = np.empty(len(order), dtype=np.int32)
    new[order] = np.arange(len(order), dtype=np.int32)
    zones = generator.permutation(len(mesh.zones))
    surfaces = {name: new[faces] for name, faces in mesh.surfaces.items()}
    return Mesh(
        mesh.points[order], new[mesh.zones[zones]], mesh.zone_group[zones], mesh.groups, surfaces
    )


def bytes_per_zone(constants):
    """Return what a step must move, each array counted once for each pass that meets it.

    Zones read slots and moduli (32 B a zone) and the places of slots (24 B); edges their springs
    and other end (52 B an edge), their start in each slot (4 B) and skew parts (32 B each), and
    zones when the ledger is written. Either reads the node of a slot and writes its sum, which
    nodes read again with its number (56 B a slot); nodes displacement, velocity, mass, force, load
    (212 B). Low-passed damping adds memory and velocity of nodes to what zones or edges read, its
    update, and two passes over slots that tell the power of damping.
    """
    n_zones = constants["zone_slot"].shape[1]
    slots = len(constants["slot_node"]) / n_zones
    nodes = len(constants["node_mass"]) / n_zones
    edges = len(constants["edge_slot"]) / n_zones
    skew = len(constants["skew_spring"]) / n_zones
    zones, springs = 32.0 + 24.0 * slots, 52.0 * edges + 4.0 * slots + 32.0 * skew
    alone = zones + slots * (4 + 24) + slots * 24 + nodes * (24 + 24 + 24 + 24 + 48 + 48)
    passes = 56.0 * slots + 212.0 * nodes
    damping = slots * 2 * (24 + 4) + nodes * (24 + 24 + 2 * 24 + 24 + 24 + 48)
    by_edges = springs + passes + zones / LEDGER_EVERY
    return {"zones": alone, "step": zones + passes, "damped": zones + passes + damping,
            "edges": by_edges, "edges_damped": by_edges + damping, "least": LEAST,
            "slots_a_zone": slots, "nodes_a_zone": nodes, "edges_a_zone": edges}  # fmt: skip


def lines(found):
    """Return the tables of this part."""
    told = [
        "Million zone steps per second (Mz/s), one thread; six zones per cell, ordered along a "
        "curve. *Zones alone* means forces and update only; a *step* also has viscous sides, ten "
        "receivers and the energy balance, a *damped* one low-passed Rayleigh damping of 2 % as "
        "well. Such ground runs *by edges*; ground that edges cannot represent runs *by zones*. "
        "Shares are of the triad's bytes per second (the memory limit), counting the bytes that "
        "such a step moves or the 59 B that every step of zones needs.",
        "",
        "| mesh | kernel | Mz/s | B a zone | of its limit | of that of 59 B | over naive loop | "
        "2 threads | batch of 8 over single runs, 1 and 2 threads |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        told += [kernel_row(name, one, *kernel) for kernel in KERNELS.items()]
    told += [
        "",
        "| mesh | edges over zones, damped | random input order, renumbered | not renumbered "
        "| triad GB/s, 1 and 2 threads | multiply-add GF/s, 2 threads |",
        "|---|---|---|---|---|---|",
    ]
    for name, one in found.items():
        probes, over = one["probes"], one["edges_over_zones"]
        told.append(
            f"| {name} | {over['step']:.2f}, {over['damped']:.2f} "
            f"| {one['random_over_ordered']:.2f} | {one['unordered_over_ordered']:.2f} "
            f"| {probes['triad_gb_per_s'][0]:.1f}, {probes['triad_gb_per_s'][1]:.1f} "
            f"| {probes['multiply_add_gflops'][0]:.0f}, × "
            f"{probes['multiply_add_two_threads']:.2f} |"
        )
    return told


def kernel_row(mesh, one, kernel, words):
    """Return the row of one kernel on one mesh."""
    key, batch = f"{kernel}_1", one["batch_of_8"]
    second = f"{one['two_threads'][kernel]:.2f}" if kernel in one["two_threads"] else "–"
    gained = f"{batch[key]:.2f}, {batch[f'{kernel}_2']:.2f}" if key in batch else "–"
    return (
        f"| {mesh} | {words} | {one['million_zone_steps_per_s'][key]:.0f} "
        f"| {one['bytes_per_zone'][kernel]:.0f} | {one['share_of_own_roof'][key]:.2f} "
        f"| {one['share_of_least_roof'][key]:.2f} | {one['over_naive'][key]:.2f} "
        f"| {second} | {gained} |"
    )
