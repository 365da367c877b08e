"""Kratos: central differences of its application for structures."""

import KratosMultiphysics as Kratos
import KratosMultiphysics.StructuralMechanicsApplication as Structural
import numpy as np
from problem import given, solve

AXES = "XYZ"


def filled(problem, model):
    """Return the part with nodes, zones and supports."""
    part = model.CreateModelPart("rock")
    part.ProcessInfo[Kratos.DOMAIN_SIZE] = 3
    for name in (
        "DISPLACEMENT", "VELOCITY", "ACCELERATION", "REACTION", "VOLUME_ACCELERATION",
        "NODAL_MASS", "FORCE_RESIDUAL", "RESIDUAL_VECTOR", "MIDDLE_VELOCITY",
        "FRACTIONAL_ACCELERATION", "NODAL_DISPLACEMENT_DAMPING",
    ):  # fmt: skip
        home = Kratos if hasattr(Kratos, name) else Structural
        part.AddNodalSolutionStepVariable(getattr(home, name))
    part.AddNodalSolutionStepVariable(Structural.POINT_LOAD)
    part.SetBufferSize(3)
    for number, point in enumerate(problem.points, 1):
        part.CreateNewNode(number, *map(float, point))
    rock = part.CreateNewProperties(1)
    rock.SetValue(Kratos.DENSITY, float(problem.density))
    rock.SetValue(Kratos.YOUNG_MODULUS, float(problem.young))
    rock.SetValue(Kratos.POISSON_RATIO, float(problem.poisson))
    rock.SetValue(Kratos.CONSTITUTIVE_LAW, Structural.LinearElastic3DLaw())
    for number, zone in enumerate((problem.zones + 1).tolist(), 1):
        part.CreateNewElement("SmallDisplacementElement3D4N", number, zone, rock)
    part.CreateNewCondition("PointLoadCondition3D1N", 1, [int(problem.source) + 1], rock)
    for axis in AXES:
        moved, held = (getattr(Kratos, f"{name}_{axis}") for name in ("DISPLACEMENT", "REACTION"))
        Kratos.VariableUtils().AddDof(moved, held, part)
    for node, axis in zip(*np.nonzero(problem.fixed), strict=True):
        part.GetNode(int(node) + 1).Fix(getattr(Kratos, f"DISPLACEMENT_{AXES[axis]}"))
    return part


def main():
    """March."""
    problem = given()
    Kratos.Logger.GetDefaultOutput().SetSeverity(Kratos.Logger.Severity.WARNING)
    Kratos.ParallelUtilities.SetNumThreads(1)
    part = filled(problem, Kratos.Model())
    part.ProcessInfo[Kratos.DELTA_TIME] = problem.dt
    scheme = Structural.ExplicitCentralDifferencesScheme(1.0, problem.dt, 1.0)
    strategy = Structural.MechanicalExplicitStrategy(part, scheme, False, False, False)
    strategy.SetEchoLevel(0)
    strategy.Initialize()
    receivers = [part.GetNode(int(node) + 1) for node in problem.receivers]
    source = part.GetNode(int(problem.source) + 1)

    def step(i):
        part.CloneTimeStep((i + 1) * problem.dt)
        part.ProcessInfo[Kratos.STEP] = i + 1
        push = Kratos.Vector([float(one) for one in problem.force * problem.samples[i]])
        source.SetSolutionStepValue(Structural.POINT_LOAD, 0, push)
        strategy.Solve()

    solve(
        problem, step,
        lambda: [list(one.GetSolutionStepValue(Kratos.DISPLACEMENT)) for one in receivers],
    )  # fmt: skip


main()
