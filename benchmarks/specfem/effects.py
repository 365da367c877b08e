"""Effects that are hidden: functions ``(world, rng) -> (world, parameters)`` by name.

Parameters are named as truths of other independent sites name them.
"""

from dataclasses import replace

import numpy as np

from .ground import VOID, Body
from .hearing import airborne, humming, swinging
from .sites import LARGE, SIZE, Hill, Holes

EFFECTS = {}
FAR, DEEP = 2000.0, 1000.0  # m, beyond all that is meshed


def effect(function):
    """Enter a function under its name."""
    EFFECTS[function.__name__] = function
    return function


@effect
def soft_surface_layer(world, rng):
    """Lay slower ground on top of the rock."""
    thickness, factor = float(rng.uniform(6.0, 9.0)), float(rng.uniform(0.6, 0.75))
    rock = world.site.ground.layers[0][1]
    layers = ((thickness, rock.scaled(cp=factor, cs=factor)), *world.site.ground.layers)
    return world.with_ground(layers=layers), {"thickness": thickness, "factor": factor}


@effect
def attenuation_Q(world, rng):
    """Let waves fade."""
    q = float(np.exp(rng.uniform(np.log(5.0), np.log(10.0))))
    return world.with_ground(q=q), {"Qs": q}


@effect
def topography(world, rng):
    """Raise a hill that the files do not list."""
    place = float(rng.uniform(80.0, 130.0)), float(rng.uniform(60.0, 120.0))
    hill = Hill(float(rng.uniform(18.0, 25.0)), float(rng.uniform(38.0, 46.0)), place)
    return world.with_ground(height=hill), {"h": hill.height, "width": hill.width, "at": place}


@effect
def body(world, rng):
    """Let softer rock lie between blasts and receivers."""
    middle = rng.uniform(100.0, 130.0), rng.uniform(70.0, 115.0)
    size = rng.uniform(40.0, 60.0), rng.uniform(55.0, 75.0), rng.uniform(20.0, 28.0)
    top = float(rng.uniform(7.0, 9.0)) + _soil(world)
    return _with_body(world, middle, size, top, float(rng.uniform(0.42, 0.52)))


@effect
def tunnel(world, rng):
    """Drive a tunnel through the whole site."""
    middle = rng.uniform(110.0, 145.0), 0.5 * SIZE[1]
    size = rng.uniform(9.0, 12.0), SIZE[1] + 100.0, rng.uniform(8.0, 10.0)
    return _with_body(world, middle, size, float(rng.uniform(8.0, 12.0)) + _soil(world), VOID)


@effect
def dyke(world, rng):
    """Let a stiff dyke stand upright in the whole site."""
    middle = rng.uniform(105.0, 140.0), 0.5 * SIZE[1]
    size = rng.uniform(14.0, 22.0), 2 * FAR, DEEP
    return _with_body(world, middle, size, _soil(world), float(rng.uniform(1.4, 1.6)))


@effect
def basin(world, rng):
    """Fill an old pit with soft ground."""
    middle = rng.uniform(60.0, 120.0), rng.uniform(60.0, 120.0)
    size = rng.uniform(55.0, 80.0), rng.uniform(60.0, 90.0), rng.uniform(12.0, 18.0)
    return _with_body(world, middle, size, 0.0, float(rng.uniform(0.45, 0.6)))


@effect
def contact(world, rng):
    """Let another rock begin beyond an upright plane."""
    edge = float(rng.uniform(80.0, 130.0))
    middle = 0.5 * (edge - FAR), 0.5 * SIZE[1]
    size = edge + FAR, 2 * FAR, DEEP
    return _with_body(world, middle, size, _soil(world), float(rng.uniform(0.7, 0.8)))


@effect
def damaged_zone(world, rng):
    """Put slower rock around the holes."""
    places = np.concatenate([b.places[:, :2] for b in world.site.blasts.values()])
    low, high = places.min(axis=0) - rng.uniform(4, 9), places.max(axis=0) + rng.uniform(4, 9)
    size = *(high - low), rng.uniform(13.0, 17.0)
    return _with_body(world, 0.5 * (low + high), size, 0.0, float(rng.uniform(0.65, 0.8)))


@effect
def rock_speed(world, rng):
    """Let all ground be faster or slower than listed by more than calibration expects."""
    factor = float(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.05, 0.09))
    layers = tuple((t, rock.scaled(cp=factor, cs=factor)) for t, rock in world.site.ground.layers)
    return world.with_ground(layers=layers), {"factor": factor}


@effect
def misfire_or_charge_error(world, rng):
    """Let a hole of the large blast fail."""
    scales = world.site.blasts[LARGE].scales.copy()
    hole = int(rng.integers(len(scales)))
    scales[hole] = float(rng.choice([0.0, 0.2]))
    return world.with_holes(LARGE, scales=scales), {"holes": [hole + 1], "factor": scales[hole]}


@effect
def delay_scatter(world, rng):
    """Let holes of the large blast fire early or late."""
    holes, spread = world.site.blasts[LARGE], float(np.exp(rng.uniform(*np.log([2.5e-3, 5.5e-3]))))
    delays = rng.normal(0.0, spread, len(holes.times))
    delays -= min(0.0, (holes.times + delays).min())
    return world.with_holes(LARGE, times=holes.times + delays), {"spread": spread}


@effect
def wrong_coordinates(world, rng):
    """Move a receiver, or the holes of the large blast."""
    far, turn = rng.uniform(8.0, 16.0), rng.uniform(0.0, 2.0 * np.pi)
    way = far * np.array([np.cos(turn), np.sin(turn)])
    found = {"east": float(way[0]), "north": float(way[1])}
    if rng.random() < 0.5:
        places = world.site.blasts[LARGE].places + np.append(way, 0.0)
        return world.with_holes(LARGE, places=places), found | {"target": LARGE}
    receivers = world.site.receivers.copy()
    at = int(rng.integers(len(receivers)))
    receivers[at, :2] += way
    return world.with_site(receivers=receivers), found | {"target": world.site.names()[at]}


@effect
def second_blast(world, rng):
    """Let a neighbour fire during the large blast."""
    holes, place = world.site.blasts[LARGE], (rng.uniform(20, 70), rng.uniform(20, 160))
    z = float(world.site.ground.surface(*place)) - _soil(world) - 9.0
    added = Holes(
        np.vstack([holes.places, [*place, z]]),
        np.append(holes.charges, holes.charges.mean() * rng.uniform(0.5, 1.5)),
        np.append(holes.times, rng.uniform(0.0, 0.2)), np.append(holes.scales, 1.0),
    )  # fmt: skip
    return world.with_holes(LARGE, **vars(added)), {"x": place[0], "y": place[1]}


@effect
def instrument_response(world, rng):
    """Leave the swing of a geophone in the records of a receiver."""
    at = int(rng.integers(len(world.site.receivers)))
    corner, damping = float(rng.uniform(3.0, 6.0)), float(rng.uniform(0.4, 0.8))
    heard = (*world.heard, swinging(at, corner, damping))
    named = {"target": world.site.names()[at], "corner": corner, "damping": damping}
    return replace(world, heard=heard), named


@effect
def air_blast(world, rng):
    """Let the wave in the air shake the ground."""
    speed, length = float(rng.uniform(332.0, 348.0)), float(rng.uniform(0.03, 0.06))
    strength = float(np.exp(rng.uniform(*np.log([0.25, 0.5]))))
    heard = (*world.heard, airborne(speed, length, strength))
    return replace(world, heard=heard), {"speed": speed, "length": length, "strength": strength}


@effect
def machine(world, rng):
    """Run a machine beside the site during the large blast."""
    place = float(rng.uniform(0.0, 80.0)), float(rng.uniform(0.0, SIZE[1]))
    frequency, strength = float(rng.uniform(9.0, 18.0)), float(rng.uniform(0.25, 0.5))
    heard = (*world.heard, humming(LARGE, place, frequency, strength, float(rng.uniform(0, 6))))
    return replace(world, heard=heard), {"frequency": frequency, "x": place[0], "y": place[1]}


def _soil(world):
    """Return the thickness in m of what lies on the rock."""
    return float(sum(thickness for thickness, _ in world.site.ground.layers[:-1]))


def _with_body(world, middle, size, top, factor):
    """Return the world with a box of other rock below a depth in m, and its parameters."""
    (x, y), (wx, wy, height) = map(float, middle), map(float, size)
    limits = ((x - 0.5 * wx, x + 0.5 * wx), (y - 0.5 * wy, y + 0.5 * wy),
              (-top - height, -top))  # fmt: skip
    ground = world.site.ground
    parameters = {"x": x, "y": y, "wx": wx, "wy": wy, "top": top, "height": height,
                  "factor": factor}  # fmt: skip
    return world.with_ground(bodies=(*ground.bodies, Body(limits, factor))), parameters
