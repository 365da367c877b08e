"""Attenuation by memory: constant Q, and stiffness damping that costs no time step.

Both are one law of zones, a generalised Maxwell body of three mechanisms.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from scipy.optimize import nnls

from ..errors import InputError

MECHANISMS = 3
FIT_POINTS = 60
INSIDE = np.geomspace(0.5, 1.5, 12)  # first rate over the low end of the band


@dataclass(frozen=True)
class ConstantQ:
    """Quality factors that hold over a band, with the dispersion that belongs to them.

    Parameters
    ----------
    qp, qs : float
        Of P and S waves.
    band : tuple of 2 float, Hz
        Where they hold: within 1 % over one decade, 4 % over two, 5 % below Q 10.
    reference : float or None, Hz
        Where the speeds are those of the material; None: the geometric mean of the band.

    Raises
    ------
    InputError
        If a quality factor is below 2, or the band is none.

    Notes
    -----
    Emmerich & Korn (1987); theory.md (2.14) to (2.17).
    """

    qp: float
    qs: float
    band: tuple[float, float] = (1.0, 100.0)
    reference: float | None = None
    name: ClassVar[str] = "viscoelastic"

    def __post_init__(self):
        """Refuse values that are no quality and no band."""
        for name in ("qp", "qs"):
            if not 2.0 <= getattr(self, name) < np.inf:
                raise InputError(f"material.{name}: must be at least 2, got {getattr(self, name)}")
        low, high = self.band
        if not 0.0 < low < high < np.inf:
            raise InputError(f"material.band: must be two ascending frequencies, got {self.band}")
        if self.reference is not None and not 0.0 < self.reference < np.inf:
            raise InputError(f"material.reference: must be positive, got {self.reference} Hz")

    @cached_property
    def rates(self):
        """Rates of the mechanisms, (3,) 1/s, even in logarithm.

        How far the outer ones stand inside the band, or outside, is chosen for the best fit.
        """
        low, high = self.band
        choices = [
            2.0 * np.pi * np.geomspace(low * inside, high / inside, MECHANISMS) for inside in INSIDE
        ]
        return min(choices, key=self._worst)

    def _worst(self, rates):
        """Return the largest relative error of 1/Q over the band with some rates."""
        frequency = np.geomspace(*self.band, FIT_POINTS)
        moduli = (
            (quality, _relative_modulus(_shares(rates, self.band, quality), rates, frequency))
            for quality in (self.qp, self.qs)
        )
        return max(np.abs(1.0 + quality * m.imag / m.real).max() for quality, m in moduli)

    def shares(self, quality):
        """Return the share of the modulus that each mechanism lets fade, (3,).

        Non-negative least squares of 1/Q over the band: theory.md (2.16).
        """
        return _shares(self.rates, self.band, quality)

    def relative_modulus(self, quality, frequency):
        """Return the complex modulus over the unrelaxed one at frequencies in Hz; (2.15)."""
        return _relative_modulus(self.shares(quality), self.rates, frequency)

    def wave(self, quality, speed, frequency):
        """Return phase speed in m/s and true quality of a wave, speed given at the reference."""
        stiffer = self._unrelaxed(quality)
        modulus = self.relative_modulus(quality, frequency)
        return (
            speed * np.sqrt(stiffer) / (1.0 / np.sqrt(modulus)).real,
            -modulus.real / modulus.imag,
        )

    def _unrelaxed(self, quality):
        """Return the unrelaxed modulus over that of the speed at the reference."""
        reference = self.reference or np.sqrt(self.band[0] * self.band[1])
        return float((1.0 / np.sqrt(self.relative_modulus(quality, reference))).real ** 2)

    def moduli(self, material):
        """Return the unrelaxed Lame moduli, Pa."""
        shear = material.shear * self._unrelaxed(self.qs)
        return material.density * material.cp**2 * self._unrelaxed(self.qp) - 2.0 * shear, shear

    def properties(self, material):
        """Return rates and shares for the routine.

        Raises
        ------
        InputError
            If the bulk modulus would gain energy, which Qp far above Qs asks for.
        """
        lame, shear = self.moduli(material)
        p, s = self.shares(self.qp), self.shares(self.qs)
        if ((lame + 2.0 * shear) * p < 4.0 / 3.0 * shear * s * (1.0 - 1e-9)).any():
            limit = 0.75 * (material.cp / material.cs) ** 2 * self.qs
            raise InputError(
                f"material.qp: {self.qp:g} with qs {self.qs:g} makes compression gain energy; "
                f"qp must stay clearly below 0.75 (cp/cs)^2 qs = {limit:.3g}"
            )
        return _properties(self.rates, p, s)


@dataclass(frozen=True)
class MaxwellDamping:
    """Stiffness damping of low-passed motion: one mechanism on top of the springs.

    Parameters
    ----------
    beta : float, s
    corner : float, Hz

    Notes
    -----
    theory.md (2.18).
    """

    beta: float
    corner: float
    name: ClassVar[str] = "viscoelastic"

    @property
    def _stiffer(self):
        """Unrelaxed over relaxed modulus."""
        return 1.0 + self.beta * 2.0 * np.pi * self.corner

    @property
    def step_factor(self):
        """What it leaves of the longest stable step."""
        return self._stiffer**-0.5

    def relative_modulus(self, frequency):
        """Return the complex modulus over that of the material at frequencies in Hz."""
        share = 1.0 / (1.0 - 1j * np.asarray(frequency, dtype=float) / self.corner)
        return self._stiffer - (self._stiffer - 1.0) * share

    def moduli(self, material):
        """Return the unrelaxed Lame moduli, Pa."""
        return material.first_lame * self._stiffer, material.shear * self._stiffer

    def properties(self, material):
        """Return rates and shares for the routine."""
        del material
        share = np.array([1.0 - 1.0 / self._stiffer, 0.0, 0.0])
        return _properties(np.array([2.0 * np.pi * self.corner, 0.0, 0.0]), share, share)


def _shares(rates, band, quality):
    """Fit the shares (3,) of mechanisms of given rates by theory.md (2.16)."""
    omega = 2.0 * np.pi * np.geomspace(*band, FIT_POINTS)[:, None]
    matrix = (rates * omega + rates**2 / quality) / (rates**2 + omega**2)
    return nnls(matrix, np.full(FIT_POINTS, 1.0 / quality))[0]


def _relative_modulus(shares, rates, frequency):
    """Return the complex modulus over the unrelaxed one at frequencies in Hz; (2.15)."""
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[..., None]
    return 1.0 - np.sum(shares * rates / (rates - 1j * omega), axis=-1)


def _properties(rates, p, s):
    """Name rates and shares as the signature of the law does."""
    rows = {"rate": rates, "p": p, "s": s}
    return {f"{name}_{k + 1}": row[k] for name, row in rows.items() for k in range(MECHANISMS)}
