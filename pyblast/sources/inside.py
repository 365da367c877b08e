"""Sources inside the ground or on it: their time functions and frequencies, in SI units."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..blasts.blast import Blast, Firing
from ..blasts.published_laws import BY_NAME, HARD_ROCK
from ..blasts.signature import SmoothPulse, cavity_moment, moment_for_peak, superpose
from ..config.config import Config
from ..errors import InputError, named_error
from ..model.material import Material
from ..model.source import TimeFunction
from ..signals.seismogram import Seismogram, ZeroPhase, fast_length
from ..signals.spectra import highest_frequency
from ..units import to_si

QUIET_CYCLES = 3.0
STEP_DOWN = 0.95  # between low-passes that are tried
NEARLY = 0.95  # of the top of a band, from which on a mesh carries it
LOW = 0.05  # of the energy, below the lowest frequency that a layer absorbs
MOST = 2.0  # default frequency of a mesh, over that below which 95 % of the energy lies
# Phase error in rad of the frequency for which hexahedra are made with an error of 1 %, after three
# wavelengths; the power of frequency with which it grows; where nothing of the phase is left.
PHASE, POWER, LOST = 0.08, 7.5, 0.5 * math.pi
ALONG = 0.7, 0.64  # phase of waves along a free surface, and its power of that growth
SAMPLES_PER_DURATION = 100
DURATIONS = 8
SAMPLES_PER_PEAK_TIME = 200
PEAK_TIMES = 10
SMOOTH = 8  # order of a pulse that is given by its frequency
FREQUENCY = 20.0  # Hz, of a hole without one
SHALLOWEST = 0.5  # m, depth of a charge at least


@dataclass(frozen=True, eq=False)
class Inside:
    """Sources inside or on the model, beside the input face; zero time is the first firing.

    Parameters
    ----------
    moment_rate : TimeFunction or None
        Of 1 kg, N m/s, from when its hole fires; None without holes inside.
    forces : tuple of TimeFunction
        N, one for each point force.
    tensors : tuple of TimeFunction
        N m/s, one for each moment tensor.
    pressures : tuple of TimeFunction
        Pa, one for each pressure on a surface.
    air_pulse : TimeFunction or None
        Pa, at the reference distance after its arrival there.
    low_pass : float or None, Hz
        Of the moment rate, where one was taken.
    unfiltered : TimeFunction or None
        Moment rate before that low-pass.
    """

    moment_rate: TimeFunction | None
    forces: tuple[TimeFunction, ...] = ()
    tensors: tuple[TimeFunction, ...] = ()
    pressures: tuple[TimeFunction, ...] = ()
    air_pulse: TimeFunction | None = None
    low_pass: float | None = None
    unfiltered: TimeFunction | None = None

    @property
    def named(self) -> dict[str, TimeFunction]:
        """Time functions of all sources by name."""
        several = {"force": self.forces, "tensor": self.tensors, "pressure": self.pressures}
        single = {"moment_rate": self.moment_rate, "air_blast": self.air_pulse}
        return {
            **{
                f"{name}_{n + 1}": function
                for name in several
                for n, function in enumerate(several[name])
            },
            **{name: function for name, function in single.items() if function is not None},
        }

    @property
    def lowest(self) -> float | None:
        """Frequency in Hz above which 95 % of the energy of each hole, force or tensor lies."""
        rate = () if self.moment_rate is None else (self.moment_rate,)
        motions = [radiated(each) for each in (*rate, *self.forces, *self.tensors)]
        least = [0.25 / (each.dt * len(each.velocity)) for each in motions]  # that spectra resolve
        lows = (highest_frequency(motion, LOW) for motion in motions)
        return min(map(max, lows, least), default=None)

    def start(self, first: float) -> float:
        """Return the earliest start of a source where the first hole fires, s, at most 0."""
        starts = [
            0.0,
            *(function.start for function in (*self.forces, *self.tensors, *self.pressures)),
        ]
        for history in (self.moment_rate, self.air_pulse):
            if history is not None:
                starts += [first, first + history.start]
        return min(starts)

    def motions(self, firing: Firing) -> tuple[Seismogram, ...]:
        """Return far-field wave shapes of all holes and of each other source, for their spectra."""
        fired = []
        if self.moment_rate is not None:
            fired.append(radiated(self.moment_rate))
        if self.air_pulse is not None:
            fired.append(shape(self.air_pulse, self.air_pulse.values))
        return (
            *(superpose(function, firing) for function in fired),
            *(radiated(function) for function in (*self.forces, *self.tensors)),
            *(shape(function, function.values) for function in self.pressures),
        )


def make_inside(
    config: Config,
    blast: Blast | None,
    materials: dict[str, Material],
    carried: Callable[[], float],
    read: Callable[[str, str], TimeFunction],
) -> Inside:
    """Return the time functions of all sources of a project file.

    Parameters
    ----------
    config : Config
    blast : Blast or None
    materials : dict of str to Material
    carried : callable
        Returns the frequency in Hz that the mesh carries around the holes.
    read : callable
        Takes a file and the name of its column, returns the `TimeFunction`.

    Raises
    ------
    InputError, ReadError
        If a file can't be read, or a level has no distance.
    """
    rate = air = corner = whole = None
    if config.holes_inside is not None:
        hole, file = config.holes_inside.charged_hole, config.holes_inside.moment_rate_file
        with named_error("holes_inside"):
            if file is not None:
                whole = read(file, "moment_rate_per_kg")
            else:
                away = math.nan if hole.pressure_mpa is not None else level_distance(config, blast)
                whole = make_moment_rate(
                    hole, config.blast.charge_exponent, materials, away, charge_depth(config, blast)
                )
            low_pass = config.holes_inside.low_pass_hz or ("none" if hole is None else "mesh")
            zero_phase = config.holes_inside.zero_phase
            rate, corner = within_band(whole, low_pass, carried, zero_phase)
    if config.air_blast is not None:
        file = config.air_blast.file
        air = make_air_pulse(config.air_blast) if file is None else read(file, "pressure")
    forces, tensors, pressures = (
        tuple(read(part.file, name) for part in parts)
        for parts, name in (
            (config.point_forces, "force"),
            (config.moment_tensors, "moment_rate"),
            (config.pressures, "pressure"),
        )
    )
    before = None if corner is None else whole
    return Inside(rate, forces, tensors, pressures, air, corner, before)


def make_moment_rate(hole, exponent, materials, distance=math.nan, depth=None) -> TimeFunction:
    """Turn a `ChargedHoleConfig` into the moment rate of 1 kg, N m/s, with all its frequencies.

    Parameters
    ----------
    hole : ChargedHoleConfig
    exponent : float
        Of the charge; takes the moment of the charged hole back to 1 kg.
    materials : dict of str to Material
    distance : float, m, optional
        Where a law sets the level of a charged hole without distance_m.
    depth : float, m, optional
        Of the charge under a free surface; None: unbounded rock.

    Notes
    -----
    ``M = pi a^3 p(t) cp^2/cs^2``, right for waves much longer than the cavity: theory.md (5.2).
    A peak on the ground is that of a half-space, `ground_peak`. A law or a peak is one of motion
    with all its frequencies, so it sets the level before any low-pass.
    """
    if hole.material not in materials:
        raise InputError(
            f"charged_hole.material: must be one of {', '.join(materials)}, got {hole.material!r}"
        )
    rock, unit = materials[hole.material], unit_rate(hole, materials[hole.material])
    if hole.pressure_mpa is not None:
        unit = replace(unit, values=to_si("pressure_mpa", hole.pressure_mpa)[1] * unit.values)
    else:
        away = float(hole.distance_m or distance)
        unit = moment_for_peak(unit, level_peak(hole, away), away, depth, rock)
    return replace(unit, values=unit.values / hole.charge_kg**exponent)


def unit_rate(hole, rock):
    """Return the moment rate of a `ChargedHoleConfig` at a pressure of 1 Pa."""
    pulse = hole_pulse(hole)
    dt = pulse.peak_time / SAMPLES_PER_PEAK_TIME
    pressure = pulse(dt * np.arange(PEAK_TIMES * SAMPLES_PER_PEAK_TIME + 1))
    moment = cavity_moment(hole.radius_m, pressure, rock.cp, rock.cs)
    return TimeFunction(np.gradient(moment, dt), dt)


def hole_pulse(hole) -> SmoothPulse:
    """Return the pulse of a `ChargedHoleConfig`, of 1 Pa; theory.md (5.2).

    One of a frequency has little above twice of it: quarry blasts are recorded at mostly 10 to 40
    Hz (Siskind and others 1980, RI 8507; not checked against it), `FREQUENCY` is their middle.
    """
    if hole.peak_time_ms is not None:
        return SmoothPulse(1.0, to_si("peak_time_ms", hole.peak_time_ms)[1])
    cycle = 2.0 * math.pi * (hole.frequency_hz or FREQUENCY)
    return SmoothPulse(1.0, SMOOTH / cycle * math.sqrt(2.0 / (SMOOTH - 1)), SMOOTH)


def level_peak(hole, distance) -> float:
    """Return the peak velocity in m/s at a distance in m by the level of a charged hole."""
    if hole.peak_mm_per_s is not None:
        return to_si("peak_mm_per_s", hole.peak_mm_per_s)[1]
    law = hole.site_law or BY_NAME[hole.law or HARD_ROCK.name]
    return law.ppv(distance, hole.charge_kg)


def make_air_pulse(config) -> TimeFunction:
    """Turn an `AirBlastConfig` into the overpressure in Pa at the reference distance.

    Notes
    -----
    ``p = P (1 - t/T) exp(-t/T)``, Friedlander (1946): theory.md (5.12).
    """
    duration = to_si("duration_ms", config.duration_ms)[1]
    share = np.arange(DURATIONS * SAMPLES_PER_DURATION + 1) / SAMPLES_PER_DURATION
    peak = to_si("pressure_kpa", config.pressure_kpa)[1]
    return TimeFunction(peak * (1.0 - share) * np.exp(-share), duration / SAMPLES_PER_DURATION)


def level_distance(config, blast) -> float:
    """Return where a law sets the level of the charged hole of a `Config`, in m.

    The geometric mean of the distances from the middle of the charges to the receivers, unless
    distance_m is given; receivers without height stand as high as the mean collar.
    """
    hole = config.holes_inside.charged_hole
    if hole is not None and hole.distance_m is not None:
        return hole.distance_m
    middle, top = blast.centres.mean(axis=0), float(blast.collar[:, 2].mean())
    away = [math.dist([*part.position_m, top][:3], middle) for part in config.receivers]
    if not away or min(away) <= 0.0:
        raise InputError(
            "charged_hole.distance_m: missing, and no distance to receivers stands for it"
        )
    return float(np.exp(np.mean(np.log(away))))


def charge_depth(config, blast) -> float | None:
    """Return the mean depth in m of charges below their collars; None where no surface is free."""
    if "top" in config.boundaries.viscous:
        return None
    return float(np.maximum(blast.collar[:, 2] - blast.centres[:, 2], SHALLOWEST).mean())


def radiated(function) -> Seismogram:
    """Return the far-field wave shape: the time derivative of a moment rate or force."""
    return shape(function, np.gradient(function.values, function.dt))


def shape(function, values) -> Seismogram:
    """Return values (n,) at the times of a function as a seismogram of one component."""
    missing = np.full_like(values, np.nan)
    return Seismogram(np.column_stack([values, missing, missing]), function.dt, function.start)


def with_quiet_ends(motion, corner) -> Seismogram:
    """Add some cycles of silence, in which a low-pass at a corner in Hz ends or, both ways, begins.

    Before the motion, too, where that is of zero phase.
    """
    quiet = math.ceil(QUIET_CYCLES / (corner * motion.dt))
    before = quiet * isinstance(corner, ZeroPhase)
    padded = np.pad(motion.velocity, ((before, quiet), (0, 0)))
    start = motion.start - before * motion.dt
    return replace(motion, velocity=np.where(motion.present, padded, np.nan), start=start)


def within_band(rate, corner, carried, zero_phase=False) -> tuple[TimeFunction, float | None]:
    """Low-pass a moment rate at a corner in Hz, or "mesh": to what it carries, or "none"."""
    kind = ZeroPhase if zero_phase else float
    if corner == "mesh":
        band = carried()
        passed, corner = rate, None
        while highest_frequency(radiated(passed)) > band:
            corner = kind(STEP_DOWN * (corner or band / STEP_DOWN))
            passed = _low_passed(rate, corner)
        return passed, corner
    if corner in (None, "none"):
        return rate, None
    return _low_passed(rate, kind(corner)), kind(corner)


def _low_passed(rate, corner):
    """Low-pass a time function, its delay taken back; it then ends in quiet."""
    passed = with_quiet_ends(shape(rate, rate.values), corner).lowpassed(corner, of_source=True)
    return replace(rate, values=passed.velocity[:, 0], start=passed.start)


def phase_error(growth: np.ndarray, along: float | np.ndarray = 0.0) -> np.ndarray:
    """Return the phase error (n,) in rad that hexahedra make of frequencies on a way.

    Parameters
    ----------
    growth : (n,) float64
        Over the error of frequencies for which they have the nodes of an error of 1 % after three
        wavelengths.
    along : float or (n,) float64
        Share of the motion that runs along a free surface.
    """
    return np.minimum(PHASE * growth + ALONG[0] * along * growth ** ALONG[1], LOST)


def needed_frequency(motion: Seismogram, accuracy: float, along: bool = False) -> float:
    """Return the frequency in Hz for which a mesh is made that carries a waveform.

    The lowest at which the rule of nodes per wavelength leaves an error of the accuracy, from the
    frequency on below which 95 % of the energy lies to twice of it (sixteen times the work); sharp
    onsets ask for more.

    Parameters
    ----------
    motion : Seismogram
    accuracy : float
    along : bool
        Whether the source stands on a free surface.
    """
    least = top = highest_frequency(motion)
    n = fast_length(2 * len(motion.velocity))
    spectrum = np.fft.rfft(np.nan_to_num(motion.velocity), n, axis=0)
    frequency, size = np.fft.rfftfreq(n, motion.dt), float(np.linalg.norm(spectrum))
    while top < MOST * least:
        phase = phase_error(accuracy / 0.01 * (frequency / top) ** POWER, float(along))
        if np.linalg.norm((1.0 - np.exp(1j * phase))[:, None] * spectrum) <= accuracy * size:
            break
        top /= NEARLY
    return float(min(top, MOST * least))
