"""What slipped in a blast, and how much stronger it would have to be, in sentences."""

import math


def slip_lines(name, blast):
    """Say of each joint surface of a blast what slipped, and how much stronger it would take.

    Parameters
    ----------
    name : str
    blast : dict
        ``strength`` and ``receivers`` of a summary.
    """
    for surface, one in blast["strength"].items():
        yield f"{name}, {surface}: {_slipped(one)}{_first(one, blast['receivers'])}"


def _slipped(one):
    """Say how many contacts slipped or opened."""
    before = f" ({one['before']} had failed before the blast)" if one["before"] else ""
    if one["failed"]:
        return f"{one['failed']} of {one['contacts']} contacts slipped or opened{before}"
    return f"no contact slipped or opened{before}"


def _first(one, receivers):
    """Say at which peak velocity the first of the contacts that held would give way."""
    factor = one["factor"]
    if one["failed"] or not factor > 0.0:
        return "."
    if not math.isfinite(factor):
        return "; no blast of this form would bring one there."
    at = ", ".join(
        f"{1e3 * factor * max(v for v in r['simulated']['ppv'] if math.isfinite(v)):.3g} mm/s at "
        f"{name}"
        for name, r in receivers.items()
    )
    return f"; the first of those that held would at {factor:.3g} times this blast, {at}."
