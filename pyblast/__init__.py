"""Blast waves through jointed rock: superposition, block model, comparison, back-analysis."""

from importlib import import_module

_HOMES = {
    "Blast": "blast",
    "Damping": "materials",
    "Firing": "blast",
    "InputError": "errors",
    "Joint": "joints",
    "Material": "materials",
    "Mesh": "mesh",
    "Model": "model",
    "Project": "project",
    "PyblastError": "errors",
    "Receiver": "model",
    "Seismogram": "seismogram",
    "check": "checks",
    "compare": "comparison",
    "load_limits": "limits",
    "load_project": "project",
    "read_blast": "hole_tables",
    "read_recording": "recordings",
    "read_result": "result",
    "run": "pipeline",
    "superpose": "superposition",
    "write_report": "report",
}
__all__ = sorted(_HOMES)


def __getattr__(name):
    """Import a public name when it is first asked for, so that the package loads at once."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pyblast' has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__():
    """List the public names."""
    return __all__
