"""Half-space: motion of a buried explosion, by a wavenumber integral."""

from collections.abc import Callable

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
    depth: float,
    distances: np.ndarray,
    depths: np.ndarray,
    times: np.ndarray,
    rock: Material,
) -> np.ndarray:
    """Return what the surface adds to `explosion`, with the same arguments; (5.20) to (5.22)."""
    start = float(times.min())
    steps = np.ceil(WINDOW * (float(times.max()) - start) / rate.dt)
    window = rate.dt * (steps + 1.0)
    omega, spectrum = _frequencies(rate, start, window)
    reach = float(distances.max()) + REPEATED * rock.cp * (start + window - rate.start)
    dk, path = np.pi / reach, depth + float(depths.min())
    most = np.maximum(np.hypot(DECAYED / path, omega.real / rock.cp), FASTER * omega.real / rock.cs)
    wavenumbers = dk * (np.arange(int(most.max() / dk) + 1) + 0.5)
    phase = np.multiply.outer(distances, wavenumbers)
    across, upright = -wavenumbers * scipy.special.j1(phase), scipy.special.j0(phase)
    parts = np.empty((len(omega), len(distances), len(depths), 2), dtype=complex)
    for row, w in enumerate(omega):
        k = wavenumbers[: int(most[row] / dk) + 1]
        nu, eta = (np.sqrt(k**2 - (w / c) ** 2) for c in (rock.cp, rock.cs))
        g = k**2 + eta**2
        direct, cross = -k / nu * np.exp(-nu * depth), 4.0 * nu * eta * k**2
        up = -direct * (g**2 + cross) / (g**2 - cross)
        turned = -2.0 * nu * (direct - up) / g
        p, s = (np.exp(-np.multiply.outer(n, depths)) for n in (nu, eta))
        along = up[:, None] * p - (eta * turned)[:, None] * s
        down = (k**2 * turned)[:, None] * s - (nu * up)[:, None] * p
        parts[row, ..., 0] = across[:, : len(k)] @ along
        parts[row, ..., 1] = -upright[:, : len(k)] @ down
    size = 4.0 * np.pi * rock.density * rock.cp**2
    kernel = np.exp(-1j * np.multiply.outer(times - start, omega)) * spectrum
    total = np.real(kernel @ parts.reshape(len(omega), -1)).T * (2.0 * dk / (window * size))
    return total.reshape(len(distances), len(depths), 2, len(times)).swapaxes(2, 3)


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
