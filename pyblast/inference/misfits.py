"""Misfits: how far simulated motion is from records."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..signals.seismogram import Seismogram
from ..signals.spectra import dominant_frequency, envelope_and_phase, lag, wavelet_transform

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
