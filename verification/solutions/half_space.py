"""Elastic half space in plane strain: line loads, line explosions, waves bound to its surface.

Depth z is positive down, fields vary as e^(ikx - iwt), potentials as e^(-nu z), with
nu_c = sqrt(k2 - w2/c2). Derived from u = grad phi + curl psi; R is the function of Rayleigh,
R = q2 - 4 k2 nu_a nu_b, q = 2 k2 - w2/b2.
"""

import numpy as np
from scipy.optimize import brentq

LENGTHS = 4.0
WAVENUMBERS = 6.0


def rayleigh_function(k, omega, cp, cs):
    """Return R, q and both nu for wave numbers and frequencies that may be complex."""
    nu_a, nu_b = (np.sqrt(k**2 - (omega / c) ** 2 + 0j) for c in (cp, cs))
    q = 2.0 * k**2 - (omega / cs) ** 2
    return q**2 - 4.0 * k**2 * nu_a * nu_b, q, nu_a, nu_b


def surface_motion(spectrum_of, times, distance, material, depth=None):
    """Return velocity (n, 2) on the surface, away from the source and down.

    Parameters
    ----------
    spectrum_of : callable
        Complex angular frequency (m,) to the transform of the source, int f e^(iwt) dt, in N/m
        for a load pushing down or N m/m for an explosion.
    times : (n,) float64, s
        Even, from zero on.
    distance : float, m
    material : Material
    depth : float or None, m
        Of a line explosion; None: a line load on the surface.

    Notes
    -----
    Discrete wave number, complex frequency (Bouchon 1981).
    """
    cp, cs, shear = material.cp, material.cs, material.shear
    n, dt = 2 * len(times), times[1] - times[0]
    fade = 2.0 * np.pi / (n * dt)
    omega = 2.0 * np.pi * np.fft.fftfreq(n, dt) + 1j * fade
    omega = omega[: n // 2 + 1].copy()
    omega[-1] = abs(omega[-1].real) + 1j * fade
    source = spectrum_of(omega)
    length = LENGTHS * cp * n * dt + 2.0 * distance
    largest = WAVENUMBERS * np.pi * 0.25 / (dt * cs)
    k = 2.0 * np.pi / length * (np.arange(int(largest * length / (2.0 * np.pi))) + 0.5)
    motion = np.zeros((len(omega), 2), dtype=complex)
    loud = np.abs(source) > 1e-9 * np.abs(source).max()
    for row in np.flatnonzero(loud):
        w = omega[row]
        r, q, nu_a, nu_b = rayleigh_function(k, w, cp, cs)
        square = (w / cs) ** 2
        if depth is None:
            down = -nu_a * square / (shear * r)
            along = -1j * k * (q - 2.0 * nu_a * nu_b) / (shear * r)
        else:
            d = -np.exp(-nu_a * depth) / (2.0 * nu_a * material.density * cp**2)
            down, along = -2.0 * nu_a * q * square * d / r, -4j * k * nu_a * nu_b * square * d / r
        motion[row] = (
            np.sum(1j * along * np.sin(k * distance)), np.sum(down * np.cos(k * distance))
        )  # fmt: skip
    motion *= (-1j * omega * source)[:, None] * 2.0 / length
    values = np.fft.irfft(np.conj(motion), n, axis=0)[: len(times)] / dt
    return values * np.exp(fade * times)[:, None]


def bound_frequency(wavelength, material, kind="free", stiffness=0.0):
    """Return the angular frequency of a wave bound to a surface or to a joint of stiffness.

    ``kind`` is "free", "symmetric" (normal stiffness) or "antisymmetric" (shear stiffness).
    """
    k, cp, cs = 2.0 * np.pi / wavelength, material.cp, material.cs

    def miss(speed):
        r, _, nu_a, nu_b = rayleigh_function(k, k * speed, cp, cs)
        nu = nu_b if kind == "antisymmetric" else nu_a
        return (r - 2.0 * stiffness / material.shear * (k * speed / cs) ** 2 * nu).real

    return k * brentq(miss, 0.5 * cs, (1.0 - 1e-9) * cs)


def bound_mode(x, depth, omega, wavelength, material, kind):
    """Return the displacement (n, 2), along and down, of a standing bound wave at rest."""
    k = 2.0 * np.pi / wavelength
    _, q, nu_a, nu_b = (part.real for part in rayleigh_function(k, omega, material.cp, material.cs))
    if kind == "antisymmetric":
        a, b = 2.0 * k * nu_b / q, 1.0
        along = -k * a * np.exp(-nu_a * depth) + nu_b * b * np.exp(-nu_b * depth)
        down = -nu_a * a * np.exp(-nu_a * depth) + k * b * np.exp(-nu_b * depth)
        return np.stack([along * np.cos(k * x), -down * np.sin(k * x)], axis=1)
    a, b = 1.0, -2.0 * k * nu_a / q
    along = -(k * a * np.exp(-nu_a * depth) + nu_b * b * np.exp(-nu_b * depth))
    down = -nu_a * a * np.exp(-nu_a * depth) - k * b * np.exp(-nu_b * depth)
    return np.stack([along * np.sin(k * x), down * np.cos(k * x)], axis=1)
