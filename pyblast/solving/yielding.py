"""Zones that can yield, in the arrays of a run: their whole stress, and what they came to."""

import numpy as np

from .kernels import ZONE_LAWS

EXCESS, HARDENING = slice(0, 6), slice(12, 14)  # columns of row_state of a zone that can yield


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
    rows = constants["zone_row"][can_yield(constants)]
    initial, memory = constants["row_initial"].copy(), np.zeros_like(settled["row_state"])
    initial[rows] = static["row_initial"][rows] + settled["row_state"][rows, EXCESS]
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
    return zone, constants["row_initial"][row] + memory[:, EXCESS], memory[:, HARDENING]
