"""Blast vibration in jointed rock: signature, superposition, block model, comparison, inversion.

The public names are imported here, in groups. As in SPEC 1 of Scientific Python, the module of a
name is loaded when the name is first used: ``import pyblast`` and the command line start at once.
"""

from functools import cache
from typing import TYPE_CHECKING

__version__: str

if TYPE_CHECKING:
    # Errors
    from .errors import InputError, PyblastError

    # Motion and records
    from .signals.seismogram import Seismogram
    from .signals.comparison import compare
    from .report.figures import plot
    from .recordings.recording import read_recording
    from .recordings.recording import read_gather
    from .workflows.records import analyse_records
    from .workflows.site import learn_site

    # Blasts
    from .blasts.blast import Blast
    from .blasts.hole_tables import read_blast
    from .blasts.signature import superpose
    from .blasts.site_law import fit_site_law
    from .blasts.published_laws import plausible_ppv

    # Mesh
    from .mesh.mesh import Mesh
    from .mesh.builder import build_mesh, structured_box
    from .mesh.importer import read_mesh

    # Model: ground, joints, boundaries, sources, receivers
    from .model.model import InSitu, Model, Receiver, SpongeLayer
    from .model.anisotropy import HoekBrown
    from .model.material import ConstantQ, Damping, Material, MohrCoulomb
    from .model.joint import Joint, infill_stiffness
    from .model.boundary import Fixed, FreeField, Roller, StressInput, VelocityInput, Viscous
    from .model.plane_wave import PlaneWave
    from .model.source import Hole, PointForce, TimeFunction

    # Solve
    from .solver.run import simulate

    # Project files: read, check, run, report
    from .project.project import Project, load_project
    from .project.checks import check
    from .workflows.run import run
    from .project.result import read_result
    from .report.run import write_report
    from .report.view import ModelView

    # Inverse problems: parameters, survey design, missing physics
    from .workflows.back_analysis import back_analyse, design_survey
    from .workflows.diagnose import diagnose_case as diagnose, predict_case as predict

    # Planning of blasts
    from .workflows.delays import optimise_delays

__all__ = [
    # Errors
    "InputError", "PyblastError",
    # Motion and records
    "Seismogram", "compare", "plot", "read_recording", "read_gather", "analyse_records",
    "learn_site",
    # Blasts
    "Blast", "read_blast", "superpose", "fit_site_law", "plausible_ppv",
    # Mesh
    "Mesh", "build_mesh", "structured_box", "read_mesh",
    # Model: ground, joints, boundaries, sources, receivers
    "InSitu", "Model", "Receiver", "SpongeLayer", "ConstantQ", "Damping", "HoekBrown", "Material",
    "MohrCoulomb", "Joint", "infill_stiffness", "Fixed", "FreeField", "Roller", "StressInput",
    "VelocityInput", "Viscous", "PlaneWave", "Hole", "PointForce", "TimeFunction",
    # Solve
    "simulate",
    # Project files: read, check, run, report
    "Project", "load_project", "check", "run", "read_result", "write_report", "ModelView",
    # Inverse problems: parameters, survey design, missing physics
    "back_analyse", "design_survey", "diagnose", "predict",
    # Planning of blasts
    "optimise_delays",
    # Version
    "__version__",
]  # fmt: skip


if not TYPE_CHECKING:

    @cache
    def _imports():
        """Return the module of each public name and its name there, from the imports above."""
        import ast
        from pathlib import Path

        return {
            alias.asname or alias.name: (f".{node.module}", alias.name)
            for node in ast.walk(ast.parse(Path(__file__).read_text(encoding="utf-8")))
            if isinstance(node, ast.ImportFrom) and node.level == 1
            for alias in node.names
        }

    def __getattr__(name):
        """Load a public name when it is first used."""
        from importlib import import_module, metadata

        if name not in __all__:
            raise AttributeError(f"module 'pyblast' has no attribute {name!r}")
        if name == "__version__":
            value = metadata.version("pyblast")
        else:
            module, attribute = _imports()[name]
            value = getattr(import_module(module, __name__), attribute)
        globals()[name] = value
        return value

    def __dir__():
        """Return the public names."""
        return sorted(__all__)

    def _show_in_notebooks():
        """Let a notebook show models, meshed projects and results as one can turn them."""
        import sys

        shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
        if shell is None:
            return

        def turned(shown):
            if type(shown).__name__ == "Project" and "model" not in vars(shown):
                return None  # its mesh may take minutes: its line of text
            return __getattr__("ModelView")(shown)._repr_html_()

        def diagnosed(shown):
            from .report.diagnosis import scene_of
            from .report.view import ModelView

            return ModelView.of_scene(scene_of(shown, shown.summary))._repr_html_()

        formatter = shell.display_formatter.formatters["text/html"]
        for module, name in (
            ("model.model", "Model"), ("project.project", "Project"), ("project.result", "Result"),
        ):  # fmt: skip
            formatter.for_type_by_name(f"pyblast.{module}", name, turned)
        formatter.for_type_by_name("pyblast.workflows.diagnose", "Diagnosis", diagnosed)

    _show_in_notebooks()
