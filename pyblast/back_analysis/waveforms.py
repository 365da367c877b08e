"""Records of a back-analysis on one sampling, and the fit of a moment rate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, PyblastError
from ..inference.records import Records
from ..project.project import Project
from ..signals.seismogram import Seismogram
from ..simulation.recipe import edge_factor
from .parameters import chosen_records, left_out, table_of

SAMPLES_PER_PERIOD = 8.0  # of the highest frequency of the band


@dataclass(frozen=True)
class Window:
    """Time window from the first firing, and band, in which motion is compared.

    Parameters
    ----------
    band : tuple of 2 float, Hz
    dt : float, s
    n_samples : int
    """

    band: tuple[float, float]
    dt: float
    n_samples: int


def remaining(records: Records, motion) -> float:
    """Return the share of the energy of records in their band that a motion leaves.

    Parameters
    ----------
    records : Records
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    """
    recorded = records.band.project(records.motion)
    missed = recorded - records.band.project(motion)
    return float(np.sum(missed**2) / np.sum(recorded**2))


def recorded_waveforms(blasts: Sequence[Project], window: Window | None = None) -> Records:
    """Gather the records of a back-analysis on one sampling, with their noise.

    Parameters
    ----------
    blasts : sequence of Project
        The first one with the table ``[back_analysis]``.
    window : Window, optional
        That of `window_of` by default.

    Raises
    ------
    InputError
        As `Survey.records`: such as a record with too little before the first firing.
    """
    table, window = table_of(blasts[0])[0], window or window_of(blasts)
    names = dict.fromkeys(
        name for blast in blasts for name in chosen_records(blast, table.receivers)
    )
    survey = replace(blasts[0].survey, shots=tuple(blast.shot for blast in blasts))
    return survey.records(
        tuple(names), window.band, dt=window.dt, n_samples=window.n_samples,
        noise=None if table.noise_mm_per_s is None else 1e-3 * table.noise_mm_per_s,
        unused=left_out(blasts, table.receivers),
    )  # fmt: skip


def window_of(projects) -> Window:
    """Return the window of blasts: band of comparison or of the input, shortest duration."""
    duration = min(project.config.run.duration_s for project in projects)
    band = projects[0].compared_band
    if band is None:
        band = (1.0 / duration, max(project.shot.highest_frequency for project in projects))
    low, high = map(float, band)
    if not low < high:
        raise InputError(
            f"{projects[0].path.name}: run.duration_s: {duration:g} s is shorter than a period of "
            f"the input, {high:g} Hz; run longer"
        )
    dt = 1.0 / (SAMPLES_PER_PERIOD * high)
    return Window((low, high), dt, int(duration / dt + 1e-9))


def sampled_motion(motions, receivers, window) -> np.ndarray:
    """Sample motions, one dict a blast, (n_blasts, n_receivers, 3, n_samples); zero if none."""
    sampled = np.zeros((len(motions), len(receivers), 3, window.n_samples))
    for b, motion in enumerate(motions):
        for r, name in enumerate(receivers):
            if name in motion:
                seismogram = motion[name].sampled(0.0, window.dt, window.n_samples)
                sampled[b, r] = np.nan_to_num(seismogram.velocity).T
    return sampled


COARSER = 5.0  # error of the coarser mesh over that of the working mesh


def mesh_errors_of(projects, motion, receivers, window, prepare=lambda other: other):
    """Estimate the mesh error of the motion of projects from runs on a coarser mesh.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast, with the values of the simulated motion.
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    receivers : sequence of str
    window : Window
    prepare : callable, optional
        ``(coarser project) -> project`` that is run, such as one with other receivers.

    Returns
    -------
    tuple of (n_blasts, n_receivers, 3, n_samples) float64, m/s
        One error, or none.
    str
        Why there is none; else empty.

    Notes
    -----
    theory.md (7.15).
    """
    motions, ratio = [], COARSER
    for project in projects:
        try:
            mesh = project.refined(COARSER)
            if mesh is None:
                return (), "the mesh error is not estimated: a mesh that is given is not coarsened"
            other = project.changed(mesh=mesh)
            if len(other.mesh.zones) == len(project.mesh.zones):
                return (), "the mesh error is not estimated: the grid is too small to coarsen"
            if not project.mesh.hexahedral:
                ratio = edge_factor(COARSER) ** 2.0
            motions.append(prepare(other).simulate().seismograms)
        except PyblastError as error:
            return (), f"the mesh error is not estimated: {error}"
    coarse = sampled_motion(motions, receivers, window)
    return ((motion - coarse) / (1.0 - ratio),), ""


PER_KNOT = 2  # samples between the knots of the splines
KNOTS_PER_PERIOD = 8.0  # of the highest frequency
SMOOTHING = np.logspace(-3.0, 2.0, 26)  # of the largest eigenvalue; less leaves what lies above
FINE = 10  # steps of the spline a sample


@dataclass(frozen=True, eq=False)
class MomentRateFit:
    """Moment rate of 1 kg that explains the records of a signature shot.

    Parameters
    ----------
    times : (n,) float64, s
        From when the hole fires.
    rate, deviation : (n,) float64, N m/s
        And its standard deviation.
    misfit, held_out : dict of str to float
        Share of the energy of each record that stays unexplained: in the fit, and predicted from
        the other receivers (empty with one).
    band : float, Hz
    smoothing : float
        Share of the largest squared singular value, by generalised cross-validation.
    """

    times: np.ndarray
    rate: np.ndarray
    deviation: np.ndarray
    misfit: dict[str, float]
    held_out: dict[str, float]
    band: float
    smoothing: float

    @property
    def summary(self) -> dict:
        """The figures of ``source.json``."""
        peak = int(np.abs(self.rate).argmax())
        return {
            "band_hz": self.band, "misfit": self.misfit, "held_out_misfit": self.held_out,
            "smoothing": self.smoothing, "peak_moment_rate_per_kg": self.rate[peak],
            "peak_deviation": self.deviation[peak], "peak_at_s": self.times[peak],
            "lasting_moment_per_kg": float(np.trapezoid(self.rate, self.times)),
        }  # fmt: skip


def spline(x: np.ndarray) -> np.ndarray:
    """Return the cubic B-spline on the knots 0, 1, 2, 3, 4; its largest value is 2/3 at 2."""
    away = np.abs(np.asarray(x) - 2.0)
    outer = np.maximum(2.0 - away, 0.0) ** 3 / 6.0
    return np.where(away < 1.0, outer - 4.0 * np.maximum(1.0 - away, 0.0) ** 3 / 6.0, outer)


def fit_moment_rate(
    motion: dict[str, Seismogram],
    records: dict[str, Seismogram],
    band: float,
    dt: float,
    count: int,
) -> MomentRateFit:
    """Fit records by a moment rate; theory.md (9.7), (9.8).

    Parameters
    ----------
    motion : dict of str to Seismogram
        Response by receiver to a spline as moment rate, see `spline`; 0 s is the first firing.
    records : dict of str to Seismogram
    band : float, Hz
        Highest frequency that counts.
    dt : float, s
        Sampling; `PER_KNOT` samples lie between knots.
    count : int
        Of splines.
    """
    parts = {
        name: _equations(motion[name], record, band, dt, count) for name, record in records.items()
    }
    rough = np.diff(np.eye(count), 2, axis=0)
    rough = rough.T @ rough
    fitted, smoothing, spread = _smooth(list(parts.values()), rough)
    misfit = {name: _unexplained(part, fitted) for name, part in parts.items()}
    others = {
        name: [part for other, part in parts.items() if other != name]
        for name in parts if len(parts) > 1
    }  # fmt: skip
    without = {name: _smooth(rest, rough)[0] for name, rest in others.items()}
    held_out = {name: _unexplained(parts[name], others) for name, others in without.items()}
    times = np.arange((count + 3) * PER_KNOT + 1) * dt
    shapes = spline(times[:, None] / (PER_KNOT * dt) - np.arange(count))
    variance = np.einsum("ti,ij,tj->t", shapes, spread, shapes)
    if len(without) > 1:  # jackknife over receivers
        n = len(without)
        each = np.array([shapes @ coefficients for coefficients in without.values()])
        jackknife = (n - 1) / n * ((each - each.mean(axis=0)) ** 2).sum(axis=0)
        variance = np.maximum(variance, jackknife)
    deviation = np.sqrt(variance)
    return MomentRateFit(times, shapes @ fitted, deviation, misfit, held_out, band, smoothing)


def _quiet(motion, band):
    """Low-pass a motion that begins at rest, up to a cycle before its end."""
    before = int(np.ceil(3.0 / (band * motion.dt)))
    velocity = np.pad(np.nan_to_num(motion.velocity), ((before, 0), (0, 0)))
    start = motion.start - before * motion.dt
    return replace(motion, velocity=velocity, start=start).lowpassed(band)


def _equations(response, record, band, dt, count):
    """Return matrix and data of a receiver, both over the root mean square of the data."""
    first = max(0.0, record.start)
    last = min(response.times[-1], record.times[-1]) - 1.0 / band
    present = np.flatnonzero(record.present)
    response, record = (_quiet(motion, band) for motion in (response, record))
    n_samples = int((last - first) / dt)
    if n_samples < PER_KNOT * count:
        raise InputError(
            f"records: {record.label or 'one'} shares {last - first:.3g} s with the run, shorter "
            "than the moment rate that is looked for"
        )
    times = first + dt * np.arange(n_samples)
    columns, data = [], []
    shifts = PER_KNOT * dt * np.arange(count)
    for n in present:
        wave = response.velocity[:, n]
        columns.append(np.interp(times[:, None] - shifts, response.times, wave, 0.0, 0.0))
        data.append(np.interp(times, record.times, record.velocity[:, n]))
    data = np.concatenate(data)
    size = np.sqrt(np.mean(data**2))
    if size == 0.0:
        raise InputError("records: one never moves; leave it out")
    return np.concatenate(columns) / size, data / size


def _smooth(parts, rough):
    """Return coefficients, smoothing and covariance; generalised cross-validation."""
    matrix, data = (np.concatenate(column) for column in zip(*parts, strict=True))
    n_free = len(data) / (0.5 * KNOTS_PER_PERIOD * PER_KNOT)  # independent samples of the band
    normal, right = matrix.T @ matrix, matrix.T @ data
    largest = np.linalg.eigvalsh(normal)[-1]

    def solved(share):
        weights = share * rough + 1e-12 * np.eye(len(right))
        inverse = np.linalg.inv(normal + largest * weights)
        residual = data - matrix @ (inverse @ right)
        n_fitted = np.trace(inverse @ normal)
        residual_energy = residual @ residual * n_free / len(data)
        n_left = max(n_free - n_fitted, 1.0)
        return residual_energy / n_left**2, inverse, residual_energy / n_left

    share = min(SMOOTHING, key=lambda share: solved(share)[0])
    _, inverse, variance = solved(share)
    oversampling = len(data) / n_free
    spread = variance * oversampling * inverse @ normal @ inverse
    return inverse @ right, float(share), spread


def _unexplained(part, coefficients) -> float:
    """Return the share of the energy of data that coefficients leave unexplained."""
    matrix, data = part
    return float(np.sum((data - matrix @ coefficients) ** 2) / np.sum(data**2))
