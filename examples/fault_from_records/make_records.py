"""Simulate the records of this example, with other values, a finer mesh and noise.

    python examples/fault_from_records/make_records.py          half a minute

The search is given none of these values.
"""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.config.config import check_config
from pyblast.project.project import make_project
from pyblast.project.result import write_csv

HERE = Path(__file__).resolve().parent
KN, KS, RATIO = 0.55, 0.18, 0.03  # what a back-analysis should find
EDGE, SEED = 4, 7  # m; of the noise
DT, QUIET = 2e-3, 0.3  # s; of record before the first firing
NOISE = 5.16e-4  # m/s, rms of a sample


def truth():
    """Return the project with the true values, without records."""
    text = tomllib.loads((HERE / "project.toml").read_text(encoding="utf-8"))
    del text["back_analysis"]
    text["receivers"] = [r for r in text["receivers"] if r.pop("recorded", None)]
    text["mesh"]["edge_m"] = EDGE
    text["joints"]["F1"] |= {"kn_gpa_per_m": KN, "ks_gpa_per_m": KS}
    text["materials"]["limestone"]["damping"]["ratio"] = RATIO
    return make_project(check_config(text), HERE / "project.toml")


def main():
    """Run the truth and write what each instrument recorded."""
    project, rng = truth(), np.random.default_rng(SEED)
    for name, motion in project.simulate().seismograms.items():
        count = round((QUIET + motion.duration - 0.02) / DT)
        record = motion.sampled(-QUIET, DT, count)
        heard = record.velocity + NOISE * rng.normal(size=record.velocity.shape)
        write_csv(HERE / f"{name}.csv", replace(record, velocity=heard, label=name))
        print(f"{name}: PPV in mm/s {1e3 * record.ppv}")


if __name__ == "__main__":
    main()
