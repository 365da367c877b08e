"""Blast waves through jointed rock: superposition, block model, comparison, back-analysis."""

from importlib import import_module

_HOMES = {
    "AirBlast": "model.source",
    "Blast": "blasts.blast",
    "Column": "model.source",
    "ConstantQ": "model.material",
    "DamagedZone": "model.ground_fields",
    "Damping": "model.material",
    "Firing": "blasts.blast",
    "FiringScatter": "planning.peak_distribution",
    "Fixed": "model.boundary",
    "FreeField": "model.boundary",
    "Gradient": "model.ground_fields",
    "Heterogeneity": "model.ground_fields",
    "Hole": "model.source",
    "InSitu": "model.model",
    "InputError": "errors",
    "Joint": "model.joint",
    "Material": "model.material",
    "Mesh": "mesh.mesh",
    "Model": "model.model",
    "MohrCoulomb": "model.material",
    "MomentTensor": "model.source",
    "PlaneWave": "model.plane_wave",
    "PointForce": "model.source",
    "Pressure": "model.source",
    "Project": "project.project",
    "PyblastError": "errors",
    "Receiver": "model.model",
    "Rim": "model.model",
    "Roller": "model.boundary",
    "Seismogram": "signals.seismogram",
    "StressInput": "model.boundary",
    "TimeFunction": "model.source",
    "VelocityInput": "model.boundary",
    "Viscous": "model.boundary",
    "anisotropic": "model.anisotropy",
    "back_analyse": "workflows.back_analysis",
    "band_functions": "inference.noise",
    "best_delays": "planning.delays",
    "blast_spectra": "runs.blast_ensemble",
    "build_mesh": "mesh.builder",
    "cached_run": "runs.cache",
    "check": "project.checks",
    "compare": "signals.comparison",
    "find_delays": "workflows.delays",
    "firing_times": "blasts.firing_times",
    "fit_site_law": "blasts.site_law",
    "gradient": "solver.sensitivity",
    "greens_functions": "runs.greens_bank",
    "infer_levels": "inference.covariance",
    "jointed": "model.anisotropy",
    "load_limits": "signals.limits",
    "load_project": "project.project",
    "misfit": "inference.misfits",
    "noise_of": "inference.noise",
    "peak_bands": "planning.peak_distribution",
    "plan_back_analysis": "workflows.back_analysis",
    "read_blast": "blasts.hole_tables",
    "read_gather": "recordings.recording",
    "read_mesh": "mesh.importer",
    "read_recording": "recordings.recording",
    "read_result": "project.result",
    "run": "workflows.run",
    "simulate": "solver.run",
    "run_all": "runs.parallel",
    "run_many": "solver.run",
    "signature_spectra": "runs.blast_ensemble",
    "structured_box": "mesh.builder",
    "superpose": "blasts.superposition",
    "tangents": "solver.sensitivity",
    "track": "solver.tracks",
    "transverse": "model.anisotropy",
    "workers": "runs.parallel",
    "write_report": "report.html",
    "whitener": "inference.covariance",
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
