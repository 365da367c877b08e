"""A small site whose records are made by the solver itself, with or without hidden physics."""

from dataclasses import replace

import numpy as np

from pyblast.blasts.blast import Blast
from pyblast.diagnosis.calibration import Baseline, unknowns_of
from pyblast.diagnosis.case import Case, case_of
from pyblast.diagnosis.effects import Scene
from pyblast.diagnosis.forward import Forward
from pyblast.diagnosis.likelihood import likelihood_of
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Receiver
from pyblast.model.source import TimeFunction
from pyblast.project.site import Site, SiteJoint
from pyblast.project.site_model import Cut
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram

CUT = Cut(30.0, 60.0, 1.3, quadratic=True)
DT, SAMPLES, BEFORE = 0.004, 100, 50
BAND = (4.0, 25.0)


def small_site():
    """Return a site of 120 x 90 x 60 m: a joint, two blasts, four receivers, no records."""
    rock = Material.from_speeds(2600.0, 2800.0, 1600.0)
    joint = Joint("J1", "elastic", {"kn": 8e8, "ks": 4e8}, insitu_pressure=1e5)
    times = np.arange(0.0, 0.1, 0.002)
    pulse = TimeFunction(np.sin(np.pi * times / 0.1) ** 2 * 6e10, 0.002, 0.0)
    return Site(
        name="small",
        box=np.array([[0.0, 120.0], [0.0, 90.0], [-60.0, 0.0]]),
        layers=(("rock", None, rock),),
        joints=(SiteJoint(joint, "x", 60.0),),
        quality=None,
        receivers=tuple(
            Receiver(f"R{n}", place)
            for n, place in enumerate(
                [(20.0, 70.0, 0.0), (80.0, 20.0, 0.0), (100.0, 60.0, 0.0), (110.0, 30.0, -20.0)]
            )
        ),
        moment_rate=pulse,
        exponent=0.9,
        blasts={
            "S1": holes([[30.0, 30.0]], [10.0], [0.0]),
            "B1": holes([[30.0, 30.0], [34.0, 36.0], [38.0, 42.0]], [60.0] * 3, [0.0, 0.03, 0.06]),
        },
        records={},
        time_zeros={},
        band=BAND,
        noise_window=(-BEFORE * DT, 0.0),
    )


def holes(places, charge, times):
    """Return a blast of short vertical holes."""
    places = np.array(places, dtype=float)
    collar, toe = (np.column_stack([places, np.full(len(places), z)]) for z in (-9.0, -11.0))
    n = len(places)
    return Blast("", collar, toe, np.array(charge), np.array(times), np.full(n, 0.1))


def recorded(site: Site, truth: Site | None = None, noise=0.003, seed=1, change=None) -> Case:
    """Return a site with records of the truth: coloured noise, a share of the peak, over them."""
    blank = {
        blast: {r.name: _recording(np.zeros((BEFORE + SAMPLES, 3))) for r in site.receivers}
        for blast in site.blasts
    }
    rng = np.random.default_rng(seed)
    first = replace(site, records=blank)
    for some in blank.values():  # a noise window must move
        for one in some.values():
            one.seismogram.velocity.setflags(write=True)
            one.seismogram.velocity[:] = rng.normal(size=one.seismogram.velocity.shape)
    case = case_of(first)
    motion = Forward(case, CUT).motion(truth or site)
    if change is not None:
        motion = change(motion)
    records = {}
    for blast, some in zip(case.blasts, motion, strict=True):
        records[blast] = {}
        for name, velocity in zip(case.receivers, some, strict=True):
            quiet = noise * np.abs(motion[0]).max() * _coloured(rng, BEFORE + SAMPLES)
            quiet[BEFORE:] += velocity.T
            records[blast][name] = _recording(quiet)
    return case_of(replace(site, records=records))


def scene_of(case: Case) -> Scene:
    """Return a case of the small site as if it were calibrated: one run of each blast."""
    forward = Forward(case, CUT)
    motion = forward.motion(case.site)
    times = DT * np.arange(case.n_samples)
    stretched = times * np.gradient(motion, DT, axis=-1)
    unknowns = unknowns_of(case.site)
    slopes = np.stack([stretched, 0.7 * stretched, 0.05 * motion, -0.03 * motion])
    baseline = Baseline(
        case, unknowns, np.zeros(4), np.diag([one.sigma**2 for one in unknowns]), case.site, motion,
        slopes, motion, np.zeros_like(motion), likelihood_of(case),
    )  # fmt: skip
    holes = np.stack([motion[0], np.roll(motion[0], 3, axis=-1), 0.5 * motion[0]])
    return Scene(forward, baseline, {"S1": motion[:1], "B1": holes})


def _coloured(rng, n):
    """Return noise (n, 3) of unit variance that remembers its last sample."""
    noise = rng.normal(size=(n + 50, 3))
    for k in range(1, len(noise)):
        noise[k] = 0.7 * noise[k - 1] + np.sqrt(1.0 - 0.49) * noise[k]
    return noise[50:]


def _recording(velocity):
    """Return a recording that begins before the blast."""
    seismogram = Seismogram(velocity, DT, -BEFORE * DT, "")
    return Recording(seismogram, "", "", None, np.zeros(velocity.shape, dtype=bool))
