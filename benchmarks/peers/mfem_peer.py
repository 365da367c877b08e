"""MFEM (PyMFEM): assembled matrix of linear elements, central differences on its vectors."""

import mfem.ser as mfem
import numpy as np
from problem import given, solve


def main():
    """March."""
    problem = given()
    mesh = mfem.Mesh(3, len(problem.points), len(problem.zones), 0)
    for point in problem.points:
        mesh.AddVertex(*map(float, point))
    for zone in problem.zones.tolist():
        mesh.AddTet(*zone, 1)
    mesh.FinalizeTetMesh(1, 0, True)
    space = mfem.FiniteElementSpace(mesh, mfem.H1_FECollection(1, 3), 3, mfem.Ordering.byVDIM)
    young, poisson = float(problem.young), float(problem.poisson)
    mu = young / (2.0 * (1.0 + poisson))
    lame = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    form = mfem.BilinearForm(space)
    law = mfem.ElasticityIntegrator(mfem.ConstantCoefficient(lame), mfem.ConstantCoefficient(mu))
    form.AddDomainIntegrator(law)
    form.Assemble()
    form.Finalize()
    stiffness = form.SpMat()
    moved, force = (mfem.Vector(space.GetVSize()) for _ in range(2))
    moved.Assign(0.0)
    force.Assign(0.0)
    u_, f_ = (vector.GetDataArray().reshape(-1, 3) for vector in (moved, force))
    v_ = np.zeros_like(u_)
    factor = np.where(problem.fixed, 0.0, problem.dt / problem.mass[:, None])

    def step(i):
        stiffness.Mult(moved, force)
        f_[int(problem.source)] -= problem.force * problem.samples[i]
        v_[:] -= factor * f_
        u_[:] += problem.dt * v_

    solve(problem, step, lambda: u_[problem.receivers])


main()
