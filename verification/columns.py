"""Columns of rock in which P or S waves travel along x, for cases and tests."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

ROCK = Material.from_speeds(2500.0, 4000.0, 2000.0)
AXIS = {"P": 0, "S": 1}
SPEED = {"P": ROCK.cp, "S": ROCK.cs}
IMPEDANCE = {wave: ROCK.density * speed for wave, speed in SPEED.items()}
HELD = {"P": ("north", "vertical"), "S": ("east", "vertical")}


def guides(wave):
    """Return the boundaries that let a column move along one axis only."""
    return [Fixed(side, HELD[wave]) for side in ("south", "north", "bottom", "top")]


def column(n_edges, edge, planes=None):
    """Make a column half as wide as its edge, so that waves across it are far above the band."""
    size = (n_edges * edge, 0.5 * edge, 0.5 * edge)
    mesh = structured_box((n_edges, 1, 1), size, planes=planes)
    return mesh.split(list(planes)) if planes else mesh


def column_model(mesh, wave, ends=(), **parts):
    """Return the model of a column with receivers on its axis and guides on its sides."""
    places = parts.pop("receivers_at", ())
    axis = 0.5 * mesh.points[:, 1:].max(axis=0)
    receivers = [Receiver(f"{place:g}", (place, *axis)) for place in places]
    return Model(
        mesh, {"rock": ROCK}, boundaries=[*guides(wave), *ends], receivers=receivers, **parts
    )


def ricker(times, frequency):
    """Return the pulse (n,) whose peak of 1 comes at 1.5 periods."""
    phase = (np.pi * (frequency * times - 1.5)) ** 2
    return (1.0 - 2.0 * phase) * np.exp(-phase)


def pulse(frequency, wave, amplitude=1.0):
    """Return a Ricker pulse of particle velocity in m/s as a seismogram."""
    times = np.arange(0.0, 3.0 / frequency, 0.01 / frequency)
    velocity = np.zeros((len(times), 3))
    velocity[:, AXIS[wave]] = amplitude * ricker(times, frequency)
    return Seismogram(velocity, times[1])


def driven(mesh, wave, frequency, duration, receivers_at, amplitude=1.0, far=None, **parts):
    """Run a pulse from a viscous west end; return the seismograms by place and the run."""
    ends = [
        Viscous("west"),
        StressInput("west", pulse(frequency, wave, amplitude)),
        *([Viscous("east")] if far is None else far),
    ]
    model = column_model(mesh, wave, ends, receivers_at=receivers_at, **parts)
    result = simulate(model, duration)
    motion = {p: result.seismograms[f"{p:g}"] for p in receivers_at}
    return {p: (s.times, s.velocity[:, AXIS[wave]]) for p, s in motion.items()}, result


def started(model, duration, displacement, velocity):
    """Run from given displacements and velocities (n_nodes, 3), the latter half a step earlier."""
    prepared = prepare(model, duration)
    state = {**prepared.state, "displacement": displacement, "velocity": velocity}
    return simulate(model, duration, prepared=replace(prepared, state=state))


def misfit(found, wanted):
    """Return the norm of the difference over that of what is wanted."""
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def spectrum(times, values, frequencies):
    """Return the Fourier transform (n_frequencies,) of samples at evenly spaced times."""
    waves = np.exp(-2j * np.pi * np.outer(frequencies, times))
    return waves @ values * (times[1] - times[0])
