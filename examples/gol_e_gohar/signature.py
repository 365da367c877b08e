"""Construct the record of a single hole that the example superposes: the paper's is not published.

    python examples/gol_e_gohar/signature.py

Writes hole.csv beside this file. What is published of the record constrains it as follows:

- one hole lasts 0.88 s: the excitation of four rows 40 ms apart ends at 1 s;
- "filtered and non-filtered nearly the same" at 20 Hz: nothing above it;
- it was measured at 39 m because instruments nearer by clip at 254 mm/s, so its peak is below that.
  100 mm/s lies within the range of the published laws there (49 to 1700 mm/s for 450 kg);
- an explosive radiates 1 to 10 % of its heat as waves: 12 Hz at this level on the graded face gives
  4 %, 8 Hz would give twice as much.

The waveform, the frequency within 8 to 12 Hz and the ratios of the components remain free.
"""

from pathlib import Path

import numpy as np

from pyblast.project.result import write_csv
from pyblast.signals.seismogram import BLAST_AXES, Seismogram

PEAK, FREQUENCY, LENGTH, RISE = 0.1, 12.0, 0.88, 0.16  # m/s, Hz, s, s
SAMPLING, DURATION = 1024.0, 1.2  # Hz, s
# Longitudinal, transverse, vertical: share of the peak, of the frequency, and phase.
COMPONENTS = ((1.0, 1.0, 0.0), (0.4, 0.8, 1.0), (0.7, 1.1, -1.5))


def signature() -> Seismogram:
    """Return the record of one hole, with a smooth start and end."""
    times = np.arange(0.0, DURATION, 1.0 / SAMPLING)
    rise = (times / RISE) ** 3 * np.exp(3.0 - 3.0 * times / RISE)
    fall = np.clip((times - 0.6 * LENGTH) / (0.4 * LENGTH), 0.0, 1.0)
    envelope = rise * 0.5 * (1.0 + np.cos(np.pi * fall))
    motion = np.column_stack([
        size * envelope * np.sin(2.0 * np.pi * share * FREQUENCY * times + phase)
        for size, share, phase in COMPONENTS
    ])  # fmt: skip
    motion *= PEAK / np.abs(motion[:, 0]).max()
    return Seismogram(motion, 1.0 / SAMPLING, label="hole", components=BLAST_AXES)


if __name__ == "__main__":
    write_csv(Path(__file__).parent / "hole.csv", signature())
