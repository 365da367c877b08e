"""Calibration of uncertain wave speeds and joint stiffnesses, with a correction of mesh error."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, linalg, ndimage

from ..errors import InputError
from ..inference.gauss_newton import LeastSquares, gauss_newton
from ..inference.likelihood import ENERGY_SHARE, EnergyShares, Likelihood, StudentT
from ..inference.parameter import Parameter, set_all
from ..project.project import Project
from ..project.uncertain_ground import factors_of
from ..simulation.simulation import Simulation
from .case import Case, case_of
from .thresholds import WRONG_UNIT
from .trusted_shots import learned

SMOOTHING = 0.1  # of the width of the band, over which the transfer function is averaged
STEP = 0.5  # of each prior's standard deviation, for derivatives
ROUNDS = 4
CONVERGED = 0.2  # of the posterior standard deviations: smaller steps end the calibration


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
    likelihood : Likelihood
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
    likelihood: Likelihood

    @property
    def sigma(self) -> np.ndarray:
        """Prior standard deviation of each value, (n,)."""
        return np.array([parameter.sigma for parameter in self.parameters])

    @property
    def prior_deviation(self) -> np.ndarray:
        """Deviation of each value from its prior mean, in prior standard deviations, (n,)."""
        return self.values / self.sigma


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
    Damped Gauss-Newton with Broyden updates on the misfit of the likelihood and the priors.
    Derivatives are differences at the reference, where the mesh correction is computed, too.
    """
    parameters = factors_of(case.project) if parameters is None else parameters
    sigma = np.array([parameter.sigma for parameter in parameters])

    def project(x):
        return set_all(case.project, parameters, np.exp(sigma * x))

    start, *moved = simulation.motions(
        [project(x) for x in [0.0 * sigma, *STEP * np.eye(len(sigma))]]
    )
    slopes = (np.array(moved).reshape(len(moved), *start.shape) - start) / STEP
    reference = start if finer is None else finer.motion(case.project)
    correction = reference - start
    likelihood = likelihood_of(case, correction)
    _refuse_another_unit(likelihood, reference)
    problem = LeastSquares(
        lambda x: simulation.motion(project(x)) + correction,
        residual=likelihood.residual,
        whiten=lambda change: -likelihood.whiten(change),
        misfit=likelihood.misfit,
        weights=lambda residual: likelihood.weights(likelihood.chi_square(residual)),
        precision=1.0,
    )
    end = gauss_newton(
        problem, 0.0 * sigma, reference, converged=_is_small, rounds=ROUNDS, jacobian=slopes,
        broyden=True,
    )  # fmt: skip
    _, hessian = problem.normal_equations(end.x, end.simulated, end.jacobian)
    each = sigma[:, None, None, None, None]
    return Baseline(
        case, parameters, sigma * end.x, sigma[:, None] * linalg.inv(hessian) * sigma,
        project(end.x), end.simulated, end.jacobian / each, reference, correction, likelihood,
    )  # fmt: skip


def likelihood_of(case: Case, correction=None) -> Likelihood:
    """Return the likelihood of the records of a case.

    Parameters
    ----------
    case : Case
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        Change of the motion by a finer mesh.

    Notes
    -----
    Student's t, with model error as shares of energy. The model error does not follow the shape of
    a simulation, which may lack physics, and does not correlate receivers, so that residuals can
    be permuted between them; theory.md (14.1).
    """
    changes = () if correction is None else (correction,)
    error = EnergyShares() if case.share is None else EnergyShares(case.share)
    return Likelihood(case, error.covariance(case, mesh_changes=changes), StudentT())


def _is_small(step, _, now):
    """Tell whether a step is small beside the posterior standard deviations."""
    return bool(np.max(np.abs(step) / np.sqrt(np.diag(linalg.inv(now.hessian)))) < CONVERGED)


def _refuse_another_unit(likelihood, reference):
    """Refuse records whose unit cannot be m/s, by comparison with the simulated reference."""
    case, loud = likelihood.records, likelihood.noise_share < 0.5
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
        its receivers have the gains and the model error that they show.

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
    """Return a case with the gains and model errors of the receivers of another one.

    Receivers that the other one lacks have those of its median receiver.
    """
    parts = {}
    for key in ("gain", "share"):
        values = dict(zip(teacher.receivers, getattr(teacher, key), strict=True))
        usual = float(np.median(getattr(teacher, key)))
        parts[key] = np.array([values.get(name, usual) for name in case.receivers])
    return replace(case, **parts)
