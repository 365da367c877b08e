"""Reciprocity along an axis: one run of a force at a sensor for all shots and all such sensors."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy

from ..errors import InputError
from ..model.model import Receiver
from ..model.source import PointForce, TimeFunction
from ..runs.greens import greens_functions
from ..runs.parallel import is_single
from ..signals.seismogram import fast_length
from .project import Project

AXES = {"x": ("west", "east"), "y": ("south", "north")}
LEVEL = 1e-9  # deg, m


def same_along(project: Project) -> str:
    """Return the axis, "x" or "y", along which the ground of a project is the same; else empty.

    Its two ends are viscous, layers are flat, and faults lie along it.
    """
    mesh, table = project.config.mesh, project.config.boundaries
    uneven = mesh.file, mesh.surface_file, mesh.benches, mesh.joint_sets, mesh.fractures
    if any(uneven) or project.fields or project.config.ground.model_dump(exclude_defaults=True):
        return ""
    for axis, ends in AXES.items():
        across = 90.0 if axis == "y" else 0.0  # a bearing across the axis, in which planes may dip
        along = [
            fault.dip_deg < LEVEL or abs((fault.dip_direction_deg - across) % 180.0) < LEVEL
            for fault in mesh.faults
        ]
        limited = any(fault.radius_m or fault.extent_m for fault in mesh.faults)
        if set(ends) <= set(table.viscous) and all(along) and not limited:
            return axis
    return ""


def mirrored_across(project: Project, axis: str) -> bool:
    """Return whether the ground is its own mirror image in the middle across an axis."""
    table, ends = project.config.boundaries, AXES["y" if axis == "x" else "x"]
    kinds = [
        {name for name in ("viscous", "roller", "fixed") if end in getattr(table, name)}
        for end in ends
    ]
    return kinds[0] == kinds[1] and all(f.dip_deg < LEVEL for f in project.config.mesh.faults)


@dataclass(frozen=True, eq=False)
class Responses:
    """Responses: motion along sensors' normals after a unit step of force at shots.

    Parameters
    ----------
    velocity : (n, n_samples) float64, m/s per N
        Of each pair of sensor and shot, from the step on; without what is faster than ``highest``.
    dt : float, s
    runs : int
        Runs of the model that they took.
    """

    velocity: np.ndarray
    dt: float
    runs: int

    def faster(self, factor: float) -> "Responses":
        """Return the responses where all wave speeds, and stiffnesses squared, have a factor.

        Exact for elastic bodies, viscous sides and joints: ``v(t; a c) = v(a t; c)/a`` after a step
        of force. Samples beyond the last one repeat it.
        """
        n = self.velocity.shape[1]
        times = np.minimum(factor * np.arange(n), n - 1.0)
        spline = scipy.interpolate.make_interp_spline(np.arange(n), self.velocity, 3, axis=1)
        return replace(self, velocity=spline(times) / factor)

    def driven(self, force: TimeFunction) -> np.ndarray:
        """Return the motion (n, n_samples) in m/s after a force that begins at zero."""
        n = self.velocity.shape[1]
        increments = np.diff(force(self.dt * (np.arange(n + 1) - 0.5)))  # about each sample
        size = fast_length(2 * n)
        spectrum = np.asarray(scipy.fft.rfft(self.velocity, size, axis=1))
        spectrum *= np.asarray(scipy.fft.rfft(increments, size))
        return np.asarray(scipy.fft.irfft(spectrum, size, axis=1))[:, :n]


def responses(
    project: Project,
    sensors: Sequence[Receiver],
    shots: np.ndarray,
    direction: Sequence[float],
    *,
    duration: float,
    dt: float,
    folder: str | Path | None = None,
    executor: Executor | None = None,
) -> Responses:
    """Compute the responses of pairs of sensor and shot by as few runs as the ground allows.

    Parameters
    ----------
    project : Project
        Its ground is the same along an axis, see `same_along`; sensors are at the middle of it.
    sensors : sequence of n Receiver
        Each with a normal; pairs of one sensor repeat it.
    shots : (n, 3) float, m
    direction : (3,) float
        Of the forces.
    duration, dt : float, s
        Of the responses; motion faster than a quarter of the sampling rate is taken off.
    folder : path, optional
        Folder of stored responses.
    executor : Executor, optional
        As for `run_all`.

    Raises
    ------
    InputError
        If the ground differs along both axes, or a shot lies outside of the model.

    Notes
    -----
    Where the ground is its own mirror image across the axis, sensors of opposite sides share a run.
    Betti's theorem, theory.md (9.3).
    """
    axis = same_along(project)
    if not axis:
        raise InputError(
            f"{project.path.name}: its ground is not the same along x or y between viscous ends: "
            "run each shot by itself"
        )
    groups = _grouped(project, axis, sensors, np.asarray(shots, dtype=float))
    n = int(np.ceil(duration / dt))
    velocity, runs = np.zeros((len(sensors), n)), 0
    for sensor, members in groups.items():
        force = PointForce(np.zeros(3), np.asarray(direction, float), TimeFunction(np.zeros(2), dt))
        sources = [replace(force, position=position) for position in members.values()]
        normal = np.array(sensor[3:])
        receiver = Receiver("sensor", sensor[:3], normal=tuple(normal))
        model = project.model
        model = replace(model, sources=sources, receivers=(receiver,), single=is_single(model))
        bank = greens_functions(model, duration, side="receiver", folder=folder, executor=executor)
        runs += bank.runs
        steps = np.einsum("prct,c->pt", bank.response, normal)
        numbers = bank.numbers(sources)
        velocity[list(members)] = _resampled(steps, bank.dt, dt, n)[numbers]
    return Responses(velocity, dt, runs)


def _grouped(project, axis, sensors, shots):
    """Return positions (3,) of shots by pair, by position and normal of the sensor that is run."""
    along = "xyz".index(axis)
    across = 1 - along
    mesh, mirror = project.config.mesh, mirrored_across(project, axis)
    middle = np.array(mesh.origin_m) + 0.5 * np.array(mesh.size_m)
    groups: dict[tuple, dict[int, np.ndarray]] = {}
    for pair, (sensor, shot) in enumerate(zip(sensors, shots, strict=True)):
        position, normal = np.array(sensor.position), np.array(sensor.normal)
        moved = shot - position[along] * np.eye(3)[along] + middle[along] * np.eye(3)[along]
        position[along] = middle[along]
        if mirror and position[across] < middle[across]:
            for each in (position, moved):
                each[across] = 2.0 * middle[across] - each[across]
            normal[across] *= -1.0
        key = (*np.round(position, 9).tolist(), *np.round(normal + 0.0, 9).tolist())
        groups.setdefault(key, {})[pair] = moved
    return groups


def _resampled(steps, step, dt, n):
    """Return responses (n_places, n) at equal times from the step on, low-passed before."""
    corner = 0.25 / dt
    sections = scipy.signal.butter(6, corner, fs=1.0 / step, output="sos")
    lead = int(np.ceil(8.0 / (corner * step)))
    padded = np.pad(steps, ((0, 0), (lead, lead)), mode="edge")
    smooth = scipy.signal.sosfiltfilt(sections, padded, axis=1)[:, lead:-lead]
    times = step * np.arange(steps.shape[1])  # the step rises within one step of the run
    spline = scipy.interpolate.make_interp_spline(times, smooth, 3, axis=1)
    return spline(np.minimum(dt * np.arange(n), times[-1]))
