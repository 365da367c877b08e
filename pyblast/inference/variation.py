"""Variation from hole to hole: random smooth filters of each charge and of its paths."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import fft, interpolate, linalg
from scipy.special import logsumexp

from .error_model import ErrorModel, Level, Levels
from .nuisances import (
    HOLES,
    N_TRANSFER,
    Firings,
    Nuisances,
    hole_parts,
    moving_columns,
    octave,
)
from .records import Band

VARIED = 0.0, 0.1, 0.2, 0.4, 0.8  # levels of variation from hole to hole
FEWEST = 5  # holes of a blast that show how much they vary
COHERENT = 15.0  # m between charges, over which their paths vary together
ROUNDS = 3  # of linearisation
LOST = 1e-3  # of the energy of the columns of a blast that fewer columns leave out
WIDE = 3.0  # levels: a charge that is further off, as a misfire, stays as it was planned
DRAWS = 400  # of a further blast
ENDS = 0.05, 0.95  # of the bands of its peaks
FINE = 9  # levels around the most probable one
QUIET = 2e-4  # of scatter, that of sites without any: more would hide variation
APART = 1.4  # times the learned level: those of the grid that are nearer aren't asked beside it
TAKEN = 1.25  # of the upper end: nuisances take a part of large variation (docs/decisions.md)
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
    open : (5,) float64, or zero
        Variance of the sum of both that the records leave open: what varies sends more in the mean.
    """

    own: np.ndarray
    paths: np.ndarray
    open: np.ndarray | float = 0.0

    def log_factor(self, charge: int, kernels: np.ndarray) -> np.ndarray:
        """Return the log of the mean factor on what a charge sends, (n_receivers, n_frequencies).

        Of the kernels (5, n_frequencies) of `log_filters`; theory.md (12.9).
        """
        known = (self.own[charge] + self.paths[charge]) @ kernels
        return known + 0.5 * np.broadcast_to(self.open, len(kernels)) @ kernels**2


class Span(NamedTuple):
    """Span of frequencies: a band without its functions; Hz, and s between samples."""

    low: float
    high: float
    dt: float


def log_filters(band: Band | Span, n: int, size: int) -> np.ndarray:
    """Return the logarithms of five smooth filters, (5, n_frequencies) complex128.

    Three cosines over log frequency in phase, two out of phase with half the amplitude. The log
    amplitude of a charge at a receiver, by filters of its own and of its path with unit normal
    factors, has a root mean square of one over the band.
    """
    x = np.pi * octave(n, size, band)
    first, second = 0.5 * np.cos(x), 0.5 * np.cos(2.0 * x)
    return np.array([1.0 + 0.0 * x, first, second, 1j * first, 1j * second]) / np.sqrt(2.5)


class FilteredMotion(NamedTuple):
    """Motion that charges send with filters.

    Parameters
    ----------
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s, or zero
        What the filters change.
    charges : dict of int to (n_charges, n_receivers, 3, n_samples) float64, m/s
        Motion of each charge with its filters, fired at zero, by blast.
    """

    change: np.ndarray | float
    charges: dict[int, np.ndarray]


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
        What the columns and paths make of the filters, negative: the mean error beside these.
    to_own : dict of int to (n_columns of the blast, n_charges 5) float64
        Filters of charges by their columns.
    to_paths : dict of int to (n_receivers, n_charges 5, 3 n_functions) float64, m/s
        Changes by the filters of paths, of independent ones.
    """

    columns: Nuisances
    paths: np.ndarray
    offset: np.ndarray
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
        Posterior median, and its 90 % interval, with what nuisances may have taken.
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


def no_filters(charges: Mapping[int, Charges]) -> dict[int, Filters]:
    """Return filters by which all charges send what was planned."""
    shapes = {b: own.motion.shape[:2] for b, own in charges.items()}
    return {b: Filters(np.zeros((h, 5)), np.zeros((h, r, 5))) for b, (h, r) in shapes.items()}


def filtered_motion(
    charges: Mapping[int, Charges], band: Band, n_blasts: int, filters
) -> FilteredMotion:
    """Return what charges send with filters, both by number of the blast."""
    changed, varied = 0.0, {}
    for b, own in charges.items():
        n, total = own.motion.shape[-1], 0.0
        size, turns = _transform(own, band)
        kernels, varied[b] = log_filters(band.of_blast(b), n, size), np.empty_like(own.motion)
        for h, motion in enumerate(own.motion):
            spectrum = fft.rfft(motion, size)
            factor = np.exp(filters[b].log_factor(h, kernels))[:, None]
            total = total + spectrum * (factor - 1.0) * np.exp(turns * own.times[h])
            varied[b][h] = fft.irfft(spectrum * factor, size)[..., :n]
        changed = np.zeros((n_blasts, *own.motion.shape[1:])) + changed
        changed[b] = fft.irfft(total, size)[..., :n]
    return FilteredMotion(changed, varied)


def _transform(charges, band):
    """Return length of transforms of the charges of a blast, and derivatives of their phase."""
    n = charges.motion.shape[-1]
    size = fft.next_fast_len(n + max(n, int(np.max(charges.times) / band.dt) + 1), real=True)
    return size, -2j * np.pi * fft.rfftfreq(size, band.dt)


def variation(
    charges: Mapping[int, Charges], band: Band, shape, filters: Mapping[int, Filters]
) -> Variation:
    """Linearise the variation from hole to hole around filters.

    Parameters
    ----------
    charges : mapping of int to Charges
        By number of the blast.
    band : Band
    shape : tuple of int
        Number of blasts, of receivers, 3, and of functions.
    filters : mapping of int to Filters
        By blast.

    Notes
    -----
    theory.md (12.9).
    """
    n_blasts, n_receivers, _, n_functions = shape
    columns, to_own, to_paths = [], {}, {}
    paths = np.zeros((n_blasts, n_receivers, 3 * n_functions, 3 * n_functions))
    offset = np.zeros(shape)
    for b, own in charges.items():
        at = filters[b]
        changes = _changes(own, band.of_blast(b), at)
        flat = changes.reshape(-1, n_receivers, 3, n_functions)
        combined = _combinations(flat.reshape(len(flat), -1))
        for row in np.tensordot(combined, flat, 1):
            columns.append(np.zeros(shape))
            columns[-1][b] = row
        mixed = np.tensordot(_coherence(own.places), changes, ([0], [0]))  # to independent ones
        each = np.moveaxis(mixed, 2, 0).reshape(n_receivers, len(flat), 3 * n_functions)
        paths[b] = each.swapaxes(1, 2) @ each
        to_own[b], to_paths[b] = combined, each
        offset[b] = -np.einsum("hrk,hkrcf->rcf", at.own[:, None] + at.paths, changes)
    return Variation(moving_columns({HOLES: columns}, shape), paths, offset, to_own, to_paths)


def _changes(charges, band, filters):
    """Return derivatives by filters, (n_charges, 5, n_receivers, 3, n_functions), in the band."""
    n, out = charges.motion.shape[-1], []
    size, turns = _transform(charges, band)
    kernels = log_filters(band, n, size)
    for h, motion in enumerate(charges.motion):
        factor = np.exp(filters.log_factor(h, kernels) + turns * charges.times[h])
        spectrum = fft.rfft(motion, size) * factor[:, None]
        part = fft.irfft(spectrum * kernels[:, None, None], size)[..., :n]
        out.append(band.project(part[:, None])[:, 0])
    return np.array(out)


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
    """Return an error with variation from hole to hole, at some levels, in place of any other."""
    return replace(
        error, blocks=replace(error.blocks, paths=own.paths), offset=own.offset,
        nuisances=error.nuisances.without(HOLES) + own.columns,
        levels=error.levels._replace(holes=levels),
    )  # fmt: skip


class Learned(NamedTuple):
    """Learned variation from hole to hole.

    Parameters
    ----------
    filters : dict of int to Filters
        Most probable ones, by blast.
    around : Variation
    filtered : FilteredMotion
        With these filters.
    level : Varied
    levels : tuple of float
        The learned one, those below, and one above: an effect leaves less to explain, not more.
    """

    filters: dict[int, Filters]
    around: Variation
    filtered: FilteredMotion
    level: Varied
    levels: tuple[float, ...]


def learned_variation(
    build: Callable[[FilteredMotion], ErrorModel],
    charges: Mapping[int, Charges],
    band: Band,
    residual: np.ndarray,
    levels: tuple[float, ...],
) -> Learned:
    """Learn how much holes vary, linearised anew around the most probable filters.

    Parameters
    ----------
    build : callable
        ``(filtered) -> error`` of all that is known, what is fitted included, around the motion
        with what the filters send, without variation.
    charges : mapping of int to Charges
        By number of the blast.
    band : Band
    residual : (n_blasts, n_receivers, 3, n_functions) float64, m/s
        Records less prediction where everything has its prior mean.
    levels : tuple of float
        Root mean squares of the log amplitude of a charge at a receiver, zero first.

    Notes
    -----
    theory.md (12.9).
    """

    def at_filters():
        own = variation(charges, band, residual.shape, filters)
        with_filters = filtered_motion(charges, band, len(residual), filters)
        whole = with_variation(build(with_filters), own, levels)
        quiet = whole.levels._replace(scatter=(QUIET, *whole.levels.scatter))
        whole = replace(whole, levels=quiet)
        return own, with_filters, whole, residual - band.project(with_filters.change)

    filters, at, level = no_filters(charges), None, Varied(0.0, 0.0, 0.0)
    for last in (*ROUNDS * (False,), True):
        own, with_filters, whole, rest = at_filters()
        at, *known = _near(whole, at).most_probable(rest)
        level = _interval(whole, at, rest, _near(whole, at).levels.scatter if last else ())
        if at.holes == 0.0 or last:
            break
        whole = replace(whole, levels=Levels(*((x,) for x in at._replace(holes=level.value))))
        at_level, *known = whole.most_probable(rest)
        filters = filters_of(own, charges, whole, at_level, *known)
    return Learned(filters, own, with_filters, level, _asked(levels, at, level))


def _asked(levels, at, learned):
    """Return the levels that are asked beside effects."""
    if at.holes == 0.0:
        return levels[:2]
    below = [level for level in levels if level * APART < learned.value]
    above = [level for level in levels if level > learned.value * APART][:1]
    return (*below, learned.value, *above)


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


def filters_of(
    own: Variation, charges: Mapping[int, Charges], whole: ErrorModel, at: Level, factors, weighted
) -> dict[int, Filters]:
    """Return the most probable filters by blast.

    Parameters
    ----------
    own : Variation
    charges : mapping of int to Charges
    whole : ErrorModel
        With this variation.
    at, factors, weighted
        As `ErrorModel.most_probable` returns them.
    """
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
        known = np.mean(of_charges**2, axis=0) + np.mean(of_paths**2, axis=(0, 1))
        beyond = np.maximum(2.0 * at.holes**2 - known, 0.0)
        filters[b] = Filters(alike * of_charges, alike[..., None] * of_paths, beyond)
    return filters


def _interval(whole: ErrorModel, at: Level, residual, scatter: tuple[float, ...] = ()) -> Varied:
    """Return median and 90 % interval of the level, averaged over some levels of scatter.

    All others, and scatter where none is given, are at their most probable values.
    """
    fine = at.holes * np.geomspace(0.5, 2.0, FINE) if at.holes else np.array(SMALL)
    levels = Levels(*((x,) for x in at))._replace(holes=tuple(fine.tolist()))
    levels = levels._replace(scatter=scatter or levels.scatter)
    known = replace(whole, levels=levels).log_evidences(residual)
    evidence = [logsumexp([value for each, value in known if each.holes == x]) for x in fine]
    value = np.linspace(fine[0], fine[-1], 2001)
    smooth = interpolate.PchipInterpolator(fine, evidence)(value)
    weight = np.cumsum(np.exp(smooth - smooth.max()))
    low, middle, high = np.interp([0.05, 0.5, 0.95], weight / weight[-1], value)
    return Varied(float(middle), float(low), float(high) * (TAKEN if at.holes else 1.0))


def charges_of(motion: np.ndarray, fired: Firings, places: np.ndarray, dt: float) -> Charges:
    """Return the charges of a blast by its motion alone: holes that share a path but its length.

    Parameters
    ----------
    motion : (n_receivers, 3, n_samples) float64, m/s
    fired : Firings
    places : (n_charges, 3) float64, m
    dt : float, s

    Notes
    -----
    theory.md (12.6).
    """
    n = motion.shape[-1]
    size = fft.next_fast_len(3 * n, real=True)
    omega = 2.0 * np.pi * fft.rfftfreq(size, dt)
    own = np.array([
        fft.irfft(part * np.exp(1j * omega * start), size)[..., :n]
        for start, part in hole_parts(motion, fired, omega, size)
    ])  # fmt: skip
    return Charges(own, fired.times, places)


DrawnFactor = Callable[[np.random.Generator, np.ndarray], np.ndarray]


class Scatter(NamedTuple):
    """Scatter of a further blast around its plan.

    Parameters
    ----------
    holes : float
        Root mean square of the log amplitude of a charge at a receiver.
    firing : float, s
        Standard deviation of each time.
    amplitude : float
        Standard deviation of the log amplitude of the blast.
    transfer : float
        Share of the energy of each channel that smooth errors of the prediction take.
    """

    holes: float
    firing: float
    amplitude: float = 0.0
    transfer: float = 0.0


def peaks_with_and_without(
    charges: Charges, band: Band | Span, scatter: Scatter, learned: DrawnFactor | None = None
) -> np.ndarray:
    """Draw the peaks of a further blast whose holes vary, and as if they were alike.

    Parameters
    ----------
    charges, band, scatter, learned
        As of `peaks_of_drawn_blasts`.

    Returns
    -------
    (2, n_draws, n_receivers, 3) float64, m/s
    """
    both = scatter, scatter._replace(holes=0.0)
    return np.array([
        peaks_of_drawn_blasts(charges, band, each, learned=learned) for each in both
    ])  # fmt: skip


def peaks_of_drawn_blasts(
    charges: Charges,
    band: Band | Span,
    scatter: Scatter,
    n_draws: int = DRAWS,
    seed: int = 1,
    learned: DrawnFactor | None = None,
) -> np.ndarray:
    """Draw the peaks of a further blast, whose holes vary around what was planned.

    Parameters
    ----------
    charges : Charges
    band : Band or Span
        In which filters vary; beyond, they are those of its ends.
    scatter : Scatter
    n_draws, seed : int, optional
    learned : callable, optional
        ``(rng, omega) -> (n_charges, n_receivers or 1, n_omega)``: draws the factor by which the
        spectra of charges differ from the motion given, omega in rad/s.

    Returns
    -------
    (n_draws, n_receivers, 3) float64, m/s
        Largest absolute velocity of each component.

    Notes
    -----
    theory.md (12.9).
    """
    rng, motion = np.random.default_rng(seed), charges.motion
    n_charges, n_receivers, _, n = motion.shape
    size, turns = _transform(charges, band)
    kernels, root = log_filters(band, n, size), _coherence(charges.places)
    waves = np.cos(np.pi * np.multiply.outer(np.arange(N_TRANSFER), octave(n, size, band)))
    waves[1:] *= np.sqrt(2.0)
    waves = np.concatenate([waves, 1j * waves]) / np.sqrt(2.0 * N_TRANSFER)
    sent_by_each, omega = fft.rfft(motion, size), -turns.imag
    peaks = np.empty((n_draws, n_receivers, 3))
    for peak in peaks:
        own = rng.standard_normal((n_charges, 1, 5))
        paths = np.tensordot(root, rng.standard_normal((n_charges, n_receivers, 5)), 1)
        late = charges.times + scatter.firing * rng.standard_normal(n_charges)
        log = scatter.holes * ((own + paths) @ kernels) + (turns * late[:, None])[:, None]
        factor = np.exp(log) if learned is None else np.exp(log) * learned(rng, omega)
        total = np.einsum("hrcf,hrf->rcf", sent_by_each, factor)
        error = rng.standard_normal((n_receivers, 3, len(waves))) @ waves
        total *= np.exp(np.sqrt(scatter.transfer) * error + scatter.amplitude * rng.normal())
        peak[:] = np.abs(fft.irfft(total, size)[..., :n]).max(axis=-1)
    return peaks
