"""Columns of the ground beside a model, each marched alone under the input from below."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..meshing.geology import Layer
from ..meshing.grid import structured_box
from ..motion.seismogram import Seismogram
from .assembly import geometry_arrays
from .attenuation import relative_modulus
from .boundaries import Fixed, StressInput, VelocityInput, Viscous
from .materials import Damping
from .model import Model, Receiver
from .sources import TimeFunction

HELD = (("north", "vertical"), ("east", "vertical"), ("east", "north"))  # while one axis moves
SPARE_STEPS = 4  # beyond the end of the run, so that its last step still finds motion


@dataclass(frozen=True)
class GroundColumn:
    """What stands at one place beside the model.

    Parameters
    ----------
    levels : tuple of float, m
        Heights of its nodes, ascending.
    cells : tuple of (str, float)
        Group of each cell between them, and the factor on its wave speeds.
    """

    levels: tuple[float, ...]
    cells: tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False)
class Shaking:
    """How a column moves: by axis (0 east, 1 north, 2 vertical) that moves at all.

    Parameters
    ----------
    velocity : dict of int to list of TimeFunction, m/s
        At each level.
    stress : dict of int to list of TimeFunction, Pa
        In each cell what acts on a vertical side: shear stress of the axis and the vertical for
        0 and 1, normal stress across the column for 2.
    """

    velocity: dict[int, list[TimeFunction]]
    stress: dict[int, list[TimeFunction]]


def shake(model: Model, column: GroundColumn, inputs, dt: float, duration: float, march: Callable):
    """March a column under the input of a model, one run for each axis that moves.

    Parameters
    ----------
    model : Model
        Beside which it stands.
    column : GroundColumn
    inputs : sequence of StressInput or VelocityInput
        Through the level base of the model.
    dt : float, s
        Step that the column shall take too where it can.
    duration : float, s
    march : callable
        Model and duration to motion (n_steps, n_receivers, 3) and the kernel's constants.

    Returns
    -------
    Shaking
    """
    alone = _column_model(model, column, inputs)
    own = geometry_arrays(alone)[0]["dt"]
    alone = replace(alone, step_factor=alone.step_factor * min(1.0, dt / own))
    velocity, stress = {}, {}
    for axis, held in enumerate(HELD):
        if not any(np.abs(one.seismogram.velocity[:, axis]).max() > 0.0 for one in inputs):
            continue
        sides = [Fixed(side, held) for side in ("west", "east", "south", "north")]
        moved = [_one_axis(b, axis) for b in alone.boundaries]
        motion, constants = march(
            replace(alone, boundaries=[*sides, *moved]), duration + SPARE_STEPS * dt
        )
        velocity[axis], stress[axis] = _histories(motion[:, :, axis], alone.mesh.points, constants)
    if 2 in stress:
        stress[2] = [
            _across(model, group, history)
            for (group, _), history in zip(column.cells, stress[2], strict=True)
        ]
    return Shaking(velocity, stress)


def _column_model(model, column, inputs):
    """Return the model of a column without guides; every cell is a group with its own material."""
    names = [str(number) for number in range(len(column.cells))]
    levels = np.array(column.levels)
    thickness = np.diff(levels)[::-1]
    layers = [Layer(n, t) for n, t in zip(names[::-1], thickness[:-1], strict=False)]
    layers.append(Layer(names[0]))
    across = np.array([0.0, thickness.min()])
    materials, damping, media = {}, {}, {}
    base = [b for b in model.boundaries if b.surface == inputs[0].surface]
    known = next((b.media for b in base if isinstance(b, Viscous)), {})
    for name, (group, factor) in zip(names, column.cells, strict=True):
        rock = model.materials[group]
        materials[name] = replace(rock, bulk=rock.bulk * factor**2, shear=rock.shear * factor**2)
        by_group = isinstance(model.damping, dict)
        damping[name] = model.damping[group] if by_group else model.damping or Damping(0.0, 1.0)
        if group in known:
            media[name] = known[group]
    ends = [replace(one, surface="bottom") for one in inputs]
    ends = [
        replace(one, doubled=model.doubles(given)) if isinstance(one, StressInput) else one
        for one, given in zip(ends, inputs, strict=True)
    ]
    if any(isinstance(b, Viscous) for b in base):
        ends.append(Viscous("bottom", media))
    mesh = structured_box(across, across, levels, layers=layers)
    alone = Model(mesh, materials, boundaries=ends, damping=damping)
    places = [Receiver(str(n), tuple(p)) for n, p in enumerate(alone.mesh.points)]
    return replace(alone, receivers=places)


def _one_axis(boundary, axis):
    """Return a boundary whose input moves along one axis only."""
    if not isinstance(boundary, (StressInput, VelocityInput)):
        return boundary
    given = boundary.seismogram
    velocity = np.zeros_like(given.velocity)
    velocity[:, axis] = given.velocity[:, axis]
    return replace(boundary, seismogram=Seismogram(velocity, given.dt, given.start))


def _histories(motion, points, constants):
    """Turn velocities (n_steps, n_nodes) at half steps into those and stresses at whole steps.

    The stress in a cell is what moves the mass above it, whatever its law: theory.md (4.12).
    """
    dt, area = constants["dt"], np.ptp(points[:, 0]) * np.ptp(points[:, 1])
    level = np.unique(points[:, 2], return_inverse=True)[1]
    share = (level[:, None] == np.arange(level.max() + 1)) * constants["node_mass"][:, None]
    mass, drag = share.sum(axis=0), constants["node_alpha"] @ share
    velocity = motion @ (share / mass)
    before = np.vstack([np.zeros_like(velocity[:1]), velocity[:-1]])
    mean = 0.5 * (before + velocity)
    pull = mass * (velocity - before) / dt + drag * mean
    above = np.cumsum(pull[:, ::-1], axis=1)[:, ::-1]
    stress = -above[:, 1:] / area
    return [TimeFunction(v, dt) for v in mean.T], [TimeFunction(s, dt) for s in stress.T]


def _across(model, group, history):
    """Return the normal stress across a column whose sides are held, from that along it.

    Where ground fades the ratio depends on frequency: theory.md (4.13).
    """
    branches = model.branches(group)
    lame, shear = model.law(group).moduli(model.materials[group])
    if not branches:
        return replace(history, values=lame / (lame + 2.0 * shear) * history.values)
    n_padded = 2 * len(history.values)
    frequency = np.fft.rfftfreq(n_padded, history.dt)
    along = (lame + 2.0 * shear) * relative_modulus(branches, frequency, "compression")
    ratio = 1.0 - 2.0 * shear * relative_modulus(branches, frequency) / along
    spectrum = np.fft.rfft(history.values, n_padded) * ratio.conj()
    return replace(history, values=np.fft.irfft(spectrum, n_padded)[: len(history.values)])
