"""Waves and vibrations that fade, in closed form; convention e^(-i omega t).

Kjartansson (1979), J. Geophys. Res. 84, for constant Q; the generalised Maxwell body of Emmerich
and Korn (1987), Geophysics 52; the rest follows from the equation of motion as stated.
"""

import numpy as np


def constant_q_modulus(quality, frequency, reference):
    """Return the complex modulus over the square of the reference speed times density, (n,).

    ``M = M0 (-i f/f0)^(2 g)`` with ``g = arctan(1/Q)/pi`` has ``Re M/-Im M = Q`` at every
    frequency; M0 is such that the phase speed at the reference is the one given.
    """
    g = np.arctan(1.0 / quality) / np.pi
    power = (-1j * np.asarray(frequency) / reference) ** (2.0 * g)
    return power * np.cos(0.5 * np.pi * g) ** 2


def maxwell_modulus(rates, shares, frequency):
    """Return the modulus of a generalised Maxwell body over its unrelaxed one, (n,).

    Parameters
    ----------
    rates, shares : (n_mechanisms,) float64, 1/s and 1
    frequency : (n,) float64, Hz
    """
    turn = -2j * np.pi * np.asarray(frequency, dtype=float)[:, None]
    return 1.0 - np.sum(np.asarray(shares) * rates / (rates + turn), axis=1)


def wave_number(modulus, density, frequency):
    """Return the complex wave number in 1/m of a plane wave; its imaginary part is positive."""
    return 2.0 * np.pi * np.asarray(frequency) * np.sqrt(density / modulus)


def quality(number, frequency):
    """Return the quality factor Re M/-Im M of waves with given complex wave numbers."""
    modulus = (frequency / number) ** 2
    return -modulus.real / modulus.imag


def discrete_wave_number(body, density, frequency, edge, dt):
    """Return the wave number of a column of edges with lumped mass, marched by steps.

    ``body(f)`` is the complex modulus in Pa; the trapezoidal memory meets it at the frequency
    ``tan(pi f dt)/(pi dt)``, and ``4/h^2 sin^2(kh/2) M = rho 4/dt^2 sin^2(omega dt/2)``.
    """
    half = np.pi * np.asarray(frequency) * dt
    turn = 2.0 / dt * np.sin(half)
    number = turn * np.sqrt(density / body(np.tan(half) / (np.pi * dt)))
    return 2.0 / edge * np.arcsin(0.5 * edge * number)


def rayleigh_ratio(frequency, ratio, central, mass=True, stiffness=True):
    """Return the damping ratio (n,) of Rayleigh damping: half of it from each part at ``central``.

    ``ratio/2 (central/f + f/central)``; a part that does not act adds nothing.
    """
    share = np.asarray(frequency) / central
    return 0.5 * ratio * (mass / share + stiffness * share)


def damped_oscillator(natural, alpha, beta, corner):
    """Return ratio of critical damping and natural frequency (1/s) of an oscillator.

    Spring and mass of natural frequency ``natural`` (1/s) with mass damping ``alpha`` and stiffness
    damping ``beta`` of motion that a first-order filter of corner ``corner`` (Hz) has passed:
    ``r^2 + alpha r + natural^2 (1 + beta w r/(r + w)) = 0``, ``w = 2 pi corner``.
    """
    w = 2.0 * np.pi * corner
    spring = natural**2
    cubic = [1.0, alpha + w, alpha * w + spring * (1.0 + beta * w), spring * w]
    root = max(np.roots(cubic), key=lambda r: r.imag)
    return float(-root.real / abs(root)), float(abs(root))
