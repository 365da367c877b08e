"""Likelihood and misfits: how far simulated motion is from records."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import signal
from scipy.special import logsumexp

from ..errors import InputError
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency, envelope_and_phase, lag, wavelet_transform
from .covariance import Whitener, whitener
from .records import Records

ENERGY_SHARE = 0.01  # of a record's energy: positions, clocks and small heterogeneity
MESH_SHARE = 0.28  # of the energy that a finer mesh changes: its own error
DOUBT = 4.0  # degrees of freedom of these shares: they may be three times as large
LARGER = np.geomspace(1.0, 100.0, 41)  # factors on the energy of all errors


@dataclass(frozen=True)
class EnergyShares:
    """Model error, white in each record, its energy a share of the recorded energy.

    Independent of a simulation, and between records, so that residuals can be permuted between
    receivers. The level is fixed: theory.md (14.1).

    Parameters
    ----------
    energy : float or (n_receivers,) float64
        Of the energy of a record above its noise.
    mesh : float
        Of the energy that a finer mesh changes.
    """

    energy: float | np.ndarray = ENERGY_SHARE
    mesh: float = MESH_SHARE

    def covariance(self, records, simulated=None, mesh_changes=()) -> Whitener:
        """Return the covariance of noise and model error in records.

        Parameters
        ----------
        records : Records
        simulated : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
            A simulation that nearly fits; the records themselves by default.
        mesh_changes : sequence of the same shape, m/s
            What other meshes change.
        """
        band, motion = records.band, records.motion if simulated is None else simulated
        held = band.project(motion)
        changed = np.zeros_like(held)
        for change in mesh_changes:
            changed = changed + band.project(change) ** 2
        shares = np.broadcast_to(self.energy, held.shape[1:2])
        blocks = np.zeros((*held.shape, band.n_functions))
        for b, r in np.ndindex(held.shape[:2]):
            noise = np.diag(records.noise.covariance(band, b, r)).reshape(held.shape[2:])
            energy = max(np.sum(held[b, r] ** 2) - np.sum(noise), 0.0)
            error = shares[r] * energy + self.mesh * np.sum(changed[b, r])
            share = error / max(1, np.count_nonzero(noise))
            blocks[b, r] = np.where(noise > 0.0, share, 0.0)[..., None] * np.eye(band.n_functions)
        return whitener(records.noise, band, len(held), blocks)


class Counts(NamedTuple):
    """Data and effective data of each record, (n_blasts, n_receivers)."""

    data: np.ndarray
    effective: np.ndarray


@dataclass(frozen=True)
class StudentT:
    """Student-t density of each record: its error level is uncertain, theory.md (14.1).

    Parameters
    ----------
    degrees : float
        Of freedom.
    """

    degrees: float = DOUBT

    def misfit(self, chi_square, counts: Counts):
        """Return -2 ln L of each record, but for a constant."""
        n, degrees = counts.effective, self.degrees
        return (n + degrees) * np.log1p(n * chi_square / degrees)

    def weights(self, chi_square, counts: Counts):
        """Return the weights of squares that give the gradient of the misfit."""
        n, degrees = counts.effective, self.degrees
        return n / np.maximum(counts.data, 1) * (n + degrees) / (degrees + n * chi_square)


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Likelihood of the residuals of records.

    Parameters
    ----------
    records : Records
    covariance : Whitener
        Of noise and model error.
    density : StudentT
    """

    records: Records
    covariance: Whitener
    density: StudentT

    @property
    def n_data(self) -> np.ndarray:
        """Coefficients of each record that carry data, (n_blasts, n_receivers)."""
        return self.covariance.n_data_each

    @cached_property
    def n_effective(self) -> np.ndarray:
        """Effective data of each record: duration times bandwidth, (n_blasts, n_receivers)."""
        band = self.records.band
        return effective_numbers(band.restore(band.project(self.records.motion)), self.records.dt)

    @property
    def _counts(self):
        """Data and effective data of each record."""
        return Counts(self.n_data, self.n_effective)

    @property
    def noise_share(self) -> np.ndarray:
        """Share of the noise in the expected mean square."""
        return self.covariance.noise_share

    def whiten(self, motion) -> np.ndarray:
        """Return whitened coefficients (..., n_blasts, n_receivers, m) of motion in m/s."""
        if not np.size(motion):  # derivatives by no parameter
            return np.zeros((*np.shape(motion)[:-2], self.covariance.roots.shape[-1]))
        white = self.covariance.apply(motion)
        return white.reshape(*white.shape[:-2], -1)

    def residual(self, motion) -> np.ndarray:
        """Return the whitened records less a motion; see `whiten`."""
        return self.whiten(self.records.residual(motion))

    def chi_square(self, white) -> np.ndarray:
        """Return the reduced chi-square of each record, (..., n_blasts, n_receivers)."""
        return np.sum(white**2, axis=-1) / np.maximum(self.n_data, 1)

    def misfit(self, white, blasts=None):
        """Return -2 ln L of a whitened residual, of some blasts if indices are given."""
        return self.misfit_of(self.chi_square(white), blasts)

    def misfit_of(self, chi_square, blasts=None):
        """Return -2 ln L of reduced chi-squares (..., n_blasts, n_receivers)."""
        each = self.misfit_each(chi_square)
        return np.sum(each if blasts is None else each[..., list(blasts), :], axis=(-2, -1))

    def misfit_each(self, chi_square):
        """Return -2 ln L of each record of reduced chi-squares (..., n_blasts, n_receivers)."""
        return self.density.misfit(chi_square, self._counts)

    def weights(self, chi_square):
        """Return the weights of squared coefficients that give the gradient of -2 ln L."""
        return self.density.weights(chi_square, self._counts)

    def log_gain_of_larger_errors(self, chi_square) -> float:
        """Return the log Bayes factor of errors that are larger by one factor.

        Of all records, of one blast or of one receiver, each with a prior of one third, and each
        blast, receiver and factor of `LARGER` as likely as the others.
        """
        density, n = self.density, self.n_effective
        widened = [n * np.log(k) + density.misfit(chi_square / k, self._counts) for k in LARGER]
        each = np.where(self.n_data > 0, np.array(widened) - widened[0], 0.0)
        thirds = each.sum(axis=(1, 2)), each.sum(axis=2), each.sum(axis=1)
        return float(
            logsumexp([logsumexp(-0.5 * part) - np.log(3.0 * part.size) for part in thirds])
        )

    def excess(self, chi_square) -> float:
        """Return the sum of chi-squares above one: what noise and model error do not explain.

        Records below one do not compensate for others.
        """
        each = np.maximum(chi_square - 1.0, 0.0)
        return float(np.sum(each))

    def explained_share(self, before, after) -> float:
        """Return the share of all excess that is gone with other chi-squares."""
        total = self.excess(before)
        return (total - self.excess(after)) / total if total > 0.0 else 0.0


def effective_numbers(motion, dt) -> np.ndarray:
    """Return the effective data (n_blasts, n_receivers) of records: 2 B T of each component.

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
    """Return the participation number along the last axis."""
    squares = np.sum(parts**2, axis=-1)
    return np.divide(np.sum(parts, axis=-1) ** 2, squares, out=np.zeros_like(squares),
                     where=squares > 0.0)  # fmt: skip


ONSET = 0.1
# Names, with their units.
MISFITS = {"paper": "%", "waveform": "", "envelope": "", "phase": "", "lag": "s", "onset": "s"}
SIGNED = ("paper", "waveform", "lag", "onset")  # with residuals that least squares can take


@dataclass(frozen=True, eq=False)
class Misfit:
    """Misfit to records, prepared by `misfit`.

    Parameters
    ----------
    name : str
    value : function of simulated (n_blasts, n_receivers, 3, n_samples), m/s, to float
        Zero where simulation and record agree.
    residuals : function of the same to (n,) float64, or None
        Signed residuals behind ``value``, for least squares; None if there are none.
    """

    name: str
    value: Callable
    residuals: Callable | None


def misfit(name, recorded, dt, *, band=None, valid=None):
    """Prepare a misfit to records.

    Parameters
    ----------
    name : str
        ``paper``: mean absolute deviation of PPV and dominant frequency, %.
        ``envelope``, ``phase``: rms of the time-frequency misfits of the channels.
        ``lag``: rms of the lag of largest correlation of the paths, common to components, s.
        ``onset``: rms of the difference of onsets of the paths, s; the onset is when the length
        of the velocity first passes 0.1 of its peak.
    recorded : (n_blasts, n_receivers, 3, n_samples) float, m/s
    dt : float, s
    band : tuple of 2 float, Hz, optional
        To which both are filtered first.
    valid : (n_blasts, n_receivers, 3, n_samples) bool, optional
        Samples that are neither clipped nor missing; others are left out of both.

    Returns
    -------
    Misfit

    Raises
    ------
    InputError
        If the name is unknown, shapes do not fit, or no channel moves.

    Notes
    -----
    theory.md (7.3), (7.5), (7.18).
    """
    recorded = np.asarray(recorded, dtype=float)
    valid = np.ones(recorded.shape, bool) if valid is None else np.asarray(valid, dtype=bool)
    if recorded.ndim != 4 or recorded.shape[2] != 3 or valid.shape != recorded.shape:
        raise InputError(
            "misfit: recorded and valid must have shape (n_blasts, n_receivers, 3, n_samples), "
            f"got {recorded.shape} and {valid.shape}"
        )
    if name not in _MEASURES:
        raise InputError(f"misfit: must be one of {', '.join(_MEASURES)}, got {name!r}")
    paths = _paths(recorded, dt, band, valid)
    if not paths:
        raise InputError("misfit: no recorded channel moves")
    measure, compare, mean = _MEASURES[name]
    wanted = {channel: measure(path, band) for channel, path in paths.items()}

    def residuals(simulated):
        simulated = np.asarray(simulated, dtype=float)
        if simulated.shape != recorded.shape:
            raise InputError(
                f"misfit: simulated must have shape {recorded.shape}, got {simulated.shape}"
            )
        moving = np.any(np.where(valid, recorded, 0.0) != 0.0, axis=-1)
        modelled = _paths(simulated, dt, band, valid, moving)
        return np.concatenate([compare(wanted[p], measure(modelled[p], band)) for p in wanted])

    signed = residuals if name in SIGNED else None
    return Misfit(name, lambda simulated: mean(residuals(simulated)), signed)


def signed_residuals(name, recorded, dt, *, band=None) -> Callable:
    """Return the residuals of a misfit as a function of simulated motion; as `misfit`.

    Raises
    ------
    InputError
        If the misfit has no residuals.
    """
    residuals = misfit(name, recorded, dt, band=band).residuals
    if residuals is None:
        raise InputError(f"misfit {name!r}: has no residuals; take one of {', '.join(SIGNED)}")
    return residuals


def _paths(motion, dt, band, valid, moving=None):
    """Return a seismogram for each blast and receiver that has a channel that moves."""
    motion = np.where(valid, motion, 0.0)
    moving = np.any(motion != 0.0, axis=-1) if moving is None else moving
    paths = {}
    for index in np.argwhere(moving.any(axis=-1)):
        b, r = map(int, index)
        velocity = np.where(moving[b, r], motion[b, r].T, np.nan)
        path = Seismogram(velocity, dt)
        paths[b, r] = path if band is None else path.bandpassed(*band)
    return paths


def _peaks(path, band):
    """Return PPV and dominant frequency of the present components, (2 n,)."""
    frequency = dominant_frequency(path, "smoothed", band).hz
    return np.concatenate([path.ppv[path.present], frequency[path.present]])


def _deviation(wanted, modelled):
    """Return deviations in %; -100 where a simulation is zero and has no frequency."""
    return 100.0 * np.nan_to_num(modelled / wanted - 1.0, nan=-1.0)


def _transforms(path, band):
    """Return the wavelet transforms of the present components."""
    return [wavelet_transform(column, path.dt, band) for column in path.velocity.T[path.present]]


def _part(n):
    """Return the comparison of transforms by their envelope (0) or phase (1)."""
    return lambda wanted, modelled: np.array(
        [envelope_and_phase(*pair)[n] for pair in zip(wanted, modelled, strict=True)]
    )


def _late(wanted, modelled):
    """Return the lag of the simulation of a path, (1,) s; the duration if it is zero."""
    (data, dt), (model, _) = wanted, modelled
    late = lag(data, model, dt)[0]
    return np.array([late if np.isfinite(late) else dt * len(data)])


def _onset(path, _):
    """Return when the length of the velocity first passes a tenth of its peak, (1,) s."""
    length = np.linalg.norm(path.velocity[:, path.present], axis=1)
    passed = length - ONSET * length.max()
    first = int(np.argmax(passed > 0.0))
    if first == 0:
        return np.array([path.dt * (len(length) if length.max() == 0.0 else 0)])
    back = passed[first] / (passed[first] - passed[first - 1])
    return np.array([path.dt * (first - back)])


def _rms(residuals):
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(residuals**2)))


_MEASURES = {
    "paper": (_peaks, _deviation, lambda deviations: float(np.mean(np.abs(deviations)))),
    "envelope": (_transforms, _part(0), _rms),
    "phase": (_transforms, _part(1), _rms),
    "lag": (lambda path, _: (path.velocity[:, path.present], path.dt), _late, _rms),
    "onset": (_onset, lambda wanted, modelled: modelled - wanted, _rms),
}


def misfit_to(name, recorded: Seismogram, simulated: Seismogram, band=None):
    """Return the misfit of a simulated seismogram to a record over the time of both.

    Parameters
    ----------
    name : str
        Of `MISFITS` but ``waveform``: theory.md (11.1), (7.5) and (7.18).
    recorded, simulated : Seismogram
        In the same components.
    band : tuple of 2 float, Hz, optional
        To which both are filtered first.

    Returns
    -------
    float
    (n,) float64
        Its residuals; none where the misfit has none.

    Raises
    ------
    InputError
        If the two have no motion to compare.
    """
    if recorded.components != simulated.components:
        raise InputError(
            f"misfit: components differ, {', '.join(recorded.components)} in the record and "
            f"{', '.join(simulated.components)} in the simulation"
        )
    end = min(recorded.start + recorded.duration, simulated.start + simulated.duration)
    recorded = recorded.windowed(recorded.start, end)
    sampled = simulated.sampled(recorded.start, recorded.dt, len(recorded.velocity))
    data, model = (np.nan_to_num(motion.velocity).T[None, None] for motion in (recorded, sampled))
    measure = misfit(name, data, recorded.dt, band=band)
    residuals = np.zeros(0) if measure.residuals is None else measure.residuals(model)
    return measure.value(model), residuals
