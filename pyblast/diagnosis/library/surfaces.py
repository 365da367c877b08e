"""What may be wrong where receivers stand: a soft layer, their places."""

import math
from dataclasses import replace

import numpy as np

from ...solving.materials import Material
from ..hypotheses import Knob, hypothesis

USUAL = 5.0  # m
APART = 1.4  # ratio of a thickness to start from
THIN, THICK = 1.0, 20.0  # m
SLOWEST, FASTEST = 0.1, 0.9  # factors on the speeds of the ground
FINER = 8  # frequencies of a spectrum in place of one
ALIKE = 2.0  # ratio of thicknesses whose zones differ by less than small errors of the theory


def _layered(site, thickness, slower):
    """Return the site with a slower layer on top; None where there is no room for it."""
    name, first, rock = site.layers[0]
    if thickness > 0.9 * (first or np.ptp(site.box[2])):
        return None
    own, listed = "soft", [there for there, *_ in site.layers]
    while own in listed:
        own = f"unlisted {own}"
    soft = Material.from_speeds(rock.density, slower * rock.cp, slower * rock.cs)
    rest = (name, None if first is None else first - thickness, rock)
    return replace(site, layers=((own, thickness, soft), rest, *site.layers[1:]))


def _as_fast(site, target, thickness, slower):
    """Return the site with a layer that is no slower, of one of few thicknesses."""
    del target, slower
    near = USUAL * ALIKE ** round(math.log(thickness / USUAL, ALIKE))
    return _layered(site, near, 1.0) or _layered(site, thickness, 1.0)


def _ringing(scene):
    """Return thickness and factor of a layer that rings where the records miss most.

    A soft layer rings at a quarter of a wave, f = c_s / (4 H) (Kramer 1996, section 7.2.1.1), and
    slow soil on rock for so long that one of another frequency explains nothing.
    """
    case, rock = scene.case, scene.baseline.site.layers[0][2]
    heard, simulated = (case.in_band(one) for one in (case.motion, scene.baseline.motion))
    size = np.linalg.norm(heard, axis=(2, 3), keepdims=True)
    shares = (heard - simulated)[:, :, :2] / np.maximum(size, np.finfo(float).tiny)
    length = FINER * case.n_samples
    spectrum = np.sum(np.abs(np.fft.rfft(shares, length)) ** 2, axis=(0, 1, 2))
    per_metre = 4.0 * np.fft.rfftfreq(length, case.dt)[max(1, np.argmax(spectrum))] / rock.cs
    slower = float(np.clip(USUAL * per_metre, SLOWEST, FASTEST))
    return float(np.clip(slower / per_metre, THIN, THICK)), slower


@hypothesis(
    "soft_surface_layer", family="receiver", on="site", target="site", axis="both", bare=_as_fast,
    begins=_ringing,
    knobs=[
        Knob("thickness", USUAL, 0.5, "m", log=True,
             starts=(USUAL / APART, USUAL * APART), low=THIN, high=THICK),
        Knob("slower", 0.4, 0.4, log=True, starts=(0.4,), low=SLOWEST, high=FASTEST),
    ],
    settled_by="a receiver on bare rock beside one on the ground, or a hammer test",
)  # fmt: skip
def soft_surface_layer(site, target, thickness, slower):
    """A slower layer that the site does not list lies on top."""
    del target
    return _layered(site, thickness, slower)


@hypothesis(
    "wrong_coordinates", form="receiver", family="receiver", on="motion", target="receiver",
    axis="blasts",
    knobs=[
        Knob("east", 0.0, 8.0, "m", starts=(0.0,), low=-30.0, high=30.0),
        Knob("north", 0.0, 8.0, "m", starts=(0.0,), low=-30.0, high=30.0),
    ],
    settled_by="a survey of the receiver",
)  # fmt: skip
def moved_receiver(scene, motion, target, east, north):
    """This receiver was elsewhere."""
    at = scene.case.receivers.index(target)
    motion = motion.copy()
    motion[:, at] += scene.surroundings.change(at, east, north)
    return motion
