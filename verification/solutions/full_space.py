"""Motion of a full space by a point explosion and a point force, in closed form.

Sources: Stokes (1849); Aki & Richards (2002), equations (4.4), (4.23) and (4.29).
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Bell:
    """A bell whose derivative, the far field of a source that follows it, has one dominant tone.

    Parameters
    ----------
    dominant : float, Hz
        Where the spectrum of the derivative is largest.
    """

    dominant: float

    @property
    def peak(self):
        """When the bell is largest [s]; it is below 1e-5 of that at zero and at twice the time."""
        return 1.1 / self.dominant

    def __call__(self, times, slope=0):
        """Return the bell at times, or its first or second derivative in time."""
        rate = np.sqrt(2.0) * np.pi * self.dominant
        x = rate * (times - self.peak)
        forms = (1.0, -2.0 * rate * x, rate**2 * (4.0 * x**2 - 2.0))
        return forms[slope] * np.exp(-(x**2))

    def samples(self):
        """Return the bell at steps of a hundredth of the dominant period, and that step."""
        dt = 0.01 / self.dominant
        return self(np.arange(0.0, 2.2 * self.peak, dt)), dt


def explosion(times, offset, rate, material):
    """Return the velocity (n, 3) by an isotropic moment whose rate is a `Bell` in N m/s.

    Parameters
    ----------
    times : (n,) float, s
    offset : (3,) float, m
        From the source.
    rate : Bell
    material : Material

    Notes
    -----
    ``v = [M'(t - r/cp)/r^2 + M''(t - r/cp)/(cp r)]/(4 pi rho cp^2)`` along the ray.
    """
    distance = np.linalg.norm(offset)
    retarded = times - distance / material.cp
    motion = rate(retarded) / distance**2 + rate(retarded, 1) / (material.cp * distance)
    motion /= 4.0 * np.pi * material.density * material.cp**2
    return np.outer(motion, np.asarray(offset) / distance)


def point_force(times, offset, direction, force, material, slope=1):
    """Return the motion (n, 3) by a force of 1 N times a `Bell` along a unit direction.

    Parameters
    ----------
    times : (n,) float, s
    offset, direction : (3,) float
    force : Bell
    material : Material
    slope : int
        1 for velocity, 0 for displacement.
    """
    distance = np.linalg.norm(offset)
    ray = np.asarray(offset) / distance
    along = np.outer(ray, ray) @ direction
    delays = np.linspace(distance / material.cp, distance / material.cs, 2001)
    passing = delays * force(times[:, None] - delays, slope)
    near = np.trapezoid(passing, delays, axis=1)[:, None] * (3.0 * along - direction)
    p_wave = force(times - delays[0], slope)[:, None] * along / material.cp**2
    s_wave = force(times - delays[-1], slope)[:, None] * (along - direction) / material.cs**2
    motion = near / distance**3 + (p_wave - s_wave) / distance
    return motion / (4.0 * np.pi * material.density)


def moment(times, offset, tensor, rate, material):
    """Return the velocity (n, 3) by a moment tensor whose rate is a `Bell` in N m/s.

    Parameters
    ----------
    times : (n,) float, s
    offset : (3,) float, m
        From the source.
    tensor : (3, 3) float
    rate : Bell
    material : Material

    Notes
    -----
    Near, intermediate and far fields: Aki & Richards (2002), (4.29), differentiated in time.
    """
    distance = np.linalg.norm(offset)
    ray = np.asarray(offset) / distance
    traction, trace = tensor @ ray, np.trace(tensor)
    along = ray * (ray @ traction)
    p, s = distance / material.cp, distance / material.cs
    delays = np.linspace(p, s, 401)
    passing = delays * rate(times[:, None] - delays)
    near = np.trapezoid(passing, delays, axis=1)
    motion = np.outer(near, 15.0 * along - 3.0 * ray * trace - 6.0 * traction) / distance**4
    middle = 6.0 * along - ray * trace - 2.0 * traction
    motion += np.outer(rate(times - p), middle) / (material.cp * distance) ** 2
    motion -= np.outer(rate(times - s), middle - traction) / (material.cs * distance) ** 2
    motion += np.outer(rate(times - p, 1), along) / (material.cp**3 * distance)
    motion -= np.outer(rate(times - s, 1), along - traction) / (material.cs**3 * distance)
    return motion / (4.0 * np.pi * material.density)


def force_spectrum(omega, offset, material):
    """Return displacement over force, (n, 3, 3) m/N, at angular frequencies, with e^(-i omega t).

    Parameters
    ----------
    omega : (n,) complex, rad/s
        A positive imaginary part makes the waves fade.
    offset : (3,) float, m
    material : Material

    Notes
    -----
    ``G = [k_s^2 g(k_s) I + grad grad (g(k_s) - g(k_p))]/(rho omega^2)``, g(k) = e^(ikr)/(4 pi r).
    """
    distance = np.linalg.norm(offset)
    ray = np.asarray(offset) / distance
    omega = np.asarray(omega)[:, None, None]
    terms = 0.0
    for speed, sign in ((material.cs, 1.0), (material.cp, -1.0)):
        k = omega / speed
        wave = np.exp(1j * k * distance) / (4.0 * np.pi * distance)
        first = wave * (1j * k - 1.0 / distance) / distance
        second = wave * (2.0 / distance**2 - 2j * k / distance - k**2)
        curved = first * np.eye(3) + (second - first) * np.outer(ray, ray)
        terms = terms + sign * curved + (k**2 * wave * np.eye(3) if sign > 0.0 else 0.0)
    return terms / (material.density * omega**2)
