"""What must hold on any mesh: energy, axes, reciprocity, superposition. Cases 26, 27, 31, 33."""

import numpy as np
from scipy.spatial.transform import Rotation

from pyblast.core import JOINT_LAWS
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Damping
from pyblast.model.model import Model, Receiver
from pyblast.model.source import Hole, PointForce, TimeFunction
from pyblast.runs.greens import greens_functions
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.cases.plane_waves import forces
from verification.columns import ROCK, ricker, started
from verification.suite import Curve, Reading, case

SIDES = ("west", "east", "south", "north", "bottom")
WEAK = {"kn": 2e9, "ks": 1e9, "cohesion": 0.0, "friction": 0.4, "tension": 0.0}
STICKY = {"kn": 2e9, "ks": 1e9, "cohesion": 3e4, "friction": 0.0, "tension": 1e9,
          "tension_residual": 1e9}  # fmt: skip
STRONG = {"kn": 2e9, "ks": 1e9}
TIMES = np.arange(0.0, 0.1, 5e-4)
A, B = np.array([11.0, 17.0, 14.0]), np.array([33.0, 8.0, 21.0])
RATE = TimeFunction(1e9 * ricker(TIMES, 30.0), 5e-4)
HOLES = (
    Hole(A, 20.0, 0.0, RATE),
    Hole(np.array([8.0, 9.0, 10.0]), 35.0, 0.0173, RATE, 0.8),
)


def crooked(turn=None):
    """Return a jointed box with nodes moved at random, turned as a whole."""
    mesh = structured_box((8, 6, 6), (40.0, 30.0, 30.0), planes={"J": ("x", 20.0)})
    points = mesh.points.copy()
    moves = np.random.default_rng(2).uniform(-1.0, 1.0, size=points.shape)
    moves[(points == 0.0) | (points == points.max(axis=0)) | (points == 20.0)] = 0.0
    points = points + moves
    if turn is not None:
        points = turn.apply(points)
    mesh = Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces)
    return mesh.split(["J"])


def shaken_box(law="coulomb", turn=None, sources=(), amplitude=0.2, properties=None):
    """Return the model of the box under shaking from the west."""
    properties = properties or (STRONG if law == "elastic" else WEAK)
    turn = turn or Rotation.identity()
    boundaries = list(map(Viscous, SIDES))
    if amplitude:
        motion = amplitude * ricker(TIMES, 30.0)[:, None] * [0.8, 0.5, -0.3]
        boundaries.append(StressInput("west", Seismogram(turn.apply(motion), TIMES[1])))
    joint = Joint("J", law, properties, insitu_pressure=5e4)
    return Model(
        crooked(turn), {"rock": ROCK}, joints=[joint], boundaries=boundaries,
        damping=Damping(0.01, 30.0, stiffness=False), sources=sources,
        receivers=[Receiver("A", turn.apply(A)), Receiver("B", turn.apply(B))],
    )  # fmt: skip


def shaken(law="coulomb", turn=None, sources=(), amplitude=0.2):
    """Run the box; return the run."""
    return simulate(shaken_box(law, turn, sources, amplitude), 0.15)


@case(
    "26",
    "Energy ledger",
    source="kinetic + stored + lost = put in",
    gate="R",
    tolerance={"elastic, 10 000 steps": 1e-3, "joints, dashpots, damping": 1e-3,
               "slip and opening": 0.01, "slip by strength times slip": 0.01,
               "work of slip": 0.01},
    quick=True,
    note="The loss at a contact is by definition the work of its mean traction less what it "
        "stores, so slip and opening balance to rounding. Slip by strength times slip closes the "
        "balance with "
    "what cohesion alone takes along the path of all contacts, which no energy enters.",
)  # fmt: skip
def ledger():
    """Compare what was put in with what is found."""
    mesh = structured_box((3, 3, 3), (6.0, 6.0, 6.0))
    body = Model(mesh, {"rock": ROCK})
    velocity = np.random.default_rng(3).normal(size=body.mesh.points.shape)
    dt = prepare(body, 1.0).constants["dt"]
    alone = started(body, 10_000 * dt, 0.0 * velocity, velocity)
    elastic, slipping = shaken("elastic"), shaken()
    energy = slipping.energy
    kept = sum(energy[n] for n in ("kinetic", "strain", "joint_stored"))
    lost = sum(energy[n] for n in ("joint_dissipated", "damping", "dashpots"))
    errors = (alone.balance_error, elastic.balance_error, slipping.balance_error)
    names = ("elastic, 10 000 steps", "joints, dashpots, damping", "slip and opening")
    readings = [Reading(n, 0.0, e, e) for n, e in zip(names, errors, strict=True)]
    sticky = shaken_box(properties=STICKY)
    slid = simulate(sticky, 0.15)
    path = slid.state["contact_state"][:, JOINT_LAWS["coulomb"].state.index("length")]
    work = STICKY["cohesion"] * float(sticky.mesh.contacts.area @ path)
    told = slid.energy["joint_dissipated"][-1]
    most = slid.energy["input"].max()
    gap = slid.balance_error + (told - work) / most
    readings += [
        Reading("slip by strength times slip", 0.0, gap, float(gap)),
        Reading.relative("work of slip", work, told),
    ]
    curve = Curve("slipping joint", energy["time"], energy["input"] + energy["insitu"],
                  kept + lost - kept[0], "time [s]", "energy put in, and found [J]")  # fmt: skip
    return readings, [curve]


@case(
    "27",
    "Rigid motion, patch test, turned model",
    source="linear displacement is exact; laws do not know the axes",
    gate="R",
    tolerance={"force of a rigid motion": 1e-12, "patch test": 1e-12, "turned model": 1e-9},
    quick=True,
    note="Forces over the largest corner force of an equally large strain. The turned model "
    "slips; what is left is rounding amplified by slip.",
)
def patch():
    """Move a crooked mesh rigidly and linearly; turn a shaken model."""
    model = Model(crooked(), {"rock": ROCK}, joints=[Joint("J", "elastic", STRONG)])
    constants = prepare(model, 0.01).constants
    points = model.mesh.points
    strain = np.random.default_rng(4).normal(scale=1e-3, size=(3, 3))
    linear = forces(constants, points @ strain.T)
    scale = np.abs(linear).max()
    spin = np.array([[0.0, -1e-3, 5e-4], [1e-3, 0.0, -7e-4], [-5e-4, 7e-4, 0.0]])
    rigid = np.abs(forces(constants, points @ spin.T + 1e-3)).max() / scale
    inner = ((points > 1e-9) & (points < points.max(axis=0) - 1e-9)).all(axis=1)
    inner &= points[:, 0] != 20.0
    turn = Rotation.random(rng=np.random.default_rng(1))
    straight, turned = shaken().seismograms["B"], shaken(turn=turn).seismograms["B"]
    wanted = turn.apply(straight.velocity.copy())
    gap = np.abs(turned.velocity - wanted).max() / np.abs(wanted).max()
    values = (rigid, np.abs(linear[inner]).max() / scale, gap)
    names = ("force of a rigid motion", "patch test", "turned model")
    readings = [Reading(n, 0.0, float(v), float(v)) for n, v in zip(names, values, strict=True)]
    return readings, [Curve("turned model", straight.times, wanted[:, 0], turned.velocity[:, 0],
                            "time [s]", "velocity [m/s]")]  # fmt: skip


def stored_gap(side):
    """Return the difference of a blast from stored responses to its run, over the largest PVS."""
    model = shaken_box("elastic", sources=HOLES, amplitude=0.0)
    direct = simulate(model, 0.15).seismograms
    stored = greens_functions(model, 0.15, side=side).blast(HOLES)
    gaps = [np.abs(stored[n].velocity - direct[n].velocity).max() for n in direct]
    return float(max(gaps) / max(record.pvs for record in direct.values()))


@case(
    "31",
    "Reciprocity across a joint",
    source="G_ij(A, B) = G_ji(B, A)",
    gate="R",
    tolerance={"largest difference": 1e-6, "holes stored from the receivers": 1e-6},
    quick=True,
)
def reciprocity():
    """Let source and receiver change places."""
    history, errors = TimeFunction(1e6 * ricker(TIMES, 30.0), 5e-4), []
    for i, j in ((0, 0), (0, 2), (1, 2)):
        there, back = (
            shaken("elastic", sources=[PointForce(at, np.eye(3)[k], history)], amplitude=0.0)
            for at, k in ((A, i), (B, j))
        )
        one = there.seismograms["B"].velocity[:, j]
        other = back.seismograms["A"].velocity[:, i]
        errors.append(np.abs(one - other).max() / np.abs(one).max())
    curve = Curve("north at A, up at B", there.seismograms["B"].times, one, other, "time [s]",
                  "velocity [m/s]")  # fmt: skip
    names = ("largest difference", "holes stored from the receivers")
    values = (max(errors), stored_gap("receiver"))
    return [Reading(n, 0.0, float(v), float(v)) for n, v in zip(names, values, strict=True)], [
        curve
    ]


@case(
    "33",
    "Superposition of holes",
    source="linear models: two holes are the sum of each alone",
    gate="R",
    tolerance={"two holes against their sum": 1e-10, "a hole later": 1e-10,
               "holes stored from their places": 1e-10},
    quick=True,
)  # fmt: skip
def superposition():
    """Fire two holes together and each alone, and one of them later."""
    one, other = HOLES
    both, first, second = (
        shaken("elastic", sources=s, amplitude=0.0).seismograms["B"]
        for s in ([one, other], [one], [other])
    )
    total = first.velocity + second.velocity
    gap = np.abs(both.velocity - total).max() / both.pvs
    early, later = (
        shaken("elastic", sources=[Hole(A, 20.0, n * first.dt, RATE)], amplitude=0.0)
        .seismograms["B"].velocity
        for n in (100, 140)  # late enough that the division of the moment begins after 0
    )  # fmt: skip
    shift = np.abs(later[40:] - early[:-40]).max() / first.pvs
    readings = [
        Reading("two holes against their sum", 0.0, float(gap), float(gap)),
        Reading("a hole later", 0.0, float(shift), float(shift)),
    ]
    stored = stored_gap("source")
    readings.append(Reading("holes stored from their places", 0.0, stored, stored))
    return readings, [Curve("vertical", both.times, total[:, 2], both.velocity[:, 2], "time [s]",
                            "velocity [m/s]")]  # fmt: skip
