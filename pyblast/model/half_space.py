"""Half-space: motion of buried explosions, moment tensors and forces, by wavenumber integrals."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from .material import Material
from .source import TimeFunction

DAMPED = 6.0  # what repeats after the window is damped by e^-6 (complex frequency)
WINDOW = 1.3  # window over the time asked for
FAINTEST = 1e-4  # of the energy of acceleration, beyond the frequencies taken
DECAYED = 12.0  # decay over the path up and down, in powers of e, where the integrand ends
FASTER = 1.3  # wavenumbers over those of S waves, beyond the pole of Rayleigh waves
REPEATED = 1.2  # distance after which sources repeat, over the reach of P waves


class Radiation(NamedTuple):
    """Radiation of a source at a point that varies with azimuth as cos(m theta) or sin(m theta).

    Parameters
    ----------
    order : int
        m.
    force : (float, float)
        Away from the source along the azimuth of the wave, and down.
    tensor : (float, float, float)
        Moment along that azimuth, its couple with the vertical, and along the vertical.
    """

    order: int
    force: tuple[float, float] = (0.0, 0.0)
    tensor: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def incident(self, k, nu, eta):
        """Return amplitudes of P, SV and SH waves that go up, over 1/(density omega^2).

        At wavenumbers k (n,) with vertical ones nu of P and eta of S; theory.md (5.26).
        """
        (along, down), (level, couple, upright) = self.force, self.tensor
        pressure = 1j * k * (along - 2.0 * nu * couple) + nu * down
        pressure = pressure + k**2 * level - nu**2 * upright
        radial = along - 1j * k * level - eta * couple
        vertical = down - 1j * k * couple - eta * upright
        across = {0: 0.0 * k, 1: along - eta * couple, 2: -1j * k * level}[self.order]
        sheared = (k * vertical + 1j * eta * radial) / eta
        return -pressure / nu, sheared, across * (k**2 - eta**2) / eta


EXPLOSION = Radiation(0, tensor=(1.0, 0.0, 1.0))


def radiations(
    tensor: np.ndarray | None = None, force: Sequence[float] = (0.0, 0.0, 0.0)
) -> list[tuple[Radiation, float, float]]:
    """Return the parts of a source by azimuth, with their cosine and sine from east to north.

    Parameters
    ----------
    tensor : (3, 3) float64, optional
        Symmetric moment tensor, east, north, up.
    force : (3,) float

    Returns
    -------
    list of (Radiation, float, float)
        Without those that are zero.
    """
    m, f = np.zeros((3, 3)) if tensor is None else np.asarray(tensor, dtype=float), force
    own = Radiation(0, (0.0, -f[2]), (0.5 * (m[0, 0] + m[1, 1]), 0.0, m[2, 2]))
    parts = [
        (own, float(any((*own.force, *own.tensor))), 0.0),
        (Radiation(1, force=(1.0, 0.0)), f[0], f[1]),
        (Radiation(1, tensor=(0.0, 1.0, 0.0)), -m[0, 2], -m[1, 2]),
        (Radiation(2, tensor=(1.0, 0.0, 0.0)), 0.5 * (m[0, 0] - m[1, 1]), m[0, 1]),
    ]
    return [(part, float(c), float(s)) for part, c, s in parts if c or s]


def explosion(
    rate: TimeFunction,
    depth: float | None,
    distances: np.ndarray,
    depths: np.ndarray,
    times: np.ndarray,
    rock: Material,
) -> np.ndarray:
    """Return the velocity of an isotropic point source under a plane free surface.

    Parameters
    ----------
    rate : TimeFunction
        Moment rate, N m/s.
    depth : float or None, m
        Of the source; None: unbounded rock.
    distances : (n_distances,) float64, m
        Horizontal, from the source.
    depths : (n_depths,) float64, m
        Below the surface, or below the source where there is none; at no point that of the source.
    times : (n,) float64, s
    rock : Material

    Returns
    -------
    (n_distances, n_depths, n, 2) float64, m/s
        Away from the source and up, at all pairs of distances and depths.

    Notes
    -----
    The direct wave in closed form, the reflected ones by discrete wavenumbers at complex
    frequencies (Bouchon 1981); theory.md (5.19) to (5.22).
    """
    distances, depths = (np.atleast_1d(a).astype(float) for a in (distances, depths))
    below, times = depths - (depth or 0.0), np.asarray(times, dtype=float)
    away, below = np.broadcast_arrays(distances[:, None], below)
    velocity = direct_wave(rate, away, below, times, rock)
    if depth is not None:
        velocity += reflected_waves(rate, depth, distances, depths, times, rock)
    return velocity


def direct_wave(
    rate: TimeFunction,
    distances: np.ndarray,
    below: np.ndarray,
    times: np.ndarray,
    rock: Material,
) -> np.ndarray:
    """Return the velocity (..., n, 2) of `explosion` in unbounded rock; theory.md (5.19).

    At points some horizontal distances (...) in m away and (...) in m below the source, at times
    (n,) in s.
    """
    path = np.hypot(distances, below)
    late = times - path[..., None] / rock.cp
    step = 0.25 * rate.dt
    slope = (_at(rate, late + step) - _at(rate, late - step)) / (2.0 * step)
    size = 4.0 * np.pi * rock.density * rock.cp**2
    radial = _at(rate, late) / path[..., None] ** 2 + slope / (path[..., None] * rock.cp)
    ray = np.stack([distances, -below], axis=-1) / path[..., None]
    return radial[..., None] / size * ray[..., None, :]


def _at(function: Callable, times):
    """Return a function of times (n,) at times of any shape."""
    return function(times.ravel()).reshape(times.shape)


def reflected_waves(
    rate: TimeFunction,
    depth: float | Sequence[float],
    distances: np.ndarray,
    depths: np.ndarray,
    times: np.ndarray,
    rock: Material,
    radiation: Radiation = EXPLOSION,
    delays: float | Sequence[float] = 0.0,
) -> np.ndarray:
    """Return the velocity that a free surface adds to that of a source in unbounded rock.

    Parameters
    ----------
    rate : TimeFunction
        Moment rate in N m/s, or the derivative of a force in N/s.
    depth, delays : float or (n_points,) float, m and s
        Of the points above one another over which the source is spread, and their firing times.
    distances, depths, times, rock
        As of `explosion`.
    radiation : Radiation

    Returns
    -------
    (n_distances, n_depths, n, 2 or 3) float64, m/s
        Away from the source and up, of an order above 0 across to the left, too: the former two
        over cos(m theta), the latter over -sin(m theta); theory.md (5.20) to (5.22), (5.26).
    """
    source, late = np.broadcast_arrays(*(np.atleast_1d(each) for each in (depth, delays)))
    start = float(times.min())
    steps = np.ceil(WINDOW * (float(times.max()) - start) / rate.dt)
    window = rate.dt * (steps + 1.0)
    omega, spectrum = _frequencies(rate, start, window)
    reach = float(distances.max()) + REPEATED * rock.cp * (start + window - rate.start)
    dk, path = np.pi / reach, float(source.min()) + float(depths.min())
    most = np.maximum(np.hypot(DECAYED / path, omega.real / rock.cs), FASTER * omega.real / rock.cs)
    wavenumbers = dk * (np.arange(int(most.max() / dk) + 1) + 0.5)
    bessel = _bessel(radiation.order, np.multiply.outer(distances, wavenumbers))
    size = 2 if radiation.order == 0 else 3
    parts = np.empty((len(omega), len(distances), len(depths), size), dtype=complex)
    for row, w in enumerate(omega):
        k = wavenumbers[: int(most[row] / dk) + 1]
        nu, eta = (np.sqrt(k**2 - (w / c) ** 2) for c in (rock.cp, rock.cs))
        spread = (
            np.exp(1j * w * late - np.multiply.outer(n, source)).mean(axis=1) for n in (nu, eta)
        )
        motion = _reflected(radiation, k, nu, eta, depths, *spread)
        parts[row] = _over_wavenumbers(radiation.order, bessel, motion * (k / w**2)[:, None])
    scale = 2.0 * dk / (window * 4.0 * np.pi * rock.density)
    kernel = np.exp(-1j * np.multiply.outer(times - start, omega)) * (scale * spectrum)
    total = np.real(kernel @ parts.reshape(len(omega), -1)).T
    return total.reshape(len(distances), len(depths), size, len(times)).swapaxes(2, 3)


def _bessel(order, phase):
    """Return Bessel functions of the orders below, at and above an order, (3, ...)."""
    return [scipy.special.jv(order + k, phase) for k in (-1, 0, 1)]


def _reflected(radiation, k, nu, eta, depths, of_p, of_s):
    """Return the motion (3, n_k, n_depths) of reflected waves: away, down and across.

    ``of_p`` and ``of_s`` (n_k,) are what of the waves of the source is left at the surface.
    """
    p, sv, sh = radiation.incident(k, nu, eta)
    p, sv, sh = p * of_p, sv * of_s, sh * of_s
    g = k**2 + eta**2
    cross = 4.0 * nu * eta * k**2
    up = -(p * (g**2 + cross) + 4.0 * eta * k * g * sv) / (g**2 - cross)
    turned = -sv - 2.0 * k * nu * (p - up) / g
    shape = len(k), len(depths)  # on the surface itself nothing has decayed
    of_p, of_s = (
        np.exp(-np.multiply.outer(n, depths)) if depths.any() else np.ones(shape) for n in (nu, eta)
    )
    along = (1j * k * up)[:, None] * of_p - (1j * eta * turned)[:, None] * of_s
    down = (k * turned)[:, None] * of_s - (nu * up)[:, None] * of_p
    return np.stack([along, down, sh[:, None] * of_s])


def _over_wavenumbers(order, bessel, motion):
    """Return the sum over wavenumbers, (n_distances, n_depths, 2 or 3): away, up, across."""
    (along, down, across), n = motion, motion.shape[1]
    below, at, above = (function[:, :n] for function in bessel)
    turn = 1j ** (order - 1)
    upward = -1j * turn * (at @ down)
    if order == 0:
        return np.stack([-turn * (above @ along), upward], axis=-1)
    first, second = 0.5 * turn * (below @ (along + across)), 0.5 * turn * (above @ (along - across))
    return np.stack([first - second, upward, first + second], axis=-1)


def _frequencies(rate, start, window):
    """Return angular frequencies (n,), damped, and the transform of a rate after a start in s."""
    damping, spacing = DAMPED / window, 2.0 * np.pi / window
    size = round(window / rate.dt)
    number = np.arange(len(rate.values))
    late = rate.start - start + rate.dt * number
    # At odd multiples of half the spacing; samples beyond the window come in turn.
    samples = rate.values * rate.dt * np.exp((0.5j * spacing - damping) * late)
    folded = np.zeros(size, dtype=complex)
    np.add.at(folded, number % size, samples)
    omega = spacing * (np.arange(size // 2) + 0.5) + 1j * damping
    turned = np.exp(1j * spacing * np.arange(size // 2) * late[0])
    spectrum = size * np.fft.ifft(folded)[: size // 2] * turned
    energy = np.cumsum(np.abs(omega * spectrum) ** 2)
    last = int(np.searchsorted(energy, (1.0 - FAINTEST) * energy[-1])) + 1
    return omega[:last], spectrum[:last]
