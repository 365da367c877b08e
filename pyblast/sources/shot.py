"""Shot: one blast with its sources."""

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..blasts.blast import Blast, Firing
from ..blasts.hole_tables import read_blast
from ..blasts.signature import superpose
from ..config.config import Config
from ..config.section import read_time_function
from ..errors import InputError, named_error
from ..model.boundary import WaveFronts
from ..model.material import Material
from ..readers.provenance import ReadLog
from ..recordings.recording import Recording
from ..signals.seismogram import Seismogram, ZeroPhase
from ..signals.spectra import dominant_frequency, highest_frequency
from ..units import to_si
from .face import (
    InputMotion,
    make_entry,
    make_input,
    make_signature,
    opposite_input,
    shifts_of,
    wave_fronts,
)
from .inside import Inside, make_inside, needed_frequency, radiated, unit_rate, within_band
from .recorded import read_hole, read_records, record_of, shared

ALONE = Firing(np.zeros(1), np.ones(1))  # one hole, with the charge of the signature


@dataclass(frozen=True, eq=False)
class Shot:
    """Shot: one blast with its sources, as a project file states them.

    A copy with other parts (`dataclasses.replace`) keeps what was read from files.

    Parameters
    ----------
    path : Path
        Project file; other files are looked for in its folder.
    config : Config
        Tables of that file. Those of the ground are not used here.
    materials : dict of str to Material
        Rock in which the sources are stated. A ground with other materials moves by the same
        sources.
    name : str
    fired : Blast, optional
        In place of the holes of the file.
    alone : bool
        Whether one hole fires instead, at time 0 and with the charge of the signature.
    held : Inside, optional
        Sources inside as they are on a mesh, in place of those of the file; see `on_mesh`.
    log : ReadLog
        Takes what is read.
    read : dict
        What was read from files, by reader and arguments.
    """

    path: Path
    config: Config
    materials: dict[str, Material]
    name: str = ""
    fired: Blast | None = None
    alone: bool = False
    held: Inside | None = None
    log: ReadLog = field(default_factory=ReadLog, repr=False)
    read: dict[tuple[str, ...], Any] = field(default_factory=dict, repr=False)

    @property
    def folder(self) -> Path:
        """Folder of the project file."""
        return self.path.parent

    def _once(self, reader, *arguments):
        """Return what a function of this package reads with arguments; at first from the disk."""
        key = reader.__name__, *map(repr, arguments)
        if key not in self.read:
            self.read[key] = reader(*arguments, self.log)
        return self.read[key]

    @cached_property
    def blast(self) -> Blast | None:
        """Holes of the production blast."""
        if self.fired is not None or self.config.blast is None:
            return self.fired
        with named_error(f"{self.path.name}: blast"):
            return self._once(make_blast, self.config.blast, self.folder)

    @cached_property
    def firing(self) -> Firing:
        """Firing times and scales of the holes; scales of holes inside refer to 1 kg."""
        if self.alone:
            return ALONE
        reference = None if self.config.holes_inside is None else 1.0
        return make_firing(self.config.blast, self.blast, reference)

    @cached_property
    def signature(self) -> Seismogram | None:
        """Seismogram of a single hole."""
        config = self.config.signature
        if config is None:
            return None
        with named_error(f"{self.path.name}: signature"):
            hole = config.recorded and self._once(read_hole, config.recorded, self.folder)
            return make_signature(config, self.materials, hole)

    @cached_property
    def fronts(self) -> WaveFronts | None:
        """Wave fronts of the holes on the input face, None where it moves alike everywhere."""
        if self.alone:
            return None
        return wave_fronts(self.config, self.blast, self.firing, self.materials)

    @cached_property
    def input(self) -> InputMotion | None:
        """Motion that enters through a face, with its stages."""
        config = self.config
        if config.signature is None:
            return None
        signature, firing = self.signature, self.firing
        with named_error(f"{self.path.name}: input"):
            cavity, shifts = config.signature.cavity, None
            if cavity is not None and not self.alone:
                shifts = shifts_of(config.blast, self.blast, cavity.receiver_m, cavity.hole_m)
            corner = self._input_corner
            if self.fronts is not None:
                return opposite_input(signature, firing, corner, self.fronts, self.blast)
            return make_input(signature, firing, corner, shifts)

    def entry(self):
        """Return the boundaries and plane waves by which the motion enters; none if none does."""
        if self.input is None:
            return [], []
        config = self.config.input
        if self.fronts is None:
            return make_entry(config, self.input.motion.shifted(self.lead))
        # each hole by itself
        fronts = replace(self.fronts, times=self.fronts.times + self.lead)
        return make_entry(config, replace(self, alone=True).input.motion, fronts)

    def on_mesh(self, carried: Callable[[], float]) -> "Shot":
        """Return the shot with its sources inside low-passed to what a mesh carries.

        They stay so with other ground or another mesh, and with other holes (`fired`): a moment
        rate is that of 1 kg.

        Parameters
        ----------
        carried : callable
            Returns the frequency in Hz that the mesh carries around the holes.
        """
        return self if self.held is not None else replace(self, held=self._inside(carried))

    def _inside(self, carried):
        """Read the sources inside."""
        with named_error(self.path.name):
            return make_inside(
                self.config, self.blast, self.materials, carried,
                lambda file, column: self._once(read_time_function, self.folder / file, column),
            )  # fmt: skip

    @cached_property
    def inside(self) -> Inside:
        """Time functions of all sources beside a motion on a face."""
        return self.held or self._inside(lambda: math.inf)

    @cached_property
    def motions(self) -> tuple[Seismogram, ...]:
        """Input motions for their frequency content: of the face, of each kind of source."""
        face = () if self.input is None else (self.input.motion,)
        return (*face, *self.inside.motions(self.firing))

    @property
    def unfiltered(self) -> tuple[Seismogram, ...]:
        """Input motions before the low-passes of the sources."""
        inside = self.inside
        if inside.unfiltered is not None:
            inside = replace(inside, moment_rate=inside.unfiltered)
        face = () if self.input is None else (self.input.superposed,)
        return (*face, *inside.motions(self.firing))

    @property
    def lead(self) -> float:
        """Time from the start of the run to the first firing [s]."""
        face = 0.0 if self.input is None else self.input.motion.start
        return max(0.0, -face, -self.inside.start(float(self.firing.times.min())))

    @property
    def duration(self) -> float:
        """Duration of the run [s]: the lead and the given duration after the first firing."""
        return self.lead + self.config.run.duration_s

    @property
    def low_pass(self) -> float | None:
        """Corner in Hz of the low-pass of all that enters, None without, 0 where some is."""
        corners = [self.inside.low_pass] if self.inside.moment_rate is not None else []
        if self.input is not None:
            corners.append(self._input_corner)
        if set(self.inside.named) - {"moment_rate"}:
            corners.append(None)
        return corners[0] if len({(type(each), each) for each in corners}) == 1 else 0.0

    @property
    def _input_corner(self):
        """Corner in Hz of the low-pass of what enters through a face, None without one."""
        config = self.config.input
        zero_phase = config.zero_phase and config.low_pass_hz is not None
        return ZeroPhase(config.low_pass_hz) if zero_phase else config.low_pass_hz

    @property
    def highest_frequency(self) -> float:
        """Frequency in Hz below which 95 % of the energy of what enters lies."""
        return max(highest_frequency(motion) for motion in self.motions)

    @property
    def central_frequency(self) -> float:
        """Frequency in Hz that damping is set to, else the dominant one of what enters."""
        if self.config.damping is not None:
            return self.config.damping.frequency_hz
        motion = self.motions[0]
        return float(dominant_frequency(motion).hz[int(np.nanargmax(motion.ppv))])

    @property
    def asked_frequency(self) -> float | None:
        """Frequency in Hz that a mesh has to carry, which nobody gave.

        A mesh made for it carries the waveform of what enters, as it would without a low-pass for
        the mesh, within ``mesh.accuracy``. None where nothing enters, or an air blast, which asks
        for other edges.
        """
        config, inside = self.config, self.config.holes_inside
        accuracy, along = config.mesh.accuracy, bool(config.point_forces or config.pressures)
        if config.air_blast is not None:
            return None
        if inside is not None and inside.charged_hole is not None and inside.low_pass_hz != "none":
            hole = inside.charged_hole
            rock = self.materials.get(hole.material)
            if rock is None:
                return None
            rate, _ = within_band(
                unit_rate(hole, rock), inside.low_pass_hz, lambda: math.inf, inside.zero_phase
            )
            return needed_frequency(superpose(radiated(rate), self.firing), accuracy)
        return max((needed_frequency(m, accuracy, along) for m in self.motions), default=None)

    @cached_property
    def recordings(self) -> dict[str, Recording]:
        """Records of the file by receiver, as their instruments wrote them."""
        records = {}
        for part in self.config.receivers:
            if part.recorded is not None:
                with named_error(f"{self.path.name}: receivers.{part.name}.recorded"):
                    whole = self._once(read_records, shared(part.recorded), self.folder)
                    records[part.name] = record_of(part.recorded, self.folder, whole)
        return records

    @cached_property
    def input_files(self) -> dict[str, str]:
        """SHA-256 of the project file and of every file that it names."""
        names = [*[self.path.name] * self.path.is_file(), *named_files(self.config)]
        files = {name: (self.folder / name).read_bytes() for name in names}
        return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


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
    if blast is None or config is None:
        return ALONE
    if not np.any(blast.charge):
        raise InputError("blast: all charges are zero, so nothing enters; give charges in kg")
    firing = blast.firing(reference_charge or config.reference_charge_kg, config.charge_exponent)
    if config.scatter_ms:
        sigma = to_si("scatter_ms", config.scatter_ms)[1]
        firing = firing.scattered(sigma, np.random.default_rng(config.seed))
    return firing


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
