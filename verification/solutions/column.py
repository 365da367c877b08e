"""Far field of a long charge that detonates from one end, in closed form.

Source: Heelan (1953) for a short length of pressed hole; summed along the hole as sub-sources.
"""

import numpy as np


def radiation(angles, omega, length, detonation_speed, material):
    """Return what a column of unit mean moment sends out as P and as SV waves, two (n,) complex.

    Parameters
    ----------
    angles : (n,) float, rad
        From the way of detonation.
    omega : float, rad/s
    length : float, m
    detonation_speed : float, m/s
    material : Material

    Notes
    -----
    Motion is ``-i w/(4 pi rho c^3 r)`` times this and the moment, along the ray for P and towards
    growing angles for SV: ``(l + 2m)(1 - 2 (cs/cp)^2 cos^2 a)`` and ``m sin 2a``, over the mean
    ``l + 4m/3`` of the diagonal, times ``e^(ix) sin(x)/x``, ``x = w L/2 (1/D - cos(a)/c)``, from
    the primed end on.
    """
    lame, shear = material.first_lame, material.shear
    stiffness = lame + 2.0 * shear
    patterns = (
        stiffness * (1.0 - 2.0 * (material.cs / material.cp) ** 2 * np.cos(angles) ** 2),
        shear * np.sin(2.0 * angles),
    )
    waves = []
    for pattern, speed in zip(patterns, (material.cp, material.cs), strict=True):
        x = 0.5 * omega * length * (1.0 / detonation_speed - np.cos(angles) / speed)
        waves.append(pattern / (lame + 4.0 / 3.0 * shear) * np.exp(1j * x) * np.sinc(x / np.pi))
    return waves


def far_field(places, forces, rays, across, omega, material):
    """Return what forces of one frequency send out as P and as SV waves, as `radiation` does.

    Parameters
    ----------
    places : (n_forces, 3) float, m
        From the primed end.
    forces : (n_forces, 3) complex
        Over the moment.
    rays, across : (n, 3) float
        Unit vectors of the rays, and those that SV waves move along.
    omega : float, rad/s
    material : Material

    Notes
    -----
    ``sum F e^(-i w ray.x/c)`` along the ray or across it, over ``-i w/c``.
    """
    waves = []
    for axis, speed in ((rays, material.cp), (across, material.cs)):
        k = omega / speed
        phases = np.exp(-1j * k * rays @ np.transpose(places))
        waves.append(np.einsum("ra,ax,rx->r", phases, forces, axis) / (-1j * k))
    return waves
