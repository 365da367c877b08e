"""Explosion under the free surface of a half-space: sums over wavenumbers, frequency by frequency.

Independent of `pyblast.model.half_space`: depths down, no tapering of wavenumbers or frequencies.
"""

import numpy as np
from scipy.special import j0, j1

from .full_space import explosion


def surface_motion(rate, highest, depth, distances, times, rock, window=0.9):
    """Return the velocity (n_distances, n, 2) on the surface, away from the source and up.

    Parameters
    ----------
    rate : Bell
        Moment rate.
    highest : float, Hz
    depth : float, m
    distances : (n_distances,) float64, m
    times : (n,) float64, s
        From 0 to less than the window in s.
    rock : Material

    Notes
    -----
    Potentials of P and SV waves, complex frequency (Bouchon 1981). At slow times Mogi (1958).
    """
    damping, spacing = 6.0 / window, 4e-4
    omega = 2.0 * np.pi / window * (np.arange(int(highest * window)) + 0.5)
    k = (np.arange(int(20.0 / depth / spacing)) + 0.5) * spacing
    sampled = np.linspace(0.0, 2.2 * rate.peak, 2001)
    values = rate(sampled) * (sampled[1] - sampled[0])
    total = np.zeros((len(distances), len(omega), 2), dtype=complex)
    for n, s in enumerate(damping + 1j * omega):
        source = values @ np.exp(-s * sampled)
        nu, eta = (np.sqrt(k**2 + (s / c) ** 2) for c in (rock.cp, rock.cs))
        g, h = k**2 + eta**2, 4.0 * nu * eta * k**2
        a = -source / (4.0 * np.pi * rock.density * rock.cp**2) * k / nu * np.exp(-nu * depth)
        b = -a * (g**2 + h) / (g**2 - h)
        c = -2.0 * nu * (a - b) / g
        for m, away in enumerate(distances):
            total[m, n, 0] = -(k * j1(k * away) * (b - eta * c)).sum() * spacing
            total[m, n, 1] = (j0(k * away) * (nu * b - k**2 * c)).sum() * spacing
    waves = np.exp((damping + 1j * omega) * np.asarray(times)[:, None]) * 2.0 / window
    velocity = np.real(np.einsum("mnc,tn->mtc", total, waves))
    for m, away in enumerate(distances):
        velocity[m] += explosion(times, (away, 0.0, depth), rate, rock)[:, [0, 2]]
    return velocity
