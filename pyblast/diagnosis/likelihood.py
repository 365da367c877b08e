"""What a misfit is worth: noise and the errors of any theory, of unsure size, record by record."""

from dataclasses import dataclass

import numpy as np
from scipy import signal
from scipy.special import logsumexp

from ..inference.noise import symmetric_root
from .case import Case

THEORY = 0.01  # share of a record's energy that places, clocks and small heterogeneity cost
UNSETTLED = 0.28  # of the energy that a finer mesh changes: what it has wrong itself
DOUBT = 4.0  # degrees of freedom behind that share: it may well be three times as large
LARGER = np.geomspace(1.0, 100.0, 41)  # by which all errors may be larger than that, in energy


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Student's distribution of each record's residual, theory.md (14.1).

    Parameters
    ----------
    case : Case
    roots : (n_blasts, n_receivers, m, m) float64, s/m
        Whitening of the coefficients of three components by noise and errors of the theory.
    kept : (n_blasts, n_receivers) int
        Coefficients that there are, at most m.
    freedom : (n_blasts, n_receivers) float64
        Independent numbers in a record: its duration times its bandwidth.
    noisy : (n_blasts, n_receivers) float64
        Mean square of whitened noise alone: the share that noise has in what is expected.
    """

    case: Case
    roots: np.ndarray
    kept: np.ndarray
    freedom: np.ndarray
    noisy: np.ndarray

    def white(self, motion):
        """Return whitened coefficients (..., n_blasts, n_receivers, m) of motion in m/s."""
        held = self.case.band.project(motion)
        held = held.reshape(*held.shape[:-2], -1)
        return np.einsum("brij,...brj->...bri", self.roots, held)

    def left(self, motion):
        """Return the whitened difference of the records and some motion; see `white`."""
        return self.white(np.where(self.case.valid, self.case.motion - motion, 0.0))

    def size(self, white):
        """Return the mean square of each whitened record, (n_blasts, n_receivers)."""
        return np.sum(white**2, axis=-1) / np.maximum(self.kept, 1)

    def doubled(self, size):
        """Return mean squares (n_blasts, n_receivers) at errors of the theory twice as large.

        As they are where all is noise, a quarter where none is.
        """
        return size / (self.noisy + 4.0 * (1.0 - self.noisy))

    def misfit(self, white, blasts=None):
        """Return -2 ln L of a whitened residual, of some blasts if indices are given."""
        return self.misfit_of(self.size(white), blasts)

    def misfit_of(self, size, blasts=None):
        """Return -2 ln L of mean squares (..., n_blasts, n_receivers)."""
        each = self.each(size)
        return np.sum(each if blasts is None else each[..., list(blasts), :], axis=(-2, -1))

    def each(self, size):
        """Return -2 ln L of each record of mean squares (..., n_blasts, n_receivers)."""
        return (self.freedom + DOUBT) * np.log1p(self.freedom * size / DOUBT)

    def doubted(self, size) -> float:
        """Return how the likelihood rises if errors may be larger by one factor, ln.

        Of all records, of one blast or of one receiver, each third as likely as the others before
        the records are seen, and in it each blast, receiver and factor of `LARGER`.
        """
        widened = [
            self.freedom * np.log(k)
            + (self.freedom + DOUBT) * np.log1p(self.freedom * size / (k * DOUBT))
            for k in LARGER
        ]
        each = np.where(self.kept > 0, np.array(widened) - widened[0], 0.0)
        thirds = each.sum(axis=(1, 2)), each.sum(axis=2), each.sum(axis=1)
        return float(logsumexp([logsumexp(-0.5 * one) - np.log(3.0 * one.size) for one in thirds]))

    def excess(self, size, blasts=None):
        """Return the energy that noise and errors of the theory do not explain, in their units.

        Records that are better than these errors make up for none that is worse.
        """
        each = np.maximum(size - 1.0, 0.0)
        return float(np.sum(each if blasts is None else each[list(blasts)]))

    def share(self, before, after, blasts=None):
        """Return the share of all energy in excess that is gone with other sizes of some blasts."""
        there = self.excess(before)
        gone = self.excess(before, blasts) - self.excess(after, blasts)
        return gone / there if there > 0.0 else 0.0

    def weights(self, size):
        """Return what squares of coefficients weigh, so that slopes of -2 ln L are right."""
        share = self.freedom / np.maximum(self.kept, 1)
        return share * (self.freedom + DOUBT) / (DOUBT + self.freedom * size)


def likelihood_of(case: Case, correction=None) -> Likelihood:
    """Return the likelihood of the records of a case.

    Parameters
    ----------
    case : Case
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        What a finer mesh changes; a share of its energy counts as an error of the theory.
    """
    band, n = case.band, 3 * case.band.n_functions
    held = band.project(case.motion)
    mesh = np.zeros_like(held) if correction is None else band.project(correction)
    shape = case.motion.shape[:2]
    roots, kept, noisy = np.zeros((*shape, n, n)), np.zeros(shape, dtype=int), np.zeros(shape)
    for b, r in np.ndindex(shape):
        noise = case.noise.covariance(band, b, r)
        there = np.diag(noise) > 0.0
        if not np.any(held[b, r]):
            continue
        kept[b, r] = np.count_nonzero(there)
        energy = max(np.sum(held[b, r] ** 2) - np.trace(noise), 0.0)
        error = THEORY * energy + UNSETTLED * np.sum(mesh[b, r] ** 2)
        covariance = noise + np.diag(there * error / kept[b, r])
        root = roots[b, r] = symmetric_root(covariance, -0.5)
        noisy[b, r] = np.sum(root * (noise @ root)) / kept[b, r]
    return Likelihood(case, roots, kept, _freedom(band.restore(held), case.dt), noisy)


def _freedom(motion, dt):
    """Return the independent numbers (n_blasts, n_receivers) of records: 2 B T of each component.

    Bandwidth, duration and the number of components are those that a flat one would have with the
    same mean square: participation numbers.
    """
    power = np.sum(np.abs(np.fft.rfft(motion)) ** 2, axis=2)
    envelope = np.sum(np.abs(signal.hilbert(motion)) ** 2, axis=2)
    frequency = 1.0 / (motion.shape[-1] * dt)
    band = _participation(power) * frequency
    duration = _participation(envelope) * dt
    return 2.0 * band * duration * _participation(np.sum(motion**2, axis=-1))


def _participation(parts):
    """Return how many parts along the last axis really take part."""
    squares = np.sum(parts**2, axis=-1)
    return np.divide(np.sum(parts, axis=-1) ** 2, squares, out=np.zeros_like(squares),
                     where=squares > 0.0)  # fmt: skip
