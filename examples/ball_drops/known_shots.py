"""Known shots: gains and clocks from first arrivals, all later motion predicted and scored."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import signal

EARLY = -5e-6, 15e-6  # s after P at 50 to 100 kHz: sets nuisances, before echoes
SLOWEST = 4e-6  # s, largest shift of a clock
BESIDE = 1.2e-6  # s, of a record from the clock of its shot
# Standard deviations: logarithms of the factor of a shot and of a record; s, s, m.
PRIORS = {"factor": 0.2, "amplitude": 0.15, "clock": 3e-6, "time": 4e-7, "place": 3e-3}
WINDOWS = (15e-6, 50e-6), (50e-6, 100e-6), (100e-6, 200e-6)
ERRORS = 0.05, 0.12, 0.26  # model error of these: share of the energy by which twin records differ
LARGEST = 4.0  # share of energy that a misfit counts at most
LEAD, ERRORS_OF_LEAD, DROPS = 10.0, 3.0, 5.0 / 6.0
LEAST_AGREEMENT = 0.6  # correlation of a first arrival whose amplitude counts
ROUNDS = 5  # of gains and factors in turn
RESAMPLED = 2000


@dataclass(frozen=True, eq=False)
class ShotRecords:
    """Records of shots of known force, one component each, in a band.

    Parameters
    ----------
    samples : (n, n_samples) float64
        In units of the instruments.
    dt, before : float, s
        Interval, and time from the first sample to the shot.
    band : tuple of 2 float, Hz
    shots, sensors : tuple of str
        Of each record.
    arrivals, ends : (n,) float64, s
        First arrival after the shot, and the time from which on nothing is compared.
    slopes : (n, 2) float64, s/m
        Of the arrival, by the position of the shot.
    """

    samples: np.ndarray
    dt: float
    before: float
    band: tuple[float, float]
    shots: tuple[str, ...]
    sensors: tuple[str, ...]
    arrivals: np.ndarray
    ends: np.ndarray
    slopes: np.ndarray

    def taken(self, chosen: np.ndarray) -> "ShotRecords":
        """Return some of the records, by a mask or by numbers."""
        numbers = np.arange(len(self.shots))[chosen]
        return replace(
            self, samples=self.samples[numbers], arrivals=self.arrivals[numbers],
            ends=self.ends[numbers], slopes=self.slopes[numbers],
            shots=tuple(self.shots[k] for k in numbers),
            sensors=tuple(self.sensors[k] for k in numbers),
        )  # fmt: skip

    def window(self, window: tuple[float, float]) -> np.ndarray:
        """Return the weights (n, n_samples), 1 within times after the first arrivals, else 0.

        A record that ends before has none.
        """
        times = self.dt * np.arange(self.samples.shape[1]) - self.before
        late = times - self.arrivals[:, None]
        whole = self.arrivals + window[1] <= self.ends
        return ((late >= window[0]) & (late < window[1]) & whole[:, None]).astype(float)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the shots, each once."""
        return tuple(dict.fromkeys(self.shots))

    @cached_property
    def halves(self) -> tuple[np.ndarray, np.ndarray]:
        """Masks (n,) of the records of every second shot, and of the others."""
        even = np.isin(self.shots, self.names[0::2])
        return even, ~even


def in_band(samples: np.ndarray, dt: float, band: tuple[float, float]) -> np.ndarray:
    """Return samples (n, n_samples) in a band in Hz, without delay."""
    sections = signal.butter(4, band, "bandpass", fs=1.0 / dt, output="sos")
    room = int(np.ceil(8.0 / (band[0] * dt)))
    wide = np.pad(samples, ((0, 0), (room, room)))
    return signal.sosfiltfilt(sections, wide, axis=1)[:, room:-room]


def shifted(samples: np.ndarray, delays: np.ndarray, dt: float) -> np.ndarray:
    """Return samples (n, n_samples) that are later by delays (n,) in s."""
    size = 2 * samples.shape[1]
    turns = np.exp(-2j * np.pi * np.outer(delays, np.fft.rfftfreq(size, dt)))
    return np.fft.irfft(np.fft.rfft(samples, size) * turns, size)[:, : samples.shape[1]]


def correlations(records: ShotRecords, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return delays (n_delays,) in s and the correlation (n, n_delays) of first arrivals."""
    most = round(SLOWEST / records.dt)
    delays = np.arange(-most, most + 1)
    early = records.window(EARLY)
    data = records.samples * early
    size = np.sqrt(np.sum(data**2, axis=1))
    rows = []
    for delay in delays:
        moved = np.roll(motion, delay, axis=1) * early
        norm = np.sqrt(np.sum(moved**2, axis=1))
        rows.append(np.sum(data * moved, axis=1) / np.maximum(size * norm, 1e-300))
    return records.dt * delays, np.array(rows).T


@dataclass(frozen=True, eq=False)
class Match:
    """Match of a simulated motion with records by their first arrivals.

    Parameters
    ----------
    clocks, moves : by shot
        s, and (2,) m along x and y.
    times, agreement : (n,) float64
        Of records: what remains of the delay in s, and the correlation of first arrivals.
    levels : (n,) float64
        Logarithm of the amplitude of first arrivals over that of the motion.
    products : (3, n, n_windows) float64
        Of record with record, record with motion and motion with motion in the windows after P.
    """

    clocks: dict[str, float]
    moves: dict[str, np.ndarray]
    times: np.ndarray
    agreement: np.ndarray
    levels: np.ndarray
    products: np.ndarray


def matched(records: ShotRecords, motion: np.ndarray) -> Match:
    """Match a motion with records: clocks and places of shots from first arrivals alone.

    Parameters
    ----------
    records : ShotRecords
    motion : (3, n, n_samples) float64
        Simulated, and its slopes per m where the shot is moved along x and y.
    """
    clocks, moves, times, agreement = _clocks(records, motion[0], np.array(records.shots))
    moved = aligned(records, motion, clocks, moves)
    early = records.window(EARLY)
    along = np.sum(records.samples * moved * early, axis=1)
    power = np.sum(moved**2 * early, axis=1)
    ratio = np.divide(along, power, out=np.zeros_like(along), where=power > 0.0)
    levels = np.log(np.maximum(ratio, 1e-3 * np.abs(ratio).max() + 1e-300))
    products = [
        [np.sum(weights * first * second, axis=1) for weights in map(records.window, WINDOWS)]
        for first, second in (
            (records.samples, records.samples), (records.samples, moved), (moved, moved))
    ]  # fmt: skip
    return Match(clocks, moves, times, agreement, levels, np.array(products).transpose(0, 2, 1))


def _clocks(records, motion, shots):
    """Return clocks and moves by shot, and residual times and correlations of records."""
    delays, values = correlations(records, motion)
    clocks, moves = {}, {}
    times, agreement = np.zeros(len(shots)), np.zeros(len(shots))
    for name in records.names:
        own = np.flatnonzero(shots == name)
        common = delays[int(np.argmax(np.maximum(values[own], 0.0).sum(axis=0)))]
        near = np.abs(delays - common) <= BESIDE + 1e-12
        picked = np.array([_peak(delays[near], values[k, near]) for k in own])
        columns = np.column_stack([np.ones(len(own)), records.slopes[own]])
        prior = np.array([PRIORS["clock"], PRIORS["place"], PRIORS["place"]])
        weights = np.maximum(picked[:, 1], 0.0)[:, None] ** 2 / PRIORS["time"] ** 2
        system = columns.T @ (weights * columns) + np.diag(prior**-2.0)
        best = np.linalg.solve(system, columns.T @ (weights[:, 0] * picked[:, 0]))
        clocks[name], moves[name] = float(best[0]), best[1:]
        times[own], agreement[own] = picked[:, 0] - columns @ best, picked[:, 1]
    return clocks, moves, times, agreement


def _peak(delays, values):
    """Return the delay of the largest value, by a parabola, and the value."""
    k = int(np.argmax(values))
    if not 0 < k < len(values) - 1:
        return delays[k], values[k]
    before, middle, after = values[k - 1 : k + 2]
    bend = before - 2.0 * middle + after
    return delays[k] + 0.5 * (before - after) / bend * (delays[1] - delays[0]), middle


def gains(
    records: ShotRecords, match: Match, fitted: np.ndarray
) -> tuple[dict[str, float], np.ndarray]:
    """Return logarithms of gains by sensor, and of the amplitudes (n,) of all records.

    Sensors have their gains from the fitted records (n,) alone, or else the median; each shot has
    a factor of its own from its first arrivals. Medians, as outliers are likely.
    """
    shots, sensors = np.array(records.shots), np.array(records.sensors)
    ridge = (PRIORS["amplitude"] / PRIORS["factor"]) ** 2
    clear = match.agreement > LEAST_AGREEMENT
    fitted = fitted & clear
    usual = float(np.median(match.levels[fitted])) if fitted.any() else 0.0
    known = dict.fromkeys(sensors[fitted].tolist(), usual)
    factors = dict.fromkeys(records.names, 0.0)
    for _ in range(ROUNDS):
        for name in known:
            own = (sensors == name) & fitted
            known[name] = float(np.median(match.levels[own] - [factors[s] for s in shots[own]]))
        usual = float(np.median(list(known.values()))) if known else usual
        for name in factors:
            own = (shots == name) & clear
            rest = match.levels[own] - [known.get(s, usual) for s in sensors[own]]
            if len(rest):
                factors[name] = float(np.median(rest) * len(rest) / (len(rest) + ridge))
    return known, np.array([
        known.get(sensor, usual) + factors[shot]
        for sensor, shot in zip(sensors.tolist(), shots.tolist(), strict=True)
    ])  # fmt: skip


def aligned(records: ShotRecords, motion: np.ndarray, clocks: Mapping, moves: Mapping):
    """Return motion (n, n_samples) with the moves and clocks of its shots, see `nuisances`."""
    steps = np.array([moves[name] for name in records.shots])
    moved = motion[0] + steps[:, :1] * motion[1] + steps[:, 1:] * motion[2]
    return shifted(moved, np.array([clocks[name] for name in records.shots]), records.dt)


def scores(records: ShotRecords, match: Match, amplitudes: np.ndarray) -> np.ndarray:
    """Return the log likelihood (n, n_windows) of records in the windows after P.

    Notes
    -----
    ``-n/2 ln(e + u)``: n twice bandwidth times length, u the unexplained share and e the model
    error of the window, whose level is that of a Gaussian that is averaged out. Zero where a record
    ends before.
    """
    share = shares(match, amplitudes)
    spans = np.array([last - first for first, last in WINDOWS])
    number = 2.0 * (records.band[1] - records.band[0]) * spans
    errors = np.array(ERRORS)
    logs = np.log((errors + np.minimum(share, LARGEST)) / (1.0 + errors))
    return np.nan_to_num(-0.5 * number * logs)


def shares(match: Match, amplitudes: np.ndarray) -> np.ndarray:
    """Return the unexplained shares (n, n_windows) of energy; NaN where a record ends before."""
    data, cross, power = match.products
    factor = np.exp(amplitudes)[:, None]
    rest = data - 2.0 * factor * cross + factor**2 * power
    return np.divide(rest, data, out=np.full_like(rest, np.nan), where=data > 0.0)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Scores of each half of the shots, by gains and choices of the other half.

    Parameters
    ----------
    scores, shares : (n, n_windows) float64
        Log likelihoods, and unexplained shares of energy.
    chosen : tuple of 2 int
        The motion that each half chose for the other one.
    amplitudes : (n,) float64
        Logarithms of the factors on the motion chosen for each record.
    """

    scores: np.ndarray
    shares: np.ndarray
    chosen: tuple[int, ...]
    amplitudes: np.ndarray


def held_out(records: ShotRecords, matches: Sequence[Match]) -> HeldOut:
    """Predict each half of the shots by the best of several motions for the other half."""
    n = len(records.shots)
    result, rest, used = np.zeros((n, len(WINDOWS))), np.zeros((n, len(WINDOWS))), np.zeros(n)
    chosen = []
    for fitted, other in (records.halves, records.halves[::-1]):
        amplitudes = [gains(records, each, fitted)[1] for each in matches]
        values = [scores(records, m, a) for m, a in zip(matches, amplitudes, strict=True)]
        best = int(np.argmax([value[fitted].sum() for value in values]))
        chosen.append(best)
        result[other], used[other] = values[best][other], amplitudes[best][other]
        rest[other] = shares(matches[best], amplitudes[best])[other]
    return HeldOut(result, rest, tuple(chosen), used)


@dataclass(frozen=True)
class Lead:
    """Lead of one score over another, with its error by resampling shots.

    Parameters
    ----------
    value, error : float
        Of the log likelihood.
    better, of : int
        Shots that gain, of all.
    """

    value: float
    error: float
    better: int
    of: int

    @property
    def decisive(self) -> bool:
        """Whether it exceeds `LEAD` and three of its errors."""
        return self.value > max(LEAD, ERRORS_OF_LEAD * self.error)

    @property
    def general(self) -> bool:
        """Whether nearly all shots gain."""
        return self.better >= DROPS * self.of - 1e-9


def lead(records: ShotRecords, first: np.ndarray, second: np.ndarray) -> Lead:
    """Return the lead of the first of two scores (n, n_windows) over the second."""
    gain = np.sum(first - second, axis=1)
    by_shot = np.array([gain[np.array(records.shots) == name].sum() for name in records.names])
    drawn = np.random.default_rng(1).integers(len(by_shot), size=(RESAMPLED, len(by_shot)))
    error = float(np.std(by_shot[drawn].sum(axis=1)))
    return Lead(float(by_shot.sum()), error, int(np.sum(by_shot > 0.0)), len(by_shot))


def loss(records: ShotRecords, prediction: np.ndarray) -> tuple[float, float]:
    """Return 1/Q beyond that of a prediction and its error, by energies alone.

    A loss lowers the misfit wherever phases are wrong, so it is asked by the ratio of energies of
    record and prediction in windows after P, against time.
    """
    starts = np.arange(15e-6, 180e-6, 20e-6)
    ratios = []
    for start in starts:
        weights = records.window((start, start + 20e-6))
        recorded, simulated = (
            np.sum(weights * x**2, axis=1) for x in (records.samples, prediction)
        )
        used = (recorded > 0.0) & (simulated > 0.0)
        ratios.append(np.where(used, np.log(np.where(used, recorded, 1.0)), np.nan)
                      - np.log(np.where(used, simulated, 1.0)))  # fmt: skip
    table, centre = np.array(ratios), np.sqrt(records.band[0] * records.band[1])
    shots = np.array(records.shots)
    slopes = []
    for name in records.names:
        mean = np.nanmean(table[:, shots == name], axis=1)
        good = np.isfinite(mean)
        if np.count_nonzero(good) > 2:
            slopes.append(np.polyfit(starts[good], mean[good], 1)[0])
    values = -np.array(slopes) / (2.0 * np.pi * centre)
    if len(values) < 3:
        return 0.0, np.inf
    return float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(len(values)))
