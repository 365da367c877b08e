"""Motion around a spherical cavity under a pressure that changes in time, in closed form.

Sources: Sharpe (1942), Blake (1952); re-derived for any ratio of Poisson.
"""

import numpy as np


def corner(radius, material):
    """Return the angular frequency in rad/s and the damping ratio of the cavity's own motion."""
    return 2.0 * material.cs / radius, material.cs / material.cp


def cavity_motion(times, distance, radius, pressure, material):
    """Return radial displacement in m and velocity in m/s, each (n,).

    Parameters
    ----------
    times : (n,) float, s
    distance : float, m
        From the centre.
    radius : float, m
    pressure : callable
        ``pressure(times)`` and ``pressure(times, 1)``, its slope; zero before time zero, Pa.
    material : Material

    Notes
    -----
    ``u = -f'/(c r) - f/r^2`` at ``tau = t - (r - a)/c``, ``f'' + 2 zeta w0 f' + w0^2 f = -a p/rho``
    with ``w0 = 2 cs/a``, ``zeta = cs/c``, ``c = cp``; f is the response to a step of pressure,
    convolved with the slope of the pressure.
    """
    natural, damping = corner(radius, material)
    delay = (distance - radius) / material.cp
    fine = np.linspace(0.0, max(times.max() - delay, 0.0), 20001)
    step = fine[1]
    turn = natural * np.sqrt(1.0 - damping**2)
    fading = np.exp(-damping * natural * fine)
    size = -(radius / material.density) / natural**2
    still = fading * (np.cos(turn * fine) + damping * natural / turn * np.sin(turn * fine))
    by_step = (size * (1.0 - still), size * natural**2 / turn * fading * np.sin(turn * fine))
    slope = pressure(fine, 1)
    length = len(fine)
    n = 2 * length
    transform = np.fft.rfft(slope, n)
    f, f_rate = (np.fft.irfft(transform * np.fft.rfft(r, n), n)[:length] * step for r in by_step)
    f_twice = -radius / material.density * pressure(fine)
    f_twice = f_twice - 2.0 * damping * natural * f_rate - natural**2 * f
    displacement = -f_rate / (material.cp * distance) - f / distance**2
    velocity = -f_twice / (material.cp * distance) - f_rate / distance**2
    late = times - delay
    return np.interp(late, fine, displacement, left=0.0), np.interp(late, fine, velocity, left=0.0)
