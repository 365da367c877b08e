"""Blast waves through jointed rock: superposition, block model, comparison, back-analysis."""

from importlib import import_module

_HOMES = {
    "AirBlast": "solving.pressures",
    "Blast": "blasting.blast",
    "Column": "solving.charges",
    "ConstantQ": "solving.attenuation",
    "DamagedZone": "solving.ground_fields",
    "Damping": "solving.materials",
    "Firing": "blasting.blast",
    "FiringScatter": "planning.firing_scatter",
    "Fixed": "solving.boundaries",
    "FreeField": "solving.boundaries",
    "Gradient": "solving.ground_fields",
    "Heterogeneity": "solving.ground_fields",
    "Hole": "solving.sources",
    "InSitu": "solving.model",
    "InputError": "errors",
    "Joint": "solving.joints",
    "Material": "solving.materials",
    "Mesh": "meshing.mesh",
    "Model": "solving.model",
    "MohrCoulomb": "solving.plasticity",
    "MomentTensor": "solving.charges",
    "PlaneWave": "solving.plane_waves",
    "PointForce": "solving.sources",
    "Pressure": "solving.pressures",
    "Project": "projects.project",
    "PyblastError": "errors",
    "Receiver": "solving.model",
    "Rim": "solving.model",
    "Roller": "solving.boundaries",
    "Seismogram": "motion.seismogram",
    "StressInput": "solving.boundaries",
    "TimeFunction": "solving.sources",
    "VelocityInput": "solving.boundaries",
    "Viscous": "solving.boundaries",
    "anisotropic": "solving.anisotropy",
    "back_analyse": "back_analysis",
    "band_functions": "residuals.band",
    "best_delays": "planning.best_delays",
    "blast_spectra": "ensembles.scatter",
    "build_mesh": "meshing.mesh_builder",
    "cached_run": "ensembles.run_cache",
    "check": "projects.checks",
    "compare": "motion.comparison",
    "controlled_mean": "ensembles.control_variate",
    "find_delays": "delays",
    "firing_times": "inversion.firing_times",
    "fit_site_law": "blasting.site_law",
    "gradient": "solving.gradients",
    "greens_functions": "ensembles.banks",
    "infer_levels": "residuals.levels",
    "jointed": "solving.anisotropy",
    "load_limits": "motion.limits",
    "load_project": "projects.project",
    "misfit": "residuals.misfits",
    "noise_of": "residuals.noise",
    "peak_bands": "planning.peak_bands",
    "plan_back_analysis": "back_analysis",
    "read_blast": "blasting.hole_tables",
    "read_gather": "records.recordings",
    "read_mesh": "meshing.mesh_import",
    "read_recording": "records.recordings",
    "read_result": "projects.result",
    "reduced": "reduction.reduced",
    "run": "pipeline",
    "run_all": "ensembles.many_runs",
    "run_many": "solving.batches",
    "run_until_quiet": "ensembles.quiet_end",
    "signature_spectra": "ensembles.signature_spectra",
    "structured_box": "meshing.mesh_builder",
    "superpose": "blasting.superposition",
    "tangents": "solving.born",
    "track": "solving.tracks",
    "transverse": "solving.anisotropy",
    "workers": "ensembles.many_runs",
    "write_report": "reporting.report",
    "whitener": "residuals.whitening",
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
