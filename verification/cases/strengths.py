"""What joints and ground keep of what happened to them, one law at a time. Cases L16 to L20."""

import math

import numpy as np

from pyblast.model.material import Material, MohrCoulomb
from verification.cases.blocks import KN, KS, THICKNESS, plate, pushed
from verification.columns import ROCK
from verification.contact import Contact
from verification.solutions.strengths import barton_share, hyperbola_area, unloading_area
from verification.suite import Curve, Reading, case
from verification.zone import Zone

WEIGHT = ROCK.density * THICKNESS * 9.81  # Pa
PRESSED = 1e6  # Pa, under which a block that jumps does not leave its joint
ROUGH = {"jrc": 10.0, "jcs": 5e7, "friction": math.tan(math.radians(30.0)), "peak_slip": 1e-4}


@case(
    "L16",
    "Dilation of a sliding block",
    source="rise = tan(psi) slip up to its limit",
    gate="C",
    tolerance={"rise over slip": 0.005, "rise beyond the limit": 0.005},
    quick=True,
    note="A block under 1 MPa is pushed over a joint that dilates by 0.1 up to 40 mm of slip.",
)
def dilation():
    """Push a block under pressure sideways and compare how it rises with how far it slips."""
    strength = {"kn": KN, "ks": KS, "cohesion": 0.0, "friction": 0.4, "tension": 0.0,
                "dilation": 0.1, "dilation_slip": 0.04}  # fmt: skip
    push = 0.4 * PRESSED / (ROCK.density * THICKNESS) + 10.0
    done = pushed(plate("coulomb", PRESSED, **strength), 0.3, [push, 0.0, 0.0], rise=0.01)
    record = done.seismograms["block"]
    along, rise = record.dt * np.cumsum(record.velocity[:, [0, 2]], axis=0).T
    free = (along > 0.01) & (along < 0.035)
    slope = np.polyfit(along[free], rise[free], 1)[0]
    beyond = rise[along > 0.06].mean()
    readings = [
        Reading.relative("rise over slip", 0.1, slope),
        Reading.relative("rise beyond the limit", 0.1 * 0.04, beyond),
    ]
    exact = 0.1 * np.minimum(along, 0.04)
    return readings, [Curve("rise", along, exact, rise, "slip [m]", "rise [m]")]


@case(
    "L17",
    "Residual strength of a sliding block",
    source="acceleration = push - residual strength/(rho h), once the peak has failed",
    gate="C",
    tolerance={"acceleration after the peak": 0.005, "velocity below the peak": 0.02},
    quick=True,
    note="Below the peak strength the block must not keep moving; its velocity is over that which "
    "the same push gives a free block.",
)
def residual():
    """Push a block a little less and a little more than its peak strength allows."""
    strength = {"kn": KN, "ks": KS, "cohesion": 2e4, "friction": 0.6, "tension": 0.0,
                "cohesion_residual": 5e3, "friction_residual": 0.3}  # fmt: skip
    peak = (2e4 + 0.6 * WEIGHT) / (ROCK.density * THICKNESS)
    end = (5e3 + 0.3 * WEIGHT) / (ROCK.density * THICKNESS)
    records = [
        pushed(plate("coulomb", WEIGHT, **strength), 0.3, [share * peak, 0.0, 0.0], rise=0.1)
        .seismograms["block"]
        for share in (0.75, 1.1)
    ]  # fmt: skip
    held, gone = (record.velocity[:, 0] for record in records)
    late = records[1].times > 0.15
    found = np.polyfit(records[1].times[late], gone[late], 1)[0]
    readings = [
        Reading.relative("acceleration after the peak", 1.1 * peak - end, found),
        Reading.absolute("velocity below the peak", 0.0, abs(held[late]).max() / (0.2 * peak)),
    ]
    return readings, []


@case(
    "L18",
    "Tension that softens",
    source="one-dimensional stretch: plastic strain (M e - T)/(M - (T - Tr)/eT)",
    gate="C",
    tolerance={"tension while it falls": 1e-3, "residual tension": 1e-3},
    quick=True,
    note="One zone stretched along one axis in 12 000 steps, its sides held.",
)
def tension():
    """Stretch a zone beyond its tension and compare the stress with the falling branch."""
    peak, last, reach = 4e5, 1e5, 2e-4
    law = MohrCoulomb(0.2, tension_residual=last, tensile_strain=reach)
    ground = Material.from_speeds(
        2600.0, 4000.0, 2300.0, cohesion=5e6, friction=0.5, tension=peak, law=law
    )
    modulus = ground.density * ground.cp**2
    zone = Zone("mohr-coulomb", np.zeros(6), ground)
    strains = np.linspace(0.0, 4e-4, 12_001)[1:]
    found = np.array([zone.strain(np.array([e, 0, 0, 0, 0, 0]))[0] for e in strains])
    plastic = np.maximum(0.0, modulus * strains - peak) / (modulus - (peak - last) / reach)
    wanted = np.minimum(modulus * strains, np.maximum(last, peak - (peak - last) * plastic / reach))
    falling = (strains > peak / modulus) & (plastic < 0.98 * reach)
    worst = np.abs(found / wanted - 1.0)[falling].argmax()
    readings = [
        Reading.relative("tension while it falls", wanted[falling][worst], found[falling][worst]),
        Reading.relative("residual tension", last, found[-1]),
    ]
    return readings, [Curve("tension", strains, wanted, found, "strain", "stress [Pa]")]


@case(
    "L19",
    "Wear of rough walls",
    source="Barton (1982): share of JRC left at 1, 2, 4, 10, 25, 100 times the peak slip",
    gate="C",
    tolerance={"angle of roughness": 5e-3},
    quick=True,
    note="One contact sheared far at a constant gap beyond its dilation; the angle follows from "
    "the tractions and is compared with the table, interpolated in log slip.",
)
def wear():
    """Slide rough walls to a hundred times their peak slip and read their angle."""
    contact = Contact("barton_bandis", (0.0, 0.0, -1e6), **ROUGH)
    slips, found, wanted = [], [], []
    for place in np.geomspace(1e-6, 120.0, 6000) * ROUGH["peak_slip"] + 2e-3:
        before = contact.says("length")
        shear, _, normal = contact.move(place, 0.0, contact.says("dilated"))
        share = barton_share(before / ROUGH["peak_slip"])
        degrees = math.degrees(math.atan(shear / -normal)) - 30.0
        slips.append(contact.says("length") / ROUGH["peak_slip"])
        wanted.append(share)
        found.append(degrees / (ROUGH["jrc"] * math.log10(ROUGH["jcs"] / -normal)))
    slips, found, wanted = (np.array(values) for values in (slips, found, wanted))
    read = (slips > 0.1) & (slips < 100.0)
    worst = np.abs(found - wanted)[read].argmax()
    readings = [Reading.absolute("angle of roughness", wanted[read][worst], found[read][worst])]
    return readings, [Curve("roughness left", slips[read], wanted[read], found[read],
                            "slip over peak slip", "share of JRC")]  # fmt: skip


@case(
    "L20",
    "Closure that does not come back",
    source="areas under the hyperbola of loading and the one of unloading through its end",
    gate="C",
    tolerance={
        "energy lost in a cycle": 1e-3,
        "energy stored when closed": 1e-9,
        "closure left": 1e-3,
    },
    quick=True,
    note="A fresh joint closed to 0.6 of its largest closure and opened again, with 30 % left "
    "behind.",
)
def closure():
    """Close and open a fresh joint; compare what it takes and keeps with the two hyperbolas."""
    most, left = 0.6e-3, 0.3
    contact = Contact("closure", irrecoverable=left, cohesion=1e9, friction=0.0)
    way = np.concatenate([np.linspace(0.0, most, 20_001), np.linspace(most, 0.0, 20_001)])
    pressure, stored = np.transpose([(-contact.move(0.0, 0.0, -v)[2], contact.stored) for v in way])
    work = float(np.sum(0.5 * (pressure[1:] + pressure[:-1]) * np.diff(way)))
    taken = hyperbola_area(2e9, 1e-3, most)
    given_back = unloading_area(2e9, 1e-3, most, left)
    closed = way[20_001:][pressure[20_001:] > 0.0].min()
    readings = [
        Reading.relative("energy lost in a cycle", taken - given_back, work),
        Reading.relative("energy stored when closed", given_back, stored[20_000]),
        Reading.relative("closure left", left * most, closed),
    ]
    return readings, [Curve("cycle", way, pressure, pressure, "closure [m]", "pressure [Pa]")]
