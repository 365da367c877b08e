"""Input of a project in SI units: blast, signature, superposed motion, source time functions."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..blasts.blast import Blast, Firing
from ..blasts.hole_tables import read_blast
from ..blasts.published_laws import BY_NAME, HARD_ROCK
from ..blasts.signature import (
    SmoothPulse,
    cavity_moment,
    cavity_seismogram,
    moment_for_peak,
    pressure_for_peak,
    superpose,
    travel_shifts,
)
from ..config.section import read_time_function
from ..errors import InputError, named_error
from ..model.boundary import StressInput, VelocityInput, WaveFronts
from ..model.source import PlaneWave, TimeFunction, polarisation
from ..recordings.recording import (
    Recording,
    first_recording,
    in_motion,
    read_recording,
    remove_response,
)
from ..signals.seismogram import GEOGRAPHIC, Seismogram, fast_length
from ..signals.spectra import LowPassed, dominant_frequency, highest_frequency, lowpass
from ..units import to_si
from .places import charge_depth, level_distance

QUIET_CYCLES = 3.0


@dataclass(frozen=True, eq=False)
class InputMotion:
    """Input motion and the stages of its making; zero time is the first firing.

    Parameters
    ----------
    signature : Seismogram
    firing : Firing
    superposed : Seismogram
        With quiet time after it, so that the filter has room.
    low_passed : LowPassed or None
    """

    signature: Seismogram
    firing: Firing
    superposed: Seismogram
    low_passed: LowPassed | None

    @property
    def motion(self) -> Seismogram:
        """The seismogram that enters the model."""
        return self.superposed if self.low_passed is None else self.low_passed.seismogram


def make_blast(config, folder, log=None) -> Blast:
    """Turn a `BlastConfig` into a `Blast`: rows of vertical holes, or a hole table."""
    shift = np.array(config.shift_m)
    if config.file is not None:
        mapping = None if config.mapping is None else folder / config.mapping
        blast = read_blast(folder / config.file, mapping, config.sheet, log)
        moved = {"collar": blast.collar + shift, "toe": blast.toe + shift}
        return replace(blast, **moved, explosive_density=config.explosive_kg_per_m3)
    row = math.radians(config.row_bearing_deg)
    along, across = np.array([math.sin(row), math.cos(row), 0.0]), None
    across = np.array([-math.cos(row), math.sin(row), 0.0])
    rows = np.repeat(np.arange(config.rows), config.holes_per_row)
    holes = np.tile(np.arange(config.holes_per_row), config.rows)
    stagger = 0.25 * np.where(rows % 2, 1.0, -1.0) * (config.rows > 1)
    offset = holes - 0.5 * (config.holes_per_row - 1) + stagger
    collar = (
        np.array(config.position_m) + shift
        + config.spacing_m * offset[:, None] * along
        + config.burden_m * rows[:, None] * across
    )  # fmt: skip
    return Blast(
        name=f"{config.rows} x {config.holes_per_row} holes",
        collar=collar,
        toe=collar - [0.0, 0.0, config.depth_m],
        charge=config.charge_kg,
        times=to_si("delay_ms", config.delay_ms)[1] * rows,
        diameter=to_si("diameter_mm", config.diameter_mm)[1],
        hole_ids=tuple(f"{r + 1}-{h + 1}" for r, h in zip(rows, holes, strict=True)),
        explosive_density=config.explosive_kg_per_m3,
    )


def make_firing(config, blast, reference_charge=None) -> Firing:
    """Return times and scales of a blast; one hole at time 0 without a blast.

    Parameters
    ----------
    config : BlastConfig or None
    blast : Blast or None
    reference_charge : float, kg, optional
        Charge that the scales refer to; without it the one of the file, else all scales are 1.
    """
    if blast is None:
        return Firing(np.zeros(1), np.ones(1))
    if not np.any(blast.charge):
        raise InputError("blast: all charges are zero, so nothing enters; give charges in kg")
    firing = blast.firing(reference_charge or config.reference_charge_kg, config.charge_exponent)
    if config.scatter_ms:
        sigma = to_si("scatter_ms", config.scatter_ms)[1]
        firing = firing.scattered(sigma, np.random.default_rng(config.seed))
    return firing


def read_record(config, folder, log=None) -> Recording:
    """Read the record that a `RecordingConfig` names."""
    records = read_recording(
        folder / config.file,
        config.format,
        bearing=None if config.bearing_deg is None else math.radians(config.bearing_deg),
        full_scale=(
            None if config.full_scale_mm_per_s is None else 1e-3 * config.full_scale_mm_per_s
        ),
        mapping=None if config.mapping is None else folder / config.mapping,
        unit="counts" if config.is_counts else config.unit,
        sheet=config.sheet,
        log=log,
    )
    if config.record > len(records):
        raise InputError(f"record: {config.file} has {len(records)} records, got {config.record}")
    record = records[config.record - 1]
    if "record" not in config.model_fields_set:
        record = first_recording(config.file, records)
    if config.sensitivity is not None:
        record = in_motion(record, config.sensitivity)
    if config.response_file is not None:
        record = remove_response(record, folder / config.response_file)
    stated = {"start": config.start_s, "low_passed": config.low_passed_hz}
    stated = {name: value for name, value in stated.items() if value is not None}
    return replace(record, seismogram=replace(record.seismogram, **stated))


def read_hole(config, folder, log=None) -> Seismogram:
    """Read a single-hole record and remove its mean, which superposition would multiply.

    Raises
    ------
    InputError
        If it is clipped and the configuration does not accept that.
    """
    record = read_record(config, folder, log)
    seismogram, clipped = record.seismogram, record.clipped.sum(axis=0)
    if clipped.any() and not config.accept_clipped:
        names = ", ".join(
            f"{count} of {name}"
            for name, count in zip(seismogram.components, clipped, strict=True)
            if count
        )
        raise InputError(
            f"recorded.file: {config.file}: samples are clipped ({names}), and every hole would "
            "repeat that; record the hole farther away, or set accept_clipped = true"
        )
    return replace(seismogram, velocity=seismogram.velocity - seismogram.velocity.mean(axis=0))


def cavity_pulse(config, material):
    """Return the pressure pulse of a `CavityConfig`; its level from pressure, peak or distance."""
    pulse = SmoothPulse(1.0, to_si("peak_time_ms", config.peak_time_ms)[1])
    if config.pressure_mpa is not None:
        return replace(pulse, pressure=to_si("pressure_mpa", config.pressure_mpa)[1])
    distance = math.dist(config.hole_m, config.receiver_m)
    peak = level_peak(config, distance)
    rock = material.density, material.cp, material.cs
    return pressure_for_peak(*rock, config.radius_m, pulse, distance, peak)


def make_signature(config, materials, folder, log=None) -> Seismogram:
    """Return the seismogram of a single hole, east, north, vertical, times its scale."""
    seismogram = _single_hole(config, materials, folder, log)
    return replace(seismogram, velocity=config.scale * seismogram.velocity)


def _single_hole(config, materials, folder, log):
    """Return a record without its mean, or the closed form."""
    if config.recorded is not None:
        seismogram = read_hole(config.recorded, folder, log)
        if tuple(seismogram.components) != GEOGRAPHIC:
            raise InputError(
                "recorded.bearing_deg: missing; the record has longitudinal and transverse "
                "components, give the direction from the instrument to the blast"
            )
        _refuse_gaps(config.recorded.file, seismogram)
        return seismogram
    cavity = config.cavity
    if cavity.material not in materials:
        raise InputError(f"cavity.material: must be one of {', '.join(materials)}")
    rock = materials[cavity.material]
    return cavity_seismogram(
        rock.density, rock.cp, rock.cs, cavity.radius_m, cavity_pulse(cavity, rock),
        source=cavity.hole_m, receiver=cavity.receiver_m,
        dt=1.0 / cavity.sampling_hz, duration=cavity.duration_s,
    )  # fmt: skip


def _refuse_gaps(file, seismogram):
    """Refuse a single-hole record that lacks a component or never moves."""
    if not seismogram.present.all():
        missing = seismogram.components[int(seismogram.present.argmin())]
        raise InputError(
            f"recorded.file: {file} has no component {missing}, what enters through a face needs "
            "all three; add the column, zeros where it does not move"
        )
    if not seismogram.velocity.any():
        raise InputError(f"recorded.file: {file} never moves; give the record of a single hole")


def make_input(signature, firing, low_pass, shifts=None) -> InputMotion:
    """Superpose the signature over the firing and low-pass the sum.

    Parameters
    ----------
    signature : Seismogram
    firing : Firing
    low_pass : float or None, Hz
    shifts : (n_holes,) float64, s, optional
        Travel-time shifts.
    """
    superposed = superpose(signature, firing, travel_shifts=shifts)
    return _filtered(signature, firing, superposed, low_pass)


def _filtered(signature, firing, superposed, low_pass):
    """Return the stages of an input motion, low-passed at a corner in Hz or not."""
    if low_pass is None:
        return InputMotion(signature, firing, superposed, None)
    padded = _with_quiet_end(superposed, low_pass)
    return InputMotion(signature, firing, padded, lowpass(padded, low_pass))


def _with_quiet_end(motion, corner):
    """Append some cycles of silence, in which what a low-pass at a corner in Hz delays ends."""
    quiet = math.ceil(QUIET_CYCLES / (corner * motion.dt))
    padded = np.pad(motion.velocity, ((0, quiet), (0, 0)))
    return replace(motion, velocity=np.where(motion.present, padded, np.nan))


INWARD = {"west": (1, 0, 0), "east": (-1, 0, 0), "south": (0, 1, 0), "north": (0, -1, 0)}


def wave_fronts(project) -> WaveFronts | None:
    """Return the wave fronts of the holes on the face of a `Project`, None where it is plane.

    Raises
    ------
    InputError
        If there is no blast, or the face is not a side of the box.
    """
    config, blast = project.config.input, project.blast
    if config.decay_exponent is None:
        return None
    if blast is None or config.face not in INWARD:
        raise InputError(
            "input.decay_exponent: needs [blast] and a face west, east, south or north; leave it "
            "out for a load that is alike everywhere"
        )
    rocks = project.materials.values()
    cavity = project.config.signature.cavity
    rock = max(rocks, key=lambda m: m.cp) if cavity is None else project.materials[cavity.material]
    return WaveFronts(
        blast.centres, project.firing.times, project.firing.scales, config.distance_m,
        config.decay_exponent, rock.cp, np.array(INWARD[config.face], dtype=float),
    )  # fmt: skip


def opposite_input(signature, firing, low_pass, fronts, blast) -> InputMotion:
    """Return the input motion at the point of the face opposite the middle of the first holes."""
    first = blast.centres[blast.times == blast.times.min()].mean(axis=0)
    point = first + fronts.distance * fronts.axis
    (amplitude, delay, turn) = (each[:, 0] for each in fronts.at(point[None]))
    turned = [replace(signature, velocity=signature.velocity @ rotation.T) for rotation in turn]
    early = min(0.0, float(delay.min()))
    superposed = superpose(signature, Firing(delay - early, amplitude), signatures=turned)
    superposed = superposed.shifted(early)
    return _filtered(signature, firing, superposed, low_pass)


def make_entry(config, motion, fronts=None):
    """Return the boundaries and plane waves by which a motion enters through a face.

    A plane wave carries the component of the motion along its polarisation.

    Parameters
    ----------
    config : InputConfig
    motion : Seismogram
        Of a single hole where there are wave fronts.
    fronts : WaveFronts, optional
    """
    if config.enters_as == "velocity":
        return [VelocityInput(config.face, motion)], []
    if config.enters_as == "stress":
        return [StressInput(config.face, motion, fronts=fronts)], []
    angles = [to_si(key, getattr(config, key))[1] for key in ("azimuth_deg", "inclination_deg")]
    along = motion.velocity @ polarisation(config.wave, *angles)
    if not np.any(np.abs(along) > 1e-9 * np.abs(motion.velocity).max()):
        raise InputError(
            f"input.wave: the signature has no motion along {config.wave} from "
            f"{config.azimuth_deg:g} degrees, so nothing enters; take another wave or azimuth_deg"
        )
    history = TimeFunction(along, motion.dt, motion.start)
    return [], [PlaneWave(config.wave, history, *angles, free_surface=config.free_surface)]


def shifts_of(config, blast, receiver, reference):
    """Return the travel-time shifts of a blast, None where no wave speed is given."""
    if blast is None or config.wave_speed_m_per_s is None:
        return None
    return travel_shifts(blast, receiver, config.wave_speed_m_per_s, reference)


def like_simulated(config, record) -> Recording:
    """Turn a record into the components of its receiver, a `ReceiverConfig`."""
    seismogram, clipped = record.seismogram, record.clipped
    if config.normal is not None:
        return _along_normal(record, config.normal)
    geographic = tuple(seismogram.components) == GEOGRAPHIC
    if config.azimuth_deg is None and not geographic:
        raise InputError(
            "azimuth_deg: missing at the receiver; the record has longitudinal and transverse "
            "components"
        )
    if config.azimuth_deg is not None and geographic:
        either = clipped[:, :1] | clipped[:, 1:2]  # each horizontal component takes from both
        turned = seismogram.rotated(math.radians(config.azimuth_deg))
        marks = np.hstack([either, either, clipped[:, 2:]])
        return replace(record, seismogram=turned, clipped=marks)
    return record


def _along_normal(record, normal):
    """Turn a record of one component, whatever its name, into motion along a direction."""
    seismogram, unit = record.seismogram, np.asarray(normal) / np.linalg.norm(normal)
    recorded = np.flatnonzero(np.isfinite(seismogram.velocity).any(axis=0))
    if len(recorded) != 1:
        names = ", ".join(seismogram.components[k] for k in recorded)
        raise InputError(
            f"normal: needs a record of one component, this one has {names or 'none'}; give the "
            "record of that sensor alone, or leave normal out"
        )
    across, column = unit == 0.0, seismogram.velocity[:, recorded]
    velocity = np.where(across, np.nan, column * unit)
    clipped = record.clipped[:, recorded] & ~across
    turned = replace(seismogram, velocity=velocity, components=GEOGRAPHIC)
    return replace(record, seismogram=turned, clipped=clipped, offset=(0.0, 0.0, 0.0))


SAMPLES_PER_DURATION = 100
DURATIONS = 8
SAMPLES_PER_PEAK_TIME = 200
PEAK_TIMES = 10
SMOOTH = 8  # order of a pulse that is given by its frequency
FREQUENCY = 20.0  # Hz, of a hole without one
STEP_DOWN = 0.95  # between low-passes that are tried
LEAST_PEAK = 0.9  # share of the peak of the blast that a run has to hold
PERIODS = 20.0  # of the lowest frequency that is lost, around a pulse
NEARLY = 0.95  # of the top of a band, from which on a mesh carries it


def make_moment_rate(
    config, exponent, materials, folder, distance=math.nan, depth=None, log=None
) -> TimeFunction:
    """Turn a `HolesInsideConfig` into the moment rate of 1 kg, N m/s, with all its frequencies.

    Parameters
    ----------
    config : HolesInsideConfig
    exponent : float
        Of the charge; takes the moment of the charged hole back to 1 kg.
    materials : dict of str to Material
    folder : Path
    distance : float, m, optional
        Where a law sets the level of a charged hole without distance_m.
    depth : float, m, optional
        Of the charge under a free surface; None: unbounded rock.
    log : ReadLog, optional
        Takes what was read.

    Notes
    -----
    ``M = pi a^3 p(t) cp^2/cs^2``, right for waves much longer than the cavity: theory.md (5.2).
    A peak on the ground is that of a half-space, `ground_peak`. A law or a peak is one of motion
    with all its frequencies, so it sets the level before any low-pass.
    """
    if config.moment_rate_file is not None:
        return read_time_function(folder / config.moment_rate_file, "moment_rate_per_kg", log)
    hole = config.charged_hole
    if hole.material not in materials:
        raise InputError(
            f"charged_hole.material: must be one of {', '.join(materials)}, got {hole.material!r}"
        )
    rock, unit = materials[hole.material], _unit_rate(hole, materials[hole.material])
    if hole.pressure_mpa is not None:
        unit = replace(unit, values=to_si("pressure_mpa", hole.pressure_mpa)[1] * unit.values)
    else:
        away = float(hole.distance_m or distance)
        unit = moment_for_peak(unit, level_peak(hole, away), away, depth, rock)
    return replace(unit, values=unit.values / hole.charge_kg**exponent)


def _unit_rate(hole, rock):
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


def within_band(rate, corner, carried) -> tuple[TimeFunction, float | None]:
    """Low-pass a moment rate at a corner in Hz, or "mesh": to what it carries, or "none"."""
    if corner == "mesh":
        band = carried()
        passed, corner = rate, None
        while highest_frequency(radiated(passed)) > band:
            corner = STEP_DOWN * (corner or band / STEP_DOWN)
            passed = _low_passed(rate, corner)
        return passed, corner
    if corner in (None, "none"):
        return rate, None
    return _low_passed(rate, corner), corner


def _low_passed(rate, corner):
    """Low-pass a time function, forward only; it then ends in quiet."""
    motion = _with_quiet_end(shape(rate, rate.values), corner)
    return replace(rate, values=motion.lowpassed(corner, causal=True).velocity[:, 0])


def level_peak(hole, distance) -> float:
    """Return the peak velocity in m/s at a distance in m by the level of a charged hole."""
    if hole.peak_mm_per_s is not None:
        return to_si("peak_mm_per_s", hole.peak_mm_per_s)[1]
    law = hole.site_law or BY_NAME[hole.law or HARD_ROCK.name]
    return law.ppv(distance, hole.charge_kg)


def make_air_pulse(config, folder, log=None) -> TimeFunction:
    """Turn an `AirBlastConfig` into the overpressure in Pa at the reference distance.

    Notes
    -----
    ``p = P (1 - t/T) exp(-t/T)`` without a file, Friedlander (1946): theory.md (5.12).
    """
    if config.file is not None:
        return read_time_function(folder / config.file, "pressure", log)
    duration = to_si("duration_ms", config.duration_ms)[1]
    share = np.arange(DURATIONS * SAMPLES_PER_DURATION + 1) / SAMPLES_PER_DURATION
    peak = to_si("pressure_kpa", config.pressure_kpa)[1]
    return TimeFunction(peak * (1.0 - share) * np.exp(-share), duration / SAMPLES_PER_DURATION)


@dataclass(frozen=True, eq=False)
class Inside:
    """Sources inside or on the model, beside the input face; zero time is the first firing.

    Parameters
    ----------
    firing : Firing
        Scales of holes inside refer to 1 kg.
    moment_rate : TimeFunction or None
        Of 1 kg, N m/s; None without holes inside.
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

    firing: Firing
    moment_rate: TimeFunction | None
    forces: tuple[TimeFunction, ...]
    tensors: tuple[TimeFunction, ...]
    pressures: tuple[TimeFunction, ...]
    air_pulse: TimeFunction | None
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
    def start(self) -> float:
        """Earliest start of a source [s], at most 0."""
        starts = [
            0.0,
            *(function.start for function in (*self.forces, *self.tensors, *self.pressures)),
        ]
        first = float(self.firing.times.min())
        for history in (self.moment_rate, self.air_pulse):
            if history is not None:
                starts += [first, first + history.start]
        return min(starts)

    @property
    def motions(self) -> tuple[Seismogram, ...]:
        """Far-field wave shapes of all holes and of each other source, for their spectra."""
        fired = []
        if self.moment_rate is not None:
            fired.append(radiated(self.moment_rate))
        if self.air_pulse is not None:
            fired.append(shape(self.air_pulse, self.air_pulse.values))
        return (
            *(superpose(function, self.firing) for function in fired),
            *(radiated(function) for function in (*self.forces, *self.tensors)),
            *(shape(function, function.values) for function in self.pressures),
        )


def read_inside(project, carried) -> Inside:
    """Read the time functions of all sources of a `Project`.

    ``carried()`` is the frequency in Hz that its mesh carries around the holes.
    """
    config, materials, folder = project.config, project.materials, project.folder
    rate = air = corner = whole = None
    if config.holes_inside is not None:
        exponent, hole = config.blast.charge_exponent, config.holes_inside.charged_hole
        with named_error("holes_inside"):
            by_law = hole is not None and hole.pressure_mpa is None
            distance = level_distance(config, project.blast) if by_law else math.nan
            depth = charge_depth(config, project.blast)
            whole = make_moment_rate(
                config.holes_inside, exponent, materials, folder, distance, depth, project.log
            )
            low_pass = config.holes_inside.low_pass_hz or ("none" if hole is None else "mesh")
            rate, corner = within_band(whole, low_pass, carried)
    if config.air_blast is not None:
        air = make_air_pulse(config.air_blast, folder, project.log)
    forces, tensors, pressures = (
        tuple(read_time_function(folder / part.file, name, project.log) for part in parts)
        for parts, name in (
            (config.point_forces, "force"),
            (config.moment_tensors, "moment_rate"),
            (config.pressures, "pressure"),
        )
    )
    before = None if corner is None else whole
    return Inside(project.firing, rate, forces, tensors, pressures, air, corner, before)


def radiated(function) -> Seismogram:
    """Return the far-field wave shape: the time derivative of a moment rate or force."""
    return shape(function, np.gradient(function.values, function.dt))


def shape(function, values) -> Seismogram:
    """Return values (n,) at the times of a function as a seismogram of one component."""
    missing = np.full_like(values, np.nan)
    return Seismogram(np.column_stack([values, missing, missing]), function.dt, function.start)


def unfiltered(project) -> tuple[Seismogram, ...]:
    """Return the input motions of a project before the low-passes of its sources."""
    inside = project.inside
    if inside.unfiltered is not None:
        inside = replace(inside, moment_rate=inside.unfiltered)
    face = () if project.input is None else (project.input.superposed,)
    return (*face, *inside.motions)


def central_frequency(project):
    """Return the frequency in Hz that damping is set to, else the dominant one of the input."""
    if project.config.damping is not None:
        return project.config.damping.frequency_hz
    motion = project.motions[0]
    return float(dominant_frequency(motion).hz[int(np.nanargmax(motion.ppv))])


def input_band(project):
    """Return the frequency in Hz below which 95 % of the energy of what enters lies."""
    return max(highest_frequency(motion) for motion in project.motions)


def blast_frequency(project) -> float | None:
    """Return the frequency in Hz that a mesh has to carry, which nobody gave.

    Below it lies 95 % of the energy of what enters, as it would without a low-pass for the mesh,
    and what makes 90 % of its peak. None where nothing enters, or an air blast, which asks for
    other edges.
    """
    config, inside = project.config, project.config.holes_inside
    if config.air_blast is not None:
        return None
    if inside is not None and inside.charged_hole is not None and inside.low_pass_hz != "none":
        hole = inside.charged_hole
        rock = project.materials.get(hole.material)
        if rock is None:
            return None
        rate, _ = within_band(_unit_rate(hole, rock), inside.low_pass_hz, lambda: math.inf)
        return _frequency_of(superpose(radiated(rate), project.firing))
    return max((_frequency_of(motion) for motion in project.motions), default=None)


def _frequency_of(motion):
    """Return the frequency in Hz up to which a motion holds its energy and its peak."""
    top = highest_frequency(motion)
    while held_shares(motion, motion, NEARLY * top)[1] < LEAST_PEAK and top < 0.5 / motion.dt:
        top /= NEARLY
    return top


def held_shares(whole, passed, carried) -> tuple[float, float]:
    """Return which share of energy and peak of a motion its low-passed one has up to a frequency.

    Parameters
    ----------
    whole, passed : Seismogram
    carried : float, Hz
    """
    velocity = np.nan_to_num(passed.velocity)
    periods = int(np.ceil(PERIODS / (carried * passed.dt)))
    padded = fast_length(len(velocity) + periods)  # a pulse may be shorter than a period
    spectrum = np.fft.rfft(velocity, padded, axis=0)
    spectrum[np.fft.rfftfreq(padded, passed.dt) > carried] = 0.0
    carried_motion = np.fft.irfft(spectrum, padded, axis=0)
    before = np.nan_to_num(whole.velocity)
    energy, peak = np.sum(before**2), np.abs(before).max()
    if not peak > 0.0:
        return 1.0, 1.0
    return np.sum(carried_motion**2) / energy, np.abs(carried_motion).max() / peak


def named_files(config) -> list[str]:
    """Return the names of all files that a `Config` names."""
    names = config.mesh.files
    if config.blast is not None:
        names += [config.blast.file, config.blast.mapping]
    if config.holes_inside is not None:
        names.append(config.holes_inside.moment_rate_file)
    if config.air_blast is not None:
        names.append(config.air_blast.file)
    several = config.point_forces, config.moment_tensors, config.pressures
    names += [part.file for parts in several for part in parts]
    records = [part.recorded for part in (config.signature, *config.receivers) if part]
    names += [name for r in records if r is not None
              for name in (r.file, r.mapping, r.response_file)]  # fmt: skip
    for candidate in config.diagnosis.candidates if config.diagnosis else ():
        names.append(candidate.mesh.get("surface_file"))
    return [name for name in names if name is not None]
