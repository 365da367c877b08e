"""A tiny twin for tests of back-analysis: records made by the small project itself."""

from dataclasses import replace

import numpy as np
from small_project import CARRIED, written

from pyblast.back_analysis.parameters import common_time_step
from pyblast.back_analysis.trials import Target
from pyblast.inference.parameter import Parameter
from pyblast.project.project import load_project
from pyblast.project.result import write_csv

PARAMETERS = (
    Parameter("joints.F1.kn_gpa_per_m", 0.01, 0.5),
    Parameter("joints.F1.ks_gpa_per_m", 0.005, 0.1),
    Parameter("damping.ratio", 0.005, 0.05),
)
TRUTH = (0.114, 0.025, 0.0112)  # of PARAMETERS, in the small project
RECORDED = '\n[receivers.recorded]\nfile = "wall.csv"\nbearing_deg = 90\n\n[run]\n'
# Soil that quadratic zones of these cells carry up to 20 Hz
STIFFER = ("bulk_mpa = 125\nshear_mpa = 57.7", "bulk_mpa = 2500\nshear_mpa = 1150")
RMS = 2e-4  # m/s of a sample, at 256 samples a second


def twin_file(folder, section="", changes=()):
    """Write a project whose record was made with its own values; return its path."""
    path = written(folder, ("duration_s = 0.1", "duration_s = 0.4"), CARRIED[0], *changes)
    project = load_project(path)
    motion = project.simulate().seismograms["R1"]
    write_csv(folder / "wall.csv", replace(motion, label="R1"))
    text = path.read_text().replace("\n[run]\n", RECORDED)
    path.write_text(text + section)
    return path


def target(project, parameters=PARAMETERS):
    """Return what a search of the twin shall meet."""
    steps = (common_time_step(project, parameters),)
    return Target((project,), parameters, (), "paper", steps, {})


def section(parameters=PARAMETERS, **keys):
    """Return the table of a search by waveforms."""
    table = {"misfit": "'waveform'", "runs": 60} | keys
    lines = ["[back_analysis]", *(f"{key} = {value}" for key, value in table.items())]
    for one in parameters:
        lines += ["[[back_analysis.parameters]]", f'path = "{one.name}"', "log = true"]
        lines += [f"low = {one.low}", f"high = {one.high}"]
        lines += ["laboratory = [0.5, 0.8]"] * one.name.endswith("ks_gpa_per_m")
    return "\n".join(lines) + "\n"


STARTS = (
    ("kn_gpa_per_m = 0.114", "kn_gpa_per_m = 0.2"),
    ("ks_gpa_per_m = 0.025", "ks_gpa_per_m = 0.015"),
)


def noisy(folder, start=-0.4, rms=RMS, **keys):
    """Write a project whose record has noise from before the blast on; return its path.

    The stiffness of its fault is not that with which the record was made.
    """
    folder.mkdir(exist_ok=True)
    path = written(
        folder, ("duration_s = 0.1", "duration_s = 0.5\ncompare_band_hz = [3, 20]"), STIFFER,
        ("cohesion_kpa = 20", "cohesion_kpa = 500"), ("tension_kpa = 0", "tension_kpa = 1e6"),
        ("grid_cells = [6, 2, 3]", "grid_cells = [6, 2, 3]\nquadratic = true"),
    )  # fmt: skip
    motion = load_project(path).simulate().seismograms["R1"]
    made = motion.sampled(start, 1.0 / 256.0, int(256 * (0.5 - start)))
    noise = rms * np.random.default_rng(3).normal(size=made.velocity.shape)
    write_csv(folder / "wall.csv", replace(made, velocity=made.velocity + noise, label="R1"))
    text = path.read_text().replace("\n[run]\n", RECORDED)
    for old, new in STARTS:
        text = text.replace(old, new)
    path.write_text(text + section(**keys))
    return path
