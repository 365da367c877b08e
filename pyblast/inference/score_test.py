"""Score test: log Bayes factors of changes of motion under an error whose levels are averaged."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.special import log_ndtr, logsumexp

from .covariance import RecordBlocks
from .nuisances import Nuisances

TRANSFER = "transfer"  # the group whose level is learned beside that of scattered motion
TINY = 1e-12  # of the deviation of a change that nuisances can't explain


class ErrorLevels(NamedTuple):
    """Grid of levels over which likelihoods are averaged, those without an effect included.

    Parameters
    ----------
    scatter, transfer : tuple of float
        Shares of the energy of each channel: scattered motion, and a smooth transfer error of a
        receiver that all blasts share.
    nuisance : tuple of float
        Factors on the prior standard deviations of nuisance parameters.
    """

    scatter: tuple[float, ...] = (5e-3, 2e-2, 8e-2, 0.3, 1.0)
    transfer: tuple[float, ...] = (2e-3, 1e-2, 5e-2, 0.3)
    nuisance: tuple[float, ...] = (1.0, 2.0)


LEVELS = ErrorLevels()


class Change(NamedTuple):
    """Change of motion by an effect of a strength that has a normal prior.

    Parameters
    ----------
    shapes : (n, n_blasts, n_receivers, 3, n_functions) float64, m/s
        In the band: for each parameter, the change by one standard deviation of its strength.
    one_sided : bool
        Whether the strength is positive; for a single shape.
    """

    shapes: np.ndarray
    one_sided: bool = False


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of n_data residuals.

    Parameters
    ----------
    log_evidence : (n_data,) float64
        Without an effect, up to a constant of the records.
    log_bayes : (n_changes, n_data) float64
        Log Bayes factor of each change over none.
    strength : list of (n_shapes, n_data) float64
        Posterior mean of the strengths of each change, in standard deviations of their priors.
    length : list of (n_shapes, n_shapes) float64
        Information on the strengths of each change, at the most probable levels of the first
        residual; the square of d' for one shape.
    weight : (n_levels, n_data) float64
        Posterior probability of the levels.
    """

    log_evidence: np.ndarray
    log_bayes: np.ndarray
    strength: list[np.ndarray]
    length: list[np.ndarray]
    weight: np.ndarray


class _Level(NamedTuple):
    """One point of the grid: levels, log determinant, factor on each column, their products."""

    at: tuple[float, float, float]
    log_determinant: float
    scale: np.ndarray  # (n_columns,)
    cholesky: tuple


class AveragedError:
    """Error of records under levels that are averaged: noise, scattering and nuisance columns.

    Parameters
    ----------
    blocks : RecordBlocks
        Covariance of the errors of each record; of it, noise and scatter are used.
    nuisances : Nuisances
        Columns of one prior standard deviation; of group ``transfer`` at a level of one.
    levels : ErrorLevels

    Notes
    -----
    theory.md (14.10).
    """

    def __init__(self, blocks: RecordBlocks, nuisances: Nuisances, levels: ErrorLevels = LEVELS):
        self.blocks, self.shape = blocks, blocks.noise.shape[:3]
        columns = nuisances.columns.reshape(-1, *self.shape)
        transfer = np.array([group == TRANSFER for group in nuisances.groups], dtype=bool)
        self.white, self.grid = {}, []
        for scatter in levels.scatter:
            white, log_determinant = blocks.whiten(columns, scatter, 0.0, 0.0)
            self.white[scatter] = white = white.reshape(len(columns), -1)
            products = white @ white.T
            for share in levels.transfer if transfer.any() else (0.0,):
                for factor in levels.nuisance:
                    scale = np.where(transfer, np.sqrt(share), factor)
                    inner = products * np.outer(scale, scale) + np.eye(len(scale))
                    cholesky = linalg.cho_factor(inner, lower=True, check_finite=False)
                    grown = 2.0 * np.sum(np.log(np.diag(cholesky[0])))
                    at = scatter, share, factor
                    self.grid.append(_Level(at, log_determinant + grown, scale, cholesky))

    def whiten(self, rows, scatter: float) -> np.ndarray:
        """Return rows (n, ...) without the correlations of noise and scattering, (n, n_data)."""
        rows = np.asarray(rows).reshape(-1, *self.shape)
        return self.blocks.whiten(rows, scatter, 0.0, 0.0)[0].reshape(
            len(rows), math.prod(self.shape)
        )


class ScoreTest:
    """Score test of changes of motion; prepared once, applied to any residuals.

    Parameters
    ----------
    error : AveragedError
    changes : sequence of n_changes Change

    Notes
    -----
    theory.md (14.11).
    """

    def __init__(self, error: AveragedError, changes: Sequence[Change] = ()):
        self.error, self.changes = error, tuple(changes)
        shapes = [change.shapes.reshape(-1, *error.shape) for change in self.changes]
        self._ends = np.cumsum([0, *map(len, shapes)])
        shapes = np.concatenate([np.zeros((0, *error.shape)), *shapes])
        self._shapes = {scatter: error.whiten(shapes, scatter) for scatter in error.white}
        self._solved = []  # of each level: products with the columns, and information
        for level in error.grid:
            own = self._shapes[level.at[0]]
            across = (error.white[level.at[0]] @ own.T) * level.scale[:, None]
            solved = linalg.cho_solve(level.cholesky, across, check_finite=False)
            self._solved.append((solved, own @ own.T - across.T @ solved))

    def __call__(self, residuals) -> Scores:
        """Return the scores of residuals (n_data, n_blasts, n_receivers, 3, n_functions), m/s."""
        products = {}
        for scatter, columns in self.error.white.items():
            white = self.error.whiten(residuals, scatter)
            products[scatter] = (
                np.sum(white**2, axis=1), columns @ white.T, self._shapes[scatter] @ white.T,
            )  # fmt: skip
        evidence, bayes, means = [], [], []
        for level, (solved, information) in zip(self.error.grid, self._solved, strict=True):
            square, along, across = products[level.at[0]]
            along = along * level.scale[:, None]
            half = linalg.cho_solve(level.cholesky, along, check_finite=False)
            square = square - np.sum(along * half, axis=0)
            evidence.append(-0.5 * (square + level.log_determinant))
            each = self._of_changes(information, across - solved.T @ along)
            bayes.append([value for value, _ in each])
            means.append(np.concatenate([np.zeros((0, len(square))), *(m for _, m in each)]))
        return self._averaged(np.array(evidence), np.array(bayes), np.array(means))

    def _averaged(self, evidence, bayes, means):
        """Return scores averaged over the levels."""
        bayes = bayes.reshape(len(evidence), len(self.changes), evidence.shape[1])
        total = logsumexp(evidence, axis=0)
        weight = np.exp(evidence - total)
        with_change = logsumexp(evidence[:, None] + bayes, axis=0)
        own = np.exp(evidence[:, None] + bayes - with_change)
        pairs = list(zip(self._ends, self._ends[1:], strict=False))
        strength = [
            np.einsum("ln,lsn->sn", own[:, n], means[:, start:end])
            for n, (start, end) in enumerate(pairs)
        ]
        _, best = self._solved[int(np.argmax(weight[:, 0]))]
        length = [best[start:end, start:end] for start, end in pairs]
        return Scores(total - np.log(len(evidence)), with_change - total, strength, length, weight)

    def _of_changes(self, information, scores):
        """Return log Bayes factor and posterior mean of each change at a level."""
        return [
            _log_bayes(information[a:b, a:b], scores[a:b], change.one_sided)
            for change, a, b in zip(self.changes, self._ends, self._ends[1:], strict=False)
        ]


def draws(
    rng: np.random.Generator,
    blocks: RecordBlocks,
    nuisances: Nuisances,
    at: tuple[float, float, float],
    n: int,
) -> np.ndarray:
    """Draw residuals without an effect at levels (scatter, transfer, nuisance).

    Returns
    -------
    (n, n_blasts, n_receivers, 3, n_functions) float64, m/s
    """
    scatter, share, factor = at
    scale = np.array([np.sqrt(share) if g == TRANSFER else factor for g in nuisances.groups])
    moved = np.tensordot(rng.standard_normal((n, len(scale))) * scale, nuisances.columns, 1)
    return moved + blocks.draws(rng, n, scatter).reshape(moved.shape)


def _log_bayes(information, scores, one_sided):
    """Return the log Bayes factor (n,) of strengths with a unit normal prior, and their means."""
    inner = np.eye(len(information)) + information
    mean = np.linalg.solve(inner, scores)
    value = 0.5 * (np.sum(scores * mean, axis=0) - np.linalg.slogdet(inner)[1])
    if one_sided:
        deviation = np.sqrt(1.0 / inner[0, 0])
        value = value + np.log(2.0) + log_ndtr(mean[0] / deviation)
    return value, mean


def detected_strength(length: float, threshold: float, power: float = 1.2815515655446004) -> float:
    """Return the strength at which a change exceeds a threshold in nine of ten cases.

    Parameters
    ----------
    length : float
        Square of d', the information on its strength.
    threshold : float
        Log Bayes factor.
    power : float
        Standard normal quantile of the share of cases; 1.28 for nine of ten.

    Notes
    -----
    theory.md (14.12): the score is the strength times its length in the mean, with that variance.
    """
    if length < TINY:
        return np.inf
    wanted = threshold + 0.5 * np.log1p(length) - np.log(2.0)
    least = np.sqrt(2.0 * max(wanted, 0.0) * (1.0 + length))
    return float((least + power * np.sqrt(length)) / length)
