"""Motion of the surface of a half-space by a vertical force on it, by a sum over wavenumbers.

Lamb (1904); complex frequencies as in Bouchon (1981). The static parts, 1/r, are taken out.
"""

import numpy as np
from scipy.special import j0, j1

DECAY = 7.0  # e-folds of the artificial fading over the window
WAVENUMBERS = 12.0  # over that of S waves at the highest frequency


def surface_motion(times, distances, pulse, rock, highest):
    """Return the velocity (n_distances, n, 2) by an upward force, away from it and up.

    Parameters
    ----------
    times : (n,) float, s
        From 0 on.
    distances : (n_distances,) float, m
    pulse : callable
        N at times.
    rock : Material
    highest : float, Hz
    """
    away = np.asarray(distances, dtype=float)[:, None]
    window = 1.5 * times.max()
    omega = 2.0 * np.pi * np.arange(int(highest * window)) / window + 1j * DECAY / window
    samples = np.linspace(0.0, window, 6000)
    spectrum = np.exp(1j * np.outer(omega, samples)) @ pulse(samples) * samples[1]
    step = 2.0 * np.pi / (2.0 * (away.max() + rock.cp * window))
    largest = WAVENUMBERS * 2.0 * np.pi * highest / rock.cs
    k = (np.arange(int(largest / step)) + 0.5) * step
    zero, one = j0(k * away), j1(k * away)
    still = (rock.cp / rock.cs) ** 2 / (2.0 * ((rock.cp / rock.cs) ** 2 - 1.0))
    out = 1.0 / (2.0 * ((rock.cp / rock.cs) ** 2 - 1.0))
    motion = np.zeros((len(away), len(times), 2))
    for number, (w, amplitude) in enumerate(zip(omega, spectrum, strict=True)):
        of_p, of_s = (np.sqrt(k**2 - (w / c) ** 2) for c in (rock.cp, rock.cs))
        slow = (w / rock.cs) ** 2
        rayleigh = (2.0 * k**2 - slow) ** 2 - 4.0 * k**2 * of_p * of_s
        up = -slow * of_p * k / rayleigh - still
        along = -(k**2) * (2.0 * k**2 - slow - 2.0 * of_p * of_s) / rayleigh - out
        field = [(one @ along) * step + out / away[:, 0], (zero @ up) * step + still / away[:, 0]]
        field = -1j * w * amplitude / (2.0 * np.pi * rock.shear) * np.array(field).T
        share = (2.0 if number else 1.0) / window
        motion += share * np.real(field[:, None] * np.exp(-1j * w * times)[:, None])
    return motion
