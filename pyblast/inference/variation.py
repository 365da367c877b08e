"""Variation from hole to hole: random smooth filters of each charge and of its paths."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, interpolate, linalg

from .error_model import ErrorModel, Level, Levels
from .nuisances import HOLES, Nuisances, moving_columns, octave
from .records import Band

COHERENT = 15.0  # m between charges, over which their paths vary together
ROUNDS = 3  # of linearisation
LOST = 1e-3  # of the energy of the columns of a blast that fewer columns leave out
WIDE = 3.0  # levels: a charge that is further off, as a misfire, stays as it was planned
FINE = 9  # levels around the most probable one
SMALL = (0.0, 0.01, 0.02, 0.04, 0.07, 0.1)  # levels where none is the most probable


@dataclass(frozen=True, eq=False)
class Charges:
    """Charges of a blast: the motion of each at its planned time, and where it lies.

    Parameters
    ----------
    motion : (n_charges, n_receivers, 3, n_samples) float64, m/s
        Of each, fired at zero.
    times : (n_charges,) float64, s
    places : (n_charges, 3) float64, m
    """

    motion: np.ndarray
    times: np.ndarray
    places: np.ndarray


@dataclass(frozen=True, eq=False)
class Filters:
    """Filters of the charges of a blast: log amplitudes of each, and of its path to a receiver.

    Parameters
    ----------
    own : (n_charges, 5) float64
    paths : (n_charges, n_receivers, 5) float64
    """

    own: np.ndarray
    paths: np.ndarray


def log_filters(band: Band, n: int, size: int) -> np.ndarray:
    """Return the logarithms of five smooth filters, (5, n_frequencies) complex128.

    Three cosines over log frequency in phase, two out of phase with half the amplitude. The log
    amplitude of a charge at a receiver, by filters of its own and of its path with unit normal
    factors, has a root mean square of one over the band.
    """
    x = np.pi * octave(n, size, band)
    first, second = 0.5 * np.cos(x), 0.5 * np.cos(2.0 * x)
    return np.array([1.0 + 0.0 * x, first, second, 1j * first, 1j * second]) / np.sqrt(2.5)


@dataclass(frozen=True, eq=False)
class Variation:
    """Variation from hole to hole around filters of all charges, at a level of one.

    Parameters
    ----------
    columns : Nuisances
        Of group ``holes``: what the filters of charges change at all receivers.
    paths : (n_blasts, n_receivers, 3 n_functions, 3 n_functions) float64, (m/s)2
        Covariance by the filters of paths.
    offset : (n_blasts, n_receivers, 3, n_functions) float64, m/s
        What the columns and paths make of the filters, negative: the mean error of `change`.
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What the filters change.
    charges : dict of int to (n_charges, n_receivers, 3, n_samples) float64, m/s
        Motion of each charge with its filters, fired at zero.
    to_own : dict of int to (n_columns of the blast, n_charges 5) float64
        Filters of charges by their columns.
    to_paths : dict of int to (n_receivers, n_charges 5, 3 n_functions) float64, m/s
        Changes by the filters of paths, of independent ones.
    """

    columns: Nuisances
    paths: np.ndarray
    offset: np.ndarray
    change: np.ndarray
    charges: dict[int, np.ndarray]
    to_own: dict[int, np.ndarray]
    to_paths: dict[int, np.ndarray]

    @property
    def energy(self) -> np.ndarray:
        """Expected energy of the change of each record, (n_blasts, n_receivers) (m/s)2."""
        own = np.sum(self.columns.columns**2, axis=(0, -2, -1))
        return own + np.trace(self.paths, axis1=-2, axis2=-1)


@dataclass(frozen=True)
class Varied:
    """Learned variation from hole to hole: rms of the log amplitude of a charge at a receiver.

    Parameters
    ----------
    value, low, high : float
        Posterior median, and its 90 % interval.
    """

    value: float
    low: float
    high: float

    @property
    def words(self) -> str:
        """The answer as a sentence without a full stop."""
        if self.low < SMALL[1]:
            return f"holes vary by less than {100.0 * self.high:.0f} %"
        ends = f"{100.0 * self.low:.0f} to {100.0 * self.high:.0f} %"
        return f"holes vary by about {100.0 * self.value:.0f} % ({ends})"


def variation(
    charges: Mapping[int, Charges], band: Band, shape, known: Mapping[int, Filters] | None = None
) -> Variation:
    """Linearise the variation from hole to hole around filters.

    Parameters
    ----------
    charges : mapping of int to Charges
        By number of the blast.
    band : Band
    shape : tuple of int
        Number of blasts, of receivers, 3, and of functions.
    known : mapping of int to Filters, optional
        Filters around which it is linearised, by blast; none by default.

    Notes
    -----
    theory.md (12.9).
    """
    n_blasts, n_receivers, _, n_functions = shape
    columns, to_own, to_paths = [], {}, {}
    paths = np.zeros((n_blasts, n_receivers, 3 * n_functions, 3 * n_functions))
    offset, varied = np.zeros(shape), {}
    change = np.zeros((*shape[:3], len(band.basis)))
    for b, own in charges.items():
        at = None if known is None else known[b]
        varied[b], change[b], changes = _changes(own, band.of_blast(b), at)
        flat = changes.reshape(-1, n_receivers, 3, n_functions)
        combined = _combinations(flat.reshape(len(flat), -1))
        for row in np.tensordot(combined, flat, 1):
            columns.append(np.zeros(shape))
            columns[-1][b] = row
        mixed = np.tensordot(_coherence(own.places), changes, ([0], [0]))  # to independent ones
        each = np.moveaxis(mixed, 2, 0).reshape(n_receivers, len(flat), 3 * n_functions)
        paths[b] = each.swapaxes(1, 2) @ each
        to_own[b], to_paths[b] = combined, each
        if at is not None:
            offset[b] = -np.einsum("hrk,hkrcf->rcf", at.own[:, None] + at.paths, changes)
    own_columns = moving_columns({HOLES: columns}, shape)
    return Variation(own_columns, paths, offset, change, varied, to_own, to_paths)


def _changes(charges, band, filters):
    """Return the motion of charges with filters, the change of all, and derivatives by factors.

    (n_charges, n_receivers, 3, n_samples), (n_receivers, 3, n_samples) and, in the band,
    (n_charges, 5, n_receivers, 3, n_functions).
    """
    n, dt = charges.motion.shape[-1], band.dt
    latest = int(np.max(charges.times) / dt) + 1
    size = fft.next_fast_len(n + max(n, latest), real=True)
    turns = -2j * np.pi * fft.rfftfreq(size, dt)
    kernels, varied, changed, out = log_filters(band, n, size), [], 0.0, []
    for h, motion in enumerate(charges.motion):
        spectrum, late = fft.rfft(motion, size), np.exp(turns * charges.times[h])
        if filters is not None:
            factor = np.exp((filters.own[h] + filters.paths[h]) @ kernels)[:, None]
            changed = changed + spectrum * (factor - 1.0) * late
            spectrum = spectrum * factor
            motion = fft.irfft(spectrum, size)[..., :n]
        varied.append(motion)
        part = fft.irfft(spectrum * late * kernels[:, None, None], size)[..., :n]
        out.append(band.project(part[:, None])[:, 0])
    total = 0.0 if filters is None else fft.irfft(changed, size)[..., :n]
    return np.array(varied), total, np.array(out)


def _combinations(rows):
    """Return orthonormal combinations (m, n) of rows (n, ...) that keep nearly all their energy."""
    energy, vectors = linalg.eigh(rows @ rows.T)
    left_out = np.cumsum(np.maximum(energy, 0.0)) <= LOST * np.sum(energy)
    return vectors[:, ~left_out].T


def _coherence(places):
    """Return the root (n, n) by which independent filters of paths become those of near ones."""
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    return linalg.cholesky(np.exp(-apart / COHERENT) + 1e-6 * np.eye(len(places)), lower=True)


def with_variation(error: ErrorModel, own: Variation, levels: tuple[float, ...]) -> ErrorModel:
    """Return an error with variation from hole to hole, at some levels."""
    return replace(
        error, blocks=replace(error.blocks, paths=own.paths), offset=own.offset,
        nuisances=error.nuisances + own.columns, levels=error.levels._replace(holes=levels),
    )  # fmt: skip


def learned_variation(
    build: Callable[[Variation], ErrorModel],
    charges: Mapping[int, Charges],
    band: Band,
    residual: np.ndarray,
    levels: tuple[float, ...],
) -> tuple[Variation, Varied, tuple[float, ...]]:
    """Learn how much holes vary, linearised anew around the most probable filters.

    Parameters
    ----------
    build : callable
        ``(variation) -> error`` of all that is known, what is fitted included, around the motion
        with what the filters send, without variation.
    charges : mapping of int to Charges
        By number of the blast.
    band : Band
    residual : (n_blasts, n_receivers, 3, n_functions) float64, m/s
        Records less prediction where everything has its prior mean.
    levels : tuple of float
        Root mean squares of the log amplitude of a charge at a receiver, zero first.

    Returns
    -------
    Variation
        Around the most probable filters.
    Varied
    tuple of float
        The levels up to one above the most probable: an effect leaves less to explain, not more.

    Notes
    -----
    theory.md (12.9).
    """
    own, at = variation(charges, band, residual.shape), None
    for _ in range(ROUNDS):
        whole, rest = with_variation(build(own), own, levels), residual - band.project(own.change)
        at, factors, weighted = _near(whole, at).most_probable(rest)
        if at.holes == 0.0:
            break
        known = _filters(own, charges, whole, at, factors, weighted)
        own = variation(charges, band, residual.shape, known)
    whole, rest = with_variation(build(own), own, levels), residual - band.project(own.change)
    at, *_ = _near(whole, at).most_probable(rest)
    above = [level for level in levels if level > at.holes][:1]
    remaining = (*(level for level in levels if level <= at.holes), *above)
    return own, _interval(whole, at, rest), remaining


def _near(error: ErrorModel, at: Level | None) -> ErrorModel:
    """Return an error with the levels next to those that were the most probable, if any were."""
    if at is None:
        return error
    near = [
        tuple(values[max(values.index(own) - 1, 0) : values.index(own) + 2])
        if own in values else values
        for values, own in zip(error.levels, at, strict=True)
    ]  # fmt: skip
    return replace(error, levels=Levels(*near))


def _filters(own, charges, whole, at, factors, weighted):
    """Return the most probable filters by blast, from factors of columns and what remains."""
    groups, filters = np.array(whole.nuisances.groups), {}
    mine, first = factors[groups == HOLES], 0
    for b, each in charges.items():
        n = len(own.to_own[b])
        of_charges = (mine[first : first + n] @ own.to_own[b]).reshape(-1, 5)
        first += n
        free = at.holes**2 * np.einsum("rkf,rf->rk", own.to_paths[b], weighted[b])
        free = free.reshape(len(free), -1, 5)
        of_paths = np.einsum("hg,rgk->hrk", _coherence(each.places), free)
        alike = np.abs(of_charges[:, :1]) < WIDE * at.holes
        filters[b] = Filters(alike * of_charges, alike[..., None] * of_paths)
    return filters


def _interval(whole: ErrorModel, at: Level, residual) -> Varied:
    """Return median and 90 % interval of the level, all others at their most probable values."""
    fine = at.holes * np.geomspace(0.5, 2.0, FINE) if at.holes else np.array(SMALL)
    levels = Levels(*((value,) for value in at))._replace(holes=tuple(fine.tolist()))
    by_level = replace(whole, levels=levels).scores(residual[None]).by_level
    evidence = np.array([float(each.evidence[0]) for each in by_level])
    value = np.linspace(fine[0], fine[-1], 2001)
    smooth = interpolate.PchipInterpolator(fine, evidence)(value)
    weight = np.cumsum(np.exp(smooth - smooth.max()))
    low, middle, high = np.interp([0.05, 0.5, 0.95], weight / weight[-1], value)
    return Varied(float(middle), float(low), float(high))
