"""What data tell of unknowns whose ranges are known, from derivatives alone."""

from dataclasses import dataclass

import numpy as np

from ..inference.covariance import SCATTER, error_columns, whitener
from ..inference.error_model import scattering
from ..inference.misfits import misfit
from ..inference.noise import Band, Noise

UNIFORM = 1.0 / np.sqrt(12.0)  # standard deviation of a range, in shares of it
INFLUENCE = 0.1  # of what noise and errors of the theory are, below which nothing is felt
NORMAL_95 = 1.6448536269514722
PEAKS = (15.0, 10.0)  # %, errors of PPV and dominant frequency: what the paper calls a good fit
MOVED = 0.002  # of a range, by which peaks are compared: further, frequencies jump between peaks


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What some data tell of n unknowns.

    Parameters
    ----------
    information : (n, n) float64
        Of whitened changes of the data by one prior deviation of each unknown; theory.md (12.7).
    """

    information: np.ndarray

    @property
    def covariance(self):
        """Of the unknowns after the data, in prior deviations, (n, n)."""
        return np.linalg.inv(np.eye(len(self.information)) + self.information)

    @property
    def shares(self):
        """Standard deviation after the data over the one before, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def felt(self):
        """Whether a change by a prior deviation would be noticed if it were alone, (n,) bool."""
        return np.sqrt(np.maximum(np.diag(self.information), 0.0)) >= INFLUENCE

    @property
    def log_determinant(self):
        """Of the covariance: how far the data shrink the volume of what is possible."""
        return -float(np.linalg.slogdet(np.eye(len(self.information)) + self.information)[1])

    def trade_offs(self, least=0.5) -> list[tuple[int, int, float]]:
        """Return pairs of unknowns whose errors go together, and how far, strongest first."""
        share, covariance = self.shares, self.covariance
        correlation = covariance / np.outer(share, share)
        rows, columns = np.triu_indices(len(share), 1)
        pairs = [(int(i), int(j), float(correlation[i, j])) for i, j in zip(rows, columns,
                 strict=True)]  # fmt: skip
        kept = [pair for pair in pairs if abs(pair[2]) >= least]
        return sorted(kept, key=lambda pair: -abs(pair[2]))


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Motion at a point and how it changes with the unknowns.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    changes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By the whole range of each unknown.
    band : Band
    noise : Noise
        Of each receiver.
    levels : dict of str to float
        Of the errors of the theory.
    peaks_only : bool
        Whether PPV and dominant frequency are all that is looked at.
    mesh_errors : (n_errors, n_blasts, n_receivers, 3, n_samples) float64, m/s
        As of `usual_whitener`.
    """

    motion: np.ndarray
    changes: np.ndarray
    band: Band
    noise: Noise
    levels: dict[str, float]
    peaks_only: bool = False
    mesh_errors: np.ndarray | tuple = ()

    def knowledge(self, blasts, receivers, scattered=None) -> Knowledge:
        """Return what some blasts at some receivers tell.

        Parameters
        ----------
        blasts, receivers : sequence of int
        scattered : array, optional
            What `scattered` returns, where it is asked for often.

        Notes
        -----
        theory.md (12.7): errors of the theory are those of (7.13), independent between receivers
        but for the spectrum of a blast and the gain of a receiver.
        """
        blasts, receivers = list(blasts), list(receivers)
        part = np.ix_(blasts, receivers)
        motion = self.motion[part]
        if not np.any(motion):
            return Knowledge(np.zeros((len(self.changes), len(self.changes))))
        if self.peaks_only:
            return self._by_peaks(receivers, motion, self.changes[:, *part])
        spread = (self.scattered() if scattered is None else scattered)[part]
        errors = error_columns(motion, self.band, [one[part] for one in self.mesh_errors])
        used = {*errors.groups, SCATTER}
        white = whitener(
            _of_receivers(self.noise, receivers), self.band, len(blasts), nuisances=errors,
            scattering=spread, levels={n: v for n, v in self.levels.items() if n in used},
        )  # fmt: skip
        columns = UNIFORM * white.apply(self.changes[:, *part]).reshape(len(self.changes), -1)
        return Knowledge(columns @ columns.T)

    def _by_peaks(self, receivers, motion, changes):
        """Return what PPV and dominant frequency tell, each with its error in `PEAKS` and noise."""
        one = misfit("paper", motion, self.band.dt, band=(self.band.low, self.band.high))
        columns = np.array([one.residuals(motion + MOVED * change) for change in changes]) / MOVED
        frequency = np.linspace(self.band.low, self.band.high, 64)
        density = self.noise.density(frequency)[receivers].mean(axis=-1)
        noise = np.sqrt(2.0 * (self.band.high - self.band.low) * density)
        ppv = np.max(np.abs(motion), axis=-1)
        # PPV of the components that move, then their frequencies, by blast and receiver
        errors = [
            np.hypot(error, 100.0 * noise[r][moves] / ppv[b, r][moves])
            for b, r in np.ndindex(ppv.shape[:2])
            for moves in [ppv[b, r] > 0.0]
            for error in PEAKS
        ]
        columns *= UNIFORM / np.concatenate(errors)
        return Knowledge(columns @ columns.T)

    def scattered(self):
        """Return the covariance of scattered motion of all blasts and receivers."""
        return scattering(self.motion, self.band)


def _of_receivers(noise, receivers):
    """Return the noise of some receivers."""
    return Noise(
        noise.step, noise.coefficients[receivers], noise.variance[receivers],
        noise.correlation[receivers], noise.doubt[receivers], noise.resolved,
    )  # fmt: skip


def centre(unit, knowledge):
    """Return the likeliest place in the unit cube where data alone would say ``unit``, (n,).

    Ranges pull towards their middle what data hardly tell; theory.md (12.8).
    """
    pull = knowledge.covariance @ knowledge.information
    return np.clip(0.5 + pull @ (np.asarray(unit) - 0.5), 0.0, 1.0)


def intervals(unit, knowledge):
    """Return where 90 % of what is left lies, (n, 2) in the unit cube, cut at its sides."""
    reach, middle = NORMAL_95 * UNIFORM * knowledge.shares, centre(unit, knowledge)
    return np.clip(np.stack([middle - reach, middle + reach], axis=-1), 0.0, 1.0)
