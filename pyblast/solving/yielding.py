"""Zones that can yield, in the arrays of a run: their whole stress, and what they came to."""

import numpy as np

from ..meshing.tetrahedra import shape_gradients
from .kernels import ZONE_LAWS

PLASTIC, HARDENING = slice(6, 12), slice(12, 14)  # columns of row_state of a zone that can yield


def can_yield(constants):
    """Tell for every zone whether its law is one that yields, (n_zones,) bool."""
    yields = constants["set_law"] == ZONE_LAWS["mohr-coulomb"].number
    return np.repeat(yields[constants["domain_set"]], np.diff(constants["domain_zone_start"]))


def stressed_rows(constants, stress):
    """Return ``row_initial`` with the stress (n_zones, 6) of the zones that can yield in it."""
    yields = can_yield(constants)
    initial = constants["row_initial"].copy()
    initial[constants["zone_row"][yields]] = stress[yields]
    return initial


def settled_rows(constants, static, settled):
    """Return ``row_initial`` and ``row_state`` that go on from the end of the static stage.

    Zones that can yield start from their settled stress, strained no more but as hardened or
    softened as they are.
    """
    yields = can_yield(constants)
    rows = constants["zone_row"][yields]
    initial, memory = constants["row_initial"].copy(), np.zeros_like(settled["row_state"])
    initial[rows] = static["row_initial"][rows] + excess_stress(static, settled)[yields]
    memory[rows, HARDENING] = settled["row_state"][rows, HARDENING]
    return initial, memory


def yield_states(constants, state):
    """Return what the zones that can yield have come to.

    Parameters
    ----------
    constants : dict
        Of a `Prepared`.
    state : dict
        Of a `Run` or `Prepared`.

    Returns
    -------
    zone : (n,) int64
    stress : (n, 6) float64, Pa
        Whole stress by the zone's own law, before the means of patches; theory.md (2.32).
    plastic : (n, 2) float64
        Largest shear and tensile plastic strain since the ground was untouched.
    """
    zone = np.flatnonzero(can_yield(constants))
    row = constants["zone_row"][zone]
    memory = state["row_state"][row]
    stress = constants["row_initial"][row] + excess_stress(constants, state)[zone]
    return zone, stress, memory[:, HARDENING]


def excess_stress(constants, state):
    """Return the stress over the initial one that zones had when forces were last found.

    Parameters
    ----------
    constants, state : dict
        Of a march.

    Returns
    -------
    (n_zones, 6) float64, Pa
        By Hooke's law, mean strains of patches and plastic strains; theory.md (2.32).
    """
    then = state["displacement"] - constants["dt"] * state["velocity"]
    domain = np.repeat(
        np.arange(len(constants["domain_set"])), np.diff(constants["domain_zone_start"])
    )
    slot = constants["zone_slot"].T[:, :4] + constants["domain_slot_start"][domain][:, None]
    moved = then[constants["slot_node"][slot]]
    slope = np.einsum(
        "zki,zkj->zij", moved[:, 1:] - moved[:, :1], shape_gradients(constants["slot_place"], slot)
    )
    strain = (slope + slope.transpose(0, 2, 1))[:, (0, 1, 2, 1, 2, 0), (0, 1, 2, 2, 0, 1)]
    strain[:, :3] *= 0.5
    patch, shared = constants["zone_patch"], constants["zone_patch"] >= 0
    mean = _dilations(constants, then)[(patch + constants["domain_patch_start"][domain])[shared]]
    strain[shared, :3] += ((mean - strain[shared, :3].sum(axis=1)) / 3.0)[:, None]
    yields = can_yield(constants)
    strain[yields] -= state["row_state"][constants["zone_row"][yields], PLASTIC]
    stress = constants["zone_shear"][:, None] * strain * ([2.0] * 3 + [1.0] * 3)
    stress[:, :3] += (constants["zone_lambda"] * strain[:, :3].sum(axis=1))[:, None]
    return stress


def _dilations(constants, motion):
    """Return how patches swell with the motion (n_nodes, 3) of the nodes, (n_patches,)."""
    starts = constants["domain_patch_start"]
    patch = np.repeat(np.arange(starts[-1]), np.diff(constants["patch_start"])[: starts[-1]])
    domain = np.searchsorted(starts, patch, side="right") - 1
    slot = constants["patch_slot"] + constants["domain_slot_start"][domain]
    parts = (constants["patch_gradient"] * motion[constants["slot_node"][slot]]).sum(axis=1)
    return np.bincount(patch, parts, minlength=starts[-1])
