"""Closed forms of Mohr-Coulomb ground; compression positive, as they are written in print."""

import numpy as np


def flow_number(tangent):
    """Return N = (1 + sin)/(1 - sin) of an angle given by its tangent."""
    return (tangent + np.hypot(1.0, tangent)) ** 2


def triaxial_strength(confining, cohesion, friction):
    """Return the largest axial stress under a confining pressure: N p + 2 c sqrt(N)."""
    n = flow_number(friction)
    return n * confining + 2.0 * cohesion * np.sqrt(n)


def yielded_radius(radius, far, inner, cohesion, friction):
    """Return the radius of yielded ground around a round hole; Salencon (1969).

    Parameters
    ----------
    radius : float, m
    far, inner : float, Pa
        Pressure of the ground far away, the same all round, and in the hole.
    cohesion : float, Pa
    friction : float, tangent
    """
    n = flow_number(friction)
    tip = 2.0 * cohesion * np.sqrt(n) / (n - 1.0)
    return radius * (2.0 / (n + 1.0) * (far + tip) / (inner + tip)) ** (1.0 / (n - 1.0))


def stress_around_hole(places, radius, far, inner, cohesion, friction):
    """Return radial and hoop pressure (n,) in Pa at distances (n,) from the axis of the hole."""
    n = flow_number(friction)
    unconfined = 2.0 * cohesion * np.sqrt(n)
    tip = unconfined / (n - 1.0)
    edge = yielded_radius(radius, far, inner, cohesion, friction)
    inside = (inner + tip) * (np.asarray(places) / radius) ** (n - 1.0)
    at_edge = (2.0 * far - unconfined) / (n + 1.0)
    fall = (far - at_edge) * (edge / np.asarray(places)) ** 2
    plastic = np.asarray(places) < edge
    radial = np.where(plastic, inside - tip, far - fall)
    return radial, np.where(plastic, n * inside - tip, far + fall)


def strip_strength(cohesion):
    """Return the pressure that a strip footing bears on weightless ground without friction."""
    return (2.0 + np.pi) * cohesion
