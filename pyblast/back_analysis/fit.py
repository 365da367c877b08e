"""Fit of waveforms: Gauss-Newton over what is looked for and what is held, one run a step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..errors import InputError, PyblastError
from ..inference.covariance import record_blocks
from ..inference.error_model import NORMAL_95, ErrorModel, Level, Levels, Posterior
from ..inference.fit import ENOUGH, Coordinates, FitState, minimise, step_of
from ..inference.nuisances import Linearised, nuisances_of
from ..inference.parameter import (
    DENSITY,
    GEOMETRY,
    SPEED,
    STIFFNESS,
    Parameter,
    Spent,
    set_all,
)
from ..inference.records import Records, band_functions
from ..inference.variation import (
    FEWEST,
    ROUNDS,
    VARIED,
    charges_of,
    filtered_motion,
    filters_of,
    no_filters,
    variation,
    with_variation,
)
from ..project.places import firings_of, on_ground
from ..project.project import Project
from ..project.uncertain_ground import held_beside, sought_in
from ..simulation.estimate import cost_of
from ..simulation.recipe import BETTER
from ..simulation.simulation import Simulation
from .waveforms import remaining

ALL_LEVELS = Levels(
    scatter=(3e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 3e-1),
    coda=(1e-5, 4e-4),
    transfer=(1e-5, 1e-3, 1e-2, 1e-1),
    ground=(0.5, 1.0, 2.0),
    holes=VARIED[:4],
)
FEW_LEVELS = ALL_LEVELS._replace(  # while a search is on its way
    scatter=(1e-4, 1e-3, 1e-2, 1e-1), coda=(1e-5,), holes=(0.0, 0.2)
)
PROBE = 0.04  # of the shortest wavelength: how far beside a receiver its slopes are taken
# Two programs that solve the same model agree to this, measured where neither knew a truth:
# docs/quality/intervals.md.
PROGRAMS = {"cp": 0.006, "cs": 0.003, "kn": 0.05, "ks": 0.05}
LONGEST = {SPEED: 0.06, STIFFNESS: 0.7}  # step of a coordinate
LONGEST_OTHER = 0.5
HALF = 0.5  # of the energy: more that remains asks for a second start
EXPECTED_STEPS = 3
LAST_STEPS = 3  # by all levels
WORSE = 1.1, 0.02  # factor on the energy that remains, and more, at which a step is shortened
LACK = 0.01  # of the energy: more model error than this means that the model lacks something
WORK_OF_BETTER = 3.5  # of a run on the better mesh, over one on the working mesh


class _Trial(NamedTuple):
    """Trial: coordinates of all properties, accuracy of the mesh, probes beside receivers."""

    purpose: str
    at: np.ndarray
    better: bool = False
    probes: bool = False


def on_mesh_of_band(blasts: Sequence[Project], highest: float) -> tuple[Project, ...]:
    """Return blasts on one mesh for motion up to a frequency in Hz."""
    spans, meshed = {}, []
    for blast in blasts:
        tables = blast.config.mesh.model_dump_json(), blast.config.ground.model_dump_json()
        span = spans.setdefault(tables, blast.reach)
        blast = replace(blast, meshes=blasts[0].meshes, span=span)
        meshed.append(blast.changed(mesh=blast.for_band(highest)))
    return tuple(meshed)


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit of waveforms.

    Parameters
    ----------
    blasts : tuple of Project
        On the mesh of the fit.
    properties : tuple of n Parameter
        Those looked for, then those held.
    x : (n,) float64
        Coordinates of the last run.
    posterior : Posterior
        Of all properties, then amplitude and 1/Q; coordinates less prior means.
    converged : bool
    last_step : float
        Largest step of a property looked for that remains, in posterior deviations.
    remaining : float
        Share of the energy of the records that the last run leaves.
    starts : int
    seconds : float
        Of computing, of all runs.
    runs : int
    left_out : dict of str to str
        Held properties that are taken as known, and why.
    trace : tuple of dict
        A row for each step of the search: coordinates and share of the energy that remains.
    """

    blasts: tuple[Project, ...]
    properties: tuple[Parameter, ...]
    x: np.ndarray
    posterior: Posterior
    converged: bool
    last_step: float
    remaining: float
    starts: int
    seconds: float
    runs: int
    left_out: dict[str, str]
    trace: tuple[dict, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of the posterior."""
        return (*(each.name for each in self.properties), "amplitude", "1/Q")

    @property
    def sought(self) -> tuple[int, ...]:
        """Numbers of the properties that are looked for."""
        return tuple(n for n, each in enumerate(self.properties) if each.uniform)

    @property
    def lacking(self) -> bool:
        """Whether the learned model error is more than good ground and mesh explain."""
        return self.posterior.level > LACK

    def coordinates(self) -> np.ndarray:
        """Return the posterior means of the properties, (n,); of those looked for in range."""
        values = self.posterior.mean[: len(self.properties)]
        values = values + [each.prior[0] for each in self.properties]
        low, high = np.array([each.range for each in self.properties]).T
        return np.clip(values, low, high)

    def deviations(self) -> np.ndarray:
        """Return the standard deviations of the properties, (n,), that of programs included."""
        own = self.posterior.deviation[: len(self.properties)]
        return np.hypot(own, [_of_programs(each) for each in self.properties])

    def values(self) -> dict[str, float]:
        """Return the best values of the parameters, in the units of their keys."""
        at = self.coordinates()
        return {self.properties[n].name: float(self.properties[n].at(at[n])) for n in self.sought}

    def intervals(self) -> dict[str, tuple[float, float]]:
        """Return the 90 % intervals of the parameters, within their ranges."""
        at, half = self.coordinates(), NORMAL_95 * self.deviations()
        rows = {}
        for n in self.sought:
            each = self.properties[n]
            ends = (float(each.at(at[n] + side * half[n])) for side in (-1.0, 1.0))
            rows[each.name] = tuple(min(max(end, each.low), each.high) for end in ends)
        return rows

    def ratios(self) -> dict[str, float]:
        """Return the ratio of posterior to prior standard deviation of the parameters."""
        ratio = self.deviations() / [each.prior[1] for each in self.properties]
        return {self.properties[n].name: min(1.0, float(ratio[n])) for n in self.sought}

    def trade_offs(self, least: float = 0.5) -> list[tuple[str, str, float]]:
        """Return pairs of parameters with a strong posterior correlation, the strongest first."""
        deviation = self.posterior.deviation
        correlation = self.posterior.covariance / np.outer(deviation, deviation)
        pairs = [
            (self.names[i], self.names[j], float(correlation[i, j]))
            for i, j in combinations(self.sought, 2)
        ]
        return sorted((p for p in pairs if abs(p[2]) >= least), key=lambda pair: -abs(pair[2]))

    def influences(self) -> list[dict]:
        """Return for each parameter what the held properties do to it, the strongest first."""
        held = [n for n in range(len(self.names)) if n not in self.sought]
        shares = self.posterior.shares_of_variance(self.sought, held)
        shifts = self.posterior.shifts_if_held(self.sought, held)
        return [
            {
                "parameter": self.names[n],
                "held": sorted(
                    (
                        {"name": self.names[h], "share": float(share), "shift": float(shift)}
                        for h, share, shift in zip(held, shares[row], shifts[row], strict=True)
                    ),
                    key=lambda each: -each["share"],
                ),
            }
            for row, n in enumerate(self.sought)
        ]


def _of_programs(each):
    """Return by how much two programs differ in a property."""
    key = each.name.rpartition(".")[-1][:2]
    return PROGRAMS.get(key, 0.0) if each.kind in LONGEST and each.relative else 0.0


class Fitter:
    """Fit of the waveforms of a survey, a problem of `minimise`; no run is repeated.

    Parameters
    ----------
    blasts : tuple of Project
        On the mesh of `on_mesh_of_band`.
    records : Records
        What the fit compares.
    parameters : sequence of Parameter
    limit : int
        Evaluations at most; each is one run of every blast.
    folder : path, optional
        Of stored runs.
    executor : Executor, optional
        As of `run_all`.
    progress : callable, optional
        Called with ("trials", done, expected).
    report : callable, optional
        Gets each row of the log.
    written : callable, optional
        Gets the `Fit` after every step.
    """

    def __init__(self, blasts: tuple[Project, ...], records: Records, parameters, limit: int,
                 folder=None, executor=None, progress=None, report=None, written=None):  # fmt: skip
        self.blasts, self.records, self.limit = blasts, records, limit
        self.simulation = Simulation(
            tuple(blast.path.name for blast in blasts), records.receivers, records.dt,
            records.n_samples, max(blast.duration for blast in blasts), folder, executor,
            injected=True,
        )  # fmt: skip
        self.report, self.written = report or (lambda _: None), written or (lambda _: None)
        self.progress = progress or (lambda *_: None)
        first = blasts[0]
        everything = (*sought_in(first, parameters), *held_beside(first, parameters))
        self.properties, self.priors = everything, first.config.priors
        self.left_out: dict[str, str] = {}
        self.coordinates = Coordinates(
            *np.array([each.prior for each in everything]).T,
            *np.array([each.range for each in everything]).T,
            np.array([LONGEST.get(each.kind, LONGEST_OTHER) for each in everything]),
            np.array([each.moves for each in everything]),
            np.array([each.uniform for each in everything]),
            np.array([_of_programs(each) for each in everything]),
        )  # fmt: skip
        self.renews = False
        self.compared, self.levels = records, FEW_LEVELS  # in the band that is fitted
        self.correction = self.change = np.zeros(0)
        self.has_better = first.refined(BETTER) is not None
        if not self.has_better:
            self.left_out["the error of the mesh"] = "a mesh that is given is not made finer"
        self.trace: list[dict] = []
        self.count = self.starts = 0
        self.seconds = 0.0
        self.aside = np.zeros(0)  # slopes of the motion by east and north, 1/s

    @property
    def expected(self) -> int:
        """Evaluations that a search needs if it ends after three steps."""
        return sum(self.expected_by_mesh)

    @property
    def expected_by_mesh(self) -> tuple[int, int]:
        """Those on the working mesh, and on the better one."""
        speeds = sum(each.kind == SPEED for each in self.properties)
        differences = sum(each.kind != DENSITY for each in self.properties)
        return 1 + differences + EXPECTED_STEPS, (1 + speeds) * self.has_better

    def fit(self) -> Fit:
        """Search from the values of the project file, and again where this does not end well.

        The second start fits the lower third of the band first.

        Raises
        ------
        InputError
            If fewer runs are allowed than the derivatives need.
        SolverError
            If a run fails.
        """
        needed = self.expected - EXPECTED_STEPS
        if self.limit < needed:
            raise InputError(
                f"back_analysis.runs: must be at least {needed} for the derivatives by what is "
                f"looked for and held, got {self.limit}"
            )
        start = self._first(np.zeros(len(self.properties)))
        low, high = self.records.band.low, self.records.band.high
        first = self._minimised(start.copy(), self.records)
        if first.converged and first.remaining < HALF:
            return first
        try:
            state = start.copy()
            self._minimised(state, _in_band(self.records, (low, low + (high - low) / 3.0)))
            second = self._minimised(state, self.records)
        except (Spent, InputError):  # a band too narrow for the window
            return replace(first, starts=self.starts)
        better = second.posterior.log_evidence > first.posterior.log_evidence
        return replace(second if better else first, starts=self.starts)

    def seconds_of_run(self) -> float:
        """Return the estimated processor seconds of one evaluation."""
        models = ((self.simulation.model(blast), blast.duration) for blast in self.blasts)
        return sum(cost_of(*each).seconds for each in models)

    def _run(self, trials: Sequence[_Trial]) -> list[np.ndarray]:
        """Run trials side by side; return motion (n_blasts, n_receivers, 3, n_samples) of each."""
        if self.count + len(trials) > self.limit:
            raise Spent
        if not trials:
            return []
        states = [self._state(trial, blast) for trial in trials for blast in self.blasts]
        probed = [trial.probes for trial in trials for _ in self.blasts]
        models = map(self._model, states, probed)
        pairs = list(zip(states, self.simulation.run(list(models)), strict=True))
        answers, n = [], len(self.blasts)
        for k, trial in enumerate(trials):
            done = pairs[k * n : (k + 1) * n]
            motion = self._sampled(done)
            if trial.probes:
                self.aside = self._of_probes(done)
            seconds = sum(run.wall_seconds for _, run in done)
            self.count, self.seconds = self.count + 1, self.seconds + seconds
            named = zip(self.properties, trial.at, strict=True)
            self.report(
                {
                    "number": self.count,
                    "purpose": trial.purpose,
                    "coordinates": {each.name: float(x) for each, x in named if x},
                    "misfit": remaining(self.records, motion),
                    "wall_seconds": seconds,
                    "stored": all(run.from_cache for _, run in done),
                }
            )
            answers.append(motion)
        self.progress("trials", self.count, max(self.expected, self.count))
        return answers

    def _state(self, trial, blast):
        """Return a blast at the coordinates of a trial."""
        values = [each.at(x) for each, x in zip(self.properties, trial.at, strict=True)]
        return set_all(blast, self.properties, values).suited(trial.better)

    def _model(self, state, probed):
        """Return the model of a blast, with probes beside its receivers if wanted."""
        model = self.simulation.model(state)
        return replace(model, receivers=(*model.receivers, *self._probes(state, probed)))

    def _sampled(self, done, side=""):
        """Return the motion of the runs of all blasts, of probes to one side if one is given."""
        names = [f"{name} {side}" if side else name for name in self.records.receivers]
        sampled = self.simulation.sampled
        return np.stack([sampled(run.seismograms, each.lead, names) for each, run in done])

    def _probes(self, state, probed):
        """Yield receivers to the west, east, south and north of those with records, if wanted."""
        aside = self._apart() * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
        for receiver in state.model.receivers if probed else ():
            if receiver.name in self.records.receivers:
                at = np.asarray(receiver.position, dtype=float)
                for name, step in zip("wesn", aside, strict=True):
                    position = _beside(state.mesh, at, step)
                    yield replace(receiver, name=f"{receiver.name} {name}", position=position)

    def _apart(self):
        """Return how far probes stand beside their receivers, m."""
        slowest = min(rock.cs for rock in self.blasts[0].materials.values())
        return PROBE * slowest / self.records.band.high

    def _of_probes(self, done):
        """Return the slopes of the motion from that of the probes."""
        west, east, south, north = (self._sampled(done, side) for side in "wesn")
        return np.array([east - west, north - south]) / (2.0 * self._apart())

    def _first(self, x):
        """Return the state at the start: reference, better run, and all derivatives."""
        trials = [_Trial("reference", x, probes=True)]
        trials += [_Trial("better mesh", x, better=True)] * self.has_better
        base, *others = self._run(trials)
        better = others[0] if others else base
        self.correction = better - base
        self.change = np.zeros((len(self.properties), *base.shape))
        state = FitState(x, base, np.zeros_like(self.change))
        self.derive(state, base)
        speeds = [n for n, each in enumerate(self.properties) if each.kind == SPEED]
        speeds = speeds if self.has_better else []
        trials = [
            _Trial(f"{self.properties[n].name}, better mesh", self._beside(x, n), better=True)
            for n in speeds
        ]
        for n, motion in zip(speeds, self._run(trials), strict=True):
            step = self._beside(x, n)[n] - x[n]
            self.change[n] = (motion - better) / step - state.slopes[n]
            state.slopes[n] += self.change[n]
        for n, each in enumerate(self.properties):
            if each.kind == GEOMETRY:
                state.slopes[n] = self._by_geometry(n, x, base)
        state.motion = base + self.correction
        left_over = remaining(self.records, state.motion)
        self.trace.append({"coordinates": x.tolist(), "remaining": left_over})
        return state

    def _beside(self, x, n):
        """Return the coordinates of the difference by a property, within its range."""
        step = self.properties[n].step
        other = x.copy()
        other[n] += step if x[n] + step <= self.coordinates.high[n] else -step
        return other

    def derive(self, state: FitState, base: np.ndarray | None = None) -> None:
        """Take the derivatives around a state anew, by its plain run if that is not given."""
        if base is None:
            base = self._run([_Trial("reference", state.x)])[0]
        moving = np.flatnonzero(self.coordinates.moves)
        trials = [_Trial(self.properties[n].name, self._beside(state.x, n)) for n in moving]
        for n, motion in zip(moving, self._run(trials), strict=True):
            step = self._beside(state.x, n)[n] - state.x[n]
            state.slopes[n] = (motion - base) / step + self.change[n]
        for n, each in enumerate(self.properties):
            if each.kind == DENSITY:  # exact by scaling: u(rho, k) = u(1, k / rho) / rho
                inside = self.blasts[0].config.signature is None
                stiff = [m for m, p in enumerate(self.properties) if p.kind == STIFFNESS]
                state.slopes[n] = -np.sum(state.slopes[stiff], axis=0) - inside * base

    def _by_geometry(self, n, x, base):
        """Return the derivative by a property of the geometry; zero where it can't be had."""
        each = self.properties[n]
        trial = _Trial(each.name, self._beside(x, n))
        try:
            for blast in self.blasts:
                mesh = self._state(trial, blast).mesh
                if mesh.hexahedral != blast.mesh.hexahedral:
                    raise InputError("its mesh has other elements")
            motion = self._run([trial])[0]
        except PyblastError as error:
            self.left_out[each.name] = str(error)
            return np.zeros_like(base)
        return (motion - base) / each.step

    def _minimised(self, state, records) -> Fit:
        """Fit records from a state, which moves to where this ends."""
        self.starts, self.compared = self.starts + 1, records
        self.levels = FEW_LEVELS
        minimise(self, state)
        self.levels = ALL_LEVELS
        return self._result(state, minimise(self, state, LAST_STEPS))

    def simulated(self, x: np.ndarray) -> np.ndarray:
        """Return the motion at coordinates (n,), by a run of each blast."""
        plain = self._run([_Trial("step", x)])[0]
        return plain + self.correction + np.tensordot(x, self.change, 1)

    def worsened(self, before: FitState, after: FitState) -> bool:
        """Tell whether a state explains much less of the energy than the one before."""
        most = WORSE[0] * remaining(self.records, before.motion) + WORSE[1]
        return remaining(self.records, after.motion) >= most

    def reached(self, state: FitState, posterior: Posterior) -> None:
        """Note a state in the trace, and write what is known."""
        left_over = remaining(self.records, state.motion)
        self.trace.append({"coordinates": state.x.tolist(), "remaining": left_over})
        self.written(self._result(state, posterior))

    def ended(self, reason: str) -> None:
        """Enter why no further step could be taken."""
        self.left_out["what a further step would change"] = reason

    def posterior(self, state: FitState) -> Posterior:
        """Return the posterior of all properties, then of amplitude and 1/Q, around a state."""
        records, band = self.compared, self.compared.band
        around = Linearised(
            state.motion, state.slopes, tuple(each.kind for each in self.properties), self.aside,
            self.correction,
        )  # fmt: skip
        firings = [firings_of(blast, self.records.receivers) for blast in self.blasts]
        nuisances, lost = nuisances_of(around, firings, band, self.priors)
        error = ErrorModel(record_blocks(records, state.motion), nuisances, self.levels)
        slopes = band.project(state.slopes)
        residual = band.project(records.motion - state.motion)
        error, residual = self._varied(error, residual, state, firings)
        residual = residual + np.tensordot(state.x - self.coordinates.mean, slopes, 1)
        columns = np.concatenate([slopes, band.project(state.motion)[None], lost[None]])
        own = 0.01 * self.priors.amplitude_percent, self.priors.inverse_q
        return error.posterior(residual, columns, np.array([*self.coordinates.deviation, *own]))

    def _varied(self, error, residual, state, firings):
        """Return an error and a residual with holes that vary around their most probable filters.

        These are learned at the last steps, by the parts of the holes in the motion; theory.md
        (12.6), (12.9).
        """
        records, band = self.compared, self.compared.band
        charges, blasts = {}, [blast.blast for blast in self.blasts]
        for b, (fired, own) in enumerate(zip(firings, blasts, strict=True)):
            if fired is None or own is None:
                continue
            if np.count_nonzero(fired.weights) >= FEWEST:
                charges[b] = charges_of(state.motion[b], fired, own.centres, records.dt)
        if not charges:
            return replace(error, levels=error.levels._replace(holes=(0.0,))), residual
        filters = no_filters(charges)
        for rounds in range(0 if self.levels is FEW_LEVELS else ROUNDS, -1, -1):
            own = variation(charges, band, residual.shape, filters)
            change = filtered_motion(charges, band, len(residual), filters).change
            whole = with_variation(error, own, error.levels.holes)
            rest = residual - band.project(change)
            at, *known = whole.most_probable(rest) if rounds else (Level(0.0),)
            if at.holes == 0.0:
                break
            filters = filters_of(own, charges, whole, at, *known)
        return whole, rest

    def _result(self, state, posterior) -> Fit:
        """Return the fit at a state."""
        _, size = step_of(self, state, posterior)
        return Fit(
            self.blasts,
            self.properties,
            state.x.copy(),
            posterior,
            size < ENOUGH,
            size,
            remaining(self.records, state.motion),
            self.starts,
            self.seconds,
            self.count,
            dict(self.left_out),
            tuple(self.trace),
        )


def _beside(mesh, at, aside):
    """Return a position beside another, as deep below the surface."""
    moved = np.add(at, (*aside, 0.0))
    if "top" in mesh.surfaces:
        try:
            depth = on_ground(mesh, tuple(at[:2]))[2] - at[2]
            moved[2] = on_ground(mesh, tuple(moved[:2]))[2] - depth
        except InputError:  # beyond the edge: no slope to that side
            return tuple(at.tolist())
    return tuple(moved.tolist())


def _in_band(records: Records, band) -> Records:
    """Return records compared in another band."""
    valid = None if records.valid.all() else records.valid
    return replace(records, band=band_functions(records.n_samples, records.dt, band, valid))
