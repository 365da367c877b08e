"""Joints: surfaces of the mesh with a contact law and its properties."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..core import JOINT_LAWS, N_JOINT_PROPERTIES, joint_bound, property_row
from ..errors import InputError
from ..units import check_stiffness, check_tangent

FOLLOWED = {
    "cohesion_residual": ("cohesion", 1.0),
    "friction_residual": ("friction", 1.0),
    "friction_initial": ("friction", 1.0),
}
DEFAULTS = {
    "coulomb": {"tension_residual": 0.0, "dilation": 0.0, "dilation_slip": 0.0},
    "softening": {"cohesion": 0.0, "tension": 0.0},
    "closure": {"irrecoverable": 0.0, "cohesion": math.inf, "friction": 0.0},
    "barton_bandis": {"irrecoverable": 0.0},
    "stress_dependent": {"cohesion": math.inf, "friction": 0.0},
}
STIFFEST = {"closure": 100.0, "barton_bandis": 100.0, "stress_dependent": 10.0}
POSITIVE = (
    "kn", "ks", "closure", "weakening_slip", "jcs", "peak_slip", "pressure", "roughness",
)  # fmt: skip
TANGENTS = (
    "friction", "friction_residual", "friction_initial", "friction_dynamic", "dilation",
)  # fmt: skip
STICKING_JOINTS = ("coulomb", "softening")  # linear while no contact slips or opens
SLIP, FAILED, STATUS = slice(0, 3), 3, 4  # columns of their state
# States that belong to the displacement, which is zero at the start of a stage.
RESET = (
    *("slip_x", "slip_y", "slip_z", "excess_x", "excess_y", "excess_z"),
    *("rate_x", "rate_y", "rate_z", "dilated", "started"),
)
# Tangents of which the first must not exceed the second: dilation would create energy, and
# weakening would strengthen the joint.
UPPER_LIMITS = (("dilation", "friction_residual"), ("friction_dynamic", "friction"))


def may_be_left_out(law: str) -> set[str]:
    """Return the names of the optional properties of a law."""
    return {*FOLLOWED, *DEFAULTS.get(law, {}), *(("kn_max",) if law in STIFFEST else ())}


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
        In SI, friction and dilation as tangents. Defaults: residual and initial strengths equal
        the peak, residual tension and dilation are zero, ``kn_max`` is 100 ``kn`` for a closing
        and 10 ``kn`` for a stress-dependent joint, and these two do not slip.
    insitu_pressure : float, Pa
        Normal pressure before the blast; a static stage replaces it.
    insitu_shear : (3,) float, Pa
        Shear traction before the blast, on the side behind the normal; only the part in the plane
        is used, and a static stage replaces it.
    fill_mass : float, kg/m2
        Mass of a fill per area, half of it on each side; see `thick_fill`.

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

    def __post_init__(self) -> None:
        """Fill in defaults and check the properties."""
        where = f"joints.{self.surface}"
        if self.law not in JOINT_LAWS:
            raise InputError(f"{where}.law: must be one of {', '.join(JOINT_LAWS)}, got {self.law}")
        names = JOINT_LAWS[self.law].properties
        values = self._with_defaults(names)
        for name in values:
            if name not in names:
                raise InputError(
                    f"{where}.{name}: unknown to '{self.law}'; it has {' '.join(names)}"
                )
        for name in names:
            if values.get(name) is None:
                raise InputError(f"{where}.{name}: missing; the law '{self.law}' needs it")
            endless = name == "dilation_slip" or DEFAULTS.get(self.law, {}).get(name) == math.inf
            _check_value(f"{where}.{name}", name, values[name], endless)
        _check_together(where, self.law, values)
        if not (math.isfinite(self.insitu_pressure) and self.insitu_pressure >= 0.0):
            raise InputError(
                f"{where}.insitu_pressure: must not be negative, got {self.insitu_pressure:g} Pa"
            )
        if not (math.isfinite(self.fill_mass) and self.fill_mass >= 0.0):
            raise InputError(
                f"{where}.fill_mass: must not be negative, got {self.fill_mass:g} kg/m2"
            )
        object.__setattr__(self, "insitu_shear", tuple(map(float, self.insitu_shear)))
        if len(self.insitu_shear) != 3 or not all(map(math.isfinite, self.insitu_shear)):
            raise InputError(
                f"{where}.insitu_shear: must be three finite numbers, got {self.insitu_shear}"
            )
        object.__setattr__(self, "properties", {name: float(values[name]) for name in names})

    def _with_defaults(self, names):
        """Return the properties with defaults."""
        values = {
            name: factor * self.properties[other]
            for name, (other, factor) in FOLLOWED.items()
            if name in names and other in self.properties
        }
        values |= DEFAULTS.get(self.law, {})
        if self.law in STIFFEST and "kn" in self.properties:
            values["kn_max"] = STIFFEST[self.law] * self.properties["kn"]
        return values | self.properties

    def tangents(self, pressure: float) -> tuple[float, float]:
        """Return the tangent stiffnesses kn and ks in Pa/m under a normal pressure in Pa.

        theory.md (3.8), (3.10); for a closing joint on the loading path.
        """
        kn, ks = self.properties["kn"], self.properties["ks"]
        pressure = max(0.0, pressure)
        if self.law == "stress_dependent":
            share = (pressure / self.properties["pressure"]) ** self.properties["exponent"]
            share = min(max(share, 0.01), self.properties["kn_max"] / kn)
            return share * kn, share * ks
        if "closure" in self.properties:
            stiffer = kn * (1.0 + pressure / (kn * self.properties["closure"])) ** 2
            return min(stiffer, self.properties["kn_max"]), ks
        return kn, ks

    def bound(self) -> tuple[float, float]:
        """Return the largest stiffness in Pa/m and the viscosity in Pa s/m."""
        law = JOINT_LAWS[self.law]
        return joint_bound(law, property_row(law, self.properties, N_JOINT_PROPERTIES))


def _check_value(where, name, value, may_be_infinite):
    """Raise InputError for a property out of range."""
    strictly = name in POSITIVE
    if may_be_infinite and value == math.inf:
        return
    if not (math.isfinite(value) and value >= 0.0) or (strictly and value == 0.0):
        raise InputError(f"{where}: must be positive and finite, got {value:g}")
    if name in ("kn", "ks"):
        check_stiffness(where, value)
    if name in TANGENTS:
        check_tangent(where, value)


def _check_together(where, law, values):
    """Raise InputError for inconsistent properties."""
    if "kn_max" in values and not values["kn_max"] > values["kn"]:
        raise InputError(
            f"{where}.kn_max: must exceed kn of {values['kn']:g} Pa/m, got {values['kn_max']:g}"
        )
    if values.get("irrecoverable", 0.0) > 0.9:
        raise InputError(
            f"{where}.irrecoverable: must lie in 0 to 0.9, got {values['irrecoverable']:g}"
        )
    if values.get("dilation", 0.0) > 0.0 and values["dilation_slip"] == 0.0:
        raise InputError(
            f"{where}.dilation_slip: missing beside dilation; give the slip at which it ends"
        )
    for low, high in UPPER_LIMITS:
        if low in values and values[low] > values[high]:
            raise InputError(
                f"{where}.{low}: must not exceed {high} of {values[high]:g}, got {values[low]:g}"
            )
    if law == "yielding" and values["friction_initial"] < values["friction"]:
        raise InputError(
            f"{where}.friction_initial: must not be below friction of {values['friction']:g}, "
            f"got {values['friction_initial']:g}"
        )
    if law == "maxwell" and not min(values["eta_n"], values["eta_s"]) > 0.0:
        raise InputError(f"{where}.eta_n, eta_s: must be positive, got zero; use 'elastic' instead")


def thick_fill(
    surface: str,
    density: float,
    cp: float,
    cs: float,
    thickness: float,
    insitu_pressure: float = 0.0,
) -> Joint:
    """Return an elastic joint with the stiffness and mass of a thin layer of fill.

    Parameters
    ----------
    surface : str
    density : float, kg/m3
    cp, cs : float, m/s
    thickness : float, m
        The error of the transmitted wave is below 3 % up to a phase of 0.3 across the layer; mesh
        thicker fills as zones. theory.md (3.20).
    insitu_pressure : float, Pa
    """
    stiffness = {"kn": density * cp**2 / thickness, "ks": density * cs**2 / thickness}
    mass = density * thickness
    return Joint(surface, "elastic", stiffness, insitu_pressure, fill_mass=mass)


def saturated(joint: Joint, aperture: float, fluid_bulk: float = 2.2e9) -> Joint:
    """Return a fluid-saturated joint: kn increases by fluid bulk modulus over aperture (m).

    Shear stiffness and strength are unchanged; theory.md (3.21).

    Raises
    ------
    InputError
        If the aperture is not positive, or the stiffness of the law depends on pressure.
    """
    if joint.law in STIFFEST:
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
        reset[joint_law.number, : len(joint_law.state)] = np.isin(joint_law.state, RESET)
    return np.where(reset[law], 0.0, contact_state)
