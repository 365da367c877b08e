"""The result file of a run (HDF5) and its summary of plain numbers and text."""

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..blasts.compliance import METHOD, OF_WALLS, ORIENTATION, assess_all, conclusion
from ..errors import Finding, ReadError
from ..files import plain, versions, write_text
from ..ground.tables import joint_of_surface
from ..model.boundary import kinds_of
from ..model.material import ConstantQ
from ..model.source import Column, Hole, MomentTensor, PointForce
from ..recordings.tables import LOW_PASSED, instrument_table
from ..signals.seismogram import Named, Seismogram, ZeroPhase
from ..signals.spectra import (
    dominant_frequency,
    late_energy,
    significant_duration,
    zero_crossing_frequency,
)
from ..solver.injection import injected_sources
from ..solver.model_file import read_arrays, write_arrays
from ..solver.moment_density import source_radii
from ..units import plain_number
from . import level
from .places import blast_table, extent_of, house_positions, source_names, undamped_plane

KIND = "result"


@dataclass(frozen=True, eq=False)
class Result:
    """Result of a run: arrays by group and name, and a summary that JSON can hold.

    Parameters
    ----------
    arrays : dict of str to dict of str to numpy array
        Groups ``mesh``, ``contacts``, ``zones``, ``energy``, ``state``, ``input``, ``simulated``,
        ``recorded``, ``snapshots``; seismograms (n_samples, 3) in m/s. ``sources`` (n, 2): time in
        s, and moment rate of 1 kg in N m/s or force in N.
    summary : dict
        Plain numbers, text, lists and dicts.
    """

    arrays: dict[str, dict[str, np.ndarray]]
    summary: dict

    def seismogram(self, group, name) -> Seismogram:
        """Return a seismogram of ``input``, ``simulated`` or ``recorded``."""
        head = Named(Named(self.summary["seismograms"])[group])[name]
        return Seismogram(
            self.arrays[group][name],
            head["dt"],
            head["start"],
            name,
            tuple(head["components"]),
            ZeroPhase(head["low_passed"]) if head.get("zero_phase") else head.get("low_passed"),
        )

    def seismograms(self, group) -> dict[str, Seismogram]:
        """Return all seismograms of a group."""
        names = Named(self.summary["seismograms"])[group]
        return Named({name: self.seismogram(group, name) for name in names})

    def __repr__(self) -> str:
        """Return title, receivers and conclusion on one line."""
        names = ", ".join(self.summary.get("receivers", {}))
        return f"<Result {self.summary.get('title', '')!r}: receivers {names or 'none'}>"

    def to_pandas(self, group="simulated"):
        """Return motions as a pandas DataFrame in m/s: time_s by (receiver, component)."""
        import pandas  # pyright: ignore[reportMissingImports]

        frames = {
            name: pandas.DataFrame(motion.velocity, pandas.Index(motion.times.round(9)),
                                   list(motion.components))
            for name, motion in self.seismograms(group).items()
        }  # fmt: skip
        return pandas.concat(frames, axis=1).rename_axis("time_s")

    def to_xarray(self, group="simulated"):
        """Return all motions of a group as an xarray Dataset in m/s, one variable a receiver."""
        import xarray  # pyright: ignore[reportMissingImports]

        return xarray.Dataset({
            name: xarray.DataArray(
                motion.velocity, dims=("time", "component"), attrs={"units": "m/s"},
                coords={"time": motion.times.round(9), "component": list(motion.components)},
            )
            for name, motion in self.seismograms(group).items()
        })  # fmt: skip

    def to_pyvista(self):
        """Return the mesh as a pyvista UnstructuredGrid: fields of zones, velocity by time."""
        import pyvista  # pyright: ignore[reportMissingImports]

        mesh = self.arrays["mesh"]
        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: mesh["zones"]}, mesh["points"])
        for name, values in self.arrays["zones"].items():
            grid.cell_data[name] = values
        for time, velocity in self.arrays["snapshots"].items():
            grid.point_data[f"velocity at {float(time):g} s [m/s]"] = velocity
        return grid


def seismogram_heads(groups):
    """Return sampling and components of seismograms by group and name, for the summary."""
    return {
        group: {
            name: {
                "dt": s.dt,
                "start": s.start,
                "components": list(s.components),
                "low_passed": s.low_passed,
                "zero_phase": isinstance(s.low_passed, ZeroPhase),
            }
            for name, s in members.items()
        }
        for group, members in groups.items()
    }


def write_result(path, result):
    """Write a result file atomically.

    Parameters
    ----------
    path : path
    result : Result

    Raises
    ------
    ReadError
        If the file can't be written.
    """
    text = np.frombuffer(json.dumps(plain(result.summary)).encode(), dtype=np.uint8)
    provenance = result.summary.get("provenance", {})
    attributes = {"kind": KIND, "title": result.summary["title"], **provenance}
    units = {
        f"{group}/{name}": {
            "unit": "m/s", "dt_s": head["dt"], "start_s": head["start"],
            "components": head["components"],
        }
        for group, heads in result.summary.get("seismograms", {}).items()
        for name, head in heads.items()
    }  # fmt: skip
    write_arrays(path, {**result.arrays, "summary": {"json": text}}, attributes, units)


def read_result(path) -> Result:
    """Read a result file, or the ``result.h5`` of a folder.

    Raises
    ------
    ReadError
        If it is no result file or incomplete.
    """
    path = Path(path) / "result.h5" if Path(path).is_dir() else Path(path)
    if not path.is_file():
        raise ReadError(f"{path}: no such file; give the folder of a run or its result.h5")
    arrays, attributes = read_arrays(path)
    if attributes.get("kind") != KIND or "json" not in arrays.get("summary", {}):
        raise ReadError(
            f"{path}: not a result file of pyblast; give result.h5 of a run, or --project beside a "
            "result of pyblast-run"
        )
    try:
        summary = json.loads(arrays.pop("summary")["json"].tobytes())
    except (ValueError, RecursionError):
        raise ReadError(f"{path}: its summary is damaged; run the project again") from None
    return Result(arrays, summary)


def write_csv(path, seismogram):
    """Write a seismogram as a table in m/s that `read_recording` reads again.

    A comment at the end names the low-pass of its sources.
    """
    corner = seismogram.low_passed
    words = LOW_PASSED[ZeroPhase if isinstance(corner, ZeroPhase) else float]
    comment = [] if corner is None else [f"{words}{corner:.9g}"]
    heads = ["time_s", *(f"{name}_m_per_s" for name in seismogram.components)]
    rows = np.column_stack([seismogram.times, seismogram.velocity])
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    write_text(path, "\n".join([",".join(heads), *lines, *comment]) + "\n")


def summarise_run(project, checked, run, simulated, comparisons):
    """Return the summary of a run, SI, angles as tangents.

    Parameters
    ----------
    project : Project
    checked : Check
    run : Run
    simulated : dict of str to Seismogram
    comparisons : dict of str to Comparison
    """
    blast, band = project.config.blast, project.accuracy.band
    return {
        "title": project.title,
        "assumed": list(project.config.assumed),
        "materials": {
            n: material_table(m) | {"attenuation": attenuation_text(project.model, n)}
            for n, m in project.materials.items()
        },
        "joints": joint_tables(project),
        "input": None if project.input is None else input_table(project),
        "sources": source_summary(project),
        "band": band.table()
        | {"input_hz": project.shot.highest_frequency, "low_pass_hz": project.shot.low_pass},
        "limit_curves": list(project.config.run.limit_curves),
        "blast": None if blast is None else blast_table(project.blast),
        **_place(project),
        "instruments": {
            part.name: instrument_table(project.records[part.name], vars(part.recorded))
            for part in project.config.receivers
            if part.recorded is not None
        },
        "receivers": receiver_tables(project, simulated, band),
        "compliance": compliance_table(project, simulated, band),
        "comparisons": {n: comparison_table(c) for n, c in comparisons.items()},
        "findings": [asdict(finding) for finding in checked.findings],
        "notes": list(checked.notes),
        "model": asdict(checked.summary),
        "ground_as_built": [asdict(row) | {"good": row.good} for row in checked.ground_as_built],
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
        },
        "energy": {
            n: float(v[-1]) for n, v in run.energy.items() if n not in ("time", "unbalanced")
        }
        | level.source_energy(project, run.energy["input"]).table(),
        "seeds": {
            "mesh": project.config.mesh.seed,
            "blast": None if blast is None else blast.seed,
        },
        "provenance": {**versions(run.prepared.fingerprint), **run.provenance},
        "files_sha256": project.input_files,
        "inputs": project.log.table(),
        "mesh_names": {
            "groups": list(project.model.mesh.groups),
            "joints": [joint.surface for joint in project.model.joints],
            "faults": project.faults,
        },
    }


def error_table(row, names) -> dict:
    """Return the expected error at a receiver: of waveform and peak, by cause, and a source near.

    Parameters
    ----------
    row : ReceiverError
    names : sequence of str
        Of all sources of the model.
    """
    near = row.near and {**asdict(row.near), "source": names[row.near.source]}
    return {
        "waveform": row.waveform, "peak": row.peak, "cause": row.cause, "parts": row.parts,
        "near": near,
    }  # fmt: skip


def _place(project):
    """Return extent, sides, shift from the coordinates of the site, and houses."""
    blast = project.config.blast
    return {
        "undamped": undamped_plane(project),
        "extent": extent_of(project),
        "boundaries": kinds_of(project.model.boundaries),
        "shift_m": None if blast is None else list(blast.shift_m),
        "houses": house_positions(project),
    }


def material_table(material):
    """Return the properties and wave speeds of a material."""
    names = ("density", "bulk", "shear", "young", "poisson", "cp", "cs", "cohesion", "friction")
    return {name: getattr(material, name) for name in names}


def attenuation_text(model, name):
    """Describe the attenuation of a material; empty text if it has none."""
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
    """Return law, properties, geometry and assumptions of each joint surface."""
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
            "assumed": [key.rsplit(".", 1)[-1] for key in project.config.assumed
                        if key.startswith(f"joints.{entry[joint.surface]}")],
        }  # fmt: skip
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
        "signature": f"closed form of a charged hole, {level.level_words(cavity)}"
        if cavity is not None else f"recorded, {config.signature.recorded.file}",
        "signature_distance": (
            None if cavity is None else math.dist(cavity.hole_m, cavity.receiver_m)
        ),
        "signature_assumed": project.is_assumed("signature"),
        "signature_ppv": stages.signature.ppv,
        "superposed_ppv": stages.superposed.ppv,
        "motion_ppv": stages.motion.ppv,
        "low_pass": None if low is None else low.corner,
        "zero_phase": config.input.zero_phase,
        "removed_energy": None if low is None else low.removed_energy,
        "ppv_change": None if low is None else low.ppv_change,
        "face_distance": config.input.distance_m,
    }  # fmt: skip


def source_summary(project):
    """Return position, charge and time of holes, other sources, the absorbing layer."""
    holes = [source for source in project.sources if isinstance(source, (Hole, Column))]
    config, air = project.config.holes_inside, project.config.air_blast
    layer, ground = project.absorbing_layer, project.elastic_ground
    if layer is None and project.mesh.layer is not None:
        width = np.array(project.mesh.layer.width)[np.isfinite(project.mesh.layer.inner)]
        layer = {"width": float(width.min())}
    centres = [] if not holes else project.blast.centres[project.blast.charge != 0.0]
    return {
        "holes": [
            {"position": centre, "charge": s.charge, "time": s.time - project.lead}
            for centre, s in zip(centres, holes, strict=True)
        ],
        "moment_rate": config and level.moment_rate_words(project),
        "level": config and level.level_rank(project),
        "exponent": holes[0].exponent if holes else None,
        "radius": source_radii(project.model),
        "injected": len(injected_sources(project.model)),
        "core_m": None if ground is None else float(ground.radius.max()),
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
        "absorbing_layer": layer if layer is None or isinstance(layer, dict) else vars(layer),
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
        "late_energy": late_energy(seismogram),
    }


def simulated_table(seismogram, band, carried) -> dict:
    """Return the table of a simulated motion, without frequencies where the run is incomplete.

    Parameters
    ----------
    seismogram : Seismogram
    band : Band
        Of the run.
    carried : float, Hz
        What sources hold and the mesh carries at the receiver: no frequency above it is dominant.
    """
    lowest = 1.0 / seismogram.duration
    table = motion_table(seismogram, (lowest, max(carried, 2.0 * lowest)))
    if band.complete:
        return table
    absent = np.full(3, np.nan)
    return table | {"dominant_frequency": absent, "zero_crossing_frequency": absent}


def receiver_tables(project, simulated, band):
    """Return position, motion, simulated and recorded, and plausible range of each receiver."""
    tables, rows = {}, {row.name: row for row in project.accuracy.of_run(simulated)}
    names = source_names(project.model.sources, project.blast)
    for receiver in project.receivers:
        name = receiver.name
        peaks = [
            level.peak_of(group[name]) for group in (simulated, project.recorded) if name in group
        ]
        tables[name] = {
            "position": list(receiver.position),
            "azimuth": receiver.azimuth,
            "normal": receiver.normal,
            "carried_hz": rows[name].carried,
            "expected_error": error_table(rows[name], names),
            "simulated": simulated_table(
                simulated[name], band, min(rows[name].carried, project.shot.highest_frequency)
            ),
            "recorded": motion_table(project.recorded[name]) if name in project.recorded else None,
            **level.level_table(project, receiver.position, peaks),
        }
    return tables


def compliance_table(project, simulated, band):
    """Return peaks of all receivers against the limit curves, and the sentence that sums it up.

    Simulated peaks are left out where the run does not hold the band of the blast.
    """
    given = project.config.run.limit_curves
    curves = given or (OF_WALLS if project.config.mesh.benches else ORIENTATION)
    motions = {"recorded": project.recorded} | ({"simulated": simulated} if band.complete else {})
    rows = assess_all(
        motions,
        {r.name: level.window_at(project, r.position) for r in project.receivers},
        curves,
        {r.name: level.level_error(project, r.position) for r in project.receivers},
        {r.name: r.transfer for r in project.config.receivers},
    )
    tables = [row.table() for row in rows]
    words = conclusion(tables, bool(given)) if tables or band.complete else ""
    if not band.complete:
        words += (
            f" The simulation is not assessed: it holds motion up to "
            f"{plain_number(band.carried)} Hz, the blast up to {plain_number(band.needed)} Hz "
            "(finding D40)."
        )
    return {
        "chosen": bool(given),
        "curves": list(curves),
        "frequency_method": METHOD + level.frequency_words(project),
        "conclusion": words.strip(),
        "rows": tables,
    }


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


END_SHARE = 0.05
STILL = 0.2
LEAST_CYCLES = 2.0
LEAST_TRANSVERSE = 0.2  # of the longitudinal peak, below which no record of a quarry blast is


def record_findings(simulated) -> tuple[Finding, ...]:
    """Return findings about the records of a run.

    Parameters
    ----------
    simulated : dict of str to Seismogram
        By receiver; zero time is the first firing.
    """
    candidates = cut_short(simulated), low_frequencies(simulated), too_symmetric(simulated)
    return tuple(finding for finding in candidates if finding is not None)


def too_symmetric(simulated):
    """D50: receivers with hardly any transverse motion; None where none is so."""
    shares, floors = {}, []
    for name, record in simulated.items():
        peaks = dict(zip(record.components, record.ppv, strict=True))
        along, across = peaks.get("longitudinal", 0.0), peaks.get("transverse", math.nan)
        if across < LEAST_TRANSVERSE * along:
            shares[name] = float(across / along)
            low, high = (1e3 * math.hypot(record.pvs, share * along) for share in (0.5, 1.0))
            floors.append(
                f"{name} {100.0 * shares[name]:.0f} % (vector sum "
                f"{plain_number(1e3 * record.pvs)}, with it {plain_number(low)} to "
                f"{plain_number(high)} mm/s)"
            )
    if not shares:
        return None
    return Finding(
        "D50",
        "Hardly any transverse motion",
        f"Transverse over longitudinal peak: {'; '.join(floors)}. An explosion in uniform ground "
        "sends none; records of quarry blasts have half to all of the longitudinal peak, and so "
        "more of a vector sum, as in brackets. Add what the site has: joints and faults, layers "
        "and slopes across the path, ground.heterogeneity, or a moment tensor with a couple.",
        numbers=shares,
    )


def cut_short(simulated):
    """D28: records that end while the ground still moves; None where all are quiet by then."""
    remaining, late = {}, []
    for name, record in simulated.items():
        size = np.linalg.norm(record.velocity, axis=1)
        last = record.times > record.times[-1] - END_SHARE * (
            record.times[-1] - min(0, record.start)
        )
        share = float(size[last].max() / size.max()) if size.any() else 0.0
        if share > STILL:
            remaining[name] = share
            late += [name] if last[int(size.argmax())] else []
    if not remaining:
        return None
    listed = ", ".join(f"{100 * share:.0f} % at {name}" for name, share in remaining.items())
    peak = f"; the peak at {', '.join(late)} comes that late" if late else ""
    return Finding(
        "D28",
        "The record ends while the ground still moves",
        f"In its last twentieth the motion still reaches {listed} of its peak{peak}: peaks, "
        "durations and low frequencies may change with a longer run.duration_s.",
        numbers=remaining,
    )


def low_frequencies(simulated):
    """D29: dominant frequencies of which fewer than two cycles fit into the record; else None."""
    low, shortest = {}, np.inf
    for name, record in simulated.items():
        lasts = record.times[-1] - max(0.0, record.start)
        for component, hz in zip(record.components, dominant_frequency(record).hz, strict=True):
            if hz * lasts < LEAST_CYCLES:
                low[f"{name} {component}"] = float(hz)
                shortest = min(shortest, lasts)
    if not low:
        return None
    listed = ", ".join(f"{hz:.3g} Hz at {name}" for name, hz in low.items())
    return Finding(
        "D29",
        "Dominant frequencies are as low as the record is short",
        f"{listed}: fewer than two cycles fit into {shortest:.3g} s, so the length of the record "
        "sets them as much as the ground does; lengthen run.duration_s before you use them.",
        numbers=low,
    )
