"""Joints: surfaces of the mesh with a contact law and its properties."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..core import JOINT_LAWS, joint_bound, joint_tangents
from ..errors import InputError

SLIP, FAILED, STATUS, GAP = slice(0, 3), 3, 4, 5  # columns of the state of joints that stick

# Ranges of thickness in m, of kn and of ks in Pa/m of clay infill: Infanti & Kanji (1978) as in
# table 3 of Babanouri et al. (2013). Its last row says kn > 0.5 GPa/m, an error of the text by its
# own column kn/ks = 5 beside ks > 1.0 GPa/m: 5.0 stands here.
INFILL = (
    ((0.05, 0.1), (0.1e9, 0.5e9), (0.01e9, 0.1e9)),
    ((0.01, 0.02), (0.5e9, 2.0e9), (0.1e9, 0.6e9)),
    ((0.0, 0.001), (5.0e9, math.inf), (1.0e9, math.inf)),
)


def infill_stiffness(
    thinnest: float, thickest: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the published ranges of kn and ks of a fault with clay infill.

    Parameters
    ----------
    thinnest, thickest : float, m
        Range of the thickness of the infill.

    Returns
    -------
    kn, ks : (float, float), Pa/m
        Between rows of the table the range covers both; infill thicker than 100 mm may be softer
        without limit, and infill below 1 mm stiffer.

    Raises
    ------
    InputError
        If the thicknesses do not ascend from zero.

    Notes
    -----
    Infanti & Kanji (1978), as table 3 of Babanouri et al. (2013) gives it; not checked against the
    original.

    Examples
    --------
    >>> infill_stiffness(0.05, 0.1)
    ((100000000.0, 500000000.0), (10000000.0, 100000000.0))
    """
    if not 0.0 <= thinnest <= thickest:
        raise InputError(
            f"infill: needs 0 <= thinnest <= thickest, got {thinnest:g} and {thickest:g} m"
        )
    thickest_row = INFILL[0][0][1]
    first = max(n for n, row in enumerate(INFILL) if row[0][1] >= min(thinnest, thickest_row))
    last = min(n for n, row in enumerate(INFILL) if row[0][0] <= thickest)
    rows = INFILL[min(first, last) : max(first, last) + 1]
    kn, ks = ((min(r[k][0] for r in rows), max(r[k][1] for r in rows)) for k in (1, 2))
    if thickest > thickest_row:
        kn, ks = (0.0, kn[1]), (0.0, ks[1])
    return kn, ks


@dataclass(frozen=True)
class Joint:
    """Joint, joint set or fault: one surface of the mesh with one contact law.

    Parameters
    ----------
    surface : str
        Name of a split surface of the mesh.
    law : str
        A name of ``pyblast.core.JOINT_LAWS``; theory.md section 3.
    properties : dict of str to float
        In SI, friction and dilation as tangents; those left out have the defaults of the law,
        ``JOINT_LAWS[law].properties``.
    insitu_pressure : float, Pa
        Normal pressure before the blast, at ``insitu_level``; a static stage replaces it.
    insitu_shear : (3,) float, Pa
        Shear traction before the blast, on the side behind the normal; only the part in the plane
        is used, and a static stage replaces it.
    fill_mass : float, kg/m2
        Mass of a fill per area, half of it on each side; theory.md (3.20).
    insitu_gradient : float, Pa/m
        Growth of that pressure with depth, such as that of the weight of rock less that of water.
    insitu_level : float, m
        Height at which the pressure is given, where it grows.

    Raises
    ------
    InputError
        If the law is unknown, or a property is missing, unknown, out of range or not in SI.

    Examples
    --------
    >>> joint = Joint("F1", "coulomb", {"kn": 2e9, "ks": 1e9, "cohesion": 1e5, "friction": 0.6,
    ...                                 "tension": 0.0})
    >>> joint.properties["friction_residual"]
    0.6
    """

    surface: str
    law: str
    properties: dict[str, float] = field(hash=False)
    insitu_pressure: float = 0.0
    insitu_shear: tuple[float, float, float] = (0.0, 0.0, 0.0)
    fill_mass: float = 0.0
    insitu_gradient: float = 0.0
    insitu_level: float = 0.0

    def __post_init__(self) -> None:
        """Take the defaults of the law and check all values."""
        where = f"joints.{self.surface}"
        if self.law not in JOINT_LAWS:
            raise InputError(f"{where}.law: must be one of {', '.join(JOINT_LAWS)}, got {self.law}")
        values = JOINT_LAWS[self.law].complete(where, self.properties)
        object.__setattr__(self, "properties", values)
        if not (math.isfinite(self.insitu_pressure) and self.insitu_pressure >= 0.0):
            raise InputError(
                f"{where}.insitu_pressure: must not be negative, got {self.insitu_pressure:g} Pa"
            )
        if not (math.isfinite(self.insitu_gradient) and math.isfinite(self.insitu_level)):
            raise InputError(f"{where}.insitu_gradient: gradient and level must be finite")
        if not (math.isfinite(self.fill_mass) and self.fill_mass >= 0.0):
            raise InputError(
                f"{where}.fill_mass: must not be negative, got {self.fill_mass:g} kg/m2"
            )
        object.__setattr__(self, "insitu_shear", tuple(map(float, self.insitu_shear)))
        if len(self.insitu_shear) != 3 or not all(map(math.isfinite, self.insitu_shear)):
            raise InputError(
                f"{where}.insitu_shear: must be three finite numbers, got {self.insitu_shear}"
            )

    def pressure_at(self, height: np.ndarray) -> np.ndarray:
        """Return the normal pressure in Pa before the blast at heights (n,) in m, never negative.

        Examples
        --------
        >>> joint = Joint("F1", "elastic", {"kn": 1e9, "ks": 1e9}, 1e5, insitu_gradient=1e4)
        >>> joint.pressure_at(np.array([-5.0, 0.0, 20.0])).tolist()
        [150000.0, 100000.0, 0.0]
        """
        growth = self.insitu_gradient * (self.insitu_level - np.asarray(height, dtype=float))
        return np.maximum(0.0, self.insitu_pressure + growth)

    def tangents(self, pressure: float) -> tuple[float, float]:
        """Return the tangent stiffnesses kn and ks in Pa/m under a normal pressure in Pa.

        theory.md (3.8), (3.10); for a closing joint on the loading path.
        """
        return joint_tangents(JOINT_LAWS[self.law], self.properties, max(0.0, pressure))

    def bound(self) -> tuple[float, float]:
        """Return the largest stiffness in Pa/m and the viscosity in Pa s/m."""
        return joint_bound(JOINT_LAWS[self.law], self.properties)


def saturated(joint: Joint, aperture: float, fluid_bulk: float = 2.2e9) -> Joint:
    """Return a fluid-saturated joint: kn increases by fluid bulk modulus over aperture (m).

    Shear stiffness and strength are unchanged; theory.md (3.21).

    Raises
    ------
    InputError
        If the aperture is not positive, or the stiffness of the law depends on pressure.
    """
    if JOINT_LAWS[joint.law].stiffens:
        raise InputError(
            f"joints.{joint.surface}.law: '{joint.law}' has no stiffness of its own that a fluid "
            "could add to; use 'elastic' or 'coulomb'"
        )
    if not aperture > 0.0:
        raise InputError(f"joints.{joint.surface}.aperture: must be positive, got {aperture:g} m")
    kn = joint.properties["kn"] + fluid_bulk / aperture
    return replace(joint, properties={**joint.properties, "kn": kn})


def carried_over(law: np.ndarray, contact_state: np.ndarray) -> np.ndarray:
    """Return joint states (n_contacts, n_state) for a stage that starts at zero displacement.

    Parameters
    ----------
    law : (n_contacts,) int
        Number of each contact's law, from 0.
    contact_state : (n_contacts, n_state) float64
    """
    reset = np.zeros((len(JOINT_LAWS), contact_state.shape[1]), dtype=bool)
    for joint_law in JOINT_LAWS.values():
        begins = [name in joint_law.at_zero for name in joint_law.state]
        reset[joint_law.number, : len(joint_law.state)] = begins
    return np.where(reset[law], 0.0, contact_state)
