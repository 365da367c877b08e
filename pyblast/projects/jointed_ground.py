"""Rock with joint sets of a project as long waves meet it."""

from dataclasses import replace

from ..meshing.geology import upward_normal
from ..solving.anisotropy import jointed
from ..solving.zone_laws import Elastic
from ..units import to_si


def set_normal(part):
    """Return the unit normal (3,) of a `JointSetConfig`, upward."""
    dip, towards = (to_si(key, getattr(part, key))[1] for key in ("dip_deg", "dip_direction_deg"))
    return upward_normal(dip, towards)


def set_stiffness(config, joints, pressures):
    """Return what the joint sets of a `MeshConfig` oppose to small long waves.

    Parameters
    ----------
    config : MeshConfig
    joints : sequence of Joint
    pressures : dict of str to float, Pa
        Mean normal pressure before the blast, by surface; of `joint_pressures`.

    Returns
    -------
    dict of str to (float, float), Pa/m
        kn and ks by set: tangents under the pressure, over the share of the area that is joint.
    """
    by_surface = {joint.surface: joint for joint in joints}
    return {
        part.name: tuple(
            k / part.persistence for k in by_surface[part.name].tangents(pressures[part.name])
        )
        for part in config.joint_sets
    }


def jointed_media(config, materials, joints, pressures):
    """Return the medium that each layer with joint sets is for long waves.

    Parameters
    ----------
    config : MeshConfig
    materials : dict of str to Material
    joints, pressures
        As of `set_stiffness`.

    Returns
    -------
    dict of str to Material
        By layer; rock bridges take their share of the area off the compliance.
    """
    stiffness, media = set_stiffness(config, joints, pressures), {}
    for part in config.joint_sets:
        for group in part.regions or [layer.material for layer in config.layers]:
            rock = media.get(group, materials[group])
            if rock.law.name != "anisotropic":
                rock = replace(rock, law=Elastic())
            media[group] = jointed(rock, set_normal(part), part.spacing_m, *stiffness[part.name])
    return media
