"""Materials: elastic moduli, damping, constant Q, Mohr-Coulomb strength."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..core import ZONE_LAWS
from ..errors import InputError
from ..units import check_density, check_modulus, check_speed, check_tangent

MECHANISMS = 5  # relaxation mechanisms of a constant Q
USUAL = 30.0  # quality for which the outer rates are chosen
ROUNDED = 1e-3  # by which Qp may exceed that of an infinite bulk Q: published values are rounded
FIT_POINTS = 60  # frequencies of its fit
INSIDE = np.geomspace(0.2, 1.5, 24)  # first relaxation rate over the low end of the band


class Branch(NamedTuple):
    """Relaxation mechanism: relaxing springs parallel to the elastic ones; theory.md (2.14).

    Parameters
    ----------
    rate : float, 1/s
    shear, compression : float
        Stiffness over the relaxed stiffness, for S and for P waves.
    """

    rate: float
    shear: float
    compression: float


class ZoneLaw(Protocol):
    """Constitutive law of zones.

    ``name`` is a key of ``pyblast.core.ZONE_LAWS``, ``branches`` are the relaxation mechanisms,
    ``properties`` returns those of the routine and ``moduli`` the relaxed Lame moduli in Pa.
    """

    name: ClassVar[str]

    @property
    def branches(self) -> tuple[Branch, ...]: ...  # noqa: D102
    def properties(self, material: "Material") -> dict[str, float]: ...  # noqa: D102
    def moduli(self, material: "Material") -> tuple[float, float]: ...  # noqa: D102


def relative_modulus(
    branches: Iterable[Branch], frequency: ArrayLike, wave: str = "shear"
) -> np.ndarray:
    """Return the complex over the relaxed modulus at frequencies in Hz; theory.md (2.15)."""
    lag = -2j * np.pi * np.asarray(frequency, dtype=float)
    relaxing = [getattr(branch, wave) * lag / (branch.rate + lag) for branch in branches]
    return np.asarray(1.0 + sum(relaxing))


BEYOND_BAND = 3.0  # factor by which the band of constant Q exceeds that of records, both ways


@dataclass(frozen=True)
class ConstantQ:
    """Frequency-independent attenuation: quality factors constant over a band, with dispersion.

    Parameters
    ----------
    qp, qs : float
        Quality factors of P and S waves, at least 2.
    band : tuple of 2 float, Hz
        Band of constant Q: after ten wavelengths motion is within 1 % over two decades.
    reference : float or None, Hz
        Frequency at which the speeds are those of the material; None: geometric mean of the band.
    compression : tuple of float, optional
        Shares of P waves in place of the fitted ones: see `within`.

    Raises
    ------
    InputError
        If a quality factor is below 2, or the band is not ascending.

    Notes
    -----
    Generalised Maxwell body of five mechanisms: Emmerich & Korn (1987); theory.md (2.14)
    to (2.17). Speeds follow Q, as they do where it is constant: Kjartansson (1979).

    Examples
    --------
    >>> rock = Material.from_speeds(2700.0, 5000.0, 3000.0, law=ConstantQ(100.0, 50.0, (2.0, 80.0)))
    >>> rock.law.name
    'elastic'
    """

    qp: float
    qs: float
    band: tuple[float, float] = (1.0, 100.0)
    reference: float | None = None
    compression: tuple[float, ...] = ()
    name: ClassVar[str] = "elastic"

    def __post_init__(self) -> None:
        """Check quality factors and band."""
        for name in ("qp", "qs"):
            if not 2.0 <= getattr(self, name) < np.inf:
                raise InputError(f"material.{name}: must be at least 2, got {getattr(self, name)}")
        low, high = self.band
        if not 0.0 < low < high < np.inf:
            raise InputError(f"material.band: must be two ascending frequencies, got {self.band}")
        if self.reference is not None and not 0.0 < self.reference < np.inf:
            raise InputError(f"material.reference: must be positive, got {self.reference} Hz")

    @classmethod
    def around(cls, qp: float, qs: float, band: tuple[float, float]) -> "ConstantQ":
        """Return factors that are constant from a third to three times a band of records in Hz."""
        return cls(qp, qs, (band[0] / BEYOND_BAND, band[1] * BEYOND_BAND))

    @property
    def rates(self) -> np.ndarray:
        """Relaxation rates of the mechanisms, (5,) 1/s, log-spaced; alike for all qualities."""
        return _rates(self.band)

    def slowness_error(self, quality: float, frequency: ArrayLike) -> np.ndarray:
        """Return the complex slowness over that of a constant Q at the reference, less 1.

        After n wavelengths motion is off by ``exp(2 pi i n e) - 1``.
        """
        at = self.reference or float(np.sqrt(self.band[0] * self.band[1]))
        return _slowness_error(self.rates, self.band, quality, frequency, at)

    def shares(self, quality: float) -> np.ndarray:
        """Return the fraction of the modulus that relaxes in each mechanism, (5,).

        Non-negative least squares of the complex modulus over the band: theory.md (2.16).
        """
        return _shares(self.rates, self.band, quality)

    def wave(
        self, quality: float, speed: float, frequency: ArrayLike
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return phase velocity in m/s and quality of a wave with ``speed`` at the reference."""
        stiffer = self._unrelaxed(self.shares(quality))
        modulus = _relative_to_unrelaxed(self.shares(quality), self.rates, frequency)
        return (
            speed * np.sqrt(stiffer) / (1.0 / np.sqrt(modulus)).real,
            -modulus.real / modulus.imag,
        )

    def _unrelaxed(self, shares):
        """Return the unrelaxed modulus over the modulus at the reference frequency."""
        modulus = _relative_to_unrelaxed(shares, self.rates, self._reference)
        return float((1.0 / np.sqrt(modulus)).real ** 2)

    @property
    def _reference(self):
        """Frequency in Hz at which the speeds are those of the material."""
        return self.reference or np.sqrt(self.band[0] * self.band[1])

    def _both(self):
        """Return the shares of P and S waves, (5,) each."""
        p = np.array(self.compression) if self.compression else self.shares(self.qp)
        return p, self.shares(self.qs)

    @property
    def branches(self) -> tuple[Branch, ...]:
        """Relaxation mechanisms for the kernel."""
        p, s = self._both()
        rows = zip(self.rates, s / (1.0 - s.sum()), p / (1.0 - p.sum()), strict=True)
        return tuple(Branch(*map(float, row)) for row in rows)

    def moduli(self, material: "Material") -> tuple[float, float]:
        """Return the relaxed Lame moduli, Pa."""
        p, s = self._both()
        shear = material.shear * self._unrelaxed(s) * (1.0 - s.sum())
        p_wave = material.density * material.cp**2 * self._unrelaxed(p) * (1.0 - p.sum())
        return p_wave - 2.0 * shear, shear

    def properties(self, material: "Material") -> dict[str, float]:
        """Check the law for a material; its routine has no properties.

        Raises
        ------
        InputError
            If Qp is so large compared with Qs that compression would gain energy.
        """
        ratio = 0.75 * (material.cp / material.cs) ** 2
        if self.qp > (1.0 + ROUNDED) * ratio * self.qs and not self._loses(material):
            qp, qs = (
                step * towards(value / step)
                for value, towards in ((ratio * self.qs, math.floor), (self.qp / ratio, math.ceil))
                for step in [10.0 ** (math.floor(math.log10(value)) - 2)]
            )
            raise InputError(
                f"material.qp: {self.qp:g} with qs {self.qs:g} makes compression gain energy; "
                f"qp must not exceed 0.75 (cp/cs)^2 qs = {ratio * self.qs:.4g}: give "
                f"qp {qp:.3g} with qs {self.qs:.3g} or qp {self.qp:.3g} with qs {qs:.3g}"
            )
        return {}

    def within(self, material: "Material") -> "ConstantQ":
        """Return the law with which compression of a material gains energy in no mechanism.

        Where Qp nears ``0.75 (cp/cs)^2 Qs``, at which bulk Q is infinite, mechanisms that are
        fitted to P and to S waves by themselves differ in sign by some per cent of either: P waves
        are then fitted with what shear alone loses as the least of each share.
        """
        plain = replace(self, compression=())
        limit = (1.0 + ROUNDED) * 0.75 * (material.cp / material.cs) ** 2 * self.qs
        if plain._loses(material) or self.qp > limit:
            return plain
        ratio = self._reference / np.sqrt(self.band[0] * self.band[1])
        lost = plain._lost_by_shear(material)
        least = lost / (1.0 / np.sqrt(_constant(self.qp, ratio))).real ** 2
        while True:
            shares = _shares(self.rates, self.band, self.qp, least)
            law = replace(plain, compression=tuple(map(float, shares)))
            if law._loses(material):
                return law
            held = law._unrelaxed(shares) * shares
            short = float((lost[lost > 0.0] / held[lost > 0.0]).max())
            least *= 1.0 + 1.01 * (short - 1.0)

    def _lost_by_shear(self, material):
        """Return what relaxes in P waves by shear alone, (5,), over their modulus."""
        s = self.shares(self.qs)
        return 4.0 / 3.0 * (material.cs / material.cp) ** 2 * self._unrelaxed(s) * s

    def _loses(self, material):
        """Tell whether compression of a material loses energy in every mechanism."""
        p, s = self._both()
        p_wave = material.density * material.cp**2 * self._unrelaxed(p)
        shear = material.shear * self._unrelaxed(s)
        return not (p_wave * p < 4.0 / 3.0 * shear * s * (1.0 - 1e-9)).any()


def _shares(rates, band, quality, least=0.0):
    """Return the fitted fractions (n,) of mechanisms with given rates; theory.md (2.16).

    ``least`` (n,): of what relaxes in each, over the modulus at the mean frequency of the band.
    """
    frequency = np.geomspace(band[0], band[1], FIT_POINTS)
    omega = 2.0 * np.pi * frequency[:, None]
    ideal = _constant(quality, frequency / np.sqrt(band[0] * band[1]))
    matrix = np.hstack([np.ones_like(omega), -rates / (rates - 1j * omega)]) / ideal[:, None]
    matrix = np.vstack([matrix.real, matrix.imag])
    wanted = np.repeat([1.0, 0.0], FIT_POINTS) - (matrix[:, 1:] * least).sum(axis=1)
    fitted = scipy.optimize.nnls(matrix, wanted)[0]
    return (fitted[1:] + least) / fitted[0]


@lru_cache(maxsize=64)
def _rates(band):
    """Return the rates (5,) in 1/s with which motion is best after each wavelength in a band."""
    frequency, at = np.geomspace(*band, FIT_POINTS), np.sqrt(band[0] * band[1])

    def worst(rates):
        return np.abs(_slowness_error(rates, band, USUAL, frequency, at)).max()

    low, high = band
    choices = (np.geomspace(low * inside, high / inside, MECHANISMS) for inside in INSIDE)
    return min((2.0 * np.pi * rates for rates in choices), key=worst)


def _slowness_error(rates, band, quality, frequency, reference):
    """Return the complex slowness of fitted rates over that of a constant Q, less 1."""
    shares = _shares(rates, band, quality)
    modulus = _relative_to_unrelaxed(shares, rates, frequency)
    ideal = _constant(quality, np.asarray(frequency, dtype=float) / reference)
    scale = (1.0 / np.sqrt(_relative_to_unrelaxed(shares, rates, reference))).real
    scale /= (1.0 / np.sqrt(_constant(quality, 1.0))).real
    return np.sqrt(ideal / modulus) / scale - 1.0


def _constant(quality, ratio):
    """Return the modulus of a constant Q at a frequency over that of the reference, (n,)."""
    return (-1j * np.asarray(ratio, dtype=float)) ** (2.0 * np.arctan(1.0 / quality) / np.pi)


def _relative_to_unrelaxed(shares, rates, frequency):
    """Return the complex modulus over the unrelaxed modulus at frequencies in Hz; (2.15)."""
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[..., None]
    return 1.0 - np.sum(shares * rates / (rates - 1j * omega), axis=-1)


@dataclass(frozen=True)
class MohrCoulomb:
    """Mohr-Coulomb plasticity with tension cut-off, hardening or softening.

    Peak cohesion, friction and tension are those of the material.

    Parameters
    ----------
    dilation : float
        Tangent of the dilation angle; at most the friction.
    cohesion_residual, tension_residual : float or None, Pa
    friction_residual, dilation_residual : float or None
        Tangents. Each is the peak value where not given.
    shear_strain : float
        Plastic shear strain (maximum engineering shear) over which cohesion, friction and dilation
        fall to their residual values; 0: at once.
    tensile_strain : float
        Plastic tensile strain over which the tensile strength falls.

    Raises
    ------
    InputError
        If a value is negative, not finite, or an angle in degrees.

    Notes
    -----
    theory.md (2.25) to (2.31). Softening depends on the mesh: failure localises in a band one patch
    of zones wide, so the strains must be chosen for the mesh.
    """

    dilation: float = 0.0
    cohesion_residual: float | None = None
    friction_residual: float | None = None
    dilation_residual: float | None = None
    tension_residual: float | None = None
    shear_strain: float = 0.0
    tensile_strain: float = 0.0
    name: ClassVar[str] = "mohr-coulomb"
    branches = ()  # no relaxation

    def __post_init__(self) -> None:
        """Check the strengths."""
        ZONE_LAWS[self.name].check("material", vars(self))

    def moduli(self, material: "Material") -> tuple[float, float]:
        """Return the elastic Lame moduli, Pa."""
        return material.first_lame, material.shear

    def properties(self, material: "Material") -> dict[str, float]:
        """Return peak and residual strengths for the routine.

        Raises
        ------
        InputError
            If the material has no finite cohesion, or the dilation exceeds the friction.
        """
        if not math.isfinite(material.cohesion):
            raise InputError("material.cohesion: missing; a Mohr-Coulomb material needs it")
        peak = {"cohesion": material.cohesion, "friction": material.friction}
        given = {**vars(self), **peak, "tension": self._tension(material)}
        return ZONE_LAWS[self.name].complete("material", given)

    def _tension(self, material):
        """Return the tensile strength, limited by the apex of the cone; large without friction."""
        tip = (
            material.cohesion / material.friction
            if material.friction > 0.0
            else 1e6 * (material.cohesion + material.bulk)
        )
        return min(material.tension, tip)


@dataclass(frozen=True)
class Elastic:
    """Isotropic linear elasticity; theory.md (2.2)."""

    name: ClassVar[str] = "elastic"
    branches = ()  # no relaxation

    def properties(self, material: "Material") -> dict[str, float]:
        """Return the properties of the routine for a material."""
        del material
        return {}

    def moduli(self, material: "Material") -> tuple[float, float]:
        """Return first Lame modulus and shear modulus, Pa."""
        return material.first_lame, material.shear


@dataclass(frozen=True)
class Material:
    """Material: isotropic elastic moduli, density, strength and constitutive law.

    Parameters
    ----------
    density : float, kg/m3
    bulk, shear : float, Pa
    cohesion, tension : float, Pa
        Strength, of plastic laws and for the checks.
    friction : float
        Tangent of the friction angle.
    law : zone law, optional
        Constitutive law: `Elastic`, `ConstantQ`, `MohrCoulomb`, or that of `anisotropic`.

    Raises
    ------
    InputError
        If density or a modulus is not positive or not in SI, or a strength is negative.

    Examples
    --------
    >>> rock = Material.from_speeds(2700.0, cp=5000.0, cs=3000.0)
    >>> round(rock.young / 1e9, 1), round(rock.poisson, 3)
    (59.2, 0.219)
    """

    density: float
    bulk: float
    shear: float
    cohesion: float = math.inf
    friction: float = 0.0
    tension: float = math.inf
    law: ZoneLaw = Elastic()

    def __post_init__(self) -> None:
        """Check the values."""
        for name, unit in (("density", "kg/m3"), ("bulk", "Pa"), ("shear", "Pa")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"material.{name}: must be positive, got {value:g} {unit}")
        check_density("material.density", self.density)
        for name in ("bulk", "shear"):
            check_modulus(f"material.{name}", getattr(self, name))
        check_tangent("material.friction", self.friction)
        if isinstance(self.law, ConstantQ):
            object.__setattr__(self, "law", self.law.within(self))
        for name in ("cohesion", "friction", "tension"):
            if not getattr(self, name) >= 0.0:
                value = getattr(self, name)
                raise InputError(f"material.{name}: must not be negative, got {value}")

    @classmethod
    def from_young_poisson(
        cls, density: float, young: float, poisson: float, **strength: Any
    ) -> "Material":
        """Return a material from Young's modulus in Pa and Poisson's ratio."""
        if not -1.0 < poisson < 0.5:
            raise InputError(f"material.poisson: must lie between -1 and 0.5, got {poisson:g}")
        check_modulus("material.young", young)
        bulk = young / (3.0 * (1.0 - 2.0 * poisson))
        return cls(density, bulk, young / (2.0 * (1.0 + poisson)), **strength)

    @classmethod
    def from_speeds(cls, density: float, cp: float, cs: float, **strength: Any) -> "Material":
        """Return a material from the speeds of P and S waves in m/s."""
        check_density("material.density", density)
        check_speed("material.cs", cs)
        if not cp > math.sqrt(4.0 / 3.0) * cs > 0.0:
            raise InputError(
                f"material: cp must exceed 1.155 cs, got cp {cp:g} m/s and cs {cs:g} m/s"
            )
        shear = density * cs**2
        return cls(density, density * cp**2 - 4.0 / 3.0 * shear, shear, **strength)

    @property
    def yields(self) -> bool:
        """Whether it is elastic until it yields: its law is plastic."""
        return ZONE_LAWS[self.law.name].yields

    @property
    def first_lame(self) -> float:
        """First Lame modulus [Pa]."""
        return self.bulk - 2.0 / 3.0 * self.shear

    @property
    def cp(self) -> float:
        """Speed of P waves [m/s]; theory.md (1.2)."""
        return math.sqrt((self.bulk + 4.0 / 3.0 * self.shear) / self.density)

    @property
    def cs(self) -> float:
        """Speed of S waves [m/s]; theory.md (1.3)."""
        return math.sqrt(self.shear / self.density)

    @property
    def young(self) -> float:
        """Young's modulus [Pa]."""
        return 9.0 * self.bulk * self.shear / (3.0 * self.bulk + self.shear)

    @property
    def poisson(self) -> float:
        """Poisson's ratio."""
        return (3.0 * self.bulk - 2.0 * self.shear) / (2.0 * (3.0 * self.bulk + self.shear))


@dataclass(frozen=True)
class Damping:
    """Rayleigh damping, with its minimum at the central frequency.

    Parameters
    ----------
    ratio : float
        Fraction of critical damping at the central frequency with both parts.
    frequency : float, Hz
    mass, stiffness : bool
        Whether the mass and the stiffness part act.
    corner : float or None, Hz
        Corner of a low-pass on the motion damped by the stiffness part, which then hardly reduces
        the time step; the damping decreases above the corner, theory.md (2.18). Use at least twice
        the highest frequency.

    Notes
    -----
    ``alpha = ratio * omega``, ``beta = ratio / omega``: theory.md (2.10).

    Raises
    ------
    InputError
        If the ratio lies outside 0 to 1, or a frequency is not positive.

    Examples
    --------
    >>> round(Damping(0.02, 10.0).ratio_at(20.0), 3)
    0.025
    """

    ratio: float
    frequency: float
    mass: bool = True
    stiffness: bool = True
    corner: float | None = None

    def __post_init__(self) -> None:
        """Check ratio and frequencies."""
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
    def alpha(self) -> float:
        """Coefficient of the mass part [1/s]."""
        return self.ratio * 2.0 * math.pi * self.frequency if self.mass else 0.0

    @property
    def beta(self) -> float:
        """Coefficient of the stiffness part without low-pass [s]."""
        return self._beta if self.corner is None else 0.0

    @property
    def _beta(self):
        """Coefficient of the stiffness part, low-passed or not [s]."""
        return self.ratio / (2.0 * math.pi * self.frequency) if self.stiffness else 0.0

    @property
    def low_passed(self) -> bool:
        """Whether the stiffness part acts on low-passed motion."""
        return self.corner is not None and self._beta > 0.0

    @property
    def branches(self) -> tuple[Branch, ...]:
        """Relaxation mechanism of low-passed stiffness damping: theory.md (2.18)."""
        if self.corner is None or not self.low_passed:
            return ()
        rate = 2.0 * math.pi * self.corner
        return (Branch(rate, self._beta * rate, self._beta * rate),)

    @property
    def step_factor(self) -> float:
        """Factor of low-passed stiffness damping on the critical time step."""
        return (1.0 + sum(branch.shear for branch in self.branches)) ** -0.5

    def ratio_at(self, frequency: float) -> float:
        """Return the fraction of critical damping at a frequency in Hz; theory.md (2.11)."""
        omega = 2.0 * math.pi * frequency
        if self.low_passed:
            modulus = relative_modulus(self.branches, frequency)
            return 0.5 * (self.alpha / omega - np.imag(modulus).item())
        return 0.5 * (self.alpha / omega + self.beta * omega)
