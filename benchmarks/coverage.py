"""Coverage: how often the intervals of a back-analysis hold the truth of a twin."""

import tempfile
from dataclasses import dataclass, replace

import numpy as np

from pyblast.inversion.levenberg import levenberg_search
from pyblast.inversion.posterior import posterior
from pyblast.inversion.searching import Problem
from pyblast.residuals.band import band_functions
from pyblast.residuals.levels import infer_levels
from pyblast.residuals.noise import noise_of
from pyblast.residuals.nuisances import mesh_columns, mesh_error, nuisances
from pyblast.residuals.scattering import scattering
from pyblast.residuals.whitening import whitener
from pyblast.solving.batches import run_many

from .search_twin import (
    CELL,
    DURATION,
    FINER,
    HIGHEST,
    NOISE,
    RANGES,
    SAMPLING,
    faulted_rock,
    quick_model,
    read,
    together,
)

TITLE = "Intervals that hold the truth"
TWINS = {"quick": 4, "usual": 60, "long": 200}
BAND = (2.0, HIGHEST)  # Hz
QUIET = 4  # windows of noise before the blast, each as long as the record
COARSER = 15.0
TURNS = 2
SEARCH = 60  # runs before and after the levels of errors are known
LEVELS = np.linspace(0.05, 0.95, 19)
SAMPLES = round(DURATION / SAMPLING)


@dataclass(frozen=True, eq=False)
class Records:
    """Records of one twin: ``truth`` (5,) in the unit cube, ``quiet`` windows, ``motion``."""

    truth: np.ndarray
    quiet: np.ndarray
    motion: np.ndarray


def measure(effort):
    """Return for every twin where the truth lies among the samples, and how wide these are."""
    with tempfile.TemporaryDirectory() as folder:
        quick = quick_model(folder)
    rows, refused = [], []
    for number, case in enumerate(recorded(TWINS[effort])):
        found, levels = inferred(quick, case, number)
        if found.doubt:
            refused.append(found.doubt)
            continue
        rows.append(
            {
                "rank": np.mean(found.places < case.truth, axis=0).tolist(),
                "width": np.diff(np.quantile(found.places, [0.05, 0.95], axis=0), axis=0)[0]
                .tolist(),
                "off": ((found.places.mean(axis=0) - case.truth) / found.places.std(axis=0))
                .tolist(),
                "effective": found.effective / len(found.log_weights),
                "corrected": found.corrected / len(found.log_weights),
                "runs": found.runs, "levels": levels,
            }
        )  # fmt: skip
    return {"twins": len(rows) + len(refused), "refused": refused, "unknowns": list(RANGES),
            "rows": rows}  # fmt: skip


def recorded(count):
    """Return twins with truths even over the ranges, recorded on the finer mesh with noise."""
    ground, rng = faulted_rock(FINER, "centred"), np.random.default_rng(77)
    low, high = np.array(list(RANGES.values())).T
    truths = rng.random((count, len(RANGES)))
    values = [dict(zip(RANGES, low * (high / low) ** one, strict=True)) for one in truths]
    runs = run_many([_ground(ground, one) for one in values], DURATION)
    for truth, run in zip(truths, runs, strict=True):
        motion = together({name: read(one) for name, one in run.seismograms.items()})
        noise = _noise(motion, rng)
        yield Records(truth, noise[:QUIET], motion + noise[QUIET])


def _ground(ground, values):
    """Return the ground with some values."""
    for key, value in values.items():
        quantity, _, joint = key.partition(".")
        if joint:
            ground = ground.with_joint(joint, **{quantity: value})
        else:
            ground = replace(ground, damping=replace(ground.damping, ratio=value))
    return ground


def _noise(motion, rng):
    """Return windows of noise (QUIET + 1, n_receivers, 3, n_samples), amplitude as 1/f."""
    n = (QUIET + 1) * motion.shape[-1]
    frequency = np.fft.rfftfreq(n, SAMPLING)
    heard = (frequency >= 1.0) & (frequency <= HIGHEST)
    level = np.where(heard, 1.0 / np.maximum(frequency, 1.0), 0.0)
    made = np.fft.irfft(level * np.fft.rfft(rng.standard_normal((*motion.shape[1:3], n))), n)
    size = np.sqrt(np.mean(motion**2, axis=(-2, -1), keepdims=True)[0])
    made *= NOISE * size / np.sqrt(np.mean(made**2, axis=(-2, -1), keepdims=True))
    return np.moveaxis(made.reshape(*motion.shape[1:3], QUIET + 1, -1), 2, 0)


def inferred(quick, case, seed):
    """Return the posterior of a twin, checked by full runs, and the levels of the errors."""
    band = band_functions(SAMPLES, SAMPLING, BAND)
    noise = noise_of(case.quiet, SAMPLING, BAND)

    def search(white):
        made = problem(case.motion, white, lambda points: _predicted(quick, points))
        trace = levenberg_search(made, SEARCH, seed)
        return made, trace.points[trace.best]

    white = whitener(noise, band, 1, scattering=scattering(case.motion, band))
    _, best = search(white)
    for _ in range(TURNS):
        found = next(_predicted(quick, best[None]))
        errors = nuisances(found, band)
        errors += mesh_columns(_by_receiver(_mesh_errors(quick, best, found)), band)
        white = whitener(
            noise, band, 1, nuisances=errors, scattering=scattering(found, band)
        )
        white = infer_levels(white, case.motion - found).whitener
        made, best = search(white)
    checking = problem(case.motion, white, lambda points: _run(quick, points))
    return posterior(made, best, seed, checking), white.levels


def _mesh_errors(quick, best, found):
    """Return what the mesh of the model may do to its motion at a point, one error a mesh.

    A coarser mesh tells by extrapolation; one of another pattern by its difference.
    """
    values = quick.family.ranges.at(_unit(best))
    coarse, other = (
        together({n: read(s) for n, s in run_many([_ground(g, values)], DURATION)[0]
                  .seismograms.items()})
        for g in (faulted_rock(COARSER, "kuhn"), faulted_rock(CELL, "centred"))
    )  # fmt: skip
    return mesh_error(found, coarse, COARSER / CELL), found - other


def _by_receiver(errors):
    """Return each error at one receiver alone."""
    whole = np.array(errors)
    apart = []
    for error in whole:
        for receiver in range(error.shape[1]):
            one = np.zeros_like(error)
            one[:, receiver] = error[:, receiver]
            apart.append(one)
    return np.array(apart)


def _unit(point):
    low, high = np.array(list(RANGES.values())).T
    return np.log(point / low) / np.log(high / low)


def problem(motion, white, answer):
    """Return the problem of whitened waveforms, simulations as ``answer`` gives them."""
    low, high = np.array(list(RANGES.values())).T

    def vectors(points):
        left = np.array([white.apply(motion - one).ravel() for one in answer(points)])
        return np.sum(left**2, axis=1) / white.n_data, left

    return Problem(low, high, np.ones(len(low), bool), lambda p: vectors(p)[0], vectors)


def _predicted(quick, points):
    """Yield what the reduced model answers at points, (1, n_receivers, 3, n_samples) m/s."""
    for point in points.tolist():
        answer = quick.predict(dict(zip(RANGES, point, strict=True)))
        yield together({name: read(one) for name, one in answer.seismograms.items()})


def _run(quick, points):
    """Yield the same of full runs."""
    family = quick.family
    models = [family.model(dict(zip(RANGES, point, strict=True))) for point in points.tolist()]
    for run in run_many(models, DURATION, step=family.step):
        yield together({name: read(one) for name, one in run.seismograms.items()})
