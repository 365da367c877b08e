"""A block on an inclined joint: physics rung 28, and a block on joint springs, rung 29."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pyblast.meshing.mesh_builder import structured_box
from pyblast.solving.boundaries import Fixed
from pyblast.solving.joints import Joint
from pyblast.solving.model import Model, Receiver
from pyblast.solving.solver import prepare, run
from verification.columns import ROCK

GRAVITY = 9.81
KN, KS = 2e9, 1e9


def plate(friction, pressure=0.0, law="coulomb", **changed):
    """Return a thin block on a fixed base, its joint flat; slopes come in by the load."""
    mesh = structured_box(
        np.linspace(0.0, 4.0, 5),
        np.linspace(0.0, 4.0, 5),
        [0.0, 0.5, 1.0],
        planes={"J": ("z", 0.5)},
    ).split(["J"])
    strength = {"cohesion": 0.0, "friction": friction, "tension": 0.0}
    properties = {"kn": KN, "ks": KS, **(strength if law == "coulomb" else {}), **changed}
    joint = Joint("J", law, properties, insitu_pressure=pressure)
    receiver = Receiver("block", (2.0, 2.0, 0.9))
    return Model(
        mesh, {"rock": ROCK}, joints=[joint], boundaries=[Fixed("bottom")], receivers=[receiver]
    )


def pushed(model, duration, acceleration, rise=0.0):
    """Run with a body force on the block, at once or after a time of rise in s."""
    prepared = prepare(model, duration)
    constants = prepared.constants
    times = constants["dt"] * np.arange(1, prepared.n_steps + 1)
    block = model.mesh.points[:, 2] > 0.5
    block[model.mesh.contacts.plus] = True
    loads = {
        "load_node": np.flatnonzero(block).astype(np.int32),
        "load_vector": constants["node_mass"][block][:, None] * np.asarray(acceleration),
        "load_history": np.zeros(np.count_nonzero(block), dtype=np.int32),
        "load_delay": np.zeros(np.count_nonzero(block)),
        "history": np.minimum(1.0, times / max(rise, 1e-9))[:, None],
    }
    prepared = replace(prepared, constants={**constants, **loads})
    return run(model, duration, prepared=prepared)


@pytest.mark.parametrize(("slope", "friction"), [(30.0, 20.0), (40.0, 35.0), (35.0, 0.0)])
def test_a_block_slides_with_the_closed_form(slope, friction):
    slope, friction = math.radians(slope), math.tan(math.radians(friction))
    weight = ROCK.density * 0.5 * GRAVITY * math.cos(slope)
    model = plate(friction, pressure=weight)

    result = pushed(model, 0.5, [GRAVITY * math.sin(slope), 0.0, 0.0])

    record = result.seismograms["block"]
    late = record.times > 0.1
    wanted = GRAVITY * (math.sin(slope) - math.cos(slope) * friction) * record.times
    found = np.polyfit(record.times[late], record.velocity[late, 0], 1)
    assert found[0] == pytest.approx(wanted[-1] / record.times[-1], rel=0.005)
    assert record.velocity[-1, 0] == pytest.approx(wanted[-1], abs=0.01)  # the springs' start


def test_friction_of_a_sliding_block_is_in_the_ledger():
    slope, friction = math.radians(35.0), 0.4
    weight = ROCK.density * 0.5 * GRAVITY * math.cos(slope)

    result = pushed(plate(friction, pressure=weight), 0.3, [GRAVITY * math.sin(slope), 0.0, 0.0])

    record = result.seismograms["block"]
    path = np.sum(record.velocity[:, 0]) * result.dt
    heat = friction * weight * 16.0 * path
    assert result.energy["joint_dissipated"][-1] == pytest.approx(heat, rel=0.01)


def test_a_block_below_the_friction_angle_sticks():
    slope, friction = math.radians(25.0), math.tan(math.radians(30.0))
    weight = ROCK.density * 0.5 * GRAVITY * math.cos(slope)
    push = [GRAVITY * math.sin(slope), 0.0, 0.0]

    result = pushed(plate(friction, pressure=weight), 0.3, push, rise=0.1)

    moved = result.seismograms["block"].velocity[:, 0].cumsum() * result.dt
    elastic = ROCK.density * 0.5 * GRAVITY * math.sin(slope) / KS
    assert moved[-1] == pytest.approx(elastic, rel=0.15)
    assert np.abs(result.state["contact_state"][:, :3]).max() < 0.2 * elastic  # its edges only


@pytest.mark.parametrize("axis", [0, 2])
def test_a_block_on_joint_springs_swings_at_its_own_frequency(axis):
    stiffness = 1e5
    springs = {"kn": KN, "ks": stiffness} if axis == 0 else {"kn": stiffness, "ks": stiffness}
    push = np.zeros(3)
    push[axis] = 1.0

    record = pushed(plate(0.0, law="elastic", **springs), 0.35, push).seismograms["block"]

    omega = math.sqrt(stiffness / (ROCK.density * 0.5))
    wanted = np.sin(omega * record.times) / omega
    assert record.velocity[:, axis] == pytest.approx(wanted, abs=0.005 * wanted.max())
