"""Effects on the holes of blasts: firing times and charges, and the table of hole effects."""

from functools import partial

import numpy as np

from ...blasts.hole_effects import ROWS, HoleChange, Pattern, since_first
from ..hypotheses import (
    blast_and_hole,
    blasts_of_many_holes,
    holes,
    hypothesis,
    patterns_of,
    pulse_known,
    superposed,
)

_LOG = "the log of the detonators, or a sensor beside the holes"
_SHEETS = "the loading sheets, and a look at the muck pile for what is left"
_OF_BLAST = {"family": "source", "on": "holes", "axis": "receivers", "target": "blast"}
_OF_HOLES = _OF_BLAST | {"targets": blasts_of_many_holes, "simulated": (superposed,)}


@hypothesis("delay_scatter", **_OF_HOLES, decided_by=_LOG)
def delay_scatter(pattern: Pattern, target, delays):
    """The holes of this blast did not fire at their planned times."""
    del pattern, target
    return HoleChange(delay=delays)


@hypothesis("delay_scatter", form="pace", **_OF_HOLES, decided_by=_LOG)
def wrong_pace(pattern: Pattern, target, pace):
    """All delays of this blast were longer or shorter than planned, by one factor."""
    del target
    return HoleChange(delay=(pace - 1.0) * since_first(pattern))


@hypothesis("misfire_or_charge_error", form="holes", **_OF_HOLES, decided_by=_SHEETS)
def misfire_or_charge_error(pattern: Pattern, target, scales):
    """Holes of this blast radiated less or more than their charge should, or nothing."""
    del pattern, target
    return HoleChange(scales)


@hypothesis(
    "misfire_or_charge_error", form="misfire", **_OF_HOLES | {"target": "hole", "targets": holes},
    single=True, decided_by="a look at the muck pile for the charge of this hole",
)  # fmt: skip
def misfire(pattern: Pattern, target, radiated):
    """This hole misfired: it radiated nothing, or little, of what its charge should."""
    _, hole = blast_and_hole(target)
    silent = np.array([name == hole for name in pattern.blast.hole_ids])
    return HoleChange(np.where(silent, radiated, 1.0))


@hypothesis(
    "misfire_or_charge_error", form="blast", **_OF_BLAST,
    decided_by="the loading sheets, or single holes of other charges",
)  # fmt: skip
def charge_error(pattern: Pattern, target, scale):
    """All holes of this blast radiated less or more than their charge should, by one factor."""
    del pattern, target
    return HoleChange(scale)


@hypothesis(
    "clock_error", form="blast", **_OF_BLAST,
    decided_by="a sensor beside the first hole, on the clock of the receivers",
)  # fmt: skip
def trigger_error(pattern: Pattern, target, shift):
    """The zero of time of this blast was wrong: all receivers recorded it late or early alike."""
    del pattern, target
    return HoleChange(delay=shift)


def _varies(row, case):
    """Return why the covariate of a row tells nothing in a case; empty if it varies."""
    return row.hardly_varies(patterns_of(case))


def _enter_rows():
    """Enter a hypothesis for each row of the table, of one strength at all holes of the site."""
    for row in ROWS:

        def applied(pattern, target, strength, row=row):
            del target
            return row.change(pattern, strength)

        applied.__doc__ = row.claim
        needs = (pulse_known,) if row.kernel == "duration" else ()
        hypothesis(
            row.label, form=row.form, family="path" if row.label == "screening" else "source",
            on="holes", axis="receivers", target="site", decided_by=row.decided_by,
            needs=(*needs, partial(_varies, row)), simulated=(superposed,),
        )(applied)  # fmt: skip


_enter_rows()
