"""Case: the records of a project and of its further blasts as arrays."""

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, named_error
from ..inference.records import COMPONENTS, Records, band_functions, gather, noise_of
from ..model.model import Receiver
from ..project.flat_box import band_of, check_flat, flat_box, not_flat, place_in_box
from ..project.project import Project
from ..signals.seismogram import GEOGRAPHIC, PASS_BAND
from .thresholds import SHORTEST_RECORD


@dataclass(frozen=True, eq=False, kw_only=True)
class Case(Records):
    """The records of some blasts of a project, from the first hole of each blast on.

    Blasts are ordered from the smallest charge to the largest; the noise of a channel that never
    moves is that of the loudest one.

    Parameters
    ----------
    project : Project
        The reference ground with its blasts; all receivers are given, in geographic axes where
        both horizontals were recorded.
    """

    project: Project


def case_of(project: Project, blasts=None) -> Case:
    """Gather the records of a project and of its further blasts.

    Parameters
    ----------
    project : Project
    blasts : sequence of str, optional
        Which of its blasts; all of them by default.

    Raises
    ------
    InputError
        If a blast is not there or has no record, records differ in sampling, none begins before
        the blast, the band is missing or comes near half the sampling rate, or a flat box can't be
        as it is described.
    """
    project = _gathered(project)
    names = tuple(blasts or project.blasts)
    every = {one.name: one for one in (project, *project.further)}
    for name in names:
        if name not in every:
            raise InputError(f"case: no blast {name!r}; there are {', '.join(every)}")
    names = tuple(sorted(names, key=lambda name: float(np.nansum(project.blasts[name].charge))))
    records = [every[name].records for name in names]
    receivers = tuple(r.name for r in project.receivers if any(r.name in some for some in records))
    if not receivers:
        raise InputError("case: none of the receivers has a record")
    limits, window = band_of(project.config), _noise_window(project, names, records)
    recordings = [some[name] for some in records for name in receivers if name in some]
    dt = recordings[0].seismogram.dt
    if any(abs(one.seismogram.dt - dt) > 1e-9 * dt for one in recordings):
        raise InputError("case: records differ in sampling rate; resample them to one")
    if limits[1] > PASS_BAND * 0.5 / dt:
        raise InputError(
            f"recording.band_hz: reaches to {limits[1]:g} Hz; at {1.0 / dt:g} samples a second "
            f"what is simulated is whole up to {PASS_BAND * 0.5 / dt:.4g} Hz; narrow it to that"
        )
    after = 0.0, int(np.floor(_end(names, records) / dt + 1e-6)) + 1
    first, last = window
    before = first, int(np.floor((last - first) / dt + 1e-6))
    (motion, valid), (quiet, heard) = (
        gather(records, receivers, start, dt, n) for start, n in (after, before)
    )
    _check_windows(window, names, receivers, records, heard)
    still = valid.any(axis=3) & (np.ptp(motion, axis=3) == 0.0)
    valid[still], heard[still] = False, False
    silent = ~np.any(heard.all(axis=3) & (np.ptp(quiet, axis=3) > 0.0), axis=0)
    quiet[:, silent] = _loudest(quiet)
    heard[:, silent] = True
    noise = noise_of(np.where(heard, quiet, np.nan), dt, limits)
    dead = _dead(still, valid, names, receivers)
    whole = None if valid.all() else valid
    band = band_functions(motion.shape[-1], dt, limits, whole)
    return Case(names, receivers, dt, motion, valid, band, noise, dead, project=project)


def _gathered(project):
    """Return a project with its records, and with the receivers of all its blasts in each.

    A receiver whose record has both horizontals is simulated east and north, any other along the
    axes of its record.
    """
    if band_of(project.config) is None:
        raise InputError(
            f"{project.path.name}: diagnosis.band_hz: missing; give lowest and highest frequency, "
            "such as [4, 30]"
        )
    if not_flat(project):
        project = _with_mesh(project)
    places, records, parts = {}, {}, {}
    for one in (project, *project.further):
        records[one.name] = {}
        parts[one.name] = {"blast": one.blast, "inside": one.inside}
        for receiver in _receivers(one, project):
            place = tuple(map(float, receiver.position))
            if places.setdefault(receiver.name, (place, receiver.azimuth))[0] != place:
                raise InputError(
                    f"{one.path.name}: receivers.{receiver.name}.position_m: differs between the "
                    "blasts"
                )
            if receiver.name in one.records:
                record, azimuth = _geographic(one.records[receiver.name], receiver.azimuth)
                records[one.name][receiver.name] = record
                places[receiver.name] = place, azimuth
        if not records[one.name]:
            raise InputError(
                f"{one.path.name}: receivers: none has a record; add [receivers.recorded]"
            )
    further = tuple(replace(o, given={**o.given, **parts[o.name]}) for o in project.further)
    project = replace(
        project, given={**project.given, **parts[project.name]}, further=further
    ).changed(
        receivers=[Receiver(name, *rest) for name, rest in places.items()], records=records
    )  # fmt: skip
    if not not_flat(project):
        with named_error(project.path.name):
            check_flat(project)
    return project


def _with_mesh(project):
    """Return a project whose blasts have their mesh, the same unless each has damaged its own."""
    shared = {"mesh": project.mesh}
    own = project.config.ground.damaged_zone is not None
    further = tuple(
        replace(one, given={**one.given, **({"mesh": one.mesh} if own else shared)})
        for one in project.further
    )
    return replace(project, given={**project.given, **shared}, further=further)


def _receivers(one, project):
    """Return the receivers of one blast: given, in a flat box, or placed in the mesh."""
    if "receivers" in one.given or not_flat(project):
        return one.receivers
    return place_in_box(one.config.receivers, flat_box(project))


def _geographic(record, azimuth):
    """Return a record east, north, vertical, and the azimuth along which it stays instead."""
    seismogram = record.seismogram
    if azimuth is None or tuple(seismogram.components) == GEOGRAPHIC:
        return record, None
    if not np.isfinite(seismogram.velocity[:, :2]).any(axis=0).all():
        return record, azimuth
    clipped = record.clipped
    either = clipped[:, :1] | clipped[:, 1:2]  # each horizontal component takes from both
    marks = np.hstack([either, either, clipped[:, 2:]])
    return replace(record, seismogram=seismogram.rotated(azimuth), clipped=marks), None


def _noise_window(project, names, records):
    """Return when nothing but noise was recorded: as given, or all that comes before."""
    table = project.config.diagnosis
    if table is not None and table.noise_window_s:
        return table.noise_window_s[0], table.noise_window_s[1]
    last, receiver, blast = max(
        (one.seismogram.start, receiver, blast)
        for blast, some in zip(names, records, strict=True)
        for receiver, one in some.items()
    )
    if last >= 0.0:
        raise InputError(
            f"receivers.{receiver}.recorded: the record of {blast} begins {last:g} s after the "
            "first hole, but noise is learnt from before; give records with a pre-trigger"
        )
    return last, 0.0


def _dead(still, valid, names, receivers):
    """Name the channels that stand still, (n_blasts, n_receivers, 3), by blast if not in all."""
    ever, told = valid.any(axis=(0, 3)), []
    for r, c in np.argwhere(still.any(axis=0)):
        channel = f"{receivers[r]} {COMPONENTS[c]}"
        blasts = [f"{channel} in {names[b]}" for b in np.flatnonzero(still[:, r, c])]
        told += blasts if ever[r, c] else [channel]
    return tuple(told)


def _end(names, records):
    """Return the time in s at which the first record ends; refuse one that ends far too early."""
    ends = {
        (blast, name): float(one.seismogram.times[-1])
        for blast, some in zip(names, records, strict=True) for name, one in some.items()
    }  # fmt: skip
    blast, name = early = min(ends, key=ends.get)
    longest = max(ends.values())
    if ends[early] < SHORTEST_RECORD * longest:
        raise InputError(
            f"{blast}: the record of {name} ends {ends[early]:.3g} s after the first hole, others "
            f"end at {longest:.3g} s, and all are compared as far as the shortest; mend its "
            "time_zero, or take it out"
        )
    return ends[early]


def _check_windows(window, names, receivers, records, heard):
    """Refuse a receiver none of whose records holds the window of noise."""
    (first, last), ever, whole = window, heard.any(axis=(0, 3)), heard.all(axis=3)
    for r, name in enumerate(receivers):
        if ever[r].any() and np.all(whole[:, r].any(axis=0) | ~ever[r]):
            continue
        starts = [(b, some[name]) for b, some in zip(names, records, strict=True) if name in some]
        blast, one = min(starts, key=lambda pair: pair[1].seismogram.start)
        raise InputError(
            f"recording.noise_window_s: no record of {name} holds {first:g} to {last:g} s whole; "
            f"that of {blast} begins at {one.seismogram.start:.4g} s"
        )


def _loudest(quiet):
    """Return the window (n_blasts, 1, n) of the channel that moves most."""
    energy = np.sum(np.var(quiet, axis=3), axis=0)
    return quiet[:, [energy.argmax() // 3], energy.argmax() % 3]
