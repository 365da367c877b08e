"""Small sites as they are believed to be, drawn at random."""

import numpy as np

from pyblast.blasts.blast import Blast
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Receiver
from pyblast.model.source import TimeFunction
from pyblast.project.site import Site, SiteJoint

SIZE = 120.0, 90.0, 60.0
BAND = 5.0, 25.0
DT, BEFORE, AFTER = 0.004, 60, 110  # s, samples before the first hole and from it on
FURTHER, HIDDEN = "H1", "RH"  # blast and receiver that no diagnosis reads
APART = 14.0  # m between joints
# Depth in m of charges below the weathered rock, or below the first of the ground: what a charge
# sends from an interface depends on the zones there more than on anything that is hidden.
BELOW, FIRST = (4.0, 7.0), 5.0


def draw_site(rng, poor=False) -> Site:
    """Draw a site with the further blast and the hidden receiver, without records.

    Parameters
    ----------
    rng : numpy Generator
    poor : bool
        One blast and one receiver beside those that are hidden.
    """
    bench = np.array([rng.uniform(22.0, 32.0), rng.uniform(28.0, 55.0)])
    joints, layers = _joints(rng), _layers(rng)
    bench = *bench, -(layers[0][1] or FIRST) - rng.uniform(*BELOW)
    blasts = {
        "S1": _blast(rng, bench, 5.0, 1, rng.uniform(8.0, 15.0)),
        "B1": _blast(rng, bench, 5.0, rng.integers(1, 5), rng.uniform(25, 60)),
        "B2": _blast(rng, bench, 5.0, rng.integers(4, 9), rng.uniform(90, 200)),
        FURTHER: _blast(rng, bench, 6.0, 3, rng.uniform(60.0, 120.0)),
    }
    if poor:
        del blasts["S1"], blasts["B1"]
    elif rng.random() < 0.4:
        del blasts["B1"]
    receivers = _receivers(rng, 1 if poor else int(rng.integers(5, 8)), joints)
    return Site(
        name="", box=np.array([[0.0, SIZE[0]], [0.0, SIZE[1]], [-SIZE[2], 0.0]]),
        layers=layers, joints=joints, quality=None, receivers=receivers,
        moment_rate=_pulse(rng), exponent=round(float(rng.uniform(0.75, 0.95)), 3), blasts=blasts,
        records={}, time_zeros={}, band=BAND, noise_window=(-BEFORE * DT, 0.0),
    )  # fmt: skip


def _layers(rng):
    """Draw rock, in four of ten sites under slower rock."""
    cs = rng.uniform(1400.0, 1900.0)
    rock = Material.from_speeds(rng.uniform(2500, 2800), cs * rng.uniform(1.7, 1.95), cs)
    if rng.random() > 0.4:
        return (("rock", None, rock),)
    slow = rng.uniform(0.65, 0.85)  # thin beside its shortest wave, which keeps runs short
    above = Material.from_speeds(rock.density - 150.0, slow * rock.cp, slow * rock.cs)
    return ("weathered", round(float(rng.uniform(10.0, 15.0)), 1), above), ("rock", None, rock)


def _joints(rng):
    """Draw one to three joints between the bench and the far receivers."""
    found = []
    for number in range(rng.integers(1, 4)):
        axis = "y" if number == 2 else "x"
        limits = (62.0, 78.0) if axis == "y" else (45.0, 90.0)
        place = round(float(rng.uniform(*limits)), 1)
        if any(j.axis == axis and abs(j.position - place) < APART for j in found):
            continue
        kn = float(np.exp(rng.uniform(np.log(4e8), np.log(2e9))))
        values = {"kn": round(kn, -6), "ks": round(kn * rng.uniform(0.3, 0.8), -6)}
        pressure = round(float(rng.uniform(0.8e5, 3e5)), -3)
        joint = Joint(f"J{number + 1}", "elastic", values, insitu_pressure=pressure)
        found.append(SiteJoint(joint, axis, place))
    return tuple(found)


def _blast(rng, bench, reach, count, charge):
    """Draw a row or two of holes near a place whose charges sum to about ``charge`` kg."""
    n, start = np.arange(count), np.array(bench)
    start[:2] += rng.uniform(-reach, reach, 2)
    centres = start + np.column_stack([n % 2 * 4.0, n // 2 * 4.5, 0.0 * n])
    centres[:, :2] += rng.uniform(-0.3, 0.3, (count, 2))
    weights = charge / count * rng.uniform(0.9, 1.1, count)
    centres, weights = centres.round(2), weights.round(2)
    delays = n * rng.choice([0.017, 0.025, 0.033])
    return Blast("", centres, centres, weights, delays, np.full(count, 0.1))


def _receivers(rng, count, joints):
    """Draw receivers, most of them beyond the first joint, and the hidden one."""
    places = []
    while len(places) <= count:
        x = rng.uniform(12.0, 112.0) if len(places) % 3 == 2 else rng.uniform(65.0, 112.0)
        place = np.array([x, rng.uniform(10.0, 80.0)]).round(1)
        gaps = [abs(place["xy".index(j.axis)] - j.position) for j in joints]
        near = [np.linalg.norm(place - np.array(other[:2])) for other in places]
        bench = abs(place[0] - 30.0) < 14.0
        if not bench and min([*gaps, 99.0]) > 3.0 and min([*near, 99.0]) > 9.0:
            places.append((*place.tolist(), 0.0))
    if count > 1 and rng.random() < 0.5:
        places[0] = (*places[0][:2], round(float(rng.uniform(-25.0, -8.0)), 1))
    named = [*(f"R{n + 1:02d}" for n in range(count)), HIDDEN]
    return tuple(Receiver(name, place) for name, place in zip(named, places, strict=True))


def _pulse(rng):
    """Draw the moment rate of 1 kg."""
    length, step = rng.uniform(0.05, 0.08), 0.001
    times = np.arange(0.0, length + step, step)
    shape = np.sin(np.pi * np.minimum(times / length, 1.0)) ** 2
    rate = rng.uniform(2e9, 6e9) * shape / (shape.sum() * step)
    return TimeFunction(rate, step, 0.0)
