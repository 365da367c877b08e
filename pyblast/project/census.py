"""What a project is about to do: volumes, zones, frequencies, steps, memory, time."""

import time
from dataclasses import dataclass, replace

import numpy as np

from ..mesh.mesh import locate, quality, volumes
from ..signals.spectra import dominant_frequency
from ..solver import assembly, preparation, run
from ..solver.edge_springs import run_bytes

TRIAL_STEPS = 40


@dataclass(frozen=True)
class GroupCensus:
    """Counts, sizes and share of added mass of one material in the mesh; SI."""

    name: str
    zones: int
    volume: float
    mass: float
    mean_edge: float
    smallest_quality: float
    highest_frequency: float
    added_share: float


@dataclass(frozen=True)
class Census:
    """Counts and sizes of a model, what limits its step and what the run will cost; SI.

    Parameters
    ----------
    elements : str
        Kind of zones, and why; one sentence.
    groups : tuple of GroupCensus
    zones, nodes, contacts, blocks : int
    dt, undamped_dt : float, s
        Time step, and the critical one without stiffness damping.
    limited_by : str
    added_mass : float
        Share of the mass that selective mass scaling adds.
    steps : int
    memory : float, bytes
    seconds : float or None
        Estimate of the dynamic stage, measured on a few steps; None where not asked for.
    """

    elements: str
    groups: tuple[GroupCensus, ...]
    zones: int
    nodes: int
    contacts: int
    blocks: int
    dt: float
    undamped_dt: float
    limited_by: str
    added_mass: float
    steps: int
    memory: float
    seconds: float | None


def take_census(project, measure=False) -> Census:
    """Count and measure the model of a project.

    Parameters
    ----------
    project : Project
    measure : bool
        Whether to march a few steps for an estimate of the time.
    """
    model = project.model
    geometry, limit = assembly.geometry_arrays(model)
    n_steps = int(np.ceil(project.duration / geometry["dt"]))
    mass = model.zone_values("density") * volumes(model.mesh)
    return Census(
        elements=project.elements,
        groups=_groups(model, mass, limit.added_share),
        zones=len(model.mesh.zones),
        nodes=len(model.nodes.points),
        contacts=len(geometry["contact_area"]),
        blocks=int(model.mesh.blocks().max()) + 1,
        dt=float(geometry["dt"]),
        undamped_dt=limit.undamped,
        limited_by=limit.limited_by,
        added_mass=float(limit.added_mass.sum() / mass.sum()),
        steps=n_steps,
        memory=run_bytes(model, n_steps * (1 + len(model.receivers))),
        seconds=_measured(model, float(geometry["dt"]), n_steps) if measure else None,
    )


def _groups(model, mass, added_share):
    """Count each material."""
    mesh = model.mesh
    edges = model.mean_edges()
    worst = quality(mesh)
    found = []
    for number, name in enumerate(mesh.groups):
        mine = mesh.zone_group == number
        if mine.any():
            material = model.materials[name]
            found.append(
                GroupCensus(
                    name,
                    int(mine.sum()),
                    float(mass[mine].sum() / material.density),
                    float(mass[mine].sum()),
                    float(edges[name]),
                    float(worst[mine].min()),
                    carried_frequency(material.cs, float(edges[name]), model.edges_per_wavelength),
                    float(added_share[name]),
                )
            )
    return tuple(found)


def carried_frequency(speed, edge, edges_per_wavelength=10.0):
    """Return the highest frequency in Hz that zones of an edge in m carry; eq. (1) of the paper."""
    return speed / (edges_per_wavelength * edge)


def _measured(model, dt, n_steps):
    """March a few steps without the static stage and return the seconds that all would take."""
    trial = replace(model, insitu=None)
    prepared = preparation.prepare(trial, TRIAL_STEPS * dt)
    began = time.perf_counter()
    run.simulate(trial, TRIAL_STEPS * dt, prepared=prepared)
    return n_steps * (time.perf_counter() - began) / prepared.n_steps


def receiver_groups(project):
    """Return the material under each receiver, dict of str to str."""
    mesh = project.model.mesh
    if not project.receivers:
        return {}
    zone, _ = locate(mesh, [receiver.position for receiver in project.receivers])
    names = [mesh.groups[group] for group in mesh.zone_group[zone]]
    return {r.name: name for r, name in zip(project.receivers, names, strict=True)}


def central_frequency(project):
    """Return the frequency in Hz that damping is set to, else the dominant one of the input."""
    if project.config.damping is not None:
        return project.config.damping.frequency_hz
    motion = project.motions[0]
    return float(dominant_frequency(motion).hz[int(np.nanargmax(motion.ppv))])


def input_band(project):
    """Return the highest frequency in Hz of what enters: the low-pass, or 95 % of the energy."""
    low_pass = None if project.input is None else project.config.input.low_pass_hz
    tops = [] if low_pass is None else [low_pass]
    return max(tops + [highest_frequency(motion) for motion in project.motions[len(tops) :]])


def highest_frequency(motion):
    """Return the frequency in Hz below which 95 % of the energy of a motion lies."""
    velocity = np.nan_to_num(motion.velocity)
    power = (np.abs(np.fft.rfft(velocity, axis=0)) ** 2).sum(axis=1)
    frequency = np.fft.rfftfreq(len(velocity), motion.dt)
    return float(frequency[np.searchsorted(np.cumsum(power), 0.95 * power.sum())])
