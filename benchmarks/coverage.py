"""Coverage: how often the intervals of a back-analysis hold the truth of a twin."""

import tempfile
from dataclasses import dataclass

import numpy as np

from pyblast.core import BATCH_SIZE
from pyblast.inference.covariance import PRIORS, SCATTER, infer_levels, usual_whitener
from pyblast.inference.error_model import mesh_error, nuisances, scattering
from pyblast.inference.gauss_newton import levenberg_search
from pyblast.inference.parameter import Problem
from pyblast.inference.posterior import posterior
from pyblast.inference.records import band_functions, noise_of
from pyblast.solver.run import run_many

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
TWINS = {"quick": 2, "usual": 60, "long": 200}
BAND = (2.0, HIGHEST)  # Hz
QUIET = 4  # windows of noise before the blast, each as long as the record
COARSER = 15.0  # m, edge of the mesh that tells the error of the model's
SEARCH, AGAIN = 60, 24  # runs of the first search, and of those that go on from its best
TURNS = 2  # searches after the errors of the theory were shaped by the best of the last one
DIFFERENCE, PRIOR = 0.01, 12.0  # of the ranges; one over the variance of an even one
BARE = "no errors but those of the mesh"
DRAWN = "errors drawn from the priors of the covariance, their levels too"
AWAY = {"by_record": "errors shaped as records", "by_simulation": "as the simulation"}
CLAIMED = np.linspace(0.0, 1.0, 21)
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
    for number, case in enumerate(recorded(quick.family.ranges, TWINS[effort])):
        found, levels, away = inferred(quick, case, number)
        if found.failure:
            refused.append(found.failure)
        else:
            rows.append(_row(found, case.truth, levels) | away)
    return {"twins": len(rows) + len(refused), "refused": refused, "rows": rows,
            "unknowns": list(RANGES), "errors": DRAWN}  # fmt: skip


def _row(found, truth, levels):
    """Return what is kept of one twin."""
    low, high = np.quantile(found.x, [0.05, 0.95], axis=0)
    checks = len(found.log_weights)
    return {
        "rank": np.mean(found.x < truth, axis=0).tolist(), "width": (high - low).tolist(),
        "effective": found.effective / checks, "corrected": found.corrected / checks,
        "runs": found.runs, "levels": levels,
    }  # fmt: skip


def lines(found):
    """Return the table and its reading; older results lack errors of best points."""
    away = [key for key in AWAY if key in found["rows"][0]]
    keys = ("rank", "width", "effective", "corrected", "runs", *away)
    rank, width, effective, better, runs, *off = (
        np.array([row[key] for row in found["rows"]]) for key in keys
    )
    heads = "".join(f" error of the best point in deviations, {AWAY[key]} |" for key in away)
    told = [
        f"{found['twins']} synthetic tests with two faults in rock as in "
        "[searches.md](searches.md), truths "
        "uniform over the whole ranges, records on a finer mesh of another pattern with coloured "
        f"noise of {100.0 * NOISE:.0f} % and {found.get('errors', BARE)}. Covariance: noise before "
        "the blast, delays, gains, rotations, source spectra, scattering and two errors of the "
        "mesh, levels inferred. Posterior sampling on an "
        "emulator of the reduced model, checked and corrected by 40 full runs each; "
        f"{len(found['refused'])} refused by their own checks.",
        "",
        "| parameter | 90 % intervals that hold the truth | 50 % intervals | median width of 90 %, "
        f"of the range |{heads}",
        "|---" * (4 + len(away)) + "|",
    ]
    for k, name in enumerate([*found["unknowns"], "all"]):
        these = slice(None) if name == "all" else slice(k, k + 1)
        told.append(
            f"| {name} | {_share(rank[:, these], 0.9)} | {_share(rank[:, these], 0.5)} "
            f"| {np.median(width[:, these]):.0%} |"
            + "".join(f" {_away(errors[:, these])} |" for errors in off)
        )
    told += [
        "",
        f"The effective number of checks is {np.median(effective):.0%} of all in the median "
        "before the "
        f"correction, {effective.min():.0%} at worst; {np.median(better):.0%} and "
        f"{better.min():.0%} after it. Evaluations: {np.median(runs):.0f} a test in the median. "
        f"Levels of errors, medians: {_levels(found['rows'])}.",
    ]
    if away:
        told[-1] += (
            " Errors of the best point: mean over tests with its standard error, and root mean "
            "square, 1 where the covariance is right; as records: no error of the mesh."
        )
    return told


def _levels(rows):
    """Return the medians of the inferred levels in words."""
    medians = {name: np.median([row["levels"][name] for row in rows]) for name in rows[0]["levels"]}
    return ", ".join(f"{name} {level:.2g}" for name, level in medians.items())


def _away(errors):
    """Return mean and root mean square of errors (n_twins, n_unknowns) in words."""
    sure = errors.std() / np.sqrt(len(errors))
    return f"{errors.mean():+.2f} ± {sure:.2f}, {np.sqrt(np.mean(errors**2)):.2f}"


def draw(found, axes):
    """Draw measured against claimed coverage, and where truths lie among samples."""
    rank = np.array([row["rank"] for row in found["rows"]])
    left, right = axes
    for k, name in enumerate(found["unknowns"]):
        held = [np.mean(_held(rank[:, k], level)) for level in CLAIMED]
        left.plot(CLAIMED, held, lw=0.9, label=name)
    left.plot(CLAIMED, [np.mean(_held(rank, level)) for level in CLAIMED], "k", lw=2, label="all")
    left.plot([0.0, 1.0], [0.0, 1.0], "k:", lw=0.8)
    left.plot([0.9, 0.9], [0.85, 0.95], color="tab:green", lw=4, alpha=0.5, label="goal")
    left.set(xlabel="claimed", ylabel="measured coverage", xlim=(0, 1), ylim=(0, 1))
    left.legend(fontsize=7, frameon=False)
    right.hist(rank.ravel(), bins=np.linspace(0.0, 1.0, 11), color="0.7", edgecolor="white")
    right.axhline(rank.size / 10.0, color="k", lw=0.8, ls=":")
    right.set(xlabel="share of samples below the truth", ylabel="unknowns of twins", xlim=(0, 1))


def _held(rank, level):
    """Tell which truths lie within the central interval of a level."""
    return np.abs(np.asarray(rank) - 0.5) < 0.5 * level


def _share(rank, level):
    """Return how many truths an interval held, in words."""
    return f"{np.mean(_held(rank, level)):.0%}"


def recorded(ranges, count):
    """Yield twins with truths even over the ranges, recorded on the finer mesh with errors."""
    band = band_functions(SAMPLES, SAMPLING, BAND)
    ground, rng = faulted_rock(FINER, "centred"), np.random.default_rng(77)
    truths = rng.random((count, len(RANGES)))
    for first in range(0, count, BATCH_SIZE):
        some = truths[first : first + BATCH_SIZE]
        runs = run_many([ranges.model(ground, ranges.at(one)) for one in some], DURATION)
        for truth, run in zip(some, runs, strict=True):
            motion = _heard(run)
            noise = _noise(motion, rng)
            yield Records(truth, noise[:QUIET], motion + noise[QUIET] + _errors(motion, band, rng))


def _errors(motion, band, rng):
    """Return errors of the theory drawn from their priors, theory.md (7.14), (7.16), (7.19)."""
    level = {name: one.level * np.sqrt(one.weight / rng.chisquare(one.weight))
             for name, one in PRIORS.items()}  # fmt: skip
    parts, spread = nuisances(motion, band), scattering(motion, band)
    sizes = rng.standard_normal(len(parts.groups)) * [level[group] for group in parts.groups]
    held = np.tensordot(sizes, parts.columns, 1)
    for channel in np.ndindex(held.shape[:-1]):
        value, vector = np.linalg.eigh(spread[channel])
        drawn = np.sqrt(np.maximum(value, 0.0)) * rng.standard_normal(len(value))
        held[channel] += level[SCATTER] * vector @ drawn
    return band.restore(held)


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
    """Return the posterior of a twin, checked by full runs, levels, and errors of best points."""
    band = band_functions(SAMPLES, SAMPLING, BAND)
    noise, away = noise_of(case.quiet, SAMPLING, BAND), {}
    white = usual_whitener(case.motion, noise, band)
    made, best = _searched(quick, case, white, seed, SEARCH)
    white = infer_levels(white, case.motion - next(_predicted(quick, best[None]))).whitener
    made, best = _searched(quick, case, white, seed, AGAIN, best)
    away["by_record"] = _deviations(made, best, case.truth)
    for _ in range(TURNS):
        found = next(_predicted(quick, best[None]))
        errors = _mesh_errors(quick, best, found)
        fitted = _moved(quick, made, best)
        white = usual_whitener(found, noise, band, errors)
        white = infer_levels(white, case.motion - found, fitted=fitted).whitener
        made, best = _searched(quick, case, white, seed, AGAIN, best)
    away["by_simulation"] = _deviations(made, best, case.truth)
    checking = problem(case.motion, white, lambda points: _run(quick, points))
    return posterior(made, best, seed, checking), white.levels, away


def _searched(quick, case, white, seed, runs, start=None):
    """Return the problem of a twin on the reduced model, and the best point found."""
    made = problem(case.motion, white, lambda points: _predicted(quick, points))
    trace = levenberg_search(made, runs, seed, None if start is None else made.unit(start))
    return made, trace.points[trace.best]


def _moved(quick, made, best):
    """Return what one standard deviation of each range moves, (n, 1, n_receivers, 3, n_samples)."""
    slopes = _slopes(made, best, lambda points: np.array(list(_predicted(quick, points))))
    return slopes / np.sqrt(PRIOR)


def _deviations(made, best, truth):
    """Return the error of a point over the deviation that residuals and ranges foresee there."""
    place, slopes = made.unit(best), _slopes(made, best, lambda points: made.vectors(points)[1])
    covariance = np.linalg.inv(slopes @ slopes.T + PRIOR * np.eye(len(place)))
    return ((place - truth) / np.sqrt(np.diag(covariance))).tolist()


def _slopes(made, best, answer):
    """Return what the answer at a point changes by the whole range of each unknown, (n, ...)."""
    place = made.unit(best)
    sides = np.where(place > 0.5, -DIFFERENCE, DIFFERENCE)
    here, *moved = answer(made.points(np.vstack([place, place + np.diag(sides)])))
    return np.array([(one - here) / side for one, side in zip(moved, sides, strict=True)])


def _mesh_errors(quick, best, found):
    """Return what the mesh of the model may do to its motion at a point, one error a mesh.

    A coarser mesh tells by extrapolation; one of another pattern by its difference.
    """
    ranges, values = quick.family.ranges, dict(zip(RANGES, best.tolist(), strict=True))
    coarse, other = (
        _heard(run_many([ranges.model(ground, values)], DURATION)[0])
        for ground in (faulted_rock(COARSER, "kuhn"), faulted_rock(CELL, "centred"))
    )
    return mesh_error(found, coarse, COARSER / CELL), found - other


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
        yield _heard(quick.predict(dict(zip(RANGES, point, strict=True))))


def _run(quick, points):
    """Yield the same of full runs."""
    family = quick.family
    models = [family.model(dict(zip(RANGES, point, strict=True))) for point in points.tolist()]
    for run in run_many(models, DURATION, step=family.step):
        yield _heard(run)


def _heard(run):
    """Return the motion at the receivers, (1, n_receivers, 3, n_samples) m/s."""
    return together({name: read(one) for name, one in run.seismograms.items()})
