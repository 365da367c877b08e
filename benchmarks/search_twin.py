"""The twin that searches are measured on: two faults in rock, recorded on another mesh with noise.

Five unknowns: kn and ks of both faults, and the damping ratio. Evaluations go through a reduced
model, so that searches of 200 runs cost seconds; records are full runs.
"""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.reduction.reduced_model import Reduced, reduced
from pyblast.inference.likelihood import misfit
from pyblast.inference.parameter import Problem
from pyblast.mesh.grid import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.material import Material
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import run_many

from .reduced_basis import shaken

SIZE = (180.0, 120.0, 80.0)  # m
FAULTS = {"F1": ("x", 60.0), "F2": ("x", 120.0)}
DIPS = (0.0, 0.4, -0.3, 0.0)  # tangents to the vertical at x = 0, 60, 120, 180 m
ROCK = Material.from_speeds(2700.0, 3000.0, 1650.0)
PLACES = ((100.0, 80.0, 79.0), (160.0, 90.0, 79.0), (150.0, 30.0, 79.0))
HIGHEST = 25.0  # Hz, of all motion
PULSES = tuple((1.0, 0.04 * row) for row in range(4))  # amplitude, delay in s: the paper's rows
RANGES = {
    "kn.F1": (2e7, 5e8), "ks.F1": (5e6, 1e8), "kn.F2": (2e7, 5e8), "ks.F2": (5e6, 1e8),
    "ratio": (0.005, 0.05),
}  # fmt: skip
INSIDE = (0.1, 0.9)  # shares of the ranges between which truths lie
DURATION, SAMPLING = 0.64, 0.004  # s
CELL, FINER = 12.0, 10.0  # m, of the model and of the mesh of the records
NOISE = 0.05  # root mean square, of that of the record
COLOUR = 1.0  # amplitude of the noise falls as 1/f to this power
RUNS, HELD_OUT, TOLERANCE = 32, 8, 3e-5
PER_CENT = 100.0


@dataclass(frozen=True, eq=False)
class Twin:
    """One case: what is true, and what was recorded of it.

    ``records`` by receiver; ``truth`` (5,) are shares of the ranges, even in logarithm.
    """

    truth: np.ndarray
    records: dict[str, Seismogram]


def faulted_rock(cell, pattern):
    """Return the rock with two dipping faults, for an edge of the boxes in m."""
    shape = tuple(round(length / cell) for length in SIZE)
    mesh = structured_box(shape, SIZE, planes=FAULTS, pattern=pattern)
    points = mesh.points.copy()
    dip = np.interp(points[:, 0], [0.0, 60.0, 120.0, 180.0], DIPS)
    points[:, 0] += dip * (points[:, 2] - 0.5 * SIZE[2])
    mesh = Mesh(points, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces).split(list(FAULTS))
    times = np.arange(0.0, DURATION, 1e-3)
    return shaken(mesh, {"rock": ROCK}, (1e8, 2e7), PLACES, times, PULSES)


def quick_model(store=None) -> Reduced:
    """Return the reduced model that answers for all values."""
    return reduced(
        faulted_rock(CELL, "kuhn"), RANGES, DURATION, highest=HIGHEST, runs=RUNS,
        held_out=HELD_OUT, tolerance=TOLERANCE, store=store,
    )  # fmt: skip


def twins(quick: Reduced, count) -> list[Twin]:
    """Return cases with truths of their own, each recorded on the finer mesh."""
    ranges, low, high = quick.family.ranges, *INSIDE
    truths = low + (high - low) * np.random.default_rng(2024).random((count, len(RANGES)))
    ground = faulted_rock(FINER, "centred")
    runs = run_many([ranges.model(ground, ranges.at(truth)) for truth in truths], DURATION)
    return [
        Twin(truth, {name: _noisy(read(one), [number, k])
                     for k, (name, one) in enumerate(run.seismograms.items())})
        for number, (truth, run) in enumerate(zip(truths, runs, strict=True))
    ]  # fmt: skip


def read(seismogram) -> Seismogram:
    """Return a seismogram at the instants that are compared."""
    return seismogram.sampled(0.0, SAMPLING, round(DURATION / SAMPLING))


def _noisy(record, seed):
    """Add noise whose amplitude falls with frequency, between 1 Hz and the highest."""
    n = len(record.velocity)
    frequency = np.fft.rfftfreq(n, record.dt)
    heard = (frequency >= 1.0) & (frequency <= HIGHEST)
    level = np.where(heard, np.maximum(frequency, 1.0) ** -COLOUR, 0.0)
    white = np.random.default_rng(seed).standard_normal((n, 3))
    noise = np.fft.irfft(level[:, None] * np.fft.rfft(white, axis=0), n, axis=0)
    noise *= NOISE * np.sqrt(np.mean(record.velocity**2) / np.mean(noise**2))
    return replace(record, velocity=record.velocity + noise)


def problem(quick: Reduced, twin: Twin, measure) -> Problem:
    """Return the search for what is true of a twin, with a ``measure`` of records."""
    low, high = np.array(list(RANGES.values())).T
    value, residuals = measure(together(twin.records))

    def motions(points):
        for point in points.tolist():
            answer = quick.predict(dict(zip(RANGES, point, strict=True)))
            yield together({name: read(one) for name, one in answer.seismograms.items()})

    def vectors(points):
        found = list(motions(points))
        return np.array([value(one) for one in found]), np.array([residuals(one) for one in found])

    def misfits(points):
        return np.array([value(one) for one in motions(points)])

    return Problem(low, high, np.ones(len(low), bool), misfits, vectors)


def together(seismograms):
    """Return the motion of all receivers, (1, n_receivers, 3, n_samples) m/s."""
    return np.array([[one.velocity.T for one in seismograms.values()]])


def paper(recorded):
    """Return the paper's misfit, %, and the deviations it is the mean of."""
    made = misfit("paper", recorded, SAMPLING)
    return made.value, made.residuals


def waveform(recorded):
    """Return residual over recorded energy, mean over receivers, %, and its residuals."""
    size = np.linalg.norm(recorded, axis=(2, 3), keepdims=True) * np.sqrt(recorded.shape[1])

    def residuals(found):
        return np.sqrt(PER_CENT) * ((found - recorded) / size).ravel()

    return lambda found: float(np.sum(residuals(found) ** 2)), residuals
