"""Error model of predicted records: posterior of properties, scores of changes, draws."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby, product
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize
from scipy.special import log_ndtr, logsumexp

from .covariance import RecordBlocks, applied
from .nuisances import GROUND, HOLES, TRANSFER, Nuisances

NORMAL_95 = 1.6448536269514722  # quantile
DROPPED = 60.0  # log evidence below the best, from where a level has no weight
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
        Learned model error, as ``level``, and log evidence at each level; minus infinity where it
        was found to have no weight.
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
        At the levels of weight, or at all.
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
        return (np.stack(rows, axis=1) for rows in (evidence, bayes, beyond))


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


class _Rows(NamedTuple):
    """Rows of shapes of changes, those of as many shapes together, and below them residuals.

    ``values`` (n_shapes + n_data, n_blasts, n_receivers, m); ``groups`` are the numbers and the
    sizes of the changes of each group.
    """

    values: np.ndarray
    groups: list[tuple[int, int]]

    def by_group(self, shapes) -> list[np.ndarray]:
        """Return what is known of each shape (n_shapes, n) as (number, size, n), by group."""
        ends = np.cumsum([0, *(number * size for number, size in self.groups)])
        return [
            shapes[start : start + number * size].reshape(number, size, shapes.shape[-1])
            for start, (number, size) in zip(ends, self.groups, strict=False)
        ]


class _Eliminated(NamedTuple):
    """Products of rows at a level whose columns are eliminated, by the inverse covariance.

    ``information`` (number, size, size) of the shapes of each change with each other, by group;
    ``along`` (n_shapes, n_data) of shapes and residuals; ``square`` (n_data,) of residuals.
    ``log_determinant`` is that of the covariance. ``root`` (n_columns, n_columns) is the Cholesky
    factor of the columns with their priors, ``across`` (n_columns, n_rows) the products of columns
    and rows after its inverse.
    """

    at: Level
    log_determinant: float
    information: list[np.ndarray]
    along: np.ndarray
    square: np.ndarray
    root: np.ndarray
    across: np.ndarray

    @property
    def evidence(self) -> np.ndarray:
        """Log evidence of each residual without a change, (n_data,)."""
        return -0.5 * (self.square + self.log_determinant)


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
    Levels that explain the records `DROPPED` less than others are not looked at: from a usual one
    on the grid of scatter, coda and holes, the neighbours of those that do not are.
    """

    blocks: RecordBlocks
    nuisances: Nuisances
    levels: Levels
    offset: np.ndarray | float = 0.0
    whole: "ErrorModel | None" = None
    out: np.ndarray | None = None
    _white: dict = field(default_factory=dict, init=False, repr=False)
    _roots: dict = field(default_factory=dict, init=False, repr=False)

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
        residual = residual - self.offset

        def judged(part):
            (information,), along = part.information[0], part.along
            gain, mean = _log_bayes(information, along)
            evidence = float(gain[0] + part.evidence[0])
            nuisances = linalg.solve_triangular(
                part.root, part.across[:, n] - part.across[:, :n] @ mean[:, 0], lower=True, trans=1,
                check_finite=False,
            )  # fmt: skip
            each = np.linalg.inv(np.eye(n) + information)
            return evidence, (evidence, mean[:, 0], each, nuisances, part.at)

        results = self._judged(_Rows(np.concatenate([own, residual[None]]), [(1, n)]), judged)
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
            float(logsumexp(evidences) - np.log(len(self._all))),
            _root_mean_squares(nuisances[best], groups),
            self.blocks.above_noise(residual - moved - np.tensordot(means[best], own, 1)),
            self._whole_grid(dict(zip(at, evidences, strict=True))),
        )  # fmt: skip

    def scores(
        self, residuals: np.ndarray, changes: Sequence[Change] = (), every: bool = False
    ) -> Scores:
        """Return the scores of changes of motion; theory.md (14.11).

        Parameters
        ----------
        residuals : (n_data, n_blasts, n_receivers, 3, n_functions) float64, m/s
        changes : sequence of n_changes Change
        every : bool
            Whether to look at levels without weight, too, which stronger changes may give it.
        """
        size = [(len(change.shapes), change.one_sided) for change in changes]
        order = sorted(range(len(changes)), key=size.__getitem__)
        groups = [(len([*own]), *kind) for kind, own in groupby(order, size.__getitem__)]
        rows = _Rows(
            np.concatenate([*(changes[k].shapes for k in order), residuals - self.offset]),
            [group[:2] for group in groups],
        )
        back = np.argsort(order)

        def in_order(by_group):
            each = [own for group in by_group for own in group]
            return [each[k] for k in back]

        def judged(part):
            along = rows.by_group(part.along)
            scored = [
                _log_bayes(information, own, one_sided)
                for (*_, one_sided), information, own in zip(
                    groups, part.information, along, strict=True
                )
            ]
            bayes, means = (in_order([own[k] for own in scored]) for k in (0, 1))
            level = ByLevel(part.evidence, in_order(part.information), in_order(along))
            values = level.evidence + np.array([np.zeros(len(residuals)), *bayes])
            return values, (bayes, means, level, part.at)

        results = self._judged(rows, judged, every)
        bayes, means, by_level, at = (list(each) for each in zip(*results, strict=True))
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
            total - np.log(len(self._all)), with_change - total, strength,
            by_level[best].information, at[best], [change.one_sided for change in changes],
            by_level,
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

        def judged(part):
            return part.evidence[0], (part.at, float(part.evidence[0]))

        return self._judged(_Rows((residual - self.offset)[None], []), judged, every=True)

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

        def judged(part):
            return part.evidence[0], part

        best = max(self._judged(_Rows(row, []), judged), key=lambda part: part.evidence[0])
        factors = best.at.scale(self.nuisances.groups) * linalg.solve_triangular(
            best.root, best.across[:, 0], lower=True, trans=1, check_finite=False
        )
        rest = (row[0] - np.tensordot(factors, self.nuisances.columns, 1)).reshape(
            self.blocks.noise.shape[:3]
        )
        roots, _ = self.blocks.roots(best.at.scatter, best.at.coda, best.at.holes)
        return best.at, factors, applied(roots.swapaxes(-1, -2), applied(roots, rest))

    @cached_property
    def _factors(self) -> list[tuple[float, ...]]:
        """The levels of transfer, ground and nuisances that columns tell apart."""
        groups = self.nuisances.groups
        return list(product(
            self.levels.transfer if TRANSFER in groups else (0.0,),
            self.levels.ground if GROUND in groups else (1.0,),
            self.levels.nuisance,
        ))  # fmt: skip

    @cached_property
    def _all(self) -> list[Level]:
        """All levels of the grid, those of the errors of a record first."""
        grid = product(self.levels.scatter, self.levels.coda, self.levels.holes)
        return [
            Level(scatter, coda, *each, holes=holes)
            for scatter, coda, holes in grid for each in self._factors
        ]  # fmt: skip

    def _whole_grid(self, evidences):
        """Return learned model error and log evidence of all levels from those of some, (n, 2)."""
        return np.array([[sum(at[:3]), evidences.get(at, -np.inf)] for at in self._all])

    def _whitened(self, shares) -> _Whitened:
        """Return the whitened columns at a level of the errors of a record, kept."""
        if shares not in self._white:
            self._white[shares] = (
                self._whiten(shares) if self.whole is None
                else self._left(self.whole._whitened(shares))
            )  # fmt: skip
        return self._white[shares]

    def _whiten(self, shares):
        """Return the whitened columns of all records."""
        columns = self.nuisances.columns.reshape(-1, *self.blocks.noise.shape[:3])
        roots, log_determinant = self.blocks.roots(*shares)
        white = applied(roots, columns)
        flat = _flat(white)
        return _Whitened(shares, roots, log_determinant, white, flat @ flat.T)

    def _left(self, each):
        """Return whitened columns without the records that are left out."""
        away = _flat(each.columns[:, self.out])
        known = np.where(self.out, 0.0, each.log_determinant)
        return each._replace(log_determinant=known, products=each.products - away @ away.T)

    def _factored(self, shares) -> list[_Factored]:
        """Return the factored columns at each level with one of the errors of a record, kept."""
        if shares not in self._roots:
            self._roots[shares] = [self._factor(shares, each) for each in self._factors]
        return self._roots[shares]

    def _factor(self, shares, factors):
        """Return the factored columns at a level."""
        (scatter, coda, holes), white = shares, self._whitened(shares)
        at = Level(scatter, coda, *factors, holes=holes)
        scale = at.scale(self.nuisances.groups)
        inner = white.products * np.outer(scale, scale) + np.eye(len(scale))
        root = linalg.cholesky(inner, lower=True, check_finite=False)
        grown = 2.0 * np.sum(np.log(np.diag(root)))
        return _Factored(at, scale, root, float(np.sum(white.log_determinant)) + grown)

    def _eliminated(self, rows: _Rows, shares) -> Iterator[_Eliminated]:
        """Yield the products of rows at each level with one of the errors of a record."""
        white = self._whitened(shares)
        own = applied(white.roots, rows.values)
        if self.out is not None:
            own[:, self.out] = 0.0
        flat = _flat(own)
        across, inside = _flat(white.columns) @ flat.T, _products(rows, flat)
        for at, scale, root, log_determinant in self._factored(shares):
            part = linalg.solve_triangular(
                root, across * scale[:, None], lower=True, check_finite=False
            )
            information, along, square = _products(rows, part.T)
            yield _Eliminated(
                at, log_determinant,
                [whole - own for whole, own in zip(inside[0], information, strict=True)],
                inside[1] - along, inside[2] - square, root, part,
            )  # fmt: skip

    def _judged(self, rows, judge: Callable, every: bool = False) -> list:
        """Return what is judged of rows at each level of weight, in their order.

        Parameters
        ----------
        rows : _Rows
            Their values of any shape (n_rows, ...).
        judge : callable
            ``(eliminated) -> (values, result)`` with the log evidences of the level.
        every : bool
            Whether to judge levels without weight, too.
        """
        own = rows.values
        rows = rows._replace(values=own.reshape(len(own), *self.blocks.noise.shape[:3]))
        axes = self.levels.scatter, self.levels.coda, self.levels.holes
        shape, values, results = tuple(map(len, axes)), {}, {}
        waiting = list(np.ndindex(shape)) if every else [_usual_index(*shape)]
        while waiting:
            index = waiting.pop()
            shares = tuple(axis[n] for axis, n in zip(axes, index, strict=True))
            judged = [judge(part) for part in self._eliminated(rows, shares)]
            values[index] = np.max([value for value, _ in judged], axis=0)
            results[index] = [result for _, result in judged]
            if not every:
                waiting = _neighbours_of_weight(values, shape)
        return [result for index in sorted(results) for result in results[index]]


def _neighbours_of_weight(values, shape):
    """Return the unknown neighbours on a grid of those with weight, that of the best last.

    ``values`` are the log evidences of those that are known, by index.
    """
    best = np.max([*values.values()], axis=0)
    short = {index: np.min(best - own) for index, own in values.items()}
    near = []
    for index in sorted(short, key=short.__getitem__, reverse=True):
        if short[index] < DROPPED:
            pairs = zip(index, shape, strict=True)
            beside = product(*(range(max(at - 1, 0), min(at + 2, n)) for at, n in pairs))
            near += [each for each in beside if each not in values][::-1]
    return near


def _usual_index(n_scatter, n_coda, n_holes):
    """Return where to begin on a grid: low scatter, and the level of holes that `Learned` ends by.

    >>> _usual_index(5, 1, 3)
    (1, 0, 1)
    """
    return min(1, n_scatter - 1), (n_coda - 1) // 2, max(n_holes - 2, 0)


def _flat(rows):
    """Return rows (n_rows, ...) of numbers as a matrix, also where there is none."""
    return rows.reshape(len(rows), int(np.prod(rows.shape[1:])))


def _products(rows, flat):
    """Return the products of rows (n_rows, n): within changes, of shapes and residuals, of these.

    As ``information``, ``along`` and ``square`` of `_Eliminated`.
    """
    n = sum(number * size for number, size in rows.groups)
    shapes, data = flat[:n], flat[n:]
    within = [own @ own.swapaxes(1, 2) for own in rows.by_group(shapes)]
    return within, shapes @ data.T, np.einsum("nk,nk->n", data, data)


def _log_bayes(information, scores, one_sided=False):
    """Return the log Bayes factor (..., n) of strengths with a unit normal prior, and their means.

    By ``information`` (..., size, size) and ``scores`` (..., size, n).
    """
    inner = np.eye(information.shape[-1]) + information
    mean = np.linalg.solve(inner, scores)
    value = 0.5 * (np.sum(scores * mean, axis=-2) - np.linalg.slogdet(inner)[1][..., None])
    if one_sided:
        deviation = np.sqrt(1.0 / inner[..., 0, 0])[..., None]
        value = value + np.log(2.0) + log_ndtr(mean[..., 0, :] / deviation)
    return value, mean


def _root_mean_squares(scores, groups):
    """Return the root mean square of the scores of each group."""
    names = dict.fromkeys(groups)
    each = {name: [s for s, g in zip(scores, groups, strict=True) if g == name] for name in names}
    return {name: float(np.sqrt(np.mean(np.square(part)))) for name, part in each.items()}
