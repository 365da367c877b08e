"""Error model of predicted records: posterior of properties, scores of changes, draws."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize
from scipy.special import log_ndtr, logsumexp

from .covariance import RecordBlocks, applied
from .nuisances import GROUND, HOLES, TRANSFER, Nuisances

NORMAL_95 = 1.6448536269514722  # quantile
TINY = 1e-12  # of the information on a change that nuisances explain
DETECTED = 0.9  # share of cases in which a change at its detection limit is found
STRONGEST = 1e4  # times the strength that is detected where the level of the error is known


class Level(NamedTuple):
    """Level of model error.

    Parameters
    ----------
    scatter, coda, transfer : float
        Shares of the energy of each channel: scattered motion, scattering that dies out slowly,
        and a smooth transfer error that all blasts share.
    ground, nuisance : float
        Factors on the prior standard deviations of columns of ground, and of all others and these.
    holes : float
        Variation from hole to hole: root mean square of the log amplitude of a charge at a
        receiver.
    """

    scatter: float
    coda: float = 0.0
    transfer: float = 0.0
    ground: float = 1.0
    nuisance: float = 1.0
    holes: float = 0.0

    def scale(self, groups: Sequence[str]) -> np.ndarray:
        """Return the factor on the columns of groups, (n_columns,)."""
        own = {TRANSFER: np.sqrt(self.transfer), GROUND: self.ground * self.nuisance,
               HOLES: self.holes}  # fmt: skip
        return np.array([own.get(group, self.nuisance) for group in groups])


class Levels(NamedTuple):
    """Grid of levels of model error, all with one prior weight; see `Level`."""

    scatter: tuple[float, ...]
    coda: tuple[float, ...] = (0.0,)
    transfer: tuple[float, ...] = (0.0,)
    ground: tuple[float, ...] = (1.0,)
    nuisance: tuple[float, ...] = (1.0,)
    holes: tuple[float, ...] = (0.0,)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of properties under levels of model error that are averaged.

    Parameters
    ----------
    mean : (n,) float64
    covariance : (n, n) float64
        The spread of the mean over the levels is included.
    prior : (n,) float64
        Standard deviations around zero.
    level : float
        Learned model error: share of the energy that scatter, coda and transfer error take
        together.
    log_evidence : float
        Averaged over the levels, up to a constant of the records.
    nuisances : dict of str to float
        Root mean square of the most probable nuisances of each group, in prior deviations.
    remaining : (n_blasts, n_receivers) float64
        Share of the energy of each record, above its noise, that remains with all properties and
        nuisances where they are most probable.
    evidences : (n_levels, 2) float64
        Learned model error, as ``level``, and log evidence at each level.
    """

    mean: np.ndarray
    covariance: np.ndarray
    prior: np.ndarray
    level: float
    log_evidence: float
    nuisances: dict[str, float]
    remaining: np.ndarray
    evidences: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Posterior standard deviations, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def pulls(self) -> np.ndarray:
        """Means in prior standard deviations, (n,)."""
        return np.divide(self.mean, self.prior, out=np.zeros_like(self.mean), where=self.prior > 0)

    def shares_of_variance(self, sought, held) -> np.ndarray:
        """Return the share of each variance that would vanish if a held property were known.

        Parameters
        ----------
        sought, held : sequence of int

        Returns
        -------
        (n_sought, n_held) float64
            Squared posterior correlations; theory.md (12.7).
        """
        variance = np.maximum(np.diag(self.covariance), np.finfo(float).tiny)
        part = self.covariance[np.ix_(sought, held)]
        return part**2 / np.outer(variance[list(sought)], variance[list(held)])

    def shifts_if_held(self, sought, held) -> np.ndarray:
        """Return how far values move if a held property is wrong by its prior deviation.

        It is then taken for known, as all others held are.

        Returns
        -------
        (n_sought, n_held) float64
            Theory.md (12.8).
        """
        used = np.flatnonzero(self.prior > 0.0)
        precision = np.zeros_like(self.covariance)
        precision[np.ix_(used, used)] = linalg.inv(self.covariance[np.ix_(used, used)])
        inner, outer = precision[np.ix_(sought, sought)], precision[np.ix_(sought, held)]
        return -linalg.solve(inner, outer, assume_a="pos") * self.prior[held]


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


class ByLevel(NamedTuple):
    """Scores of n_data residuals and n_changes changes at one level of model error.

    Parameters
    ----------
    evidence : (n_data,) float64
        Log evidence without an effect.
    information : list of (n_shapes, n_shapes) float64
        On the strengths of each change.
    along : list of (n_shapes, n_data) float64
        What each residual has of the shapes of each change, by the inverse covariance.
    """

    evidence: np.ndarray
    information: list[np.ndarray]
    along: list[np.ndarray]


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
        Information on the strengths of each change, at the most probable level of the first
        residual; the square of d' for one shape.
    at : Level
        The most probable one of the first residual.
    one_sided : list of bool
        Whether the strength of each change is positive.
    by_level : list of ByLevel
    """

    log_evidence: np.ndarray
    log_bayes: np.ndarray
    strength: list[np.ndarray]
    length: list[np.ndarray]
    at: Level
    one_sided: list[bool]
    by_level: list[ByLevel]

    def detected_strength(self, change: int, threshold: float, shape: int = 0) -> float:
        """Return the strength at which a change exceeds a threshold in nine of ten residuals.

        Parameters
        ----------
        change, shape : int
            Number of the change, and of the one of its shapes that is added to all residuals.
        threshold : float
            Log Bayes factor.

        Returns
        -------
        float
            In standard deviations of the prior; infinite where no strength does.

        Notes
        -----
        Theory.md (14.12). Levels are averaged: what a change leaves unexplained without it is
        taken for a higher level of the error, so that more is needed than at the known level.
        """
        length = float(self.length[change][shape, shape])
        if length < TINY:
            return np.inf
        evidence, bayes, beyond = self._in_strength(change, shape)

        def excess(strength):
            powers = np.array([1.0, strength, strength**2])
            without, gain = np.tensordot(powers, evidence, 1), np.tensordot(powers, bayes, 1)
            if self.one_sided[change]:
                gain += np.log(2.0) + log_ndtr(np.tensordot(powers[:2], beyond, 1))
            score = logsumexp(without + gain, axis=0) - logsumexp(without, axis=0)
            return float(np.quantile(score, 1.0 - DETECTED)) - threshold

        first = high = np.sqrt(2.0 * max(threshold, 1.0) / length)
        while excess(high) < 0.0:
            high *= 2.0
            if high > STRONGEST * first:
                return np.inf
        return float(optimize.brentq(excess, 0.0, high, rtol=1e-3))

    def _in_strength(self, change, shape):
        """Return polynomials in a strength that is added, (n_powers, n_levels, n_data).

        Of the log evidence without the change, of its log Bayes factor, and of its strength over
        the deviation of that.
        """
        evidence, bayes, beyond = [], [], []
        for each in self.by_level:
            information, along = each.information[change], each.along[change]
            inner, added = np.eye(len(information)) + information, information[:, shape]
            mean, moved = np.linalg.solve(inner, along), np.linalg.solve(inner, added)
            same = np.ones(along.shape[1])
            evidence.append([each.evidence, -along[shape], -0.5 * added[shape] * same])
            still = 0.5 * (np.sum(along * mean, axis=0) - np.linalg.slogdet(inner)[1])
            bayes.append([still, added @ mean, 0.5 * (added @ moved) * same])
            root = np.sqrt(inner[0, 0])
            beyond.append([root * mean[0], root * moved[0] * same])
        return (np.swapaxes(rows, 0, 1) for rows in (evidence, bayes, beyond))


class _Whitened(NamedTuple):
    """Columns at a level of the errors of each record, which need no elimination.

    ``shares`` are those of scatter and coda, and the level of holes. ``roots`` (n_blasts,
    n_receivers, m, m) whiten records; ``log_determinant`` is that of their
    covariance, each (n_blasts, n_receivers); ``columns`` (n_columns, n_blasts, n_receivers, m) are
    whitened, and ``products`` (n_columns, n_columns) those of all records.
    """

    shares: tuple[float, ...]
    roots: np.ndarray
    log_determinant: np.ndarray
    columns: np.ndarray
    products: np.ndarray


class _Factored(NamedTuple):
    """Columns at a level: their scale, and the Cholesky factor with their priors."""

    at: Level
    scale: np.ndarray
    root: np.ndarray
    log_determinant: float


class _Eliminated(NamedTuple):
    """Products of rows at a level whose columns are eliminated.

    ``products`` (n_rows, n_rows) are those by the inverse of the whole covariance,
    ``log_determinant`` is that of the latter. ``root`` (n_columns, n_columns) is the Cholesky
    factor of the columns with their priors, ``across`` (n_columns, n_rows) the products of columns
    and rows after its inverse.
    """

    at: Level
    log_determinant: float
    products: np.ndarray
    root: np.ndarray
    across: np.ndarray


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Error of a prediction: Gaussian records, nuisance columns, levels that are averaged.

    Parameters
    ----------
    blocks : RecordBlocks
        Covariance of the errors of each record, by levels.
    nuisances : Nuisances
        Columns of one prior standard deviation each; of group ``transfer`` at a level of one.
    levels : Levels
    offset : (n_blasts, n_receivers, 3, n_functions) float64, m/s, optional
        Mean error: change of motion around which columns are linear, less their own part.
    whole : ErrorModel, optional
        That of all records, of which this one leaves some out; see `without`.
    out : (n_blasts, n_receivers) bool, optional
        Those records.

    Notes
    -----
    ``C = N + f S + q K + p T T^T + k^2 J J^T``: theory.md (12.5), (14.10). Everything is linear:
    what is asked for is a row, and one elimination of the columns at each level answers for all.
    """

    blocks: RecordBlocks
    nuisances: Nuisances
    levels: Levels
    offset: np.ndarray | float = 0.0
    whole: "ErrorModel | None" = None
    out: np.ndarray | None = None

    def without(self, out: np.ndarray) -> "ErrorModel":
        """Return the error of the records but some, (n_blasts, n_receivers) bool."""
        return replace(self, whole=self, out=np.asarray(out, dtype=bool))

    def posterior(self, residual: np.ndarray, slopes: np.ndarray, prior: np.ndarray) -> Posterior:
        """Return the posterior of properties on which motion depends linearly.

        Parameters
        ----------
        residual : (n_blasts, n_receivers, 3, n_functions) float64
            Records less prediction where all properties have their prior mean.
        slopes : (n, n_blasts, n_receivers, 3, n_functions) float64
            Derivatives by the properties.
        prior : (n,) float64
            Standard deviations of the properties; zero where one is known.

        Notes
        -----
        theory.md (12.5): the levels of the errors have equal prior weights on a grid, and
        posterior means and covariances are averaged by their evidence.
        """
        n, own = len(prior), slopes * prior[:, None, None, None, None]
        residual, results = residual - self.offset, []
        for part in self._eliminated(np.concatenate([own, residual[None]])):
            information, along = part.products[:n, :n], part.products[:n, n:]
            (gain,), mean = _log_bayes(information, along)
            evidence = gain - 0.5 * (part.products[n, n] + part.log_determinant)
            nuisances = linalg.solve_triangular(
                part.root, part.across[:, n] - part.across[:, :n] @ mean[:, 0], lower=True, trans=1,
                check_finite=False,
            )  # fmt: skip
            each = np.linalg.inv(np.eye(n) + information)
            results.append((evidence, mean[:, 0], each, nuisances, part.at))
        evidences, means, covariances, nuisances, at = zip(*results, strict=True)
        weight = np.exp(np.array(evidences) - logsumexp(evidences))
        best = int(np.argmax(weight))
        mean = weight @ np.array(means)
        spread = np.array(means) - mean
        covariance = np.tensordot(weight, covariances, 1)
        covariance = covariance + np.einsum("l,li,lj->ij", weight, spread, spread)
        groups = self.nuisances.groups
        scale = at[best]._replace(transfer=0.0).scale(groups)  # which is no nuisance but an error
        moved = np.tensordot(nuisances[best] * scale, self.nuisances.columns, 1)
        shares = [np.sum(level[:3]) for level in at]
        return Posterior(
            mean * prior, covariance * np.outer(prior, prior), prior,
            float(np.exp(weight @ np.log(shares))),
            float(logsumexp(evidences) - np.log(len(evidences))),
            _root_mean_squares(nuisances[best], groups),
            self.blocks.above_noise(residual - moved - np.tensordot(means[best], own, 1)),
            np.stack([shares, evidences], axis=-1),
        )  # fmt: skip

    def scores(self, residuals: np.ndarray, changes: Sequence[Change] = ()) -> Scores:
        """Return the scores of changes of motion; theory.md (14.11).

        Parameters
        ----------
        residuals : (n_data, n_blasts, n_receivers, 3, n_functions) float64, m/s
        changes : sequence of n_changes Change
        """
        rows = np.concatenate([*(change.shapes for change in changes), residuals - self.offset])
        ends = np.cumsum([0, *(len(change.shapes) for change in changes)])
        pairs, n = list(pairwise(ends)), ends[-1]
        bayes, means, by_level, at = [], [], [], []
        for part in self._eliminated(rows):
            square = np.diag(part.products)[n:]
            level = ByLevel(
                -0.5 * (square + part.log_determinant),
                [part.products[a:b, a:b] for a, b in pairs],
                [part.products[a:b, n:] for a, b in pairs],
            )
            each = [
                _log_bayes(information, along, change.one_sided)
                for change, information, along in zip(changes, *level[1:], strict=True)
            ]
            bayes.append([value for value, _ in each])
            means.append([mean for _, mean in each])
            by_level.append(level)
            at.append(part.at)
        evidence = np.array([level.evidence for level in by_level])
        bayes = np.array(bayes).reshape(len(at), len(changes), len(residuals))
        total = logsumexp(evidence, axis=0)
        joint = evidence[:, None] + bayes
        with_change = logsumexp(joint, axis=0)
        weight = np.exp(joint - with_change)
        strength = [
            np.einsum("ln,lsn->sn", weight[:, k], [own[k] for own in means])
            for k in range(len(changes))
        ]
        best = int(np.argmax(evidence[:, 0]))
        return Scores(
            total - np.log(len(at)), with_change - total, strength, by_level[best].information,
            at[best], [change.one_sided for change in changes], by_level,
        )  # fmt: skip

    def draws(self, rng: np.random.Generator, n: int, at: Level) -> np.ndarray:
        """Draw residuals without an effect at a level.

        Returns
        -------
        (n, n_blasts, n_receivers, 3, n_functions) float64, m/s
        """
        scale = at.scale(self.nuisances.groups)
        moved = np.tensordot(
            rng.standard_normal((n, len(scale))) * scale, self.nuisances.columns, 1
        )
        own = self.blocks.draws(rng, n, at.scatter, at.coda, at.holes)
        return self.offset + moved + own.reshape(moved.shape)

    def log_evidences(self, residual: np.ndarray) -> list[tuple[Level, float]]:
        """Return the log evidence of a residual (n_blasts, n_receivers, 3, n_functions) by level.

        Up to a constant of the records.
        """
        return [
            (each.at, -0.5 * (float(each.products[0, 0]) + each.log_determinant))
            for each in self._eliminated((residual - self.offset)[None])
        ]

    def most_probable(self, residual: np.ndarray) -> tuple[Level, np.ndarray, np.ndarray]:
        """Return the most probable level, the factors of all columns, and what remains.

        Parameters
        ----------
        residual : (n_blasts, n_receivers, 3, n_functions) float64, m/s

        Returns
        -------
        Level
        (n_columns,) float64
            Most probable there.
        (n_blasts, n_receivers, 3 n_functions) float64, s/m
            Records less these columns, by the inverse covariance of their errors.
        """
        row = (residual - self.offset)[None]
        best = max(
            self._eliminated(row), key=lambda each: -each.products[0, 0] - each.log_determinant
        )
        factors = best.at.scale(self.nuisances.groups) * linalg.solve_triangular(
            best.root, best.across[:, 0], lower=True, trans=1, check_finite=False
        )
        rest = (row[0] - np.tensordot(factors, self.nuisances.columns, 1)).reshape(
            self.blocks.noise.shape[:3]
        )
        roots, _ = self.blocks.roots(best.at.scatter, best.at.coda, best.at.holes)
        return best.at, factors, applied(roots.swapaxes(-1, -2), applied(roots, rest))

    @cached_property
    def _whitened(self) -> list[_Whitened]:
        """The whitened columns at each level of the errors of a record."""
        if self.whole is not None:
            return [self._left(each) for each in self.whole._whitened]
        shape, parts = self.blocks.noise.shape[:3], []
        columns = self.nuisances.columns.reshape(-1, *shape)
        for shares in product(self.levels.scatter, self.levels.coda, self.levels.holes):
            roots, log_determinant = self.blocks.roots(*shares)
            white = applied(roots, columns)
            flat = _flat(white)
            parts.append(_Whitened(shares, roots, log_determinant, white, flat @ flat.T))
        return parts

    def _left(self, each):
        """Return whitened columns without the records that are left out."""
        away = _flat(each.columns[:, self.out])
        known = np.where(self.out, 0.0, each.log_determinant)
        return each._replace(log_determinant=known, products=each.products - away @ away.T)

    @cached_property
    def _factored(self) -> list[list[_Factored]]:
        """The factored columns at each level, by level of the errors of a record."""
        groups = self.nuisances.groups
        factors = list(product(
            self.levels.transfer if TRANSFER in groups else (0.0,),
            self.levels.ground if GROUND in groups else (1.0,),
            self.levels.nuisance,
        ))  # fmt: skip
        parts = []
        for white in self._whitened:
            parts.append([])
            for each in factors:
                scatter, coda, holes = white.shares
                at = Level(scatter, coda, *each, holes=holes)
                scale = at.scale(groups)
                inner = white.products * np.outer(scale, scale) + np.eye(len(scale))
                root = linalg.cholesky(inner, lower=True, check_finite=False)
                grown = 2.0 * np.sum(np.log(np.diag(root)))
                total = float(np.sum(white.log_determinant)) + grown
                parts[-1].append(_Factored(at, scale, root, total))
        return parts

    def _eliminated(self, rows) -> Iterator[_Eliminated]:
        """Yield the products of rows (n_rows, ...) at each level."""
        rows = rows.reshape(len(rows), *self.blocks.noise.shape[:3])
        for white, factored in zip(self._whitened, self._factored, strict=True):
            own = applied(white.roots, rows)
            if self.out is not None:
                own[:, self.out] = 0.0
            flat = _flat(own)
            across, inside = _flat(white.columns) @ flat.T, flat @ flat.T
            for at, scale, root, log_determinant in factored:
                part = linalg.solve_triangular(
                    root, across * scale[:, None], lower=True, check_finite=False
                )
                yield _Eliminated(at, log_determinant, inside - part.T @ part, root, part)


def _flat(rows):
    """Return rows (n_rows, ...) of numbers as a matrix, also where there is none."""
    return rows.reshape(len(rows), int(np.prod(rows.shape[1:])))


def _log_bayes(information, scores, one_sided=False):
    """Return the log Bayes factor (n,) of strengths with a unit normal prior, and their means."""
    inner = np.eye(len(information)) + information
    mean = np.linalg.solve(inner, scores)
    value = 0.5 * (np.sum(scores * mean, axis=0) - np.linalg.slogdet(inner)[1])
    if one_sided:
        deviation = np.sqrt(1.0 / inner[0, 0])
        value = value + np.log(2.0) + log_ndtr(mean[0] / deviation)
    return value, mean


def _root_mean_squares(scores, groups):
    """Return the root mean square of the scores of each group."""
    names = dict.fromkeys(groups)
    each = {name: [s for s, g in zip(scores, groups, strict=True) if g == name] for name in names}
    return {name: float(np.sqrt(np.mean(np.square(part)))) for name, part in each.items()}
