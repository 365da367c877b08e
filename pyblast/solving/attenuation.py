"""Attenuation by memory: springs that relax beside those that stay, and constant Q made of them."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.optimize import nnls

from ..errors import InputError

MECHANISMS = 3
FIT_POINTS = 60
INSIDE = np.geomspace(0.5, 1.5, 12)  # first rate over the low end of the band


class Branch(NamedTuple):
    """Springs that relax, beside those that stay; theory.md (2.14).

    Parameters
    ----------
    rate : float, 1/s
    shear, compression : float
        Stiffness over that of the springs that stay, for S and for P waves.
    """

    rate: float
    shear: float
    compression: float


def relative_modulus(branches, frequency, wave="shear"):
    """Return the complex modulus over the relaxed one at frequencies in Hz; theory.md (2.15)."""
    lag = -2j * np.pi * np.asarray(frequency, dtype=float)
    return 1.0 + sum(getattr(one, wave) * lag / (one.rate + lag) for one in branches)


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
    name: ClassVar[str] = "elastic"

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
            (quality, _fading(_shares(rates, self.band, quality), rates, frequency))
            for quality in (self.qp, self.qs)
        )
        return max(np.abs(1.0 + quality * m.imag / m.real).max() for quality, m in moduli)

    def shares(self, quality):
        """Return the share of the modulus that each mechanism lets fade, (3,).

        Non-negative least squares of 1/Q over the band: theory.md (2.16).
        """
        return _shares(self.rates, self.band, quality)

    def wave(self, quality, speed, frequency):
        """Return phase speed in m/s and true quality of a wave, speed given at the reference."""
        stiffer = self._unrelaxed(quality)
        modulus = _fading(self.shares(quality), self.rates, frequency)
        return (
            speed * np.sqrt(stiffer) / (1.0 / np.sqrt(modulus)).real,
            -modulus.real / modulus.imag,
        )

    def _unrelaxed(self, quality):
        """Return the unrelaxed modulus over that of the speed at the reference."""
        reference = self.reference or np.sqrt(self.band[0] * self.band[1])
        modulus = _fading(self.shares(quality), self.rates, reference)
        return float((1.0 / np.sqrt(modulus)).real ** 2)

    @property
    def branches(self):
        """What relaxes, for the kernel: one `Branch` a mechanism."""
        p, s = (self.shares(quality) for quality in (self.qp, self.qs))
        rows = zip(self.rates, s / (1.0 - s.sum()), p / (1.0 - p.sum()), strict=True)
        return tuple(Branch(*map(float, row)) for row in rows)

    def moduli(self, material):
        """Return the Lame moduli after everything has relaxed, Pa."""
        stays = [1.0 - self.shares(quality).sum() for quality in (self.qp, self.qs)]
        shear = material.shear * self._unrelaxed(self.qs) * stays[1]
        p_wave = material.density * material.cp**2 * self._unrelaxed(self.qp) * stays[0]
        return p_wave - 2.0 * shear, shear

    def properties(self, material):
        """Check that the law suits a material; its routine takes no properties.

        Raises
        ------
        InputError
            If the bulk modulus would gain energy, which Qp far above Qs asks for.
        """
        p, s = self.shares(self.qp), self.shares(self.qs)
        p_wave = material.density * material.cp**2 * self._unrelaxed(self.qp)
        shear = material.shear * self._unrelaxed(self.qs)
        if (p_wave * p < 4.0 / 3.0 * shear * s * (1.0 - 1e-9)).any():
            limit = 0.75 * (material.cp / material.cs) ** 2 * self.qs
            raise InputError(
                f"material.qp: {self.qp:g} with qs {self.qs:g} makes compression gain energy; "
                f"qp must stay clearly below 0.75 (cp/cs)^2 qs = {limit:.3g}"
            )
        return {}


def _shares(rates, band, quality):
    """Fit the shares (3,) of mechanisms of given rates by theory.md (2.16)."""
    omega = 2.0 * np.pi * np.geomspace(*band, FIT_POINTS)[:, None]
    matrix = (rates * omega + rates**2 / quality) / (rates**2 + omega**2)
    return nnls(matrix, np.full(FIT_POINTS, 1.0 / quality))[0]


def _fading(shares, rates, frequency):
    """Return the complex modulus over the unrelaxed one at frequencies in Hz; (2.15)."""
    omega = 2.0 * np.pi * np.asarray(frequency, dtype=float)[..., None]
    return 1.0 - np.sum(shares * rates / (rates - 1j * omega), axis=-1)
