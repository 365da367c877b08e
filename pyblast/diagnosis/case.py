"""Case: the records of a project and of its further blasts, gathered into arrays."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..inference.records import COMPONENTS, Records, band_functions, gather, noise_of
from ..model.model import Receiver
from ..project.places import longest_path, resolved_receivers, survey_positions
from ..project.project import Project
from ..project.validity import carried_band
from ..signals.seismogram import GEOGRAPHIC, PASS_BAND
from ..survey import Survey
from .thresholds import SHORTEST_RECORD


@dataclass(frozen=True, eq=False, kw_only=True)
class Case(Records):
    """Case: the records of blasts of a project, from the first hole of each blast on.

    Blasts are ordered from the smallest charge to the largest. A channel without noise is given
    the noise of the channel with most noise.

    Parameters
    ----------
    project : Project
        The reference ground with its blasts; all receivers are given, in geographic axes where
        both horizontals were recorded.
    near : tuple of str
        Receivers with records that stand too near to a source to be compared.
    carried : str
        Why only a part of the band is compared; empty where the mesh carries all.
    gain : (n_receivers,) float64, optional
        Factor on simulated motion, as trusted shots show it.
    share : (n_receivers,) float64, optional
        Model error, share of the energy of a record, as trusted shots show it.
    """

    project: Project
    near: tuple[str, ...] = ()
    carried: str = ""
    gain: np.ndarray | None = None
    share: np.ndarray | None = None


def case_of(project: Project, blasts=None) -> Case:
    """Gather the records of a project and of its further blasts.

    Parameters
    ----------
    project : Project
    blasts : sequence of str, optional
        Names of blasts; all by default.

    Raises
    ------
    InputError
        If a blast does not exist or has no record, records differ in sampling, none begins before
        the blast, the band is missing or comes near half the sampling rate, or the description of
        a flat box is contradictory.
    """
    limits = project.config.band_hz
    if limits is None:
        raise InputError(
            f"{project.path.name}: diagnosis.band_hz: missing; give lowest and highest frequency, "
            "such as [4, 30]"
        )
    project = _gathered(project, limits[1])
    names = tuple(blasts or project.blasts)
    for name in names:
        project.survey.shot(name)
    names = tuple(sorted(names, key=lambda name: float(np.nansum(project.blasts[name].charge))))
    records = [project.survey.recordings[name] for name in names]
    recorded = set().union(*records)
    receivers = tuple(r.name for r in project.receivers if r.name in recorded)
    if not receivers:
        raise InputError("case: none of the receivers has a record")
    far = [set(resolved_receivers(project.of(name), receivers, injected=False)) for name in names]
    near = tuple(name for name in receivers if not all(name in each for each in far))
    receivers = tuple(name for name in receivers if name not in near)
    if not receivers:
        raise InputError(
            "case: every receiver stands near a source of some blast, where the mesh makes errors "
            "above 20 % (D38); name blasts that leave one"
        )
    blasts = [project.of(name) for name in names]
    limits, carried = carried_band(blasts, limits, receivers)
    assert limits is not None  # a case has a band
    window = _noise_window(project, names, records)
    recordings = [table[name] for table in records for name in receivers if name in table]
    dt = recordings[0].seismogram.dt
    if any(abs(recording.seismogram.dt - dt) > 1e-9 * dt for recording in recordings):
        raise InputError("case: records differ in sampling rate; resample them to one")
    if limits[1] > PASS_BAND * 0.5 / dt:
        raise InputError(
            f"recording.band_hz: reaches to {limits[1]:g} Hz; at {1.0 / dt:g} samples a second "
            f"simulations are complete up to {PASS_BAND * 0.5 / dt:.4g} Hz; narrow it to that"
        )
    table = project.config.diagnosis
    end = min(_end(names, records), (table and table.until_s) or np.inf)
    after = 0.0, int(np.floor(end / dt + 1e-6)) + 1
    first, last = window
    before = first, int(np.floor((last - first) / dt + 1e-6))
    (motion, valid), (noise, recorded) = (
        gather(records, receivers, start, dt, n) for start, n in (after, before)
    )
    _check_windows(window, names, receivers, records, recorded)
    constant = valid.any(axis=3) & (np.ptp(motion, axis=3) == 0.0)
    valid[constant], recorded[constant] = False, False
    silent = ~np.any(recorded.all(axis=3) & (np.ptp(noise, axis=3) > 0.0), axis=0)
    noise[:, silent] = _loudest(noise)
    recorded[:, silent] = True
    spectra = noise_of(np.where(recorded, noise, np.nan), dt, limits)
    dead = _dead(constant, valid, names, receivers)
    band = band_functions(motion.shape[-1], dt, limits, None if valid.all() else valid)
    about = {"near": near, "carried": "" if carried is None else carried.text}
    return Case(names, receivers, dt, motion, valid, band, spectra, dead, project=project, **about)


def _gathered(project, highest):
    """Return a project with its records, each blast with the receivers of all blasts.

    A receiver is simulated along east and north if its record has both horizontals, else along the
    axes of its record.
    """
    project = _with_mesh(project, highest)
    receivers, records = {}, {}
    parts = [part for shot in project.shots for part in shot.config.receivers]
    standing = {part.name for part in parts if len(part.position_m) == 2}
    for shot in project.shots:
        each, records[shot.name] = project.of(shot.name), {}
        for receiver in each.receivers:
            position = tuple(map(float, receiver.position))
            axes = receiver.azimuth, receiver.normal
            if receivers.setdefault(receiver.name, (position, *axes))[0] != position:
                raise InputError(
                    f"{each.path.name}: receivers.{receiver.name}.position_m: differs between the "
                    "blasts"
                )
            if receiver.name in each.records:
                record, azimuth = _geographic(each.comparable[receiver.name], receiver.azimuth)
                records[shot.name][receiver.name] = record
                receivers[receiver.name] = position, azimuth, receiver.normal
        if not records[shot.name]:
            raise InputError(
                f"{each.path.name}: receivers: none has a record; add [receivers.recorded]"
            )
    stations = tuple(
        Receiver(name, at[:2] if name in standing else at, *axes)
        for name, (at, *axes) in receivers.items()
    )
    survey = Survey(project.held_shots, stations, records, project.survey.band)
    return replace(project, survey=survey)


def _with_mesh(project, highest):
    """Return a project with meshed blasts for a band; all share the ground.

    The ground reaches half the longest of the shortest S wavelengths beyond holes and receivers, so
    that receivers can be moved.
    """
    reach = 0.5 * max(material.cs for material in project.materials.values()) / highest
    aside = reach * np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
    positions = np.concatenate([survey_positions(project) + step for step in aside])
    project = replace(project, span=longest_path(positions))
    return project.changed(mesh=project.for_band(highest))


def _geographic(record, azimuth):
    """Return a record along east, north and vertical with None, or unchanged with its azimuth."""
    seismogram = record.seismogram
    if azimuth is None or tuple(seismogram.components) == GEOGRAPHIC:
        return record, None
    if not np.isfinite(seismogram.velocity[:, :2]).any(axis=0).all():
        return record, azimuth
    clipped = record.clipped
    either = clipped[:, :1] | clipped[:, 1:2]  # rotation mixes both horizontals
    marks = np.hstack([either, either, clipped[:, 2:]])
    return replace(record, seismogram=seismogram.rotated(azimuth), clipped=marks), None


def _noise_window(project, names, records):
    """Return the window of noise in s: as given, or all records before the blast."""
    table = project.config.diagnosis
    if table is not None and table.noise_window_s:
        return table.noise_window_s[0], table.noise_window_s[1]
    last, receiver, blast = max(
        (record.seismogram.start, receiver, blast)
        for blast, table in zip(names, records, strict=True)
        for receiver, record in table.items()
    )
    if last >= 0.0:
        raise InputError(
            f"receivers.{receiver}.recorded: the record of {blast} begins {last:g} s after the "
            "first hole, and noise is estimated from before it; give records with a pre-trigger"
        )
    return last, 0.0


def _dead(constant, valid, names, receivers):
    """Name constant channels (n_blasts, n_receivers, 3), with the blast if alive in others."""
    alive, dead = valid.any(axis=(0, 3)), []
    for r, c in np.argwhere(constant.any(axis=0)):
        channel = f"{receivers[r]} {COMPONENTS[c]}"
        blasts = [f"{channel} in {names[b]}" for b in np.flatnonzero(constant[:, r, c])]
        dead += blasts if alive[r, c] else [channel]
    return tuple(dead)


def _end(names, records):
    """Return the time in s at which the shortest record ends; refuse one that ends too early."""
    ends = {
        (blast, name): float(record.seismogram.times[-1])
        for blast, table in zip(names, records, strict=True) for name, record in table.items()
    }  # fmt: skip
    blast, name = early = min(ends, key=ends.__getitem__)
    longest = max(ends.values())
    if ends[early] < SHORTEST_RECORD * longest:
        raise InputError(
            f"{blast}: the record of {name} ends {ends[early]:.3g} s after the first hole, others "
            f"end at {longest:.3g} s, and all are compared up to the end of the shortest; correct "
            "its time_zero, or leave it out"
        )
    return ends[early]


def _check_windows(window, names, receivers, records, recorded):
    """Refuse a receiver none of whose records covers the noise window."""
    (first, last), ever, whole = window, recorded.any(axis=(0, 3)), recorded.all(axis=3)
    for r, name in enumerate(receivers):
        if ever[r].any() and np.all(whole[:, r].any(axis=0) | ~ever[r]):
            continue
        tables = zip(names, records, strict=True)
        starts = [(table[name].seismogram.start, b) for b, table in tables if name in table]
        start, blast = min(starts, key=lambda pair: pair[0])
        raise InputError(
            f"recording.noise_window_s: no record of {name} covers {first:g} to {last:g} s; "
            f"that of {blast} begins at {start:.4g} s"
        )


def _loudest(noise):
    """Return the noise (n_blasts, 1, n) of the channel with most energy."""
    energy = np.sum(np.var(noise, axis=3), axis=0)
    return noise[:, [energy.argmax() // 3], energy.argmax() % 3]
