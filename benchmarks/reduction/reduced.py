"""Reduced models: what a family answers for any values in its ranges, and how well."""

from dataclasses import dataclass

import numpy as np

from pyblast.errors import InputError
from pyblast.model.model import Model
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.perturbation import FAILED, SLIP, STATUS
from pyblast.solver.run import Run, simulate
from pyblast.solver.tracks import seismograms

from .family import Family, family
from .projection import Projection, project, refuse_led, solve
from .ranges import Ranges
from .strength import Watched, refuse_slip, watched
from .training import samples

TOLERANCE = 1e-5  # of the largest size of motion: what the basis may leave out
FIRST = 4  # runs before their error tells where the next should be
CANDIDATES = 48  # places among which the next run is chosen


@dataclass(frozen=True, eq=False)
class Calibration:
    """What residuals of a reduced model mean, by full runs that it did not learn from.

    Parameters
    ----------
    values : list of dict
    residual : (n,) float64
    error : (n,) float64
        True ones: norm of the difference of waveforms over that of the full run, worst receiver.
    """

    values: list[dict]
    residual: np.ndarray
    error: np.ndarray

    @property
    def factor(self):
        """Error over residual, the largest seen."""
        return float(np.max(self.error / self.residual))

    def __str__(self):
        """Table of residual, what is estimated from it and what is true, run by run."""
        lines = ["residual  estimated  true error of the waveforms"]
        for residual, error in zip(self.residual, self.error, strict=True):
            lines.append(f"{residual:8.1e}  {self.factor * residual:8.2%}  {error:8.2%}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a reduced model answers.

    Parameters
    ----------
    values : dict of str to float
    seismograms : dict of str to Seismogram
        By receiver, at the steps of a full run.
    residual : float
    error : float
        Estimated from the residual: of the waveforms, at the worst receiver.
    strength_used : float
        Largest share of its strength that a watched contact uses; 0 where none can slip.
    """

    values: dict[str, float]
    seismograms: dict[str, Seismogram]
    residual: float
    error: float
    strength_used: float


@dataclass(frozen=True, eq=False)
class Confirmation:
    """A prediction beside the full run of the same values.

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
    """A family of linear models that answers fast.

    Parameters
    ----------
    projection : Projection
    trained : list of dict
        Values of the runs that it learnt from, in order.
    seconds : list of float
        What the march of each of them took.
    calibration : Calibration
    contacts : list of Watched
    """

    projection: Projection
    trained: list[dict]
    seconds: list[float]
    calibration: Calibration
    contacts: list[Watched]

    @property
    def family(self) -> Family:
        """The models that it stands for."""
        return self.projection.family

    def predict(self, values) -> Prediction:
        """Return the seismograms of some values, with their estimated error; theory.md (10.8).

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
        """Make the full run of some values, strength and in-situ stress included, and compare.

        Raises
        ------
        InputError
            As `predict`.
        """
        predicted = self.predict(values)
        one = self.family
        whole = simulate(
            one.model(values), one.duration, progress=progress, prepared=one.stressed(values)
        )
        errors = {
            name: difference(one.velocity, predicted.seismograms[name].velocity)
            for name, one in whole.seismograms.items()
        }
        return Confirmation(predicted, whole, errors, count_failed(whole))


def reduced(
    model: Model, ranges, duration, *, highest, runs=12, held_out=4, tolerance=TOLERANCE,
    seed=0, store=None, progress=None,
) -> Reduced:  # fmt: skip
    """Learn how a linear model answers for all stiffness of joints and damping in some ranges.

    Parameters
    ----------
    model : Model
        Joints elastic, or with a strength that nothing reaches; ground elastic or fading.
    ranges : dict of str to (low, high)
        See `Ranges`: ``kn``, ``ks`` in Pa/m, ``ratio``; of one joint as ``kn.NAME``.
    duration : float, s
    highest : float, Hz
        Highest frequency of the motion.
    runs : int
        Full runs to learn from.
    held_out : int
        Further full runs that calibrate the estimated error.
    tolerance : float
        Share of the largest size of motion that the basis may leave out.
    seed : int
        Of all random choices.
    store : path, optional
        Folder of runs: what is there already is not run again.
    progress : callable, optional
        Called with (stage, done, total) after every full run.

    Raises
    ------
    InputError
        If the model is not linear, ranges do not suit it, sources go beyond ``highest`` or a
        contact fails before the blast.

    Notes
    -----
    The first runs stand at a Sobol sequence and march side by side with those that calibrate; each
    further one stands where the residual is largest.
    """
    whole = family(model, Ranges(dict(ranges)), duration, highest)
    refuse_led(whole)
    for name, count in (("runs", runs), ("held_out", held_out)):
        if count < 1:
            raise InputError(f"reduced.{name}: must be at least 1, got {count}")
    apart = whole.ranges.unseen(held_out, seed)
    places = whole.ranges.learning(FIRST + runs + CANDIDATES, seed)
    first = places[: min(runs, FIRST)]
    found = samples(whole, first + apart, store)
    learnt, kept = found[: len(first)], found[len(first) :]
    projection = project(whole, [one.modes for one in learnt], tolerance, seed)
    for left in range(runs - len(first), 0, -1):
        if progress is not None:
            progress("runs", runs + held_out - left, runs + held_out)
        residual = [solve(projection, values).residual for values in places[FIRST:][:CANDIDATES]]
        learnt += samples(whole, [places.pop(FIRST + int(np.argmax(residual)))], store)
        projection = project(whole, [one.modes for one in learnt], tolerance, seed)
    known = [(one.values, solve(projection, one.values)) for one in learnt]
    return Reduced(
        projection, [values for values, _ in known], [one.seconds for one in learnt],
        _calibrated(projection, kept), watched(projection, known),
    )  # fmt: skip


def _calibrated(projection, samples):
    """Compare residuals with errors at runs that nothing was learnt from."""
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
    motion = projection.line.back(solution.velocity)
    return motion.reshape(len(motion), -1, 3)


def difference(wanted, found):
    """Return the norm of the difference of two motions over that of the first."""
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def count_failed(whole):
    """Count the contacts that have slipped or opened at the end of a run."""
    begun, ended = whole.prepared.state["contact_state"], whole.state["contact_state"]
    moved = (ended[:, SLIP] != 0.0).any(axis=1) | (ended[:, STATUS] > 0.0)
    return int(np.count_nonzero(moved | (ended[:, FAILED] > begun[:, FAILED])))
