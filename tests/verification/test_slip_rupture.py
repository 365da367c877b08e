"""The boundary integral's kernels and stresses against static limits and Laplace transforms."""

import numpy as np
import pytest

from verification.solutions.slip_rupture import kernel, step_weights

RATIO = 1.8


@pytest.mark.parametrize("mode", [2, 3])
@pytest.mark.parametrize("s", [0.3, 1.0, 3.0])
def test_a_kernel_is_what_the_half_spaces_answer_in_the_laplace_domain(mode, s):
    times = np.arange(0.0, 60.0 / s, 1e-3)
    slow, fast = np.sqrt(1.0 + s**2), np.sqrt(1.0 + (s / RATIO) ** 2)
    rayleigh = (1.0 + slow**2) ** 2 - 4.0 * slow * fast

    found = np.trapezoid(kernel(mode, times, RATIO) * np.exp(-s * times), times)

    wanted = (rayleigh / (slow * s**2) if mode == 2 else slow) - s
    assert found == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize(("mode", "stiffness"), [(2, 1.0 - RATIO**-2), (3, 0.5)])
def test_slip_that_stays_leaves_the_static_stress(mode, stiffness):
    k, rate = np.array([2e-3]), 50.0

    weights = step_weights(mode, k, RATIO, rate, 4000)[:, 0]

    # Slip of one unit in the first step; afterwards stress falls by stiffness times k.
    late = weights[-400:].mean() / (rate * k[0])
    assert late == pytest.approx(-stiffness, rel=5e-3)
