"""Effects on what receivers write down, on where they stand, and through the air."""

import numpy as np
from scipy import fft, signal

from pyblast.model.model import Receiver

from .effects import effect, log_uniform, logged_blast, receiver
from .nuisances import LEAD
from .sites import BEFORE, DT


@effect
def clock_error(world, rng):
    """Set the clock of a receiver, or of a blast, wrong."""
    shift = float(rng.choice([-1.0, 1.0])) * log_uniform(rng, 2.5e-3, 3e-2)
    if rng.random() < 0.7:
        name = receiver(world, rng)
        lags = {b: {**some, name: some[name] + shift} for b, some in world.lags.items()}
    else:
        name = logged_blast(world, rng)
        lags = {
            b: {r: lag + shift * (b == name) for r, lag in some.items()}
            for b, some in world.lags.items()
        }
    return type(world)(world.site, lags, world.damping, world.heard), name, {"shift": shift}


@effect
def wrong_coordinates(world, rng):
    """Move a receiver, or a blast."""
    far, turn = log_uniform(rng, 5.0, 22.0), rng.uniform(0.0, 2.0 * np.pi)
    way = far * np.array([np.cos(turn), np.sin(turn), 0.0])
    if rng.random() < 0.5:
        name = logged_blast(world, rng)
        blast = world.site.blasts[name]
        world = world.with_blast(name, collar=blast.collar + way, toe=blast.toe + way)
    else:
        name = receiver(world, rng)
        moved = tuple(
            Receiver(r.name, tuple((np.array(r.position) + way).tolist())) if r.name == name else r
            for r in world.site.receivers
        )
        world = world.with_site(receivers=moved)
    return world, name, {"east": float(way[0]), "north": float(way[1])}


@effect
def instrument_response(world, rng):
    """Leave a geophone's swing in, step by step in time, or a wrong gain, not quite even."""
    name = receiver(world, rng)
    if rng.random() < 0.5:
        gain = float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 1.5)))
        gains = gain * np.exp(rng.normal(0.0, 0.03, 3))[:, None]
        return world.hearing(_at(name, lambda v: gains * v)), name, {"gain": gain}
    corner, damping = log_uniform(rng, 2.0, 12.0), float(rng.uniform(0.3, 0.9))
    filters = [_geophone(corner * f, damping) for f in np.exp(rng.normal(0.0, 0.03, 3))]

    def swings(velocity):
        rows = [signal.lfilter(*one, v) for one, v in zip(filters, velocity, strict=True)]
        return np.stack(rows)

    return world.hearing(_at(name, swings)), name, {"corner": corner, "damping": damping}


@effect
def sensor_orientation_or_polarity(world, rng):
    """Turn a receiver, not quite level, or give components the wrong sign."""
    name, tilt = receiver(world, rng), rng.normal(0.0, 0.02)
    signs, turn = np.ones(3), 0.0
    if rng.random() < 0.5:
        turn = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, np.pi))
    elif rng.random() < 0.3:
        signs = -signs
    else:
        signs[rng.integers(3)] = -1.0
    c, s = np.cos(turn), np.sin(turn)
    matrix = np.diag(signs) @ np.array([[c, -s, 0.0], [s, c, tilt], [0.0, -tilt, 1.0]])
    return world.hearing(_at(name, lambda v: matrix @ v)), name, {"turn": turn} if turn else {}


@effect
def air_blast(world, rng):
    """Let a wave in the air, steep in front, move soil as it moves a half space at rest."""
    loud, speed = log_uniform(rng, 300.0, 5e3), float(rng.uniform(330.0, 350.0))
    length, shear = rng.uniform(0.02, 0.05), log_uniform(rng, 2e7, 1.5e8)
    times = DT * np.arange(400)
    pulse = (1.0 - times / length) * np.exp(-1.2 * times / length)  # Friedlander
    pulse -= pulse.mean()

    def passing(velocity, site, blast, name):
        place = np.array(next(r.position for r in site.receivers if r.name == name))
        holes, n = site.blasts[blast], velocity.shape[-1]
        size = fft.next_fast_len(2 * n + 400, real=True)
        frequency, moved = fft.rfftfreq(size, DT), velocity.copy()
        spectrum = fft.rfft(pulse, size)
        spectrum *= np.exp(-2 * np.pi * frequency / speed * -place[2])  # fades with depth
        for collar, charge, time in zip(holes.collar, holes.charge, holes.times, strict=True):
            way = place[:2] - collar[:2]
            far = np.linalg.norm(way)
            peak = loud * (max(far, 5.0) / max(charge, 1e-3) ** (1 / 3) / 10.0) ** -1.3
            lag = time - LEAD + BEFORE * DT + far / speed
            late = peak * spectrum * np.exp(-2j * np.pi * frequency * lag)
            up = fft.irfft(-1j * late * np.sign(frequency), size)[:n] * speed * 0.7 / shear
            out = fft.irfft(late, size)[:n] * speed * 0.2 / shear
            moved += np.stack([way[0] / far * out, way[1] / far * out, up])
        return moved

    return world.hearing(passing), "", {"speed": speed}


def _at(name, change):
    """Return a change of the records of one receiver."""

    def heard(velocity, site, blast, receiver_name):
        del site, blast
        return change(velocity) if receiver_name == name else velocity

    return heard


def _geophone(corner, damping):
    """Return a digital filter of a geophone, matched by the bilinear rule."""
    w = 2.0 * np.tan(np.pi * corner * DT) / DT
    return signal.bilinear([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w**2], 1.0 / DT)
