"""Survey design: Fisher information of receivers and blasts about the parameters."""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..core import LANES
from ..inference.covariance import LEVELS
from ..inference.gauss_newton import DIFFERENCE
from ..inference.global_search import Problem
from ..inference.parameter import Parameter
from ..inference.records import band_functions
from ..project.inputs import input_band
from .identifiability import Knowledge, Sensitivities, intervals
from .mesh_error import Place, listening, mesh_errors_of, places_of
from .parameters import (
    candidates_of,
    check_parameters,
    foreseen_blasts,
    foreseen_records,
    parameters_of,
    with_values,
)
from .slip import Slip, insensitive, is_strength, watched_run, weakest
from .trials import held_step, simulate
from .waveforms import Window, gathered, has_quiet, recorded_noise, white_noise, window_of


@dataclass(frozen=True)
class Extra:
    """What one more receiver or blast would bring, or one less would cost.

    Parameters
    ----------
    kind : str
        ``receiver``, ``blast``, or ``without`` for a receiver that is left out.
    name : str
    position : tuple of 3 float, m, or None
    gain : float
        By which it lowers the logarithm of the determinant of the covariance of the unknowns.
    worst : float
        Largest standard deviation after over before, of unknowns that are felt at all.
    worst_path : str
    """

    kind: str
    name: str
    position: tuple[float, float, float] | None
    gain: float
    worst: float
    worst_path: str


def extras_of(sensitivities, parameters, places, blasts, candidates):
    """Return what is known as it is, and what extras would bring, best first."""
    scattered = sensitivities.scattered()
    count, fired = sum(place.counts for place in places), range(len(blasts))

    def known(some_blasts, some_receivers):
        return sensitivities.knowledge(some_blasts, some_receivers, scattered)

    now = known(fired, range(count))

    def extra(kind, name, position, then):
        felt = now.felt | then.felt
        shares = np.where(felt, then.shares, 0.0)
        worst = int(np.argmax(shares))
        path = parameters[worst].name if felt.any() else ""
        gain = now.log_determinant - then.log_determinant
        return Extra(kind, name, position, gain, float(shares[worst]), path)

    found = [
        extra("receiver", place.name, place.position, known(fired, [*range(count), number]))
        for number, place in enumerate(places)
        if not place.counts
    ]
    found += [
        extra("blast", one.path.name, None, known([*fired, len(blasts) + number], range(count)))
        for number, one in enumerate(candidates)
    ]
    if count > 1:
        found += [
            extra("without", place.name, place.position,
                  known(fired, [r for r in range(count) if r != number]))
            for number, place in enumerate(places[:count])
        ]  # fmt: skip
    found.sort(key=lambda one: -one.gain)
    return now, extra("as it is", "", None, now), tuple(found)


NOISE = 5e-5  # m/s, rms of a component in the band, where nothing is known
FIXED, HARDLY = 0.3, 0.8  # standard deviation after over before
UNFELT = {
    "paper": "PPV and dominant frequency hardly depend on it",
    "waveform": "the motion hardly depends on it",
}


@dataclass(frozen=True, eq=False)
class Plan:
    """What receivers and blasts can tell of unknowns.

    Parameters
    ----------
    parameters : tuple of Parameter
    values : (n,) float64
        Where the sensitivities were taken, in the units of the parameters.
    misfit : str
        By which `knowledge` counts: ``paper`` or ``waveform``.
    knowledge : Knowledge
    other : Knowledge
        By the other of the two.
    within : (n, 2) float64
        Where 90 % of what is left lies.
    why : dict of str to str
        Parameters that can't be told at all, and why.
    extras : tuple of Extra
    worst : Extra
        As it is, with no extra.
    places : tuple of Place
    apart : float, m
        How far new receivers stand from those that there are, at least: nearer ones have the
        errors of the theory in common.
    window : Window
    noise : str
        Where its level is from.
    levels : dict of str to float
        Of the errors of the theory.
    slip : dict of str to Slip
        By blast; empty where no strength is asked for.
    mesh_doubt : str
        Why errors of the mesh are not counted; nothing where they are.
    """

    parameters: tuple[Parameter, ...]
    values: np.ndarray
    misfit: str
    knowledge: Knowledge
    other: Knowledge
    within: np.ndarray
    why: dict[str, str]
    extras: tuple[Extra, ...]
    worst: Extra
    places: tuple[Place, ...]
    apart: float
    window: Window
    noise: str
    levels: dict[str, float]
    slip: dict[str, Slip]
    mesh_doubt: str

    def verdict(self, number) -> str:
        """Say of a parameter whether it is fixed, partly or hardly told, or not at all."""
        if self.parameters[number].name in self.why:
            return "not identifiable"
        share = self.knowledge.shares[number]
        return "fixed" if share < FIXED else "partly" if share < HARDLY else "hardly"

    @property
    def trade_offs(self) -> list[tuple[str, str, float]]:
        """Pairs of parameters whose errors go together, by path, with their correlation."""
        path = [one.name for one in self.parameters]
        return [(path[i], path[j], rho) for i, j, rho in self.knowledge.trade_offs()]


def make_plan(
    blasts, parameters, unit, *, records, candidates=(), levels=None, slip=None, progress=None
) -> Plan:
    """Work out what receivers and blasts can tell of parameters around a point.

    Parameters
    ----------
    blasts : sequence of Project
        The first one holds the table ``[back_analysis]``.
    parameters : tuple of Parameter
    unit : (n,) float64
        The point in the unit cube of the ranges.
    records : sequence of dict of str to Seismogram or None
        For each blast by receiver that counts; None where a record is only foreseen.
    candidates : sequence of Project
        Blasts that could be fired and recorded.
    levels : dict of str to float, optional
        Of the errors of the theory; the usual ones if not given.
    slip : dict of str to Slip, optional
        What slipped in each blast, where that is known; else it is looked for.
    progress : callable, optional
        Called with (stage, done, total).

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        If there is nothing to hear, or a project or its window is wrong.
    SolverError
        If a model can't be run.
    """
    tell = progress or (lambda *_: None)
    everything = [*blasts, *candidates]
    window = window_of(everything)
    counting = list(dict.fromkeys(name for one in records for name in one))
    slowest = min(one.cs for one in blasts[0].materials.values())
    apart = 0.5 * slowest / math.sqrt(window.band[0] * window.band[1])
    places = places_of(everything, counting, apart)
    names = [place.name for place in places]
    noise, told = _noise(blasts, records, names, window)
    heard = np.array([[_heard(n, one, counting) for n in names] for one in records])
    heard = np.concatenate([heard, np.ones((len(candidates), len(names), 3), dtype=bool)])
    heard = heard[..., None]
    motion, changes = _changes(everything, parameters, unit, places, window, tell)
    values = problem_of(parameters).points(unit)
    varied = [with_values(one, parameters, values) for one in everything]
    errors, doubt = mesh_errors_of(varied, motion, names, window, places)
    sensitivities = Sensitivities(
        motion * heard, changes * heard,
        band_functions(window.n_samples, window.dt, window.band), noise,
        {**LEVELS, **(levels or {})}, blasts[0].config.back_analysis.misfit == "paper",
        [one * heard for one in errors],
    )  # fmt: skip
    found, worst, extras = extras_of(sensitivities, parameters, places, blasts, candidates)
    kind = "paper" if sensitivities.peaks_only else "waveform"
    slip = _watched(blasts, parameters, values, tell) if slip is None else slip
    return Plan(
        tuple(parameters), values, kind, found,
        _by_other(sensitivities, len(blasts), counting), _within(parameters, unit, found),
        _why(parameters, blasts, found, slip, kind), extras, worst, tuple(places), apart, window,
        told, levels or {name: level for name, level in LEVELS.items() if errors or name != "mesh"},
        slip, doubt,
    )  # fmt: skip


def foreseen_plan(project, progress=None) -> Plan:
    """Return what the blasts and receivers of a project can tell, in the middle of the ranges.

    Raises
    ------
    InputError
        If the project has no table ``[back_analysis]``, or it names what is not there.
    SolverError
        If a model can't be run.
    """
    parameters = parameters_of(project)
    blasts, candidates = foreseen_blasts(project), candidates_of(project)
    for blast in (*blasts, *candidates):
        check_parameters(blast, parameters)
    records = [foreseen_records(blast, project) for blast in blasts]
    middle = np.full(len(parameters), 0.5)
    return make_plan(
        blasts, parameters, middle, records=records, candidates=candidates, progress=progress
    )


def problem_of(parameters) -> Problem:
    """Return the ranges of parameters as a search sees them."""
    parts = [(one.low, one.high, one.log) for one in parameters]
    return Problem(*zip(*parts, strict=True), lambda points: np.zeros(len(points)))


def _heard(name, records, counting):
    """Tell which components count at a place in a blast, (3,): those recorded, or all foreseen."""
    if name not in counting:
        return np.ones(3, dtype=bool)
    if name not in records:
        return np.zeros(3, dtype=bool)
    return np.ones(3, dtype=bool) if records[name] is None else records[name].present


def _by_other(sensitivities, n_blasts, counting):
    """Return what the other kind of misfit knows of the same motions."""
    other = replace(sensitivities, peaks_only=not sensitivities.peaks_only)
    return other.knowledge(range(n_blasts), range(len(counting)))


def _within(parameters, unit, found):
    """Return the 90 % intervals in the units of the parameters, (n, 2); they reach to the point."""
    ends = intervals(unit, found)
    ends = np.stack([np.minimum(ends[:, 0], unit), np.maximum(ends[:, 1], unit)], axis=-1)
    problem = problem_of(parameters)
    return np.stack([problem.points(ends[:, 0]), problem.points(ends[:, 1])], axis=-1)


def _changes(projects, parameters, unit, places, window, tell):
    """Return motion and its changes by whole ranges: differences inwards, eight side by side."""
    unit = np.asarray(unit, dtype=np.float64)
    sides = np.where(unit > 0.5, -DIFFERENCE, DIFFERENCE)
    points = problem_of(parameters).points(np.vstack([unit, unit + np.diag(sides)]))
    total, found = len(projects) * len(points), []
    for number, project in enumerate(projects):
        heard = listening(project, places)
        step = held_step(heard, parameters)
        side = LANES if step else 1
        motions = []
        for first in range(0, len(points), side):
            tell("plan", number * len(points) + first, total)
            motions += simulate(heard, parameters, points[first : first + side], step)
        found.append(gathered(motions, [place.name for place in places], window))
    found = np.stack(found, axis=1)
    tell("plan", total, total)
    return found[0], (found[1:] - found[0]) / sides[:, None, None, None, None]


def _noise(blasts, records, names, window):
    """Return the noise of all receivers, and where it is from."""
    rms = blasts[0].config.back_analysis.noise_mm_per_s
    there = all(
        record is not None and has_quiet(record, window) for o in records for record in o.values()
    )
    if rms is not None or not there:
        told = "as given" if rms is not None else "assumed"
        rms = NOISE if rms is None else 1e-3 * rms
        return white_noise(rms, len(names), window), f"{1e3 * rms:g} mm/s rms in the band, {told}"
    counting = list(dict.fromkeys(name for one in records for name in one))
    noise = recorded_noise(blasts, records, counting, window)
    level = noise.density(np.linspace(*window.band, 50)).sum(axis=(1, 2))
    take = [counting.index(name) if name in counting else int(np.argmax(level)) for name in names]
    noise = replace(
        noise,
        **{part: getattr(noise, part)[take]
           for part in ("coefficients", "variance", "correlation", "doubt")},
    )  # fmt: skip
    return noise, "of the records before the first firing; new receivers as the noisiest one"


def _watched(blasts, parameters, values, tell):
    """Return what the joints of each blast did, where a strength is asked for."""
    if not any(is_strength(one) for one in parameters):
        return {}
    found = {}
    for project in blasts:
        varied = with_values(project, parameters, values)
        weak = weakest(project, parameters, values)
        run, strength = watched_run(varied.model, varied.duration, input_band(varied), weak, tell)
        ppv = {name: one.ppv for name, one in run.seismograms.items()}
        found[project.path.name] = Slip(strength, ppv)
    return found


def _why(parameters, blasts, found, slip, kind):
    """Say which parameters can't be told at all, and why."""
    why, strengths = {}, [one.strength for one in slip.values()]
    for one, felt in zip(parameters, found.felt, strict=True):
        text = insensitive(one, blasts, strengths) if slip else ""
        if text or not felt:
            why[one.name] = text or UNFELT[kind]
    return why
