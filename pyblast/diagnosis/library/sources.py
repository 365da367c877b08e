"""Effects on the source: position of a blast, damaged rock around it, its force."""

from dataclasses import replace

import numpy as np
from scipy import fft

from ...model.ground_fields import DamagedZone
from ..hypotheses import blasts_of_many_holes, holes_inside, hypothesis, known_source


@hypothesis(
    "wrong_coordinates",
    form="blast",
    family="source",
    on="site",
    target="blast",
    axis="receivers",
    decided_by="a survey of the holes",
    odd=True,
    simulated=(holes_inside,),
)
def moved_blast(project, target, east, north):
    """This blast was elsewhere: all its holes are displaced by the same vector."""
    blast, shift = project.blasts[target], np.array([east, north, 0.0])
    moved = replace(blast, collar=blast.collar + shift, toe=blast.toe + shift)
    return project.changed(blasts={**project.blasts, target: moved})


def _bench_and_blasts(case):
    """List all holes together, and each blast of many holes."""
    return "", *blasts_of_many_holes(case)


@hypothesis(
    "damaged_zone",
    family="source",
    on="site",
    target="blast",
    axis="receivers",
    targets=_bench_and_blasts,
    decided_by="a seismic survey of the bench before and after a blast, receivers on all sides",
    simulated=(holes_inside,),
)
def damaged_zone(project, target, reduction, length):
    """Blasting has left slower rock around the holes of this blast, or of all blasts."""
    chosen = [project.blasts[target]] if target else project.blasts.values()
    holes = np.concatenate([np.stack([each.collar, each.toe], axis=1) for each in chosen])
    return project.changed(fields=(*project.fields, DamagedZone(holes, reduction, length)))


WEAKEST = 0.05  # of the largest in its spectrum: a source is not divided by less


@hypothesis(
    "source_function",
    family="source",
    on="motion",
    target="blast",
    axis="receivers",
    decided_by="a force gauge at the source, or a receiver beside it",
    simulated=(known_source,),
)  # fmt: skip
def source_function(scene, motion, target, duration, impulse, shift):
    """The force of this shot was longer or shorter, stronger or weaker than assumed."""
    case, n = scene.case, motion.shape[-1]
    if target not in case.blasts:
        return motion
    force = case.project.survey.shot(target).inside.forces[0]
    size = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(size, case.dt)
    times = force.dt * np.arange(len(force.values))

    def spectrum(at):
        return np.exp(-2j * np.pi * np.multiply.outer(at, times)) @ force.values

    reference = spectrum(frequency)
    least = WEAKEST * np.max(np.abs(reference))
    weak = np.conj(reference) / np.maximum(np.abs(reference) ** 2, least**2)
    change = impulse * spectrum(duration * frequency) * weak
    change = change * np.exp(-2j * np.pi * frequency * shift)
    at, motion = case.blasts.index(target), motion.copy()
    motion[at] = fft.irfft(fft.rfft(motion[at], size) * change, size)[..., :n]
    return motion
