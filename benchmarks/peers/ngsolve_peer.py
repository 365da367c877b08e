"""NGSolve: assembled matrix of linear elements, central differences on its vectors."""

import netgen.meshing as netgen
import numpy as np
from ngsolve import (
    BilinearForm,
    Grad,
    Id,
    InnerProduct,
    Mesh,
    SetNumThreads,
    Trace,
    VectorH1,
    dx,
)
from problem import given, solve


def meshed(problem):
    """Return the mesh."""
    mesh = netgen.Mesh(3)
    nodes = [mesh.Add(netgen.MeshPoint(netgen.Pnt(*map(float, p)))) for p in problem.points]
    mesh.SetMaterial(1, "rock")
    for zone in problem.zones:
        mesh.Add(netgen.Element3D(1, [nodes[n] for n in zone]))
    return Mesh(mesh)


def main():
    """March."""
    SetNumThreads(1)
    problem = given()
    space = VectorH1(meshed(problem), order=1)
    young, poisson = float(problem.young), float(problem.poisson)
    mu = young / (2.0 * (1.0 + poisson))
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    u, v = space.TnT()
    strain, other = (0.5 * (Grad(w) + Grad(w).trans) for w in (u, v))
    stress = 2.0 * mu * strain + lame * Trace(strain) * Id(3)
    stiffness = BilinearForm(InnerProduct(stress, other) * dx).Assemble().mat
    moved, going, force = (stiffness.CreateColVector() for _ in range(3))
    for vector in (moved, going, force):
        vector[:] = 0.0
    n_nodes, source, receivers = len(problem.points), int(problem.source), problem.receivers
    factor = np.where(problem.fixed, 0.0, problem.dt / problem.mass[:, None]).T.ravel()
    places = np.arange(3) * n_nodes
    u_, v_, f_ = (vector.FV().NumPy() for vector in (moved, going, force))

    def step(i):
        stiffness.Mult(moved, force)
        f_[places + source] -= problem.force * problem.samples[i]
        v_[:] -= factor * f_
        u_[:] += problem.dt * v_

    solve(problem, step, lambda: u_[places[None, :] + receivers[:, None]])


main()
