"""Quadratic zones: exact for quadratic motion, no force from rigid motion, lumped mass, order."""

import numpy as np
import pytest
from crooked_box import crooked
from quadratic_reference import zone_stiffness

from pyblast import core
from pyblast.mesh import tetrahedra
from pyblast.mesh.grid import structured_box
from pyblast.mesh.nodes import nodes_of
from pyblast.solver.assembly import zone_packs
from pyblast.solver.time_step import QUADRATIC, zone_frequencies

LAME, SHEAR = 3.0, 2.0


def zone_arguments(quadratic, lame=LAME, shear=SHEAR, starts=(0,)):
    n, width = len(quadratic.zone_nodes), core.HEX_WIDTH[False]
    arrays = {
        "zone_lambda": np.broadcast_to(lame, n),
        "zone_shear": np.broadcast_to(shear, n),
        "domain_zone_start": np.array([*starts, n]),
        "pack_node": np.zeros((1, 1, width)),
    }
    return {
        "first": 1,
        "last": n,
        "zone_slot": np.asfortranarray(quadratic.zone_nodes + 1),
        "metric": zone_packs(quadratic, arrays)["pack_metric"][:, 0].T,
    }


def forces(quadratic, motion, swelling=None, **moduli):
    """Return nodal forces (n_nodes, 3) of motions (n_nodes, 3)."""
    force = np.zeros_like(motion)
    core._core.pyblast_tet15.tet15_forces(
        **zone_arguments(quadratic, **moduli),
        deviatoric=motion.T,
        volumetric=(motion if swelling is None else swelling).T,
        same_field=swelling is None,
        force=force.T,
    )
    return force


def energy(quadratic, motion, share=(1.0, 1.0), **moduli):
    return core._core.pyblast_tet15.tet15_energy(
        **zone_arguments(quadratic, **moduli), field=motion.T, share=share
    )


def inner(quadratic):
    high = quadratic.points.max(axis=0)
    return ((quadratic.points > 1e-9) & (quadratic.points < high - 1e-9)).all(axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_linear_motion_loads_no_inner_node(seed):
    quadratic = nodes_of(crooked(seed), True)
    gradient = np.random.default_rng(seed).normal(size=(3, 3))

    force = forces(quadratic, quadratic.points @ gradient.T)

    assert np.abs(force[inner(quadratic)]).max() < 1e-12 * np.abs(force).max()


def test_quadratic_motion_stores_its_energy_exactly():
    quadratic = nodes_of(crooked(), True)
    x, y, z = quadratic.points.T
    a, b, c = quadratic.points.max(axis=0)

    stored = energy(quadratic, np.stack([x**2, x * z, 0.0 * y], axis=1))

    # Strain: xx = 2x, gamma_xy = z, gamma_yz = x.
    exact = 0.5 * (LAME + 2.0 * SHEAR) * 4.0 * a**3 * b * c / 3.0
    exact += 0.5 * SHEAR * (a * b * c**3 + a**3 * b * c) / 3.0
    assert stored == pytest.approx(exact, rel=1e-12)


def test_rigid_motion_loads_nothing():
    quadratic = nodes_of(crooked(), True)
    turned = np.cross([0.3, -0.7, 0.2], quadratic.points) + np.array([5.0, 1.0, -2.0])
    strained = forces(quadratic, quadratic.points * [1.0, 0.0, 0.0])

    assert np.abs(forces(quadratic, turned)).max() < 1e-12 * np.abs(strained).max()


def test_a_shift_however_long_leaves_no_force_at_all():
    quadratic = nodes_of(crooked(), True)

    assert not forces(quadratic, np.full_like(quadratic.points, 1e6)).any()


def test_forces_are_those_of_the_stiffness_of_each_zone():
    mesh = crooked(3)
    quadratic = nodes_of(mesh, True)
    rng = np.random.default_rng(3)
    lame, shear = rng.uniform(1.0, 2.0, size=(2, len(mesh.zones)))
    motion = rng.normal(size=quadratic.points.shape)

    root = np.sqrt(tetrahedra.VOLUME_SHARE)[:, None]
    volume = tetrahedra.volumes(mesh.points, mesh.zones)[:, None, None]
    local = (motion[quadratic.zone_nodes] * root).reshape(-1, 45, 1)
    parts = zone_stiffness(mesh.points, mesh.zones, lame, shear) @ local
    wanted = np.zeros_like(motion)
    np.add.at(wanted, quadratic.zone_nodes, -volume * parts.reshape(-1, 15, 3) * root)

    force = forces(quadratic, motion, lame=lame, shear=shear)
    assert np.abs(force - wanted).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("seed", range(3))
def test_no_motion_but_a_rigid_one_is_free(seed):
    mesh = crooked(seed)
    one = np.ones(len(mesh.zones))

    values = np.linalg.eigvalsh(zone_stiffness(mesh.points, mesh.zones, LAME * one, SHEAR * one))

    assert np.abs(values[:, :6]).max() < 1e-12 * values[:, -1].max()
    assert (values[:, 6] > 1e-5 * values[:, -1]).all()


def test_forces_are_symmetric_and_do_the_work_of_the_energy():
    quadratic = nodes_of(crooked(1), True)
    one, other = np.random.default_rng(1).normal(size=(2, *quadratic.points.shape))

    across = np.sum(one * forces(quadratic, other))

    assert across == pytest.approx(np.sum(other * forces(quadratic, one)), rel=1e-12)
    assert energy(quadratic, one) == pytest.approx(
        -0.5 * np.sum(one * forces(quadratic, one)), rel=1e-12
    )


def test_swelling_and_shearing_may_be_those_of_two_fields():
    quadratic = nodes_of(crooked(2), True)
    one, other = np.random.default_rng(2).normal(size=(2, *quadratic.points.shape))
    fluid = {"lame": LAME + 2.0 * SHEAR, "shear": 0.0}
    solid = {"lame": -2.0 * SHEAR, "shear": SHEAR}

    both = forces(quadratic, one, swelling=other)

    parts = forces(quadratic, one, **solid) + forces(quadratic, other, **fluid)
    assert np.abs(both - parts).max() < 1e-12 * np.abs(both).max()
    assert energy(quadratic, one, share=(0.0, 0.5)) == pytest.approx(
        0.5 * energy(quadratic, one, **fluid), rel=1e-12
    )


def test_any_part_of_the_zones_can_be_asked_for():
    quadratic = nodes_of(crooked(4), True)
    motion = np.random.default_rng(4).normal(size=quadratic.points.shape)
    n, cut = len(quadratic.zone_nodes), 37

    force = np.zeros_like(motion)
    packs = zone_arguments(quadratic, starts=(0, cut))
    n_first = -(-cut // core.HEX_WIDTH[False])
    parts = ((1, cut, np.s_[:n_first]), (cut + 1, n, np.s_[n_first:]))
    for first, last, own in parts:
        arguments = {**packs, "first": first, "last": last, "metric": packs["metric"][..., own]}
        core._core.pyblast_tet15.tet15_forces(
            **arguments, deviatoric=motion.T, volumetric=motion.T, same_field=True, force=force.T
        )

    whole = forces(quadratic, motion)
    assert np.abs(force - whole).max() < 1e-13 * np.abs(whole).max()


@pytest.mark.parametrize("seed", range(3))
def test_the_frequency_of_a_zone_is_about_that_of_constant_strain_times_a_number(seed):
    mesh = crooked(seed)
    one = np.ones(len(mesh.zones))
    moduli = (LAME * one, SHEAR * one)

    exact = np.linalg.eigvalsh(zone_stiffness(mesh.points, mesh.zones, *moduli))[:, -1]

    ratio = np.sqrt(exact / zone_frequencies(mesh.points, mesh.zones, *moduli, one))
    assert ratio == pytest.approx(QUADRATIC, rel=0.15)


def phase_error(n):
    """Return the error of the squared frequency of a standing shear wave by Rayleigh's quotient."""
    quadratic = nodes_of(structured_box((n, n, n), (1.0, 1.0, 1.0)), True)
    mesh = quadratic.mesh
    mass = quadratic.sums(tetrahedra.volumes(mesh.points, mesh.zones))[:, None]
    x, y, z = np.pi * quadratic.points.T
    form = (np.sin(x) * np.cos(y), -np.cos(x) * np.sin(y), 0.0 * z)
    motion = np.stack(form, axis=1)
    stiffness = -np.sum(motion * forces(quadratic, motion))
    return stiffness / np.sum(mass * motion**2) / (SHEAR * 2.0 * np.pi**2) - 1.0


def test_the_phase_error_falls_with_the_fourth_power_of_the_size():
    coarse, fine = phase_error(3), phase_error(6)

    assert 0.0 < fine < 3e-3
    assert 3.4 < np.log2(coarse / fine) < 4.5
