"""How Sphinx builds these pages: `./dev docs`."""

import inspect
import re
from importlib.metadata import version as installed_version

from sphinx.util.docutils import SphinxDirective

import pyblast

project = "pyblast"
release = version = installed_version("pyblast")
copyright = "the authors of pyblast, see CITATION.cff"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["_build"]
myst_heading_anchors = 3
napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_typehints = "none"
autodoc_member_order = "bysource"
highlight_language = "none"
html_theme = "furo"
html_title = f"pyblast {release}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
suppress_warnings = ["myst.strikethrough"]

# Public names by subject. Names that `pyblast` does not have are left out; others go to "Others".
GROUPS = {
    "The whole chain": "run simulate compare diagnose predict back_analyse design_survey "
    "optimise_delays load_project Project check read_result "
    "write_report",
    "Mesh": "Mesh structured_box build_mesh read_mesh",
    "Ground": "Material Damping ConstantQ MohrCoulomb anisotropic transverse jointed DamagedZone "
    "Gradient Heterogeneity InSitu",
    "Joints": "Joint",
    "Model": "Model Receiver SpongeLayer",
    "Boundaries": "Viscous FreeField Roller Fixed StressInput VelocityInput PlaneWave",
    "Sources": "Hole Column MomentTensor PointForce Pressure AirBlast TimeFunction",
    "Seismograms and records": "Seismogram plot read_recording read_gather analyse_records "
    "load_limits",
    "Blasts": "Blast Firing FiringScatter read_blast superpose signature_spectra blast_spectra "
    "peak_bands best_delays fit_site_law",
    "Many runs": "run_many run_all cached_run workers greens_functions",
    "Inference": "misfit noise_of band_functions",
    "Errors": "PyblastError InputError",
}


class PublicNames(SphinxDirective):
    """List every name of ``pyblast.__all__`` under the heading of its group."""

    def run(self):
        """Return the sections of all groups."""
        public = set(pyblast.__all__)
        groups = {
            title: [name for name in names.split() if name in public]
            for title, names in GROUPS.items()
        }
        known = {name for names in groups.values() for name in names}
        groups["Others"] = sorted(public - known)
        lines = []
        for title, names in groups.items():
            if names:
                lines += [title, "-" * len(title), ""]
                lines += [line for name in names for line in documented(name)]
        return self.parse_text_to_nodes("\n".join(lines), allow_section_headings=True)


def documented(name):
    """Return the directive that documents one public name."""
    kind = "function"
    thing = getattr(pyblast, name)
    if inspect.isclass(thing):
        kind = "exception" if issubclass(thing, Exception) else "class"
    elif inspect.ismodule(thing):
        kind = "module"
    elif not callable(thing):
        kind = "data"
    members = ["   :members:"] if kind == "class" else []
    return [f".. auto{kind}:: pyblast.{name}", *members, ""]


def escaped(_app, _what, _name, _object, _options, lines):
    """Escape bars, stars and trailing underscores outside of code, which are meant literally."""
    for number, line in enumerate(lines):
        parts = re.split(r"(``[^`]*``)", line)
        parts[::2] = [re.sub(r"[|*]|(?<=\w)_(?=\W|$)", r"\\\g<0>", part) for part in parts[::2]]
        lines[number] = "".join(parts)


def downloads(_app, _page, source):
    """Let links to pages beside the documents, which are no pages of the site, lead to the file."""
    source[0] = re.sub(r"\]\(((?:\.\./)+examples/[^)\s]+\.md)\)", r"](path:\1)", source[0])


def setup(app):
    """Register the list of public names and the links to examples."""
    app.connect("source-read", downloads)
    app.add_directive("public-names", PublicNames)
    app.connect("autodoc-process-docstring", escaped, priority=100)  # before napoleon
    return {"parallel_read_safe": True}
