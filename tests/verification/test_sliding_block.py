"""Heat of a block that slides down an inclined joint, beside case 28."""

import math

import numpy as np
import pytest

from verification.cases.blocks import GRAVITY, KN, KS, THICKNESS, plate, pushed
from verification.columns import ROCK


def test_friction_of_a_sliding_block_is_in_the_ledger():
    slope, friction = math.radians(35.0), 0.4
    weight = ROCK.density * THICKNESS * GRAVITY * math.cos(slope)
    strength = {"kn": KN, "ks": KS, "cohesion": 0.0, "friction": friction, "tension": 0.0}
    down = [GRAVITY * math.sin(slope), 0.0, 0.0]

    result = pushed(plate("coulomb", weight, **strength), 0.3, down)

    record = result.seismograms["block"]
    path = np.sum(record.velocity[:, 0]) * result.dt
    heat = friction * weight * 16.0 * path
    assert result.energy["joint_dissipated"][-1] == pytest.approx(heat, rel=0.01)
