"""What a calibration may change of a site: wave speeds of its layers, stiffness of its joints."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..projects.site import Site
from ..solving.materials import Material

SPEED_SIGMA = 0.03
STIFFNESS_SIGMA = 0.3


@dataclass(frozen=True)
class Unknown:
    """One value of a site, as the logarithm of a factor on what is believed.

    Parameters
    ----------
    part : str
        Name of a layer or a joint.
    name : str
        "cp" or "cs" of a layer, "kn" or "ks" of a joint.
    sigma : float
        Standard deviation before the records are seen.
    """

    part: str
    name: str
    sigma: float

    @property
    def label(self):
        """The word for it in tables."""
        return f"{self.part}.{self.name}"


def unknowns_of(site: Site) -> tuple[Unknown, ...]:
    """List what may be calibrated at a site."""
    speeds = [Unknown(n, c, SPEED_SIGMA) for n, _, _ in site.layers for c in ("cp", "cs")]
    names = [j.joint.surface for j in site.joints]
    return (*speeds, *(Unknown(n, k, STIFFNESS_SIGMA) for n in names for k in ("kn", "ks")))


def with_values(site: Site, unknowns, values) -> Site:
    """Return a site with factors exp(values) on some of its values.

    Raises
    ------
    InputError
        If a layer or joint is not there.
    """
    factors = {
        (one.part, one.name): float(np.exp(value))
        for one, value in zip(unknowns, values, strict=True)
    }
    parts = {name for name, _, _ in site.layers} | {j.joint.surface for j in site.joints}
    for part, _ in factors:
        if part not in parts:
            raise InputError(f"unknowns: no layer or joint named {part!r}")
    layers = tuple(
        (name, thickness, _faster(material, factors, name))
        for name, thickness, material in site.layers
    )
    joints = tuple(replace(j, joint=_stiffer(j.joint, factors)) for j in site.joints)
    return replace(site, layers=layers, joints=joints)


def _faster(material, factors, layer):
    """Return a material with other speeds and its other values."""
    cp, cs = (factors.get((layer, name), 1.0) for name in ("cp", "cs"))
    if cp == cs == 1.0:
        return material
    moduli = Material.from_speeds(material.density, material.cp * cp, material.cs * cs)
    return replace(material, bulk=moduli.bulk, shear=moduli.shear)


def _stiffer(joint, factors):
    """Return a joint with other stiffness."""
    changed = {
        key: value * factors.get((joint.surface, key), 1.0)
        for key, value in joint.properties.items()
    }
    return replace(joint, properties=changed)
