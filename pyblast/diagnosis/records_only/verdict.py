"""What records alone say of one effect, and how easily chance would have said it."""

from dataclasses import dataclass, field

import numpy as np
from scipy import fft

OUTCOMES = ("NAMED", "CLASS", "UNKNOWN", "NULL")
SURE = 0.05


@dataclass(frozen=True)
class Verdict:
    """Say what was found, where, and how sure.

    Parameters
    ----------
    outcome : str
        Of `OUTCOMES`: "UNKNOWN" is something that is no chance and fits no label, "CLASS" fits
        several that these records can't separate.
    label : str
        Of the effect that was looked for; several, joined by " | ", in a class.
    reason : str
        One sentence.
    target : tuple
        Channels, from 0, or names.
    parameters : dict of str to (value, low, high), SI
        With 90 % intervals.
    window : tuple of 2 float, s, or None
        After the moveout in the parameters.
    band : tuple of 2 float, Hz, or None
    chance : float
        Share of surrogates that show the effect as clearly.
    held_out : tuple of 2 float, or None
        Share of energy (or other score, see the maker) explained without and with the effect, on
        records that it was not fitted to.
    """

    outcome: str
    label: str
    reason: str
    target: tuple = ()
    parameters: dict = field(default_factory=dict)
    window: tuple[float, float] | None = None
    band: tuple[float, float] | None = None
    chance: float = 1.0
    held_out: tuple[float, float] | None = None


def phase_randomised(samples, rng):
    """Return samples (..., n) of the same spectrum whose phases are drawn, each row its own."""
    spectrum = fft.rfft(samples, axis=-1)
    turns = rng.uniform(0.0, 2.0 * np.pi, spectrum.shape)
    turns[..., 0] = 0.0
    return fft.irfft(np.abs(spectrum) * np.exp(1j * turns), samples.shape[-1], axis=-1)


def share_as_large(found, drawn):
    """Return the share of draws, with the finding itself as one, that are as large."""
    return float((1 + np.count_nonzero(np.asarray(drawn) >= found)) / (1 + len(drawn)))


def interval(values, share=0.9):
    """Return median and the ends that hold this share of values."""
    low, middle, high = np.quantile(values, [0.5 - 0.5 * share, 0.5, 0.5 + 0.5 * share])
    return float(middle), float(low), float(high)


def jackknifed(estimates):
    """Return mean and 90 % interval of a value estimated without each part in turn."""
    estimates = np.asarray(estimates, dtype=float)
    n = len(estimates)
    sigma = np.sqrt((n - 1) / n * np.sum((estimates - estimates.mean()) ** 2))
    return tuple(float(estimates.mean() + k * sigma) for k in (0.0, -1.645, 1.645))
