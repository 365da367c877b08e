"""Seismograms: three components of particle velocity, recorded or simulated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..errors import InputError
from ..units import check_angle

FILTER_ORDER = 4
SAMPLES_PER_CORNER = 100.0  # of a low-passed record: 0.1 % from the continuous filter
GEOGRAPHIC = ("east", "north", "vertical")
BLAST_AXES = ("longitudinal", "transverse", "vertical")
PASS_BAND = 0.8  # of the new Nyquist frequency, kept without taper when resampling


class ZeroPhase(float):
    """Corner in Hz of a low-pass of sources that is of zero phase: theory.md (6.8), -6 dB there."""


@dataclass(frozen=True, eq=False)
class Seismogram:
    """Seismogram: three components of particle velocity at one place.

    Immutable: every method returns a new seismogram.

    Parameters
    ----------
    velocity : (n_samples, 3) float64, m/s
        Finite, or NaN throughout a component that was not recorded.
    dt : float, s
        Time between samples.
    start : float, s
        Time of the first sample; zero is the firing of the first hole.
    label : str
        Name of the receiver or station.
    components : tuple of 3 str
        ``GEOGRAPHIC`` (east, north, vertical) or ``BLAST_AXES`` (longitudinal, transverse,
        vertical).
    low_passed : float or None, Hz
        Corner of the low-pass of the sources of this motion (`lowpassed`), `ZeroPhase` where that
        is of zero phase; None without one, 0 where sources were low-passed differently.

    Raises
    ------
    InputError
        If the shape, the sampling, a sample or the names of components are invalid.

    Examples
    --------
    >>> import numpy as np
    >>> motion = Seismogram(np.array([[0.0, 0.0, 0.0], [3e-3, 4e-3, 0.0]]), dt=1e-3)
    >>> motion.ppv.tolist(), motion.pvs
    ([0.003, 0.004, 0.0], 0.005)
    """

    velocity: np.ndarray
    dt: float
    start: float = 0.0
    label: str = ""
    components: tuple[str, str, str] = GEOGRAPHIC
    low_passed: float | None = None

    def __post_init__(self) -> None:
        """Check the fields once and make the samples read-only."""
        velocity = np.array(self.velocity, dtype=np.float64, order="C")
        if velocity.ndim != 2 or velocity.shape[1] != 3 or len(velocity) < 2:
            raise InputError(
                "seismogram.velocity: must have shape (n_samples, 3) with at least 2 samples, "
                f"got {velocity.shape}"
            )
        if not (math.isfinite(self.dt) and self.dt > 0.0):
            raise InputError(f"seismogram.dt: must be positive, got {self.dt:g} s")
        if not math.isfinite(self.start):
            raise InputError(f"seismogram.start: must be finite, got {self.start:g} s")
        if len(self.components) != 3 or len(set(self.components)) != 3:
            raise InputError(f"seismogram.components: need 3 names, got {self.components}")
        _refuse_gaps(velocity, self.components)
        velocity.setflags(write=False)
        object.__setattr__(self, "velocity", velocity)
        object.__setattr__(self, "components", tuple(self.components))

    def __repr__(self) -> str:
        """Return name, sampling and peaks on one line."""
        peaks = ", ".join(f"{1e3 * peak:.3g}" for peak in self.ppv)
        return (
            f"<Seismogram {self.label!r}: {len(self.velocity)} samples of {1e3 * self.dt:.4g} ms, "
            f"PPV {peaks} mm/s ({', '.join(self.components)})>"
        )

    def to_obspy(self, time_zero: str | float = 0.0):
        """Return the recorded components as traces in m/s.

        Parameters
        ----------
        time_zero : str or float
            ISO time, or seconds since 1970, of time 0.

        Returns
        -------
        obspy.Stream
            Channels are named by the first letter of the component; the station by the label.
        """
        import obspy

        start = obspy.UTCDateTime(time_zero) + self.start
        heads = {"delta": self.dt, "starttime": start, "station": self.label}
        return obspy.Stream(
            obspy.Trace(np.array(samples), heads | {"channel": name[0].upper()})
            for name, samples in zip(self.components, self.velocity.T, strict=True)
            if not np.isnan(samples[0])
        )

    @property
    def times(self) -> np.ndarray:
        """Time of each sample, (n_samples,) s."""
        return self.start + self.dt * np.arange(len(self.velocity))

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return self.dt * (len(self.velocity) - 1)

    @property
    def present(self) -> np.ndarray:
        """Whether each component was recorded, (3,) bool."""
        return ~np.isnan(self.velocity[0])

    @property
    def ppv(self) -> np.ndarray:
        """Peak particle velocity of each component, (3,) m/s; the mean is not removed."""
        return np.max(np.abs(self.velocity), axis=0)

    @property
    def pvs(self) -> float:
        """Peak vector sum: largest length of the velocity vector at one time [m/s]."""
        return float(np.sqrt(np.max(np.sum(self.velocity[:, self.present] ** 2, axis=1))))

    def sampled(self, start: float, dt: float, n_samples: int) -> "Seismogram":
        """Resample at given times by band-limited interpolation.

        Parameters
        ----------
        start : float, s
        dt : float, s
        n_samples : int

        Returns
        -------
        Seismogram
            Zero outside the record. Where ``dt`` is longer than before, frequencies above
            0.8 of the new Nyquist frequency are tapered off to zero at Nyquist (no aliases).

        Notes
        -----
        The line through the first and last sample is subtracted and the rest expanded in a sine
        series, so that the ends do not ring.
        """
        if not (math.isfinite(dt) and dt > 0.0):
            raise InputError(f"seismogram.sampled: dt must be positive, got {dt:g} s")
        if n_samples < 2:
            raise InputError(f"seismogram.sampled: need at least 2 samples, got {n_samples}")
        times = start + dt * np.arange(n_samples) - self.start
        ramp = self.velocity[-1] - self.velocity[0]
        line = self.velocity[0] + np.outer(np.arange(len(self.velocity)), ramp) / (
            len(self.velocity) - 1
        )
        motion = _sine_series_at(self.velocity - line, self.dt, times[0], dt, n_samples)
        motion += self.velocity[0] + np.outer(times / self.duration, ramp)
        outside = (times < -1e-9 * dt) | (times > self.duration + 1e-9 * dt)
        motion[np.ix_(outside, self.present)] = 0.0
        return replace(self, velocity=motion, dt=dt, start=start)

    def resampled(self, dt: float) -> "Seismogram":
        """Change the sampling interval without aliasing; the start time stays."""
        if not (math.isfinite(dt) and dt > 0.0):
            raise InputError(f"seismogram.resampled: dt must be positive, got {dt:g} s")
        return self.sampled(self.start, dt, math.floor(self.duration / dt + 1e-9) + 1)

    def lowpassed(self, hz: float, *, of_source: bool = False) -> "Seismogram":
        """Low-pass filter at ``hz``, without phase shift or forward only.

        Butterworth of order 4, forward and backward: amplitude 1/(1 + (f/hz)^8), which is
        -6 dB at ``hz`` and -3 dB at 0.896 ``hz``. ``of_source``, unless ``hz`` is `ZeroPhase`:
        Bessel of order 4, forward only, -3 dB at ``hz``, for what a source does: a step overshoots
        by 1 %, and the delay of the filter, 0.336 / ``hz`` at all frequencies it passes, is taken
        back by an earlier start.
        """
        if not of_source:
            return self._filtered("lowpass", hz)
        if isinstance(hz, ZeroPhase):
            return replace(self._filtered("lowpass", hz), low_passed=hz)
        self._check_corners(hz)
        sections = scipy.signal.bessel(FILTER_ORDER, hz, norm="mag", fs=1.0 / self.dt, output="sos")
        passed = scipy.signal.sosfilt(sections, self.velocity, axis=0)
        start = self.start - self.dt * _delay_of(sections)
        return replace(self, velocity=passed, start=start, low_passed=hz)

    def filtered_like(self, corner: float | None) -> "Seismogram":
        """Return a record as it is beside motion whose sources were low-passed at a corner in Hz.

        A record goes through the same low-pass, as if its first sample had lasted, between its
        samples where these are few. Motion that has gone through it stays.

        Raises
        ------
        InputError
            If this motion has gone through another one.
        """
        alike = isinstance(corner, ZeroPhase) == isinstance(self.low_passed, ZeroPhase)
        if alike and corner == self.low_passed and corner != 0.0:
            return self
        both = corner and self.low_passed
        if alike and both and math.isclose(corner, self.low_passed, rel_tol=1e-6):
            return self  # a file has nine digits
        if 0.0 in (corner, self.low_passed):
            raise InputError(
                f"{self.label or 'record'}: can't be set beside simulated motion some of whose "
                "sources were low-passed and others not; give low_pass_hz so that none is"
            )
        if self.low_passed is not None:
            other = "not low-passed" if corner is None else f"low-passed at {corner:g} Hz"
            raise InputError(
                f"{self.label or 'record'}: its sources were low-passed at "
                f"{self.low_passed:g} Hz, those of the motion beside it were {other}; give both "
                "the same low_pass_hz and zero_phase"
            )
        assert corner is not None  # else alike
        finer, n = max(1, math.ceil(SAMPLES_PER_CORNER * corner * self.dt)), len(self.velocity)
        fine, first = replace(self, velocity=self.velocity - self.velocity[0]), self.velocity[0]
        fine = fine.sampled(self.start, self.dt / finer, (n - 1) * finer + 1)
        passed = fine.lowpassed(corner, of_source=True)
        moved = passed.velocity[::finer] + first
        return replace(self, velocity=moved, start=passed.start, low_passed=corner)

    def bandpassed(self, low: float, high: float) -> "Seismogram":
        """Band-pass filter, ``low`` to ``high`` Hz, without phase shift; -6 dB at both corners."""
        if not low < high:
            raise InputError(f"seismogram.bandpassed: need low < high, got {low:g}, {high:g} Hz")
        return self._filtered("bandpass", low, high)

    def _filtered(self, kind, *corners):
        """Filter forward and backward, the ends extended by three cycles of the lowest corner."""
        self._check_corners(*corners)
        sections = scipy.signal.butter(
            FILTER_ORDER,
            corners[0] if kind == "lowpass" else corners,
            kind,
            fs=1.0 / self.dt,
            output="sos",
        )
        padding = min(len(self.velocity) - 1, math.ceil(3.0 / (min(corners) * self.dt)))
        filtered = scipy.signal.sosfiltfilt(sections, self.velocity, axis=0, padlen=padding)
        return replace(self, velocity=filtered)

    def _check_corners(self, *corners):
        """Refuse corners in Hz beyond the Nyquist frequency."""
        nyquist = 0.5 / self.dt
        if not 0.0 < min(corners) <= max(corners) < nyquist:
            raise InputError(
                f"seismogram filter: corners must lie between 0 and the Nyquist frequency "
                f"{nyquist:g} Hz, got {', '.join(f'{c:g}' for c in corners)} Hz"
            )

    def along(self, normal: Sequence[float]) -> "Seismogram":
        """Return what of a motion along east, north and vertical lies along a unit vector (3,).

        A component across the vector is zero, one that was not recorded does not count there.
        """
        unit = np.asarray(normal, dtype=float)
        along = np.where(unit == 0.0, 0.0, self.velocity) @ unit
        return replace(self, velocity=np.outer(along, unit))

    def rotated(self, azimuth: float) -> "Seismogram":
        """Rotate the horizontal components: east, north to longitudinal, transverse, or back.

        Parameters
        ----------
        azimuth : float, rad
            Direction of the longitudinal axis, clockwise from north; the transverse axis lies
            90 degrees clockwise of it. The rotation is its own inverse.

        Raises
        ------
        InputError
            If the components have other names, or the azimuth is in degrees.
        """
        names = {GEOGRAPHIC: BLAST_AXES, BLAST_AXES: GEOGRAPHIC}.get(self.components)
        if names is None:
            raise InputError(
                f"seismogram.rotated: components must be {GEOGRAPHIC} or {BLAST_AXES}, "
                f"got {self.components}"
            )
        check_angle("seismogram.rotated: azimuth", azimuth)
        east, north, vertical = self.velocity.T
        sine, cosine = math.sin(azimuth), math.cos(azimuth)
        turned = np.column_stack(
            [sine * east + cosine * north, cosine * east - sine * north, vertical]
        )
        return replace(self, velocity=turned, components=names)

    def windowed(self, t0: float, t1: float) -> "Seismogram":
        """Cut out the samples from ``t0`` to ``t1`` [s], both included."""
        inside = (self.times >= t0 - 1e-9 * self.dt) & (self.times <= t1 + 1e-9 * self.dt)
        if np.count_nonzero(inside) < 2:
            raise InputError(
                f"seismogram.windowed: {t0:g} to {t1:g} s holds fewer than 2 samples of a record "
                f"from {self.start:g} to {self.start + self.duration:g} s"
            )
        return replace(self, velocity=self.velocity[inside], start=float(self.times[inside][0]))

    def shifted(self, seconds: float) -> "Seismogram":
        """Shift the start by ``seconds``; the samples are unchanged."""
        return replace(self, start=self.start + seconds)


class Named(dict):
    """Dict whose missing keys are answered with the keys that are there."""

    def __missing__(self, key):
        """Raise KeyError that lists the keys."""
        raise KeyError(f"no {key!r}; there are {', '.join(map(repr, self)) or 'none'}")


def fast_length(n_samples: int) -> int:
    """Return the next length from ``n_samples`` on for which real Fourier transforms are fast."""
    return scipy.fft.next_fast_len(n_samples, real=True)  # type: ignore[return-value]


def _refuse_gaps(velocity, components):
    """Raise InputError for infinite samples, gaps and records without any component."""
    missing = np.all(np.isnan(velocity), axis=0)
    if np.all(missing):
        raise InputError("seismogram.velocity: every component is missing")
    for name, column in zip(np.array(components)[~missing], velocity[:, ~missing].T, strict=True):
        wrong = np.flatnonzero(~np.isfinite(column))
        if len(wrong):
            raise InputError(
                f"seismogram.velocity: component {name} must be finite (or NaN throughout), got "
                f"{column[wrong[0]]:g} at sample {wrong[0]}"
            )


def _delay_of(sections):
    """Return the group delay of second-order sections (n, 6) at 0 Hz, in samples."""
    number = np.arange(3.0)
    zeros, poles = sections[:, :3], sections[:, 3:]
    late = zeros @ number / zeros.sum(axis=1) - poles @ number / poles.sum(axis=1)
    return float(late.sum())


def _sine_series_at(motion, dt, first, new_dt, n_samples):
    """Evaluate the sine series of motion, zero at both ends, at ``first + m*new_dt``."""
    n_waves = len(motion) - 2
    if n_waves < 1:
        return np.zeros((n_samples, 3)) + 0.0 * motion[0]
    duration = dt * (len(motion) - 1)
    waves = np.arange(1, n_waves + 1)
    amplitude = np.asarray(scipy.fft.dst(motion[1:-1], type=1, axis=0)) / (n_waves + 1)
    if new_dt > dt:
        nyquist = 0.5 / new_dt
        above = (waves / (2.0 * duration) / nyquist - PASS_BAND) / (1.0 - PASS_BAND)
        taper = 0.5 + 0.5 * np.cos(np.pi * np.clip(above, 0.0, 1.0))
        amplitude = amplitude * taper[:, None]
    turn = np.pi * new_dt / duration
    amplitude = amplitude * np.exp(1j * np.pi * waves * first / duration)[:, None]
    series = scipy.signal.czt(amplitude, n_samples, w=np.exp(1j * turn), a=1.0, axis=0)
    return np.imag(series * np.exp(1j * turn * np.arange(n_samples))[:, None])
