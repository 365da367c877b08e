"""Posterior of properties by linear algebra: those looked for, those held, and nuisances."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.special import logsumexp

from .covariance import RecordBlocks
from .nuisances import Nuisances

# Levels of model error, in shares of the energy of a channel, and of the group "ground".
SCATTER = (3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1)
PATH = (1e-5, 1e-3, 1e-2, 1e-1)
CODA = (1e-5, 4e-4)
GROUND = (0.5, 1.0, 2.0)
NORMAL_95 = 1.6448536269514722


class Levels(NamedTuple):
    """Grid of levels over which a posterior is averaged.

    Parameters
    ----------
    scatter, path, coda : tuple of float
        Shares of the energy of each channel: scattered motion, a smooth transfer error of each
        channel, and scattering that dies out slowly.
    ground : tuple of float
        Factors on the columns of group ``ground``.
    """

    scatter: tuple[float, ...] = SCATTER
    path: tuple[float, ...] = PATH
    coda: tuple[float, ...] = CODA
    ground: tuple[float, ...] = GROUND


ALL_LEVELS = Levels()
FEW_LEVELS = Levels((1e-4, 1e-3, 1e-2, 1e-1), PATH, (1e-5,))  # while a search is on its way


@dataclass(frozen=True, eq=False)
class Linear:
    """Gaussian posterior of properties under levels of model error that are averaged.

    Parameters
    ----------
    mean : (n,) float64
    covariance : (n, n) float64
        The spread of the mean over the levels is included.
    prior : (n,) float64
        Standard deviations around zero.
    level : float
        Learned model error: share of the energy that scatter, path and coda take together.
    log_evidence : float
        Averaged over the levels, up to a constant of the records.
    nuisances : dict of str to float
        Root mean square of the most probable nuisances of each group, in prior deviations.
    remaining : (n_blasts, n_receivers) float64
        Share of the energy of each record, above its noise, that remains with all properties and
        nuisances where they are most probable.
    """

    mean: np.ndarray
    covariance: np.ndarray
    prior: np.ndarray
    level: float
    log_evidence: float
    nuisances: dict[str, float]
    remaining: np.ndarray

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


def linear(
    blocks: RecordBlocks,
    residual: np.ndarray,
    slopes: np.ndarray,
    prior: np.ndarray,
    nuisances: Nuisances,
    levels: Levels = ALL_LEVELS,
) -> Linear:
    """Return the posterior of properties on which motion depends linearly.

    Parameters
    ----------
    blocks : RecordBlocks
        Covariance of the errors of each record, by levels.
    residual : (n_blasts, n_receivers, 3, n_functions) float64
        Records less prediction where all properties have their prior mean.
    slopes : (n, n_blasts, n_receivers, 3, n_functions) float64
        Derivatives by the properties.
    prior : (n,) float64
        Standard deviations of the properties; zero where one is known.
    nuisances : Nuisances
        Columns of one prior standard deviation each.
    levels : Levels

    Notes
    -----
    theory.md (12.5): properties and nuisances are columns with a unit prior; the levels of the
    errors of records have equal prior weights on a grid, and posterior means and covariances are
    averaged by their evidence.
    """
    n, shape = len(prior), residual.shape[:2]
    columns = np.concatenate([slopes * prior[:, None, None, None, None], nuisances.columns])
    scaled = np.array([False] * n + [group == "ground" for group in nuisances.groups])
    rows = np.concatenate([residual[None], columns]).reshape(len(columns) + 1, *shape, -1)
    factors = levels.ground if scaled.any() else levels.ground[:1]
    results = []
    for each in np.array(np.meshgrid(*levels[:3], indexing="ij")).reshape(3, -1).T:
        white, log_determinant = blocks.whiten(rows, *each)
        white = white.reshape(len(rows), -1)
        gram = white @ white.T
        for factor in factors:
            scale = np.where(scaled, factor, 1.0)
            inner = gram[1:, 1:] * np.outer(scale, scale) + np.eye(len(scale))
            along = gram[1:, 0] * scale
            cholesky = linalg.cho_factor(inner, lower=True, check_finite=False)
            mean = linalg.cho_solve(cholesky, along, check_finite=False)
            part = linalg.cho_solve(cholesky, np.eye(len(inner))[:, :n], check_finite=False)[:n]
            log_all = log_determinant + 2.0 * np.sum(np.log(np.diag(cholesky[0])))
            evidence = -0.5 * (gram[0, 0] - along @ mean + log_all)
            results.append((evidence, mean, part, mean * scale, np.sum(each)))
    evidences, means, parts, moved, shares = zip(*results, strict=True)
    weight = np.exp(np.array(evidences) - logsumexp(evidences))
    best = int(np.argmax(weight))
    properties = np.array(means)[:, :n]
    mean = weight @ properties
    spread = properties - mean
    covariance = np.tensordot(weight, parts, 1) + np.einsum("l,li,lj->ij", weight, spread, spread)
    fitted = np.tensordot(moved[best], columns, 1)
    return Linear(
        mean * prior, covariance * np.outer(prior, prior), prior,
        float(np.exp(weight @ np.log(shares))),
        float(logsumexp(evidences) - np.log(len(evidences))),
        _root_mean_squares(means[best][n:], nuisances.groups),
        blocks.above_noise(residual - fitted),
    )  # fmt: skip


def _root_mean_squares(scores, groups):
    """Return the root mean square of the scores of each group."""
    names = dict.fromkeys(groups)
    each = {name: [s for s, g in zip(scores, groups, strict=True) if g == name] for name in names}
    return {name: float(np.sqrt(np.mean(np.square(part)))) for name, part in each.items()}
