"""What is doubtful about the holes of a blast, in plain sentences."""

import math
from collections import Counter

import numpy as np

ANFO_DENSITY = 850.0
SAME_PLACE = 0.01
SAME_INSTANT = 1e-6
FAR_AWAY = 1000.0
ANGLE_TOLERANCE = math.radians(2.0)
LENGTH_TOLERANCE = 0.1


def hole_sentences(blast):
    """Check times, charges, names, places, angles and lengths.

    Parameters
    ----------
    blast : Blast

    Returns
    -------
    list of str
        Times and charge per 8 ms window always; every other sentence only where it applies.
    """
    return [
        _timing(blast),
        _charging(blast),
        *_misfires(blast),
        *_duplicates(blast),
        *_far_holes(blast),
        *_angles(blast),
        *_lengths(blast),
        *_tight_charges(blast),
    ]


def _timing(blast):
    """Say when the first and the last charge fire."""
    first, last = 1e3 * blast.times.min(), 1e3 * blast.times.max()
    instants = len(np.unique(np.round(blast.times / SAME_INSTANT)))
    return (
        f"{len(blast.times)} charges fire at {instants} instants, the first at {first:g} ms, "
        f"the last at {last:g} ms."
    )


def _charging(blast):
    """Say the charge per 8 ms window, or whose charge is missing."""
    missing = np.isnan(blast.charge)
    if np.any(missing):
        return (
            f"The charge is missing for {blast.named(missing)}; "
            "the charge per 8 ms window is not known."
        )
    times, charges = blast.window_charges()
    largest = int(np.argmax(charges))
    return (
        f"The largest charge in any 8 ms window is {charges[largest]:.6g} kg, from "
        f"{1e3 * times[largest]:g} ms on, of {np.sum(blast.charge):.6g} kg in all."
    )


def _misfires(blast):
    """Name the holes without any charge."""
    if np.any(blast.charge == 0.0):
        yield f"The charge is 0 for {blast.named(blast.charge == 0.0)}: no motion comes from there."


def _duplicates(blast):
    """Find names, places and instants that occur twice."""
    ids = Counter(zip(blast.hole_ids, map(tuple, np.nan_to_num(blast.deck)), strict=True))
    twice = list(dict.fromkeys(name for (name, _), count in ids.items() if count > 1))
    if twice:
        yield f"Hole names that occur more than once: {', '.join(twice[:5])} ({len(twice)} in all)."
    cells = np.round((blast.centres - blast.centres[0]) / SAME_PLACE).astype(np.int64)
    n_shared = len(cells) - len(np.unique(cells, axis=0))
    if n_shared:
        yield f"{n_shared} charges lie within 1 cm of another charge of the table."
    ((instant, count),) = Counter(np.round(blast.times / SAME_INSTANT)).most_common(1)
    if count > 1:
        yield f"Up to {count} charges share one instant (at {1e3 * instant * SAME_INSTANT:g} ms)."


def _far_holes(blast):
    """Find holes more than 1 km from the centroid, taken by the median so that none moves it."""
    away = np.linalg.norm(blast.centres - np.median(blast.centres, axis=0), axis=1)
    if np.any(away > FAR_AWAY):
        yield f"More than 1 km from the centroid of the blast: {blast.named(away > FAR_AWAY)}."


def _angles(blast):
    """Find out whether stated angles count from the vertical, the horizontal or neither."""
    length = np.where(blast.length > 0.0, blast.length, np.nan)
    vertical = np.arccos(np.clip((blast.collar - blast.toe)[:, 2] / length, -1.0, 1.0))
    known = ~np.isnan(blast.stated_inclination) & ~np.isnan(vertical)
    from_vertical = np.abs(blast.stated_inclination - vertical) < ANGLE_TOLERANCE
    complement = math.pi / 2.0 - blast.stated_inclination
    from_horizontal = np.abs(complement - vertical) < ANGLE_TOLERANCE
    if np.any(from_horizontal & from_vertical):
        yield (
            "Angles near 45 degrees do not tell whether they count from the vertical: "
            f"{blast.named(from_horizontal & from_vertical)}."
        )
    if np.any(from_horizontal & ~from_vertical):
        yield (
            "The stated angle counts from the horizontal, by collar and toe: "
            f"{blast.named(from_horizontal & ~from_vertical)}."
        )
    neither = known & ~from_vertical & ~from_horizontal
    if np.any(neither):
        yield (
            "The stated angle differs from collar and toe by more than 2 degrees, whether from "
            f"the vertical or the horizontal: {blast.named(neither)}."
        )


def _lengths(blast):
    """Find stated lengths that differ from the distance between collar and toe."""
    gap = np.where(blast.length > 0.0, np.abs(blast.stated_length - blast.length), 0.0)
    off = gap > LENGTH_TOLERANCE
    if np.any(off):
        worst = int(np.nanargmax(gap))
        yield (
            f"The stated length differs from collar to toe by more than {LENGTH_TOLERANCE:g} m: "
            f"{blast.named(off)}; worst {blast.hole_ids[worst]}, "
            f"{blast.stated_length[worst]:.4g} m against {blast.length[worst]:.4g} m."
        )


def _tight_charges(blast):
    """Find charges that are longer than their deck or hole."""
    deck = blast.deck[:, 1] - blast.deck[:, 0]
    room = np.where(np.isnan(deck), blast.length, deck)
    filled = np.where(room > 0.0, blast.charge_length / np.where(room > 0.0, room, 1.0), 0.0)
    if np.any(filled > 1.0):
        worst, density = int(np.nanargmax(filled)), blast.explosive_density
        kind = f"at {density:g} kg/m3"
        if density == ANFO_DENSITY:
            kind = f"as ANFO ({density:g} kg/m3 assumed)"
        yield (
            f"The charge does not fit {kind}: {blast.named(filled > 1.0)}; "
            f"worst {blast.hole_ids[worst]}, {blast.charge[worst]:g} kg need "
            f"{blast.charge_length[worst]:.3g} m of {room[worst]:.3g} m "
            f"(a full hole would hold {filled[worst] * density:.4g} kg/m3)."
        )
