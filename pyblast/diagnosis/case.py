"""A site with its records as arrays: what a diagnosis compares."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..inference.records import COMPONENTS, Records, band_functions, gather, noise_of
from ..project.site import Site
from ..signals.seismogram import PASS_BAND
from .thresholds import SHORTEST_RECORD


@dataclass(frozen=True, eq=False, kw_only=True)
class Case(Records):
    """The records of some blasts of a site, from the first hole of each blast on.

    Blasts are ordered from the smallest charge to the largest; the noise of a channel that never
    moves is that of the loudest one.

    Parameters
    ----------
    site : Site
        As it is known before the records are used.
    """

    site: Site


def case_of(site: Site, blasts=None) -> Case:
    """Gather the records of a site.

    Parameters
    ----------
    site : Site
    blasts : sequence of str, optional
        Which of its blasts; all of them by default.

    Raises
    ------
    InputError
        If a blast is not there, records differ in sampling, none begins before the blast, or the
        band comes near half the sampling rate.
    """
    names = tuple(blasts or site.blasts)
    for name in names:
        if name not in site.records:
            raise InputError(f"case: no blast {name!r}; there are {', '.join(site.records)}")
    names = tuple(sorted(names, key=lambda name: float(np.sum(site.blasts[name].charge))))
    records = [site.records[name] for name in names]
    receivers = tuple(r.name for r in site.receivers if any(r.name in some for some in records))
    if not receivers:
        raise InputError("case: none of the receivers of the site has a record")
    every = [some[name] for some in records for name in receivers if name in some]
    dt = every[0].seismogram.dt
    if any(abs(one.seismogram.dt - dt) > 1e-9 * dt for one in every):
        raise InputError("case: records differ in sampling rate; resample them to one")
    if site.band[1] > PASS_BAND * 0.5 / dt:
        raise InputError(
            f"recording.band_hz: reaches to {site.band[1]:g} Hz; at {1.0 / dt:g} samples a second "
            f"what is simulated is whole up to {PASS_BAND * 0.5 / dt:.4g} Hz; narrow it to that"
        )
    after = 0.0, int(np.floor(_end(names, records) / dt + 1e-6)) + 1
    first, last = site.noise_window
    before = first, int(np.floor((last - first) / dt + 1e-6))
    (motion, valid), (quiet, heard) = (
        gather(records, receivers, start, dt, n) for start, n in (after, before)
    )
    _check_windows(site, names, receivers, records, heard)
    still = valid.any(axis=3) & (np.ptp(motion, axis=3) == 0.0)
    valid[still], heard[still] = False, False
    silent = ~np.any(heard.all(axis=3) & (np.ptp(quiet, axis=3) > 0.0), axis=0)
    quiet[:, silent] = _loudest(quiet)
    heard[:, silent] = True
    noise = noise_of(np.where(heard, quiet, np.nan), dt, site.band)
    dead = _dead(still, valid, names, receivers)
    whole = None if valid.all() else valid
    band = band_functions(motion.shape[-1], dt, site.band, whole)
    return Case(names, receivers, dt, motion, valid, band, noise, dead, site=site)


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


def _check_windows(site, names, receivers, records, heard):
    """Refuse a receiver none of whose records holds the window of noise."""
    (first, last), ever, whole = site.noise_window, heard.any(axis=(0, 3)), heard.all(axis=3)
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
