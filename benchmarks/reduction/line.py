"""The line of complex frequencies on which reduced models are solved, and the way back to time."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import fft

REST = 0.15  # of the duration, added so that what the sources hold can fade out
WRAPPED = 1e-4  # what the end of a period leaves at its beginning
TAPER = 1.25  # highest frequency solved over that of the motion


@dataclass(frozen=True, eq=False)
class Line:
    """Complex frequencies z on a circle, and the steps of the whole scheme as functions of z.

    Parameters
    ----------
    dt : float, s
    highest : float, Hz
    n_steps, n_period : int
        Of a seismogram and of the period after which everything repeats, damped.
    z : (n,) complex128
    weight : (n,) float64
        1 within the band, falling to 0 above.

    Notes
    -----
    theory.md (10.4) to (10.6).
    """

    dt: float
    highest: float
    n_steps: int
    n_period: int
    z: np.ndarray
    weight: np.ndarray

    @property
    def decay(self):
        """What each step damps on the circle."""
        return math.log(1.0 / WRAPPED) / self.n_period

    @property
    def rate(self):
        """Complex angular frequency of the differential equation, (n,) 1/s."""
        return np.log(self.z) / self.dt

    @property
    def mass(self):
        """What acceleration becomes, (n,) 1/s2."""
        return (self.z - 2.0 + 1.0 / self.z) / self.dt**2

    @property
    def mean_rate(self):
        """What a rate at the mean velocity becomes, (n,) 1/s."""
        return (self.z - 1.0 / self.z) / (2.0 * self.dt)

    @property
    def lagged_rate(self):
        """What a rate half a step ago becomes, (n,) 1/s."""
        return (1.0 - 1.0 / self.z) / self.dt

    def relaxing(self, rate):
        """Return what is left of a strain in springs that relax at a rate in 1/s, (n,)."""
        x = 0.5 * rate * self.dt
        return 1.0 - x * (1.0 + 1.0 / self.z) / (1.0 + x - (1.0 - x) / self.z)

    def velocity(self, displacement):
        """Return velocities in the middle of the steps for displacements, (n, ...) both."""
        shape = (-1,) + (1,) * (displacement.ndim - 1)
        return ((self.z - 1.0) / self.dt).reshape(shape) * displacement

    def energy(self, values):
        """Return the sum over the line of squares of values (n, m) within the band, (m,)."""
        return np.sum((self.weight[:, None] * np.abs(values)) ** 2, axis=0)

    def transform(self, histories):
        """Return histories (n_steps, m) at all frequencies (n_period / 2 + 1, m).

        Beyond their end they are held and faded out.
        """
        fade = 0.5 + 0.5 * np.cos(np.pi * np.linspace(0.0, 1.0, self.n_period - self.n_steps))
        whole = np.concatenate([histories, fade[:, None] * histories[-1]])
        damped = np.exp(-self.decay * np.arange(self.n_period))[:, None] * whole
        return fft.rfft(damped, axis=0)

    def back(self, values, count=None):
        """Return what ``values`` (n, ...) on the line are in time, up to the last step.

        ``count`` samples to a period instead of one a step.
        """
        count = count or self.n_period
        shape = (-1,) + (1,) * (values.ndim - 1)
        motion = fft.irfft(self.weight.reshape(shape) * values, count, axis=0)
        every = self.n_period / count
        motion = motion[: math.ceil(self.n_steps / every)] / every
        return np.exp(self.decay * every * np.arange(len(motion))).reshape(shape) * motion


def line(dt, n_steps, highest):
    """Lay out the line for seismograms of some steps whose motion ends at a frequency in Hz."""
    n_period = fft.next_fast_len(math.ceil((1.0 + REST) * n_steps), real=True)
    n_period += n_period % 2
    count = min(n_period // 2, math.ceil(TAPER * highest * n_period * dt)) + 1
    circle = 2j * np.pi * np.arange(count) / n_period + math.log(1.0 / WRAPPED) / n_period
    hertz = np.arange(count) / (n_period * dt)
    fall = np.clip((hertz / highest - 1.0) / (TAPER - 1.0), 0.0, 1.0)
    weight = 0.5 + 0.5 * np.cos(np.pi * fall)
    return Line(dt, highest, n_steps, n_period, np.exp(circle), weight)
