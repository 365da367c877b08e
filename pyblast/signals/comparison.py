"""Comparison of motion: recorded against simulated, and peaks against limit curves."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..units import to_si
from .seismogram import Seismogram
from .spectra import (
    dominant_frequency,
    envelope_and_phase,
    lag,
    significant_duration,
    smoothed_spectrum,
    wavelet_transform,
)

SILENT = 1e-6  # fraction of the largest spectral amplitude below which there is no signal


@dataclass(frozen=True, eq=False)
class Comparison:
    """Comparison of a simulated seismogram with the recorded one, per component.

    Every (3,) array is NaN where a component is missing in either or silent in the record.
    Deviations are ``simulated / recorded - 1``.

    Attributes
    ----------
    components : tuple of 3 str
    ppv_deviation, frequency_deviation, duration_deviation : (3,) float64
    waveform_misfit : (3,) float64
        ``sum (d - s)^2 / sum d^2``.
    residual_energy, recorded_energy : (3,) float64
        The two sums, m2/s2.
    lag, correlation : (3,) float64
        Lag [s] of the largest cross-correlation, positive where the simulation is late, and the
        correlation at that lag.
    envelope_misfit, phase_misfit : (3,) float64
        Time-frequency misfits of Kristekova et al. (2009); NaN if not requested.
    frequency : (n,) float64, Hz
    spectral_ratio : (n, 3) float64
        Smoothed simulated over smoothed recorded amplitude; NaN where the recorded amplitude is
        below 1e-6 of its maximum.
    band : tuple of 2 float, Hz, or None
        Pass band of the filter applied to both.
    frequency_method : str
        Definition of the dominant frequency: "smoothed", "multitaper" or "raw".
    """

    components: tuple[str, str, str]
    ppv_deviation: np.ndarray
    frequency_deviation: np.ndarray
    duration_deviation: np.ndarray
    residual_energy: np.ndarray
    recorded_energy: np.ndarray
    lag: np.ndarray
    correlation: np.ndarray
    envelope_misfit: np.ndarray
    phase_misfit: np.ndarray
    frequency: np.ndarray
    spectral_ratio: np.ndarray
    band: tuple[float, float] | None
    frequency_method: str

    def __repr__(self) -> str:
        """Return the deviations of PPV on one line."""
        parts = zip(self.components, self.ppv_deviation, strict=True)
        listed = ", ".join(f"{name} {100.0 * value:+.0f} %" for name, value in parts)
        return f"<Comparison: PPV {listed}; mean deviation {self.misfit:.0f} %>"

    @property
    def waveform_misfit(self) -> np.ndarray:
        """Residual over recorded energy of each component, (3,)."""
        return _ratio(self.residual_energy, self.recorded_energy)

    @property
    def total_waveform_misfit(self) -> float:
        """Residual over recorded energy of all compared components together."""
        compared = ~np.isnan(self.residual_energy)
        energy = np.sum(self.recorded_energy[compared])
        return float(np.sum(self.residual_energy[compared]) / energy)

    @property
    def misfit(self) -> float:
        """Mean absolute deviation of PPV and dominant frequency over the components, percent.

        With three components this is the cost C of paper.md section 3.
        """
        deviations = np.abs(np.concatenate([self.ppv_deviation, self.frequency_deviation]))
        return 100.0 * float(np.mean(deviations[~np.isnan(deviations)]))


def compare(
    recorded: Seismogram,
    simulated: Seismogram,
    band: tuple[float, float] | None = None,
    *,
    frequency_method: str = "smoothed",
    time_frequency: bool = True,
) -> Comparison:
    """Compare a recorded and a simulated seismogram of one receiver.

    Parameters
    ----------
    recorded, simulated : Seismogram
        The simulation is interpolated (band-limited) at the times of the record. It is zero before
        its start; the comparison ends with the shorter of the two. Where the sources of one were
        low-passed, the other goes through the same filter first.
    band : tuple of 2 float, Hz, optional
        Both are first band-passed without phase shift.
    frequency_method : str
        Definition of the dominant frequency, see ``dominant_frequency``.
    time_frequency : bool
        Whether to compute envelope and phase misfits, which takes most of the time.

    Returns
    -------
    Comparison

    Raises
    ------
    InputError
        If components differ, none is in both, the record is silent or the times do not overlap.

    Notes
    -----
    Waveform misfit ``sum (d - s)^2 / sum d^2``; theory.md (7.1) to (7.5). Envelope and phase
    misfit: Kristekova et al. (2009).

    Examples
    --------
    >>> import numpy as np
    >>> times = np.arange(0.0, 1.0, 1e-3)
    >>> pulse = np.exp(-((times - 0.5) ** 2) / 1e-3)[:, None] * [1.0, 0.5, 0.2]
    >>> recorded, simulated = Seismogram(pulse, 1e-3), Seismogram(0.9 * pulse, 1e-3)
    >>> compare(recorded, simulated).ppv_deviation.round(3).tolist()
    [-0.1, -0.1, -0.1]
    """
    recorded, simulated = in_common(recorded, simulated, band)
    compared = recorded.present & simulated.present & np.any(recorded.velocity != 0.0, axis=0)
    if not np.any(compared):
        raise InputError("compare: no component with motion is present in both seismograms")
    data, model = (np.where(compared, s.velocity, np.nan) for s in (recorded, simulated))
    hz_simulated, hz_recorded = (
        dominant_frequency(s, frequency_method, band).hz for s in (simulated, recorded)
    )
    durations = significant_duration(simulated), significant_duration(recorded)
    pairs = zip(data.T, model.T, strict=True)
    lags, correlation = np.transpose([lag(d[:, None], m[:, None], recorded.dt) for d, m in pairs])
    envelope, phase = np.full((2, 3), np.nan)
    for n in np.flatnonzero(compared & time_frequency):
        transforms = (wavelet_transform(each[:, n], recorded.dt, band) for each in (data, model))
        envelope[n], phase[n] = envelope_and_phase(*transforms)
    frequency, ratio = _spectral_ratio(recorded, simulated)
    return Comparison(
        components=recorded.components,
        ppv_deviation=_ratio(np.max(np.abs(model), axis=0), np.max(np.abs(data), axis=0)) - 1.0,
        frequency_deviation=np.where(compared, _ratio(hz_simulated, hz_recorded) - 1.0, np.nan),
        duration_deviation=np.where(compared, _ratio(*durations) - 1.0, np.nan),
        residual_energy=np.sum((data - model) ** 2, axis=0),
        recorded_energy=np.sum(data**2, axis=0),
        lag=lags,
        correlation=correlation,
        envelope_misfit=envelope,
        phase_misfit=phase,
        frequency=frequency,
        spectral_ratio=ratio,
        band=band,
        frequency_method=frequency_method,
    )


def _spectral_ratio(recorded, simulated):
    """Frequencies and smoothed simulated over smoothed recorded amplitude."""
    spectrum = smoothed_spectrum(recorded)
    floor = SILENT * np.max(spectrum.amplitude, axis=0)
    level = np.where(spectrum.amplitude > floor, spectrum.amplitude, np.nan)
    return spectrum.frequency, smoothed_spectrum(simulated).amplitude / level


def _ratio(top, bottom):
    """Divide; NaN where the divisor is zero."""
    safe = np.where(bottom == 0.0, np.nan, bottom)
    return top / safe


def in_common(
    recorded: Seismogram, simulated: Seismogram, band: tuple[float, float] | None = None
) -> tuple[Seismogram, Seismogram]:
    """Return both seismograms at the times of the record, up to the earlier end, in a band.

    Both have then gone through the low-pass of the sources of either, see
    `Seismogram.filtered_like`.

    Raises
    ------
    InputError
        If components differ or the times do not overlap.
    """
    if recorded.components != simulated.components:
        raise InputError(
            f"compare: components differ, {recorded.components} recorded against "
            f"{simulated.components} simulated; rotate one"
        )
    if simulated.low_passed is None:
        simulated = simulated.filtered_like(recorded.low_passed)
    recorded = recorded.filtered_like(simulated.low_passed)
    end = min(recorded.start + recorded.duration, simulated.start + simulated.duration)
    if end - max(recorded.start, simulated.start) < 2.0 * recorded.dt:
        raise InputError(
            f"compare: no common time, recorded from {recorded.start:g} s and simulated "
            f"{simulated.start:g} to {simulated.start + simulated.duration:g} s"
        )
    recorded = recorded.windowed(recorded.start, end)
    same = (
        len(simulated.velocity) == len(recorded.velocity)
        and abs(simulated.dt - recorded.dt) < 1e-9 * recorded.dt
        and abs(simulated.start - recorded.start) < 1e-9 * recorded.dt
    )
    if not same:
        simulated = simulated.sampled(recorded.start, recorded.dt, len(recorded.velocity))
    if band is not None:
        recorded, simulated = recorded.bandpassed(*band), simulated.bandpassed(*band)
    return recorded, simulated


GROUND = "ground"
BUILDING = "foundation", "floors", "top floor"  # places that no free ground is
PLACES = GROUND, "rock", *BUILDING
INTERPOLATIONS = ("log-log", "linear")
QUANTITIES = ("peak component", "vertical component", "horizontal component", "vector sum")


@dataclass(frozen=True, eq=False)
class LimitCurve:
    """Limit of particle velocity as a function of frequency.

    Parameters
    ----------
    name, source : str
    verified : bool
        Whether a named person compared the numbers with the standard itself; if not, reports say
        so in a footnote.
    quantity : str
        What the limit applies to: "peak component", "vector sum", ...
    corners : (n_corners, 2) float64, Hz and m/s
        Rising frequency; a step has two corners at one frequency.
    interpolation : str
        "log-log" or "linear" between corners.
    note : str
    applies_to : str
        Where the limit applies: "ground", "rock", or of a building "foundation", "floors", "top
        floor".

    Raises
    ------
    InputError
        If the corners do not rise, a limit is not positive or a name is unknown.
    """

    name: str
    source: str
    verified: bool
    quantity: str
    corners: np.ndarray
    interpolation: str = "linear"
    note: str = ""
    applies_to: str = GROUND

    def __post_init__(self) -> None:
        """Check the fields once."""
        corners = np.array(self.corners, dtype=np.float64)
        where = f"limit curve {self.name!r}"
        if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) == 0:
            raise InputError(f"{where}: corners need shape (n, 2), got {corners.shape}")
        if not np.all(corners > 0.0) or not np.all(np.isfinite(corners)):
            raise InputError(f"{where}: frequencies and limits must be positive")
        if np.any(np.diff(corners[:, 0]) < 0.0):
            raise InputError(f"{where}: frequencies must rise")
        if self.interpolation not in INTERPOLATIONS:
            raise InputError(f"{where}: interpolation is one of {INTERPOLATIONS}")
        if self.applies_to not in PLACES:
            raise InputError(f"{where}: applies_to is one of {PLACES}, got {self.applies_to!r}")
        if self.quantity not in QUANTITIES:
            raise InputError(f"{where}: quantity is one of {QUANTITIES}, got {self.quantity!r}")
        corners.setflags(write=False)
        object.__setattr__(self, "corners", corners)

    def limit(self, frequency: ArrayLike) -> np.ndarray:
        """Return the limit at each frequency.

        Parameters
        ----------
        frequency : float or array, Hz

        Returns
        -------
        array of float64, m/s
            NaN below the first corner, where the curve is undefined; the last value above the
            last corner. At a step the lower of the two values.
        """
        frequency = np.asarray(frequency, dtype=np.float64)
        values = np.minimum(self._from(frequency, "left"), self._from(frequency, "right"))
        return np.where(frequency < self.corners[0, 0], np.nan, values)

    def _from(self, frequency, side):
        """Interpolate in the segment that ends ("left") or begins ("right") at a corner."""
        hz, limit = self.corners.T
        if len(hz) == 1:
            return np.full(frequency.shape, limit[0])
        segment = np.clip(np.searchsorted(hz, frequency, side=side) - 1, 0, len(hz) - 2)
        ends = hz[segment], hz[segment + 1], limit[segment], limit[segment + 1]
        x = np.clip(frequency, hz[0], hz[-1])
        if self.interpolation == "log-log":
            x, *ends = np.log(x), *np.log(ends)
        start, stop, low, high = ends
        width = np.where(stop > start, stop - start, 1.0)
        value = low + (high - low) * np.where(stop > start, (x - start) / width, 1.0)
        return np.exp(value) if self.interpolation == "log-log" else value


def load_limits() -> dict[str, LimitCurve]:
    """Load the limit curves that come with pyblast.

    Returns
    -------
    dict of str to LimitCurve
        By key ("usbm_plaster", "din_4150_dwelling", ...), all with ``verified`` false.

    Examples
    --------
    >>> curve = load_limits()["usbm_plaster"]
    >>> curve.verified
    False
    """
    return dict(_limits())


@cache
def _limits():
    """Return the limit curves, read once."""
    text = resources.files("pyblast.signals").joinpath("limits.toml").read_text(encoding="utf-8")
    return {key: _curve(entry) for key, entry in tomllib.loads(text).items()}


def _curve(entry):
    """Return the curve of one entry of the data file, in SI."""
    keys = ("frequency_hz", "limit_mm_per_s")
    columns = [to_si(key, entry.pop(key))[1] for key in keys]
    return LimitCurve(corners=np.array(columns).T, **entry)
