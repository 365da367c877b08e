"""Shear waves straight up through a layer over a half space, in closed form.

Source: Kramer (1996), section 7.2, with damping by mass in the layer.
"""

import numpy as np


def layer_gain(frequency, thickness, layer, rock, alpha=0.0):
    """Return motion at the ground over that of the bare rock's ground, (n,) complex, e^(-i w t).

    Parameters
    ----------
    frequency : (n,) float, Hz
    thickness : float, m
    layer, rock : Material
    alpha : float, 1/s
        Damping by mass in the layer.

    Notes
    -----
    ``F = 1/(cos k H - i a sin k H)``, ``k = w/c sqrt(1 + i alpha/w)``, a the impedance of the
    layer, ``rho c^2 k/w``, over that of the rock.
    """
    omega = 2.0 * np.pi * np.asarray(frequency)
    k = omega / layer.cs * np.sqrt(1.0 + 1j * alpha / omega)
    ratio = layer.density * layer.cs**2 * k / (rock.density * rock.cs * omega)
    return 1.0 / (np.cos(k * thickness) - 1j * ratio * np.sin(k * thickness))
