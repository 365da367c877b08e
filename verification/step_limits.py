"""Where a model begins to grow: the top of its spectrum, and full runs on both sides of it."""

from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from pyblast import core
from pyblast.errors import SolverError
from pyblast.model.joint import Joint
from pyblast.model.material import Elastic
from pyblast.solver.assembly import time_step
from pyblast.solver.implicit_zones import Implicit
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

ROUNDS = 3  # the answer of mass damping to a force depends a little on the step


def elastic(model):
    """Return a model with elastic ground and joints at their largest stiffness: a linear one.

    What yields or slips makes the operator of `true_limit` neither linear nor symmetric.
    """
    materials = {
        name: replace(rock, law=Elastic()) if rock.yields else rock
        for name, rock in model.materials.items()
    }
    joints = []
    for joint in model.joints:
        stiffness, _ = joint.bound()
        joints.append(Joint(joint.surface, "elastic", {"kn": stiffness, "ks": stiffness}))
    return replace(model, materials=materials, joints=joints, insitu=None, sources=())


def explicit(model, duration=1e-3):
    """Return a `Prepared` with the step that the smallest zone allows, and nothing implicit."""
    dt, limit = time_step(model)
    none = Implicit(*(np.zeros_like(part) for part in vars(limit.implicit).values()))
    bare = replace(limit, implicit=none, dt=limit.explicit)
    return prepare(model, duration, step=(dt * limit.explicit / limit.dt, bare))


def true_limit(prepared, dt=None):
    """Return the longest stable step of a linear model without lagged damping, s.

    Parameters
    ----------
    prepared : Prepared
        Of a linear model, such as `elastic` returns, with nothing implicit.
    dt : float, s
        Where to begin; that of the model by default.

    Notes
    -----
    Two over the largest frequency of the assembled operator, by Lanczos iteration; the operator
    is what one step of the kernels makes of a displacement, before anything has relaxed.
    """
    dt = prepared.constants["dt"] if dt is None else dt
    root = np.sqrt(np.repeat(prepared.constants["node_mass"], 3))
    for _ in range(ROUNDS):
        views = core.to_fortran({**prepared.constants, "dt": dt})
        drag = np.repeat(1.0 + 0.5 * dt * prepared.constants["node_alpha"], 3)

        def answer(moved, views=views, drag=drag, dt=dt):
            state = {name: value.copy() for name, value in prepared.state.items()}
            state["displacement"][:] = (moved.ravel() / root).reshape(-1, 3)
            core.advance(views, state, 0, 1, 10**6)
            return -state["velocity"].ravel() * drag * root / dt

        operator = LinearOperator((len(root),) * 2, matvec=answer, dtype=float)
        largest = eigsh(operator, k=1, which="LA", tol=1e-6, return_eigenvectors=False)[0]
        dt = 2.0 / np.sqrt(largest)
    return float(dt)


def largest_root(model, dt):
    """Return the largest eigenvalue of the march from step to step, one unit state at a time."""
    prepared = explicit(model)
    views = core.to_fortran({**prepared.constants, "dt": dt})
    names, columns = ("displacement", "velocity", "memory"), []
    for name in names:
        for place in range(prepared.state[name].size):
            state = {key: value.copy() for key, value in prepared.state.items()}
            state[name].flat[place] = 1.0
            core.advance(views, state, 0, 1, 10**6)
            columns.append(np.concatenate([state[key].ravel() for key in names]))
    return np.abs(np.linalg.eigvals(np.array(columns))).max()


def lasts(model, dt, n_steps=4000):
    """Tell whether an explicit run from random velocities lasts and calms down at a step of dt."""
    prepared = explicit(model)
    velocity = np.random.default_rng(0).normal(size=prepared.state["velocity"].shape)
    constants = {**prepared.constants, "dt": dt, "history": np.zeros((n_steps, 1))}
    state = {**prepared.state, "velocity": velocity}
    begun = replace(prepared, constants=constants, state=state, n_steps=n_steps)
    try:
        kinetic = simulate(model, n_steps * dt, prepared=begun).energy["kinetic"]
    except SolverError:
        return False
    return bool(kinetic[-20:].max() <= kinetic[0])
