"""Calibrate what is known to be uncertain of a site before anything is called missing."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..errors import InputError
from ..projects.site import Site
from .case import Case
from .forward import Forward
from .likelihood import Likelihood, likelihood_of
from .unknowns import Unknown, unknowns_of, with_values

STEP = 0.5  # of each prior's standard deviation, for derivatives
ROUNDS = 4
APART = 100.0  # times larger or smaller than what is believed: no physics that is missing does that
SETTLED = 0.2  # of the posterior standard deviations: smaller moves end the calibration


@dataclass(frozen=True, eq=False)
class Baseline:
    """A site that fits the records as well as its uncertain values allow.

    Parameters
    ----------
    case : Case
    unknowns : tuple of n Unknown
    values : (n,) float64
        Logarithms of factors on what was believed.
    covariance : (n, n) float64
    site : Site
        With these values.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What it sends, ``correction`` included.
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By each value.
    believed : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What the site sends as it is believed to be, by a finer mesh if there was one.
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Of the finer mesh over the one of the runs.
    likelihood : Likelihood
    """

    case: Case
    unknowns: tuple[Unknown, ...]
    values: np.ndarray
    covariance: np.ndarray
    site: Site
    motion: np.ndarray
    slopes: np.ndarray
    believed: np.ndarray
    correction: np.ndarray
    likelihood: Likelihood

    @property
    def sigma(self):
        """Standard deviation of each value before the records are seen, (n,)."""
        return np.array([one.sigma for one in self.unknowns])

    @property
    def pull(self):
        """How far each value was drawn from its prior, in standard deviations, (n,)."""
        return self.values / self.sigma


def calibrate(forward: Forward, fine: Forward | None = None) -> Baseline:
    """Fit wave speeds and joint stiffness to the records of a case.

    Parameters
    ----------
    forward : Forward
        Whose runs are many.
    fine : Forward, optional
        With a better mesh; it runs the site as it is believed to be.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        If the records are a hundred times larger or smaller than what the believed site sends.

    Notes
    -----
    Gauss-Newton steps on the misfit of the likelihood with the priors of the unknowns. Derivatives
    are differences at the start; each further run improves them by Broyden's rule. What the finer
    mesh adds is taken at the believed site.
    """
    unknowns = unknowns_of(forward.case.site)
    sigma = np.array([one.sigma for one in unknowns])
    places = [np.zeros(len(sigma)), *np.diag(STEP * sigma)]
    found = forward.motions([with_values(forward.case.site, unknowns, one) for one in places])
    slopes = (found[1:] - found[0]) / (STEP * sigma)[:, None, None, None, None]
    believed = found[0] if fine is None else fine.motion(forward.case.site)
    correction = believed - found[0]
    likelihood = likelihood_of(forward.case, correction)
    _refuse_another_unit(likelihood, believed)
    search = _Search(forward, unknowns, sigma, slopes, likelihood)
    values, motion = search.settled(np.zeros(len(sigma)), believed, correction)
    _, covariance = search.step(values, motion)
    return Baseline(
        forward.case, unknowns, values, covariance,
        with_values(forward.case.site, unknowns, values), motion, search.slopes, believed,
        correction, search.likelihood,
    )  # fmt: skip


def _refuse_another_unit(likelihood, believed):
    """Refuse records of a case that can't be motion in m/s of the site as it is believed to be."""
    case, loud = likelihood.case, likelihood.noisy < 0.5
    recorded, sent = (
        np.linalg.norm(case.band.project(one), axis=(2, 3)) for one in (case.motion, believed)
    )
    told = loud & (recorded > 0.0) & (sent > 0.0)
    times = np.median(recorded[told] / sent[told]) if np.any(told) else 1.0
    if not 1.0 / APART < times < APART:
        raise InputError(
            f"records: are {times:.2g} times as large as what the site sends, in the median; give "
            "them in m/s (mm/s are 1000 times as large), or mend the source and the charges"
        )


@dataclass
class _Search:
    """The calibration under way."""

    forward: Forward
    unknowns: tuple[Unknown, ...]
    sigma: np.ndarray
    slopes: np.ndarray
    likelihood: Likelihood

    def site(self, values):
        """Return the site with some values."""
        return with_values(self.forward.case.site, self.unknowns, values)

    def settled(self, values, motion, correction):
        """Move by steps of Gauss-Newton until they are small; return values and motion."""
        for _ in range(ROUNDS):
            move, covariance = self.step(values, motion)
            if np.max(np.abs(move) / np.sqrt(np.diag(covariance))) < SETTLED:
                break
            after = self.forward.motion(self.site(values + move)) + correction
            missed = after - motion - np.tensordot(move, self.slopes, 1)
            weight = move / self.sigma**2
            self.slopes = self.slopes + np.multiply.outer(weight / (weight @ move), missed)
            if self.squares(values + move, after) > self.squares(values, motion):
                break
            values, motion = values + move, after
        return values, motion

    def squares(self, values, motion):
        """Return the misfit with what the priors take."""
        left = self.likelihood.misfit(self.likelihood.left(motion))
        return float(left + np.sum((values / self.sigma) ** 2))

    def step(self, values, motion):
        """Return the best change of values (n,) and the covariance of what is known then."""
        left = self.likelihood.left(motion)
        weights = self.likelihood.weights(self.likelihood.size(left))
        columns = self.likelihood.white(self.slopes)
        curvature = np.einsum("ibrm,jbrm,br->ij", columns, columns, weights)
        curvature += np.diag(self.sigma**-2.0)
        pull = np.einsum("ibrm,brm,br->i", columns, left, weights) - values / self.sigma**2
        return linalg.solve(curvature, pull, assume_a="pos"), linalg.inv(curvature)
