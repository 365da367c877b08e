"""Survey: shots, the receivers that stand around them, and what these recorded."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .errors import InputError, named_error
from .inference.records import (
    COMPONENTS,
    LEAST_NOISE,
    Noise,
    Records,
    band_functions,
    check_sampling,
    gather,
    noise_of,
    white_noise,
)
from .model.model import Receiver
from .recordings.recording import Recording
from .signals.seismogram import GEOGRAPHIC, PASS_BAND
from .sources.recorded import like_simulated, make_receivers
from .sources.shot import Shot

SHORTEST_RECORD = 0.5  # of the longest record; no record may end earlier


@dataclass(frozen=True, eq=False)
class Survey:
    """Survey: shots in one ground, receivers, and recordings.

    Parameters
    ----------
    shots : tuple of Shot
    receivers : tuple of Receiver, optional
        Of every shot; by default those that the file of each shot names, on the ground.
    recorded : dict of str to dict of str to Recording, optional
        By shot and receiver, in place of the recordings of the files.
    band : tuple of 2 float, Hz, optional
        In which records are compared, in place of ``run.compare_band_hz``.
    """

    shots: tuple[Shot, ...]
    receivers: tuple[Receiver, ...] | None = None
    recorded: Mapping[str, Mapping[str, Recording]] | None = None
    band: tuple[float, float] | None = None

    def shot(self, name: str) -> Shot:
        """Return a shot by its name.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        for shot in self.shots:
            if shot.name == name:
                return shot
        known = ", ".join(shot.name for shot in self.shots)
        raise InputError(f"case: no blast {name!r}; there are {known}")

    def stations(self, shot: Shot) -> tuple[Receiver, ...]:
        """Return the receivers of a shot as they are stated, not placed on the ground."""
        return make_receivers(shot.config.receivers) if self.receivers is None else self.receivers

    @property
    def recordings(self) -> dict[str, dict[str, Recording]]:
        """Recordings by shot and receiver, as their instruments wrote them."""
        if self.recorded is None:
            return {shot.name: shot.recordings for shot in self.shots}
        return {shot.name: dict(self.recorded.get(shot.name, {})) for shot in self.shots}

    def edited(self, act: Callable[[str, dict[str, Recording]], Mapping[str, Recording]]):
        """Return the survey with other recordings.

        Parameters
        ----------
        act : callable
            Takes the name of a shot and its recordings by receiver, returns those in their place.
        """
        tables = {name: act(name, table) for name, table in self.recordings.items()}
        return replace(self, recorded=tables)

    def in_axes(self, shot: Shot) -> dict[str, Recording]:
        """Return the recordings of a shot in the components of its simulated seismograms."""
        axes = {part.name: (part.azimuth, part.normal) for part in self.stations(shot)}
        turned = {}
        for name, record in self.recordings[shot.name].items():
            with named_error(_place(shot, name)):
                turned[name] = like_simulated(record, *axes[name]) if name in axes else record
        return turned

    def comparable(self, shot: Shot) -> dict[str, Recording]:
        """Return the same, low-passed like what enters from the shot as it is on a mesh."""
        compared = {}
        for name, record in self.in_axes(shot).items():
            with named_error(_place(shot, name)):
                compared[name] = record.filtered_like(shot.low_pass)
        return compared

    def geographic(self) -> "Survey":
        """Return the survey with the same receivers for every shot, along east and north.

        A receiver keeps the axes of its recording where that lacks a horizontal component.

        Raises
        ------
        InputError
            If a receiver has several places, or a shot no recording.
        """
        receivers, tables = {}, {}
        for shot in self.shots:
            recordings, table = self.recordings[shot.name], {}
            for receiver in self.stations(shot):
                known = receivers.setdefault(receiver.name, receiver).position
                if any(a != b for a, b in zip(known, receiver.position, strict=False)):
                    raise InputError(
                        f"{shot.path.name}: receivers.{receiver.name}.position_m: differs between "
                        "the blasts"
                    )
                held = receivers[receiver.name]
                if receiver.name in recordings:
                    with named_error(_place(shot, receiver.name)):
                        record, azimuth = _geographic(recordings[receiver.name], receiver)
                    table[receiver.name] = record
                    held = replace(receiver, azimuth=azimuth)
                at = min(known, receiver.position, key=len)
                receivers[receiver.name] = replace(held, position=at)
            tables[shot.name] = table
            if not table:
                raise InputError(
                    f"{shot.path.name}: receivers: none has a record; add [receivers.recorded]"
                )
        return replace(self, receivers=tuple(receivers.values()), recorded=tables)

    def records(
        self,
        receivers: Sequence[str],
        band: tuple[float, float],
        *,
        dt: float | None = None,
        n_samples: int | None = None,
        until: float = np.inf,
        noise: float | Sequence[float] | None = None,
        unused: Mapping[tuple[str, str], str] | None = None,
    ) -> Records:
        """Gather the recordings of all shots at common instants, with their noise.

        A sensor of one component has one channel, the largest of its direction, which holds all
        that it says. A channel that never moves is left out, and a channel that is still before
        the shot gets the noise of the channel with most noise, reversed in time.

        Parameters
        ----------
        receivers : sequence of str
        band : tuple of 2 float, Hz
        dt : float, s, optional
            Between the instants; that of the recordings by default, which must be one.
        n_samples : int, optional
            From the first firing on; up to the end of the shortest recording by default.
        until : float, s
            Latest end of that.
        noise : float, m/s, or 2 float, s, optional
            Level of white noise within the band, or the window before the shot in which noise is
            recorded; by default from when all recordings have begun to the first firing.
        unused : dict of (str, str) to str, optional
            Why the recording of a shot at a receiver is left out.

        Raises
        ------
        InputError
            If sampling, ends or beginnings of the recordings don't fit, or a shot keeps none.
        """
        unused = dict(unused or {})
        normals = {part.name: part.normal for shot in self.shots for part in self.stations(shot)}
        tables = [
            {name: _once(record, normals.get(name))
             for name, record in self.comparable(shot).items()
             if name in receivers and (shot.name, name) not in unused}
            for shot in self.shots
        ]  # fmt: skip
        every = [
            (shot, name, record.seismogram)
            for shot, table in zip(self.shots, tables, strict=True)
            for name, record in table.items()
        ]
        dt = _sampling(every, band) if dt is None else dt
        for shot, name, record in every:
            check_sampling(_place(shot, name), record, band)
        if n_samples is None:
            n_samples = int(np.floor(min(_end(every), until) / dt + 1e-6)) + 1
        receivers = tuple(receivers)
        motion, valid = gather(tables, receivers, 0.0, dt, n_samples)
        still = valid.any(axis=3) & (np.ptp(motion, axis=3) == 0.0)
        valid[still] = False
        for shot, name, _ in every:
            b, r = self.shots.index(shot), receivers.index(name)
            if not valid[b, r].any() and not still[b, r].any():
                unused[shot.name, name] = "no sample is present and below full scale"
        self._refuse_empty(tables, valid)
        if isinstance(noise, float):
            spectra = white_noise(noise, len(receivers), band, dt, n_samples)
        else:
            spectra = _noise(every, tables, receivers, band, dt, noise, still)
        return Records(
            tuple(shot.name for shot in self.shots), receivers, dt, motion, valid,
            band_functions(n_samples, dt, band, None if valid.all() else valid), spectra,
            self.named(unused) | self._still(receivers, still, valid),
        )  # fmt: skip

    def _refuse_empty(self, tables, valid):
        """Refuse a shot without a valid sample."""
        for shot, table, any_valid in zip(self.shots, tables, valid, strict=True):
            if not any_valid.any():
                raise InputError(
                    f"{_place(shot, ', '.join(table))}: no sample after the first firing is "
                    "present and below full scale; take another record, or leave the blast out"
                )

    def named(self, unused: Mapping[tuple[str, str], str]) -> dict[str, str]:
        """Return why recordings are left out: ``R3``, or ``R3 in B1`` where it is not of all."""
        held, named = self.recordings, {}
        for (shot, name), reason in unused.items():
            having = [each for each, table in held.items() if name in table]
            of_all = all(unused.get((each, name)) == reason for each in having)
            named[name if of_all else f"{name} in {shot}"] = reason
        return named

    def _still(self, receivers, still, valid):
        """Return the channels (n_shots, n_receivers, 3) that never move in the same way."""
        alive, named = valid.any(axis=(0, 3)), {}
        for r, c in np.argwhere(still.any(axis=0)):
            channel = f"{receivers[r]} {COMPONENTS[c]}"
            shots = [self.shots[b].name for b in np.flatnonzero(still[:, r, c])]
            labels = [f"{channel} in {name}" for name in shots] if alive[r, c] else [channel]
            named |= dict.fromkeys(labels, "it never moves")
        return named


def _place(shot, name):
    """Return the place of a recording, for messages."""
    return f"{shot.path.name}: receivers.{name}.recorded"


def _geographic(record, receiver):
    """Return a recording along east, north and vertical, and the azimuth of the first component.

    The azimuth is None, but where a horizontal component is missing: that recording stays.
    """
    if receiver.normal is not None or tuple(record.seismogram.components) == GEOGRAPHIC:
        return record, None
    record = like_simulated(record, receiver.azimuth)
    if not record.seismogram.present[:2].all():
        return record, receiver.azimuth
    return record.rotated(receiver.azimuth), None


def _once(record, normal):
    """Return a recording with its component nearest to a direction alone; all without one."""
    if normal is None:
        return record
    held = np.arange(3) == np.argmax(np.abs(normal))
    seismogram = record.seismogram
    velocity = np.where(held, seismogram.velocity, np.nan)
    return replace(
        record, seismogram=replace(seismogram, velocity=velocity), clipped=record.clipped & held
    )


def _sampling(every, band):
    """Return the one sampling interval of recordings, at which simulations hold a band in Hz."""
    dt = every[0][2].dt
    if any(abs(record.dt - dt) > 1e-9 * dt for _, _, record in every):
        raise InputError("case: records differ in sampling rate; resample them to one")
    if band[1] > PASS_BAND * 0.5 / dt:
        raise InputError(
            f"recording.band_hz: reaches to {band[1]:g} Hz; at {1.0 / dt:g} samples a second "
            f"simulations are complete up to {PASS_BAND * 0.5 / dt:.4g} Hz; narrow it to that"
        )
    return dt


def _end(every):
    """Return the time in s at which the shortest recording ends; refuse one that ends early."""
    ends = [float(record.times[-1]) for _, _, record in every]
    shot, name, _ = every[int(np.argmin(ends))]
    if min(ends) < SHORTEST_RECORD * max(ends):
        raise InputError(
            f"{shot.name}: the record of {name} ends {min(ends):.3g} s after the first hole, "
            f"others end at {max(ends):.3g} s, and all are compared up to the end of the "
            "shortest; correct its time_zero, or leave it out"
        )
    return min(ends)


def _noise(every, tables, receivers, band, dt, window, still) -> Noise:
    """Estimate the noise of receivers from a window in s before the shots, see `Survey.records`."""
    first, last = window or (max(record.start for _, _, record in every), 0.0)
    n = int(np.floor((last - first) / dt + 1e-6))
    if window is None and n < LEAST_NOISE:
        shot, name, record = max(every, key=lambda each: each[2].start)
        raise InputError(
            f"{_place(shot, name)}: begins at {record.start:g} s, but waveforms need "
            f"{LEAST_NOISE * dt:.2g} s of noise before the first firing (0 s); take a record with "
            "more pre-trigger, set its start_s, or, for a back-analysis, give noise_mm_per_s"
        )
    noise, recorded = gather(tables, receivers, last - n * dt, dt, n)
    _refuse_uncovered((first, last), every, receivers, recorded)
    recorded[still] = False
    silent = ~np.any(recorded.all(axis=3) & (np.ptp(noise, axis=3) > 0.0), axis=0)
    energy = np.sum(np.var(noise, axis=3), axis=0)
    noise[:, silent] = noise[:, [energy.argmax() // 3], energy.argmax() % 3, ::-1]
    recorded[:, silent] = True
    return noise_of(np.where(recorded, noise, np.nan), dt, band)


def _refuse_uncovered(window, every, receivers, recorded):
    """Refuse a receiver none of whose recordings covers the noise window."""
    (first, last), ever, whole = window, recorded.any(axis=(0, 3)), recorded.all(axis=3)
    for r, name in enumerate(receivers):
        if ever[r].any() and np.all(whole[:, r].any(axis=0) | ~ever[r]):
            continue
        shot, _, record = min((e for e in every if e[1] == name), key=lambda each: each[2].start)
        raise InputError(
            f"recording.noise_window_s: no record of {name} covers {first:g} to {last:g} s; "
            f"that of {shot.name} begins at {record.start:.4g} s"
        )
