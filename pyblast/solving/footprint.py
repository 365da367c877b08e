"""What a model takes of memory while it is turned into arrays, and while it marches."""

import numpy as np

from .edges import LINEAR, TOGETHER

# Measured: bytes for a zone, a node, a contact, while edges are numbered, while their springs are
# made, while patches are, and while a model marches; beside them what zones and nodes take that
# remember.
NUMBERED, SPRINGS = np.array([275.0, 850.0, 0.0]), np.array([215.0, 340.0, 0.0])
PATCHES = np.array([580.0, 380.0, 0.0])
ALONE = 385.0  # of a zone that has no springs
HELD, HELD_QUADRATIC = np.array([115.0, 860.0, 280.0]), np.array([350.0, 445.0, 490.0])
YIELDING, YIELDING_HELD, RELAXING = 90.0, 340.0, 75.0  # each zone; node and further rate
STATIC = 215.0  # of each zone: springs of the static stage are made beside those that stay
ALWAYS, SHARED = 3e5, 512.0  # the latter of each of the zones whose springs are made together
SAMPLE_BYTES = 100.0  # of a receiver and step
HISTORY_BYTES = 25.0  # of a load's history and step


def marching_bytes(model, n_samples=0, n_loaded=0):
    """Return what assembly and march of a model take beside its mesh, bytes.

    Parameters
    ----------
    model : Model
    n_samples : int
        Steps times receivers.
    n_loaded : int
        Steps times histories of loads.

    Notes
    -----
    Constant-strain zones take most while springs are made of them, others while they march.
    """
    nodes = model.nodes
    n_contacts = 0 if nodes.contacts is None else len(nodes.contacts.area)
    counts = np.array([len(nodes.zone_nodes), len(nodes.points), n_contacts])
    n_yielding = np.count_nonzero(model.yielding())
    rates = {one.rate for group in model.mesh.groups for one in model.branches(group)}
    held = (HELD_QUADRATIC if nodes.quadratic else HELD) @ counts + YIELDING_HELD * n_yielding
    held += RELAXING * len(nodes.points) * max(0, len(rates) - 1)
    own = ALWAYS + (held if nodes.quadratic else max(held, _made(model, counts, n_yielding)))
    return float(own) + SAMPLE_BYTES * n_samples + HISTORY_BYTES * n_loaded


def _made(model, counts, n_yielding):
    """Return the most that constant-strain zones take while they are turned into arrays, bytes."""
    made = ALONE * counts[0]
    if any(_springs(model, group) for group in model.mesh.groups):
        shared = SHARED * min(counts[0], TOGETHER)
        most = max(NUMBERED @ counts, SPRINGS @ counts + shared)
        made = max(made, most + YIELDING * n_yielding)
    if n_yielding:
        made = max(made, PATCHES @ counts * n_yielding / counts[0])
    return made + (STATIC * counts[0] if model.insitu is not None else 0.0)


def _springs(model, group):
    """Tell whether the zones of a group are made into springs."""
    alike = all(one.shear == one.compression for one in model.branches(group))
    return alike and model.law(group).name in LINEAR
