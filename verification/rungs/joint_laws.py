"""Laws of nature that every joint law keeps. Rung L12."""

import copy

import numpy as np
from scipy.spatial.transform import Rotation

from pyblast.solving.kernels import JOINT_LAWS
from verification.contact import KN, KS, NORMAL, TENSION, WEAKER, Contact, cycles
from verification.ladder import Reading, rung

LINEAR_AT_FIRST = ("elastic", "coulomb", "softening")
SEEDS = range(4)


def stiffness_error():
    """Return the largest relative error of a first, small traction."""
    wanted = np.array([KS * 1e-5, -KS * 2e-5, -KN * 3e-5])
    found = [Contact(law).move(1e-5, -2e-5, -3e-5) for law in LINEAR_AT_FIRST]
    return np.abs(np.array(found) / wanted - 1.0).max()


def turning_error(law, seed):
    """Return how far the tractions of a turned contact are from the turned tractions."""
    turn = Rotation.random(rng=np.random.default_rng(seed))
    initial = np.array([2e4, 1e4, -1e5])
    contact = Contact(law, initial, **WEAKER)
    turned = Contact(law, turn.apply(initial), normal=turn.apply(NORMAL), **WEAKER)
    pairs = np.array([
        (turned.move(turn.apply(jump)), turn.apply(contact.move(jump)))
        for jump in cycles(seed, 300)
    ])  # fmt: skip
    return np.abs(pairs[:, 0] - pairs[:, 1]).max() / np.abs(pairs).max()


def energy_given_back(law, seed):
    """Return what a law gives back over a closed path, over the most it stored."""
    contact, most = Contact(law, **WEAKER), 0.0
    for jump in cycles(seed):
        contact.move(jump)
        most = max(most, contact.stored)
    return max(0.0, -contact.dissipated) / most


def carried_when_open(law, seed):
    """Return the traction of an open contact, over its tension."""
    shear = np.random.default_rng(seed).normal(scale=1e-3, size=2)
    return np.abs(Contact(law).move(*shear, 1.01 * TENSION / KN)).max() / TENSION


def bits_lost(law):
    """Count tractions that differ where a contact goes on from a copy of what it keeps."""
    contact = Contact(law, **WEAKER)
    path = cycles(3, 300)
    for jump in path[:150]:
        contact.move(jump)
    again = copy.deepcopy(contact)
    return sum(
        contact.move(jump).tobytes() != again.move(jump).tobytes() for jump in path[150:]
    )


@rung(
    "L12",
    "Laws of nature that all joint laws keep",
    source="frame indifference, second law of thermodynamics, nothing crosses a gap",
    gate="R",
    tolerance={
        "stiffness": 1e-12,
        "turned axes": 1e-12,
        "energy given back": 1e-12,
        "carried when open": 0.0,
        "bits lost by a restart": 0.0,
    },
    quick=True,
    note="The worst of all laws and of four random paths; the first of the laws that begin linear.",
)
def laws():
    """Lead a contact of each law through the same paths."""
    opening = [name for name, law in JOINT_LAWS.items() if "gap" in law.state]
    worst = {
        "stiffness": stiffness_error(),
        "turned axes": max(turning_error(law, seed) for law in JOINT_LAWS for seed in SEEDS),
        "energy given back": max(energy_given_back(w, seed) for w in JOINT_LAWS for seed in SEEDS),
        "carried when open": max(carried_when_open(law, seed) for law in opening for seed in SEEDS),
        "bits lost by a restart": max(bits_lost(law) for law in JOINT_LAWS),
    }
    return [Reading.absolute(what, 0.0, value) for what, value in worst.items()], []
