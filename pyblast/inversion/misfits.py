"""What a search minimises: misfits of all blasts and receivers of a project, each on its record."""

import numpy as np

from ..errors import InputError
from ..motion.seismogram import Seismogram
from ..residuals.misfits import misfit


def misfit_to(name, recorded: Seismogram, simulated: Seismogram, band=None):
    """Return the misfit of a simulated seismogram to a record over the time of both.

    Parameters
    ----------
    name : str
        Of `residuals.misfits.MISFITS` but ``waveform``: theory.md (11.1), (7.5) and (7.20).
    recorded, simulated : Seismogram
        In the same components.
    band : tuple of 2 float, Hz, optional
        To which both are filtered first.

    Returns
    -------
    float
    (n,) float64
        Residuals that it is made of; none where the misfit has none.

    Raises
    ------
    InputError
        If the two have nothing to compare.
    """
    if recorded.components != simulated.components:
        raise InputError(
            f"misfit: components differ, {', '.join(recorded.components)} in the record and "
            f"{', '.join(simulated.components)} in the simulation"
        )
    end = min(recorded.start + recorded.duration, simulated.start + simulated.duration)
    recorded = recorded.windowed(recorded.start, end)
    found = simulated.sampled(recorded.start, recorded.dt, len(recorded.velocity))
    data, model = (np.nan_to_num(one.velocity).T[None, None] for one in (recorded, found))
    made = misfit(name, data, recorded.dt, band=band)
    return made.value(model), np.zeros(0) if made.residuals is None else made.residuals(model)
