"""Motion of a half space under a pressure that runs over it at a constant speed."""

import numpy as np

from .half_space import rayleigh_function


def coupling(speed, material):
    """Return the velocity into the ground over the pressure, complex, m/s/Pa.

    Parameters
    ----------
    speed : float, m/s
        Of the pressure ``p e^(ik(x - speed t))``, in a half space from minus infinity on.
    material : Material

    Notes
    -----
    ``i w nu_a k_b^2/(mu R)`` with ``k = w/speed``: the same at all frequencies. A frequency with a
    small positive imaginary part chooses the waves that leave the surface.
    """
    omega = 1.0 + 1e-12j
    k = omega.real / speed
    r, _, nu_a, _ = rayleigh_function(k, omega, material.cp, material.cs)
    return 1j * omega * nu_a * (omega / material.cs) ** 2 / (material.shear * r)


def load_that_sets_out(pulse, times, distance, speed, material):
    """Return the velocity into the ground (n,) under a pressure that sets out both ways from zero.

    Parameters
    ----------
    pulse : callable
        Pressure over time, Pa, zero before time zero.
    times : (n,) float, s
        Even, from zero on.
    distance : float, m
    speed : float, m/s
    material : Material

    Notes
    -----
    ``int e^(iw|x|/c_a - ikx) dx = 2 i q/(q^2 - k^2)``, ``q = w/c_a``: discrete wave numbers and
    complex frequencies (Bouchon 1981). Its pole at ``k = q`` is `coupling`.
    """
    n, dt = 2 * len(times), times[1] - times[0]
    fade = 2.0 * np.pi / (n * dt)
    omega = 2.0 * np.pi * np.fft.rfftfreq(n, dt) + 1j * fade
    source = np.exp(1j * np.outer(omega, times)) @ pulse(times) * dt
    length = 4.0 * material.cp * n * dt + 2.0 * distance
    loud = np.abs(source) > 1e-7 * np.abs(source).max()
    largest = 40.0 * omega[loud].real.max() / min(speed, material.cs)
    k = 2.0 * np.pi / length * (np.arange(int(largest * length / (2.0 * np.pi))) + 0.5)
    motion = np.zeros(len(omega), dtype=complex)
    for row in np.flatnonzero(loud):
        w, q = omega[row], omega[row] / speed
        r, _, nu_a, _ = rayleigh_function(k, w, material.cp, material.cs)
        answer = 1j * w * nu_a * (w / material.cs) ** 2 / (material.shear * r)
        motion[row] = np.sum(answer * 2j * q / (q**2 - k**2) * np.cos(k * distance))
    values = np.fft.irfft(np.conj(motion * source), n)[: len(times)] / dt
    return 2.0 / length * values * np.exp(fade * times)
