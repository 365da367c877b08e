"""Speed of Rayleigh waves of the first mode over layered ground, by thin layers."""

import numpy as np
from scipy import linalg

from ...errors import InputError

PER_WAVE, DEPTH = 24, 2.0


def rayleigh_speeds(frequencies, thickness, vs, poisson=0.4):
    """Return phase speeds of the first mode (n,) m/s.

    Parameters
    ----------
    frequencies : (n,) float, Hz
    thickness : (n_layers - 1,) float, m
        The last layer reaches down without end.
    vs : (n_layers,) float, m/s
    poisson : float
        Of all layers; density is the same in all and falls out.

    Notes
    -----
    Quadratic in the wave number, linear in depth between planes (Lysmer 1970; Kausel and Roesset
    1981), theory.md (15.5), linear in its square for (k u_x, i u_z);
    fixed two wavelengths down, with 24 elements.
    """
    thickness, vs = np.atleast_1d(np.asarray(thickness, float)), np.asarray(vs, float)
    if len(vs) != len(thickness) + 1 or (vs <= 0).any() or (thickness <= 0).any():
        raise InputError(
            f"rayleigh_speeds: need positive speeds, one more than thicknesses, got {vs} m/s and "
            f"{thickness} m"
        )
    return np.array([_speed(f, thickness, vs, poisson) for f in np.atleast_1d(frequencies)])


def _speed(frequency, thickness, vs, poisson):
    """Return the slowest mode's speed at one frequency."""
    depth = DEPTH * vs.max() / frequency
    share = np.linspace(0.0, 1.0, PER_WAVE + 1) ** 1.6
    planes = np.unique(np.concatenate([depth * share, np.cumsum(thickness)]))
    planes = planes[planes <= depth]
    heights, middles = np.diff(planes), 0.5 * (planes[1:] + planes[:-1])
    mu = vs[np.searchsorted(np.cumsum(thickness), middles)] ** 2
    lame = mu * 2.0 * poisson / (1.0 - 2.0 * poisson)
    a, b, g, m = _matrices(heights, lame, mu)
    stiff = g - (2.0 * np.pi * frequency) ** 2 * m
    x, z = slice(0, None, 2), slice(1, None, 2)
    zero = np.zeros_like(b[x, z])
    left = np.block([[stiff[x, x], zero], [b[z, x], stiff[z, z]]])
    right = np.block([[a[x, x], b[x, z]], [zero, a[z, z]]])
    squares = linalg.eigvals(linalg.solve(right, -left))
    real = np.abs(squares.imag) < 1e-6 * np.abs(squares.real)
    return 2.0 * np.pi * frequency / np.sqrt(np.max(squares.real[real]))


def _matrices(heights, lame, mu):
    """Return A, B, G, M of (k^2 A + k B + G - omega^2 M) u = 0 for (u_x, i u_z) at planes."""
    n = 2 * len(heights)
    a, b, g, m = (np.zeros((n + 2, n + 2)) for _ in range(4))
    for k, (h, la, s) in enumerate(zip(heights, lame, mu, strict=True)):
        at = slice(2 * k, 2 * k + 4)
        p, d = la + 2.0 * s, la - s
        mass = h / 6.0 * np.array([[2, 0, 1, 0], [0, 2, 0, 1], [1, 0, 2, 0], [0, 1, 0, 2]])
        a[at, at] += mass * np.tile([p, s], 2)
        m[at, at] += mass
        e = la + s
        b[at, at] += 0.5 * np.array([[0, d, 0, -e], [d, 0, e, 0], [0, e, 0, -d], [-e, 0, -d, 0]])
        g[at, at] += np.array(
            [[s, 0, -s, 0], [0, p, 0, -p], [-s, 0, s, 0], [0, -p, 0, p]]
        ) / h  # fmt: skip
    return a[:n, :n], b[:n, :n], g[:n, :n], m[:n, :n]
