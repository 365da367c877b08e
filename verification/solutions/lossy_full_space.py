"""Motion of a full space of constant Q by a force or a moment tensor, by sums over frequencies.

Kjartansson (1979) in the Green function of Stokes; complex frequencies as in Bouchon (1981).
"""

from types import SimpleNamespace

import numpy as np

from .full_space import force_spectrum

DECAY = 7.0  # e-folds of the artificial fading over the window
STEP = 0.25  # m, of the differences that make a moment of forces


def speed(omega, quality, at_reference, reference):
    """Return the complex speed (n,) in m/s of a constant Q at angular frequencies."""
    power = np.arctan(1.0 / quality) / np.pi
    slow = (1.0 / (-1j) ** power).real
    return at_reference * slow * (-1j * omega / reference) ** power


def motion(times, offset, source, pulse, rock, quality=None, highest=90.0):
    """Return the velocity (n, 3) by a force (3,) in N or a moment tensor (3, 3) in N m.

    Parameters
    ----------
    times : (n,) float, s
        From 0 on.
    offset : (3,) float, m
    source : (3,) or (3, 3) float
        Multiplies the pulse: a force, or a moment rate.
    pulse : callable
    rock : Material
    quality : tuple of 3 float, optional
        Qp, Qs and the frequency in Hz at which the speeds are those of the rock.
    highest : float, Hz
    """
    window = 1.5 * times.max()
    fade = DECAY / window
    omega = 2.0 * np.pi * np.arange(int(highest * window)) / window + 1j * fade
    samples = np.linspace(0.0, window, 6000)
    spectrum = np.exp(1j * np.outer(omega, samples)) @ pulse(samples) * samples[1]
    ground = rock
    if quality is not None:
        at = 2.0 * np.pi * quality[2]
        cp, cs = (
            speed(omega, q, c, at)[:, None, None]
            for q, c in zip(quality, (rock.cp, rock.cs), strict=False)
        )
        ground = SimpleNamespace(density=rock.density, cp=cp, cs=cs)
    if np.ndim(source) == 1:
        field = -1j * omega[:, None] * (force_spectrum(omega, offset, ground) @ source)
    else:  # the moment is the integral of its rate
        field = 0.0
        for axis in np.eye(3):
            ends = [force_spectrum(omega, offset - side * STEP * axis, ground) for side in (1, -1)]
            field = field + (ends[0] - ends[1]) / (2.0 * STEP) @ (np.asarray(source) @ axis)
    share = np.where(np.arange(len(omega)), 2.0, 1.0) / window
    turns = np.exp(-1j * np.outer(times, omega))
    return np.real(turns @ (share[:, None] * spectrum[:, None] * field))
