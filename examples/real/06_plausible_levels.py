"""Published peaks that are called implausible, as published and in another unit.

The peaks are a published table of 50 pairs of scaled distance and PPV; its site and units are not
stated, its law is one of mm/s and m/kg^0.5. Charges are not stated either: all are taken as 10, 100
and 1000 kg. The examples with holes inside are run, a minute. Argument: the folder of recordings.
"""

import sys

import numpy as np
from real_line import REPOSITORY, keep_results, recordings_folder

from pyblast import load_project
from pyblast.blasts.published_laws import BY_NAME, plausible_ppv
from pyblast.project.level import simulated_peaks

TABLE = "ppv_law/fgbastante_ppv_law.txt"
CHARGES = (10.0, 100.0, 1000.0)  # kg
WRONG = {  # factor on a peak in m/s
    "as published": 1.0,
    "m/s read as mm/s": 1e-3,
    "mm/s read as m/s": 1e3,
    "in/s read as mm/s": 1.0 / 25.4,
    "100 times too low": 1e-2,
    "100 times too high": 1e2,
}


def outside(scaled, peak):
    """Return the share of peaks (m/s) outside of the plausible range at scaled distances."""
    cases = [(plausible_ppv(s * charge**0.5, charge), v) for charge in CHARGES
             for s, v in zip(scaled, peak, strict=True)]  # fmt: skip
    return float(np.mean([near is not None and near.excess(v) != 1.0 for near, v in cases]))


def one_law(law, scaled, peak):
    """Return the share of peaks outside of the 5-95 % range of one law."""
    ends = np.array([[law.peak(s * w**0.5, w).band(0.9) for s in scaled] for w in CHARGES])
    return float(np.mean((peak < ends[..., 0]) | (peak > ends[..., 1])))


def example_peaks(name):
    """Run an example; return its peaks and ranges in mm/s and whether each lies outside."""
    project = load_project(REPOSITORY / "examples" / name / "project.toml")
    return {
        peak.name: {
            "ppv_mm_per_s": 1e3 * peak.ppv,
            "plausible_mm_per_s": [1e3 * peak.plausible.low, 1e3 * peak.plausible.high],
            "implausible": peak.excess != 1.0,
        }
        for peak in simulated_peaks(project, project.simulate().seismograms)
        if peak.plausible is not None
    }


folder = recordings_folder(sys.argv[1:])
scaled, millimetres = 10.0 ** np.loadtxt(folder / TABLE, skiprows=1).T
peak = 1e-3 * millimetres
shares = {name: outside(scaled, factor * peak) for name, factor in WRONG.items()}
examples = {name: example_peaks(name) for name in ("fault_from_records", "holes_inside")}
keep_results(
    "plausible_levels",
    {
        "published_peaks": len(peak),
        "scaled_distance": [float(scaled.min()), float(scaled.max())],
        "share_outside": shares,
        "share_outside_of_one_law": {
            name: one_law(law, scaled, peak) for name, law in BY_NAME.items()
        },
        "examples": examples,
    },
)
for name, share in shares.items():
    print(f"{name}: {100 * share:.0f} % of {len(peak)} published peaks are implausible")
for name, peaks in examples.items():
    flagged = [place for place, values in peaks.items() if values["implausible"]]
    print(f"{name}: {len(flagged)} of {len(peaks)} peaks are implausible {', '.join(flagged)}")
