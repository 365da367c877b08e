"""Memory: what the machine has left, what a mesh needs, and a refusal beforehand."""

import os
from pathlib import Path

from ..errors import InputError

# Measured growth of the process per zone: gmsh with its mesh, and a grid.
MESHING_BYTES, GRID_BYTES = 1900.0, 300.0
ZONES_PER_CUBE = 11.0  # zones in a volume of one mean edge cubed
_GROUPS = Path("/sys/fs/cgroup")
_LIMITS = (
    (_GROUPS / "memory.max", _GROUPS / "memory.current"),
    (_GROUPS / "memory/memory.limit_in_bytes", _GROUPS / "memory/memory.usage_in_bytes"),
)


def available():
    """Return the memory in bytes that the machine has left, within the limit of a container.

    Without word from the system it is infinite.
    """
    free = [_left(*files) for files in _LIMITS]
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        known = dict(line.split(":", 1) for line in lines if ":" in line)
        free.append(1024.0 * float(known["MemAvailable"].split()[0]))
    except (OSError, KeyError, ValueError):
        free.append(_pages())
    return min(free)


def _left(limit, used):
    """Return what a container may still take, infinite where it has no limit."""
    try:
        return float(limit.read_text()) - float(used.read_text())
    except (OSError, ValueError):
        return float("inf")


def _pages():
    """Return the memory of a system without /proc, infinite where it does not tell."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return float("inf")


def refuse_beyond_memory(what, needed):
    """Refuse what needs more bytes than there are.

    Raises
    ------
    InputError
        With both numbers.
    """
    free = available()
    if needed > free:
        raise InputError(
            f"{what} needs about {needed / 1e9:.3g} GB of memory, the machine has "
            f"{free / 1e9:.3g} GB left; take longer edges, fewer receivers or a shorter duration"
        )
