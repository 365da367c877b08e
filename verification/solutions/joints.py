"""Plane waves at joints in closed form, fields varying as e^(-i w t).

Sources: displacement discontinuity (Schoenberg 1980); Miller (1978) for friction; Zhao and Cai
(2001) for closure, re-derived.
"""

import numpy as np
from scipy.integrate import solve_ivp


def through_spring(omega, impedance, stiffness):
    """Return T (n,) complex of a joint of complex stiffness in Pa/m at normal incidence."""
    return 1.0 / (1.0 - 0.5j * omega * impedance / stiffness)


def through_kelvin(omega, impedance, stiffness, viscosity):
    """Return T (n,) of a spring beside a dashpot in Pa s/m."""
    return through_spring(omega, impedance, stiffness - 1j * omega * viscosity)


def through_maxwell(omega, impedance, stiffness, viscosity):
    """Return T (n,) of a spring in a row with a dashpot in Pa s/m."""
    return 1.0 / (1.0 + 0.5 * impedance / viscosity - 0.5j * omega * impedance / stiffness)


def through_layer(omega, impedance, layer_impedance, crossing):
    """Return T (n,) of a layer that its own wave crosses in ``crossing`` seconds, face to face."""
    x, ratio = omega * crossing, impedance / layer_impedance
    return 1.0 / (np.cos(x) - 0.5j * (ratio + 1.0 / ratio) * np.sin(x))


def through_heavy_spring(omega, impedance, stiffness, mass):
    """Return T (n,) of a spring with a mass per area in kg/m2, half of it on each side."""
    z = impedance - 0.5j * omega * mass
    return 2.0 * impedance / (z * (2.0 - 1j * omega * z / stiffness))


def past_friction(share):
    """Return T, R, A of a rigid Coulomb plane under a harmonic shear wave.

    Parameters
    ----------
    share : float
        Strength over the amplitude of the shear stress, below one. The transmitted wave is the
        incident one clipped; T and R are root mean squares over that of the incident wave, and
        ``T^2 + R^2 + A^2 = 1``.
    """
    limit = np.arcsin(share)
    rest = 0.5 * np.pi - limit
    passed = 4.0 / np.pi * (0.5 * limit - 0.25 * np.sin(2.0 * limit) + share**2 * rest)
    kept = 0.5 * rest + 0.25 * np.sin(2.0 * limit) - 2.0 * share * np.cos(limit) + share**2 * rest
    back = 4.0 / np.pi * kept
    return np.sqrt([passed, back, 1.0 - passed - back])


def past_closure(times, incident, impedance, stiffness, closure, pressure=0.0):
    """Return the velocity (n,) behind a closing joint.

    Parameters
    ----------
    times : (n,) float, s
    incident : callable
        Velocity in m/s of the incident wave, positive in compression.
    impedance, stiffness, closure : float
        Pa s/m, initial in Pa/m, largest in m.
    pressure : float, Pa
        Before the wave.

    Notes
    -----
    ``dv/dt = 2 k/z (1 + (p + z v)/(k Vm))^2 (v_I - v)``.
    """

    def rate(t, v):
        stiffer = (1.0 + (pressure + impedance * v) / (stiffness * closure)) ** 2
        return 2.0 * stiffness / impedance * stiffer * (incident(t) - v)

    found = solve_ivp(rate, times[[0, -1]], [0.0], t_eval=times, rtol=1e-8, atol=1e-12,
                      max_step=(times[-1] - times[0]) / 2000.0, method="LSODA")  # fmt: skip
    return found.y[0]


def oblique(omega, angle, wave, rock, kn, ks):
    """Return the waves that a joint makes of a plane wave of unit velocity.

    Parameters
    ----------
    omega : float, 1/s
    angle : float, rad
        Between the ray and the normal of the joint.
    wave : str
        "P" or "S" in the plane of incidence, "H" across it.
    rock : Material
        On both sides.
    kn, ks : float, Pa/m

    Returns
    -------
    dict of str to (amplitude, slowness, direction)
        Of the transmitted waves, and of those ``back``: complex, (2,) s/m and (2,) along the
        normal and along the joint. Of "H" only what passes.

    Notes
    -----
    Four unknowns: the two reflected and two transmitted waves. Traction passes unchanged, and
    ``[u_n] = sigma/kn``, ``[u_t] = tau/ks``.
    """
    if wave == "H":
        z = rock.density * rock.cs * np.cos(angle)
        along = np.array([np.cos(angle), np.sin(angle)]) / rock.cs
        return {"H": (through_spring(omega, z, ks), along, np.zeros(2))}
    p = np.sin(angle) / {"P": rock.cp, "S": rock.cs}[wave]
    ahead = {"P": _plane_wave("P", p, rock, 1.0), "S": _plane_wave("S", p, rock, 1.0)}
    back = [_plane_wave(kind, p, rock, -1.0) for kind in ("P", "S")]
    compliance = -1j * omega * np.diag([1.0 / kn, 1.0 / ks])

    # Unknowns: reflected P, S, transmitted P, S. v+ - v- = -i w C t with t on the plus side.
    matrix, given = np.zeros((4, 4), dtype=complex), np.zeros(4, dtype=complex)
    for column, one in enumerate(back):
        matrix[:2, column], matrix[2:, column] = -one[2], -one[1]
    for column, kind in enumerate(("P", "S")):
        _, velocity, traction = ahead[kind]
        matrix[:2, 2 + column] = traction
        matrix[2:, 2 + column] = velocity - compliance @ traction
    given[2:], given[:2] = ahead[wave][1:]
    waves = zip((*back, *ahead.values()), np.linalg.solve(matrix, given), strict=True)
    names = ("P back", "S back", "P", "S")
    return {n: (size, *one[:2]) for n, (one, size) in zip(names, waves, strict=True)}


def _plane_wave(kind, p, rock, sign):
    """Return slowness, direction and traction on the joint of a wave of unit velocity.

    Axes: normal of the joint, along it. The wave goes along ``sign`` times the normal.
    """
    speed = {"P": rock.cp, "S": rock.cs}[kind]
    slowness = np.array([sign * np.sqrt(1.0 / speed**2 - p**2), p])
    ray = slowness * speed
    direction = ray if kind == "P" else np.array([-ray[1], ray[0]])
    strain = -0.5 * (np.outer(slowness, direction) + np.outer(direction, slowness))
    stress = rock.first_lame * np.trace(strain) * np.eye(2) + 2.0 * rock.shear * strain
    return slowness, direction, stress[0]
