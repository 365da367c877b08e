"""Bare marches of zones on one thread: forces, springs of joints, update, readings."""

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from pyblast.core import HEX_WIDTH
from pyblast.mesh import tetrahedra
from pyblast.mesh.mesh import locate_in_zones
from pyblast.mesh.nodes import morton_keys, nodes_of, renumbered
from pyblast.solver.assembly import zone_packs

from .compiled import called, compiled, plain

KERNELS = (
    "kinds.f90.in", "wide_vectors.c", "processor.f90", "tet4.f90", "tet15_kernel.f90.in",
    "tet15_kernels.f90.in", "tet15.f90",
)  # fmt: skip
DOMAIN_ZONES = {4: 1024, 15: 512}


def library():
    """Return the kernels with the march, compiled for the machine at hand."""
    sources = [f"fortran/{name}" for name in KERNELS]
    return compiled(*sources, "benchmarks/bare_march.f90")


@dataclass(frozen=True, eq=False)
class Bare:
    """A box of one elastic rock on rollers, its nodes and zones in order along a curve.

    Parameters
    ----------
    points : (n_nodes, 3) float64, m
    zone_nodes : (n_zones, 4 or 15) int32
    mass : (n_nodes,) float64, kg
    fixed : (n_nodes, 3) bool
    lame, shear : float, Pa
    links : (n, 2) int32 and (n,) float64, kg
        Edges and gamma (M_l - M_c) on them: the tuned mass.
    pairs : (n, 2) int32 and (n, 3) float64, N/m
        Springs of joints.
    places : callable
        From points (n, 3) to nodes and weights, (n, 4 or 15) each.
    """

    points: np.ndarray
    zone_nodes: np.ndarray
    mass: np.ndarray
    fixed: np.ndarray
    lame: float
    shear: float
    links: tuple
    pairs: tuple
    places: object = field(repr=False)

    def march(self, dt, n_steps, motion=None, source=None, receivers=None):
        """Return velocities (n_steps, n_receivers, 3), the last u and v, and processor seconds.

        Parameters
        ----------
        dt : float, s
        n_steps : int
        motion : tuple of (n_nodes, 3), optional
            u in m, and v in m/s half a step earlier.
        source : (point (3,), force (3,), samples (n_steps,)), optional
        receivers : (n, 3) float64, optional
        """
        arguments, out, u, v = self.arguments(n_steps, motion, source, receivers)
        start = time.process_time()
        called(library().march, arguments[0], (dt,), arguments[1])
        return out, u, v, time.process_time() - start

    def arguments(self, n_steps, motion=None, source=None, receivers=None):
        """Return counts and tables of the compiled march, and those that it fills."""
        n_nodes, n_corners = len(self.points), self.zone_nodes.shape[1]
        point, force, samples = source or (self.points[0], np.zeros(3), np.zeros(n_steps))
        where = np.atleast_2d(point if receivers is None else [*receivers, point])
        nodes, weights = self.places(where)
        u, v = (np.array(part) for part in (motion or np.zeros((2, n_nodes, 3))))
        out = np.zeros((n_steps, len(where) - 1, 3))
        inverse = np.where(self.fixed, 0.0, 1.0 / self.mass[:, None])
        domains = self.domains
        moduli = np.full((2, len(self.zone_nodes), 1), [[[self.lame]], [[self.shear]]])
        pushed = weights[-1][:, None] * force
        tables = (*domains[:4], *moduli, domains[4], self.metric, inverse,
                  self.links[0] + 1, self.links[1], self.pairs[0] + 1, self.pairs[1],
                  pushed, samples, nodes + 1, weights[:-1], u, v, out)  # fmt: skip
        counts = (n_nodes, len(self.zone_nodes), n_corners, len(domains[0]) - 1, len(domains[2]),
                  n_steps, len(self.links[1]), len(self.pairs[1]), len(where) - 1)  # fmt: skip
        return (counts, [plain(table) for table in tables]), out, u, v

    def longest_step(self):
        """Return two over the highest frequency, found by Lanczos' iteration."""
        root = np.where(self.fixed, 0.0, 1.0 / np.sqrt(self.mass)[:, None])

        still = np.zeros_like(self.points)
        (counts, tables), _, u, v = self.arguments(1, (still, still))

        def product(x):
            u[:], v[:] = x.reshape(-1, 3) * root, 0.0
            called(library().march, counts, (1.0,), tables)
            return -(v * np.sqrt(self.mass)[:, None]).ravel()

        size = self.points.size
        operator = LinearOperator((size, size), matvec=product, dtype=float)
        top = eigsh(operator, k=1, which="LM", tol=1e-4, return_eigenvectors=False)[0]
        return 2.0 / np.sqrt(top)

    @cached_property
    def domains(self):
        """Starts of domains, starts of slots, slot nodes, zone slots and places."""
        n_zones, n_corners = self.zone_nodes.shape
        starts = np.append(np.arange(0, n_zones, DOMAIN_ZONES[n_corners]), n_zones)
        domain = np.arange(n_zones) // DOMAIN_ZONES[n_corners]
        keys = domain[:, None] * len(self.points) + self.zone_nodes.astype(np.int64)
        slots, at = np.unique(keys, return_inverse=True)
        first = np.searchsorted(slots, np.arange(len(starts)) * len(self.points))
        node = slots % len(self.points)
        zone_slot = at.reshape(-1, n_corners) - first[domain][:, None] + 1
        return [plain(t) for t in (starts + 1, first + 1, node + 1, zone_slot.T, self.points[node])]

    @cached_property
    def metric(self):
        """Packs of quadratic zones."""
        if self.zone_nodes.shape[1] == 4:
            return np.zeros(1)
        n_zones = len(self.zone_nodes)
        arrays = {
            "domain_zone_start": self.domains[0] - 1,
            "zone_lambda": np.full(n_zones, self.lame),
            "zone_shear": np.full(n_zones, self.shear),
            "pack_node": np.zeros((1, 1, HEX_WIDTH[False])),
        }
        return zone_packs(self, arrays)["pack_metric"]


def bare(mesh, rock, quadratic=False, gamma=0.0, stiffness=None):
    """Return the `Bare` box of a mesh, split or not.

    Parameters
    ----------
    mesh : Mesh
        Joints across an axis of coordinates.
    rock : Material
    quadratic : bool
    gamma : float
        Of the tuned mass of constant-strain zones.
    stiffness : (kn, ks), optional, Pa/m
    """
    mesh = renumbered(mesh)
    mass = rock.density * tetrahedra.volumes(mesh.points, mesh.zones)
    held = nodes_of(mesh, quadratic)
    total = held.sums(mass)
    order = np.argsort(morton_keys(held.points), kind="stable")
    new = np.empty(len(order), dtype=np.int32)
    new[order] = np.arange(len(order), dtype=np.int32)
    ends = (mesh.points.min(axis=0), mesh.points.max(axis=0))
    points = held.points[order]
    fixed = np.any([np.abs(points - end) < 1e-6 for end in ends], axis=0)

    def places(where):
        zone, weights = locate_in_zones(mesh, where)
        return new[held.zone_nodes[zone]], held.shapes(weights)

    links = np.zeros((0, 2), dtype=np.int32), np.zeros(0)
    if gamma:
        edges = np.sort(new[mesh.zones[:, tetrahedra.EDGES]].reshape(-1, 2), axis=1)
        edges, at = np.unique(edges, axis=0, return_inverse=True)
        links = edges, gamma * np.bincount(at.ravel(), np.repeat(mass / 20.0, 6))
    pairs = np.zeros((0, 2), dtype=np.int32), np.zeros((0, 3))
    if held.contacts is not None:
        normal, (kn, ks) = np.abs(held.contacts.normal), stiffness
        springs = held.contacts.area[:, None] * (kn * normal + ks * (1.0 - normal))
        pairs = new[np.column_stack([held.contacts.minus, held.contacts.plus])], springs
    zone_nodes = new[held.zone_nodes]
    return Bare(points, zone_nodes, total[order], fixed, rock.first_lame, rock.shear, links,
                pairs, places)  # fmt: skip
