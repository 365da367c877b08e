"""Ground that yields: Mohr-Coulomb strength with tension cut-off and softening."""

import math
from dataclasses import dataclass
from typing import ClassVar

from ..errors import InputError

STRENGTHS = ("cohesion", "friction", "dilation", "tension")


@dataclass(frozen=True)
class MohrCoulomb:
    """Elastic up to the cohesion, friction and tension of the material, plastic there.

    Parameters
    ----------
    dilation : float
        Tangent of the dilation angle; at most the friction.
    cohesion_residual, tension_residual : float or None, Pa
    friction_residual, dilation_residual : float or None
        Tangents. Each is the peak value where not given.
    shear_strain : float
        Plastic shear strain (the largest, as an angle) over which cohesion, friction and dilation
        fall to their residuals; 0 at once.
    tensile_strain : float
        Plastic strain in tension over which the tensile strength does.

    Raises
    ------
    InputError
        If a value is negative or not finite.

    Notes
    -----
    theory.md (2.25) to (2.31). Softening belongs to the size of zones: failure gathers in a band
    one patch of zones wide, so the strains must be chosen for the mesh.
    """

    dilation: float = 0.0
    cohesion_residual: float | None = None
    friction_residual: float | None = None
    dilation_residual: float | None = None
    tension_residual: float | None = None
    shear_strain: float = 0.0
    tensile_strain: float = 0.0
    name: ClassVar[str] = "mohr-coulomb"
    branches: ClassVar[tuple] = ()

    def __post_init__(self):
        """Refuse values that are no strength."""
        for name in ("dilation", *(f"{s}_residual" for s in STRENGTHS), "shear_strain",
                     "tensile_strain"):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not 0.0 <= value < math.inf:
                raise InputError(f"material.{name}: must be finite and not negative, got {value:g}")

    def moduli(self, material):
        """Return the elastic Lame moduli, Pa."""
        return material.first_lame, material.shear

    def properties(self, material):
        """Return peak and residual strengths for the routine.

        Raises
        ------
        InputError
            If the material has no finite cohesion, or dilates more than it rubs.
        """
        if not math.isfinite(material.cohesion):
            raise InputError("material.cohesion: missing; a Mohr-Coulomb material needs it")
        peak = {name: getattr(material, name) for name in STRENGTHS if name != "dilation"}
        peak["dilation"] = self.dilation
        peak["tension"] = self._tension(material)
        row = dict(peak)
        for name, value in peak.items():
            residual = getattr(self, f"{name}_residual")
            row[f"{name}_residual"] = value if residual is None else residual
        for kind in ("", "_residual"):
            friction, dilation = row["friction" + kind], row["dilation" + kind]
            if dilation > friction:
                raise InputError(
                    f"material.dilation{kind}: must not exceed the friction, got tangents "
                    f"{dilation:g} and {friction:g}; dilation above friction makes energy"
                )
        return {**row, "shear_strain": self.shear_strain, "tensile_strain": self.tensile_strain}

    def _tension(self, material):
        """Return the tensile strength, at most that of the cone's tip; a large one for none."""
        tip = (
            material.cohesion / material.friction
            if material.friction > 0.0
            else 1e6 * (material.cohesion + material.bulk)
        )
        return min(material.tension, tip)
