"""Akantu: explicit march with lumped mass."""

import akantu as aka
import numpy as np
from problem import given, solve


def written(problem):
    """Write the mesh as Gmsh's format 2.2 and the material; return the names of both."""
    mesh, material = problem.folder / "mesh.msh", problem.folder / "material.dat"
    with mesh.open("w") as file:
        file.write(f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{len(problem.points)}\n")
        number = np.arange(1, len(problem.points) + 1)[:, None]
        np.savetxt(file, np.hstack([number, problem.points]), fmt="%d %.12g %.12g %.12g")
        file.write(f"$EndNodes\n$Elements\n{len(problem.zones)}\n")
        rows = np.tile([4, 2, 1, 1], (len(problem.zones), 1))
        number = np.arange(1, len(rows) + 1)[:, None]
        np.savetxt(file, np.hstack([number, rows, problem.zones + 1]), fmt="%d")
        file.write("$EndElements\n")
    material.write_text(
        f"material elastic [\n name = rock\n rho = {problem.density}\n"
        f" E = {problem.young}\n nu = {problem.poisson}\n]\n"
    )
    return str(mesh), str(material)


def main():
    """March."""
    problem = given()
    path, material = written(problem)
    aka.parseInput(material)
    mesh = aka.Mesh(3)
    mesh.read(path)
    model = aka.SolidMechanicsModel(mesh)
    model.initFull(_analysis_method=aka._explicit_lumped_mass)
    model.setTimeStep(problem.dt)
    model.getBlockedDOFs()[:] = problem.fixed
    moved, force = model.getDisplacement(), model.getExternalForce()
    if not np.allclose(mesh.getNodes(), problem.points):
        raise SystemExit("nodes were renumbered")

    later = [*problem.samples[1:], 0.0]  # a step ends with the force at its end

    def step(i):
        force[problem.source] = problem.force * later[i]
        model.solveStep()

    solve(problem, step, lambda: moved[problem.receivers])


main()
