"""Records of a back-analysis on one sampling, and the likelihood of their residuals."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..inference.likelihood import Gaussian, InferredLevels, Likelihood
from ..inference.records import Noise, Records, band_functions, check_sampling, gather, noise_of
from ..project.inputs import input_band

FINE = 8.0  # samples to the shortest period of the band
QUIET = 2.0  # of these periods that the noise is learnt from, at least


@dataclass(frozen=True)
class Window:
    """The time from the first firing and the band in which motions are looked at.

    Parameters
    ----------
    band : tuple of 2 float, Hz
    dt : float, s
    n_samples : int
    """

    band: tuple[float, float]
    dt: float
    n_samples: int

    @property
    def quiet(self) -> int:
        """Samples before the first firing that the noise needs."""
        return int(np.ceil(QUIET * FINE))


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Records that simulated waveforms are compared with.

    Parameters
    ----------
    window : Window
    likelihood : Likelihood
        Gaussian, of noise and model error.
    mesh_doubt : str
        Why the mesh error is not part of the covariance; nothing where it is.
    """

    window: Window
    likelihood: Likelihood
    mesh_doubt: str = ""

    @property
    def records(self) -> Records:
        """The records on the sampling of the window."""
        return self.likelihood.records

    def residuals(self, motions) -> np.ndarray:
        """Return records less simulated motions, one dict a blast, in the band, (n,)."""
        simulated = gathered(motions, self.records.receivers, self.window)
        return self.records.band.project(self.records.motion - simulated).ravel()

    def motion_of(self, residuals) -> np.ndarray:
        """Return residuals (..., n) as motion (..., n_blasts, n_receivers, 3, n_samples), m/s."""
        band = self.records.band
        shape = *np.shape(residuals)[:-1], *self.records.motion.shape[:3], band.n_functions
        return band.restore(np.reshape(residuals, shape))

    def whitened(self, residuals) -> tuple[float, np.ndarray]:
        """Return the misfit of residuals (n,), and these whitened.

        Notes
        -----
        theory.md (7.17): the sum of squares of what is whitened for each number of data.
        """
        white = self.likelihood.whiten(self.motion_of(residuals))
        n_data = self.likelihood.covariance.n_data
        return float(self.likelihood.misfit(white)) / n_data, white.ravel()

    def with_model_error(self, residuals, mesh_errors=(), fitted=(), doubt="") -> "Waveforms":
        """Return the waveforms with the covariance beside a simulation.

        Parameters
        ----------
        residuals : (n,) float64
            Of the simulation.
        mesh_errors : sequence of (n_blasts, n_receivers, 3, n_samples) float64, m/s
        fitted : (n_parameters, n) float64
            Change of the residuals by one prior standard deviation of each parameter.
        doubt : str
            Why there is no mesh error.

        Notes
        -----
        theory.md (7.13) to (7.19).
        """
        records = self.records
        recorded = replace(records, motion=records.in_band(records.motion))
        simulated = recorded.motion - self.motion_of(residuals)
        error = InferredLevels(self.motion_of(fitted) if len(fitted) else ())
        covariance = error.covariance(recorded, simulated, mesh_errors)
        likelihood = replace(self.likelihood, covariance=covariance)
        return replace(self, likelihood=likelihood, mesh_doubt=doubt)


def make_waveforms(projects, records, rms=None) -> Waveforms:
    """Bring records to one sampling, with the likelihood of their residuals.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast.
    records : sequence of dict of str to Seismogram
        For each blast by receiver; 0 s is its first firing.
    rms : float, m/s, optional
        Of the noise of each component within the band; estimated from the time before the first
        firing if not given.

    Raises
    ------
    InputError
        If a record has too little before the first firing, or too few samples for the band.

    Notes
    -----
    Before anything is run, the model error can only be shaped as the records are, at the levels
    of reference of theory.md (7.19). That finds the valley; within it, it favours too much
    damping, so `update_covariance` takes the shape of a simulation as soon as there is a good one.
    """
    window = window_of(projects)
    names = tuple(dict.fromkeys(name for some in records for name in some))
    for project, some in zip(projects, records, strict=True):
        for name, record in some.items():
            where = f"{project.path.name}: receivers.{name}.recorded"
            check_sampling(where, record, window.band)
    recordings = [
        {name: replace(project.records[name], seismogram=one) for name, one in some.items()}
        for project, some in zip(projects, records, strict=True)
    ]
    motion, valid = gather(recordings, names, 0.0, window.dt, window.n_samples)
    _refuse_empty(projects, records, names, valid)
    if rms is not None:
        noise = white_noise(rms, len(names), window)
    else:
        noise = recorded_noise(projects, records, names, window)
    band = band_functions(window.n_samples, window.dt, window.band, valid)
    blasts = tuple(project.path.name for project in projects)
    every = Records(blasts, names, window.dt, motion, valid, band, noise)
    return Waveforms(window, Likelihood(every, InferredLevels().covariance(every), Gaussian()))


def _refuse_empty(projects, records, names, valid):
    """Refuse a record none of whose samples can be compared."""
    for b, (project, some) in enumerate(zip(projects, records, strict=True)):
        for name in some:
            if not valid[b, names.index(name)].any():
                raise InputError(
                    f"{project.path.name}: receivers.{name}.recorded: no sample after the first "
                    "firing is there and below full scale; take another record, or leave it out "
                    "of back_analysis.receivers"
                )


def window_of(projects) -> Window:
    """Return the window of blasts: the band of comparison, or all that enters, in common time."""
    duration = min(project.config.run.duration_s for project in projects)
    band = projects[0].config.run.compare_band_hz
    if band is None:
        band = (1.0 / duration, max(input_band(project) for project in projects))
    low, high = map(float, band)
    if not low < high:
        raise InputError(
            f"{projects[0].path.name}: run.duration_s: {duration:g} s is shorter than a period of "
            f"what enters, {high:g} Hz; run longer"
        )
    dt = 1.0 / (FINE * high)
    return Window((low, high), dt, int(duration / dt + 1e-9))


def gathered(motions, receivers, window) -> np.ndarray:
    """Return motions, one dict a blast, as (n_blasts, n_receivers, 3, n_samples), zero if none."""
    found = np.zeros((len(motions), len(receivers), 3, window.n_samples))
    for b, one in enumerate(motions):
        for r, name in enumerate(receivers):
            if name in one:
                read = one[name].sampled(0.0, window.dt, window.n_samples)
                found[b, r] = np.nan_to_num(read.velocity).T
    return found


def white_noise(rms, n_receivers, window) -> Noise:
    """Return noise of one density with an rms in m/s within the band of a window."""
    low, high = window.band
    step = max(window.dt, 0.25 / high)
    variance = np.full((n_receivers, 3), rms**2 / (2.0 * (high - low)) / step)
    return Noise(
        step, np.zeros((n_receivers, 3, 1)), variance, np.tile(np.eye(3), (n_receivers, 1, 1)),
        np.ones((n_receivers, 3)), 1.0 / (window.n_samples * window.dt),
    )  # fmt: skip


def has_quiet(record, window) -> bool:
    """Tell whether a record begins early enough before the first firing to know its noise."""
    return -record.start >= (window.quiet - 1e-6) * window.dt


def recorded_noise(projects, records, receivers, window) -> Noise:
    """Learn the noise of receivers from their records before the first firing.

    Raises
    ------
    InputError
        If a record begins too late; the sentence says what to do.
    """
    for project, one in zip(projects, records, strict=True):
        for name, record in one.items():
            if not has_quiet(record, window):
                raise InputError(
                    f"{project.path.name}: receivers.{name}.recorded: begins at {record.start:g} s"
                    f", but waveforms need {window.quiet * window.dt:.2g} s of quiet before the "
                    "first firing (0 s) to know the noise; take a record with more pre-trigger, "
                    "set its start_s, or give back_analysis.noise_mm_per_s"
                )
    shortest = min(-record.start for one in records for record in one.values())
    n = int(shortest / window.dt + 1e-6)
    windows = np.full((len(records), len(receivers), 3, n), np.nan)
    for b, one in enumerate(records):
        for name, record in one.items():
            quiet = record.sampled(-n * window.dt, window.dt, n).velocity.T
            windows[b, receivers.index(name)] = np.where(record.present[:, None], quiet, np.nan)
    for each in windows.transpose(1, 2, 0, 3):
        # A component that no blast has needs some noise: that of another, backwards, so that the
        # two are not one.
        there = np.isfinite(each).any(axis=(1, 2))
        each[~there] = each[int(np.flatnonzero(there)[0]), :, ::-1]
    return noise_of(windows, window.dt, window.band)
