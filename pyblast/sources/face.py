"""Motion that enters through a face: the seismogram of a hole, superposed over all holes."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..blasts.blast import Blast, Firing
from ..blasts.signature import (
    SmoothPulse,
    cavity_seismogram,
    pressure_for_peak,
    superpose,
    travel_shifts,
)
from ..config.config import Config
from ..errors import InputError
from ..model.boundary import StressInput, VelocityInput, WaveFronts
from ..model.material import Material
from ..model.source import PlaneWave, TimeFunction, polarisation
from ..signals.seismogram import GEOGRAPHIC, Seismogram
from ..signals.spectra import LowPassed, lowpass
from ..units import to_si
from .inside import level_peak, with_quiet_ends

INWARD = {"west": (1, 0, 0), "east": (-1, 0, 0), "south": (0, 1, 0), "north": (0, -1, 0)}


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


def cavity_pulse(config, material):
    """Return the pressure pulse of a `CavityConfig`; its level from pressure, peak or distance."""
    pulse = SmoothPulse(1.0, to_si("peak_time_ms", config.peak_time_ms)[1])
    if config.pressure_mpa is not None:
        return replace(pulse, pressure=to_si("pressure_mpa", config.pressure_mpa)[1])
    distance = math.dist(config.hole_m, config.receiver_m)
    peak = level_peak(config, distance)
    rock = material.density, material.cp, material.cs
    return pressure_for_peak(*rock, config.radius_m, pulse, distance, peak)


def make_signature(config, materials, hole=None) -> Seismogram:
    """Return the seismogram of a single hole, east, north, vertical, times its scale.

    Parameters
    ----------
    config : SignatureConfig
    materials : dict of str to Material
    hole : Seismogram, optional
        Record of that hole without its mean; without it the closed form.
    """
    seismogram = _closed_form(config.cavity, materials) if hole is None else hole
    if hole is not None:
        if tuple(hole.components) != GEOGRAPHIC:
            raise InputError(
                "recorded.bearing_deg: missing; the record has longitudinal and transverse "
                "components, give the direction from the instrument to the blast"
            )
        _refuse_gaps(config.recorded.file, hole)
    return replace(seismogram, velocity=config.scale * seismogram.velocity)


def _closed_form(cavity, materials):
    """Return the seismogram of a `CavityConfig`."""
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
    padded = with_quiet_ends(superposed, low_pass)
    return InputMotion(signature, firing, padded, lowpass(padded, low_pass))


def wave_fronts(
    config: Config, blast: Blast | None, firing: Firing, materials: dict[str, Material]
) -> WaveFronts | None:
    """Return the wave fronts of the holes on the face of a project file, None where it is plane.

    Raises
    ------
    InputError
        If there is no blast, or the face is not a side of the box.
    """
    entry = config.input
    if entry.decay_exponent is None:
        return None
    if blast is None or entry.face not in INWARD:
        raise InputError(
            "input.decay_exponent: needs [blast] and a face west, east, south or north; leave it "
            "out for a load that is alike everywhere"
        )
    cavity = config.signature.cavity
    fastest = max(materials.values(), key=lambda m: m.cp)
    rock = fastest if cavity is None else materials[cavity.material]
    return WaveFronts(
        blast.centres, firing.times, firing.scales, entry.distance_m,
        entry.decay_exponent, rock.cp, np.array(INWARD[entry.face], dtype=float),
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
