"""Reduced models: training, predictions with estimated errors, contacts near failure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from pyblast.errors import InputError
from pyblast.model.joint import FAILED, SLIP, STATUS, STICKING_JOINTS
from pyblast.model.model import Model
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import Run, seismograms, simulate

from .families import Family, Ranges, family
from .projection import Projection, check_sources, joint_jumps, project, solve
from .snapshots import samples

MONITORED = 256  # contacts, over all joints
PER_PERIOD = 10  # samples of tractions to the shortest period
PART = 512  # contacts whose tractions are computed at once
AT_REST = 1e-9  # fraction of the largest shear traction that counts as zero


@dataclass(frozen=True, eq=False)
class MonitoredContacts:
    """Monitored contacts of one joint: those nearest to their strength.

    Parameters
    ----------
    surface : str
    strength : tuple of 3 float
        Cohesion in Pa, friction as a tangent, tension in Pa.
    jump : (n, 3, size) float64
        Of the directions of the basis.
    normal : (n, 3) float64
    initial : (n, 3) float64, Pa
        Traction before the blast, at the centre of the ranges.
    """

    surface: str
    strength: tuple[float, float, float]
    jump: np.ndarray
    normal: np.ndarray
    initial: np.ndarray


def monitored_contacts(projection, solutions):
    """Return the contacts that came nearest to their strength in the training runs.

    Parameters
    ----------
    projection : Projection
    solutions : list of (values, Solution)

    Returns
    -------
    list of MonitoredContacts
        For the joints that can slip.

    Raises
    ------
    InputError
        If a contact slips or opens before the blast.
    """
    model, contacts = projection.family.base, projection.family.base.mesh.contacts
    joints = {one.surface: one for one in model.joints if one.law in STICKING_JOINTS}
    if not joints:
        return []
    stressed = projection.family.stressed(projection.family.ranges.middle())
    monitored, uses = [], []
    for number, name in enumerate(contacts.names):
        if name in joints:
            here = contacts.joint == number
            _refuse_failed(name, stressed.state["contact_state"][here])
            values = [joints[name].properties[k] for k in ("cohesion", "friction", "tension")]
            jump, normal, _ = joint_jumps(contacts, number, projection.directions)
            initial = stressed.constants["contact_initial"][here]
            monitored.append(MonitoredContacts(name, tuple(values), jump, normal, initial))
            uses.append(
                np.max(
                    [strength_used(projection, monitored[-1], *pair) for pair in solutions], axis=0
                )
            )
    least = np.sort(np.concatenate(uses))[-MONITORED:][0]
    kept = [one >= least for one in uses]
    return [_selected(each, here) for each, here in zip(monitored, kept, strict=True) if here.any()]


def _selected(contacts, chosen):
    """Return a selection of the contacts of a joint."""
    parts = {name: getattr(contacts, name)[chosen] for name in ("jump", "normal", "initial")}
    return replace(contacts, **parts)


def _refuse_failed(name, state):
    """Raise InputError for a joint with contacts that fail in the static stage."""
    count = np.count_nonzero((state[:, FAILED] > 0.0) | (state[:, STATUS] > 0.0))
    if count:
        raise InputError(
            f"joints.{name}: {count} of {len(state)} contacts slip or open before the blast, where "
            "a reduced model does not hold; take the law 'elastic' or a stronger joint"
        )


def strength_used(projection, one, values, solution):
    """Return the largest utilisation of strength of each contact, (n,); 1 at failure."""
    family, path = projection.family, projection.contour
    joints = family.ranges.model(family.base, values).joints
    kn, ks = next(
        (j.properties["kn"], j.properties["ks"]) for j in joints if j.surface == one.surface
    )
    count = math.ceil(PER_PERIOD * family.highest * path.n_period * path.dt)
    motion = path.to_time(solution.motion, min(path.n_period, count))
    shares = []
    for first in range(0, len(one.normal), PART):
        part = slice(first, first + PART)
        jump, normal = one.jump[part], one.normal[part]
        moved = (jump.reshape(-1, jump.shape[2]) @ motion.T).reshape(len(jump), 3, -1)
        opening = np.einsum("cit,ci->ct", moved, normal)
        along = opening[:, None] * normal[:, :, None]
        tension = kn * opening + np.sum(one.initial[part] * normal, axis=1)[:, None]
        resting = one.initial[part] - np.sum(one.initial[part] * normal, axis=1)[:, None] * normal
        shear = np.linalg.norm(resting[:, :, None] + ks * (moved - along), axis=1)
        shares.append(_utilisation(tension, shear, one.strength))
    return np.concatenate(shares)


def _utilisation(normal, shear, strength):
    """Return the largest utilisation in time of tractions (n, n_times); theory.md (3.2)."""
    cohesion, friction, tension = strength
    limit = cohesion + np.maximum(0.0, -normal) * friction
    idle = shear <= AT_REST * max(shear.max(), np.finfo(float).tiny)
    with np.errstate(divide="ignore"):
        share = np.where(idle, 0.0, shear / limit)
    return np.where(normal > tension, np.inf, share).max(axis=1)


def refuse_slip(projection, contacts, values, solution):
    """Return the largest utilisation of strength; raise InputError where a contact fails.

    Raises
    ------
    InputError
        With the joint and the count.
    """
    largest = 0.0
    for one in contacts:
        share = strength_used(projection, one, values, solution)
        if (share >= 1.0).any():
            raise InputError(
                f"joints.{one.surface}: {np.count_nonzero(share >= 1.0)} of {len(share)} monitored "
                "contacts slip or open at these values, where a reduced model does not hold; make "
                "a full run"
            )
        largest = max(largest, float(share.max()))
    return largest


TOLERANCE = 1e-5  # fraction of the largest singular value that the basis may leave out
FIRST = 4  # training runs before the residual chooses the next
CANDIDATES = 48  # for the next training run


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibration of the residual as an error estimate, by full runs held out of the training.

    Parameters
    ----------
    values : list of dict
    residual : (n,) float64
    error : (n,) float64
        True error: norm of the waveform difference over that of the full run, worst receiver.
    """

    values: list[dict]
    residual: np.ndarray
    error: np.ndarray

    @property
    def factor(self):
        """Largest ratio of error to residual."""
        return float(np.max(self.error / self.residual))

    def __str__(self):
        """Table of residual, estimated error and true error of each run."""
        lines = ["residual  estimated  true error of the waveforms"]
        for residual, error in zip(self.residual, self.error, strict=True):
            lines.append(f"{residual:8.1e}  {self.factor * residual:8.2%}  {error:8.2%}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction of a reduced model.

    Parameters
    ----------
    values : dict of str to float
    seismograms : dict of str to Seismogram
        By receiver, at the steps of a full run.
    residual : float
    error : float
        Estimated from the residual: of the waveforms, at the worst receiver.
    strength_used : float
        Largest utilisation of strength of a monitored contact; 0 where none can slip.
    """

    values: dict[str, float]
    seismograms: dict[str, Seismogram]
    residual: float
    error: float
    strength_used: float


@dataclass(frozen=True, eq=False)
class Confirmation:
    """Prediction and full run for the same values.

    Parameters
    ----------
    prediction : Prediction
    run : Run
    error : dict of str to float
        By receiver: norm of the difference of waveforms over that of the full run.
    failed : int
        Contacts that slipped or opened in the full run.
    """

    prediction: Prediction
    run: Run
    error: dict[str, float]
    failed: int


@dataclass(frozen=True, eq=False)
class Reduced:
    """Reduced model of a family of linear models.

    Parameters
    ----------
    projection : Projection
    trained : list of dict
        Values of the training runs, in order.
    seconds : list of float
        Wall time of each of them.
    calibration : Calibration
    contacts : list of MonitoredContacts
    """

    projection: Projection
    trained: list[dict]
    seconds: list[float]
    calibration: Calibration
    contacts: list[MonitoredContacts]

    @property
    def family(self) -> Family:
        """The family of full models."""
        return self.projection.family

    def predict(self, values) -> Prediction:
        """Return the seismograms for given values, with their estimated error; theory.md (10.8).

        Parameters
        ----------
        values : dict of str to float
            Of all ranges.

        Raises
        ------
        InputError
            If a value is outside its range, or a contact would slip or open.
        """
        self.family.ranges.check(values)
        solution = solve(self.projection, values)
        used = refuse_slip(self.projection, self.contacts, values, solution)
        found = seismograms(self.family.base, _motion(self.projection, solution), self.family.dt)
        error = self.calibration.factor * solution.residual
        return Prediction(dict(values), found, solution.residual, error, used)

    def confirm(self, values, progress=None) -> Confirmation:
        """Simulate the full model, with strength and in-situ stress, and compare.

        Raises
        ------
        InputError
            As `predict`.
        """
        predicted, family = self.predict(values), self.family
        whole = simulate(
            family.model(values),
            family.duration,
            progress=progress,
            prepared=family.stressed(values),
        )
        errors = {
            name: difference(record.velocity, predicted.seismograms[name].velocity)
            for name, record in whole.seismograms.items()
        }
        return Confirmation(predicted, whole, errors, count_failed(whole))


def reduced(
    model: Model, ranges, duration, *, highest, runs=12, held_out=4, tolerance=TOLERANCE,
    seed=0, store=None, progress=None,
) -> Reduced:  # fmt: skip
    """Train a reduced model for ranges of joint stiffness and damping.

    Parameters
    ----------
    model : Model
        Joints elastic, or with a strength that is not reached; ground elastic or attenuating.
    ranges : dict of str to (low, high)
        See `Ranges`: ``kn``, ``ks`` in Pa/m, ``ratio``; of one joint as ``kn.NAME``.
    duration : float, s
    highest : float, Hz
        Highest frequency of the motion.
    runs : int
        Training runs.
    held_out : int
        Further full runs that calibrate the error estimate.
    tolerance : float
        Fraction of the largest singular value that the basis may leave out.
    seed : int
        Of all random choices.
    store : path, optional
        Cache folder of full runs.
    progress : callable, optional
        Called with (stage, done, total) after every full run.

    Raises
    ------
    InputError
        If the model is not linear or lacks a parameter, sources exceed ``highest`` or a contact
        fails before the blast.

    Notes
    -----
    The first training runs follow a Sobol sequence and run in one batch with the held-out ones;
    each further one is at the candidate with the largest residual (greedy).
    """
    whole = family(model, Ranges(dict(ranges)), duration, highest)
    check_sources(whole)
    for name, count in (("runs", runs), ("held_out", held_out)):
        if count < 1:
            raise InputError(f"reduced.{name}: must be at least 1, got {count}")
    apart = whole.ranges.validation(held_out, seed)
    places = whole.ranges.training(FIRST + runs + CANDIDATES, seed)
    first = places[: min(runs, FIRST)]
    runs_made = samples(whole, first + apart, store)
    training, kept = runs_made[: len(first)], runs_made[len(first) :]
    projection = project(whole, [one.modes for one in training], tolerance, seed)
    for left in range(runs - len(first), 0, -1):
        if progress is not None:
            progress("runs", runs + held_out - left, runs + held_out)
        residual = [solve(projection, values).residual for values in places[FIRST:][:CANDIDATES]]
        training += samples(whole, [places.pop(FIRST + int(np.argmax(residual)))], store)
        projection = project(whole, [one.modes for one in training], tolerance, seed)
    known = [(one.values, solve(projection, one.values)) for one in training]
    return Reduced(
        projection, [values for values, _ in known], [one.seconds for one in training],
        _calibrated(projection, kept), monitored_contacts(projection, known),
    )  # fmt: skip


def _calibrated(projection, samples):
    """Compare residuals with errors at the held-out runs."""
    solutions = [solve(projection, one.values) for one in samples]
    error = [
        max(
            difference(wanted, found)
            for wanted, found in zip(
                np.swapaxes(one.motion, 0, 1),
                np.swapaxes(_motion(projection, solution), 0, 1), strict=True,
            )
        )
        for one, solution in zip(samples, solutions, strict=True)
    ]  # fmt: skip
    residual = np.array([solution.residual for solution in solutions])
    return Calibration([one.values for one in samples], residual, np.array(error))


def _motion(projection, solution):
    """Return the motion of the receivers in time, (n_steps, n_receivers, 3) m/s."""
    motion = projection.contour.to_time(solution.velocity)
    return motion.reshape(len(motion), -1, 3)


def difference(wanted, found):
    """Return the norm of the difference of two motions over that of the first."""
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def count_failed(whole):
    """Count the contacts that have slipped or opened at the end of a run."""
    begun, ended = whole.prepared.state["contact_state"], whole.state["contact_state"]
    moved = (ended[:, SLIP] != 0.0).any(axis=1) | (ended[:, STATUS] > 0.0)
    return int(np.count_nonzero(moved | (ended[:, FAILED] > begun[:, FAILED])))
