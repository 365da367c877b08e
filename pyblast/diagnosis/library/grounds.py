"""What may be wrong with the ground itself: it fades waves, it has a grain."""

from dataclasses import replace

import numpy as np

from ...projects.site_fabric import Fabric
from ..hypotheses import Knob, hypothesis
from ..needs import ground_without_loss, three_directions, unknown_quality


@hypothesis(
    "attenuation_Q", family="path", on="site", target="site", axis="both",
    knobs=[Knob("q", 20.0, 0.8, log=True, starts=(8.0, 25.0), low=4.0, high=300.0)],
    settled_by="receivers at distances of three to one, without a joint between them",
    needs=(unknown_quality,),
)  # fmt: skip
def attenuation_q(site, target, q):
    """The ground takes energy from all waves alike, as constant Q of S waves does."""
    del target
    if site.quality is not None or site.fabric is not None:
        return None
    return replace(site, quality=(1.3 * q, q))


def _as_stiff(site, target, azimuth, normal, shear):
    """Return the site in the zones of one with a fabric, as stiff in all directions."""
    del target, normal, shear
    return replace(site, fabric=Fabric(0.5 * np.pi - azimuth, 0.0, 0.0))


@hypothesis(
    "anisotropy", family="path", on="site", target="site", axis="both", bare=_as_stiff,
    knobs=[
        Knob("azimuth", 0.0, 2.0, "rad", starts=(0.0, 0.79, 1.57, 2.36), low=-7.0, high=7.0),
        Knob("normal", 0.2, 0.15, starts=(0.25,), low=0.0, high=0.8),
        Knob("shear", 0.2, 0.15, starts=(0.15,), low=0.0, high=0.8),
    ],
    settled_by="receivers in five or more directions from the blast",
    needs=(ground_without_loss, three_directions),
)  # fmt: skip
def anisotropy(site, target, azimuth, normal, shear):
    """Upright fissures slow waves across them, at an azimuth from north, more than along them."""
    del target
    if site.quality is not None or site.fabric is not None:
        return None
    return replace(site, fabric=Fabric(0.5 * np.pi - azimuth, normal, shear))
