"""Misfits of simulated and recorded motion over blasts and receivers."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency, envelope_and_phase, lag, wavelet_transform
from .covariance import Whitener

ONSET = 0.1
# Names, with their units.
MISFITS = {"paper": "%", "waveform": "", "envelope": "", "phase": "", "lag": "s", "onset": "s"}
SIGNED = ("paper", "waveform", "lag", "onset")  # with residuals that least squares can take


@dataclass(frozen=True, eq=False)
class Misfit:
    """A misfit to records that were given to `misfit`.

    Parameters
    ----------
    name : str
    value : function of simulated (n_blasts, n_receivers, 3, n_samples), m/s, to float
        Zero where simulation and record agree.
    residuals : function of the same to (n,) float64, or None
        What ``value`` is made of, with signs, for least squares. None where there are none.
    """

    name: str
    value: Callable
    residuals: Callable | None


def misfit(name, recorded, dt, *, band=None, valid=None, whitener: Whitener | None = None):
    """Prepare a misfit to records.

    Parameters
    ----------
    name : str
        ``paper``: mean absolute deviation of PPV and dominant frequency, %.
        ``waveform``: ``r^T C^-1 r`` for each number of data, about 1 where nothing but noise and
        the errors of the theory is left; needs a whitener.
        ``envelope``, ``phase``: rms of the time-frequency misfits of the channels.
        ``lag``: rms of the lag of largest correlation of the paths, common to components, s.
        ``onset``: rms of the difference of onsets of the paths, s; the onset is when the length
        of the velocity first passes 0.1 of its peak.
    recorded : (n_blasts, n_receivers, 3, n_samples) float, m/s
    dt : float, s
    band : tuple of 2 float, Hz, optional
        To which both are filtered first; the whitener has its own.
    valid : (n_blasts, n_receivers, 3, n_samples) bool, optional
        Samples that are neither clipped nor missing; others are taken out of both. The whitener
        has its own.
    whitener : Whitener, optional

    Returns
    -------
    Misfit

    Raises
    ------
    InputError
        If the name is not known, shapes do not fit, a whitener is missing, or no channel moves.

    Notes
    -----
    theory.md (7.3), (7.5), (7.17), (7.20).
    """
    recorded = np.asarray(recorded, dtype=float)
    valid = np.ones(recorded.shape, bool) if valid is None else np.asarray(valid, dtype=bool)
    if recorded.ndim != 4 or recorded.shape[2] != 3 or valid.shape != recorded.shape:
        raise InputError(
            "misfit: recorded and valid must have shape (n_blasts, n_receivers, 3, n_samples), "
            f"got {recorded.shape} and {valid.shape}"
        )
    if name == "waveform":
        return _waveform(recorded, whitener)
    if name not in _MEASURES:
        raise InputError(f"misfit: must be waveform or {', '.join(_MEASURES)}, got {name!r}")
    paths = _paths(recorded, dt, band, valid)
    if not paths:
        raise InputError("misfit: no recorded channel moves")
    measure, compare, mean = _MEASURES[name]
    wanted = {place: measure(path, band) for place, path in paths.items()}

    def residuals(simulated):
        simulated = np.asarray(simulated, dtype=float)
        if simulated.shape != recorded.shape:
            raise InputError(
                f"misfit: simulated must have shape {recorded.shape}, got {simulated.shape}"
            )
        moving = np.any(np.where(valid, recorded, 0.0) != 0.0, axis=-1)
        found = _paths(simulated, dt, band, valid, moving)
        return np.concatenate([compare(wanted[p], measure(found[p], band)) for p in wanted])

    signed = residuals if name in SIGNED else None
    return Misfit(name, lambda simulated: mean(residuals(simulated)), signed)


def _waveform(recorded, whitener):
    """Return least squares of waveforms with the covariance of a whitener."""
    if whitener is None:
        raise InputError("misfit.waveform: needs a whitener, which says what a residual is worth")

    def residuals(simulated):
        return whitener.apply(recorded - np.asarray(simulated, dtype=float)).ravel()

    def value(simulated):
        return float(whitener.chi_square(recorded - np.asarray(simulated, dtype=float)))

    return Misfit("waveform", lambda simulated: value(simulated) / whitener.n_data, residuals)


def _paths(motion, dt, band, valid, moving=None):
    """Return a seismogram for each blast and receiver that has a channel that moves."""
    motion = np.where(valid, motion, 0.0)
    moving = np.any(motion != 0.0, axis=-1) if moving is None else moving
    paths = {}
    for place in np.argwhere(moving.any(axis=-1)):
        place = tuple(map(int, place))
        velocity = np.where(moving[place], motion[place].T, np.nan)
        path = Seismogram(velocity, dt)
        paths[place] = path if band is None else path.bandpassed(*band)
    return paths


def _peaks(path, band):
    """Return PPV and dominant frequency of the components that are there, (2 n,)."""
    frequency = dominant_frequency(path, "smoothed", band).hz
    return np.concatenate([path.ppv[path.present], frequency[path.present]])


def _deviation(wanted, found):
    """Return deviations in %; a silent simulation has no frequency: -100."""
    return 100.0 * np.nan_to_num(found / wanted - 1.0, nan=-1.0)


def _transforms(path, band):
    """Return the wavelet transforms of the components that are there."""
    return [wavelet_transform(column, path.dt, band) for column in path.velocity.T[path.present]]


def _part(n):
    """Return what compares transforms by their envelope (0) or phase (1)."""
    return lambda wanted, found: np.array(
        [envelope_and_phase(*pair)[n] for pair in zip(wanted, found, strict=True)]
    )


def _late(wanted, found):
    """Return how late the simulation of a path is, (1,) s; all the record if it is silent."""
    (data, dt), (model, _) = wanted, found
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
    "onset": (_onset, lambda wanted, found: found - wanted, _rms),
}


def misfit_to(name, recorded: Seismogram, simulated: Seismogram, band=None):
    """Return the misfit of a simulated seismogram to a record over the time of both.

    Parameters
    ----------
    name : str
        Of `residuals.misfits.MISFITS` but ``waveform``: theory.md (11.1), (7.5) and (7.20).
    recorded, simulated : Seismogram
        In the same components.
    band : tuple of 2 float, Hz, optional
        To which both are filtered first.

    Returns
    -------
    float
    (n,) float64
        Residuals that it is made of; none where the misfit has none.

    Raises
    ------
    InputError
        If the two have nothing to compare.
    """
    if recorded.components != simulated.components:
        raise InputError(
            f"misfit: components differ, {', '.join(recorded.components)} in the record and "
            f"{', '.join(simulated.components)} in the simulation"
        )
    end = min(recorded.start + recorded.duration, simulated.start + simulated.duration)
    recorded = recorded.windowed(recorded.start, end)
    found = simulated.sampled(recorded.start, recorded.dt, len(recorded.velocity))
    data, model = (np.nan_to_num(one.velocity).T[None, None] for one in (recorded, found))
    made = misfit(name, data, recorded.dt, band=band)
    return made.value(model), np.zeros(0) if made.residuals is None else made.residuals(model)
