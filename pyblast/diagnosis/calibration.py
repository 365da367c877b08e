"""Calibration of uncertain speeds and stiffnesses, and the correction for the mesh."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, linalg, ndimage

from ..errors import InputError
from ..inference.gauss_newton import LeastSquares, gauss_newton
from ..inference.likelihood import EnergyShares, Likelihood, StudentT
from ..inference.parameter import Parameter
from ..model.anisotropy import Anisotropic
from ..model.material import Material
from ..project.flat_box import ground_materials
from ..project.project import Project
from .case import Case
from .forward import Forward
from .thresholds import SPEED_SIGMA, STIFFNESS_SIGMA, WRONG_UNIT

SMOOTH = 0.1  # of the width of the band, over which the transfer of energy is averaged


def carried(correction, before, after, dt, band):
    """Return a correction as it is after what damps the motion that it belongs to; (14.6).

    Parameters
    ----------
    correction : (n_receivers, 3, n_samples) float64, m/s
        Of the motion ``before``.
    before, after : (n_receivers, 3, n_samples) float64, m/s
        On one mesh, without and with damping.
    dt : float, s
    band : tuple of 2 float, Hz

    Returns
    -------
    (n_receivers, 3, n_samples) float64, m/s

    Notes
    -----
    A mesh errs by phases that grow along the way, so that its error fades as the motion does. The
    transfer from one motion to the other is that of least squares over neighbouring frequencies
    and the three components of a receiver, and never more than one.
    """
    n = correction.shape[-1]
    size = fft.next_fast_len(2 * n, real=True)
    first, last, own = (fft.rfft(one, size) for one in (before, after, correction))
    width = SMOOTH * (band[1] - band[0]) * size * dt
    across = _smooth(np.sum(last * np.conj(first), axis=1), width)
    power = _smooth(np.sum(np.abs(first) ** 2, axis=1), width)
    transfer = np.divide(across, power, out=np.zeros_like(across), where=power > 0.0)
    transfer /= np.maximum(np.abs(transfer), 1.0)
    return fft.irfft(own * transfer[:, None], size)[..., :n]


def _smooth(spectrum, width):
    """Return a spectrum (n_receivers, n) averaged over so many frequencies."""
    return ndimage.gaussian_filter1d(spectrum, width, axis=-1)


def unknowns_of(project: Project) -> tuple[Parameter, ...]:
    """List what may be calibrated in the ground of a project, as factors: ``rock.cp``, ``J1.kn``.

    Speeds of each material, of an anisotropic one all alike; stiffnesses of each fault, and of the
    joint sets that share an entry together.
    """
    speeds = [
        _factor(name, speed, SPEED_SIGMA)
        for name in ground_materials(project)
        for speed in (("cs",) if _is_anisotropic(project.materials[name]) else ("cp", "cs"))
    ]
    known = {joint.surface: joint.properties for joint in project.joints}
    stiffnesses = [
        _factor(part, key, STIFFNESS_SIGMA)
        for part, surfaces in _joint_parts(project).items()
        for key in ("kn", "ks")
        if key in known[surfaces[0]]
    ]
    return (*speeds, *stiffnesses)


def _is_anisotropic(material):
    """Tell whether a material has a stiffness of directions."""
    return isinstance(material.law, Anisotropic)


def _joint_parts(project):
    """Return the joint surfaces that are calibrated together, by the name of the part."""
    sets = {one.name: one.joint or one.name for one in project.config.mesh.joint_sets}
    single = {joint.surface for joint in project.joints} - sets.keys()
    parts = {}
    for joint in project.joints:
        part = sets.get(joint.surface, joint.surface)
        own = joint.surface in sets and part in single
        parts.setdefault(joint.surface if own else part, []).append(joint.surface)
    return parts


def _factor(part, name, sigma):
    """Return the factor on a value of a material or joint, log-normal around one."""
    return Parameter(f"{part}.{name}", log=True, mean=1.0, sigma=sigma)


def with_values(project: Project, unknowns, values) -> Project:
    """Return a project with factors exp(values) on some values of its ground.

    Raises
    ------
    InputError
        If a material or joint is not there.
    """
    factors = {
        tuple(one.name.rsplit(".", 1)): float(np.exp(value))
        for one, value in zip(unknowns, values, strict=True)
    }
    joints = _joint_parts(project)
    for part, _ in factors:
        if part not in project.materials and part not in joints:
            raise InputError(f"unknowns: no material or joint named {part!r}")
    part_of = {surface: part for part, surfaces in joints.items() for surface in surfaces}
    return project.changed(
        materials={name: _faster(one, factors, name) for name, one in project.materials.items()},
        joints=[_stiffer(joint, factors, part_of[joint.surface]) for joint in project.joints],
    )


def _faster(material, factors, name):
    """Return a material with other speeds and its other values."""
    cp, cs = (factors.get((name, speed), 1.0) for speed in ("cp", "cs"))
    if cp == cs == 1.0:
        return material
    if _is_anisotropic(material):
        return scaled(material, cs)
    moduli = Material.from_speeds(material.density, material.cp * cp, material.cs * cs)
    return replace(material, bulk=moduli.bulk, shear=moduli.shear)


def scaled(material: Material, factor: float) -> Material:
    """Return a material all of whose wave speeds have a factor, of any law."""
    law = material.law
    if isinstance(law, Anisotropic):
        law = Anisotropic(factor**2 * law.stiffness)
    bulk, shear = factor**2 * material.bulk, factor**2 * material.shear
    return replace(material, bulk=bulk, shear=shear, law=law)


def _stiffer(joint, factors, part):
    """Return a joint with other stiffness."""
    changed = {
        key: value * factors.get((part, key), 1.0) for key, value in joint.properties.items()
    }
    return replace(joint, properties=changed)


STEP = 0.5  # of each prior's standard deviation, for derivatives
ROUNDS = 4
SETTLED = 0.2  # of the posterior standard deviations: smaller moves end the calibration


@dataclass(frozen=True, eq=False)
class Baseline:
    """A project that fits the records as well as its uncertain values allow.

    Parameters
    ----------
    case : Case
    unknowns : tuple of n Parameter
    values : (n,) float64
        Logarithms of factors on the values of the reference.
    covariance : (n, n) float64
    project : Project
        With these values.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What it simulates, ``correction`` included.
    slopes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By each value.
    reference : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Simulated with the values of the reference, on the finer mesh if there was one.
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Of the finer mesh over the one of the runs.
    likelihood : Likelihood
    """

    case: Case
    unknowns: tuple[Parameter, ...]
    values: np.ndarray
    covariance: np.ndarray
    project: Project
    motion: np.ndarray
    slopes: np.ndarray
    reference: np.ndarray
    correction: np.ndarray
    likelihood: Likelihood

    @property
    def sigma(self):
        """Standard deviation of each value before the records are seen, (n,)."""
        return np.array([one.sigma for one in self.unknowns])

    @property
    def pull(self):
        """How far each value was drawn from its prior, in standard deviations, (n,)."""
        return self.values / self.sigma


def calibrate(forward: Forward, fine: Forward | None = None) -> Baseline:
    """Fit wave speeds and joint stiffness to the records of a case.

    Parameters
    ----------
    forward : Forward
        Whose runs are many.
    fine : Forward, optional
        With a better mesh; it runs the values of the reference.

    Returns
    -------
    Baseline

    Raises
    ------
    InputError
        If the records are a hundred times larger or smaller than the simulated reference.

    Notes
    -----
    Gauss-Newton steps on the misfit of the likelihood with the priors of the unknowns. Derivatives
    are differences at the start; each further run improves them by Broyden's rule. What the finer
    mesh adds is taken at the values of the reference.
    """
    case, unknowns = forward.case, unknowns_of(forward.case.project)
    sigma = np.array([one.sigma for one in unknowns])

    def project(x):
        return with_values(case.project, unknowns, sigma * x)

    start, *moved = forward.motions([project(x) for x in [0.0 * sigma, *STEP * np.eye(len(sigma))]])
    slopes = (np.array(moved).reshape(-1, *start.shape) - start) / STEP
    reference = start if fine is None else fine.motion(case.project)
    correction = reference - start
    likelihood = likelihood_of(case, correction)
    _refuse_another_unit(likelihood, reference)
    problem = LeastSquares(
        lambda x: forward.motion(project(x)) + correction,
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
        case, unknowns, sigma * end.x, sigma[:, None] * linalg.inv(hessian) * sigma, project(end.x),
        end.simulated, end.jacobian / each, reference, correction, likelihood,
    )  # fmt: skip


def likelihood_of(case: Case, correction=None) -> Likelihood:
    """Return the likelihood of the records of a case.

    Parameters
    ----------
    case : Case
    correction : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        What a finer mesh changes.

    Notes
    -----
    Student's, with model error as shares of energy: it must not follow the shape of a simulation
    that may lack physics, nor tie receivers together, so that residuals can be permuted between
    them; theory.md (14.1).
    """
    changes = () if correction is None else (correction,)
    return Likelihood(case, EnergyShares().covariance(case, mesh_changes=changes), StudentT())


def _is_small(step, _, now):
    """Tell whether a step is small beside the posterior standard deviations."""
    return bool(np.max(np.abs(step) / np.sqrt(np.diag(linalg.inv(now.hessian)))) < SETTLED)


def _refuse_another_unit(likelihood, reference):
    """Refuse records of a case that can't be motion in m/s of the reference project."""
    case, loud = likelihood.records, likelihood.noise_share < 0.5
    recorded, sent = (
        np.linalg.norm(case.band.project(one), axis=(2, 3)) for one in (case.motion, reference)
    )
    told = loud & (recorded > 0.0) & (sent > 0.0)
    times = np.median(recorded[told] / sent[told]) if np.any(told) else 1.0
    if not 1.0 / WRONG_UNIT < times < WRONG_UNIT:
        raise InputError(
            f"records: are {times:.2g} times as large as what is simulated, in the median; give "
            "them in m/s (mm/s are 1000 times as large), or mend the source and the charges"
        )
