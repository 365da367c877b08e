"""Effects that are in no library: the right answer is that something unknown is there."""

from dataclasses import dataclass

import numpy as np

from .effects import effect, log_uniform, logged_blast
from .sites import BEFORE, DT, SIZE


@dataclass(frozen=True)
class Block:
    """Ground between limits (3, 2) in m whose waves are slower by one factor."""

    limits: tuple
    slower: float

    def factor(self, places, edges):
        """Return the factor (n,) at places (n, 3)."""
        del edges
        low, high = np.array(self.limits).T
        inside = ((places > low) & (places < high)).all(axis=1)
        return np.where(inside, self.slower, 1.0)


def _with_block(world, limits, slower):
    """Return the world with a block of slower ground."""
    return world.with_site(ground=(*world.site.ground, Block(limits, slower)))


@effect
def void(world, rng):
    """Fill an old working between the bench and the receivers with loose rubble."""
    middle = np.array([rng.uniform(48.0, 80.0), rng.uniform(25.0, 65.0), rng.uniform(-20.0, -9.0)])
    half = np.array([rng.uniform(6.0, 11.0), rng.uniform(10.0, 22.0), rng.uniform(5.0, 8.0)])
    limits = tuple(map(tuple, np.column_stack([middle - half, middle + half]).tolist()))
    return _with_block(world, limits, float(rng.uniform(0.12, 0.3))), "", {}


@effect
def second_blast(world, rng):
    """Add somebody else's shot, logged by nobody, to the records of one blast."""
    name = logged_blast(world, rng)
    blast = world.site.blasts[name]
    while True:
        place = np.array([rng.uniform(10.0, 110.0), rng.uniform(8.0, 82.0), -8.0])
        if np.linalg.norm(place[:2] - blast.centres.mean(axis=0)[:2]) > 40.0:
            break
    charge = blast.charge.mean() * log_uniform(rng, 0.3, 1.5)
    return world.with_blast(
        name, collar=np.vstack([blast.collar, place]), toe=np.vstack([blast.toe, place]),
        charge=np.append(blast.charge, charge),
        times=np.append(blast.times, blast.times[0] + rng.uniform(0.0, 0.2)),
        diameter=np.full(len(blast.charge) + 1, 0.1), hole_ids=(),
        deck=np.nan, stated_length=np.nan, stated_inclination=np.nan, planned=np.nan,
        burden=np.nan, stemming=np.nan, row=np.nan,
    ), name, {}  # fmt: skip


@effect
def reflector(world, rng):
    """Make ground beyond a plane beside the receivers so slow that it sends waves back."""
    place = rng.uniform(70.0, 80.0)
    limits = (-1e4, 1e4), (place, 1e4), (-1e4, 1e4)
    return _with_block(world, limits, float(rng.uniform(0.35, 0.6))), "", {}


@effect
def hum(world, rng):
    """Start a machine during the records of one blast."""
    name, onset = logged_blast(world, rng), rng.uniform(0.05, 0.2)
    frequency, share = rng.uniform(8.0, 20.0), rng.uniform(0.2, 0.7)
    there = np.array([rng.uniform(0.0, SIZE[0]), rng.uniform(0.0, SIZE[1])])

    def humming(velocity, site, blast, receiver_name):
        if blast != name:
            return velocity
        place = next(r.position for r in site.receivers if r.name == receiver_name)
        far = np.linalg.norm(np.array(place[:2]) - there)
        times = DT * (np.arange(velocity.shape[-1]) - BEFORE) - onset - far / 800.0
        size = share * np.abs(velocity).max() * min(1.0, 30.0 / max(far, 1.0)) ** 0.5
        wave = np.clip(times / 0.06, 0.0, 1.0) * np.sin(2.0 * np.pi * frequency * times)
        return velocity + size * np.array([0.6, 0.3, 1.0])[:, None] * wave

    return world.hearing(humming), name, {}
