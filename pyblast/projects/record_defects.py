"""Defects of simulated records that show after a run: D28 and D29."""

import numpy as np

from ..motion.spectra import dominant_frequency
from .findings import Finding

END_SHARE = 0.05
STILL = 0.2
LEAST_CYCLES = 2.0


def record_findings(simulated) -> tuple[Finding, ...]:
    """Return what is doubtful about the records of a run.

    Parameters
    ----------
    simulated : dict of str to Seismogram
        By receiver; zero time is the first firing.
    """
    found = cut_short(simulated), low_frequencies(simulated)
    return tuple(finding for finding in found if finding is not None)


def cut_short(simulated):
    """D28: records that end while the ground still moves; None where all are quiet by then."""
    left, late = {}, []
    for name, record in simulated.items():
        size = np.linalg.norm(record.velocity, axis=1)
        last = record.times > record.times[-1] - END_SHARE * (
            record.times[-1] - min(0, record.start)
        )
        share = float(size[last].max() / size.max()) if size.any() else 0.0
        if share > STILL:
            left[name] = share
            late += [name] if last[int(size.argmax())] else []
    if not left:
        return None
    listed = ", ".join(f"{100 * share:.0f} % at {name}" for name, share in left.items())
    peak = f"; the peak at {', '.join(late)} comes that late" if late else ""
    return Finding(
        "D28",
        "The record ends while the ground still moves",
        f"In its last twentieth the motion still reaches {listed} of its peak{peak}: peaks, "
        "durations and low frequencies may change with a longer run.duration_s.",
        numbers=left,
    )


def low_frequencies(simulated):
    """D29: dominant frequencies of which fewer than two cycles fit into the record; else None."""
    low, shortest = {}, np.inf
    for name, record in simulated.items():
        lasts = record.times[-1] - max(0.0, record.start)
        for component, hz in zip(record.components, dominant_frequency(record).hz, strict=True):
            if hz * lasts < LEAST_CYCLES:
                low[f"{name} {component}"] = float(hz)
                shortest = min(shortest, lasts)
    if not low:
        return None
    listed = ", ".join(f"{hz:.3g} Hz at {name}" for name, hz in low.items())
    return Finding(
        "D29",
        "Dominant frequencies are as low as the record is short",
        f"{listed}: fewer than two cycles fit into {shortest:.3g} s, so the length of the record "
        "sets them as much as the ground does; lengthen run.duration_s before you use them.",
        numbers=low,
    )
