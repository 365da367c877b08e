"""Misfits of a simulated seismogram against the recorded one, by the names of project files."""

import numpy as np

from ..motion.comparison import compare
from ..motion.seismogram import Seismogram
from ..residuals.misfits import misfit

SIGNED = ("paper", "lag", "onset")  # with residuals that least squares can take
MISFITS = {"paper": "%", "envelope": "", "phase": "", "lag": "s", "onset": "s"}  # with their units


def misfit_to(name, recorded: Seismogram, simulated: Seismogram, band=None):
    """Return the misfit of a simulated seismogram to a record over the time of both.

    Parameters
    ----------
    name : str
        Of `MISFITS`: ``paper`` of theory.md (11.1), the others of (7.5) and (7.20).
    recorded, simulated : Seismogram
        In the same components.
    band : tuple of 2 float, Hz, optional
        To which both are filtered first.

    Returns
    -------
    float
    (n,) float64
        Residuals that it is made of; none unless it is one of `SIGNED`.

    Raises
    ------
    InputError
        If the two have nothing to compare.
    """
    if name == "paper":
        found = compare(recorded, simulated, band, time_frequency=False)
        deviations = np.concatenate([found.ppv_deviation, found.frequency_deviation])
        return found.misfit, 100.0 * np.nan_to_num(deviations)
    end = min(recorded.start + recorded.duration, simulated.start + simulated.duration)
    recorded = recorded.windowed(recorded.start, end)
    found = simulated.sampled(recorded.start, recorded.dt, len(recorded.velocity))
    data, model = (np.nan_to_num(one.velocity).T[None, None] for one in (recorded, found))
    made = misfit(name, data, recorded.dt, band=band)
    return made.value(model), made.residuals(model) if name in SIGNED else np.zeros(0)
