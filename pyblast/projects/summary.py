"""The summary of a run: every table of the report as plain numbers and words."""

import math
from dataclasses import asdict

import numpy as np

from ..motion.spectra import dominant_frequency, significant_duration, zero_crossing_frequency
from ..solving.attenuation import ConstantQ
from ..solving.charges import Column, MomentTensor
from ..solving.provenance import versions
from ..solving.sources import Hole, PointForce
from .census import input_band
from .ground import joint_of_surface


def summarise(project, checked, run, simulated, comparisons):
    """Return the summary of a run, SI, angles as tangents.

    Parameters
    ----------
    project : Project
    checked : Check
    run : Run
    simulated : dict of str to Seismogram
    comparisons : dict of str to Comparison
    """
    blast = project.config.blast
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "materials": {
            n: material_table(m) | {"fading": fading_words(project.model, n)}
            for n, m in project.materials.items()
        },
        "joints": joint_tables(project),
        "input": None if project.input is None else input_table(project),
        "sources": source_summary(project),
        "band": input_band(project),
        "limit_curves": list(project.config.run.limit_curves),
        "receivers": receiver_tables(project, simulated),
        "comparisons": {n: comparison_table(c) for n, c in comparisons.items()},
        "findings": [asdict(finding) for finding in checked.findings],
        "notes": list(checked.notes),
        "census": asdict(checked.census),
        "run": {
            "dt": run.dt,
            "steps": run.prepared.n_steps,
            "duration": project.config.run.duration_s,
            "lead": project.lead,
            "edges_per_wavelength": project.model.edges_per_wavelength,
            "wall_seconds": run.wall_seconds,
            "balance_error": run.balance_error,
            "limited_by": run.prepared.limit.limited_by,
            "static": run.prepared.static,
            "added_mass": checked.census.added_mass,
        },
        "energy": {
            n: float(v[-1]) for n, v in run.energy.items() if n not in ("time", "unbalanced")
        },
        "seeds": {
            "mesh": project.config.mesh.seed,
            "blast": None if blast is None else blast.seed,
        },
        "provenance": {**versions(run.prepared.fingerprint), **run.provenance},
        "files_sha256": project.input_files,
        "mesh_names": {
            "groups": list(project.model.mesh.groups),
            "joints": [joint.surface for joint in project.joints],
            "faults": project.faults,
        },
    }


def material_table(material):
    """Return the properties and wave speeds of a material."""
    names = ("density", "bulk", "shear", "young", "poisson", "cp", "cs", "cohesion", "friction")
    return {name: getattr(material, name) for name in names}


def fading_words(model, name):
    """Say how waves fade in a material, an empty text where they do not."""
    law = model.materials[name].law
    words = []
    if isinstance(law, ConstantQ):
        low, high = law.band
        words.append(f"Qp {law.qp:g}, Qs {law.qs:g} from {low:g} to {high:g} Hz")
    damping = model.damping.get(name) if isinstance(model.damping, dict) else model.damping
    if damping is not None and damping.ratio > 0.0:
        words.append(f"{100.0 * damping.ratio:.3g} % at {damping.frequency:g} Hz (Rayleigh)")
    return "; ".join(words)


def joint_tables(project):
    """Return law, properties, place in the mesh and assumptions of each joint surface."""
    config = project.config.mesh
    parts = {part.name: part for part in (*config.joint_sets, *config.faults)}
    entry = joint_of_surface(config)
    tables = {}
    for joint in project.joints:
        part = parts.get(joint.surface)
        tables[joint.surface] = {
            "law": joint.law,
            **joint.properties,
            "dip": None if part is None else part.dip_deg,
            "dip_direction": None if part is None else part.dip_direction_deg,
            "spacing": getattr(part, "spacing_m", None),
            "regions": list(getattr(part, "regions", ())),
            "assumed": [
                key.rsplit(".", 1)[-1]
                for key in project.config.assumed
                if key.startswith(f"joints.{entry[joint.surface]}")
            ],
        }
    return tables


def input_table(project):
    """Return the firing, the low-pass and the peaks of every stage of the input."""
    stages, config = project.input, project.config
    low = stages.low_passed
    cavity = config.signature.cavity
    return {
        "face": config.input.face,
        "holes": len(stages.firing.times),
        "instants": sorted({float(t) for t in np.round(stages.firing.times, 6)}),
        "signature": "closed form of a charged hole" if cavity is not None else
        f"recorded, {config.signature.recorded.file}",
        "signature_distance": (
            None if cavity is None else math.dist(cavity.hole_m, cavity.receiver_m)
        ),
        "signature_assumed": project.is_assumed("signature"),
        "signature_ppv": stages.signature.ppv,
        "superposed_ppv": stages.superposed.ppv,
        "motion_ppv": stages.motion.ppv,
        "low_pass": None if low is None else low.corner,
        "low_pass_3db": None if low is None else low.corner_3db,
        "removed_energy": None if low is None else low.removed_energy,
        "ppv_change": None if low is None else low.ppv_change,
        "face_distance": config.input.distance_m,
    }  # fmt: skip


def source_tables(project):
    """Return time in s and moment rate in N m/s, force in N or pressure in Pa of all sources."""
    return {
        name: np.column_stack([f.start + f.dt * np.arange(len(f.values)), f.values])
        for name, f in project.inside.named.items()
    }


def source_summary(project):
    """Return place, charge and time of holes, place of other sources, the air blast, the rim."""
    holes = [source for source in project.sources if isinstance(source, (Hole, Column))]
    config, rim, air = project.config.holes_inside, project.rim, project.config.air_blast
    centres = [] if not holes else project.blast.centres[project.blast.charge != 0.0]
    return {
        "holes": [
            {"position": place, "charge": s.charge, "time": s.time - project.lead}
            for place, s in zip(centres, holes, strict=True)
        ],
        "moment_rate": config and (config.moment_rate_file or "closed form of a charged hole"),
        "exponent": holes[0].exponent if holes else None,
        "spread": getattr(holes[0], "spread", None) if holes else None,
        "detonation": config and config.detonation_m_per_s,
        "forces": [
            {"position": s.position, "direction": s.direction}
            for s in project.sources if isinstance(s, PointForce)
        ],
        "tensors": [
            {"position": s.position, "tensor": s.tensor}
            for s in project.sources if isinstance(s, MomentTensor)
        ],
        "pressures": [part.surface for part in project.config.pressures],
        "air_blast": air and {"surface": air.surface, "speed": air.speed_m_per_s},
        "rim": None if rim is None else vars(rim),
    }  # fmt: skip


def motion_table(seismogram, band=None):
    """Return peaks, frequencies and durations of a seismogram, the dominant one within a band."""
    dominant = dominant_frequency(seismogram, band=band)
    crossing = zero_crossing_frequency(seismogram)
    return {
        "components": list(seismogram.components),
        "ppv": seismogram.ppv,
        "pvs": seismogram.pvs,
        "dominant_frequency": dominant.hz,
        "frequency_definition": dominant.definition,
        "zero_crossing_frequency": crossing.hz,
        "duration": significant_duration(seismogram),
    }


def receiver_tables(project, simulated):
    """Return place and motion, simulated and recorded, of each receiver."""
    tables = {}
    for receiver in project.receivers:
        name = receiver.name
        tables[name] = {
            "position": list(receiver.position),
            "azimuth": receiver.azimuth,
            "simulated": motion_table(simulated[name]),
            "recorded": motion_table(project.recorded[name]) if name in project.recorded else None,
        }
    return tables


def comparison_table(comparison):
    """Return the deviations of a comparison."""
    names = (
        "ppv_deviation", "frequency_deviation", "duration_deviation", "waveform_misfit", "lag",
        "correlation", "envelope_misfit", "phase_misfit", "misfit",
    )  # fmt: skip
    return {
        "components": list(comparison.components),
        "frequency_method": comparison.frequency_method,
        **{name: getattr(comparison, name) for name in names},
    }
