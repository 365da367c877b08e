"""Joints: a named surface, the law of its contacts, and its properties."""

import math
from dataclasses import dataclass, field

from ..errors import InputError
from .kernels import JOINT_LAWS, N_JOINT_PROPERTIES, joint_bound, property_row

PEAKS = {"cohesion_residual": "cohesion", "friction_residual": "friction"}


@dataclass(frozen=True)
class Joint:
    """A joint, a joint set or a fault: one surface of the mesh with one law.

    Parameters
    ----------
    surface : str
        Name of a split surface of the mesh.
    law : str
        A name of ``pyblast.kernels.JOINT_LAWS``.
    properties : dict of str to float
        ``kn``, ``ks`` in Pa/m; ``cohesion``, ``tension`` in Pa; ``friction`` as tangent.
        Residual cohesion and friction that are not given equal the peak; a residual tension
        that is not given is zero.
    insitu_pressure : float, Pa
        Normal pressure before the blast; a static stage replaces it.

    Raises
    ------
    InputError
        If the law is unknown, a property is missing, unknown or out of range.
    """

    surface: str
    law: str
    properties: dict[str, float] = field(hash=False)
    insitu_pressure: float = 0.0

    def __post_init__(self):
        """Fill in residual strengths and refuse what the law does not know."""
        where = f"joints.{self.surface}"
        if self.law not in JOINT_LAWS:
            raise InputError(f"{where}.law: must be one of {', '.join(JOINT_LAWS)}, got {self.law}")
        names = JOINT_LAWS[self.law].properties
        values = {n: self.properties.get(PEAKS[n]) for n in names if n in PEAKS}
        values |= {n: 0.0 for n in names if n == "tension_residual"}
        values |= self.properties
        for name in values:
            if name not in names:
                raise InputError(
                    f"{where}.{name}: unknown to '{self.law}'; it has {' '.join(names)}"
                )
        for name in names:
            value = values.get(name)
            if value is None:
                raise InputError(f"{where}.{name}: missing; the law '{self.law}' needs it")
            if not (math.isfinite(value) and value >= 0.0) or (name in ("kn", "ks") and value == 0):
                raise InputError(f"{where}.{name}: must be positive and finite, got {value:g}")
        if not (math.isfinite(self.insitu_pressure) and self.insitu_pressure >= 0.0):
            raise InputError(
                f"{where}.insitu_pressure: must not be negative, got {self.insitu_pressure:g} Pa"
            )
        object.__setattr__(self, "properties", {name: float(values[name]) for name in names})

    def bound(self):
        """Return the largest stiffness in Pa/m and the viscosity in Pa s/m of the law."""
        law = JOINT_LAWS[self.law]
        return joint_bound(law, property_row(law, self.properties, N_JOINT_PROPERTIES))
