"""Wear of rough walls and loss of closing joints, in closed form.

Barton (1982) for the wear; the loss is the difference of two areas under hyperbolas.
"""

import numpy as np

SLIP = np.log([1.0, 2.0, 4.0, 10.0, 25.0, 100.0])
LEFT = np.array([1.0, 0.85, 0.7, 0.5, 0.4, 0.0])


def barton_share(slip_over_peak):
    """Return the share of roughness left after a slip over its peak, between entries in log."""
    return float(np.interp(np.log(max(slip_over_peak, 1.0)), SLIP, LEFT))


def hyperbola_area(stiffness, most, closure):
    """Return the energy in J/m2 under ``p = k v/(1 - v/vm)`` up to a closure in m."""
    share = closure / most
    return stiffness * most**2 * (-np.log(1.0 - share) - share)


def unloading_area(stiffness, most, closure, left):
    """Return the energy in J/m2 that a fresh joint gives back when it opens again.

    It opens on the hyperbola that begins at ``left * closure``, has the same asymptote ``most``
    and passes through the end of loading.
    """
    pressure = stiffness * closure / (1.0 - closure / most)
    width, back = most - left * closure, closure * (1.0 - left)
    return hyperbola_area(pressure * (1.0 - back / width) / back, width, back)
