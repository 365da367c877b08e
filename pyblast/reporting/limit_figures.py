"""Peaks against frequency under the limit curves that a project asks for; nothing is judged."""

import numpy as np

from ..motion.spectra import zero_crossing_frequency
from .figures import LETTERS, RECORDED, SIMULATED, _figure, _short, _tidy, _uri

SUM = "vector sum"
LEAST_SPAN = 1.0, 100.0  # Hz
TICKS = [a * 10.0**b for b in range(-4, 5) for a in (1, 2, 5)]


def limits_figure(motions, curves):
    """Draw the peak of each component, and of the vector sum if a curve limits that.

    Parameters
    ----------
    motions : dict of str to dict of str to Seismogram
        By "simulated" and "recorded", then by receiver.
    curves : sequence of LimitCurve

    Returns
    -------
    image : str
        A data URI.
    left_out : list of str
        Peaks that have no frequency; see `peaks_of`.
    """
    summed = any(curve.quantity == SUM for curve in curves)
    peaks = [
        (kind, f"{name} {what}", size, hz)
        for kind, some in motions.items()
        for name, motion in some.items()
        for what, size, hz in peaks_of(motion, summed)
    ]
    drawn = [one for one in peaks if np.isfinite(one[-1])]
    span = [*LEAST_SPAN, *(hz for *_, hz in drawn)]
    frequency = np.geomspace(min(span), 1.2 * max(span), 2000)
    figure = _figure(9.6, 5.0)
    axes = figure.subplots()
    for curve in curves:
        doubt = "" if curve.verified else ", unverified"
        label = f"{curve.name} ({curve.quantity}{doubt})"
        axes.loglog(frequency, 1e3 * curve.limit(frequency), lw=1.1, label=label)
    for kind, colour in zip(motions, (SIMULATED, RECORDED), strict=False):
        of_kind = [(text, 1e3 * size, hz) for k, text, size, hz in drawn if k == kind]
        label = kind
        for text, size, hz in of_kind:
            axes.plot(hz, size, "o", ms=4, color=colour, label=label)
            axes.annotate(
                text, (hz, size), (4, 0), textcoords="offset points", fontsize=6.5, color=colour,
                va="center",
            )  # fmt: skip
            label = None
    axes.set_xlabel("frequency by zero crossing  Hz")
    axes.set_ylabel("peak particle velocity  mm/s")
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        ticks = [tick for tick in TICKS if low <= tick <= high]
        axis.set_ticks(ticks, [_short(tick) for tick in ticks])
        axis.set_ticks([], minor=True)
    axes.set_xlim(frequency[0], frequency[-1])
    axes.legend(fontsize=7, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    _tidy(axes)
    return _uri(figure), [f"{text} ({kind})" for kind, text, _, hz in peaks if not np.isfinite(hz)]


def peaks_of(motion, summed):
    """Return name, size in m/s and frequency in Hz of the peaks of a place.

    Frequencies are by zero crossing at the peak, that of the largest component for the vector
    sum; NaN without crossings on both sides. Components that are silent or missing have no peak.
    """
    frequency = zero_crossing_frequency(motion).hz
    rows = [
        (LETTERS[name], float(size), float(hz))
        for name, size, hz in zip(motion.components, motion.ppv, frequency, strict=True)
    ]
    if summed:
        rows.append((SUM, motion.pvs, float(frequency[np.nanargmax(motion.ppv)])))
    return [row for row in rows if row[1] > 0.0]
