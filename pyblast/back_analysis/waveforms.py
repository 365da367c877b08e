"""Records of all blasts and receivers on one sampling, and what their residuals are worth."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..inference.covariance import Whitener, usual_whitener
from ..inference.noise import Noise, band_functions, noise_of
from ..project.census import input_band

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
    """Records that waveforms are compared with.

    Parameters
    ----------
    window : Window
    receivers : tuple of str
    recorded : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Zero where nothing was recorded.
    noise : Noise
    whitener : Whitener
    mesh_doubt : str
        Why the whitener knows nothing of the error of the mesh; nothing where it does.
    """

    window: Window
    receivers: tuple[str, ...]
    recorded: np.ndarray
    noise: Noise
    whitener: Whitener
    mesh_doubt: str = ""

    def residuals(self, motions) -> np.ndarray:
        """Return what records less simulated motions, one dict a blast, hold in the band, (n,)."""
        found = gathered(motions, self.receivers, self.window)
        return self.whitener.band.project(self.recorded - found).ravel()

    def worth(self, residuals) -> tuple[float, np.ndarray]:
        """Return the misfit of residuals (n,), and these whitened.

        Notes
        -----
        theory.md (7.17): the sum of squares of what is whitened for each number of data.
        """
        band = self.whitener.band
        held = np.reshape(residuals, (*self.recorded.shape[:3], band.n_functions))
        white = self.whitener.apply(band.restore(held)).ravel()
        return float(white @ white) / self.whitener.n_data, white


def make_waveforms(projects, records, rms=None) -> Waveforms:
    """Bring records to one sampling and learn what residuals are worth.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast.
    records : sequence of dict of str to Seismogram
        For each blast by receiver; 0 s is its first firing.
    rms : float, m/s, optional
        Of the noise of each component within the band; learnt from the time before the first
        firing if not given.

    Raises
    ------
    InputError
        If a record has too little before the first firing, or too few samples for the band.

    Notes
    -----
    Before anything is run, the errors of the theory can only be shaped as the records are, at the
    usual levels of theory.md (7.19). That finds the valley; within it, it favours too much
    damping, so `shape_beside` takes the shape of a simulation as soon as there is a good one.
    """
    window = window_of(projects)
    names = tuple(dict.fromkeys(name for one in records for name in one))
    _refuse_slow(projects, records, window)
    recorded = gathered(records, names, window)
    band = band_functions(
        window.n_samples, window.dt, window.band, _valid(projects, records, names, window)
    )
    if rms is not None:
        noise = white_noise(rms, len(names), window)
    else:
        noise = recorded_noise(projects, records, names, window)
    made = usual_whitener(recorded, noise, band)
    return Waveforms(window, names, recorded, noise, made)


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


def _refuse_slow(projects, records, window):
    """Refuse records whose samples do not carry the band."""
    for project, one in zip(projects, records, strict=True):
        for name, record in one.items():
            if not 0.5 / record.dt > window.band[1]:
                raise InputError(
                    f"{project.path.name}: receivers.{name}.recorded: {1.0 / record.dt:g} samples "
                    f"a second do not carry {window.band[1]:g} Hz; lower run.compare_band_hz"
                )


def _valid(projects, records, receivers, window):
    """Tell which samples were recorded and are not clipped, (n_blasts, n_receivers, 3, n)."""
    times = window.dt * np.arange(window.n_samples)
    valid = np.zeros((len(records), len(receivers), 3, window.n_samples), dtype=bool)
    for b, (project, one) in enumerate(zip(projects, records, strict=True)):
        for name, record in one.items():
            clipped = project.records[name].clipped
            inside = (times >= record.start) & (times <= record.times[-1] + 1e-9)
            there = record.present[:, None] & inside
            for component, marks in enumerate(clipped.T):
                there[component] &= _apart(times, record.times[marks], max(window.dt, record.dt))
            if not there.any():
                raise InputError(
                    f"{project.path.name}: receivers.{name}.recorded: no sample after the first "
                    "firing is there and below full scale; take another record, or leave it out "
                    "of back_analysis.receivers"
                )
            valid[b, receivers.index(name)] = there
    return valid


def _apart(times, others, distance):
    """Tell which times lie farther than a distance from all others, which rise."""
    if not len(others):
        return np.ones(len(times), dtype=bool)
    after = np.minimum(np.searchsorted(others, times), len(others) - 1)
    near = np.minimum(np.abs(times - others[after]), np.abs(times - others[after - 1]))
    return near > distance
