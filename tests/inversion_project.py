"""A tiny twin for tests of back-analysis: records made by the small project itself."""

from dataclasses import replace

from small_project import written

from pyblast.inversion.forward import Target, held_step, simulate
from pyblast.inversion.parameters import Parameter
from pyblast.projects.project import load_project
from pyblast.projects.result import write_csv

PARAMETERS = (
    Parameter("joints.F1.kn_gpa_per_m", 0.01, 0.5),
    Parameter("joints.F1.ks_gpa_per_m", 0.005, 0.1),
    Parameter("damping.ratio", 0.005, 0.05),
)
RECORDED = '\n[receivers.recorded]\nfile = "wall.csv"\nbearing_deg = 90\n\n[run]\n'


def twin_file(folder, section="", changes=()):
    """Write a project whose record was made with its own values; return its path."""
    path = written(folder, ("duration_s = 0.1", "duration_s = 0.4"), *changes)
    project = load_project(path)
    motion = simulate(project, (), [()])[0]["R1"]
    write_csv(folder / "wall.csv", replace(motion, label="R1"))
    text = path.read_text().replace("\n[run]\n", RECORDED)
    path.write_text(text + section)
    return path


def target(project, parameters=PARAMETERS):
    """Return what a search of the twin shall meet."""
    return Target((project,), parameters, (), "paper", (held_step(project, parameters),))
