"""Plane waves at the free surface of a half space."""

import numpy as np


def plane_field(wave, angle, cp, cs):
    """Return the waves of a half space that a plane wave of unit velocity meets from below.

    Parameters
    ----------
    wave : str
        "P", "SV" or "SH".
    angle : float, rad
        Between its path and the normal of the surface.
    cp, cs : float, m/s

    Returns
    -------
    list of (slowness (3,), motion (3,))
        Incident wave first; axes along the surface in the plane of the path, across that plane,
        and outwards. All have the same phase at the origin on the surface.

    Notes
    -----
    Aki & Richards (2002), section 5.2, for displacements with z downwards; their third axis is
    turned here. Good below the critical angle.
    """
    if wave == "SH":
        s = np.array([np.sin(angle), 0.0, np.cos(angle)]) / cs
        return [(s, np.array([0.0, 1.0, 0.0])), (s * [1.0, 1.0, -1.0], np.array([0.0, 1.0, 0.0]))]
    p = np.sin(angle) / (cp if wave == "P" else cs)
    sin_p, sin_s = p * cp, p * cs
    cos_p, cos_s = np.sqrt(1.0 - sin_p**2), np.sqrt(1.0 - sin_s**2)
    bend, product = 1.0 / cs**2 - 2.0 * p**2, 4.0 * p**2 * cos_p * cos_s / (cp * cs)
    total = bend**2 + product
    if wave == "P":
        back_p = (product - bend**2) / total
        back_s = 4.0 * cp / cs * p * cos_p / cp * bend / total
        first = np.array([p, 0.0, cos_p / cp]), np.array([sin_p, 0.0, cos_p])
    else:
        back_p = 4.0 * cs / cp * p * cos_s / cs * bend / total
        back_s = (bend**2 - product) / total
        first = np.array([p, 0.0, cos_s / cs]), np.array([cos_s, 0.0, -sin_s])
    return [
        first,
        (np.array([p, 0.0, -cos_p / cp]), back_p * np.array([sin_p, 0.0, -cos_p])),
        (np.array([p, 0.0, -cos_s / cs]), back_s * np.array([cos_s, 0.0, sin_s])),
    ]


def surface_gain(wave, angle, cp, cs):
    """Return the velocity (3,) of the surface per unit of a wave; axes as in `plane_field`."""
    return sum(motion for _, motion in plane_field(wave, angle, cp, cs))
