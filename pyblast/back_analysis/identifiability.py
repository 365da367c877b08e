"""Identifiability of parameters: Fisher information, and slip of joints."""

import math
from dataclasses import dataclass

import numpy as np

from .. import core
from ..core import JOINT_LAWS
from ..errors import SolverError
from ..inference.covariance import SCATTER, error_columns, whitener
from ..inference.error_model import scattering
from ..inference.likelihood import misfit
from ..inference.records import Band, Noise
from ..project.ground import joint_of_surface
from ..solver.linear_runs import FAILED, STICKING_JOINTS, by_number
from ..solver.preparation import LEDGER_EVERY, prepare
from ..solver.run import collect, failure
from ..units import split_key
from .parameters import with_values

UNIFORM = 1.0 / np.sqrt(12.0)  # standard deviation of a range, in shares of it
INFLUENCE = 0.1  # of what noise and errors of the theory are, below which nothing is felt
NORMAL_95 = 1.6448536269514722
PEAKS = (15.0, 10.0)  # %, errors of PPV and dominant frequency: what the paper calls a good fit
MOVED = 0.002  # of a range, by which peaks are compared: further, frequencies jump between peaks


@dataclass(frozen=True, eq=False)
class Knowledge:
    """What some data tell of n unknowns.

    Parameters
    ----------
    information : (n, n) float64
        Of whitened changes of the data by one prior deviation of each unknown; theory.md (12.7).
    """

    information: np.ndarray

    @property
    def covariance(self):
        """Of the unknowns after the data, in prior deviations, (n, n)."""
        return np.linalg.inv(np.eye(len(self.information)) + self.information)

    @property
    def shares(self):
        """Standard deviation after the data over the one before, (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def felt(self):
        """Whether a change by a prior deviation would be noticed if it were alone, (n,) bool."""
        return np.sqrt(np.maximum(np.diag(self.information), 0.0)) >= INFLUENCE

    @property
    def log_determinant(self):
        """Of the covariance: how far the data shrink the volume of what is possible."""
        return -float(np.linalg.slogdet(np.eye(len(self.information)) + self.information)[1])

    def trade_offs(self, least=0.5) -> list[tuple[int, int, float]]:
        """Return pairs of unknowns whose errors go together, and how far, strongest first."""
        share, covariance = self.shares, self.covariance
        correlation = covariance / np.outer(share, share)
        rows, columns = np.triu_indices(len(share), 1)
        pairs = [(int(i), int(j), float(correlation[i, j])) for i, j in zip(rows, columns,
                 strict=True)]  # fmt: skip
        kept = [pair for pair in pairs if abs(pair[2]) >= least]
        return sorted(kept, key=lambda pair: -abs(pair[2]))


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Motion at a point and how it changes with the unknowns.

    Parameters
    ----------
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    changes : (n, n_blasts, n_receivers, 3, n_samples) float64, m/s
        By the whole range of each unknown.
    band : Band
    noise : Noise
        Of each receiver.
    levels : dict of str to float
        Of the errors of the theory.
    peaks_only : bool
        Whether PPV and dominant frequency are all that is looked at.
    mesh_errors : (n_errors, n_blasts, n_receivers, 3, n_samples) float64, m/s
        As of `usual_whitener`.
    """

    motion: np.ndarray
    changes: np.ndarray
    band: Band
    noise: Noise
    levels: dict[str, float]
    peaks_only: bool = False
    mesh_errors: np.ndarray | tuple = ()

    def knowledge(self, blasts, receivers, scattered=None) -> Knowledge:
        """Return what some blasts at some receivers tell.

        Parameters
        ----------
        blasts, receivers : sequence of int
        scattered : array, optional
            What `scattered` returns, where it is asked for often.

        Notes
        -----
        theory.md (12.7): errors of the theory are those of (7.13), independent between receivers
        but for the spectrum of a blast and the gain of a receiver.
        """
        blasts, receivers = list(blasts), list(receivers)
        part = np.ix_(blasts, receivers)
        motion = self.motion[part]
        if not np.any(motion):
            return Knowledge(np.zeros((len(self.changes), len(self.changes))))
        if self.peaks_only:
            return self._by_peaks(receivers, motion, self.changes[:, *part])
        spread = (self.scattered() if scattered is None else scattered)[part]
        errors = error_columns(motion, self.band, [one[part] for one in self.mesh_errors])
        used = {*errors.groups, SCATTER}
        white = whitener(
            _of_receivers(self.noise, receivers), self.band, len(blasts), nuisances=errors,
            scattering=spread, levels={n: v for n, v in self.levels.items() if n in used},
        )  # fmt: skip
        columns = UNIFORM * white.apply(self.changes[:, *part]).reshape(len(self.changes), -1)
        return Knowledge(columns @ columns.T)

    def _by_peaks(self, receivers, motion, changes):
        """Return what PPV and dominant frequency tell, each with its error in `PEAKS` and noise."""
        one = misfit("paper", motion, self.band.dt, band=(self.band.low, self.band.high))
        columns = np.array([one.residuals(motion + MOVED * change) for change in changes]) / MOVED
        frequency = np.linspace(self.band.low, self.band.high, 64)
        density = self.noise.density(frequency)[receivers].mean(axis=-1)
        noise = np.sqrt(2.0 * (self.band.high - self.band.low) * density)
        ppv = np.max(np.abs(motion), axis=-1)
        # PPV of the components that move, then their frequencies, by blast and receiver
        errors = [
            np.hypot(error, 100.0 * noise[r][moves] / ppv[b, r][moves])
            for b, r in np.ndindex(ppv.shape[:2])
            for moves in [ppv[b, r] > 0.0]
            for error in PEAKS
        ]
        columns *= UNIFORM / np.concatenate(errors)
        return Knowledge(columns @ columns.T)

    def scattered(self):
        """Return the covariance of scattered motion of all blasts and receivers."""
        return scattering(self.motion, self.band)


def _of_receivers(noise, receivers):
    """Return the noise of some receivers."""
    return Noise(
        noise.step, noise.coefficients[receivers], noise.variance[receivers],
        noise.correlation[receivers], noise.doubt[receivers], noise.resolved,
    )  # fmt: skip


def centre(unit, knowledge):
    """Return the likeliest place in the unit cube where data alone would say ``unit``, (n,).

    Ranges pull towards their middle what data hardly tell; theory.md (12.8).
    """
    pull = knowledge.covariance @ knowledge.information
    return np.clip(0.5 + pull @ (np.asarray(unit) - 0.5), 0.0, 1.0)


def intervals(unit, knowledge):
    """Return where 90 % of what is left lies, (n, 2) in the unit cube, cut at its sides."""
    reach, middle = NORMAL_95 * UNIFORM * knowledge.shares, centre(unit, knowledge)
    return np.clip(np.stack([middle - reach, middle + reach], axis=-1), 0.0, 1.0)


PER_PERIOD = 20  # tractions that are looked at in the shortest period
STRENGTH = ("cohesion", "friction", "tension")
AT_YIELD = 1e-6  # of the strength: what is taken for none left
ROUNDING = 1e-9


@dataclass(frozen=True)
class Strength:
    """What the contacts of one joint surface did with their strength.

    Parameters
    ----------
    contacts : int
    before : int
        That had slipped or opened before the blast.
    failed : int
        That slipped or opened in the blast.
    factor : float
        How many times stronger the blast would have to be for the first of the others to slip or
        open; infinite where none can. theory.md (11.5).
    weakest_factor : float
        The same with another, lower strength.
    """

    contacts: int
    before: int
    failed: int
    factor: float
    weakest_factor: float


@dataclass(frozen=True, eq=False)
class Slip:
    """What joints did in a blast.

    Parameters
    ----------
    strength : dict of str to Strength
        By joint surface.
    ppv : dict of str to (3,) float64, m/s
        By receiver.
    """

    strength: dict[str, Strength]
    ppv: dict[str, np.ndarray]


def watched_run(model, duration, highest, weakest=None, progress=None):
    """Run a model and watch the tractions on its joints.

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
    joints = by_number(model)
    other = {joint.surface: joint for joint in weakest or joints}
    several = [joints, [other[joint.surface] for joint in joints]]
    strengths = [_strengths(some, prepared.constants) for some in several]
    initial, normal = (prepared.constants[f"contact_{n}"] for n in ("initial", "normal"))
    least = np.full((2, len(initial)), np.inf)

    def look(state):
        moved = state["contact_traction"] - initial
        for k, strength in enumerate(strengths):
            np.minimum(least[k], factors(initial, moved, normal, *strength), out=least[k])

    every = max(1, math.floor(1.0 / (PER_PERIOD * highest * prepared.constants["dt"])))
    run = _march(model, prepared, every, look, progress)
    return run, _by_surface(joints, run, least)


def _march(model, prepared, every, look, progress):
    """March a model and look at its state every few steps."""
    views = core.to_fortran(prepared.constants)
    state = {name: value.copy() for name, value in prepared.state.items()}
    motion, energy, step, total = [], [], 0, prepared.n_steps
    while step < total:
        moved, ledger, failed = core.advance(
            views, state, step, min(every, total - step), LEDGER_EVERY
        )
        motion.append(moved)
        energy.append(ledger)
        step += len(moved)
        if failed is not None:
            raise SolverError(failure(model, prepared, step, failed))
        look(state)
        if progress is not None:
            progress("dynamic", step, total)
    return collect(model, prepared, np.concatenate(motion), np.concatenate(energy), state, 0.0, {})


def _strengths(joints, constants):
    """Return cohesion, friction and tension of every contact, infinite where none slips."""
    rows = np.tile([np.inf, 0.0, np.inf], (max(1, len(joints)), 1))
    for number, joint in enumerate(joints):
        if joint.law in STICKING_JOINTS:
            rows[number] = [joint.properties[name] for name in STRENGTH]
    return rows[constants["contact_joint"]].T


def factors(initial, moved, normal, cohesion, friction, tension):
    """Return how many times stronger motion would bring contacts to their strength, (n,).

    Parameters
    ----------
    initial, moved : (n, 3) float64, Pa
        Traction before the blast, and what the blast adds.
    normal : (n, 3) float64
    cohesion, tension : (n,) float64, Pa
    friction : (n,) float64
        As a tangent.

    Returns
    -------
    (n,) float64
        Zero where nothing is left before the blast, infinite where no blast of this form does it.

    Notes
    -----
    theory.md (11.5), its least root above zero.
    """
    rest, blast = (np.einsum("ci,ci->c", one, normal) for one in (initial, moved))
    shear = initial - rest[:, None] * normal
    added = moved - blast[:, None] * normal
    with np.errstate(divide="ignore", invalid="ignore"):
        opens = np.where(blast > 0.0, (tension - rest) / blast, np.inf)
    pressed = _roots(shear, added, cohesion - rest * friction, friction * blast)
    free = _roots(shear, added, cohesion, 0.0)
    nearly = ROUNDING * np.abs(rest)
    with np.errstate(invalid="ignore"):
        there = np.stack([rest + pressed * blast <= nearly, rest + free * blast >= -nearly])
    found = np.where(there, np.stack([pressed, free]), np.inf)
    slips = np.where(np.isfinite(cohesion), found.min(axis=(0, 1)), np.inf)
    left = cohesion - np.minimum(0.0, rest) * friction
    weak = np.linalg.norm(shear, axis=1) >= (1.0 - AT_YIELD) * left
    return np.where(weak | (rest >= tension), 0.0, np.fmin(slips, opens))


def _roots(shear, added, left, loss):
    """Return both m > 0 with ``|shear + m added| = |left - m loss|``, (2, n); infinite if none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        a = np.sum(added**2, axis=1) - loss**2
        b = np.sum(shear * added, axis=1) + loss * left
        q = np.sum(shear**2, axis=1) - left**2
        far = -b - np.copysign(np.sqrt(b**2 - a * q), b)
        found = np.stack([far / a, q / far])
        return np.where(found > 0.0, found, np.inf)


def _by_surface(joints, run, least):
    """Sum up contacts by their joint surface."""
    constants, begun, ended = run.prepared.constants, run.prepared.state, run.state
    sticking = [JOINT_LAWS[name].number for name in STICKING_JOINTS]
    had = begun["contact_state"][:, FAILED] > 0.0
    slip = slice(0, 3)
    has = (ended["contact_state"][:, FAILED] > begun["contact_state"][:, FAILED]) | (
        ended["contact_state"][:, slip] != begun["contact_state"][:, slip]
    ).any(axis=1)
    found = {}
    for number, joint in enumerate(joints):
        here = constants["contact_joint"] == number
        if constants["joint_law"][number] in sticking:
            whole = here & ~had
            # Where nothing moves no factor is finite; what failed before is not looked at.
            first = [float(np.min(row[whole], initial=np.inf)) for row in least]
            counts = (int(np.count_nonzero(one)) for one in (here, here & had, here & has))
            found[joint.surface] = Strength(*counts, *first)
    return found


def is_strength(parameter) -> bool:
    """Tell whether a parameter is a strength of a joint."""
    table, *_, key = parameter.name.split(".")
    return table == "joints" and split_key(key)[0].removesuffix("_residual") in STRENGTH


def weakest(project, parameters, values):
    """Return the joints with the lowest strengths of the ranges, the rest as given."""
    lowest = [
        one.low if is_strength(one) else value
        for one, value in zip(parameters, values, strict=True)
    ]
    return with_values(project, parameters, lowest).joints


def insensitive(parameter, projects, strengths) -> str:
    """Say why records can't tell a strength: nothing slipped in any blast; else nothing.

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
    found = [
        strength[surface]
        for project, strength in zip(projects, strengths, strict=True)
        for surface in surfaces_of(project, entry)
        if surface in strength
    ]
    if not found or any(one.failed for one in found):
        return ""
    least = min(one.weakest_factor for one in found)
    over = "whatever its value in the range" if least > 1.0 else "though lower values would slip"
    return f"no contact of '{entry}' slipped or opened, {over}"


def surfaces_of(project, entry) -> list[str]:
    """Return the joint surfaces that an entry of ``[joints]`` stands for."""
    return [name for name, one in joint_of_surface(project.config.mesh).items() if one == entry]
