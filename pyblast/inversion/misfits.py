"""Misfits of a simulated seismogram against the recorded one, by name."""

from collections.abc import Callable

from ..motion.comparison import compare
from ..motion.seismogram import Seismogram

Misfit = Callable[[Seismogram, Seismogram, tuple[float, float] | None], float]


def paper(recorded: Seismogram, simulated: Seismogram, band=None) -> float:
    """Return the mean absolute deviation of PPV and dominant frequency in %; theory.md (11.1)."""
    return compare(recorded, simulated, band, time_frequency=False).misfit


MISFITS: dict[str, Misfit] = {"paper": paper}
