"""Slip of a plane without friction beside a line explosion, in closed form.

Source: Cagniard's method, as Day (1985) puts the problem. The plane lets no normal motion and no
shear stress through, so its slip is that of two free surfaces which move against each other.
"""

import numpy as np


def step_slip(times, distance, height, material):
    """Return slip times the root of ``t^2 - r^2/cp^2`` by a step of 1 N m/m, (n,) m s.

    Parameters
    ----------
    times : (n,) float, s
        From the arrival of the P wave on.
    distance, height : float, m
        Along the plane from the foot of the source, and of the source over the plane.
    material : Material

    Notes
    -----
    ``2/(pi rho a^2 b^2) Re[p n_a n_b/R]``, ``R = (1/b^2 - 2 p^2)^2 + 4 p^2 n_a n_b``,
    ``n_c = sqrt(1/c^2 - p^2)``, ``p = [x t + i h sqrt(t^2 - r^2/a^2)]/r^2``, a = cp, b = cs.
    """
    square = distance**2 + height**2
    root = np.sqrt(np.maximum(times**2 - square / material.cp**2, 0.0))
    p = (distance * times + 1j * height * root) / square
    n_a, n_b = (np.sqrt(1.0 / c**2 - p**2) for c in (material.cp, material.cs))
    rayleigh = (1.0 / material.cs**2 - 2.0 * p**2) ** 2 + 4.0 * p**2 * n_a * n_b
    size = 2.0 / (np.pi * material.density * material.cp**2 * material.cs**2)
    return size * (p * n_a * n_b / rayleigh).real


def slip(times, distance, height, moment, material, slope=0):
    """Return the slip (n,) in m, or its rate with ``slope`` 1, of the side of the source.

    Parameters
    ----------
    times : (n,) float, s
    distance, height : float, m
    moment : callable
        ``moment(times, slope)`` in N m/m and its slopes, zero before time zero, a `Bell`.
    material : Material

    Notes
    -----
    The root of `step_slip` is the variable of the convolution, ``t' dt' = s ds``, so that nothing
    is singular.
    """
    arrival = np.hypot(distance, height) / material.cp
    points, weights = np.polynomial.legendre.leggauss(800)
    last = np.sqrt(np.maximum(np.asarray(times, dtype=float) ** 2 - arrival**2, 0.0))
    s = 0.5 * last[:, None] * (points + 1.0)
    since = np.hypot(s, arrival)
    passing = moment(times[:, None] - since, slope + 1) / since
    return 0.5 * last * ((passing * step_slip(since, distance, height, material)) @ weights)
