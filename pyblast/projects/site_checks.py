"""What a site must hold before it is worth a run: places, speeds, holes, windows, records."""

import numpy as np

from ..blasting.blast import Blast
from ..errors import InputError
from ..meshing.rock_cells import SIDES

SPEEDS = 30.0, 10_000.0  # m/s, of waves in ground
EARLY = 1e-3  # of its peak that a moment rate may reach before its hole fires
NEAR = 1e-6  # m that a place may lie outside of the box


def check_site(site):
    """Refuse a `Site` that can't be as it is described, with the part that is to blame.

    Raises
    ------
    InputError
    """
    if not np.all(site.box[:, 0] < site.box[:, 1]):
        raise InputError(f"box: each axis must go from low to high, got {site.box.tolist()}")
    low, high = site.band
    if not 0.0 < low < high:
        raise InputError(f"recording.band_hz: must be lowest, highest, got {low:g}, {high:g}")
    first, last = site.noise_window
    if not first < last <= 0.0:
        raise InputError(
            "recording.noise_window_s: must begin and end before the first hole at 0, "
            f"got {first:g}, {last:g}"
        )
    _check_names("layers", [name for name, *_ in site.layers])
    _check_thicknesses(site)
    _check_names("joints", [one.joint.surface for one in site.joints])
    for name, _, rock in site.layers:
        if not SPEEDS[0] <= rock.cs < rock.cp <= SPEEDS[1]:
            raise InputError(
                f"layers.{name}: speeds must lie in {SPEEDS[0]:g} to {SPEEDS[1]:g} m/s, "
                f"got vp {rock.cp:g}, vs {rock.cs:g}"
            )
    for one in site.joints:
        if one.joint.surface in SIDES:
            raise InputError(f"joints.{one.joint.surface}: is a side of the box; take another name")
        start, end = site.box["xy".index(one.axis)]
        if not start < one.position < end:
            raise InputError(
                f"joints.{one.joint.surface}.position: must lie within the box, {start:g} to "
                f"{end:g} m, got {one.position:g}"
            )
        _check_rims(site.box, one)
    for one in site.receivers:
        refuse_outside(site.box, f"receivers.{one.name}", one.position)
    _check_source(site.moment_rate)
    for name, blast in site.blasts.items():
        check_holes(site.box, name, blast)
    _check_stations(site)


def _check_names(part, names):
    """Refuse a name that two layers or two joints have, by which one would stand for both."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{part}: {name!r} is there twice; each needs a name of its own")


def _check_thicknesses(site):
    """Refuse layers that do not share out the height of the box, the last taking the rest."""
    top, bottom = 0.0, site.box[2, 0] - site.box[2, 1]
    for name, thickness, _ in site.layers[:-1]:
        if thickness is None or not thickness > 0.0:
            raise InputError(f"layers.{name}.thickness_m: must be positive, got {thickness}")
        top -= thickness
        if top <= bottom:
            raise InputError(
                f"layers.{name}: ends {-top:g} m below the ground, at or below the bottom of the "
                f"box at {-bottom:g} m; leave out the layers below it, or give a deeper box"
            )
    name, thickness, _ = site.layers[-1]
    if thickness is not None:
        raise InputError(f"layers.{name}.thickness_m: the last layer has no end; leave it out")


def _check_rims(box, one):
    """Refuse a `SiteJoint` no part of which lies in the box (3, 2) m."""
    along, down = box["yx".index(one.axis)], box[2, 1] - box[2, ::-1]
    for name, part, room in (("extent", one.extent, along), ("depth", one.depth, down)):
        low, high = np.clip(part, *room)
        if not low < high:
            raise InputError(
                f"joints.{one.joint.surface}.{name}: must go from low to high and reach into the "
                f"box, {room[0]:g} to {room[1]:g} m, got {part[0]:g} to {part[1]:g}"
            )


def _check_source(rate):
    """Refuse a moment rate that begins before its hole fires: no run has begun there."""
    size = np.abs(rate.values)
    begins = rate.start + rate.dt * np.argmax(size > EARLY * np.max(size))
    if begins < 0.0:
        raise InputError(
            f"source: its moment rate begins at {begins:g} s, but no hole sends anything before it "
            f"fires at 0; shift the table, and all records with it, by {-begins:g} s to later"
        )


def check_holes(box, name, blast: Blast):
    """Refuse a blast of which a hole lies outside of a box (3, 2) m, or has an unknown charge."""
    for hole, place, charge in zip(blast.hole_ids, blast.centres, blast.charge, strict=True):
        refuse_outside(box, f"{name}: hole {hole}", place)
        if np.isnan(charge):
            raise InputError(f"{name}: hole {hole}: its charge is missing; give kg, 0 for a dud")
    if not np.any(blast.charge > 0.0):
        raise InputError(f"{name}: no hole has a charge")


def refuse_outside(box, name, place):
    """Refuse a place in m, of something of a name, that is not in a box (3, 2) m."""
    low, high = box.T
    if not (np.all(np.array(place) >= low - NEAR) and np.all(np.array(place) <= high + NEAR)):
        raise InputError(f"{name}: lies outside of the box of the ground; move it into it")


def _check_stations(site):
    """Refuse records of stations that are no receivers, which nothing would be compared with."""
    known = {one.name for one in site.receivers}
    for blast, records in site.records.items():
        for name in records:
            if name not in known:
                raise InputError(
                    f"{blast}: station {name!r} of its records is no receiver; list it, or take "
                    "it out of the file"
                )
