"""Calibrate what is known to be uncertain of a site before anything is called missing."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ..projects.site import Site
from ..residuals.levels import infer_levels
from ..residuals.theory_errors import usual_whitener
from ..residuals.whitening import Whitener
from .case import Case
from .forward import Forward
from .unknowns import Unknown, unknowns_of, with_values

STEP = 0.5  # of each prior's standard deviation, for derivatives
ROUNDS = 4
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
    whitener : Whitener
        With the levels of the errors that the residual shows.
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
    whitener: Whitener

    @property
    def residual(self):
        """What the records have and the site does not send, m/s; zero where nothing is valid."""
        return remainder(self.case, self.motion)

    @property
    def pull(self):
        """How far each value was drawn from its prior, in standard deviations, (n,)."""
        return self.values / np.array([one.sigma for one in self.unknowns])


def remainder(case: Case, motion):
    """Return recorded less simulated motion, zero where the record is not valid."""
    return np.where(case.valid, case.motion - motion, 0.0)


def calibrate(forward: Forward, fine: Forward | None = None) -> Baseline:
    """Fit wave speeds and joint stiffness to the records of a case.

    Parameters
    ----------
    forward : Forward
        Whose runs are many.
    fine : Forward, optional
        With a better mesh; it runs the site as believed and as calibrated.

    Returns
    -------
    Baseline

    Notes
    -----
    Gauss-Newton steps on the whitened residual with the priors of the unknowns. Derivatives are
    differences at the start; each further run improves them by Broyden's rule. What the finer mesh
    adds is taken at the believed site first, and again where the calibration ends.
    """
    unknowns = unknowns_of(forward.case.site)
    sigma = np.array([one.sigma for one in unknowns])
    places = [np.zeros(len(sigma)), *np.diag(STEP * sigma)]
    found = forward.motions([with_values(forward.case.site, unknowns, one) for one in places])
    slopes = (found[1:] - found[0]) / (STEP * sigma)[:, None, None, None, None]
    search = _Search(forward, fine, unknowns, sigma, slopes)
    values, believed = np.zeros(len(sigma)), search.corrected(np.zeros(len(sigma)), found[0])
    motion, correction = believed, believed - found[0]
    values, motion = search.settled(values, motion, correction)
    if fine is not None:
        rough = motion - correction
        motion = search.corrected(values, rough)
        correction = motion - rough
        values, motion = search.settled(values, motion, correction)
    weigh = whitener_of(forward.case, motion, search.slopes, sigma, values)
    _, covariance = step(weigh, remainder(forward.case, motion), search.slopes, sigma, values)
    return Baseline(
        forward.case, unknowns, values, covariance,
        with_values(forward.case.site, unknowns, values), motion, search.slopes, believed,
        correction, weigh,
    )  # fmt: skip


@dataclass
class _Search:
    """The calibration under way."""

    forward: Forward
    fine: Forward | None
    unknowns: tuple[Unknown, ...]
    sigma: np.ndarray
    slopes: np.ndarray

    def site(self, values):
        """Return the site with some values."""
        return with_values(self.forward.case.site, self.unknowns, values)

    def corrected(self, values, rough):
        """Return the motion of the finer mesh, or the rough one where there is none."""
        return rough if self.fine is None else self.fine.motion(self.site(values))

    def settled(self, values, motion, correction):
        """Move by steps of Gauss-Newton until they are small; return values and motion."""
        case, slopes = self.forward.case, self.slopes
        for _ in range(ROUNDS):
            weigh = whitener_of(case, motion, slopes, self.sigma, values)
            move, covariance = step(weigh, remainder(case, motion), slopes, self.sigma, values)
            if np.max(np.abs(move) / np.sqrt(np.diag(covariance))) < SETTLED:
                break
            after = self.forward.motion(self.site(values + move)) + correction
            missed = after - motion - np.tensordot(move, slopes, 1)
            weight = move / self.sigma**2
            slopes = slopes + np.multiply.outer(weight / (weight @ move), missed)
            if self._squares(weigh, values + move, after) > self._squares(weigh, values, motion):
                break
            values, motion = values + move, after
        self.slopes = slopes
        return values, motion

    def _squares(self, weigh, values, motion):
        """Return the whitened sum of squares with that of the priors."""
        left = weigh.chi_square(remainder(self.forward.case, motion))
        return float(left + np.sum((values / self.sigma) ** 2))


def whitener_of(case, motion, slopes, sigma, values) -> Whitener:
    """Return the covariance around a simulation, its levels from what calibration can't take."""
    weigh = usual_whitener(motion, case.noise, case.band)
    residual = remainder(case, motion)
    for _ in range(2):
        move, _ = step(weigh, residual, slopes, sigma, values)
        weigh = infer_levels(weigh, residual - np.tensordot(move, slopes, 1)).whitener
    return weigh


def step(weigh, residual, slopes, sigma, values):
    """Return the best change of values (n,) and the covariance of what is known then."""
    white = weigh.apply(np.concatenate([residual[None], slopes]))
    target, columns = white[0].ravel(), white[1:].reshape(len(slopes), -1)
    curvature = columns @ columns.T + np.diag(sigma**-2.0)
    pulled = columns @ target - values / sigma**2
    factor = linalg.cho_factor(curvature)
    return linalg.cho_solve(factor, pulled), linalg.inv(curvature)
