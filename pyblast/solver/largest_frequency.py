"""Largest frequency of an assembled model of linear zones and joints, and the step it allows."""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import eigvalsh_tridiagonal

from ..mesh.mesh import Contacts
from ..model.model import Model

# Product of M^-1 (K + rate C) with a motion (n_nodes, 3), in 1/s2, from the motion and the rate.
Product = Callable[..., np.ndarray]
MOST = 40  # products for the largest eigenvalue
LEAST = 20  # the value can stand still before the fastest place is found
ROUNDS = 3  # for the step of a damped model
TIGHT = 1e-3  # its relative change between the last products
ABOVE = 1.005  # factor on the eigenvalue found, which is a lower bound
GRID = 1.01  # ratio of the values to which it is raised, so that its last digits do not matter


def with_joints(model: Model, product: Product, mass: np.ndarray) -> Product:
    """Return the product of a whole model: that of its zones, and its joints at their stiffest."""
    contacts = model.nodes.contacts
    if contacts is None:
        return product
    by_name = {joint.surface: joint for joint in model.joints}
    bounds = np.array([by_name[name].bound() for name in contacts.names]).reshape(-1, 2)
    bound = bounds[contacts.joint]

    def whole(motion, rate=0.0):
        spring = contacts.area * (bound[:, 0] + rate * bound[:, 1])
        return product(motion, rate) + joint_product(contacts, spring, motion) / mass[:, None]

    return whole


def joint_product(contacts: Contacts, stiffness: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """Return the forces (n_nodes, 3) in N of springs (n_contacts,) in N/m against a motion."""
    force = np.zeros_like(motion)
    jump = stiffness[:, None] * (motion[contacts.plus] - motion[contacts.minus])
    np.add.at(force, contacts.plus, jump)
    np.subtract.at(force, contacts.minus, jump)
    return force


def longest_step(squared: float, drag: float, beta: float = 0.0) -> float:
    """Return the longest stable step in s.

    Parameters
    ----------
    squared : float, 1/s2
        Square of the largest angular frequency.
    drag : float, 1/s
        Largest damping force over mass and velocity.
    beta : float, s
        Stiffness damping.

    Notes
    -----
    The root of ``squared T^2/4 + (drag + squared beta) T/2 = 1``; theory.md (2.48).
    """
    drag = drag + squared * beta
    return float((np.sqrt(drag**2 / 4.0 + squared) - drag / 2.0) * 2.0 / squared)


def damped_step(product: Product, mass: np.ndarray, shortest: float) -> float:
    """Return the longest stable step of damped zones and joints in s, at least ``shortest``.

    Notes
    -----
    A step T is stable if the largest eigenvalue of ``M^-1 (K + 2/T C)`` is at most ``4/T^2``. The
    eigenvalue falls with T, so that of a stable step gives a longer one: theory.md (2.48).
    """
    dt = shortest
    for _ in range(ROUNDS):
        squared = largest_eigenvalue(partial(product, rate=2.0 / dt), mass)
        dt = max(dt, longest_step(squared, 0.0))
    return dt


def largest_eigenvalue(product: Product, mass: np.ndarray) -> float:
    """Return the largest eigenvalue of M^-1 K in 1/s2, raised by what its search may miss.

    Notes
    -----
    Lanczos from a fixed start in the inner product of the mass; theory.md (2.48).
    """
    n_nodes = len(mass)
    motion = np.random.default_rng(0).standard_normal((n_nodes, 3))
    weight = mass[:, None]
    motion /= np.sqrt((weight * motion**2).sum())
    before, off, diagonal, beside, largest = 0.0 * motion, 0.0, [], [], 0.0
    for count in range(1, min(MOST, 3 * n_nodes) + 1):
        image = product(motion) - off * before
        diagonal.append(float((weight * image * motion).sum()))
        image -= diagonal[-1] * motion
        off = float(np.sqrt((weight * image**2).sum()))
        value = float(eigvalsh_tridiagonal(np.array(diagonal), np.array(beside))[-1])
        still = count >= LEAST and abs(value - largest) < TIGHT * value
        if still or off <= 1e-12 * value:
            return _raised(value)
        largest = value
        beside.append(off)
        before, motion = motion, image / off
    return _raised(largest)


def _raised(value):
    """Return the next value of a fixed sequence."""
    return float(GRID ** np.ceil(np.log(ABOVE * value) / np.log(GRID)))
