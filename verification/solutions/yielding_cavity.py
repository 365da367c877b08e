"""A spherical cavity in ground that yields, under a pressure that rises, along its radius alone."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Rise:
    """A pressure of one that rises smoothly and stays.

    Parameters
    ----------
    duration : float, s
    """

    duration: float

    def __call__(self, times):
        """Return the pressure at times (n,) s."""
        share = np.clip(np.asarray(times) / self.duration, 0.0, 1.0)
        return share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi)


def yielding_cavity(radius, pressure, distance, duration, material, cells=40):
    """Return times, radial velocity (n,) at a distance, and the radius up to which ground yielded.

    Parameters
    ----------
    radius : float, m
    pressure : callable
        Times to Pa.
    distance, duration : float, m and s
        The ground ends so far out that nothing comes back in time.
    material : Material
        With a cohesion, which is half of the largest difference of stresses; without friction.
    cells : int
        Along one radius.

    Notes
    -----
    Cells of linear motion along the radius, lumped mass, central differences; beyond the cohesion
    the difference of radial and hoop stress is cut back and the mean stays: exact for Tresca.
    """
    first, shear, cohesion = material.first_lame, material.shear, material.cohesion
    dr = radius / cells
    end = 0.5 * (distance + radius + material.cp * duration) + radius
    r = radius + dr * np.arange(int((end - radius) / dr))
    centre, volume = 0.5 * (r[1:] + r[:-1]), 4.0 / 3.0 * np.pi * np.diff(r**3)
    mass = 0.5 * material.density * (np.append(volume, 0.0) + np.append(0.0, volume))
    dt = 0.8 * dr / material.cp
    times = dt * np.arange(int(duration / dt))
    seen, at = np.zeros(len(times)), round((distance - radius) / dr)
    v, radial, hoop, broken = np.zeros(len(r)), *np.zeros((2, len(centre))), False
    for k, push in enumerate(4.0 * np.pi * radius**2 * pressure(times)):
        along, around = volume * radial / dr, volume * hoop / centre
        force = np.append(along - around, 0.0) - np.append(0.0, along + around)
        force[0] += push
        v += dt * force / mass
        seen[k] = v[at]
        stretch, widening = dt * np.diff(v) / dr, 0.5 * dt * (v[1:] + v[:-1]) / centre
        radial += (first + 2.0 * shear) * stretch + 2.0 * first * widening
        hoop += first * stretch + 2.0 * (first + shear) * widening
        excess = radial - hoop
        excess = excess - np.clip(excess, -2.0 * cohesion, 2.0 * cohesion)
        radial, hoop, broken = radial - excess / 1.5, hoop + excess / 3.0, broken | (excess != 0.0)
    return times + 0.5 * dt, seen, r[1:][broken].max(initial=radius)


def still_radius(radius, pressure, cohesion):
    """Return the radius up to which ground yields under a pressure that rises slowly.

    Notes
    -----
    ``p = (4 c/3) (1 + 3 ln(a_e/a))``: Hill (1950).
    """
    return radius * np.exp(max(0.0, 0.75 * pressure / cohesion - 1.0) / 3.0)


def source_spectrum(times, velocity, distance, frequencies, material):
    """Return the spectrum (n,) in m3 of what the far field moves by, without the near field.

    Parameters
    ----------
    times, velocity : (n,) float
        Radial, where the ground is elastic; evenly sampled from rest on.
    distance : float, m
    frequencies : (n,) float, Hz
    material : Material

    Notes
    -----
    ``v = g'/(c r) + g/r^2``, c = cp: the far field moves by ``g/(c r)``; at low frequencies its
    spectrum is the lasting ``r^2 u``.
    """
    dt, rate = times[1] - times[0], material.cp / distance
    fade, g = np.exp(-rate * dt), np.zeros(len(times))
    gain = (1.0 - fade) / rate * material.cp * distance
    for k in range(1, len(times)):
        g[k] = fade * g[k - 1] + gain * 0.5 * (velocity[k - 1] + velocity[k])
    waves = np.exp(2j * np.pi * np.outer(frequencies, times - times[0]))
    return np.abs(waves @ g) * dt


def corner_frequency(frequencies, spectrum):
    """Return where a spectrum first falls to half of its first value, Hz."""
    share = spectrum / spectrum[0]
    below = int(np.argmax(share < 0.5))
    return np.interp(-0.5, -share[below - 1 : below + 1], frequencies[below - 1 : below + 1])
