"""The air blast, which runs over the ground and moves it."""

import numpy as np
from scipy import fft

from ..air_waves import ground_response
from ..hypotheses import Knob, hypothesis

AFAR = 100.0  # m: where the pressure of 1 kg is told
GROWTH = 0.45  # of the pressure with the charge: (r/W^(1/3))^-1.35, between usual 1.2 and 1.45
AHEAD = 3.0  # widths of the pulse before its middle that it begins


@hypothesis(
    "air_blast", family="receiver", on="motion", target="site", axis="both",
    knobs=[
        Knob("pressure", 800.0, 2.0, "Pa", log=True, starts=(800.0,), low=0.1, high=1e6,
             nothing=0.0),
        Knob("period", 0.1, 0.6, "s", log=True, starts=(0.05, 0.1), low=0.02, high=0.5),
        Knob("speed", 340.0, 6.0, "m/s", starts=(340.0,), low=310.0, high=370.0),
        Knob("decay", 1.1, 0.2, starts=(1.1,), low=0.4, high=2.0),
        Knob("radial", 1.0, 0.5, starts=(1.0,), low=-2.0, high=4.0),
    ],
    settled_by="a microphone beside a receiver, or a receiver some metres deep",
)  # fmt: skip
def air_blast(scene, motion, target, pressure, period, speed, decay, radial):
    """A pressure wave through the air runs over the ground and moves it as it passes."""
    del target
    case, n = scene.case, motion.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(size, case.dt)
    pulse = pressure * pulse_spectrum(frequency, period)
    there = {r.name: np.array(r.position) for r in case.site.receivers}
    depths = [case.site.box[2, 1] - there[name][2] for name in case.receivers]
    moved = np.zeros((len(depths), 2, len(frequency)), complex)
    moved[..., 1:] = ground_response(case.site, speed, depths, frequency[1:])
    moved *= pulse / case.dt
    moved[:, 0] *= radial
    change = np.empty_like(motion)
    for b, name in enumerate(case.blasts):
        blast = case.site.blasts[name]
        for r, receiver in enumerate(case.receivers):
            way = there[receiver][:2] - blast.collar[:, :2]
            far = np.linalg.norm(way, axis=1)
            share = blast.charge**GROWTH * (np.maximum(far, speed * period) / AFAR) ** -decay
            lag = blast.times + far / speed
            share = np.where(lag < case.duration, share, 0.0)
            along = share[:, None] * np.exp(-2j * np.pi * np.multiply.outer(lag, frequency))
            east, north = (way / np.maximum(far, 1e-9)[:, None]).T @ along
            spectrum = [east * moved[r, 0], north * moved[r, 0], along.sum(axis=0) * moved[r, 1]]
            change[b, r] = fft.irfft(spectrum, size)[..., :n]
    return motion + change


def pulse_spectrum(frequency, period):
    """Return the Fourier transform in s of a pulse of pressure, then suction, of peak one.

    -x exp((1 - x^2)/2) with x = (t - AHEAD s)/s and s = period/(2 pi), at which it is loudest.
    """
    s = period / (2.0 * np.pi)
    turn = 2.0 * np.pi * np.asarray(frequency) * s
    return s * np.sqrt(2.0 * np.pi * np.e) * 1j * turn * np.exp(-0.5 * turn**2 - 1j * AHEAD * turn)
