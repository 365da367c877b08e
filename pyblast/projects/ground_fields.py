"""Fields of a project that change the wave speeds of its ground, in SI."""

import numpy as np

from ..errors import InputError
from ..meshing.mesh import Mesh
from ..solving.ground_fields import DamagedZone, Gradient, Heterogeneity, damaged_group


def make_fields(config, blast, mesh) -> tuple:
    """Turn a `GroundConfig` into fields of the ground.

    Parameters
    ----------
    config : GroundConfig
    blast : Blast or None
        Whose holes have damaged the ground.
    mesh : Mesh
        A gradient without a height begins at its highest point.

    Raises
    ------
    InputError
        If no hole comes near enough to damage anything.
    """
    fields = []
    if config.gradient is not None:
        part = config.gradient
        top = mesh.points[:, 2].max() if part.top_m is None else part.top_m
        fields.append(Gradient(part.reduction, part.length_m, float(top)))
    if config.damaged_zone is not None:
        zone = _damaged(config.damaged_zone, blast)
        centres = mesh.points[mesh.zones].mean(axis=1)
        nearest = zone.distance(centres).min()
        if nearest > zone.length:
            raise InputError(
                f"ground.damaged_zone.length_m: the ground begins {nearest:.3g} m from the holes "
                f"and is not damaged, got {zone.length:g} m; are the holes inside the model?"
            )
        fields.append(zone)
    if config.heterogeneity is not None:
        part = config.heterogeneity
        fields.append(Heterogeneity(part.deviation, part.length_m, part.seed, part.hurst))
    return tuple(fields)


def with_damaged_material(config, blast, mesh) -> Mesh:
    """Return a mesh whose zones near the holes have the material of a `DamagedZoneConfig`."""
    part = config.damaged_zone
    if part is None or part.material is None:
        return mesh
    return damaged_group(mesh, _damaged(part, blast), part.radius_m, part.material)


def _damaged(part, blast):
    """Return the damaged zone around all holes."""
    holes = np.stack([blast.collar, blast.toe], axis=1)
    return DamagedZone(holes, part.reduction, part.length_m)
