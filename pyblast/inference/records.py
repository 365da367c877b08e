"""Records of blasts at receivers on one sampling: motion, valid samples, noise, band."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .noise import Band, Noise

COMPONENTS = ("east", "north", "up")
ALIGNED = 0.01  # of a sample, by which records may be off the instants that are compared


@dataclass(frozen=True, eq=False)
class Records:
    """Recorded motion that simulations are compared with.

    Parameters
    ----------
    blasts : tuple of n_blasts str
    receivers : tuple of n_receivers str
    dt : float, s
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        East, north, vertical, from the first firing on; zero where nothing was recorded.
    valid : the same shape, bool
        Samples that were recorded and are not clipped.
    band : Band
    noise : Noise
        Of each receiver.
    dead : tuple of str
        Channels that never move, such as ``R3 north``; none of their samples is valid.
    """

    blasts: tuple[str, ...]
    receivers: tuple[str, ...]
    dt: float
    motion: np.ndarray
    valid: np.ndarray
    band: Band
    noise: Noise
    dead: tuple[str, ...] = ()

    @property
    def n_samples(self) -> int:
        """Samples from the first firing on."""
        return self.motion.shape[-1]

    @property
    def duration(self) -> float:
        """How long a simulation has to last, s."""
        return self.n_samples * self.dt

    def in_band(self, motion) -> np.ndarray:
        """Return the part of a motion that is compared, as motion of the same shape."""
        return self.band.restore(self.band.project(motion))

    def residual(self, motion) -> np.ndarray:
        """Return the records less a motion, zero in samples that are not valid."""
        return np.where(self.valid, self.motion - motion, 0.0)


def gather(recordings, receivers, start, dt, n_samples) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of recordings at common instants.

    Parameters
    ----------
    recordings : sequence of dict of str to Recording
        For each blast by receiver; 0 s is its first firing.
    receivers : sequence of str
    start, dt : float, s
    n_samples : int

    Returns
    -------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Zero where nothing was recorded.
    valid : the same shape, bool
        False where nothing was recorded, or where a sample that is used is clipped.

    Notes
    -----
    A recording with this sampling, and samples within 1 % of one at these instants, is copied;
    another one is resampled within its band, and samples next to clipped ones are not valid.
    """
    shape = len(recordings), len(receivers), 3, n_samples
    motion, valid = np.zeros(shape), np.zeros(shape, dtype=bool)
    for b, some in enumerate(recordings):
        for r, name in enumerate(receivers):
            if name not in some:
                continue
            record = some[name].seismogram
            if abs(record.dt - dt) > 1e-9 * dt:
                velocity, good, at = _resampled(some[name], start, dt, n_samples)
            else:
                velocity, good, at = _copied(some[name], start, n_samples)
            motion[b, r, :, at] = np.where(np.isfinite(velocity), velocity, 0.0).T
            valid[b, r, :, at] = (np.isfinite(velocity) & good).T
    return motion, valid


def _copied(recording, start, n_samples):
    """Return samples of a recording that has the sampling, whether they count, and their place."""
    record = recording.seismogram
    first = round((start - record.start) / record.dt)
    taken = slice(max(first, 0), max(first + n_samples, 0))
    late = record.start + first * record.dt - start
    velocity = record.velocity
    if abs(late) > ALIGNED * record.dt:
        velocity = record.sampled(record.start - late, record.dt, len(velocity)).velocity
    velocity, good = velocity[taken], ~recording.clipped[taken]
    before = max(-first, 0)
    return velocity, good, slice(before, before + len(velocity))


def _resampled(recording, start, dt, n_samples):
    """Return the same of a recording with another sampling."""
    record, times = recording.seismogram, start + dt * np.arange(n_samples)
    velocity = record.sampled(start, dt, n_samples).velocity
    inside = (times >= record.start) & (times <= record.times[-1] + 1e-9)
    good = record.present & inside[:, None]
    for component, marks in enumerate(recording.clipped.T):
        good[:, component] &= _apart(times, record.times[marks], max(dt, record.dt))
    return velocity, good, slice(0, n_samples)


def _apart(times, others, distance):
    """Tell which times lie farther than a distance from all others, which rise."""
    if not len(others):
        return np.ones(len(times), dtype=bool)
    after = np.minimum(np.searchsorted(others, times), len(others) - 1)
    near = np.minimum(np.abs(times - others[after]), np.abs(times - others[after - 1]))
    return near > distance


def check_sampling(where: str, record, band):
    """Refuse a seismogram whose samples do not carry a band in Hz.

    Raises
    ------
    InputError
        With the place that is given as ``where``.
    """
    if not 0.5 / record.dt > band[1]:
        raise InputError(
            f"{where}: {1.0 / record.dt:g} samples a second do not carry {band[1]:g} Hz; lower "
            "run.compare_band_hz"
        )
