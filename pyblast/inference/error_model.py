"""Model error: columns for delay, gain, rotation and source, and scattered motion."""

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from ..errors import InputError
from .records import Band

N_MODES = 3


@dataclass(frozen=True, eq=False)
class Nuisances:
    """Nuisance columns: changes of all seismograms by small errors of a model.

    Parameters
    ----------
    columns : (n_columns, n_blasts, n_receivers, 3, n_functions) float64
        In the band, for a unit error: delays in s, rotations in rad, others relative.
    groups : tuple of n_columns str
        Columns of one group have one level, their standard deviation.
    """

    columns: np.ndarray
    groups: tuple[str, ...]

    def __post_init__(self):
        """Check that each column has its group."""
        if len(self.columns) != len(self.groups):
            raise InputError(
                f"nuisances: need a group for each column, got {len(self.groups)} for "
                f"{len(self.columns)}"
            )

    def __add__(self, other):
        """Put the columns of both together."""
        return Nuisances(np.concatenate([self.columns, other.columns]), self.groups + other.groups)


def nuisances(simulated, band: Band) -> Nuisances:
    """Build the columns of a simulation: delays, gains, rotations and source spectra.

    Parameters
    ----------
    simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band

    Returns
    -------
    Nuisances
        Groups ``delay`` (each path, common to the three components), ``gain`` (each
        channel of each blast), ``receiver`` (gain of a receiver in all blasts), ``rotation``
        (of its horizontal components in all blasts) and ``source`` (four shapes of the spectrum
        of a blast, from flat to two waves over the logarithm of frequency).

    Notes
    -----
    theory.md (7.14). Components must be in an order with the vertical one last.
    """
    simulated = np.asarray(simulated, dtype=float)
    n_blasts, n_receivers = simulated.shape[:2]
    rate = np.gradient(simulated, band.dt, axis=-1)
    moved = band.project(-rate)
    held = band.project(simulated)
    turned = np.stack([held[:, :, 1], -held[:, :, 0], 0.0 * held[:, :, 2]], axis=2)
    shaped = band.project(_shaped(simulated, band))
    shape = held.shape
    parts = {
        "delay": [_only(moved, channels) for channels in np.ndindex(shape[:2])],
        "gain": [_only(held, channel) for channel in np.ndindex(shape[:3])],
        "receiver": [_only(held, np.s_[:, r]) for r in range(n_receivers)],
        "rotation": [_only(turned, np.s_[:, r]) for r in range(n_receivers)],
        "source": [_only(part, b) for part in shaped for b in range(n_blasts)],
    }
    columns = [column for each in parts.values() for column in each]
    moving = [np.any(column != 0.0) for column in columns]
    groups = [group for group, each in parts.items() for _ in each]
    return Nuisances(
        np.array(columns)[moving],
        tuple(g for g, moves in zip(groups, moving, strict=True) if moves),
    )


def _only(motion, index):
    """Return the motion at an index and zero elsewhere."""
    column = np.zeros_like(motion)
    column[index] = motion[index]
    return column


def _shaped(simulated, band):
    """Return seismograms with their spectrum weighted by cosines over log frequency."""
    n = simulated.shape[-1]
    n_padded = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(n_padded, band.dt)
    low = max(band.low, 1.0 / (n * band.dt))
    octave = np.log(np.clip(frequency, low, band.high) / low) / np.log(band.high / low)
    spectrum = fft.rfft(simulated, n_padded, axis=-1)
    return np.array(
        [
            fft.irfft(spectrum * np.cos(np.pi * mode * octave), n_padded, axis=-1)[..., :n]
            for mode in range(N_MODES + 1)
        ]
    )


def mesh_error(simulated, other, ratio, order=2.0) -> np.ndarray:
    """Return the error of a mesh from the same motion on another mesh.

    Parameters
    ----------
    simulated, other : (...) float
        On the working mesh and on one whose edges are ``ratio`` times as long.
    ratio : float
        Above 1 for a coarser, below 1 for a finer other mesh.
    order : float
        Order of convergence.

    Raises
    ------
    InputError
        If the ratio is 1 or not positive.

    Notes
    -----
    Richardson: ``(s - s_other) / (1 - ratio^order)``, theory.md (7.15).
    """
    if not ratio > 0.0 or ratio == 1.0:
        raise InputError(f"mesh_error.ratio: must be positive and not 1, got {ratio:g}")
    return (np.asarray(simulated) - np.asarray(other)) / (1.0 - ratio**order)


def mesh_columns(errors, band: Band) -> Nuisances:
    """Build one column of group ``mesh`` from each error (n, n_blasts, n_receivers, 3, n_samples).

    One error for each pair of meshes, and one difference for each mesh seed.
    """
    columns = band.project(errors)
    return Nuisances(columns, ("mesh",) * len(columns))


SMOOTHING = 2.0


def scattering(simulated, band: Band) -> np.ndarray:
    """Return the covariance of scattered motion as strong as the simulated motion around it.

    Parameters
    ----------
    simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band

    Returns
    -------
    (n_blasts, n_receivers, 3, n_functions, n_functions) float64, (m/s)2
        Between the coefficients of each channel.

    Notes
    -----
    ``D C D`` with D the running rms over a period at the middle of the band (geometric) and C of
    unit diagonal with the smoothed spectrum of the simulation; theory.md (7.16).
    """
    simulated = np.asarray(simulated, dtype=float)
    n = simulated.shape[-1]
    n_padded = fft.next_fast_len(2 * n, real=True)
    frequency = fft.rfftfreq(n_padded, band.dt)
    inside = np.flatnonzero((frequency >= band.low) & (frequency <= band.high))
    middle = np.sqrt(max(band.low, 1.0 / (n * band.dt)) * band.high)
    reach = 0.5 / (middle * band.dt)
    level = np.sqrt(np.maximum(ndimage.gaussian_filter1d(simulated**2, reach, mode="constant"), 0))
    power = np.abs(fft.rfft(simulated, n_padded, axis=-1)[..., inside]) ** 2
    width = SMOOTHING / (n * band.dt) / (frequency[1] - frequency[0])
    power = ndimage.gaussian_filter1d(power, width, mode="nearest")
    total = np.sum(power, axis=-1, keepdims=True)
    power = np.divide(power, total, out=np.zeros_like(power), where=total > 0.0)
    blocks = np.empty((*simulated.shape[:3], band.n_functions, band.n_functions))
    for channel in np.ndindex(simulated.shape[:3]):
        functions = level[channel][:, None] * band.functions(channel)
        waves = fft.rfft(functions, n_padded, axis=0)[inside]
        blocks[channel] = np.real((waves.conj() * power[channel][:, None]).T @ waves)
    return blocks
