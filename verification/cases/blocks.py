"""One block on one joint: sliding, sticking, swinging. Cases 28 and 29."""

import math
from dataclasses import replace

import numpy as np

from pyblast.errors import SolverError
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.cases.damped_waves import largest_square
from verification.columns import ROCK
from verification.suite import Curve, Reading, case

GRAVITY, THICKNESS = 9.81, 0.5
KN, KS = 2e9, 1e9
SLOPES = ((30.0, 20.0), (40.0, 35.0), (35.0, 0.0))


def plate(law, pressure=0.0, **properties):
    """Return a thin block on a fixed base, its joint flat; slopes come in by the load."""
    axis = np.linspace(0.0, 4.0, 5)
    mesh = structured_box(axis, axis, [0.0, THICKNESS, 1.0], planes={"J": ("z", THICKNESS)})
    joint = Joint("J", law, properties, insitu_pressure=pressure)
    return Model(
        mesh.split(["J"]), {"rock": ROCK}, joints=[joint], boundaries=[Fixed("bottom")],
        receivers=[Receiver("block", (2.0, 2.0, 0.9))],
    )  # fmt: skip


def pushed(model, duration, acceleration, rise=1e-9, factor=None):
    """Run with a body force on the block that rises to its full value over some time in s."""
    prepared = prepare(model, duration)
    dt = prepared.constants["dt"] if factor is None else factor
    n_steps = math.ceil(duration / dt)
    block = model.mesh.points[:, 2] > THICKNESS
    block[model.mesh.contacts.plus] = True
    mass = prepared.constants["node_mass"][block]
    loads = {
        "load_node": np.flatnonzero(block).astype(np.int32),
        "load_vector": mass[:, None] * np.asarray(acceleration),
        "load_history": np.zeros(len(mass), dtype=np.int32),
        "load_delay": np.zeros(len(mass)),
        "load_member": np.full(len(mass), -1, dtype=np.int32),
        "history": np.minimum(1.0, dt * np.arange(1, n_steps + 1) / rise)[:, None],
        "dt": dt,
    }
    constants = {**prepared.constants, **loads}
    return simulate(
        model, duration, prepared=replace(prepared, constants=constants, n_steps=n_steps)
    )


@case(
    "28",
    "Sliding block",
    source="v = g (sin s - cos s tan f) t; it sticks where tan s < tan f",
    gate="C",
    tolerance={
        **{f"acceleration on {s:g} deg, friction {f:g} deg": 0.005 for s, f in SLOPES},
        "slip on 25 deg, friction 30 deg": 0.2,
    },
    quick=True,
    note="Slip where it should stick is over the elastic displacement of the joint: corners give.",
)
def sliding():
    """Let a block slide down three slopes and stick on a fourth."""
    readings, curves = [], []
    for slope, friction in SLOPES:
        turn, mu = math.radians(slope), math.tan(math.radians(friction))
        weight = ROCK.density * THICKNESS * GRAVITY * math.cos(turn)
        strength = {"kn": KN, "ks": KS, "cohesion": 0.0, "friction": mu, "tension": 0.0}
        done = pushed(plate("coulomb", weight, **strength), 0.5, [GRAVITY * math.sin(turn), 0, 0])
        record = done.seismograms["block"]
        late = record.times > 0.1
        wanted = GRAVITY * (math.sin(turn) - math.cos(turn) * mu)
        found = np.polyfit(record.times[late], record.velocity[late, 0], 1)[0]
        name = f"acceleration on {slope:g} deg, friction {friction:g} deg"
        readings.append(Reading.relative(name, wanted, found))
        curves.append(Curve(f"{slope:g} deg, friction {friction:g} deg", record.times,
                            wanted * record.times, record.velocity[:, 0], "time [s]",
                            "velocity [m/s]"))  # fmt: skip
    turn = math.radians(25.0)
    weight = ROCK.density * THICKNESS * GRAVITY * math.cos(turn)
    strength["friction"] = math.tan(math.radians(30.0))
    push = [GRAVITY * math.sin(turn), 0.0, 0.0]
    done = pushed(plate("coulomb", weight, **strength), 0.3, push, rise=0.1)
    elastic = ROCK.density * THICKNESS * push[0] / KS
    slip = float(np.abs(done.state["contact_state"][:, :3]).max() / elastic)
    readings.append(Reading.absolute("slip on 25 deg, friction 30 deg", 0.0, slip))
    return readings, curves


@case(
    "29",
    "Block on joint springs",
    source="f = sqrt(kA/m)/2 pi; limit 2/sqrt(k A (1/m1 + 1/m2)) of a stiff joint",
    gate="R",
    tolerance={
        "swing in shear": 0.005, "swing along the normal": 0.005,
        "growth at the step pyblast takes": 0.5, "growth at 0.98 of the limit": 0.5,
        "growth at 1.02 of the joint's limit": 0.5,
    },
    quick=True,
    note="Growth is 0 or 1; the joint is made so stiff that it governs the time step. The limit "
        "is 2/w, with w2 the sum of the joint's and the largest of the zones.",
)  # fmt: skip
def swinging():
    """Let a block swing on shear and on normal springs; drive a stiff joint beyond its limit."""
    readings, curves = [], []
    omega = math.sqrt(1e5 / (ROCK.density * THICKNESS))
    for name, axis in (("in shear", 0), ("along the normal", 2)):
        springs = {"kn": KN if axis == 0 else 1e5, "ks": 1e5}
        push = np.eye(3)[axis]
        record = pushed(plate("elastic", **springs), 0.35, push).seismograms["block"]
        wanted = np.sin(omega * record.times) / omega
        found = record.velocity[:, axis]
        readings.append(Reading.norm(f"swing {name}", wanted, found))
        curves.append(Curve(name, record.times, wanted, found, "time [s]", "velocity [m/s]"))
    stiff = plate("elastic", kn=1e13, ks=1e13)
    dt = prepare(stiff, 0.01).constants["dt"]
    contacts = stiff.mesh.contacts
    constants = prepare(stiff, 0.01).constants
    mass = constants["node_mass"]
    worst = (contacts.area * 1e13 * (1.0 / mass[contacts.plus] + 1.0 / mass[contacts.minus])).max()
    readings += [
        Reading.absolute("growth at the step pyblast takes", 0.0, grown(stiff, dt)),
        Reading.absolute("growth at 0.98 of the limit", 0.0,
                         grown(stiff, 0.98 * 2.0 / math.sqrt(worst + largest_square(constants)))),
        Reading.absolute("growth at 1.02 of the joint's limit", 1.0,
                         grown(stiff, 1.02 * 2.0 / math.sqrt(worst))),
    ]  # fmt: skip
    return readings, curves


def grown(model, dt):
    """Tell (1 or 0) whether a pushed block blows up at a time step."""
    try:
        pushed(model, 2000 * dt, [1.0, 0.5, -0.5], factor=dt)
    except SolverError:
        return 1.0
    return 0.0
