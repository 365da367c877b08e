"""Zones that can yield are judged in time: never too late, and with the same bits however often."""

from dataclasses import replace

import numpy as np
import pytest

from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.material import Damping, MohrCoulomb
from pyblast.model.model import Model
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.initial_stress import excess_stress
from pyblast.solver.preparation import prepare
from verification.columns import ROCK

ZONES = 4000
LAME, SHEAR = 8e9, 5e9
SQUARES = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # of engineering strains


def judged(law, rng):
    """Return initial stress and strain (n, 6) of zones, their room (n,) and a row of properties."""
    material = replace(ROCK, law=law, cohesion=1e6, friction=0.7, tension=8e5)
    table = core.ZONE_LAWS[law.name]
    row = core.property_row(table, law.properties(material), core.N_ZONE_PROPERTIES)
    initial = rng.normal(scale=5e5, size=(ZONES, 6)) - 2e6 * rng.random((ZONES, 1)) * (SQUARES == 1)
    strain = rng.normal(scale=3e-5, size=(ZONES, 6))
    room = core._core.pyblast_mohr_coulomb.yield_margins(
        row, np.full(ZONES, LAME), np.full(ZONES, SHEAR), initial, strain
    )
    return initial, strain, room, row


def yielded(initial, strain, row):
    """Tell which zones yield, (n,) bool."""
    found = np.zeros(len(strain), dtype=bool)
    for n, (before, now) in enumerate(zip(initial, strain, strict=True)):
        state, lost = np.zeros(core.N_ZONE_STATE), np.zeros(1)
        core._core.pyblast_zone_laws.zone_stress(
            core.ZONE_LAWS["mohr-coulomb"].number + 1, row, LAME, SHEAR, before, now, state, lost
        )
        found[n] = state[6:].any()
    return found


@pytest.mark.parametrize("dilation", [0.0, 0.3])
def test_no_zone_yields_within_the_strain_that_it_has_room_for(dilation):
    rng = np.random.default_rng(4)
    initial, strain, room, row = judged(MohrCoulomb(dilation), rng)
    safe = room > 0.0
    assert 0.2 < safe.mean() < 0.8
    assert yielded(initial[~safe], strain[~safe], row).mean() > 0.6
    assert not yielded(initial[safe], strain[safe], row).any()

    more = rng.normal(size=(safe.sum(), 6))
    more[:, :3] -= more[:, :3].mean(axis=1, keepdims=True)
    more /= np.sqrt((SQUARES * more**2).sum(axis=1, keepdims=True))
    more[:, :3] += rng.choice([-1.0, 1.0], size=(safe.sum(), 1)) / 3.0
    end = strain[safe] + 0.999 * room[safe, None] * more

    assert not yielded(initial[safe], end, row).any()
    assert yielded(initial[safe], strain[safe] + 3.0 * room[safe, None] * more, row).mean() > 0.02


def shaken(size=(0.2, 0.0, 0.1), sides=()):
    """Return a pillar that a pulse (m/s) makes yield here and there, held sideways or not."""
    rock = replace(ROCK, cohesion=3e5, friction=0.6, tension=1e5, law=MohrCoulomb(0.1))
    mesh = structured_box((2, 2, 30), (10.0, 10.0, 150.0))
    time = np.arange(0.0, 0.1, 1e-3)
    push = Seismogram(np.outer(np.sin(np.pi * time / 0.05) ** 3, size), 1e-3)
    model = Model(
        mesh, {"rock": rock}, damping=Damping(0.02, 10.0),
        boundaries=[Viscous("bottom"), StressInput("bottom", push), *sides],
    )  # fmt: skip
    return prepare(model, 0.1)


def marched(prepared, size, total=None):
    """Return the state after a march in calls of so many steps."""
    total = total or prepared.n_steps
    state = {name: value.copy() for name, value in prepared.state.items()}
    views, step = core.to_fortran(prepared.constants), 0
    while step < total:
        n_steps = min(size, total - step)
        core.advance(views, state, step, n_steps, 20)
        step += n_steps
    return state


HELD = [Fixed(side, ("east", "north")) for side in ("west", "east", "south", "north")]


@pytest.mark.parametrize(("size", "sides"), [((0.2, 0.0, 0.1), ()), ((0.0, 0.0, 0.2), HELD)])
def test_how_often_zones_are_judged_changes_no_bit(size, sides):
    prepared = shaken(size, sides)

    seldom, always = marched(prepared, prepared.n_steps), marched(prepared, 1)

    yields = always["row_state"][:, 6:].any(axis=1)
    assert 0.02 < yields.mean() < 0.98
    for name, value in always.items():
        if name != "sums":
            assert np.array_equal(seldom[name], value), name


def test_excess_stress_of_zones_stays_within_their_strength():
    prepared = shaken()
    state = marched(prepared, 20, prepared.n_steps // 3)

    row = prepared.constants["zone_row"]
    stress = prepared.constants["row_initial"][row] + excess_stress(prepared.constants, state)
    principal = np.linalg.eigvalsh(stress[:, [[0, 5, 4], [5, 1, 3], [4, 3, 2]]])

    assert principal.max() < 1e5 * (1.0 + 1e-6)
    root = 0.6 + np.sqrt(1.36)
    over = root**2 * principal[:, 2] - principal[:, 0] - 2.0 * 3e5 * root
    assert over.max() < 1e-6 * 3e5
    assert over.max() > -1e-6 * 3e5


@pytest.mark.parametrize("softened", [False, True])
def test_zones_that_have_softened_yield_below_their_full_strength(softened):
    law = MohrCoulomb(cohesion_residual=1e5, friction_residual=0.3, shear_strain=1e-3)
    material = replace(ROCK, law=law, cohesion=5e6, friction=0.7, tension=3e6)
    model = Model(structured_box((3, 3, 3), (3.0, 3.0, 3.0)), {"rock": material})
    prepared = prepare(model, 1e-2)
    views, state = prepared.begun()
    state["row_state"][:, 12] = 0.01 if softened else 0.0
    state["displacement"][:, 0] = 2e6 / ROCK.shear * model.mesh.points[:, 2]

    core.advance(views, state, 0, 1, 1)

    assert (np.abs(state["row_state"][:, 6:12]).max() > 0.0) == softened
