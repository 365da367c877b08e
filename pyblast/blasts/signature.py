"""Signature of a single hole, closed form or recorded, and its superposition over a blast."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..errors import InputError
from ..model.half_space import explosion
from ..model.material import Material
from ..model.source import TimeFunction
from ..signals.seismogram import Seismogram, fast_length
from .blast import Blast, Firing

OVERSAMPLING = 16
MOST_SAMPLES = OVERSAMPLING * 10_000_000
FAINT = 0.01  # of a spectrum of acceleration, above which times are sampled
SAMPLES_PER_CYCLE = 12.0
SLOWEST = 1.2  # arrival of Rayleigh waves over that of S waves
Pulse = Callable[[np.ndarray], np.ndarray]  # times in s to pressures in Pa


@dataclass(frozen=True)
class CavityPulse:
    """Pressure in the cavity, ``p0 (exp(-t/decay) - exp(-t/rise))`` scaled to the peak ``p0``.

    Parameters
    ----------
    pressure : float, Pa
        Largest pressure p0.
    rise, decay : float, s
        ``0 < rise < decay``.
    """

    pressure: float
    rise: float
    decay: float

    def __post_init__(self) -> None:
        """Check the fields once."""
        if not (0.0 < self.rise < self.decay and math.isfinite(self.decay)):
            raise InputError(
                f"cavity pulse: need 0 < rise < decay, got {self.rise:g} and {self.decay:g} s"
            )
        if not math.isfinite(self.pressure):
            raise InputError(f"cavity pulse: pressure must be finite, got {self.pressure:g} Pa")

    @property
    def level(self) -> float:
        """Factor of the two exponentials that makes the largest pressure p0 [Pa]."""
        ratio = self.decay / self.rise
        peak = ratio ** (-1.0 / (ratio - 1.0)) - ratio ** (-ratio / (ratio - 1.0))
        return self.pressure / peak

    def __call__(self, times: ArrayLike) -> np.ndarray:
        """Return the pressure [Pa] at each time [s]; zero before 0 s."""
        later = np.maximum(times, 0.0)
        return self.level * (np.exp(-later / self.decay) - np.exp(-later / self.rise))


@dataclass(frozen=True)
class SmoothPulse:
    """Pressure ``p0 (x exp(1 - x))^order`` with ``x = t / peak_time``: no jump in any slope below.

    The far velocity of a small cavity then peaks at ``order / (2 pi peak_time) *
    sqrt(2 / (order - 1))`` Hz, 3 / (2 pi peak_time) for the default order 3.

    Parameters
    ----------
    pressure : float, Pa
    peak_time : float, s
    order : int
        At least 2.
    """

    pressure: float
    peak_time: float
    order: int = 3

    def __post_init__(self) -> None:
        """Check the fields once."""
        if not (0.0 < self.peak_time < math.inf and self.order >= 2):
            raise InputError(
                f"smooth pulse: need peak_time > 0 and order >= 2, got {self.peak_time:g} s "
                f"and {self.order}"
            )

    def __call__(self, times: ArrayLike) -> np.ndarray:
        """Return the pressure [Pa] at each time [s]; zero before 0 s."""
        x = np.maximum(times, 0.0) / self.peak_time
        return self.pressure * (x * np.exp(1.0 - x)) ** self.order


def cavity_signature(
    density: float,
    cp: float,
    cs: float,
    radius: float,
    pressure: float,
    distance: float,
    dt: float,
    duration: float,
    rise: float,
    decay: float,
) -> np.ndarray:
    """Return the radial velocity around a pressurised spherical cavity in full space.

    Parameters
    ----------
    density : float, kg/m3
    cp, cs : float, m/s
    radius, distance : float, m
        Of the cavity, and from its centre to the receiver (at least the radius).
    pressure, rise, decay : float, Pa and s
        See :class:`CavityPulse`.
    dt, duration : float, s
        Sampling of the result, which begins with the pressure.

    Returns
    -------
    (n_samples,) float64, m/s
        Outward positive; samples of the exact motion, not filtered (see ``cavity_seismogram``).

    Raises
    ------
    InputError
        If a value breaks these rules.

    Notes
    -----
    ``u = -f'/(c r) - f/r^2`` with ``f'' + (4 cs^2/(c a)) f' + (4 cs^2/a^2) f = -(a/rho) p`` at
    the time ``t - (r - a)/c``, c = cp: Sharpe (1942), Blake (1952). The two exponentials make f a
    sum of four, one per pole.
    """
    _check_path(density, cp, cs, radius, distance, dt, duration)
    pulse = CavityPulse(pressure, rise, decay)
    corner, ratio = 2.0 * cs / radius, cs / cp
    swing = corner * complex(-ratio, math.sqrt(1.0 - ratio**2))
    poles = np.array([-1.0 / decay, -1.0 / rise, swing, swing.conjugate()])
    gaps = poles[:, None] - poles + np.eye(4)
    drive = -(radius / density) * pulse.level * (1.0 / rise - 1.0 / decay)
    weights = drive / np.prod(gaps, axis=1)
    late = np.arange(math.floor(duration / dt + 1e-9) + 1) * dt - (distance - radius) / cp
    moving = late > 0.0
    growth = np.exp(np.outer(np.where(moving, late, 0.0), poles))
    motion = -(poles**2 / (cp * distance) + poles / distance**2)
    return np.where(moving, np.real(growth @ (weights * motion)), 0.0)


def cavity_response(
    density: float,
    cp: float,
    cs: float,
    radius: float,
    pulse: Pulse,
    distance: float,
    dt: float,
    duration: float,
) -> np.ndarray:
    """Return the radial velocity for any pressure history.

    Parameters
    ----------
    density, cp, cs, radius, distance, dt, duration : float, SI
        As for ``cavity_signature``.
    pulse : callable
        Pressure [Pa] at an array of times [s]; taken as straight lines between samples.

    Returns
    -------
    (n_samples,) float64, m/s
        Outward positive.

    Notes
    -----
    The equations of ``cavity_signature``, integrated exactly for piecewise linear pressure.
    """
    if isinstance(pulse, CavityPulse):
        return cavity_signature(
            density,
            cp,
            cs,
            radius,
            pulse.pressure,
            distance,
            dt,
            duration,
            pulse.rise,
            pulse.decay,
        )
    _check_path(density, cp, cs, radius, distance, dt, duration)
    late = np.arange(math.floor(duration / dt + 1e-9) + 1) * dt - (distance - radius) / cp
    pressure = np.where(late > 0.0, pulse(late), 0.0)
    stiffness, drag = (2.0 * cs / radius) ** 2, 4.0 * cs**2 / (cp * radius)
    matrix = np.array([[0.0, 1.0], [-stiffness, -drag]])
    system = (matrix, [[0.0], [-radius / density]], np.eye(2), np.zeros((2, 1)))
    _, state, _ = scipy.signal.lsim(system, pressure, np.arange(len(late)) * dt)
    second = -(radius / density) * pressure - drag * state[:, 1] - stiffness * state[:, 0]
    return -second / (cp * distance) - state[:, 1] / distance**2


def cavity_seismogram(
    density: float,
    cp: float,
    cs: float,
    radius: float,
    pulse: Pulse,
    *,
    source: ArrayLike,
    receiver: ArrayLike,
    dt: float,
    duration: float,
) -> Seismogram:
    """Return the seismogram of a pressurised cavity at a receiver.

    Parameters
    ----------
    density, cp, cs, radius : float, SI
    pulse : CavityPulse, SmoothPulse or any callable
        Pressure [Pa] at an array of times [s].
    source, receiver : (3,) float64, m
        East, north, up.
    dt, duration : float, s

    Returns
    -------
    Seismogram
        From the firing time; band-limited below Nyquist as a recorder would do. Full space: no
        free surface, so the motion is that inside the rock.
    """
    path = np.asarray(receiver, dtype=np.float64) - np.asarray(source, dtype=np.float64)
    distance = float(np.linalg.norm(path))
    fine = dt / OVERSAMPLING
    radial = cavity_response(density, cp, cs, radius, pulse, distance, fine, duration)
    exact = Seismogram(
        radial[:, None] * path / distance, fine, label="pressurised cavity, closed form"
    )
    return exact.resampled(dt)


def pressure_for_peak(
    density: float,
    cp: float,
    cs: float,
    radius: float,
    pulse: CavityPulse | SmoothPulse,
    distance: float,
    peak: float,
) -> CavityPulse | SmoothPulse:
    """Return the pulse with the pressure for which the velocity at ``distance`` peaks at ``peak``.

    Shape and radius stay as they are: both are assumptions, and so is the peak where it comes
    from a scaled-distance law such as ``published_laws.LAWS``.

    Parameters
    ----------
    density, cp, cs, radius, distance : float, SI
    pulse : CavityPulse or SmoothPulse
        Its pressure is replaced.
    peak : float, m/s

    Returns
    -------
    CavityPulse or SmoothPulse
    """
    smooth = isinstance(pulse, SmoothPulse)
    rise, last = (pulse.peak_time,) * 2 if smooth else (pulse.rise, pulse.decay)
    duration = (distance - radius) / cp + 5.0 * last + 10.0 * radius / cs
    unit = replace(pulse, pressure=1.0)
    dt = min(rise, radius / cs) / 50.0
    motion = cavity_response(density, cp, cs, radius, unit, distance, dt, duration)
    return replace(pulse, pressure=peak / float(np.max(np.abs(motion))))


def moment_velocity(
    moment_rate: np.ndarray, dt: float, distance: float, density: float, cp: float
) -> np.ndarray:
    """Return the radial velocity of an isotropic point source in unbounded rock.

    Parameters
    ----------
    moment_rate : (n,) float64, N m/s
    dt, distance, density, cp : float, SI

    Returns
    -------
    (n,) float64, m/s
        ``(M'/r^2 + M''/(r cp)) / (4 pi density cp^2)`` at the time r/cp later: theory.md (13.9).
    """
    slope = np.gradient(moment_rate, dt)
    size = 4.0 * math.pi * density * cp**2
    return (moment_rate / distance**2 + slope / (distance * cp)) / size


def ground_peak(rate: TimeFunction, distance: float, depth: float | None, rock: Material) -> float:
    """Return the largest component of velocity on the ground by an isotropic point source.

    Parameters
    ----------
    rate : TimeFunction
        Moment rate, N m/s.
    distance : float, m
        From the source; where it is below the depth, right above the source.
    depth : float or None, m
        Of the source under a plane free surface; None: unbounded rock.
    rock : Material

    Returns
    -------
    float, m/s

    Notes
    -----
    `half_space.explosion`. Over that in unbounded rock it is 2 only for a P wave that arrives
    upright from far: 1.5 times as much within 50 m of a charge 6 to 10 m deep.
    """
    deep = 0.0 if depth is None else depth
    away = math.sqrt(max(distance**2 - deep**2, 0.0)) if depth is not None else distance
    slope = np.abs(scipy.fft.rfft(np.diff(rate.values), 2 * len(rate.values)))
    above = np.flatnonzero(slope > FAINT * slope.max())
    highest = above[-1] / (2 * len(rate.values) * rate.dt)
    dt = max(rate.dt, 1.0 / (SAMPLES_PER_CYCLE * highest))
    first = rate.start + 0.9 * math.hypot(away, deep) / rock.cp
    last = rate.start + rate.dt * len(rate.values) + SLOWEST * math.hypot(away, deep) / rock.cs
    times = first + dt * np.arange(math.ceil((last - first) / dt) + 2)
    motion = explosion(rate, depth, np.array([away]), np.zeros(1), times, rock)
    return float(np.abs(motion).max())


def moment_for_peak(
    rate: TimeFunction, peak: float, distance: float, depth: float | None, rock: Material
) -> TimeFunction:
    """Return a moment rate times the factor for which the ground moves at a peak.

    Parameters
    ----------
    rate : TimeFunction
        Its level is replaced.
    peak : float, m/s
        Largest component of velocity.
    distance, depth, rock
        As for `ground_peak`.
    """
    return replace(rate, values=peak / ground_peak(rate, distance, depth, rock) * rate.values)


def cavity_moment(
    radius: float, pressure: float | np.ndarray, cp: float, cs: float
) -> float | np.ndarray:
    """Return the isotropic moment ``M0 = pi a^3 p0 cp^2 / cs^2`` [N m] of a lasting pressure p0."""
    return math.pi * radius**3 * pressure * (cp / cs) ** 2


def _check_path(density, cp, cs, radius, distance, dt, duration):
    """Check rock, cavity and distance."""
    for name, value in (("density", density), ("cs", cs), ("radius", radius)):
        if not 0.0 < value < math.inf:
            raise InputError(f"cavity.{name}: must be positive, got {value:g}")
    if not cs * math.sqrt(4.0 / 3.0) < cp < math.inf:
        raise InputError(f"cavity.cp: must exceed 1.155 cs = {1.1547 * cs:g} m/s, got {cp:g} m/s")
    if not distance >= radius:
        raise InputError(
            f"cavity.distance: must be at least the radius {radius:g} m, got {distance:g} m"
        )
    if not 0.0 < dt < duration < math.inf:
        raise InputError(f"cavity: need 0 < dt < duration, got {dt:g} and {duration:g} s")
    if duration > MOST_SAMPLES * dt:
        raise InputError(
            f"cavity: {duration:.3g} s by steps of {dt:.3g} s are more than {MOST_SAMPLES} "
            "samples; give a larger radius, a longer time to the peak or a shorter distance"
        )


def superpose(
    signature: Seismogram,
    firing: Firing,
    *,
    signatures: Sequence[Seismogram | None] | None = None,
    travel_shifts: ArrayLike | None = None,
    method: str = "fft",
) -> Seismogram:
    """Superpose the single-hole signature over the holes of a blast.

    Parameters
    ----------
    signature : Seismogram
        Single-hole seismogram at the place of interest, zero time at its firing.
    firing : Firing
        Times in s and scales relative to the signature hole.
    signatures : sequence of Seismogram or None, optional
        Own seismogram of each hole; None in the sequence stands for ``signature``.
    travel_shifts : (n_holes,) float64, s, optional
        Added to the firing times, see :func:`travel_shifts`.
    method : str
        "fft" multiplies spectra; "direct" adds shifted copies in time. Both use the same
        band-limited shift and agree to 1e-12 of the peak; "direct" is slow.

    Returns
    -------
    Seismogram
        From the first to the last moved sample of all holes.

    Raises
    ------
    InputError
        If lengths, samplings or components do not agree, or the method is unknown.

    Notes
    -----
    ``u = u_s * sum_i a_i delta(t - t_i)``: eq. (9) to (14) of the paper; theory.md (5.4).
    The shift is exact for motion below the Nyquist frequency that begins and ends at rest; a
    delay of whole samples moves any samples unchanged.

    Examples
    --------
    >>> pulse = Seismogram(np.hanning(21)[:, None] * [1e-3, 0.0, 0.0], 1e-3)
    >>> superpose(pulse, Firing.rows(3, 1, delay=0.05)).duration.__round__(3)
    0.12
    """
    if method not in ("fft", "direct"):
        raise InputError(f'superpose.method: must be "fft" or "direct", got {method!r}')
    own = _own_signatures(signature, signatures, len(firing.times))
    times = firing.times + _checked_shifts(travel_shifts, len(firing.times))
    delays = (times + [s.start - signature.start for s in own]) / signature.dt
    first = math.floor(np.min(delays) + 1e-9)
    delays = delays - first
    n_samples = max(
        math.ceil(delay - 1e-9) + len(s.velocity) for delay, s in zip(delays, own, strict=True)
    )
    n_padded = fast_length(2 * n_samples)
    add = _add_spectra if method == "fft" else _add_samples
    motion = add(own, delays, firing.scales, n_padded)[:n_samples]
    start = signature.start + first * signature.dt
    return replace(signature, velocity=motion, start=start, label="superposed")


def travel_shifts(
    blast: Blast, receiver: ArrayLike, speed: float, reference: ArrayLike
) -> np.ndarray:
    """Return how much later each hole's waves arrive than those of the signature hole.

    Parameters
    ----------
    blast : Blast
    receiver : (3,) float64, m
    speed : float, m/s
        Of the wave that carries the peak.
    reference : (3,) float64, m
        Place of the signature hole.

    Returns
    -------
    (n_holes,) float64, s
        ``(|centre_i - receiver| - |reference - receiver|) / speed``; negative when nearer.

    Raises
    ------
    InputError
        If the speed is not positive.
    """
    if not speed > 0.0:
        raise InputError(f"travel_shifts.speed: must be positive, got {speed:g} m/s")
    receiver = np.asarray(receiver, dtype=np.float64)
    distance = np.linalg.norm(blast.centres - receiver, axis=1)
    return (distance - np.linalg.norm(np.asarray(reference) - receiver)) / speed


def _checked_shifts(shifts, n_holes):
    """One finite travel-time shift per hole, zero where none is given."""
    if shifts is None:
        return np.zeros(n_holes)
    shifts = np.asarray(shifts, dtype=np.float64)
    if shifts.shape != (n_holes,) or not np.all(np.isfinite(shifts)):
        raise InputError(
            f"superpose.travel_shifts: need {n_holes} finite values, got shape {shifts.shape}"
        )
    return shifts


def _own_signatures(signature, signatures, n_holes):
    """One seismogram per hole, all sampled like the common one."""
    if signatures is None:
        return [signature] * n_holes
    if len(signatures) != n_holes:
        raise InputError(f"superpose.signatures: {len(signatures)} given for {n_holes} holes")
    own = [signature if s is None else s for s in signatures]
    for hole, s in enumerate(own):
        if abs(s.dt - signature.dt) > 1e-9 * signature.dt or s.components != signature.components:
            raise InputError(
                f"superpose.signatures[{hole}]: must have dt = {signature.dt:g} s and components "
                f"{signature.components}; resample or rotate it first"
            )
    return own


def _split_delay(delay):
    """Whole samples and a fraction between -0.5 and 0.5; rounding noise is no fraction."""
    whole = round(delay)
    fraction = delay - whole
    return whole, (fraction if abs(fraction) > 1e-9 else 0.0)


def _add_spectra(own, delays, scales, n_padded):
    """Add phase-turned spectra; holes that share a signature share its transform."""
    turns = np.arange(n_padded // 2 + 1)
    combs = {}
    for s, delay, scale in zip(own, delays, scales, strict=True):
        whole, fraction = _split_delay(delay)
        cycles = (turns * whole % n_padded + turns * fraction) / n_padded
        comb = combs.setdefault(id(s), (s, np.zeros(len(turns), dtype=np.complex128)))[1]
        comb += scale * np.exp(-2j * np.pi * cycles)
    spectrum = np.zeros((len(turns), 3), dtype=np.complex128)
    for s, comb in combs.values():
        spectrum += np.asarray(scipy.fft.rfft(s.velocity, n_padded, axis=0)) * comb[:, None]
    return np.asarray(scipy.fft.irfft(spectrum, n_padded, axis=0))


def _add_samples(own, delays, scales, n_padded):
    """Add shifted copies in time; a fraction of a sample by the periodic sinc."""
    motion = np.zeros((n_padded, 3))
    for s, delay, scale in zip(own, delays, scales, strict=True):
        whole, fraction = _split_delay(delay)
        copy = np.zeros((n_padded, 3))
        if fraction == 0.0:
            copy[: len(s.velocity)] = s.velocity
        else:
            kernel = _periodic_sinc(fraction, n_padded)
            for n in range(len(s.velocity)):
                copy += np.roll(kernel, n)[:, None] * s.velocity[n]
        motion += scale * np.roll(copy, whole, axis=0)
    return motion


def _periodic_sinc(fraction, n_padded):
    """Band-limited unit sample, ``fraction`` of a sample late, repeated every n_padded samples."""
    n = np.arange(n_padded)
    n = np.where(n > n_padded // 2, n - n_padded, n)
    angle = np.pi * (n - fraction) / n_padded
    period = np.tan(angle) if n_padded % 2 == 0 else np.sin(angle)
    sign = np.where(n % 2 == 0, -1.0, 1.0)
    return sign * math.sin(math.pi * fraction) / (n_padded * period)
