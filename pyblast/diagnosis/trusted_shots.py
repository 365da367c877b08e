"""What trusted shots tell: source of each shot; gain, clock and model error of receivers."""

from dataclasses import replace

import numpy as np
from scipy import fft, linalg, signal

from .case import Case

ROUNDS = 6  # of iteratively reweighted least squares
DOUBT = 4.0  # degrees of freedom of the weights of receivers
DAMPING = 1e-2  # prior variance of the source: noise over signal, of a receiver as loud as all
STEPS_PER_PERIOD = 40  # of a search for an origin time, at the top of the band
FARTHEST = 1.0  # standard deviations of the origin time
ONSET = 0.05  # of the largest motion of a record: its first arrival
LATEST = 0.25  # of the shortest period: a clock farther off would fit a neighbouring cycle


def with_source(case: Case, blast: str, motion: np.ndarray) -> np.ndarray:
    """Return simulated motion with gains and clocks of receivers and the source of a shot.

    Parameters
    ----------
    case : Case
        Its project says what of the source is unknown: ``diagnosis.source_s``, the length of a
        filter, or ``diagnosis.trigger_s``, an origin time.
    blast : str
    motion : (n_receivers, 3, n_samples) float64, m/s

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s

    Notes
    -----
    A nuisance common to all receivers, at its most probable value; receivers that contradict the
    others weigh little (Student's t), so that one wrong receiver does not move the source.
    """
    table = case.project.config.diagnosis
    if case.gain is not None:
        motion = motion * case.gain[:, None, None]
    if case.clock is not None:
        motion = time_shifted(motion, case.clock[:, None], case.dt)
    if table is None or (table.source_s is None and table.trigger_s is None):
        return motion
    b = case.blasts.index(blast)
    recorded = _in_band(case, np.where(case.valid[b], case.motion[b], 0.0))
    simulated = _in_band(case, np.where(case.valid[b].any(axis=-1)[..., None], motion, 0.0))
    if not np.any(recorded) or not np.any(simulated):
        return motion
    if table.source_s is not None:
        taps = _source(recorded, simulated, case, table.source_s)
        return _filtered(motion, taps, _lags(case, table.source_s))
    return time_shifted(motion, _origin(recorded, simulated, case, table.trigger_s), case.dt)


def _in_band(case, motion):
    """Return motion within the band of the records."""
    low, high = case.band.low, case.band.high
    sections = signal.butter(3, (low, high), "bandpass", fs=1.0 / case.dt, output="sos")
    return signal.sosfiltfilt(sections, motion, axis=-1)


def _lags(case, length):
    """Return the lags of the taps of a filter in samples, (n,) int."""
    spacing = max(int(0.25 / (case.band.high * case.dt)), 1)
    number = int(np.ceil(length / (spacing * case.dt)))
    return spacing * np.arange(-number, number + 1)


def _moved(motion, lags):
    """Return motion late by each lag, (n_lags, ..., n_samples)."""
    n = motion.shape[-1]
    moved = np.zeros((len(lags), *motion.shape))
    for k, lag in enumerate(lags):
        if lag >= 0:
            moved[k, ..., lag:] = motion[..., : n - lag]
        else:
            moved[k, ..., :lag] = motion[..., -lag:]
    return moved


def _filtered(motion, taps, lags):
    """Return motion through a filter."""
    return np.tensordot(taps, _moved(motion, lags), 1)


def _source(recorded, simulated, case, length):
    """Return the taps of the filter from a simulated to the recorded source, (n_taps,)."""
    lags = _lags(case, length)
    energy = np.sum(recorded**2, axis=(1, 2))
    used = energy > 0.0
    moved = _moved(simulated[used], lags) / np.sqrt(energy[used])[:, None, None]
    wanted = recorded[used] / np.sqrt(energy[used])[:, None, None]
    products = np.einsum("irct,jrct->rij", moved, moved, optimize=True)
    gradient = np.einsum("irct,rct->ri", moved, wanted, optimize=True)
    prior = np.exp(-0.5 * (lags * case.dt / length) ** 2)
    scale = np.trace(products.sum(axis=0)) / len(lags)
    weights, taps = np.ones(int(used.sum())), np.zeros(len(lags))
    for _ in range(ROUNDS):
        normal = np.tensordot(weights, products, 1)
        taps = linalg.solve(normal + DAMPING * scale * np.diag(1.0 / prior**2), weights @ gradient)
        residual = 1.0 - 2.0 * gradient @ taps + np.einsum("i,rij,j->r", taps, products, taps)
        weights = _weights(residual)
    return taps


def _weights(residual):
    """Return the weights of receivers whose unexplained shares of energy are given."""
    level = max(float(np.median(residual)), 1e-6)
    return (1.0 + DOUBT) / (DOUBT + np.maximum(residual, 0.0) / level)


def _origin(recorded, simulated, case, sigma):
    """Return by how many s the shot was late: where records and simulation correlate best."""
    norms = np.sqrt(np.sum(recorded**2, axis=(1, 2)) * np.sum(simulated**2, axis=(1, 2)))
    used = norms > 0.0
    size = fft.next_fast_len(2 * recorded.shape[-1], real=True)
    cross = np.sum(
        np.conj(fft.rfft(simulated[used], size)) * fft.rfft(recorded[used], size), axis=1
    )
    cross = cross / norms[used, None]
    step = 1.0 / (STEPS_PER_PERIOD * case.band.high)
    shifts = step * np.arange(-int(FARTHEST * sigma / step), int(FARTHEST * sigma / step) + 1)
    turns = np.exp(2j * np.pi * np.multiply.outer(fft.rfftfreq(size, case.dt), shifts))
    correlation = 2.0 * np.real(cross @ turns) / size
    score = np.mean(correlation, axis=0) - 0.5 * DAMPING * (shifts / sigma) ** 2
    return float(shifts[np.argmax(score)])


def time_shifted(motion: np.ndarray, shift: float | np.ndarray, dt: float) -> np.ndarray:
    """Return motion (..., n_samples) late by shifts (...) in s; zero where nothing is known."""
    n = motion.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    turn = np.exp(-2j * np.pi * fft.rfftfreq(size, dt) * np.asarray(shift)[..., None])
    return fft.irfft(fft.rfft(motion, size) * turn, size)[..., :n]


def learned(case: Case, motion: np.ndarray, least: float) -> Case:
    """Return a case with gain, clock and model error of each receiver, as its shots show them.

    Parameters
    ----------
    case : Case
        Of trusted shots, with nothing to find in them. ``diagnosis.early_s`` of its project is the
        window about first arrivals that alone tells gains and clocks; without it whole records
        tell gains, and clocks are right.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Simulated, without gains of receivers.
    least : float
        Share of energy below which no model error is assumed to lie.

    Notes
    -----
    The model error of a receiver is the unexplained share of a shot whose gain the other shots
    gave, in the mean, and never less than that of the median receiver.
    """
    motion = np.where(np.any(case.valid, axis=-1, keepdims=True), motion, 0.0)
    recorded = _in_band(case, np.where(case.valid, case.motion, 0.0))
    simulated, early, clock = _in_band(case, motion), np.ones(1), None
    window = case.project.config.diagnosis.early_s
    if window is not None:
        early = _about_arrivals(motion, window, case.dt)
        clock = _clocks(case, recorded, simulated, early)
        simulated = time_shifted(simulated, clock[:, None], case.dt)
    exists, product, square = _products(early * recorded, early * simulated)
    gain = _ratio(product.sum(axis=0), square.sum(axis=0))
    usual = float(np.median(gain[exists.any(axis=0)]))
    gain = np.where(exists.any(axis=0), gain, usual)
    others = _ratio(product.sum(axis=0) - product, square.sum(axis=0) - square)
    others = np.where(exists.sum(axis=0) > 1, others, usual)
    exists, product, square = _products(recorded, simulated)
    residual = np.where(exists, 1.0 - 2.0 * others * product + others**2 * square, 0.0)
    share = residual.sum(axis=0) / np.maximum(exists.sum(axis=0), 1)
    middle = float(np.median(residual[exists]))
    return replace(case, gain=gain, clock=clock, share=np.maximum(share, max(middle, least)))


def _products(recorded, simulated):
    """Return which records exist, and records by motion and motion by motion over their energy."""
    energy = np.sum(recorded**2, axis=(2, 3))
    exists = energy > 0.0
    unit = np.where(exists, 1.0 / np.maximum(energy, 1e-300), 0.0)
    product = unit * np.sum(recorded * simulated, axis=(2, 3))
    return exists, product, unit * np.sum(simulated**2, axis=(2, 3))


def _about_arrivals(motion, window, dt):
    """Return the weights (n_blasts, n_receivers, 1, n_samples), 1 within s after first arrivals."""
    size = np.linalg.norm(motion, axis=2)
    first = np.argmax(size >= ONSET * size.max(axis=-1, keepdims=True), axis=-1)
    late = dt * (np.arange(size.shape[-1]) - first[..., None])
    return ((late >= window[0]) & (late < window[1]))[:, :, None].astype(float)


def _clocks(case, recorded, simulated, early):
    """Return by how many s each receiver is late (n_receivers,): where its shots correlate best.

    Whatever its polarity; zero without records.
    """
    step = 1.0 / (STEPS_PER_PERIOD * case.band.high)
    most = int(LATEST * STEPS_PER_PERIOD)
    shifts, scores = step * np.arange(-most, most + 1), []
    for shift in shifts:
        _, product, square = _products(
            early * recorded, early * time_shifted(simulated, shift, case.dt)
        )
        correlation = np.abs(_ratio(product, np.sqrt(square)).sum(axis=0))
        scores.append(correlation - 0.5 * DAMPING * (shift / shifts[-1]) ** 2)
    return shifts[np.argmax(scores, axis=0)]


def _ratio(top, bottom):
    """Return a ratio, 0 where nothing is divided by."""
    return np.divide(top, bottom, out=np.zeros_like(top), where=bottom > 0.0)


def explained(case: Case, motion: np.ndarray) -> np.ndarray:
    """Return the share of the energy of each record that a motion explains, within the band.

    Parameters
    ----------
    case : Case
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s

    Returns
    -------
    (n_blasts, n_receivers) float64
        Not a number where there is no record.
    """
    recorded = _in_band(case, np.where(case.valid, case.motion, 0.0))
    residual = recorded - _in_band(
        case, np.where(np.any(case.valid, axis=-1, keepdims=True), motion, 0.0)
    )
    energy = np.sum(recorded**2, axis=(2, 3))
    return np.where(
        energy > 0.0, 1.0 - np.sum(residual**2, axis=(2, 3)) / np.maximum(energy, 1e-300), np.nan
    )
