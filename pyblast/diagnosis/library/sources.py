"""What may be wrong with a blast: its times, its charges, its place, the rock around its holes."""

import numpy as np

from ..hypotheses import Knob, hypothesis


@hypothesis(
    "delay_scatter", family="source", on="holes", target="blast", axis="receivers",
    knobs=[Knob("delays", 0.0, 3e-3, "s", starts=(0.0,), low=-0.02, high=0.02, per_hole=True)],
)  # fmt: skip
def delay_scatter(blast, target, delays):
    """The holes of this blast did not fire at their planned times."""
    del blast, target
    return delays, np.ones(len(delays))


@hypothesis(
    "misfire_or_charge_error", family="source", on="holes", target="blast", axis="receivers",
    knobs=[Knob("scales", 1.0, 0.3, starts=(1.0,), low=0.0, high=3.0, per_hole=True)],
)  # fmt: skip
def misfire_or_charge_error(blast, target, scales):
    """Holes of this blast sent less or more than their charge should, or nothing."""
    del blast, target
    return np.zeros(len(scales)), scales
