"""Ground whose speed changes from place to place, and fluids in it. L3 and L6."""

from dataclasses import dataclass

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint, saturated
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.solver.run import simulate
from verification.columns import AXIS, IMPEDANCE, ROCK, column, driven, guides, pulse, spectrum
from verification.solutions.saturated_rock import saturated_rock
from verification.suite import Curve, Reading, case

FREQUENCY = 20.0


@dataclass(frozen=True)
class Along:
    """A gradient along the column, in the shape that `Model.ground` takes."""

    low: float
    length: float

    def factor(self, places, edges):
        """Return the factor (n,) at places (n, 3): linear from one to its least value."""
        del edges
        return 1.0 - (1.0 - self.low) * places[:, 0] / self.length


@case(
    "L3",
    "Gradient of speed: delay and amplitude of a pulse",
    source="delay = integral of dx/c; amplitude as the root of the impedance",
    gate="C",
    tolerance={"delay": 0.005, "amplitude": 0.02},
    meshes=(10.0, 15.0, 22.0),
    unit="edges per wavelength at the slow end",
    order=1.8,
    ordered=("delay",),
    note="S wave, speed falling to 0.6 over six wavelengths; the amplitude is that of ray theory.",
)
def gradient(n):
    """Send a pulse up a column that grows softer."""
    low, length = 0.6, 6.0 * ROCK.cs / FREQUENCY
    edge = low * ROCK.cs / FREQUENCY / n
    count = int(np.ceil(length / edge))
    edge = length / count
    mesh = structured_box((count, 1, 1), (length, 0.5 * edge, 0.5 * edge))
    places = (0.1 * length, 0.9 * length)
    at = [Receiver(f"{k}", (x, 0.25 * edge, 0.25 * edge)) for k, x in enumerate(places)]
    model = Model(
        mesh, {"rock": ROCK}, ground=[Along(low, length)], receivers=at,
        boundaries=[*guides("S"), Viscous("west"), Viscous("east"),
                    StressInput("west", pulse(FREQUENCY, "S"))],
    )  # fmt: skip
    done = simulate(model, 0.7)
    near, far = (done.seismograms[f"{k}"] for k in range(2))
    one, two = (s.velocity[:, AXIS["S"]] for s in (near, far))
    at_peak = spectrum(near.times, two, [FREQUENCY]) / spectrum(near.times, one, [FREQUENCY])
    slope = (1.0 - low) / length
    speeds = [ROCK.cs * (1.0 - slope * x) for x in places]
    delay = np.log(speeds[0] / speeds[1]) / (slope * ROCK.cs)
    turns = -np.angle(at_peak[0]) / (2.0 * np.pi)
    found = (turns + round(delay * FREQUENCY - turns)) / FREQUENCY
    gain = np.sqrt(speeds[0] / speeds[1])
    shifted = gain * np.interp(near.times - delay, near.times, one)
    readings = [
        Reading.relative("delay", delay, found),
        Reading.relative("amplitude", gain, abs(at_peak[0])),
    ]
    return readings, [Curve("behind the gradient", near.times, shifted, two, "time [s]",
                            "velocity [m/s]")]  # fmt: skip


@case(
    "L6",
    "Fluids: Gassmann's modulus; P passes a wet joint, S does not",
    source="Gassmann (1951); limits: no pores, fluid as stiff as the solid, no fluid",
    gate="C",
    tolerance={"fluid as stiff as the solid": 1e-3, "no fluid": 1e-3, "water in pores": 1e-3,
               "shear modulus": 1e-12, "density": 1e-12, "|T| of P, wet joint": 0.01,
               "|T| of S, wet joint": 0.01, "|T| of P, air in the joint": 0.01},
    note="Water in pores: by the other form, K/(Ks - K) = Kd/(Ks - Kd) + Kf/p(Ks - Kf). "
    "24 edges per wavelength; the joint is dry at k/zw 0.1 and 0.5 mm wide.",
)  # fmt: skip
def fluids():
    """Check Gassmann's limits and what passes a wet joint."""
    dry = Material(2300.0, 9e9, 7e9)
    hard = saturated_rock(dry, 0.2, 37e9, fluid_bulk=37e9).bulk
    empty = saturated_rock(dry, 0.2, 37e9, fluid_bulk=1.0).bulk
    wet = saturated_rock(dry, 0.2, 37e9, fluid_bulk=2.2e9, fluid_density=1000.0)
    part = 9.0 / (37.0 - 9.0) + 2.2 / (0.2 * (37.0 - 2.2))
    readings = [
        Reading.relative("fluid as stiff as the solid", 37e9, hard),
        Reading.relative("no fluid", 9e9, empty),
        Reading.relative("water in pores", 37e9 * part / (1.0 + part), wet.bulk),
        Reading.relative("shear modulus", 7e9, wet.shear),
        Reading.relative("density", 2300.0 + 0.2 * 1000.0, wet.density),
    ]
    fluids = (("P", "wet joint", 2.2e9), ("S", "wet joint", 2.2e9), ("P", "air in the joint", 1e5))
    for wave, name, fluid in fluids:
        n, speed = 24, ROCK.cp if wave == "P" else ROCK.cs
        edge, k = speed / FREQUENCY / n, 0.1 * IMPEDANCE[wave] * 2.0 * np.pi * FREQUENCY
        joint = saturated(Joint("J", "elastic", {"kn": k, "ks": k}), 5e-4, fluid_bulk=fluid)
        spectra = []
        for joints, planes in (([joint], {"J": ("x", 3 * n * edge)}), ([], None)):
            mesh = column(8 * n, edge, planes)
            motion, _ = driven(mesh, wave, FREQUENCY, 0.45, [4 * n * edge], joints=joints)
            spectra.append(abs(spectrum(*motion[4 * n * edge], [FREQUENCY])[0]))
        stiffness = k + (fluid / 5e-4 if wave == "P" else 0.0)
        wanted = 1.0 / np.hypot(1.0, np.pi * FREQUENCY * IMPEDANCE[wave] / stiffness)
        found = spectra[0] / spectra[1]
        readings.append(Reading.relative(f"|T| of {wave}, {name}", wanted, found))
    return readings, []
