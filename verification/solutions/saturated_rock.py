"""Rock whose pores are full of a fluid, by Gassmann's modulus."""

from dataclasses import replace

from pyblast.errors import InputError
from pyblast.model.material import Material


def saturated_rock(
    dry: Material,
    porosity: float,
    solid_bulk: float,
    fluid_bulk: float = 2.2e9,
    fluid_density: float = 1000.0,
) -> Material:
    """Return the material of fluid-saturated rock (Gassmann); theory.md (1.9).

    Parameters
    ----------
    dry : Material
    porosity : float
    solid_bulk, fluid_bulk : float, Pa
    fluid_density : float, kg/m3

    Raises
    ------
    InputError
        If the porosity is not between 0 and 1, or the solid not stiffer than the dry rock.
    """
    if not 0.0 < porosity < 1.0:
        raise InputError(f"material.porosity: must lie between 0 and 1, got {porosity:g}")
    if not dry.bulk < solid_bulk:
        raise InputError(
            f"material.solid_bulk: must exceed that of the dry rock, {dry.bulk:g} Pa, got "
            f"{solid_bulk:g} Pa"
        )
    share = dry.bulk / solid_bulk
    pores = porosity / fluid_bulk + (1.0 - porosity) / solid_bulk - share / solid_bulk
    bulk = dry.bulk + (1.0 - share) ** 2 / pores
    return replace(dry, density=dry.density + porosity * fluid_density, bulk=bulk)
