"""Effects that are hidden in true worlds, by other means than the diagnosis has for them.

Each is a function ``(world, rng) -> (world, target, parameters)``; targets and parameters are named
as in the library where they mean the same there.
"""

from dataclasses import dataclass, replace

import numpy as np

from pyblast.model.ground_fields import DamagedZone, Gradient
from pyblast.model.joint import Joint
from pyblast.model.material import Damping, Material

from .nuisances import LEAD
from .sites import FURTHER, HIDDEN, SIZE, SiteJoint

EFFECTS = {}
SLIPLESS = 1e9  # Pa, a tension that nothing reaches


def effect(function):
    """Enter a function under its name."""
    EFFECTS[function.__name__] = function
    return function


def log_uniform(rng, low, high):
    """Draw a number whose logarithm is even."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def large_blast(world, rng):
    """Draw one of the logged blasts that have many holes."""
    many = [n for n, b in world.site.blasts.items() if len(b.charge) > 3 and n != FURTHER]
    return str(rng.choice(many))


def logged_blast(world, rng):
    """Draw one of the logged blasts, not the weakest if there are more."""
    names = [name for name in world.site.blasts if name != FURTHER]
    return str(rng.choice(names[1:] or names))


def receiver(world, rng):
    """Draw one of the receivers that the diagnosis reads."""
    return str(rng.choice([r.name for r in world.site.receivers if r.name != HIDDEN]))


@effect
def delay_scatter(world, rng):
    """Let holes fire at Gaussian times, or all at a wrong pace."""
    blast = large_blast(world, rng)
    times = world.site.blasts[blast].times
    if rng.random() < 0.75:
        delays = rng.normal(0.0, log_uniform(rng, 1.5e-3, 7e-3), len(times))
    else:
        delays = rng.choice([-1.0, 1.0]) * rng.uniform(0.06, 0.2) * (times - LEAD)
    delays = np.maximum(delays, -times)
    return world.with_blast(blast, times=times + delays), blast, {"delays": delays.tolist()}


@effect
def misfire_or_charge_error(world, rng):
    """Let a hole misfire, holes differ, or a whole blast be larger or smaller than logged."""
    kind = rng.choice(["misfire", "holes", "blast"])
    blast = logged_blast(world, rng) if kind == "blast" else large_blast(world, rng)
    charge = world.site.blasts[blast].charge
    scales = np.ones(len(charge))
    if kind == "misfire":
        scales[rng.integers(len(charge))] = 0.0
    elif kind == "holes":
        scales = np.exp(rng.normal(0.0, log_uniform(rng, 0.2, 0.7), len(charge)))
    else:
        scales *= np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.9))
    known = {"scale": float(scales[0])} if kind == "blast" else {"scales": scales.tolist()}
    changed = charge * scales ** (1.0 / world.site.exponent)
    return world.with_blast(blast, charge=changed), blast, known


@effect
def damaged_zone(world, rng):
    """Put slower rock with a sharp edge around the holes."""
    holes = np.concatenate([np.stack([b.collar, b.toe], 1) for b in world.site.blasts.values()])
    zone = Sharp(DamagedZone(holes, 0.0, 1.0), rng.uniform(4.0, 16.0), rng.uniform(0.45, 0.85))
    return world.with_site(ground=(*world.site.ground, zone)), "", {}


@effect
def missing_joint(world, rng):
    """Cut a joint through the mesh where none is listed."""
    axis = str(rng.choice(["x", "x", "y"]))
    low, high = (44.0, 96.0) if axis == "x" else (18.0, 72.0)
    place = clear_plane(world.site, axis, rng, low, high, 9.0)
    kn = log_uniform(rng, 1.5e8, 3e9)
    ks = kn * float(rng.uniform(0.2, 1.0))
    joint = Joint("hidden", "elastic", {"kn": kn, "ks": ks})
    world = world.with_site(joints=(*world.site.joints, SiteJoint(joint, axis, place)))
    return world, f"{axis}={place:.1f}", {"kn": kn, "ks": ks}


@effect
def joint_nonlinear_closure(world, rng):
    """Let a joint close by Barton and Bandis; small waves meet the stiffness that is listed."""
    closed = rng.uniform(0.3, 0.85)

    def rough(joint):
        kn = joint.properties["kn"] * (1.0 - closed) ** 2
        closure = joint.insitu_pressure * (1.0 - closed) / closed / kn
        return Joint(
            joint.surface, "barton_bandis",
            {"kn": kn, "ks": joint.properties["ks"], "closure": closure, "kn_max": 300.0 * kn,
             "jrc": 14.0, "jcs": 1.2e8, "friction": 0.7, "peak_slip": 2e-3},
            joint.insitu_pressure,
        )  # fmt: skip

    world, name = with_joint(world, rng, rough)
    return world, name, {"closed": float(closed)}


@effect
def joint_slip(world, rng):
    """Let a joint weaken as it slips."""
    strength, share = log_uniform(rng, 1e4, 2.5e5), rng.uniform(0.3, 0.95)

    def weakening(joint):
        friction = strength / joint.insitu_pressure
        return Joint(
            joint.surface, "softening",
            {**joint.properties, "cohesion": 0.0, "friction": friction,
             "friction_dynamic": share * friction, "weakening_slip": log_uniform(rng, 3e-5, 1e-3),
             "tension": SLIPLESS},
            joint.insitu_pressure,
        )  # fmt: skip

    world, name = with_joint(world, rng, weakening)
    return world, name, {"strength": strength}


@effect
def joint_viscous_fill(world, rng):
    """Fill a joint: with a mass, slower in shear than in pressure; or as Maxwell has it."""
    relaxation, creeps = log_uniform(rng, 5e-4, 1.5e-2), rng.random() < 0.4

    def filled(joint):
        kn, ks = joint.properties["kn"], joint.properties["ks"]
        slow = (3.0 if creeps else 1.0) * relaxation
        values = {"kn": kn, "ks": ks, "eta_n": slow * kn, "eta_s": rng.uniform(0.5, 2) * slow * ks}
        law, mass = ("maxwell", 0.0) if creeps else ("kelvin", rng.uniform(200.0, 1200.0))
        return Joint(joint.surface, law, values, joint.insitu_pressure, fill_mass=mass)

    world, name = with_joint(world, rng, filled)
    return world, name, {} if creeps else {"relaxation": relaxation}


@effect
def attenuation_Q(world, rng):
    """Damp the whole ground by Rayleigh's rule."""
    q = log_uniform(rng, 4.0, 40.0)
    return replace(world, damping=Damping(0.5 / q, 11.0, corner=75.0)), "", {"q": q}


@effect
def anisotropy(world, rng):
    """Cut parallel fissures, one by one, through the mesh."""
    axis, spacing = str(rng.choice(["x", "y"])), rng.uniform(11.0, 15.0)
    density, cp, cs = (getattr(world.site.layers[-1][2], n) for n in ("density", "cp", "cs"))
    kn = density * cp**2 / (spacing * rng.uniform(0.1, 0.7))
    ks = density * cs**2 / (spacing * rng.uniform(0.1, 0.6))
    planes = [j.position for j in world.site.joints if j.axis == axis]
    along = "xy".index(axis)
    holes = np.concatenate([b.centres[:, along] for b in world.site.blasts.values()])
    found = []
    for number, place in enumerate(np.arange(6.0, SIZE[along] - 3.0, spacing)):
        joint = Joint(f"fissure {number}", "elastic", {"kn": kn, "ks": ks})
        near = min([abs(place - other) for other in planes] + [99.0])
        if near > 4.0 and np.min(np.abs(holes - place)) > 1.0:
            found.append(SiteJoint(joint, axis, float(place)))
    return world.with_site(joints=(*world.site.joints, *found)), "", {}


@effect
def soft_surface_layer(world, rng):
    """Lay soil on top that grows stiffer with depth."""
    thickness, slower = log_uniform(rng, 2.0, 9.0), log_uniform(rng, 0.18, 0.65)
    name, first, rock = world.site.layers[0]
    soil = Material.from_speeds(rock.density - 400.0, slower * rock.cp, slower * rock.cs)
    rest = None if first is None else first - thickness
    layers = ("soil", thickness, soil), (name, rest, rock), *world.site.layers[1:]
    stiffer = OnlyAbove(Gradient(rng.uniform(0.1, 0.35), 0.4 * thickness), -thickness)
    world = world.with_site(layers=layers, ground=(*world.site.ground, stiffer))
    return world, "", {"thickness": thickness, "slower": slower}


def with_joint(world, rng, change):
    """Return the world with one of its joints changed, and the name of the joint."""
    chosen = world.site.joints[rng.integers(len(world.site.joints))]
    joints = tuple(
        replace(j, joint=change(j.joint)) if j is chosen else j for j in world.site.joints
    )
    return world.with_site(joints=joints), chosen.joint.surface


def clear_plane(site, axis, rng, low, high, room):
    """Draw a plane that keeps away from joints, and from holes."""
    along = "xy".index(axis)
    taken = [j.position for j in site.joints if j.axis == axis]
    holes = np.concatenate([b.centres[:, along] for b in site.blasts.values()])
    while True:
        place = round(float(rng.uniform(low, high)), 1)
        far = min([abs(place - other) for other in taken] + [99.0])
        if far > room and np.min(np.abs(holes - place)) > 3.0:
            return place


@dataclass(frozen=True)
class Sharp:
    """Ground that is slower by one factor within a distance in m of holes."""

    zone: DamagedZone
    radius: float
    slower: float

    def factor(self, places, edges):
        """Return the factor (n,) at places (n, 3)."""
        del edges
        return np.where(self.zone.distance(places) < self.radius, self.slower, 1.0)


@dataclass(frozen=True)
class OnlyAbove:
    """A gradient that ends at a height in m."""

    gradient: Gradient
    base: float

    def factor(self, places, edges):
        """Return the factor (n,) at places (n, 3)."""
        return np.where(places[:, 2] > self.base, self.gradient.factor(places, edges), 1.0)
