"""Records on one sampling, their frequency band, and the noise in them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import fft, linalg, signal, stats

from ..errors import InputError

CONCENTRATION = 0.9
MARGIN = 6


@dataclass(frozen=True, eq=False)
class Band:
    """Band: orthonormal functions on a time window with their energy within a frequency band.

    Parameters
    ----------
    dt : float, s
    low, high : float, Hz
    basis : (n_samples, n_functions) float64
        Each column of unit length, with at least 0.9 of its energy between ``low`` and ``high``.
    gapped : dict of (blast, receiver, component) to (n_samples, n_functions) float64
        Functions of channels with invalid samples, zero there; lost functions are columns of
        zeros.
    """

    dt: float
    low: float
    high: float
    basis: np.ndarray
    gapped: dict = field(default_factory=dict)

    @property
    def n_functions(self):
        """Number of functions of a channel."""
        return self.basis.shape[1]

    @cached_property
    def _lost(self):
        """Channels without any function."""
        return [channel for channel, functions in self.gapped.items() if not functions.any()]

    @cached_property
    def _partial(self):
        """Functions of the channels with some invalid samples."""
        return {channel: f for channel, f in self.gapped.items() if f.any()}

    def functions(self, channel):
        """Return the functions of one channel (blast, receiver, component)."""
        return self.gapped.get(channel, self.basis)

    def of_blast(self, blast: int) -> "Band":
        """Return the band of the records of one blast alone."""
        own = {(0, r, c): f for (b, r, c), f in self.gapped.items() if b == blast}
        return replace(self, gapped=own)

    def project(self, motion):
        """Return the coefficients of motion in the band.

        Parameters
        ----------
        motion : (..., n_blasts, n_receivers, 3, n_samples) float

        Returns
        -------
        (..., n_blasts, n_receivers, 3, n_functions) float64
            Invalid samples do not contribute.

        Raises
        ------
        InputError
            If a valid sample is not finite.
        """
        motion = np.asarray(motion, dtype=float)
        held = motion @ self.basis
        if self._lost:
            held[(..., *np.transpose(self._lost), slice(None))] = 0.0
        for channel, functions in self._partial.items():
            used = np.any(functions != 0.0, axis=1)
            held[(..., *channel, slice(None))] = (
                motion[(..., *channel, slice(None))][..., used] @ functions[used]
            )
        if not np.all(np.isfinite(held)):
            b, r, c = np.argwhere(~np.isfinite(held))[0][-4:-1]
            raise InputError(
                f"seismograms: blast {b}, receiver {r}, component {c} has a sample that is not "
                "finite; mark it invalid"
            )
        return held

    def restore(self, coefficients):
        """Return the motion (..., n_samples) of coefficients; zero where invalid."""
        motion = coefficients @ self.basis.T
        if self._lost:
            motion[(..., *np.transpose(self._lost), slice(None))] = 0.0
        for channel, functions in self._partial.items():
            held = coefficients[(..., *channel, slice(None))]
            motion[(..., *channel, slice(None))] = held @ functions.T
        return motion


def band_functions(n_samples, dt, band, valid=None) -> Band:
    """Build the functions of a band on a window.

    Parameters
    ----------
    n_samples : int
    dt : float, s
    band : tuple of 2 float, Hz
    valid : (n_blasts, n_receivers, 3, n_samples) bool, optional
        False where a sample is clipped or missing.

    Returns
    -------
    Band
        About ``2 (high - low) n_samples dt`` functions.

    Raises
    ------
    InputError
        If the band is empty, reaches beyond the Nyquist frequency, or is so narrow that the
        window holds none of its motion.

    Notes
    -----
    Eigenvectors of the band's own operator on the window (Slepian 1978), theory.md (7.9), looked
    for among the cosines in and near the band. Where samples are invalid, those combinations are
    kept that have 0.9 of their energy in the band and in the samples that are left.
    """
    low, high = map(float, band)
    if not 0.0 <= low < high < 0.5 / dt:
        raise InputError(
            f"band: need 0 <= low < high < {0.5 / dt:g} Hz (half the sampling rate), "
            f"got {low:g} to {high:g} Hz"
        )
    duration = n_samples * dt
    first = max(0, int(2.0 * low * duration) - MARGIN)
    last = min(n_samples, int(2.0 * high * duration) + MARGIN + 2)
    unit = np.zeros((n_samples, last - first))
    unit[np.arange(first, last), np.arange(last - first)] = 1.0
    cosines = fft.idct(unit, axis=0, norm="ortho")
    lag = np.arange(n_samples)
    above, below = (2.0 * edge * dt * np.sinc(2.0 * edge * dt * lag) for edge in (high, low))
    share, mixture = linalg.eigh(cosines.T @ linalg.matmul_toeplitz(above - below, cosines))
    concentrated = share >= CONCENTRATION
    if not np.any(concentrated):
        raise InputError(
            f"band: {low:g} to {high:g} Hz is too narrow for a window of {duration:g} s; "
            f"make it longer than about {1.0 / (high - low):.2g} s"
        )
    basis = cosines @ mixture[:, concentrated]
    return Band(float(dt), low, high, basis, {} if valid is None else _gapped(basis, valid))


def _gapped(basis, valid):
    """Return the functions of each channel in which a sample is invalid."""
    valid = np.asarray(valid, dtype=bool)
    if valid.ndim != 4 or valid.shape[2:] != (3, len(basis)):
        raise InputError(
            f"valid: must have shape (n_blasts, n_receivers, 3, {len(basis)}), got {valid.shape}"
        )
    gapped = {}
    for index in np.argwhere(~valid.all(axis=-1)):
        channel = tuple(map(int, index))
        vectors, length, _ = linalg.svd(basis * valid[channel][:, None], full_matrices=False)
        gapped[channel] = vectors * (length**2 >= CONCENTRATION)
    return gapped


ORDER = 8
LEAST_NOISE = 16  # samples of a window of noise: two periods at 8 of them
TIME_BANDWIDTH = 1.5
N_TAPERS = 2
REACH = 2.0
FLOOR = 0.02
SURE = 0.01
PADDING = 8


@dataclass(frozen=True, eq=False)
class Noise:
    """Noise of each channel: a stationary autoregressive process.

    Parameters
    ----------
    step : float, s
        Of the autoregression: half a period of twice the top of the band.
    coefficients : (n_receivers, 3, order) float64
    variance : (n_receivers, 3) float64, (m/s)2
        Innovation variance, ``inflation`` included.
    correlation : (n_receivers, 3, 3) float64
        Between the components; the unit matrix where a test does not reject it.
    inflation : (n_receivers, 3) float64
        Factor in the variance for the few degrees of freedom of its estimate.
    resolved : float, Hz
        One period to a window. Below, the density is constant.
    """

    step: float
    coefficients: np.ndarray
    variance: np.ndarray
    correlation: np.ndarray
    inflation: np.ndarray
    resolved: float

    def density(self, frequency):
        """Return the two-sided density at frequencies, (n_receivers, 3, n) (m/s)2/Hz."""
        order = np.arange(1, self.coefficients.shape[-1] + 1)
        turns = np.exp(-2j * np.pi * self.step * np.outer(order, frequency))
        reply = np.abs(1.0 - self.coefficients @ turns) ** 2
        return self.step * self.variance[..., None] / reply

    def covariance(self, band, blast, receiver):
        """Return the covariance of a receiver's coefficients in one blast.

        Parameters
        ----------
        band : Band
        blast, receiver : int

        Returns
        -------
        (3 n_functions, 3 n_functions) float64, (m/s)2
            With 2 % of its mean on the diagonal; zero where functions are lost.

        Notes
        -----
        ``sqrt(T_c) rho_cd sqrt(T_d)`` for components c and d; theory.md (7.11), (7.12).
        """
        n = band.n_functions
        root = np.zeros((3, n, n))
        n_padded = fft.next_fast_len(2 * len(band.basis), real=True)
        frequency = fft.rfftfreq(n_padded, band.dt)
        frequency = frequency[frequency <= 0.5 / self.step]
        power = 2.0 * self.density(frequency)[receiver] / (n_padded * band.dt)
        power[:, 0] /= 2.0
        for c in range(3):
            functions = band.functions((blast, receiver, c))
            present = np.any(functions != 0.0, axis=0)
            waves = fft.rfft(functions, n_padded, axis=0)[: len(frequency)]
            toeplitz = np.real((waves.conj() * power[c][:, None]).T @ waves)
            level = np.trace(toeplitz) / max(1, np.count_nonzero(present))
            root[c] = symmetric_root(toeplitz + FLOOR * level * np.diag(present))
        block = np.einsum("cij,cd,dkj->cidk", root, self.correlation[receiver], root)
        return block.reshape(3 * n, 3 * n)


def noise_of(windows, dt, band) -> Noise:
    """Estimate the noise of each channel from its windows before the blasts.

    Parameters
    ----------
    windows : (n_blasts, n_receivers, 3, n_samples) float, m/s
        Samples before the first arrival. A window with a sample that is not finite is left out.
    dt : float, s
    band : tuple of 2 float, Hz

    Raises
    ------
    InputError
        If a channel has no window, or only zeros, or windows are shorter than 16
        samples or than a period at the top of the band.

    Notes
    -----
    The multitaper spectra of all blasts are pooled and Levinson's recursion finds the
    autoregression of order 8 with their autocovariance at 4 times the top of the band;
    theory.md (7.10). A variance from nu degrees of freedom is multiplied by ``nu / (nu - 2)``, so
    that whitened noise has unit variance in the mean.
    """
    windows = np.asarray(windows, dtype=float)
    if windows.ndim != 4 or windows.shape[2] != 3:
        raise InputError(
            "noise windows: must have shape (n_blasts, n_receivers, 3, n_samples), "
            f"got {windows.shape}"
        )
    n = windows.shape[-1]
    if n < LEAST_NOISE or n * dt * band[1] < 1.0:
        raise InputError(
            f"noise windows: need {LEAST_NOISE} samples and {1.0 / band[1]:g} s, "
            f"got {n} and {n * dt:g} s"
        )
    windows = windows - windows.mean(axis=-1, keepdims=True)
    given = np.all(np.isfinite(windows), axis=-1)
    moving = given & np.any(windows != 0.0, axis=-1)
    if not np.all(moving.any(axis=0)):
        receiver, component = np.argwhere(~moving.any(axis=0))[0]
        raise InputError(
            f"noise windows: receiver {receiver}, component {component} has only zeros; "
            "leave the channel out"
        )
    windows = np.where(moving[..., None], windows, 0.0)
    degrees = 2.0 * N_TAPERS * np.count_nonzero(moving, axis=0)
    inflation = degrees / (degrees - 2.0)
    step = max(dt, 0.5 / (REACH * band[1]))
    coefficients, variance = _autoregression(windows, np.count_nonzero(moving, axis=0), dt, step)
    unmixed = np.broadcast_to(np.eye(3), (*variance.shape[:1], 3, 3))
    noise = Noise(step, coefficients, variance * inflation, unmixed, inflation, 1.0 / (n * dt))
    return _correlated(noise, windows, moving, band_functions(n, dt, band))


def white_noise(rms, n_receivers, band, dt, n_samples) -> Noise:
    """Return white noise with an rms in m/s within a band in Hz, for samples (n_samples,)."""
    low, high = band
    step = max(dt, 0.25 / high)
    variance = np.full((n_receivers, 3), rms**2 / (2.0 * (high - low)) / step)
    return Noise(
        step, np.zeros((n_receivers, 3, 1)), variance, np.tile(np.eye(3), (n_receivers, 1, 1)),
        np.ones((n_receivers, 3)), 1.0 / (n_samples * dt),
    )  # fmt: skip


def _autoregression(windows, n_windows, dt, step):
    """Return coefficients (n_receivers, 3, order) and variance of pooled windows."""
    n = windows.shape[-1]
    tapers = signal.windows.dpss(n, TIME_BANDWIDTH, N_TAPERS)
    n_padded = fft.next_fast_len(PADDING * n, real=True)
    frequency = fft.rfftfreq(n_padded, dt)
    frequency = frequency[frequency <= 0.5 / step * (1.0 + 1e-9)]
    density = np.zeros((*n_windows.shape, len(frequency)))
    for taper in tapers:
        spectrum = fft.rfft(windows * taper, n_padded, axis=-1)[..., : len(frequency)]
        density += dt / N_TAPERS * np.sum(np.abs(spectrum) ** 2, axis=0) / n_windows[..., None]
    first = np.searchsorted(frequency, 1.0 / (n * dt))
    density[..., :first] = density[..., first : first + 1]
    weight = np.full(len(frequency), 2.0 / (n_padded * dt))
    weight[[0, -1]] /= 2.0
    lags = step * np.arange(ORDER + 1)
    covariance = (density * weight) @ np.cos(2.0 * np.pi * np.outer(frequency, lags))
    coefficients = np.empty((*n_windows.shape, ORDER))
    for channel in np.ndindex(n_windows.shape):
        lagged = covariance[channel]
        coefficients[channel] = linalg.solve_toeplitz(lagged[:-1], lagged[1:])
    variance = covariance[..., 0] - np.sum(coefficients * covariance[..., 1:], axis=-1)
    return coefficients, variance


def _correlated(noise, windows, moving, band: Band):
    """Return the noise with those correlations between components that a test confirms."""
    n = band.n_functions
    held = band.project(windows)
    correlation = np.array(noise.correlation)
    for receiver in range(windows.shape[1]):
        whole = moving[:, receiver].all(axis=-1)
        count = n * np.count_nonzero(whole)
        if count < 12:
            continue
        block = noise.covariance(band, 0, receiver)
        white = held[whole, receiver].reshape(-1, 3 * n) @ symmetric_root(block, -0.5)
        estimate = np.corrcoef(white.reshape(-1, 3, n).transpose(1, 0, 2).reshape(3, -1))
        spread = -(count - 1.0 - 11.0 / 6.0) * np.linalg.slogdet(estimate)[1]
        if stats.chi2.sf(spread, 3) < SURE:
            correlation[receiver] = estimate
    return Noise(
        noise.step, noise.coefficients, noise.variance, correlation, noise.inflation, noise.resolved
    )


def symmetric_root(matrix, power=0.5):
    """Return a power of a positive definite matrix, rows and columns of zeros left out."""
    rows = np.flatnonzero(np.diag(matrix) > 0.0)
    value, vector = linalg.eigh(matrix[np.ix_(rows, rows)])
    root = np.zeros_like(matrix)
    root[np.ix_(rows, rows)] = (vector * value**power) @ vector.T
    return root


COMPONENTS = ("east", "north", "up")
ALIGNED = 0.01  # of a sample: largest offset of a record that is copied


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
    unused : dict of str to str
        Why recordings, such as ``R3`` or ``R3 in B1``, and channels, such as ``R3 north``, are not
        used.
    """

    blasts: tuple[str, ...]
    receivers: tuple[str, ...]
    dt: float
    motion: np.ndarray
    valid: np.ndarray
    band: Band
    noise: Noise
    unused: dict[str, str] = field(default_factory=dict)

    @property
    def n_samples(self) -> int:
        """Samples from the first firing on."""
        return self.motion.shape[-1]

    @property
    def duration(self) -> float:
        """Duration of the records and of a simulation, s."""
        return self.n_samples * self.dt

    def in_band(self, motion) -> np.ndarray:
        """Return a motion filtered to the band, of the same shape."""
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
    for b, blast in enumerate(recordings):
        for r, name in enumerate(receivers):
            if name not in blast:
                continue
            record = blast[name].seismogram
            if abs(record.dt - dt) > 1e-9 * dt:
                velocity, good, at = _resampled(blast[name], start, dt, n_samples)
            else:
                velocity, good, at = _copied(blast[name], start, n_samples)
            motion[b, r, :, at] = np.where(np.isfinite(velocity), velocity, 0.0).T
            valid[b, r, :, at] = (np.isfinite(velocity) & good).T
    return motion, valid


def _copied(recording, start, n_samples):
    """Return samples of a recording of this sampling, which are valid, and their slice."""
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
    inside = (times >= record.start - 1e-9) & (times <= record.times[-1] + 1e-9)
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
    """Check that the sampling of a seismogram carries a band in Hz.

    Raises
    ------
    InputError
        With ``where`` as its place.
    """
    if not 0.5 / record.dt > band[1]:
        raise InputError(
            f"{where}: {1.0 / record.dt:g} samples a second do not carry {band[1]:g} Hz; lower "
            "run.compare_band_hz"
        )
