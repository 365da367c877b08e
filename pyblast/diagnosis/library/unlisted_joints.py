"""Joints that a site does not list."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ...projects.site import SiteJoint
from ...solving.joints import Joint
from ..hypotheses import Knob, hypothesis

EDGES = 3.0  # of the cells by which planes are apart, to a shortest S wave in the fastest layer
NEAREST = 2.0  # m that an unlisted joint keeps from listed ones


def planes(case):
    """List planes on which a joint may be missing: vertical, between holes and receivers.

    They keep half a spacing from listed joints and holes, and are spread evenly in between; a gap
    of half a spacing or more has one in its middle.
    """
    site, found = case.site, []
    apart = max(material.cs for _, _, material in site.layers) / (EDGES * site.band[1])
    for axis, along in (("x", 0), ("y", 1)):
        holes = np.concatenate([b.centres[:, along] for b in site.blasts.values()])
        heard = [r.position[along] for r in site.receivers if r.name in case.receivers]
        taken = [j.position for j in site.joints if j.axis == axis]
        low, high = min(*heard, *holes), max(*heard, *holes)
        stops = [low, *sorted(p for p in (*holes, *taken) if low < p < high), high]
        for before, after in pairwise(stops):
            if after - before > 0.5 * apart:
                room = max(after - before - apart, 0.0)
                count = max(int(np.ceil(room / apart)), 1)
                steps = 0.5 * (before + after - room) + room * (np.arange(count) + 0.5) / count
                found += [f"{axis}={place:.1f}" for place in steps]
    return tuple(found)


def _plane(site, target, offset):
    """Return axis and place of a plane; None outside of the box or too near a listed joint."""
    axis, place = target[0], float(target[2:]) + offset
    low, high = site.box["xy".index(axis)]
    listed = [j.position for j in site.joints if j.axis == axis]
    near = any(abs(place - other) < NEAREST for other in listed)
    return (axis, place) if low < place < high and not near else None


def _cut_there(site, target, offset, kn, ks):
    """Return the site with zones that end on the plane before it was moved."""
    del offset, kn, ks
    plane = _plane(site, target, 0.0)
    return site if plane is None else replace(site, marks=(*site.marks, plane))


@hypothesis(
    "missing_joint", family="path", on="site", target="plane", targets=planes, axis="both",
    bare=_cut_there,
    knobs=[
        Knob("offset", 0.0, 5.0, "m", starts=(0.0,), low=-25.0, high=25.0),
        Knob("kn", 1e9, 1.5, "Pa/m", log=True, starts=(1e9,), low=2e7, high=5e10),
        Knob("ks", 4e8, 1.5, "Pa/m", log=True, starts=(4e8,), low=1e7, high=2e10),
    ],
    settled_by="receivers close to the plane on both sides, or a blast on its other side",
)  # fmt: skip
def missing_joint(site, target, offset, kn, ks):
    """A vertical joint that the site does not list crosses it at this plane."""
    plane = _plane(site, target, offset)
    if plane is None:
        return None
    joint = Joint(f"missing {target}", "elastic", {"kn": kn, "ks": ks})
    return replace(site, joints=(*site.joints, SiteJoint(joint, *plane)))
