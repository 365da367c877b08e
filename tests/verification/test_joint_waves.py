"""Waves across one linear joint at normal incidence, beside case 5."""

import numpy as np
import pytest

from pyblast.model.joint import Joint
from verification.columns import IMPEDANCE, SPEED, column, driven, spectrum

FREQUENCY, EDGES = 20.0, 10


def passed(wave, normal_over_shear):
    """Return the complex spectrum behind a joint whose own spring for a wave stays the same."""
    edge = SPEED[wave] / FREQUENCY / EDGES
    k = 0.3 * IMPEDANCE[wave] * 2.0 * np.pi * FREQUENCY
    kn, ks = (k, k / normal_over_shear) if wave == "P" else (k * normal_over_shear, k)
    behind = 4 * EDGES * edge
    mesh = column(8 * EDGES, edge, {"J": ("x", 3 * EDGES * edge)})
    law = Joint("J", "elastic", {"kn": kn, "ks": ks})
    motion, _ = driven(mesh, wave, FREQUENCY, 0.45, [behind], joints=[law])
    return spectrum(*motion[behind], np.array([8.0, 13.0, 20.0]))


@pytest.mark.parametrize("wave", ["P", "S"])
def test_each_wave_feels_only_its_own_spring(wave):
    assert passed(wave, 4.0) == pytest.approx(passed(wave, 1.0), rel=1e-3)
