"""Full space: motion of a moment tensor and of a point force in unbounded rock, in closed form.

Sources: Stokes (1849); Aki & Richards (2002), equations (4.23) and (4.29).
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from .material import Material
from .source import TimeFunction

PADDED = 4  # samples, of zero before a time function


def moment_motion(
    rate: TimeFunction, tensor: np.ndarray, offsets: np.ndarray, times: np.ndarray, rock: Material
) -> np.ndarray:
    """Return the velocity of a moment tensor source in unbounded rock; theory.md (5.23).

    Parameters
    ----------
    rate : TimeFunction
        Moment rate, N m/s.
    tensor : (3, 3) float64
        Symmetric; multiplies the rate.
    offsets : (n, 3) float64, m
        Of points from the source, none of them zero.
    times : (m,) float64, s
    rock : Material

    Returns
    -------
    (n, m, 3) float64, m/s

    Examples
    --------
    >>> rock = Material.from_speeds(2600.0, 4000.0, 2300.0)
    >>> bell = TimeFunction(1e9 * np.sin(np.pi * np.arange(101) / 100) ** 2, 1e-3)
    >>> at = np.array([[30.0, 40.0, 0.0]])
    >>> motion = moment_motion(bell, np.eye(3), at, np.array([0.05]), rock)
    >>> motion.shape, bool(np.isclose(motion[0, 0, 1] / motion[0, 0, 0], 4.0 / 3.0))
    ((1, 1, 3), True)
    """
    distance = np.linalg.norm(offsets, axis=1)[:, None]
    ray = offsets / distance
    traction, trace = ray @ tensor, float(np.trace(tensor))
    along = ray * np.sum(ray * traction, axis=1, keepdims=True)
    history = _History(rate, times)
    p, s = distance / rock.cp, distance / rock.cs
    outer, inner = 15.0 * along - 3.0 * ray * trace - 6.0 * traction, traction
    middle = 6.0 * along - ray * trace - 2.0 * traction
    parts = (
        (history.between(p, s) / distance**4, outer),
        (history.at(p) / (rock.cp * distance) ** 2, middle),
        (-history.at(s) / (rock.cs * distance) ** 2, middle - inner),
        (history.at(p, 1) / (rock.cp**3 * distance), along),
        (-history.at(s, 1) / (rock.cs**3 * distance), along - inner),
    )
    motion = sum(factor[..., None] * pattern[:, None] for factor, pattern in parts)
    return motion / (4.0 * np.pi * rock.density)


def force_motion(
    history: TimeFunction,
    direction: np.ndarray,
    offsets: np.ndarray,
    times: np.ndarray,
    rock: Material,
) -> np.ndarray:
    """Return the velocity of a point force in unbounded rock; theory.md (5.24).

    Parameters
    ----------
    history : TimeFunction
        Force, N.
    direction : (3,) float64
        Its length multiplies the history.
    offsets, times, rock
        As in `moment_motion`.

    Returns
    -------
    (n, m, 3) float64, m/s
    """
    distance = np.linalg.norm(offsets, axis=1)[:, None]
    ray, direction = offsets / distance, np.asarray(direction, dtype=float)
    along = ray * (ray @ direction)[:, None]
    slope = _History(history, times, 1)
    p, s = distance / rock.cp, distance / rock.cs
    parts = (
        (slope.between(p, s) / distance**3, 3.0 * along - direction),
        (slope.at(p) / (rock.cp**2 * distance), along),
        (-slope.at(s) / (rock.cs**2 * distance), along - direction),
    )
    motion = sum(factor[..., None] * pattern[:, None] for factor, pattern in parts)
    return motion / (4.0 * np.pi * rock.density)


class _History:
    """Time function or a derivative of it at retarded times, and its first moment over delays."""

    def __init__(self, function, times, slope=0):
        """Integrate and differentiate the spline through the samples; zero before them."""
        self.times, self.slope = np.asarray(times, dtype=float), slope
        values = np.pad(function.values, (PADDED, 0))
        values = np.pad(values, (0, PADDED), mode="edge" if function.held else "constant")
        self.start = function.start - PADDED * function.dt
        self.end = self.start + function.dt * (len(values) - 1)
        spline = make_interp_spline(np.linspace(self.start, self.end, len(values)), values, k=5)
        self.of = {k: spline.derivative(k) for k in (0, 1, 2)}
        self.of |= {-k: spline.antiderivative(k) for k in (1, 2)}

    def at(self, delay, order=0):
        """Return the function, a derivative or an integral (n, m) of it after delays (n, 1)."""
        return self._after(self.times - delay, order)

    def between(self, first, last):
        """Return the integral over delays of the delay times the function after it, (n, m)."""
        early, late = self.times - first, self.times - last
        total = first * self._after(early, -1) - last * self._after(late, -1)
        return total + self._after(early, -2) - self._after(late, -2)

    def _after(self, times, order):
        """Return a derivative or integral at times; the samples end with what they hold."""
        order += self.slope
        value = self.of[order](np.clip(times, self.start, self.end))
        value = np.where((order > 0) & (times > self.end), 0.0, value)
        beyond = np.maximum(times - self.end, 0.0)
        for k in range(1, 1 - order):
            value += beyond**k / k * float(self.of[order + k](self.end))
        return np.where(times < self.start, 0.0, value)
