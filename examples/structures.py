"""What a blast does to a house, a tunnel lining and the rock around its holes, by closed forms.

    python examples/structures.py PROJECT RECEIVER

The project's model gives the motion of the ground at the receiver.
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from pyblast import load_project
from pyblast.blasts.published_laws import EXPLOSIVES
from pyblast.errors import InputError
from pyblast.signals.response_spectra import oscillator, response_spectra
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate

DECOUPLING = 2.4  # exponent of the ratio of diameters


def shear_building(
    seismogram: Seismogram, mass: ArrayLike, stiffness: ArrayLike, damping: float = 0.05
) -> np.ndarray:
    """Return how the floors of a shear building move over the ground.

    Parameters
    ----------
    seismogram : Seismogram
        Velocity of the ground under it.
    mass : (n_floors,) array_like, kg
        From the lowest floor up.
    stiffness : (n_floors,) array_like, N/m
        Against the drift of each storey.
    damping : float
        Fraction of critical of each mode.

    Returns
    -------
    (n_samples, n_floors, 3) float64, m
        Drifts are differences along the floors.

    Raises
    ------
    InputError
        If masses and stiffnesses are not positive or differ in number.

    Notes
    -----
    Sum of the modes, each exact for straight lines of velocity: theory.md (16.2).
    """
    m, k = (np.atleast_1d(np.asarray(part, dtype=float)) for part in (mass, stiffness))
    if m.shape != k.shape or not (m > 0.0).all() or not (k > 0.0).all():
        raise InputError("shear_building: give a positive mass and stiffness for each floor")
    matrix = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    squared, shapes = eigh(matrix, np.diag(m))
    moved = np.zeros((len(seismogram.times), len(m), 3))
    for value, shape in zip(squared, shapes.T, strict=True):
        share = float(shape @ m)
        for part in np.flatnonzero(seismogram.present):
            slope = np.diff(seismogram.velocity[:, part]) / seismogram.dt
            hz = np.sqrt(value) / (2.0 * np.pi)
            motion, _ = oscillator(slope, seismogram.dt, hz, damping)
            moved[:, :, part] += share * motion[:, None] * shape
    return moved


@dataclass(frozen=True)
class TunnelStrain:
    """Strains of a tunnel under a passing plane wave.

    Parameters
    ----------
    axial, bending : float
        Along the tunnel, at the worst angle: of a P or S wave, and of the curvature of an S wave.
    shear : float
        Largest shear strain of the ground across the tunnel.
    ovaling : float
        Change of diameter over diameter of the lining.
    hoop : float
        Largest strain of the lining around the tunnel: thrust and bending.
    """

    axial: float
    bending: float
    shear: float
    ovaling: float
    hoop: float


def tunnel_strain(
    velocity: float,
    acceleration: float,
    *,
    cp: float,
    cs: float,
    density: float,
    radius: float,
    thickness: float,
    lining_young: float,
    lining_poisson: float = 0.2,
) -> TunnelStrain:
    """Return the strains of a lined circular tunnel under the peak motion of the ground.

    Parameters
    ----------
    velocity, acceleration : float, m/s and m/s2
        Peaks of the ground without the tunnel.
    cp, cs, density : float, SI
        Of the ground.
    radius, thickness : float, m
        Of the lining.
    lining_young, lining_poisson : float, Pa and -

    Raises
    ------
    InputError
        If a value is not positive.

    Notes
    -----
    St. John and Zahrah (1987) along the tunnel; Wang (1993), full slip between lining and ground,
    across it; as in Hashash and others (2001), Tunnelling and Underground Space Technology 16:
    theory.md (16.3), (16.4). Waves much longer than the tunnel is wide. Not checked against the
    originals.

    Examples
    --------
    >>> strain = tunnel_strain(0.1, 10.0, cp=4000.0, cs=2000.0, density=2500.0, radius=3.0,
    ...                        thickness=0.3, lining_young=25e9)
    >>> f"{strain.shear:.1e} {strain.axial:.1e} {strain.bending:.1e}"
    '5.0e-05 2.5e-05 7.5e-06'
    """
    values = {
        "velocity": velocity, "cp": cp, "cs": cs, "density": density, "radius": radius,
        "thickness": thickness, "lining_young": lining_young, "acceleration": acceleration,
    }  # fmt: skip
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise InputError(f"tunnel_strain.{name}: must be positive, got {value:g}")
    ratio = (cp / cs) ** 2
    poisson = (ratio - 2.0) / (2.0 * (ratio - 1.0))
    young = 2.0 * (1.0 + poisson) * density * cs**2
    shear = velocity / cs
    inertia = thickness**3 / 12.0
    stiff = lining_young * inertia / (1.0 - lining_poisson**2)
    flexibility = young * radius**3 / (6.0 * stiff * (1.0 + poisson))
    factor = 12.0 * (1.0 - poisson) / (2.0 * flexibility + 5.0 - 6.0 * poisson)
    thrust = factor / 6.0 * young / (1.0 + poisson) * radius * shear
    moment = thrust * radius
    plane = lining_young / (1.0 - lining_poisson**2)
    return TunnelStrain(
        axial=max(velocity / cp, 0.5 * velocity / cs),
        bending=radius * acceleration / cs**2,
        shear=shear,
        ovaling=factor * flexibility * shear / 3.0,
        hoop=thrust / (plane * thickness) + 6.0 * moment / (plane * thickness**2),
    )


def borehole_pressure(
    density: float, velocity: float, charge_diameter: float, hole_diameter: float
) -> float:
    """Return the pressure in Pa of the gases on the wall of a hole.

    Parameters
    ----------
    density, velocity : float, kg/m3 and m/s
        Of the explosive and of its detonation.
    charge_diameter, hole_diameter : float, m
        Equal where the charge fills the hole.

    Raises
    ------
    InputError
        If a value is not positive, or the charge is thicker than its hole.

    Notes
    -----
    ``density velocity^2 / 8 (charge / hole diameter)^2.4``: half the Chapman-Jouguet pressure for
    a ratio of specific heats of 3, decoupled as in Atlas Powder Company, Explosives and Rock
    Blasting (1987); not checked against the original; theory.md (16.5).
    """
    for value in (density, velocity, charge_diameter, hole_diameter):
        if not 0.0 < value < np.inf:
            raise InputError(f"borehole pressure: values must be positive, got {value:g}")
    if charge_diameter > hole_diameter:
        raise InputError(
            f"borehole pressure: a charge of {charge_diameter:g} m is thicker than its hole of "
            f"{hole_diameter:g} m"
        )
    return density * velocity**2 / 8.0 * (charge_diameter / hole_diameter) ** DECOUPLING


def crushed_radius(
    hole_radius: float, pressure: float, strength: float, young: float, poisson: float
) -> float:
    """Return the radius in m of the crushed zone around a hole, at least that of the hole.

    Parameters
    ----------
    hole_radius : float, m
    pressure : float, Pa
        On the wall of the hole, see `borehole_pressure`.
    strength : float, Pa
        Unconfined compressive strength of the rock.
    young, poisson : float, Pa and -
        Dynamic.

    Raises
    ------
    InputError
        If a value is out of range.

    Notes
    -----
    ``0.812 r CZI^0.219`` with the index ``CZI = p^3 / (K strength^2)``, ``K = E/(1 + nu)``: Esen,
    Onederra and Bilgin (2003), Int. J. Rock Mech. Min. Sci. 40, 485-495, from 92 tests in
    concrete; coefficients not checked against the original; theory.md (16.6).

    Examples
    --------
    >>> round(crushed_radius(0.0575, 2.0e9, 100e6, 60e9, 0.25), 3)
    0.086
    """
    for value in (hole_radius, pressure, strength, young):
        if not 0.0 < value < np.inf:
            raise InputError(f"crushed radius: values must be positive, got {value:g}")
    if not 0.0 <= poisson < 0.5:
        raise InputError(f"crushed radius: poisson must lie from 0 to below 0.5, got {poisson:g}")
    index = pressure**3 / (young / (1.0 + poisson) * strength**2)
    return hole_radius * max(1.0, 0.812 * index**0.219)


def main(path, receiver):
    """Print the response of a house, a lining and the rock around a hole of 115 mm."""
    project = load_project(path)
    motion = simulate(project.model, project.duration).seismograms[receiver]
    spectra = response_spectra(motion, [5.0, 10.0, 20.0], damping=0.05)
    drift = np.abs(shear_building(motion, mass=[3e4, 2e4], stiffness=[9e7, 6e7])[:, 0]).max()
    slope = np.abs(np.diff(motion.velocity, axis=0)).max() / motion.dt
    lining = tunnel_strain(
        motion.pvs, slope, cp=4000.0, cs=2300.0, density=2600.0, radius=3.0, thickness=0.3,
        lining_young=25e9,
    )  # fmt: skip
    explosive = EXPLOSIVES["ANFO"]
    pressure = borehole_pressure(explosive.density, explosive.velocity, 0.115, 0.115)
    crushed = crushed_radius(0.0575, pressure, strength=100e6, young=60e9, poisson=0.25)
    print("PSV at 5, 10 and 20 Hz:", np.round(1e3 * spectra.psv.max(axis=1), 2), "mm/s")
    print(f"Drift of the lower storey: {1e3 * drift:.3f} mm")
    print(f"Strain around the lining: {1e6 * lining.hoop:.1f} millionths")
    print(f"Crushed rock: {crushed:.2f} m around a hole of ANFO under {1e-9 * pressure:.1f} GPa")


if __name__ == "__main__":
    main(*sys.argv[1:])
