"""Identifiability of parameters: Fisher information, and slip of joints."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .. import core
from ..core import JOINT_LAWS
from ..errors import SolverError
from ..ground.tables import joint_of_surface
from ..inference.covariance import RecordBlocks, noise_blocks
from ..inference.error_model import NORMAL_95, Change, ErrorModel, Levels
from ..inference.likelihood import signed_residuals
from ..inference.nuisances import SCATTER, design_nuisances, scattering
from ..inference.records import Band, Noise
from ..laws import of_laws
from ..model.joint import FAILED, SLIP
from ..solver.preparation import LEDGER_EVERY, prepare
from ..solver.run import collect, failure
from ..units import split_key
from .parameters import with_values

UNIFORM = 1.0 / np.sqrt(12.0)  # standard deviation of a uniform prior, as a share of its range
LEAST_SENSITIVITY = 0.1  # change of the data by a prior deviation, in units of their error
PEAK_ERRORS = (15.0, 10.0)  # %, of PPV and dominant frequency: what the paper calls a good fit
PEAK_STEP = 0.002  # of a range, for derivatives of peaks; with larger ones frequencies may jump


@dataclass(frozen=True, eq=False)
class FisherInformation:
    """Fisher information of data about n parameters with uniform priors.

    Parameters
    ----------
    matrix : (n, n) float64
        ``J^T J`` of whitened changes of the data by one prior standard deviation of each
        parameter; theory.md (12.3).
    """

    matrix: np.ndarray

    @property
    def covariance(self):
        """Posterior covariance of the parameters in prior standard deviations, (n, n)."""
        return np.linalg.inv(np.eye(len(self.matrix)) + self.matrix)

    @property
    def ratios(self):
        """Ratio of posterior to prior standard deviation of each parameter, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sensitive(self):
        """Whether the data are sensitive to each parameter alone, (n,) bool."""
        return np.sqrt(np.maximum(np.diag(self.matrix), 0.0)) >= LEAST_SENSITIVITY

    @property
    def log_determinant(self):
        """Log determinant of the posterior covariance: the criterion of D-optimal designs."""
        return -float(np.linalg.slogdet(np.eye(len(self.matrix)) + self.matrix)[1])

    def trade_offs(self, least=0.5) -> list[tuple[int, int, float]]:
        """Return pairs of parameters with their posterior correlation, strongest first."""
        ratio, covariance = self.ratios, self.covariance
        correlation = covariance / np.outer(ratio, ratio)
        rows, columns = np.triu_indices(len(ratio), 1)
        pairs = [(int(i), int(j), float(correlation[i, j])) for i, j in zip(rows, columns,
                 strict=True)]  # fmt: skip
        strong = [pair for pair in pairs if abs(pair[2]) >= least]
        return sorted(strong, key=lambda pair: -abs(pair[2]))


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Sensitivity of the motion at a point to the parameters.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    changes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By the whole range of each parameter.
    band : Band
    noise : Noise
        Of each receiver.
    levels : dict of str to float
        Of the model error, see `DESIGN_LEVELS`.
    peaks_only : bool
        Whether the data are PPV and dominant frequency instead of waveforms.
    mesh_errors : (n_errors, n_blasts, n_receivers, 3, n_samples) float64, m/s
        As of `design_nuisances`.
    """

    motion: np.ndarray
    changes: np.ndarray
    band: Band
    noise: Noise
    levels: dict[str, float]
    peaks_only: bool = False
    mesh_errors: np.ndarray | Sequence[np.ndarray] = ()

    @cached_property
    def _blocks(self):
        """Covariance of noise and scattered motion of all records."""
        noise = noise_blocks(self.noise, self.band, len(self.motion))
        spread, none = scattering(self.motion, self.band), np.zeros(self.motion.shape[:2])
        return RecordBlocks(noise, spread, 0.0 * spread, none, none)

    def information(self, blasts, receivers) -> FisherInformation:
        """Return the Fisher information of the records of some blasts at some receivers.

        Parameters
        ----------
        blasts, receivers : sequence of int

        Notes
        -----
        theory.md (12.3): the model error is that of (7.13), independent between receivers but for
        the source spectrum of a blast and the gain of a receiver.
        """
        blasts, receivers = list(blasts), list(receivers)
        part = np.ix_(blasts, receivers)
        motion = self.motion[part]
        if not np.any(motion):
            return FisherInformation(np.zeros((len(self.changes), len(self.changes))))
        if self.peaks_only:
            return self._of_peaks(receivers, motion, self.changes[:, *part])
        errors = [error[part] for error in self.mesh_errors]
        error = ErrorModel(
            self._blocks.of(blasts, receivers),
            design_nuisances(motion, self.band, errors, self.levels),
            Levels(scatter=(self.levels[SCATTER] ** 2,)),
        )
        changes = UNIFORM * self.band.project(self.changes[:, *part])
        return FisherInformation(error.scores(0.0 * changes[:1], [Change(changes)]).length[0])

    def _of_peaks(self, receivers, motion, changes):
        """Return the information of PPV and dominant frequency, with `PEAK_ERRORS` and noise."""
        band = self.band.low, self.band.high
        residuals = signed_residuals("paper", motion, self.band.dt, band=band)
        columns = np.array([residuals(motion + PEAK_STEP * change) for change in changes])
        columns /= PEAK_STEP
        frequency = np.linspace(self.band.low, self.band.high, 64)
        density = self.noise.density(frequency)[receivers].mean(axis=-1)
        noise = np.sqrt(2.0 * (self.band.high - self.band.low) * density)
        ppv = np.max(np.abs(motion), axis=-1)
        # PPV of the components that move, then their frequencies, by blast and receiver
        errors = [
            np.hypot(error, 100.0 * noise[r][moves] / ppv[b, r][moves])
            for b, r in np.ndindex(ppv.shape[:2])
            for moves in [ppv[b, r] > 0.0]
            for error in PEAK_ERRORS
        ]
        columns *= UNIFORM / np.concatenate(errors)
        return FisherInformation(columns @ columns.T)


def centre(unit, information):
    """Return the posterior mean in the unit cube where the data alone estimate ``unit``, (n,).

    Where the data constrain little, the uniform prior shrinks it to the middle; theory.md (12.4).
    """
    shrinkage = information.covariance @ information.matrix
    return np.clip(0.5 + shrinkage @ (np.asarray(unit) - 0.5), 0.0, 1.0)


def posterior_intervals(unit, information):
    """Return the 90 % posterior intervals, (n, 2) in the unit cube, clipped at its faces."""
    half, middle = NORMAL_95 * UNIFORM * information.ratios, centre(unit, information)
    return np.clip(np.stack([middle - half, middle + half], axis=-1), 0.0, 1.0)


PER_PERIOD = 20  # checks of the tractions in the shortest period
STRENGTH = ("cohesion", "friction", "tension")
AT_YIELD = 1e-6  # remaining share of the strength that counts as none
ROUNDING = 1e-9


@dataclass(frozen=True)
class Strength:
    """Slip of one joint surface in a blast, and how far it is from slipping.

    Parameters
    ----------
    contacts : int
    before : int
        Contacts that slipped or opened before the blast.
    failed : int
        Contacts that slipped or opened in the blast.
    factor : float
        Factor on the blast at which the first of the others would slip or open; infinite if none
        can. theory.md (11.5).
    weakest_factor : float
        The same with the lowest strength of the ranges.
    """

    contacts: int
    before: int
    failed: int
    factor: float
    weakest_factor: float


@dataclass(frozen=True, eq=False)
class Slip:
    """Slip of all joints in a blast.

    Parameters
    ----------
    strength : dict of str to Strength
        By joint surface.
    ppv : dict of str to (3,) float64, m/s
        By receiver.
    """

    strength: dict[str, Strength]
    ppv: dict[str, np.ndarray]


def run_with_slip(model, duration, highest, weakest=None, progress=None):
    """Run a model and compare the tractions on its joints with their strength.

    Parameters
    ----------
    model : Model
    duration : float, s
    highest : float, Hz
        Highest frequency of the motion.
    weakest : sequence of Joint, optional
        The same joints with other strengths.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Run
    dict of str to Strength
        By joint surface, of those whose law has a strength and sticks below it.

    Raises
    ------
    SolverError
        As `run`.
    """
    prepared = prepare(model, duration, progress)
    joints = model.numbered_joints
    other = {joint.surface: joint for joint in weakest or joints}
    variants = [joints, [other[joint.surface] for joint in joints]]
    strengths = [_strengths(variant, prepared.constants) for variant in variants]
    initial, normal = (prepared.constants[f"contact_{n}"] for n in ("initial", "normal"))
    least = np.full((2, len(initial)), np.inf)

    def observe(state):
        change = state["contact_traction"] - initial
        for k, strength in enumerate(strengths):
            np.minimum(least[k], slip_factors(initial, change, normal, *strength), out=least[k])

    every = max(1, math.floor(1.0 / (PER_PERIOD * highest * prepared.constants["dt"])))
    run = _run_observed(model, prepared, every, observe, progress)
    return run, _by_surface(joints, run, least)


def _run_observed(model, prepared, every, observe, progress):
    """Run a model and call a function with its state every few steps."""
    views = core.to_fortran(prepared.constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    motion, energy, step, total = [], [], 0, prepared.n_steps
    while step < total:
        chunk, ledger, failed = core.advance(
            views, state, step, min(every, total - step), LEDGER_EVERY
        )
        motion.append(chunk)
        energy.append(ledger)
        step += len(chunk)
        if failed is not None:
            raise SolverError(failure(model, prepared, step, failed))
        observe(state)
        if progress is not None:
            progress("dynamic", step, total)
    whole = prepared.whole(np.concatenate(motion))
    return collect(model, prepared, whole, np.concatenate(energy), state, 0.0, {})


def _strengths(joints, constants):
    """Return cohesion, friction and tension of every contact, infinite where none slips."""
    rows = np.tile([np.inf, 0.0, np.inf], (max(1, len(joints)), 1))
    for number, joint in enumerate(joints):
        if JOINT_LAWS[joint.law].sticks:
            rows[number] = [joint.properties[name] for name in STRENGTH]
    return rows[constants["contact_joint"]].T


def slip_factors(initial, change, normal, cohesion, friction, tension):
    """Return the factor on a blast at which each contact slips or opens, (n,).

    Parameters
    ----------
    initial, change : (n, 3) float64, Pa
        Traction before the blast, and its change in the blast.
    normal : (n, 3) float64
    cohesion, tension : (n,) float64, Pa
    friction : (n,) float64
        As a tangent.

    Returns
    -------
    (n,) float64
        Zero where no strength remains before the blast, infinite where no factor suffices.

    Notes
    -----
    theory.md (11.5), its least root above zero.
    """
    rest, blast = (np.einsum("ci,ci->c", traction, normal) for traction in (initial, change))
    shear = initial - rest[:, None] * normal
    added = change - blast[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        opens = np.where(blast > 0.0, (tension - rest) / blast, np.inf)
    pressed = _roots(shear, added, cohesion - rest * friction, friction * blast)
    free = _roots(shear, added, cohesion, 0.0)
    tolerance = ROUNDING * np.abs(rest)
    with np.errstate(invalid="ignore"):
        valid = np.stack([rest + pressed * blast <= tolerance, rest + free * blast >= -tolerance])
    roots = np.where(valid, np.stack([pressed, free]), np.inf)
    slips = np.where(np.isfinite(cohesion), roots.min(axis=(0, 1)), np.inf)
    shear_strength = cohesion - np.minimum(0.0, rest) * friction
    weak = np.linalg.norm(shear, axis=1) >= (1.0 - AT_YIELD) * shear_strength
    return np.where(weak | (rest >= tension), 0.0, np.fmin(slips, opens))


def _roots(shear, added, strength, loss):
    """Return both m > 0 with ``|shear + m added| = |strength - m loss|``, (2, n); else infinite."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a = np.sum(added**2, axis=1) - loss**2
        b = np.sum(shear * added, axis=1) + loss * strength
        q = np.sum(shear**2, axis=1) - strength**2
        far = -b - np.copysign(np.sqrt(b**2 - a * q), b)
        roots = np.stack([far / a, q / far])
        return np.where(roots > 0.0, roots, np.inf)


def _by_surface(joints, run, least):
    """Return the `Strength` of each joint surface."""
    constants, begun, ended = run.prepared.constants, run.prepared.state, run.state
    sticks = of_laws(JOINT_LAWS, constants["joint_law"], "sticks")
    had = begun["contact_state"][:, FAILED] > 0.0
    has = (ended["contact_state"][:, FAILED] > begun["contact_state"][:, FAILED]) | (
        ended["contact_state"][:, SLIP] != begun["contact_state"][:, SLIP]
    ).any(axis=1)
    strengths = {}
    for number, joint in enumerate(joints):
        here = constants["contact_joint"] == number
        if sticks[number]:
            whole = here & ~had
            # Where nothing moves no factor is finite; contacts that failed before are left out.
            first = [float(np.min(row[whole], initial=np.inf)) for row in least]
            counts = (int(np.count_nonzero(chosen)) for chosen in (here, here & had, here & has))
            strengths[joint.surface] = Strength(*counts, *first)
    return strengths


def is_strength(parameter) -> bool:
    """Tell whether a parameter is a strength of a joint."""
    table, *_, key = parameter.name.split(".")
    return table == "joints" and split_key(key)[0].removesuffix("_residual") in STRENGTH


def weakest(project, parameters, values):
    """Return the joints with the lowest strengths of the ranges, the rest as given."""
    lowest = [
        parameter.low if is_strength(parameter) else value
        for parameter, value in zip(parameters, values, strict=True)
    ]
    return with_values(project, parameters, lowest).joints


def reason_without_slip(parameter, projects, strengths) -> str:
    """Return why a strength is not identifiable: nothing slipped in any blast; else nothing.

    Parameters
    ----------
    parameter : Parameter
    projects : sequence of Project
        One for each blast.
    strengths : sequence of dict of str to Strength
        For each blast by joint surface.
    """
    if not is_strength(parameter):
        return ""
    entry = parameter.name.split(".")[1]
    chosen = [
        strength[surface]
        for project, strength in zip(projects, strengths, strict=True)
        for surface in surfaces_of(project, entry)
        if surface in strength
    ]
    if not chosen or any(strength.failed for strength in chosen):
        return ""
    least = min(strength.weakest_factor for strength in chosen)
    over = "whatever its value in the range" if least > 1.0 else "though lower values would slip"
    return f"no contact of '{entry}' slipped or opened, {over}"


def surfaces_of(project, entry) -> list[str]:
    """Return the joint surfaces of an entry of ``[joints]``."""
    return [name for name, joint in joint_of_surface(project.config.mesh).items() if joint == entry]
