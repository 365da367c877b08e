"""A plane wave across a joint at an angle, as a mode between rollers. Case 6.

Two plane waves that go up and down alike make a mode of profile cos(kz z), which rollers a half
wavelength apart leave as it is: waves, joint and rollers know no other edges.
"""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Roller, Viscous
from pyblast.model.joint import Joint
from pyblast.model.model import Model, Receiver
from pyblast.solver.preparation import prepare
from verification.columns import ROCK, spectrum, started
from verification.solutions.joints import oblique
from verification.suite import Curve, Reading, case

FREQUENCY = 20.0
OMEGA = 2.0 * np.pi * FREQUENCY
BAND = FREQUENCY * np.linspace(0.9, 1.2, 13)  # at the lowest the ray is steepest
ANGLES = (30.0, 45.0)
SPEED = {"P": ROCK.cp, "H": ROCK.cs}
SPRINGS = {
    "kn": 0.3 * ROCK.density * ROCK.cp * OMEGA,
    "ks": 0.3 * ROCK.density * ROCK.cs * OMEGA,
}
AXES = {"P": ("north",), "H": ("east", "vertical")}


class Slab:
    """Places of a slab in m: the middle of the pulse, the joint, the receivers, the ends."""

    def __init__(self, wave, angle, n):
        """Lay the slab out for a wave at an angle in rad, on a mesh of n edges per wavelength."""
        self.wave, self.speed = wave, SPEED[wave]
        length = self.speed / FREQUENCY
        self.across, self.along = OMEGA / self.speed * np.array([np.cos(angle), np.sin(angle)])
        self.spread = 0.2 * self.across
        self.edge, self.height = length / n, np.pi / self.along
        self.middle = 4.0 / self.spread
        self.joint, self.front, self.behind, end = (
            self.edge * np.ceil((2.0 * self.middle + more * length) / self.edge)
            for more in (1.0, 0.5, 1.5, 1.5 + 1.1 * self.middle / length)
        )
        self.shape = (round(end / self.edge), 1, 2 * round(0.5 * self.height / self.edge))
        self.size = (end, self.edge, self.height)
        self.duration = (self.behind + 0.3 * self.middle) / (self.speed * np.cos(angle))

    def model(self, there):
        """Return the slab with the joint or without."""
        planes = {"J": ("x", self.joint)} if there else None
        mesh = structured_box(self.shape, self.size, planes=planes, pattern="alternating")
        sides = [Fixed(side, AXES[self.wave]) for side in ("south", "north")]
        rollers = [Roller("bottom"), Roller("top")] if self.wave == "P" else []
        places = {
            f"{name} {part}": (x, 0.5 * self.edge, share * self.height)
            for name, x in (("front", self.front), ("behind", self.behind))
            for part, share in (("cos", 0.0), ("sin", 0.5))
        }
        return Model(
            mesh.split(["J"]) if there else mesh,
            {"rock": ROCK},
            joints=[Joint("J", "elastic", SPRINGS)] if there else [],
            boundaries=[*sides, *rollers, Viscous("west"), Viscous("east")],
            receivers=[Receiver(name, place) for name, place in places.items()],
        )

    def mode(self, points, time, rate):
        """Return displacement or, with ``rate``, velocity of the pulse, (n, 3)."""
        k = np.linspace(0.02, 2.0, 400) * self.across
        omega = self.speed * np.hypot(k, self.along)
        size = np.exp(-0.5 * ((k - self.across) / self.spread) ** 2)
        level, place = np.unique(points[:, 0], return_inverse=True)
        wave = np.exp(1j * (np.outer(level - self.middle, k) - omega * time)) * size
        wave = wave * (-1j * omega if rate else 1.0)
        motion = np.zeros((len(points), 3))
        profile = np.cos(self.along * points[:, 2]), np.sin(self.along * points[:, 2])
        if self.wave == "H":
            motion[:, 1] = wave.sum(axis=1).real[place] * profile[0]
        else:
            slowness = self.speed / omega
            motion[:, 0] = (wave @ (k * slowness)).real[place] * profile[0]
            motion[:, 2] = (wave @ (1j * self.along * slowness)).real[place] * profile[1]
        return motion


def recorded(slab, there):
    """Return the spectra (2 places, 2 profiles, n) at `BAND` with or without the joint."""
    model = slab.model(there)
    dt = prepare(model, slab.duration).constants["dt"]
    points = model.mesh.points
    result = started(
        model, slab.duration, slab.mode(points, 0.0, False), slab.mode(points, -0.5 * dt, True)
    )
    axes = {"cos": 1 if slab.wave == "H" else 0, "sin": 2}
    spectra = [
        np.conj(spectrum(s.times, s.velocity[:, axes[name.split()[1]]], BAND))
        for name, s in result.seismograms.items()
    ]
    return np.reshape(spectra, (2, 2, -1))


def wanted(slab):
    """Return the ratio of motion behind the joint to that without it, (n_profiles, n)."""
    ratios = []
    for omega in 2.0 * np.pi * BAND:
        angle = np.arcsin(slab.along * slab.speed / omega)
        waves = oblique(omega, angle, slab.wave, ROCK, **SPRINGS)
        if slab.wave == "H":
            ratios.append([waves["H"][0]])
            continue
        sums = sum(
            waves[kind][0] * waves[kind][2]
            * np.exp(1j * omega * waves[kind][1][0] * (slab.behind - slab.joint))
            for kind in ("P", "S")
        )  # fmt: skip
        _, slowness, direction = waves["P"]
        phase = np.exp(1j * omega * slowness[0] * (slab.behind - slab.joint))
        ratios.append(sums / (direction * phase))
    return np.transpose(ratios)


@case(
    "6",
    "Oblique joint, SH and P-SV",
    source="displacement discontinuity at an angle: T = 1/(1 - i w zs cos a/2ks), 4 x 4 for P-SV",
    gate="C",
    tolerance={
        f"{what} {a:g} deg": 0.01 if what.startswith("energy") else 0.05
        for a in ANGLES
        for what in ("T, SH", "energy, SH", "across, P-SV", "along, P-SV")
    },
    meshes=(10.0, 15.0, 22.0),
    order=1.8,
    ordered=tuple(f"{what} {a:g} deg" for a in ANGLES
                  for what in ("T, SH", "across, P-SV", "along, P-SV")),
    note="Complex amplitudes over the band of the pulse; behind the joint P and SV arrive "
        "together. Edges are per wavelength of the incident wave: SV from an incident P wave has "
        "half as many, and 15 meet 5 %.",
)  # fmt: skip
def oblique_joint(n):
    """Measure what passes a joint at two angles."""
    readings, curves = [], []
    for degrees in ANGLES:
        for wave in ("H", "P"):
            slab = Slab(wave, np.radians(degrees), round(n))
            without, with_joint = recorded(slab, False), recorded(slab, True)
            profiles = 1 if wave == "H" else 2
            found = with_joint[1, :profiles] / without[1, :profiles]
            form = wanted(slab)
            if wave == "H":
                readings.append(Reading.norm(f"T, SH {degrees:g} deg", form[0], found[0]))
                back = (with_joint[0, 0] - without[0, 0]) / without[0, 0]
                energy = np.mean(np.abs(back) ** 2 + np.abs(found[0]) ** 2)
                readings.append(Reading.relative(f"energy, SH {degrees:g} deg", 1.0, energy))
                curves.append(
                    Curve(
                        f"SH {degrees:g} deg",
                        BAND,
                        np.abs(form[0]),
                        np.abs(found[0]),
                        "frequency [Hz]",
                        "motion with over without joint",
                    )
                )
                continue
            for what, one, other in zip(("across", "along"), form, found, strict=True):
                readings.append(Reading.norm(f"{what}, P-SV {degrees:g} deg", one, other))
                curves.append(
                    Curve(
                        f"P-SV {degrees:g} deg, {what}",
                        BAND,
                        np.abs(one),
                        np.abs(other),
                        "frequency [Hz]",
                        "motion with over without joint",
                    )
                )
    return readings, curves
