"""Projects as sites: a box of flat layers, upright joints, holes inside, recorded motion."""

from dataclasses import replace

import numpy as np

from ..blasts.blast import Blast
from ..errors import InputError
from ..model.material import Elastic
from ..model.model import Receiver
from ..signals.seismogram import GEOGRAPHIC
from .inputs import read_record
from .places import make_rim
from .project import Project, load_project
from .section import named_error
from .site import Site, SiteJoint, check_site

# What a site can't hold: key path, why, and what would do.
REFUSED = {
    "mesh.file": "holds a mesh, but a diagnosis cuts its own; give size_m and [[mesh.layers]]",
    "mesh.surface_file": "is a surveyed surface, but a diagnosis takes flat layers; leave it out",
    "mesh.joint_sets": "are many joints; give those that matter as [[mesh.faults]]",
    "signature": "enters through a face; put the holes inside with [holes_inside]",
    "point_forces": "is no hole; a diagnosis fires holes alone, leave it out",
    "moment_tensors": "is no hole; a diagnosis fires holes alone, leave it out",
    "pressures": "is no hole; a diagnosis fires holes alone, leave it out",
    "air_blast": "is an effect that a diagnosis looks for itself; leave it out",
    "holes_inside.detonation_m_per_s": "makes columns of holes; leave it out, points do here",
    "blast.scatter_ms": "draws firing times, but a diagnosis believes planned ones; leave it out",
    "ground.gradient": "changes speeds within layers; give it as several [[mesh.layers]]",
    "ground.damaged_zone": "is an effect that a diagnosis looks for itself; leave it out",
    "ground.heterogeneity": "is an error that a diagnosis allows for itself; leave it out",
    "damping": "is of one frequency; give qp, qs and quality_band_hz to every material, or nothing",
    "insitu": "needs a stage of its own; give insitu_pressure_kpa to the joints instead",
    "run.local_damping": "damps all motion; leave it out",
}
OF_MATERIALS = {
    "damping": REFUSED["damping"],
    "yielding": "makes ground that yields, but a diagnosis takes elastic ground; leave it out",
    "transverse": "is an effect that a diagnosis looks for itself; give young_mpa and poisson",
    "joints": "is an effect that a diagnosis looks for itself; leave it out",
}
SHARED = (
    "mesh", "materials", "joints", "boundaries", "rim", "holes_inside", "blast.charge_exponent",
)  # fmt: skip
QUALITY = "qp", "qs"
SIDES = "west", "east", "south", "north", "bottom"


def diagnosed_blasts(project: Project) -> tuple[Project, ...]:
    """Return a project and those that its table [diagnosis] names beside it.

    Raises
    ------
    InputError
        If a name is there twice, or the ground or the source of a hole is not the same.
    """
    table, folder = project.config.diagnosis, project.folder
    every = (project, *(load_project(folder / name) for name in (table.blasts if table else ())))
    names = [one.path.stem for one in every]
    for one, name in zip(every, names, strict=True):
        if names.count(name) > 1:
            raise InputError(f"{project.path.name}: diagnosis.blasts: {name!r} is named twice")
        for key in SHARED:
            if _entry(one.config, key) != _entry(project.config, key):
                raise InputError(
                    f"{one.path.name}: {key}: differs from {project.path.name}; blasts that are "
                    "diagnosed together share their ground and the moment rate of 1 kg"
                )
    return every


def site_of_project(project: Project) -> Site:
    """Return the site that a project and the further blasts of its table [diagnosis] believe in.

    Parameters
    ----------
    project : Project
        A box of flat layers of isotropic elastic ground, with or without quality factors,
        vertical elastic joints along x or y, holes inside, recordings at receivers.

    Returns
    -------
    Site
        With its ground at height 0, without time zeros: the file says times from the first hole.

    Raises
    ------
    InputError
        If it is anything else; one sentence with the key and what would do.
    """
    every = diagnosed_blasts(project)
    for one in every:
        with named_error(f"{one.path.name}: diagnose"):
            _refuse(one.config)
    with named_error(f"{project.path.name}: diagnose"):
        top = ground_height(project)
        box = _box(project.config, top)
        site = Site(
            name=project.title,
            box=box,
            layers=_layers(project),
            joints=tuple(_joint(project, fault, top) for fault in project.config.mesh.faults),
            quality=_quality(project.config),
            receivers=_receivers(every, top),
            moment_rate=project.inside.moment_rate,
            exponent=project.config.blast.charge_exponent,
            blasts={one.path.stem: lowered(one.blast, top) for one in every},
            records={one.path.stem: _records(one) for one in every},
            time_zeros={},
            band=_band(project.config),
            noise_window=(0.0, 0.0),
        )
        site = replace(site, noise_window=_noise_window(project.config, site.records))
        check_site(site)
        return site


def _entry(config, key):
    """Return what a path of keys such as ``blast.charge_exponent`` leads to, or None."""
    for name in key.split("."):
        config = None if config is None else getattr(config, name)
    return config


def _refuse(config):
    """Refuse what a site can't hold."""
    for key, why in REFUSED.items():
        if _entry(config, key):
            raise InputError(f"{key}: {why}")
    if config.holes_inside is None:
        raise InputError("holes_inside: missing; a diagnosis fires the holes of [blast] inside")
    for side in SIDES:
        if side not in config.boundaries.viscous:
            raise InputError(
                f"boundaries.viscous: lacks {side!r}; in a diagnosis waves leave through all sides "
                "but the top"
            )
    for name, material in config.materials.items():
        for key, why in OF_MATERIALS.items():
            if getattr(material, key):
                raise InputError(f"materials.{name}.{key}: {why}")


def _box(config, top):
    """Return the box (3, 2) in m within its rim, its top at 0."""
    low = np.array(config.mesh.origin_m)
    box = np.column_stack([low, low + config.mesh.size_m])
    rim = make_rim(config)
    if rim is not None:
        box = np.array(rim.box, dtype=float)
    return np.array([*box[:2], [box[2, 0] - top, 0.0]])


def _layers(project):
    """Return the layers; each has a material of its own, whose speeds are its own.

    The last goes on below the bottom of the mesh.
    """
    layers = project.config.mesh.layers
    names = [layer.material for layer in layers]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"mesh.layers: {name!r} is used twice; give each layer a material of its own"
            )
    thicknesses = [*(layer.thickness_m for layer in layers[:-1]), None]
    return tuple(
        (name, thickness, replace(project.materials[name], law=Elastic()))
        for name, thickness in zip(names, thicknesses, strict=True)
    )


def _quality(config):
    """Return Qp and Qs of all layers, or None."""
    used = {layer.material: config.materials[layer.material] for layer in config.mesh.layers}
    given = {name: tuple(getattr(one, key) for key in QUALITY) for name, one in used.items()}
    first = next(iter(given.values()))
    for name, pair in given.items():
        if pair != first:
            raise InputError(
                f"materials.{name}.qp: a diagnosis takes one pair qp, qs for all layers, "
                f"got {pair} beside {first}"
            )
    return None if first[0] is None else first


def _joint(project, fault, top):
    """Return a fault as a vertical joint of a site."""
    where, turned = f"mesh.faults.{fault.name}", fault.dip_direction_deg % 180.0
    if fault.dip_deg != 90.0 or turned not in (0.0, 90.0):
        raise InputError(
            f"{where}: a diagnosis takes joints of dip_deg 90 and dip_direction_deg 0 or 90, "
            f"got {fault.dip_deg:g} and {fault.dip_direction_deg:g}"
        )
    if fault.radius_m is not None:
        raise InputError(f"{where}.radius_m: give extent_m instead, a diagnosis takes rectangles")
    joint = next(one for one in project.joints if one.surface == fault.name)
    if joint.law != "elastic":
        raise InputError(
            f"joints.{fault.joint or fault.name}.law: must be 'elastic', got {joint.law!r}; "
            "closure, slip and viscous fill are what a diagnosis looks for"
        )
    axis, (x, y, z) = ("y" if turned == 0.0 else "x"), fault.through_m
    place, middle = (x, y) if axis == "x" else (y, x)
    if fault.extent_m is None:
        return SiteJoint(joint, axis, float(place))
    along, down = (0.5 * length for length in fault.extent_m)
    depth = top - z
    return SiteJoint(
        joint, axis, float(place), (middle - along, middle + along), (depth - down, depth + down)
    )


def _receivers(every, top):
    """Return the receivers of all blasts, once each."""
    places = {}
    for one in every:
        for part in one.config.receivers:
            x, y, z = (*part.position_m, top)[:3]
            place = float(x), float(y), float(z) - top
            if places.setdefault(part.name, place) != place:
                raise InputError(f"receivers.{part.name}.position_m: differs between the blasts")
    return tuple(Receiver(name, place) for name, place in places.items())


def ground_height(project: Project) -> float:
    """Return the height in m of the ground of a project, which is 0 in its site."""
    return project.config.mesh.origin_m[2] + project.config.mesh.size_m[2]


def lowered(blast: Blast, top: float) -> Blast:
    """Return a blast with the ground at height 0; refuse holes without a charge."""
    for name, charge in zip(blast.hole_ids, blast.charge, strict=True):
        if not charge > 0.0:
            raise InputError(f"blast: hole {name} has no charge; take it out of the table")
    down = np.array([0.0, 0.0, top])
    return replace(blast, collar=blast.collar - down, toe=blast.toe - down)


def _records(project):
    """Return the records of one blast, east, north, up."""
    found = {}
    for part in project.config.receivers:
        if part.recorded is None:
            continue
        record = read_record(part.recorded, project.folder)
        if tuple(record.seismogram.components) != GEOGRAPHIC:
            raise InputError(
                f"receivers.{part.name}.recorded.bearing_deg: missing; a diagnosis compares east, "
                "north and up"
            )
        found[part.name] = record
    if not found:
        raise InputError("receivers: none has a record; add [receivers.recorded]")
    return found


def _band(config):
    """Return the band that is compared."""
    given = config.diagnosis and config.diagnosis.band_hz
    band = given or config.run.compare_band_hz
    if band is None:
        raise InputError("diagnosis.band_hz: missing; give lowest and highest frequency, such as "
                         "[4, 30]")  # fmt: skip
    return tuple(band)


def _noise_window(config, records):
    """Return when nothing but noise was recorded: as given, or all that comes before."""
    if config.diagnosis and config.diagnosis.noise_window_s:
        return tuple(config.diagnosis.noise_window_s)
    last, receiver, blast = max(
        (one.seismogram.start, receiver, blast)
        for blast, some in records.items()
        for receiver, one in some.items()
    )
    if last >= 0.0:
        raise InputError(
            f"receivers.{receiver}.recorded: the record of {blast} begins {last:g} s after the "
            "first hole, but noise is learnt from before; give records with a pre-trigger"
        )
    return last, 0.0
