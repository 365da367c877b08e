"""Laws of nature that every law of joints and zones keeps. Case L12."""

import copy

import numpy as np
from scipy.spatial.transform import Rotation

from pyblast.core import JOINT_LAWS, ZONE_LAWS
from verification.contact import KN, KS, NORMAL, TENSION, WEAKER, Contact, cycles, given_back
from verification.suite import Reading, case
from verification.zone import Zone, strain_cycle, turned_column, turned_zone

LINEAR_AT_FIRST = [name for name, law in JOINT_LAWS.items() if law.elastic or law.sticks]
SEEDS = range(4)
PRESSED = ((0.0, 0.0, 0.0), (2e4, 1e4, -1e5), (3e5, -1e5, -3e6))


def stiffness_error():
    """Return the largest relative error of a first, small traction."""
    wanted = np.array([KS * 1e-5, -KS * 2e-5, -KN * 3e-5])
    found = [Contact(law).move(1e-5, -2e-5, -3e-5) for law in LINEAR_AT_FIRST]
    return np.abs(np.array(found) / wanted - 1.0).max()


def turning_error(law, seed):
    """Return how far the tractions of a turned contact are from the turned tractions."""
    turn, initial = Rotation.random(rng=np.random.default_rng(seed)), np.array(PRESSED[1])
    contact = Contact(law, initial, **WEAKER)
    turned = Contact(law, turn.apply(initial), normal=turn.apply(NORMAL), **WEAKER)
    pairs = np.array([
        (turned.move(turn.apply(jump)), turn.apply(contact.move(jump)))
        for jump in cycles(seed, 300)
    ])  # fmt: skip
    return np.abs(pairs[:, 0] - pairs[:, 1]).max() / np.abs(pairs).max()


def energy_given_back(law, seed):
    """Return what a law gives back over a closed path, over the most it stored; worst pressure."""
    return max(given_back(law, initial, cycles(seed, 1500), **WEAKER) for initial in PRESSED)


def carried_when_open(law, seed):
    """Return the traction of an open contact, over its tension."""
    shear = np.random.default_rng(seed).normal(scale=1e-3, size=2)
    return np.abs(Contact(law).move(*shear, 1.01 * TENSION / KN)).max() / TENSION


def bits_lost(law):
    """Count tractions that differ where a contact goes on from a copy of what it keeps."""
    contact, path = Contact(law, **WEAKER), cycles(3, 300)
    for jump in path[:150]:
        contact.move(jump)
    again = copy.deepcopy(contact)
    return sum(contact.move(jump).tobytes() != again.move(jump).tobytes() for jump in path[150:])


def zone_turning_error(name, seed):
    """Return how far the stresses of a turned zone are from the turned stresses."""
    turn = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    zone, other = Zone(name), turned_zone(name, turn)
    pairs = np.array([
        (other.strain(turned_column(turn, strain, 2.0)), turned_column(turn, zone.strain(strain)))
        for strain in strain_cycle(seed, 50)
    ])  # fmt: skip
    return np.abs(pairs[:, 0] - pairs[:, 1]).max() / np.abs(pairs).max()


def zone_energy_given_back(name, seed):
    """Return what a zone gives back over a closed path, over the most it stored."""
    zone, most = Zone(name), 0.0
    for strain in strain_cycle(seed):
        zone.strain(strain)
        most = max(most, zone.stored)
    return max(0.0, -zone.work / most)


def zone_bits_lost(name):
    """Count stresses that differ where a zone goes on from a copy of what it keeps."""
    zone, path = Zone(name), strain_cycle(3)
    for strain in path[:200]:
        zone.strain(strain)
    again = copy.deepcopy(zone)
    return sum(
        zone.strain(strain).tobytes() != again.strain(strain).tobytes() for strain in path[200:]
    )


@case(
    "L12",
    "Laws of nature that all laws of joints and zones keep",
    source="frame indifference, second law of thermodynamics, nothing crosses a gap",
    gate="R",
    tolerance={
        "stiffness": 1e-12,
        "turned axes": 1e-12,
        "energy given back": 1e-12,
        "carried when open": 0.0,
        "bits lost by a restart": 0.0,
        "turned axes, zones": 1e-12,
        "energy given back, zones": 1e-12,
        "bits lost by a restart, zones": 0.0,
    },
    quick=True,
    note="The worst over all laws of joints and zones, over four random paths and, for energy, "
    "three pressures; stiffness: over the laws that begin linearly.",
)
def laws():
    """Lead a contact or a zone of each law through the same paths."""
    opening = [name for name, law in JOINT_LAWS.items() if law.opens]
    worst = {
        "stiffness": stiffness_error(),
        "turned axes": max(turning_error(law, seed) for law in JOINT_LAWS for seed in SEEDS),
        "energy given back": max(energy_given_back(w, seed) for w in JOINT_LAWS for seed in SEEDS),
        "carried when open": max(carried_when_open(law, seed) for law in opening for seed in SEEDS),
        "bits lost by a restart": max(bits_lost(law) for law in JOINT_LAWS),
        "turned axes, zones": max(zone_turning_error(n, s) for n in ZONE_LAWS for s in SEEDS),
        "energy given back, zones": max(
            zone_energy_given_back(n, s) for n in ZONE_LAWS for s in SEEDS
        ),
        "bits lost by a restart, zones": max(zone_bits_lost(name) for name in ZONE_LAWS),
    }
    return [Reading.absolute(what, 0.0, value) for what, value in worst.items()], []
