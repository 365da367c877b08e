"""A site whose joint closes, which its description does not say: something to diagnose.

    python examples/05_hidden_closure.py hidden
    pyblast diagnose hidden --out found

Writes a case folder: the site as it is believed to be, the holes of a single shot and of two
blasts, and what six receivers would have recorded if joint J1 stiffened as it closes. Speeds and
stiffness differ from what is believed, too, and there is noise: only the records tell.
"""

import sys
from dataclasses import replace

import numpy as np

from pyblast import Blast, Joint, Material, Receiver, Seismogram, TimeFunction, simulate
from pyblast.diagnosis.effects import Effect
from pyblast.diagnosis.prediction import site_of
from pyblast.project.site import Site, SiteJoint
from pyblast.project.site_file import write_site
from pyblast.project.site_model import Cut, site_model
from pyblast.recordings.recording import Recording

PLACES = ((20, 70, 0), (80, 20, 0), (100, 60, 0), (110, 30, -20), (95, 85, 0), (35, 10, 0))
CUT = Cut(20.0, 180.0, 1.1, quadratic=True)
DT, SAMPLES, BEFORE = 0.004, 125, 62
CLOSED = 0.6  # share of its largest closure at which the joint lies
ERRORS = (0.02, -0.015, 0.15, -0.1)  # logarithms of factors on cp, cs, kn, ks
NOISE = 0.004  # of the peak of the single shot


def believed():
    """Return the site without records."""
    times = np.arange(0.0, 0.1, 0.002)
    joint = Joint("J1", "elastic", {"kn": 8e8, "ks": 4e8}, insitu_pressure=3e4)
    return Site(
        name="hidden closure",
        box=np.array([[0.0, 120.0], [0.0, 90.0], [-60.0, 0.0]]),
        layers=(("rock", None, Material.from_speeds(2600.0, 2800.0, 1600.0)),),
        joints=(SiteJoint(joint, "x", 60.0),),
        quality=None,
        receivers=tuple(Receiver(f"R{n}", place) for n, place in enumerate(PLACES, 1)),
        moment_rate=TimeFunction(np.sin(np.pi * times / 0.1) ** 2 * 6e10, 0.002, 0.0),
        exponent=0.9,
        blasts={"S1": holes(1, 10.0), "B1": holes(3, 40.0), "B2": holes(5, 120.0)},
        records={},
        time_zeros={name: f"2026-05-01T1{n}:00:00Z" for n, name in enumerate(("S1", "B1", "B2"))},
        band=(4.0, 25.0),
        noise_window=(-BEFORE * DT, 0.0),
    )


def holes(count, charge):
    """Return a row of holes, 25 ms apart."""
    n = np.arange(count)
    collar = np.column_stack([25.0 + 4.0 * n, 30.0 + 6.0 * n, np.full(count, -9.0)])
    toe = collar - [0.0, 0.0, 2.0]
    every = np.full(count, charge), 0.025 * n, np.full(count, 0.1)
    return Blast("", collar, toe, *every)


def recorded(site, seed):
    """Return a site with the records of its blasts, made by runs, with noise."""
    rng = np.random.default_rng(seed)
    motions = {}
    for name in site.blasts:
        done = simulate(site_model(site, name, CUT), SAMPLES * DT)
        motions[name] = {
            r: s.sampled(0.0, DT, SAMPLES).velocity for r, s in done.seismograms.items()
        }
    level = NOISE * max(np.abs(v).max() for v in motions["S1"].values())
    records = {}
    for name, some in motions.items():
        records[name] = {}
        for receiver, velocity in some.items():
            noise = level * np.cumsum(rng.normal(size=(BEFORE + SAMPLES, 3)), axis=0)
            noise -= np.linspace(noise[0], noise[-1], len(noise))
            noise[BEFORE:] += velocity
            clipped = np.zeros(noise.shape, dtype=bool)
            made = Seismogram(noise, DT, -BEFORE * DT, receiver)
            records[name][receiver] = Recording(made, "", "", None, clipped)
    return records


def main(folder):
    """Write the case folder."""
    site = believed()
    effect = Effect("joint_nonlinear_closure", "J1", ((CLOSED,),))
    true = site_of(site, np.array(ERRORS), [effect])
    write_site(folder, replace(site, records=recorded(true, seed=1)))
    print(f"written: {folder}; now: pyblast diagnose {folder} --out found")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("which folder shall be written? python examples/05_hidden_closure.py hidden")
    main(sys.argv[1])
