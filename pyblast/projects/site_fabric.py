"""Upright fissures of one direction in all ground of a site."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..solving.anisotropy import anisotropic, jointed, stiffness_of
from ..solving.materials import Material

NONE = 1e-9  # a weakness that changes nothing


@dataclass(frozen=True)
class Fabric:
    """Parallel fissures that make ground weaker across them; theory.md (2.21).

    Parameters
    ----------
    azimuth : float, rad
        Of their normal, from east to north.
    normal, shear : float
        Weaknesses in 0 to 1: the share of the compliance across them, or of that of sliding along
        them, that the fissures bring.

    Raises
    ------
    InputError
        If a weakness is none.
    """

    azimuth: float
    normal: float
    shear: float

    def __post_init__(self):
        """Refuse weaknesses that leave no stiffness."""
        for name in ("normal", "shear"):
            if not 0.0 <= getattr(self, name) < 1.0:
                value = getattr(self, name)
                raise InputError(f"fabric.{name}: must lie in 0 to 1, got {value:g}")

    def of(self, material: Material) -> Material:
        """Return elastic ground with these fissures, its mean shear modulus as it was."""
        across = np.array([np.cos(self.azimuth), np.sin(self.azimuth), 0.0])
        modulus = material.first_lame + 2.0 * material.shear
        normal, shear = max(self.normal, NONE), max(self.shear, NONE)
        kn, ks = modulus * (1.0 / normal - 1.0), material.shear * (1.0 / shear - 1.0)
        weak = jointed(material, across, 1.0, kn, ks)
        stiffness = stiffness_of(weak) * (material.shear / weak.shear)
        strength = {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}
        return anisotropic(material.density, stiffness, **strength)
