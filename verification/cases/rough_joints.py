"""Waves across rough joints, and joints that yield from the start. Cases L13 and L14."""

import numpy as np

from pyblast.model.joint import Joint
from verification.cases.nonlinear_joints import (
    FREQUENCY,
    NEARLY_RIGID,
    OMEGA,
    closing,
    crossed,
    harmonic,
    slipping,
)
from verification.columns import IMPEDANCE, spectrum
from verification.contact import Contact
from verification.solutions.joints import past_friction
from verification.solutions.rough_joints import (
    RoughWalls,
    Yielding,
    led_by,
    past_rough_walls,
    past_yielding,
)
from verification.suite import Curve, Reading, case

Z = IMPEDANCE["S"]
ROUGH = {"jrc": 10.0, "jcs": 5e7, "friction": np.tan(np.radians(30.0))}
PRESSURES = (1e6, 2e6, 4e6)
PRESSED = (0.0, 0.5)


def rough(pressure, kn, closure, peak_slip):
    """Return rough walls, nearly rigid in shear, as a joint and as the solution has them."""
    properties = {"kn": kn, "ks": NEARLY_RIGID, "closure": closure, "peak_slip": peak_slip, **ROUGH}
    walls = RoughWalls(kn, closure, peak_slip=peak_slip, **ROUGH)
    return Joint("J", "barton_bandis", properties, pressure), walls


def behind(n, joint, size):
    """Send a harmonic wave of a size (m/s) across a joint.

    Returns
    -------
    times, motion : (n,) float64
        Behind the joint.
    incident : callable
        Velocity at a time, in the same place on the same mesh without the joint.
    """
    values, dt = harmonic()
    motion = crossed("S", n, size * values, dt, joint, 11.0)
    given = motion[False][1]
    return *motion[True][1], lambda time: np.interp(time, *given)


def worn(n):
    """Return times, wanted and found velocity behind walls that dilate and wear under a wave."""
    pressure = 2e5
    joint, walls = rough(pressure, 5e8, 2e-3, 2e-4)
    t, found, incident = behind(n, joint, 0.1)
    return t, past_rough_walls(t, incident, Z, walls, pressure), found


def cycle_sizes(times, motion):
    """Return the root mean square of each whole cycle after the wave has grown."""
    arrived = 3.0 + 2.0  # cycles: three wavelengths, two of growth
    cycles = np.floor(times * FREQUENCY - arrived).astype(int)
    return np.array([np.sqrt(np.mean(motion[cycles == c] ** 2)) for c in range(5)])


@case(
    "L13",
    "Rough joint: closes under a push, caps a shear wave, dilates and wears",
    source="the equation of case 10; the clipped wave of case 8 at Barton's strength, with its "
    "dilation",
    gate="C",
    tolerance={
        **{f"T of a push, {p:g} k Vm before": 0.03 for p in PRESSED},
        **{f"T under {1e-6 * p:g} MPa": 0.02 for p in PRESSURES},
        **{f"{what} under {1e-6 * p:g} MPa": 0.05 for what in "RA" for p in PRESSURES},
        "size of each cycle behind walls that dilate and wear": 0.03,
    },
    meshes=(10.0, 20.0, 40.0),
    order=0.9,
    ordered=(
        *(f"T of a push, {p:g} k Vm before" for p in PRESSED),
        "T under 1 MPa",
        "size of each cycle behind walls that dilate and wear",
    ),
    note="JRC 10, JCS 50 MPa, 30 degrees: the three pressures cap a wave of 5 MPa at 0.21, 0.39 "
    "and 0.69 of it, with a normal spring so soft that dilation adds no pressure; the last joint, "
    "held, grows from 0.5 to 0.9 of its wave by dilation while its roughness wears. 20 edges meet "
    "the push, 40 the wave under 1 MPa; under 2 and 4 MPa T is within 1.2 % on every mesh: no "
    "order.",
)
def rough_walls(n):
    """Send a push and shear waves across Barton-Bandis joints."""
    n = round(n)
    t, wanted, found = worn(n)
    readings = [Reading.norm("size of each cycle behind walls that dilate and wear",
                             cycle_sizes(t, wanted), cycle_sizes(t, found))]  # fmt: skip
    curves = [Curve("dilates and wears", t, wanted, found, "time [s]", "velocity [m/s]")]
    for pressed in PRESSED:
        t, *motions = closing(n, 1.0, "barton_bandis", pressed, peak_slip=1.0, **ROUGH)
        wanted, found, given = (abs(spectrum(t, v, [FREQUENCY])[0]) for v in motions)
        readings.append(Reading.relative(f"T of a push, {pressed:g} k Vm before",
                                         wanted / given, found / given))  # fmt: skip
    for pressure in PRESSURES:
        joint, walls = rough(pressure, 1e5, 1e3, 1.0)
        share = walls.strength(pressure) / Z
        found, phase, motion, given = slipping(n, joint)
        for what, wanted, value in zip("TRA", past_friction(share), found, strict=True):
            quantity = f"{what} under {1e-6 * pressure:g} MPa"
            readings.append(Reading.relative(quantity, wanted, value))
        curves.append(Curve(f"{1e-6 * pressure:g} MPa", 1e3 * phase, np.clip(given, -share, share),
                            motion, "time [ms]", "velocity [m/s]"))  # fmt: skip
    return readings, curves


PRESSURE, FIRST, LAST, ROUGHNESS = 1e6, 0.9, 0.6, 5e-3
TURNS = (1e-3, -1e-3, 2e-3, -2e-3, 4e-3, -4e-3, 4e-3)


def yielding(stiffness):
    """Return the law of a yielding joint as the solution has it."""
    return Yielding(stiffness, PRESSURE, np.arctan(LAST), np.arctan(FIRST), ROUGHNESS)


def led(steps, turns=TURNS):
    """Return place, wanted and found shear of a contact led through growing cycles."""
    stiffness = 1e9
    contact = Contact("yielding", (0.0, 0.0, -PRESSURE), ks=stiffness, friction=LAST,
                      friction_initial=FIRST, roughness=ROUGHNESS)  # fmt: skip
    places, wanted = led_by(yielding(stiffness), turns, steps)
    found = np.array([contact.move(x, 0.0, 0.0)[0] for x in places])
    return places, wanted, found


@case(
    "L14",
    "Joint that yields from the start: cycles of shear, a shear wave",
    source="theory.md (3.17) to (3.19), integrated apart from pyblast",
    gate="C",
    tolerance={
        "shear in growing cycles": 1e-3,
        "energy lost in growing cycles": 1e-3,
        **{f"motion behind, {size:g} of the strength": 0.03 for size in (0.5, 1.0, 2.0)},
    },
    meshes=(10.0, 20.0, 40.0),
    order=0.9,
    note="Cycles: one contact, ten times as many steps from turn to turn, slip of 1 to 4 mm with "
    "5 mm to wear by. Waves: k/zw 0.5, complete records; up to the strength 20 to 40 edges meet "
    "3 %, at twice the strength 40, for its kinks. That the equations are those of the authors "
    "could not be confirmed: see theory.md.",
)
def yields(n):
    """Lead a yielding contact through cycles; send shear waves across a yielding joint."""
    n = round(n)
    places, wanted, found = led(10 * n)
    loops = [np.sum(0.5 * (tau[1:] + tau[:-1]) * np.diff(places)) for tau in (wanted, found)]
    readings = [Reading.norm("shear in growing cycles", wanted, found),
                Reading.relative("energy lost in growing cycles", *loops)]  # fmt: skip
    curves = [Curve("growing cycles", 1e3 * places, 1e-6 * wanted, 1e-6 * found,
                    "slip [mm]", "shear [MPa]")]  # fmt: skip
    stiffness = 0.5 * Z * OMEGA
    law = {"kn": stiffness, "ks": stiffness, "friction": LAST, "friction_initial": FIRST,
           "roughness": ROUGHNESS}  # fmt: skip
    joint = Joint("J", "yielding", law, PRESSURE)
    for size in (0.5, 1.0, 2.0):
        t, found, incident = behind(n, joint, size * FIRST * PRESSURE / Z)
        wanted = past_yielding(t, incident, Z, yielding(stiffness))
        readings.append(Reading.norm(f"motion behind, {size:g} of the strength", wanted, found))
    curves.append(Curve("twice the strength", t, wanted, found, "time [s]", "velocity [m/s]"))
    return readings, curves
