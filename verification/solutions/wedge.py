"""SH waves at a wedge with free faces, and at a bench of the same edges.

Sommerfeld's series, as in F. J. Sanchez-Sesma, "Diffraction of elastic SH waves by wedges",
Bull. Seismol. Soc. Am. 75 (1985) 1435-1446: at the edge of a wedge of the angle alpha a wave has
2 pi/alpha times its amplitude in the full space.
"""

import numpy as np
from scipy.special import jv


def transfer(wavenumber, distance, position, source, angle):
    """Return the motion (n,) at a point of a wedge over that of the incident wave at its edge.

    Parameters
    ----------
    wavenumber : (n,) float64, 1/m
    distance : float, m, from the edge
    position, source, angle : float, rad
        Direction of the point, direction from which the wave comes, and angle of the ground; all
        from the same face.

    Notes
    -----
    ``2 pi/alpha sum_n e_n i^nu J_nu(k r) cos(nu theta) cos(nu theta0)`` with ``nu = n pi/alpha``,
    ``e_0 = 1``, else 2, for the time factor exp(i omega t).
    """
    argument = np.asarray(wavenumber, dtype=float) * distance
    count = int(1.5 * argument.max(initial=0.0) * angle / np.pi) + 40
    order = np.arange(count) * np.pi / angle
    weight = np.where(order == 0.0, 1.0, 2.0) * np.exp(0.5j * np.pi * order)
    weight *= np.cos(order * position) * np.cos(order * source)
    return 2.0 * np.pi / angle * (jv(order, argument[:, None]) @ weight)


def bench_motion(times, pulse, height, speed):
    """Return the motion (2, n) of toe and crest of an upright bench under vertical SH waves.

    Exact until the wave that the top reflects has been diffracted by the other edge: ``height``
    over ``speed`` after the wave meets the crest for the crest, as long for the toe.

    Parameters
    ----------
    times : (n,) float64, s, equidistant from 0
    pulse : (n,) float64
        Incident motion at the level of the toe, far from it.
    height, speed : float, m and m/s
    """
    count = 8 * len(times)  # a late wrap of the slowly decaying diffracted wave
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, times[1] - times[0])
    spectrum = np.fft.rfft(pulse, count)
    audible = np.abs(spectrum) > 1e-9 * np.abs(spectrum).max()
    gains = np.zeros((2, len(omega)), dtype=complex)
    ground = 1.5 * np.pi
    for row, (distance, factor) in enumerate(((0.0, 1.0), (height, 2.0))):
        gains[row, audible] = factor * transfer(
            omega[audible] / speed, distance, ground, 0.5 * np.pi, ground
        )
    return np.fft.irfft(gains * spectrum, count)[:, : len(times)]
