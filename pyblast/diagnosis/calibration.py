"""Calibration of uncertain wave speeds and joint stiffnesses, with a correction of mesh error."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, ndimage

from ..errors import InputError
from ..inference.error_model import Posterior
from ..inference.fit import Coordinates, FitState, minimise
from ..inference.parameter import Parameter, set_all
from ..project.project import Project
from ..project.uncertain_ground import factors_of
from ..simulation.simulation import Simulation
from .case import Case, case_of
from .error import gained, learned_error, noise_energy, usual_energy
from .thresholds import ENERGY_SHARE, WRONG_UNIT
from .trusted_shots import learned

SMOOTHING = 0.1  # of the width of the band, over which the transfer function is averaged
STEP = 0.5  # of each prior's standard deviation, for derivatives
LONGEST = 1.5  # prior standard deviations that a value may go in one round


def attenuated(correction, before, after, dt: float, band) -> np.ndarray:
    """Attenuate a mesh correction as much as the motion that it belongs to; (14.6).

    Parameters
    ----------
    correction : (n_receivers, 3, n_samples) float64, m/s
        Correction of the motion ``before``.
    before, after : (n_receivers, 3, n_samples) float64, m/s
        Motion on one mesh, without and with attenuation.
    dt : float, s
    band : tuple of 2 float, Hz

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s

    Notes
    -----
    Mesh errors are phase errors that grow along the path, so that they attenuate as the motion
    does. The transfer function between the two motions is estimated by least squares over
    neighbouring frequencies and the three components of a receiver; its modulus is at most one.
    """
    n = correction.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    first, last, own = (fft.rfft(motion, size) for motion in (before, after, correction))
    width = SMOOTHING * (band[1] - band[0]) * size * dt
    across = _smooth(np.sum(last * np.conj(first), axis=1), width)
    power = _smooth(np.sum(np.abs(first) ** 2, axis=1), width)
    transfer = np.divide(across, power, out=np.zeros_like(across), where=power > 0.0)
    transfer /= np.maximum(np.abs(transfer), 1.0)
    return fft.irfft(own * transfer[:, None], size)[..., :n]


def _smooth(spectrum, width):
    """Return a spectrum (n_receivers, n) averaged over a number of frequencies."""
    return ndimage.gaussian_filter1d(spectrum, width, axis=-1)


@dataclass(frozen=True, eq=False)
class Baseline:
    """Baseline: the calibrated project, its motion and its derivatives.

    Parameters
    ----------
    case : Case
    parameters : tuple of n Parameter
    values : (n,) float64
        Logarithms of factors on the values of the reference.
    covariance : (n, n) float64
        Posterior covariance of the values.
    project : Project
        Project with these values.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Simulated motion, ``correction`` included.
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        Derivatives of the motion by the values.
    reference : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Motion of the reference (zero values), on the finer mesh if there is one.
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Motion of the reference on the finer mesh less that on the mesh of the runs.
    usual : (n_blasts, n_receivers) float64, (m/s)2
        Energy of each record that usual errors leave; see `usual_energy`.
    """

    case: Case
    parameters: tuple[Parameter, ...]
    values: np.ndarray
    covariance: np.ndarray
    project: Project
    motion: np.ndarray
    slopes: np.ndarray
    reference: np.ndarray
    correction: np.ndarray
    usual: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """Prior standard deviation of each value, (n,)."""
        return np.array([parameter.sigma for parameter in self.parameters])

    @property
    def prior_deviation(self) -> np.ndarray:
        """Deviation of each value from its prior mean, in prior standard deviations, (n,)."""
        return self.values / self.sigma

    def chi_square(self, motion) -> np.ndarray:
        """Return the energy that a motion leaves of each record over the usual one.

        (n_blasts, n_receivers) float64; zero without a record.
        """
        return self.over_usual(self.case.residual(motion))

    def over_usual(self, change) -> np.ndarray:
        """Return the energy of a change of motion over that which usual errors leave."""
        energy = np.sum(self.case.band.project(self.case.valid * change) ** 2, axis=(-2, -1))
        return np.divide(energy, self.usual, out=np.zeros_like(energy), where=self.usual > 0.0)


def calibrate(
    case: Case,
    simulation: Simulation,
    finer: Simulation | None = None,
    parameters: tuple[Parameter, ...] | None = None,
) -> Baseline:
    """Fit wave speeds and joint stiffness to the records of a case.

    Parameters
    ----------
    case : Case
    simulation : Simulation
    finer : Simulation, optional
        That on a finer mesh; it runs the reference alone.
    parameters : tuple of Parameter, optional
        Factors that are fitted; by default `factors_of` the project.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        If the records are a hundred times larger or smaller than the simulated reference.
    SolverError
        If a run fails.

    Notes
    -----
    By `minimise`, under an error that is learned. Derivatives are differences at the reference,
    where the mesh correction is computed, too.
    """
    parameters = factors_of(case.project) if parameters is None else parameters
    problem = _Calibration(case, simulation, parameters)
    start = problem.begun()
    reference = start.motion if finer is None else finer.motion(case.project)
    problem.correction = correction = reference - start.motion
    _refuse_another_unit(case, reference, usual_energy(case))
    start.motion = reference
    posterior = minimise(problem, start)
    sigma, each = problem.sigma, problem.sigma[:, None, None, None, None]
    return Baseline(
        case, parameters, sigma * start.x, sigma[:, None] * posterior.covariance * sigma,
        problem.project(start.x), start.motion, start.slopes / each, reference, correction,
        usual_energy(case, correction),
    )  # fmt: skip


class _Calibration:
    """Calibration, a problem of `minimise`: values in standard deviations of their priors."""

    renews = False

    def __init__(self, case, simulation, parameters):
        self.case, self.simulation, self.parameters = case, simulation, parameters
        self.sigma = np.array([parameter.sigma for parameter in parameters])
        self.correction, n = np.zeros(case.motion.shape), len(parameters)
        far, every = np.full(n, np.inf), np.ones(n, dtype=bool)
        self.coordinates = Coordinates(
            np.zeros(n), np.ones(n), -far, far, np.full(n, LONGEST), every, every, np.zeros(n)
        )

    def project(self, x):
        """Return the project at values."""
        return set_all(self.case.project, self.parameters, np.exp(self.sigma * x))

    def begun(self):
        """Return the state of the reference, with derivatives by differences."""
        x = np.zeros(len(self.sigma))
        points = [x, *(STEP * np.eye(len(x)))]
        start, *moved = self.simulation.motions([self.project(at) for at in points])
        return FitState(x, start, (np.array(moved).reshape(len(x), *start.shape) - start) / STEP)

    def derive(self, state):
        """Keep the derivatives, which each step updates: new ones cost as much as all steps."""

    def simulated(self, x):
        """Return the motion at values."""
        return self.simulation.motion(self.project(x)) + self.correction

    def posterior(self, state: FitState) -> Posterior:
        """Return the posterior of the values; where receivers stand is taken as known."""
        case, band = self.case, self.case.band
        slopes = state.slopes / self.sigma[:, None, None, None, None]
        still = np.zeros((2, *state.motion.shape))
        self.error = learned_error(
            case, self.parameters, (state.motion, slopes, still, self.correction)
        )
        rows = band.project(state.slopes)
        residual = band.project(case.residual(state.motion)) + np.tensordot(state.x, rows, 1)
        return self.error.posterior(residual, rows, np.ones(len(rows)))

    def worsened(self, before: FitState, after: FitState) -> bool:
        """Tell whether a state is less probable than the one before, priors included."""
        return gained(self.error, self.case, before, after) < 0.0

    def reached(self, state, posterior):
        """Keep nothing of a state on the way."""

    def ended(self, reason):
        """Keep the state where no step explains more."""


def _refuse_another_unit(case, reference, usual):
    """Refuse records whose unit cannot be m/s, by comparison with the simulated reference."""
    loud = noise_energy(case) < 0.5 * usual
    if case.gain is not None or case.project.config.diagnosis.source_s is not None:
        return  # their level says nothing
    recorded, simulated = (
        np.linalg.norm(case.band.project(motion), axis=(2, 3))
        for motion in (case.motion, reference)
    )
    usable = loud & (recorded > 0.0) & (simulated > 0.0)
    ratio = np.median(recorded[usable] / simulated[usable]) if np.any(usable) else 1.0
    if not 1.0 / WRONG_UNIT < ratio < WRONG_UNIT:
        raise InputError(
            f"records: the median ratio of recorded to simulated motion is {ratio:.2g}; give "
            "records in m/s (in mm/s they are 1000 times as large), or correct source and charges"
        )


def taught(everything: Case, simulated: Callable[[Case], Simulation]) -> Case:
    """Return the case of the shots in question, with what the trusted shots tell.

    Parameters
    ----------
    everything : Case
        Of all shots; ``diagnosis.trusted`` and ``diagnosis.held_out`` of its project name theirs.
    simulated : callable
        ``(case) -> Simulation``.

    Returns
    -------
    Case
        Without trusted and held-out shots. With trusted shots: its ground is calibrated to them,
        its receivers have the gains, clocks and model error that they show.

    Raises
    ------
    InputError
        If no shot is left, or a name is not that of a shot.
    SolverError
        If a run fails.
    """
    project = everything.project
    table = project.config.diagnosis
    if table is None or not (table.trusted or table.held_out):
        return everything
    for name in (*table.trusted, *table.held_out):
        if name not in everything.blasts:
            raise InputError(
                f"{project.path.name}: diagnosis: no blast {name!r}; there are "
                f"{', '.join(everything.blasts)}"
            )
    names = [n for n in everything.blasts if n not in (*table.trusted, *table.held_out)]
    if not names:
        raise InputError(f"{project.path.name}: diagnosis: no blast is left that is not trusted or "
                         "held out")  # fmt: skip
    if not table.trusted:
        return case_of(project, names)
    teacher = case_of(project, table.trusted)
    motion = simulated(teacher).motion(project)
    if table.calibrate:
        pupil = learned(teacher, motion, ENERGY_SHARE)
        project = calibrate(pupil, simulated(pupil)).project
        motion = simulated(teacher).motion(project)
    return like_taught(case_of(project, names), learned(teacher, motion, ENERGY_SHARE))


def like_taught(case: Case, teacher: Case) -> Case:
    """Return a case with gains, clocks and model errors of the receivers of another one.

    Receivers that the other one lacks have those of its median receiver.
    """
    parts = {}
    for key in ("gain", "share") if teacher.clock is None else ("gain", "share", "clock"):
        values = dict(zip(teacher.receivers, getattr(teacher, key), strict=True))
        usual = float(np.median(getattr(teacher, key)))
        parts[key] = np.array([values.get(name, usual) for name in case.receivers])
    return replace(case, **parts)
