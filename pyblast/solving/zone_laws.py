"""Laws of zones: what Python knows of each, the stress routine being in Fortran.

A law has the name of its routine, tells the properties that the routine takes, and the Lame
moduli of its stiffest answer, which rule the time step.
"""

from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True)
class Elastic:
    """Isotropic linear elasticity; theory.md (2.2)."""

    name: ClassVar[str] = "elastic"
    branches: ClassVar[tuple] = ()

    def properties(self, material):
        """Return the properties of the routine for a material."""
        del material
        return {}

    def moduli(self, material):
        """Return first Lame modulus and shear modulus, Pa."""
        return material.first_lame, material.shear
