"""OpenSeesPy: tetrahedra of four nodes, central differences, diagonal system."""

import numpy as np
import openseespy.opensees as ops
from problem import given, solve


def main():
    """March."""
    problem = given()
    ops.model("basic", "-ndm", 3, "-ndf", 3)
    for number, (point, mass) in enumerate(zip(problem.points, problem.mass, strict=True), 1):
        ops.node(number, *map(float, point))
        ops.mass(number, *[float(mass)] * 3)
    for node in np.flatnonzero(problem.fixed.any(axis=1)):
        ops.fix(int(node) + 1, *map(int, problem.fixed[node]))
    ops.nDMaterial("ElasticIsotropic", 1, float(problem.young), float(problem.poisson))
    for number, zone in enumerate((problem.zones + 1).tolist(), 1):
        ops.element("FourNodeTetrahedron", number, *zone, 1)
    samples = [float(one) for one in problem.samples]
    ops.timeSeries("Path", 1, "-dt", problem.dt, "-values", *samples)
    ops.pattern("Plain", 1, 1)
    ops.load(int(problem.source) + 1, *map(float, problem.force))
    ops.constraints("Plain")
    ops.numberer("Plain")
    ops.system("Diagonal")
    ops.integrator("CentralDifference")
    ops.algorithm("Linear")
    ops.analysis("Transient")
    receivers = [int(node) + 1 for node in problem.receivers]

    def step(_):
        if ops.analyze(1, problem.dt) != 0:
            raise SystemExit("analyze failed")

    solve(problem, step, lambda: [ops.nodeDisp(node) for node in receivers])


main()
