"""Ground that differs from the model: soft layers, damaged zones, unlisted joints."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ...inference.parameter import Parameter
from ...model.joint import Joint
from ...model.material import Material
from ...project.site import Fabric, SiteJoint
from ..hypotheses import ground_without_loss, hypothesis, three_directions, unknown_quality


@hypothesis(
    "attenuation_Q",
    family="path",
    on="site",
    target="site",
    axis="both",
    parameters=[
        Parameter("q", mean=20.0, sigma=0.8, log=True, starts=(8.0, 25.0), low=4.0, high=300.0)
    ],
    settled_by="receivers at distances of three to one, without a joint between them",
    needs=(unknown_quality,),
)
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
    "anisotropy",
    family="path",
    on="site",
    target="site",
    axis="both",
    bare=_as_stiff,
    parameters=[
        Parameter(
            "azimuth",
            mean=0.0,
            sigma=2.0,
            unit="rad",
            starts=(0.0, 0.79, 1.57, 2.36),
            low=-7.0,
            high=7.0,
        ),
        Parameter("normal", mean=0.2, sigma=0.15, starts=(0.25,), low=0.0, high=0.8),
        Parameter("shear", mean=0.2, sigma=0.15, starts=(0.15,), low=0.0, high=0.8),
    ],
    settled_by="receivers in five or more directions from the blast",
    needs=(ground_without_loss, three_directions),
)
def anisotropy(site, target, azimuth, normal, shear):
    """Upright fissures slow waves across them, at an azimuth from north, more than along them."""
    del target
    if site.quality is not None or site.fabric is not None:
        return None
    return replace(site, fabric=Fabric(0.5 * np.pi - azimuth, normal, shear))


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
    "missing_joint",
    family="path",
    on="site",
    target="plane",
    targets=planes,
    axis="both",
    bare=_cut_there,
    parameters=[
        Parameter("offset", mean=0.0, sigma=5.0, unit="m", starts=(0.0,), low=-25.0, high=25.0),
        Parameter(
            "kn", mean=1e9, sigma=1.5, unit="Pa/m", log=True, starts=(1e9,), low=2e7, high=5e10
        ),
        Parameter(
            "ks", mean=4e8, sigma=1.5, unit="Pa/m", log=True, starts=(4e8,), low=1e7, high=2e10
        ),
    ],
    settled_by="receivers close to the plane on both sides, or a blast on its other side",
)
def missing_joint(site, target, offset, kn, ks):
    """A vertical joint that the site does not list crosses it at this plane."""
    plane = _plane(site, target, offset)
    if plane is None:
        return None
    joint = Joint(f"missing {target}", "elastic", {"kn": kn, "ks": ks})
    return replace(site, joints=(*site.joints, SiteJoint(joint, *plane)))


USUAL = 5.0  # m
APART = 1.4  # ratio of a thickness to start from
THIN, THICK = 1.0, 20.0  # m
SLOWEST, FASTEST = 0.1, 0.9  # factors on the speeds of the ground
FINER = 8  # frequencies of a spectrum in place of one
ALIKE = 2.0  # ratio of thicknesses whose zones differ by less than small errors of the theory


def _layered(site, thickness, slower):
    """Return the site with a slower layer on top; None where there is no room for it."""
    name, first, rock = site.layers[0]
    if thickness > 0.9 * (first or np.ptp(site.box[2])):
        return None
    own, listed = "soft", [there for there, *_ in site.layers]
    while own in listed:
        own = f"unlisted {own}"
    soft = Material.from_speeds(rock.density, slower * rock.cp, slower * rock.cs)
    rest = (name, None if first is None else first - thickness, rock)
    return replace(site, layers=((own, thickness, soft), rest, *site.layers[1:]))


def _as_fast(site, target, thickness, slower):
    """Return the site with a layer that is no slower, of one of few thicknesses."""
    del target, slower
    near = USUAL * ALIKE ** round(math.log(thickness / USUAL, ALIKE))
    return _layered(site, near, 1.0) or _layered(site, thickness, 1.0)


def _ringing(scene):
    """Return thickness and factor of a layer that rings where the records miss most.

    A soft layer rings at a quarter of a wave, f = c_s / (4 H) (Kramer 1996, section 7.2.1.1), and
    slow soil on rock for so long that one of another frequency explains nothing.
    """
    case, rock = scene.case, scene.baseline.site.layers[0][2]
    heard, simulated = (case.in_band(one) for one in (case.motion, scene.baseline.motion))
    size = np.linalg.norm(heard, axis=(2, 3), keepdims=True)
    shares = (heard - simulated)[:, :, :2] / np.maximum(size, np.finfo(float).tiny)
    length = FINER * case.n_samples
    spectrum = np.sum(np.abs(np.fft.rfft(shares, length)) ** 2, axis=(0, 1, 2))
    per_metre = 4.0 * np.fft.rfftfreq(length, case.dt)[max(1, np.argmax(spectrum))] / rock.cs
    slower = float(np.clip(USUAL * per_metre, SLOWEST, FASTEST))
    return float(np.clip(slower / per_metre, THIN, THICK)), slower


@hypothesis(
    "soft_surface_layer",
    family="receiver",
    on="site",
    target="site",
    axis="both",
    bare=_as_fast,
    begins=_ringing,
    parameters=[
        Parameter(
            "thickness",
            mean=USUAL,
            sigma=0.5,
            unit="m",
            log=True,
            starts=(USUAL / APART, USUAL * APART),
            low=THIN,
            high=THICK,
        ),
        Parameter(
            "slower", mean=0.4, sigma=0.4, log=True, starts=(0.4,), low=SLOWEST, high=FASTEST
        ),
    ],
    settled_by="a receiver on bare rock beside one on the ground, or a hammer test",
)
def soft_surface_layer(site, target, thickness, slower):
    """A slower layer that the site does not list lies on top."""
    del target
    return _layered(site, thickness, slower)


@hypothesis(
    "wrong_coordinates",
    form="receiver",
    family="receiver",
    on="motion",
    target="receiver",
    axis="blasts",
    parameters=[
        Parameter("east", mean=0.0, sigma=8.0, unit="m", starts=(0.0,), low=-30.0, high=30.0),
        Parameter("north", mean=0.0, sigma=8.0, unit="m", starts=(0.0,), low=-30.0, high=30.0),
    ],
    settled_by="a survey of the receiver",
)
def moved_receiver(scene, motion, target, east, north):
    """This receiver was elsewhere."""
    at = scene.case.receivers.index(target)
    motion = motion.copy()
    motion[:, at] += scene.surroundings.change(at, east, north)
    return motion
