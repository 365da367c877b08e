"""What rock and soil are made of: elastic moduli, strength, damping."""

import math
from dataclasses import dataclass, replace

from ..errors import InputError
from .attenuation import Branch, relative_modulus
from .zone_laws import Elastic


@dataclass(frozen=True)
class Material:
    """Isotropic elastic material with Mohr-Coulomb strength.

    Parameters
    ----------
    density : float, kg/m3
    bulk, shear : float, Pa
    cohesion, tension : float, Pa
        Strength; of the checks, and of zones whose law yields.
    friction : float
        Tangent of the friction angle.
    law : zone law, optional
        How stress follows strain: one of ``pyblast.solving.zone_laws``.

    Raises
    ------
    InputError
        If density or a modulus is not positive, or a strength is negative.
    """

    density: float
    bulk: float
    shear: float
    cohesion: float = math.inf
    friction: float = 0.0
    tension: float = math.inf
    law: object = Elastic()

    def __post_init__(self):
        """Refuse values that are no material."""
        for name, unit in (("density", "kg/m3"), ("bulk", "Pa"), ("shear", "Pa")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"material.{name}: must be positive, got {value:g} {unit}")
        for name in ("cohesion", "friction", "tension"):
            if not getattr(self, name) >= 0.0:
                value = getattr(self, name)
                raise InputError(f"material.{name}: must not be negative, got {value}")

    @classmethod
    def from_young_poisson(cls, density, young, poisson, **strength):
        """Make a material from Young's modulus in Pa and Poisson's ratio."""
        if not -1.0 < poisson < 0.5:
            raise InputError(f"material.poisson: must lie between -1 and 0.5, got {poisson:g}")
        bulk = young / (3.0 * (1.0 - 2.0 * poisson))
        return cls(density, bulk, young / (2.0 * (1.0 + poisson)), **strength)

    @classmethod
    def from_speeds(cls, density, cp, cs, **strength):
        """Make a material from the speeds of P and S waves in m/s."""
        if not cp > math.sqrt(4.0 / 3.0) * cs > 0.0:
            raise InputError(
                f"material: cp must exceed 1.155 cs, got cp {cp:g} m/s and cs {cs:g} m/s"
            )
        shear = density * cs**2
        return cls(density, density * cp**2 - 4.0 / 3.0 * shear, shear, **strength)

    @property
    def first_lame(self):
        """First Lame modulus [Pa]."""
        return self.bulk - 2.0 / 3.0 * self.shear

    @property
    def cp(self):
        """Speed of P waves [m/s]; theory.md (1.2)."""
        return math.sqrt((self.bulk + 4.0 / 3.0 * self.shear) / self.density)

    @property
    def cs(self):
        """Speed of S waves [m/s]; theory.md (1.3)."""
        return math.sqrt(self.shear / self.density)

    @property
    def young(self):
        """Young's modulus [Pa]."""
        return 9.0 * self.bulk * self.shear / (3.0 * self.bulk + self.shear)

    @property
    def poisson(self):
        """Poisson's ratio."""
        return (3.0 * self.bulk - 2.0 * self.shear) / (2.0 * (3.0 * self.bulk + self.shear))


def saturated_rock(dry, porosity, solid_bulk, fluid_bulk=2.2e9, fluid_density=1000.0):
    """Return a material with its pores full of a fluid; theory.md (1.9).

    Parameters
    ----------
    dry : Material
    porosity : float
    solid_bulk, fluid_bulk : float, Pa
    fluid_density : float, kg/m3

    Raises
    ------
    InputError
        If the porosity is none, or the solid not stiffer than the dry rock.
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


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping, least at its central frequency.

    Parameters
    ----------
    ratio : float
        Share of critical damping at the central frequency when both parts act.
    frequency : float, Hz
    mass, stiffness : bool
        Which parts act.
    corner : float or None, Hz
        Low-pass of the motion that the stiffness part sees: it then hardly shortens the time
        step, and fades above the corner, theory.md (2.18); best at twice the band or more.

    Notes
    -----
    ``alpha = ratio * omega``, ``beta = ratio / omega``: theory.md (2.10).
    """

    ratio: float
    frequency: float
    mass: bool = True
    stiffness: bool = True
    corner: float | None = None

    def __post_init__(self):
        """Refuse values that are no damping."""
        if not 0.0 <= self.ratio < 1.0:
            raise InputError(f"damping.ratio: must lie between 0 and 1, got {self.ratio:g}")
        if not (math.isfinite(self.frequency) and self.frequency > 0.0):
            raise InputError(f"damping.frequency: must be positive, got {self.frequency:g} Hz")
        if self.corner is not None and not self.frequency < self.corner < math.inf:
            raise InputError(
                f"damping.corner: must exceed the central frequency of {self.frequency:g} Hz, "
                f"got {self.corner:g} Hz"
            )

    @property
    def alpha(self):
        """Mass part [1/s]."""
        return self.ratio * 2.0 * math.pi * self.frequency if self.mass else 0.0

    @property
    def beta(self):
        """Stiffness part that acts on the motion itself [s]."""
        return self._beta if self.corner is None else 0.0

    @property
    def _beta(self):
        """Stiffness part, low-passed or not [s]."""
        return self.ratio / (2.0 * math.pi * self.frequency) if self.stiffness else 0.0

    @property
    def low_passed(self):
        """Whether the stiffness part acts on low-passed motion."""
        return self.corner is not None and self._beta > 0.0

    @property
    def branches(self):
        """What low-passed stiffness damping lets relax: theory.md (2.18)."""
        if not self.low_passed:
            return ()
        rate = 2.0 * math.pi * self.corner
        return (Branch(rate, self._beta * rate, self._beta * rate),)

    @property
    def step_factor(self):
        """What low-passed stiffness damping leaves of the longest stable step."""
        return (1.0 + sum(one.shear for one in self.branches)) ** -0.5

    def ratio_at(self, frequency):
        """Share of critical damping at a frequency in Hz: theory.md (2.11), (2.18)."""
        omega = 2.0 * math.pi * frequency
        if self.low_passed:
            modulus = relative_modulus(self.branches, frequency)
            return 0.5 * (self.alpha / omega - modulus.imag)
        return 0.5 * (self.alpha / omega + self.beta * omega)
