"""Water in pores: stiffer in compression alone, and nonsense refused."""

import pytest

from pyblast.errors import InputError
from pyblast.model.material import Material
from verification.solutions.saturated_rock import saturated_rock


def test_water_stiffens_compression_but_not_shear():
    dry = Material(2300.0, 10e9, 8e9)
    wet = saturated_rock(dry, 0.2, 37e9)

    assert wet.shear == dry.shear
    assert wet.density == pytest.approx(2500.0)
    assert dry.bulk < wet.bulk < 37e9


@pytest.mark.parametrize(("porosity", "solid"), [(0.0, 37e9), (0.2, 5e9)])
def test_rock_that_is_none_is_refused(porosity, solid):
    with pytest.raises(InputError, match="material"):
        saturated_rock(Material(2300.0, 10e9, 8e9), porosity, solid)
