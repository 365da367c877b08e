"""Free-field sides of a layered model under input from below. Case L9."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer
from pyblast.model.boundary import Fixed, FreeField, StressInput, Viscous
from pyblast.model.material import ConstantQ
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.cases.layers import FIRST, ROCK, SOIL, THICKNESS
from verification.columns import misfit, ricker
from verification.suite import Curve, Reading, case

AXIS = {"SV": 0, "SH": 1, "P": 2}
AXES = ("east", "north", "vertical")
SIDES = ("west", "east")
FADING = {
    "soil": replace(SOIL, law=ConstantQ(20.0, 10.0)),
    "rock": replace(ROCK, law=ConstantQ(60.0, 30.0)),
}
GROUNDS = {"elastic": {"soil": SOIL, "rock": ROCK}, "attenuating": FADING}
DURATION = 0.8  # s


def from_below(wave):
    """Return a pulse of 1 m/s about the second resonance of the layer."""
    times = np.arange(0.0, 1.5 / FIRST, 0.005 / FIRST)
    velocity = np.zeros((len(times), 3))
    velocity[:, AXIS[wave]] = ricker(times, 2.0 * FIRST)
    return Seismogram(velocity, times[1])


def shaken(n, wave, ground, width):
    """Shake a slab of layered ground between free-field sides, or a column where it has no width.

    Returns
    -------
    dict of str to Seismogram
        On the west side: at the ground, and at the foot of the layer.
    """
    edge = THICKNESS / n
    along = edge * np.arange(max(1, round(width * n)) + 1)
    heights = edge * np.arange(round(2 * n) + 1)
    layers = [Layer("soil", THICKNESS), Layer("rock")]
    mesh = structured_box(
        along, np.array([0.0, edge]), heights, layers=layers, pattern="alternating"
    )
    still = [name for name in AXES if name != AXES[AXIS[wave]]]
    if width:
        ends = [kind(side) for side in SIDES for kind in (Viscous, FreeField)]
        across = still if wave == "SH" else ["north"]
        ends += [Fixed(side, across) for side in ("south", "north")]
    else:
        ends = [Fixed(side, still) for side in (*SIDES, "south", "north")]
    model = Model(
        mesh,
        GROUNDS[ground],
        boundaries=[*ends, Viscous("bottom"), StressInput("bottom", from_below(wave))],
        receivers=[
            Receiver(name, (0.0, 0.5 * edge, z))
            for name, z in (("ground", heights[-1]), ("foot", heights[-1] - THICKNESS))
        ],
    )
    return simulate(model, DURATION).seismograms


@case(
    "L9",
    "Free-field sides under input from below",
    source="the same ground as a column with guided sides; case 22 compares it with a closed form",
    gate="C",
    tolerance={f"{wave}, {name}": 0.01 for name in GROUNDS for wave in AXIS},
    meshes=(8.0, 12.0, 18.0),
    unit="edges over the layer (twice as many per S wavelength in it)",
    order=0.9,
    note="Norm of the difference of all components on the side, at the surface and at the base of "
    "the layer; the model is as wide as 1.5 layers. Attenuating: Qs 10 and 30, Qp twice "
    "that.",
)
def sides_follow_columns(n):
    """Compare the motion of the sides with that of a column."""
    readings, curves = [], []
    for name in GROUNDS:
        for wave, axis in AXIS.items():
            wanted, found = shaken(n, wave, name, 0.0), shaken(n, wave, name, 1.5)
            times = found["ground"].times
            pairs = {}
            for place in ("ground", "foot"):
                guided = np.zeros((len(times), 3))
                given = wanted[place]
                guided[:, axis] = np.interp(times, given.times, given.velocity[:, axis])
                pairs[place] = guided, found[place].velocity
            error = max(misfit(motion, guided) for guided, motion in pairs.values())
            readings.append(Reading(f"{wave}, {name}", 0.0, error, error))
            if name == "elastic":
                shown = (motion[:, axis] for motion in pairs["ground"])
                curves.append(Curve(f"{wave}, ground at the side", times, *shown, "time [s]",
                                    "velocity [m/s]"))  # fmt: skip
    return readings, curves
