"""Nuisances: columns of motion for small errors of a model and its survey, scattered motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage

from ..config.config import PriorsConfig
from ..errors import InputError
from .parameter import SPEED, STIFFNESS
from .records import Band

# Prior standard deviations: of what the better mesh leaves, over its change; of the spectrum of a
# blast at four cosines over log frequency; of ground between receivers, and frequencies.
UNCORRECTED, SOURCE = 0.3, 0.01
UNEVEN = {SPEED: 0.003, STIFFNESS: 0.05}
GROUND, TRANSFER, HOLES = "ground", "transfer", "holes"  # groups with levels of their own
LAW = "law"
SCATTER = "scatter"
# Of a survey that is designed, in s, rad or shares of the motion: theory.md (7.14), (7.16).
DESIGN_LEVELS = {
    "delay": 1e-3, "gain": 0.05, "receiver": 0.05, "rotation": 0.05, "source": 0.05, "mesh": 1.0,
    SCATTER: 0.1,
}  # fmt: skip
N_MODES = 3
N_TRANSFER, N_LAW = 6, 4


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

    def without(self, group: str) -> "Nuisances":
        """Return the columns of all other groups."""
        others = [n for n, own in enumerate(self.groups) if own != group]
        if len(others) == len(self.groups):
            return self
        return Nuisances(self.columns[others], tuple(self.groups[n] for n in others))


def design_nuisances(simulated, band: Band, mesh_errors, levels: Mapping[str, float]) -> Nuisances:
    """Build the columns of a survey that is designed: delays, gains, rotations, sources, mesh.

    Parameters
    ----------
    simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band
    mesh_errors : sequence of (n_blasts, n_receivers, 3, n_samples) float, m/s
        One for each pair of meshes, and one difference for each mesh seed.
    levels : mapping of str to float
        Standard deviation of each group, see `DESIGN_LEVELS`.

    Returns
    -------
    Nuisances
        Groups ``delay`` (each path, common to the three components), ``gain`` (each
        channel of each blast), ``receiver`` (gain of a receiver in all blasts), ``rotation``
        (of its horizontal components in all blasts), ``source`` (four shapes of the spectrum
        of a blast, from flat to two waves over the logarithm of frequency) and ``mesh`` (each
        error at each receiver).

    Notes
    -----
    theory.md (7.14). Components must be in an order with the vertical one last.
    """
    simulated = np.asarray(simulated, dtype=float)
    n_blasts, n_receivers = simulated.shape[:2]
    moved = band.project(-np.gradient(simulated, band.dt, axis=-1))
    held = band.project(simulated)
    turned = np.stack([held[:, :, 1], -held[:, :, 0], 0.0 * held[:, :, 2]], axis=2)
    spectra = shaped(simulated, band, range(N_MODES + 1))
    errors = [band.project(error) for error in mesh_errors]
    shape = held.shape
    parts = {
        "delay": [_only(moved, path) for path in np.ndindex(shape[:2])],
        "gain": [_only(held, channel) for channel in np.ndindex(shape[:3])],
        "receiver": [_only(held, np.s_[:, r]) for r in range(n_receivers)],
        "rotation": [_only(turned, np.s_[:, r]) for r in range(n_receivers)],
        "source": [_only(part, b) for part in spectra for b in range(n_blasts)],
        "mesh": [_only(error, np.s_[:, r]) for error in errors for r in range(n_receivers)],
    }
    each = {name: [levels[name] * own for own in part] for name, part in parts.items() if part}
    return moving_columns(each, shape)


def _only(motion, index):
    """Return the motion at an index and zero elsewhere."""
    column = np.zeros_like(motion)
    column[index] = motion[index]
    return column


def octave(n: int, n_padded: int, band) -> np.ndarray:
    """Return the place of each frequency in the band, 0 to 1, over the logarithm."""
    frequency = fft.rfftfreq(n_padded, band.dt)
    low = max(band.low, 1.0 / (n * band.dt))
    return np.log(np.clip(frequency, low, band.high) / low) / np.log(band.high / low)


SMOOTHING = 2.0


def scattering(simulated, band: Band, memory: float | None = None) -> np.ndarray:
    """Return the covariance of scattered motion as strong as the simulated motion around it.

    Parameters
    ----------
    simulated : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band
    memory : float, s, optional
        Decay time of the power of scattered motion after that of the simulation: a coda.

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
    level = ndimage.gaussian_filter1d(simulated**2, reach, mode="constant")
    if memory is not None:
        decay = np.exp(-np.arange(n) * band.dt / memory)
        level = fft.irfft(fft.rfft(level, n_padded) * fft.rfft(decay, n_padded), n_padded)[..., :n]
    level = np.sqrt(np.maximum(level, 0.0))
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


def shift_columns(motion, slopes, band: Band, priors: Mapping[str, float]) -> Nuisances:
    """Build the columns of trigger, clocks and places of receivers.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    slopes : (2, n_blasts, n_receivers, 3, n_samples) float, 1/s
        Change of the motion by a move of its receiver to the east and to the north.
    band : Band
    priors : mapping of str to float
        Standard deviations ``trigger`` (of a blast) and ``clock`` (of a receiver) in s,
        ``receiver`` in m.

    Returns
    -------
    Nuisances
        Columns of one prior standard deviation each.
    """
    late = band.project(-np.gradient(np.asarray(motion, dtype=float), band.dt, axis=-1))
    n_blasts, n_receivers = late.shape[:2]
    parts = {
        "trigger": [priors["trigger"] * _only(late, b) for b in range(n_blasts)],
        "clock": [priors["clock"] * _only(late, path) for path in np.ndindex(late.shape[:2])],
        "receiver": [
            priors["receiver"] * _only(held, np.s_[:, r])
            for held in band.project(slopes)
            for r in range(n_receivers)
        ],
    }
    return moving_columns(parts, late.shape)


def moving_columns(parts, shape) -> Nuisances:
    """Return the nuisances of groups of columns of a shape, without those that move nothing.

    Parameters
    ----------
    parts : dict of str to sequence of (n_blasts, n_receivers, 3, n_functions) float64
        Columns by group.
    shape : tuple of int
        Of a column.
    """
    rows = [(group, column) for group, each in parts.items() for column in each]
    rows = [(group, column) for group, column in rows if np.any(column)]
    columns = np.array([column for _, column in rows]).reshape(len(rows), *shape)
    return Nuisances(columns, tuple(group for group, _ in rows))


def discretization_columns(change) -> list[np.ndarray]:
    """Return the columns of what the mesh leaves of its error: everywhere, and by receiver.

    Parameters
    ----------
    change : (n_blasts, n_receivers, 3, n_functions) float64
        One standard deviation, m/s.
    """
    return [change, *(_only(change, np.s_[:, r]) for r in range(change.shape[1]))]


@dataclass(frozen=True, eq=False)
class Firings:
    """Firings of a blast with the travel times to each receiver.

    Parameters
    ----------
    times : (n_holes,) float64, s
        After the first one.
    weights : (n_holes,) float64
        Amplitude of each hole.
    late : (n_receivers, n_holes) float64, s
        Travel time of each hole beyond the mean of all.
    """

    times: np.ndarray
    weights: np.ndarray
    late: np.ndarray


WATER = 1e-3  # of the spectrum of all holes in phase, below which a share is not divided out


def hole_columns(
    motion,
    firings: Sequence[Firings | None],
    band: Band,
    deviation: float,
    known: Mapping[int, np.ndarray] | None = None,
):
    """Build the columns of firing times, and the change of all motion by attenuation.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    firings : sequence of Firings or None
        Of each blast; None where nothing fires hole by hole.
    band : Band
    deviation : float, s
        Prior standard deviation of a firing time.
    known : mapping of int to (n_holes, n_blasts, n_receivers, 3, n_functions) float64, optional
        Columns of blasts of which the motion of each hole is known.

    Returns
    -------
    Nuisances
        One column for each hole of a blast with several.
    (n_blasts, n_receivers, 3, n_functions) float64
        Change of the motion by a unit of 1/Q, counted from the time of each hole.

    Notes
    -----
    theory.md (12.6): without a run, the part of a hole is that of holes which share the path of
    the blast but for its length.
    """
    motion = np.asarray(motion, dtype=float)
    n = motion.shape[-1]
    size = fft.next_fast_len(3 * n, real=True)
    omega = 2.0 * np.pi * fft.rfftfreq(size, band.dt)
    middle = 2.0 * np.pi * np.sqrt(max(band.low, 1.0 / (n * band.dt)) * band.high)
    slow = np.log(np.maximum(omega, 1e-9) / middle)
    loss = -0.5 * omega * (1.0 - 2j / np.pi * slow)
    times = band.dt * np.arange(n)
    lost, columns, known = np.zeros(motion.shape), [], known or {}
    for b, (blast, fired) in enumerate(zip(motion, firings, strict=True)):
        columns += [*known.get(b, ())]
        for start, part in hole_parts(blast, fired, omega, size):
            since = np.maximum(times - start, 0.0)
            lost[b] += since * fft.irfft(part * loss, size, axis=-1)[..., :n]
            if b not in known and fired is not None and len(fired.times) > 1:
                moved = np.zeros(motion.shape)
                moved[b] = fft.irfft(part * (-1j * omega), size, axis=-1)[..., :n]
                columns.append(deviation * band.project(moved))
    lost = band.project(lost)
    return moving_columns({"firing": columns}, lost.shape), lost


def hole_parts(blast, fired: Firings | None, omega, size: int):
    """Yield the firing time and the spectrum of the part of each hole in the motion of a blast.

    Parameters
    ----------
    blast : (n_receivers, 3, n_samples) float, m/s
    fired : Firings or None
        Without any all of the motion is one part from 0 s on.
    omega : (n_omega,) float64, rad/s
        Of a real transform of a length ``size``.
    size : int
    """
    spectrum = fft.rfft(blast, size, axis=-1)
    if fired is None:
        yield 0.0, spectrum
        return
    for start, share in zip(fired.times, _shares(fired, omega), strict=True):
        yield float(start), spectrum * share[:, None]


def _shares(fired, omega):
    """Return the share of each hole in the spectrum at every receiver, (n_holes, n, n_omega)."""
    late = fired.times[:, None] + fired.late.T
    parts = fired.weights[:, None, None] * np.exp(-1j * late[..., None] * omega)
    total = parts.sum(axis=0)
    floor = WATER * np.sum(np.abs(fired.weights)) ** 2
    return parts * np.conj(total) / (np.abs(total) ** 2 + floor)


def shaped(motion, band: Band, modes: Sequence[int], phases=(1.0,)) -> np.ndarray:
    """Return motion with its spectrum times cosines over log frequency, in the band.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band
    modes : sequence of int
        Half waves over the band.
    phases : sequence of complex
        In phase (1) and out of phase (1j).

    Returns
    -------
    (n_modes n_phases, n_blasts, n_receivers, 3, n_functions) float64, m/s
    """
    n = np.shape(motion)[-1]
    n_padded = fft.next_fast_len(2 * n, real=True)
    octaves = octave(n, n_padded, band)
    spectrum = fft.rfft(motion, n_padded, axis=-1)
    return np.array([
        band.project(
            fft.irfft(spectrum * np.cos(np.pi * mode * octaves) * phase, n_padded, axis=-1)[..., :n]
        )
        for mode in modes for phase in phases
    ])  # fmt: skip


def random_slopes(slopes, deviations, band: Band) -> Nuisances:
    """Build columns of ground that each receiver, and each part of the band, sees otherwise.

    Parameters
    ----------
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float
        Derivatives of the motion by properties of the ground.
    deviations : (n,) float
        Prior standard deviation of the difference of each property.
    band : Band

    Returns
    -------
    Nuisances
        Of group ``ground``: a random slope for each receiver, and three over log frequency.
    """
    columns, projected = [], band.project(slopes)
    for slope, held, deviation in zip(slopes, projected, deviations, strict=True):
        columns += [deviation * _only(held, np.s_[:, r]) for r in range(held.shape[1])]
        columns += [*(deviation * shaped(slope, band, (1, 2, 3)))]
    return moving_columns({GROUND: columns}, projected.shape[1:])


def transfer_columns(motion, band: Band, n_modes: int = N_TRANSFER) -> Nuisances:
    """Build the columns of a smooth transfer error of each channel, the same in all blasts.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float, m/s
    band : Band
    n_modes : int
        Cosines over log frequency, each in and out of phase.

    Returns
    -------
    Nuisances
        Of group ``transfer``; together they have the energy of each channel.
    """
    energy = np.sum(band.project(motion) ** 2, axis=(0, 3))
    parts = shaped(motion, band, range(n_modes), (1.0, 1j))
    size = np.sum(parts**2, axis=(1, 4))
    scale = np.sqrt(energy / np.maximum(size, np.finfo(float).tiny) / len(parts))
    columns = [
        _only(part * factor[..., None], np.s_[:, r, c])
        for part, factor in zip(parts, scale, strict=True)
        for r, c in np.ndindex(energy.shape)
    ]
    return moving_columns({TRANSFER: columns}, parts.shape[1:])


def law_columns(change, band: Band, share: float) -> Nuisances:
    """Build the columns of the error of a law: smooth over frequency, the same in all records.

    Parameters
    ----------
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Of the motion, by an effect that follows the law.
    band : Band
    share : float
        Energy of the error over that of the change.

    Returns
    -------
    Nuisances
        Of group ``law``; together they have the energy of the error.
    """
    parts = shaped(change, band, range(N_LAW), (1.0, 1j))
    size = max(np.sum(parts**2), np.finfo(float).tiny)
    parts *= np.sqrt(share * np.sum(band.project(change) ** 2) / size)
    return moving_columns({LAW: list(parts)}, parts.shape[1:])


@dataclass(frozen=True, eq=False)
class Linearised:
    """Prediction around a state: motion, its derivatives, and the error of the mesh.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float64
        Derivatives by properties of the ground.
    kinds : tuple of n str
        See `kind_of_key`.
    moved : (2, n_blasts, n_receivers, 3, n_samples) float64, 1/s
        Change of the motion by a move of its receiver to the east and to the north.
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        By the better mesh, included in the motion.
    """

    motion: np.ndarray
    slopes: np.ndarray
    kinds: tuple[str, ...]
    moved: np.ndarray
    correction: np.ndarray


def nuisances_of(
    around: Linearised,
    firings: Sequence[Firings | None],
    band: Band,
    priors: PriorsConfig,
    by_hole: Mapping[int, np.ndarray] | None = None,
) -> tuple[Nuisances, np.ndarray]:
    """Return the nuisances of a prediction, and its change by attenuation.

    Parameters
    ----------
    around : Linearised
    firings : sequence of Firings or None
        Of each blast; None where nothing fires by hole.
    band : Band
    priors : PriorsConfig
    by_hole : mapping of int to (n_holes, n_blasts, n_receivers, 3, n_functions) float64, optional
        Columns of firing times, as of `hole_columns`.

    Returns
    -------
    Nuisances
        Of what a source sends, what the better mesh leaves, trigger, clocks, places of receivers,
        firing times, ground that differs between receivers and frequencies, and a transfer error
        of each receiver.
    (n_blasts, n_receivers, 3, n_functions) float64
        By a unit of 1/Q.

    Notes
    -----
    theory.md (12.5), (12.6).
    """
    motion = around.motion
    parts = {
        "source": SOURCE * shaped(motion, band, range(4), (1.0, 1j)),
        "mesh": discretization_columns(UNCORRECTED * band.project(around.correction)),
    }
    own = moving_columns(parts, parts["source"].shape[1:])
    seconds = {"trigger": 1e-3 * priors.trigger_ms, "clock": 1e-3 * priors.clock_ms}
    survey = shift_columns(motion, around.moved, band, {**seconds, "receiver": priors.receiver_m})
    holes, lost = hole_columns(motion, firings, band, 1e-3 * priors.firing_ms, by_hole)
    uneven = [n for n, kind in enumerate(around.kinds) if kind in UNEVEN]
    deviations = [UNEVEN[around.kinds[n]] for n in uneven]
    ground = random_slopes(around.slopes[uneven], deviations, band)
    return own + survey + holes + ground + transfer_columns(motion, band), lost
