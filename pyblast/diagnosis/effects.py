"""Effects: hypotheses with values, and the motion that they change."""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np
from scipy import fft, signal

from ..blasts.hole_effects import HoleChange, together
from ..errors import InputError, contained
from ..ground.tables import quality_of
from ..inference.error_model import ErrorModel
from ..inference.location import Places
from ..inference.nuisances import law_columns
from ..inference.parameter import Parameter, set_all
from ..inference.variation import (
    VARIED,
    Charges,
    FilteredMotion,
    Filters,
    Learned,
    Variation,
    filtered_motion,
    learned_variation,
    variation,
    with_variation,
)
from ..project.project import Project
from ..project.uncertain_ground import factors_of
from ..simulation.recipe import HARMONICS
from ..simulation.simulation import Simulation
from ..units import plain_number
from . import library  # noqa: F401  fills the library
from .calibration import Baseline, attenuated
from .case import Case
from .error import learned_error, with_calibrated
from .forward import (
    StoredFields,
    Surroundings,
    holds,
    stored_fields,
    surroundings,
)
from .hypotheses import (
    FAMILIES,
    LIBRARY,
    Hypothesis,
    blast_and_hole,
    patterns_of,
    superposed,
)
from .thresholds import CARRIED, DEAREST, FEWEST_HOLES, IDEALISED, ORDINARY

WEAKEST = 0.05  # of the largest in its spectrum: a pulse is not divided by less
ORDER = 6  # of the low-pass of harmonics
RUNS, HOLES = "runs", "motion of single holes"  # parts of a diagnosis that may fail


@dataclass(frozen=True)
class Effect:
    """Effect: a hypothesis at a target, with values of its parameters.

    Parameters
    ----------
    name : str
        Name of its hypothesis in the library.
    target : str
        A target of its hypothesis; empty for the whole site.
    values : tuple of tuple of float
        Values of each parameter, in its unit: one, or one for each hole.
    """

    name: str
    target: str
    values: tuple[tuple[float, ...], ...]

    @property
    def hypothesis(self) -> Hypothesis:
        """The entry of the library."""
        return LIBRARY[self.name]

    @property
    def where(self) -> tuple[str, str]:
        """Its name and its target, whatever its values."""
        return self.name, self.target

    @property
    def label(self) -> str:
        """Its name in results, whatever its form."""
        return self.hypothesis.label

    @property
    def parameters(self) -> dict:
        """Values by name: a float, or (n_holes,) float64."""
        pairs = zip(self.hypothesis.parameters, self.values, strict=True)
        return {p.name: np.array(values) if p.per_hole else values[0] for p, values in pairs}


@dataclass(eq=False)
class Scene:
    """Scene: the calibrated site with its records, on which effects are simulated.

    Parameters
    ----------
    simulation : Simulation
    baseline : Baseline
    holes : dict of str to (n_holes, n_receivers, 3, n_samples) float64, m/s
        Motion of each hole with its planned charge, fired at zero, by blast; without blasts whose
        holes do not superpose.
    failures : dict
        Sentences of errors: of effects, by their names and targets; of parts of the diagnosis, by
        the name of the part.
    budget : float, s
        Of the price of all runs.
    others : tuple of Simulation
        Whose runs count, too.
    fields : StoredFields, optional
        Of the calibrated ground; made where they are first asked for.
    """

    simulation: Simulation
    baseline: Baseline
    holes: dict[str, np.ndarray]
    failures: dict[frozenset | str, str] = field(default_factory=dict)
    budget: float = np.inf
    others: tuple[Simulation, ...] = ()
    fields: StoredFields | None = None
    _prices: dict = field(default_factory=dict, repr=False)
    _paid: dict = field(default_factory=dict, repr=False)
    _simulated: dict = field(default_factory=dict, repr=False)
    _corrections: dict = field(default_factory=dict, repr=False)
    _impossible: set = field(default_factory=set, repr=False)
    _beside: tuple = field(default=(None, None), repr=False)

    def __post_init__(self):
        """Store the motion that the calibration has simulated."""
        baseline, shape = self.baseline, self.case.project.geometry
        reference = tuple(np.zeros(len(baseline.values)).tolist()), ()
        for b in range(len(self.case.blasts)):
            self._corrections[shape, b] = baseline.correction[b]
            self._simulated[reference, b] = baseline.reference[b]
            self._simulated[(tuple(baseline.values.tolist()), ()), b] = baseline.motion[b]

    @property
    def case(self) -> Case:
        """The records."""
        return self.baseline.case

    @cached_property
    def surroundings(self) -> Surroundings:
        """Motion around receivers in the calibrated ground, by stored fields or a run per blast."""
        if self.fields is not None:
            return self.fields.surroundings
        return surroundings(self.simulation, self.case, self.baseline.project)

    @property
    def secondary_places(self) -> tuple[Places, Places]:
        """Cells of the rock and patches of the joints of the calibrated ground, with changes."""
        if self.fields is None:
            self.fields = stored_fields(self.simulation, self.case, self.baseline.project)
        return self.fields.rock, self.fields.joints

    @cached_property
    def charges(self) -> dict[int, Charges]:
        """Charges of the blasts with enough holes to show how much they vary, by number."""
        blasts = self.case.project.blasts
        return {
            b: Charges(self.holes[name], blasts[name].times, blasts[name].centres)
            for b, name in enumerate(self.case.blasts) if _many(self.holes.get(name, ()))
        }  # fmt: skip

    @cached_property
    def varied(self) -> Learned | None:
        """Variation from hole to hole, learned before anything else; None without many holes.

        What it does to each record counts as usual from then on.
        """
        baseline, charges = self.baseline, self.charges
        if not charges:
            return None
        band, sigma = self.case.band, baseline.sigma[:, None, None, None, None]
        held = sigma * band.project(baseline.slopes)
        residual = band.project(self.case.residual(baseline.motion))
        residual = residual + np.tensordot(baseline.prior_deviation, held, 1)

        def build(own):
            return with_calibrated(self._error_around(own), held)

        learned = learned_variation(build, charges, band, residual, VARIED)
        usual = baseline.usual + learned.level.value**2 * learned.around.energy
        self.baseline = replace(baseline, usual=np.where(baseline.usual > 0.0, usual, 0.0))
        return learned

    @property
    def filters(self) -> dict[int, Filters]:
        """Filters of charges that were learned without an effect, by number of the blast."""
        return {} if self.varied is None else self.varied.filters

    def filtered(self, filters: Mapping[int, Filters] | None = None) -> FilteredMotion:
        """Return what charges send with filters, by default those learned without an effect."""
        if self.varied is None:
            return FilteredMotion(0.0, {})
        if filters is None or filters is self.varied.filters:
            return self.varied.filtered
        return filtered_motion(self.charges, self.case.band, len(self.case.blasts), filters)

    def radiated(self, name: str, filters: Mapping[int, Filters] | None = None) -> np.ndarray:
        """Return the share of its planned motion that each hole of a blast radiates, (n_holes,).

        By filters of charges, at all receivers together.
        """
        planned, at = self.holes[name], self.case.blasts.index(name)
        varied = self.filtered(filters).charges.get(at, planned)
        alike, energy = (np.einsum("hrct,hrct->h", planned, each) for each in (varied, planned))
        return np.where(energy > 0.0, alike / np.where(energy > 0.0, energy, 1.0), 1.0)

    @cached_property
    def error(self) -> ErrorModel:
        """Learned error of the prediction of the calibrated site, but for what is calibrated."""
        if self.varied is None:
            return self._error_around(FilteredMotion(0.0, {}))
        own = self.varied
        return with_variation(self._error_around(own.filtered), own.around, own.levels)

    def _error_around(self, own):
        """Return the error around the motion that charges send, without their variation."""
        baseline, names = self.baseline, self.case.blasts
        motion = baseline.motion + own.change
        holes = self.holes | {names[b]: each for b, each in own.charges.items()}
        return learned_error(
            self.case, baseline.parameters,
            (motion, baseline.slopes, self.surroundings.slopes(), baseline.correction),
            self._late_holes(holes),
        )  # fmt: skip

    def _late_holes(self, holes):
        """Return the columns of firing times by the motion of each hole, by number of the blast."""
        seconds = 1e-3 * self.case.project.config.priors.firing_ms
        late = {
            b: [self.change_by_holes(name, HoleChange(delay=each), holes[name])
                for each in seconds * np.eye(len(holes[name]))]
            for b, name in enumerate(self.case.blasts)
            if seconds and len(holes.get(name, ())) > 1
        }  # fmt: skip
        return {b: self.seen(np.array(changes)) for b, changes in late.items()}

    def seen(self, change) -> np.ndarray:
        """Return changes of motion (..., 3, n_samples) as valid samples show them, in the band."""
        return self.case.band.project(np.where(self.case.valid, change, 0.0))

    def error_beside(self, effects: Sequence[Effect], values, motion, filters) -> ErrorModel:
        """Return the error of a prediction with effects, that of their laws included.

        Holes vary around what they send with the effects and with filters that were learned beside
        them. Where effects are not those of instruments, the change of motion by them has an error
        of `IDEALISED` of its energy at each record; that of joints that close or slip has as large
        a one, smooth over frequency, that all records share; theory.md (12.9), (14.13).

        Parameters
        ----------
        effects : sequence of Effect
        values : (n_calibrated,) float64
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
            With both.
        filters : mapping of int to Filters
            By number of the blast.
        """
        error, own = self.error, self.varied
        if own is not None and (filters is not own.filters or acting_on(effects, "holes")):
            around = self.variation_beside(effects, filters)
            error = with_variation(error, around, own.levels)
        if all(effect.hypothesis.family == "instrument" for effect in effects):
            return error
        calibrated = np.tensordot(values - self.baseline.values, self.baseline.slopes, 1)
        change = motion - self.baseline.motion - self.filtered(filters).change - calibrated
        blocks, nuisances = error.blocks.beside(change, self.case.band, IDEALISED), error.nuisances
        if not all(effect.hypothesis.linear for effect in effects):
            nuisances = nuisances + law_columns(change, self.case.band, IDEALISED)
        return replace(error, blocks=blocks, nuisances=nuisances)

    def variation_beside(self, effects: Sequence[Effect], filters) -> Variation:
        """Return the variation of what holes send with effects on them, around filters."""
        acting = acting_on(effects, "holes")
        if self._beside[0] != (acting, id(filters)):
            names, shape = self.case.blasts, self.error.nuisances.columns.shape[1:]
            charges = {
                b: replace(own, motion=self._with_holes(acting, names[b]))
                for b, own in self.charges.items()
            }
            around = variation(charges, self.case.band, shape, filters)
            self._beside = (acting, id(filters)), (around, filters)  # its id is then its own
        return self._beside[1][0]

    def _with_holes(self, acting, name):
        """Return the motion of each hole of a blast with effects, fired at zero."""
        holes = self.holes[name]
        pattern = patterns_of(self.case)[self.case.blasts.index(name)]
        changes = [
            e.hypothesis.apply(pattern, e.target, **e.parameters)
            for e in acting if blast_and_hole(e.target)[0] in ("", name)
        ]  # fmt: skip
        return self.changed_holes(holes, together(changes)) if changes else holes

    def changed_holes(self, holes: np.ndarray, changes: HoleChange) -> np.ndarray:
        """Return the motion of holes (n_holes, n_receivers, 3, n_samples) with changes, m/s."""
        size, factor = self._factor(changes, 0.0)
        out = np.empty_like(holes)
        for h, motion in enumerate(holes):
            spectrum = fft.rfft(motion, size) * factor[min(h, len(factor) - 1)][:, None]
            out[h] = fft.irfft(spectrum, size)[..., : self.case.n_samples]
        return out

    def contained(self, effects: Sequence[Effect]) -> AbstractContextManager[None]:
        """Enter an error of effects into the failures in place of raising it; raise one of none."""
        if not effects:
            return nullcontext()
        return contained(self.failures, frozenset(effect.where for effect in effects))

    def project(self, values, effects: Sequence[Effect]) -> Project | None:
        """Return the project with calibrated values and the effects on its site.

        None where effects exclude one another, or holes would lie outside of the model.
        """
        project = changed_site(self.case.project, values, effects, self.baseline.parameters)
        if project is None or not holds(self.simulation, self.case.project, project):
            return None
        return project

    def price(self, values, effects: Sequence[Effect]) -> float:
        """Return the price in s of a run with calibrated values and effects, before it is meshed.

        Zero where the effects are impossible, and of a mesh of a file.
        """
        site = changed_site(self.case.project, values, effects, self.baseline.parameters)
        cost = None if site is None else self.simulation.of(site, self.case.blasts[0]).cost
        return 0.0 if cost is None else cost.seconds

    def simulate(self, states, blasts: Sequence[int] | None = None) -> list[np.ndarray | None]:
        """Simulate sites with effects, by runs that are not stored yet.

        Parameters
        ----------
        states : sequence of (values, effects)
        blasts : sequence of int, optional
            Indices of the blasts that are run, all by default; the others have their records.

        Returns
        -------
        list of (n_blasts, n_receivers, 3, n_samples) float64, m/s, or None
            None where effects are impossible, or cannot be simulated; the failures have the reason.

        Raises
        ------
        InputError, SolverError
            If a run without effects fails.
        """
        blasts = tuple(range(len(self.case.blasts)) if blasts is None else blasts)
        keys = [(tuple(map(float, values)), acting_on(each, "site")) for values, each in states]
        known = [key for key in keys if all((key, b) in self._simulated for b in blasts)]
        projects: dict[tuple, Project | None] = {}
        for key in dict.fromkeys(keys):
            if key not in known and key not in self._impossible:
                with self.contained(key[1]):
                    self._refuse_dear(self.price(*key), 1, key[1])
                    projects[key] = self.project(*key)
        possible = [key for key, project in projects.items() if project is not None]
        together = 1 if self.simulation.executor is None else max(len(possible), 1)  # models held
        for start in range(0, len(possible), together):
            known += self._possible(possible[start : start + together], blasts, projects)
        self._impossible.update(key for key in keys if key not in known)
        return [self._gathered(key, blasts) if key in known else None for key in keys]

    def _possible(self, keys, blasts, projects):
        """Run states and return those that can be simulated; one by one if a run fails."""
        built, controls, failed = {}, {}, {}
        for key in keys:
            with self.contained(key[1]):
                built[key] = self._build(key, blasts, projects[key], controls)
        alone = len(built) == 1
        with self.contained(next(iter(built))[1]) if alone else contained(failed, RUNS):
            self._run(built, controls, projects)
            return list(built)
        return [] if alone else [key for key in built if self._possible([key], blasts, projects)]

    def _build(self, key, blasts, project, controls):
        """Return a state by blasts in which it is not stored, and the shape of its control.

        Mesh controls that are not stored are added to ``controls``, by shape and blast.
        """
        missing = [b for b in blasts if (key, b) not in self._simulated]
        control = self._mesh_control(key[1])
        shape = control.geometry
        states = {b: self.simulation.of(project, self.case.blasts[b]) for b in missing}
        own = {
            (shape, b): self.simulation.of(control, self.case.blasts[b])
            for b in missing
            if (shape, b) not in self._corrections and (shape, b) not in controls
        }
        for state in list(states.values())[:1]:  # blasts and controls share its ground
            self._refuse_dear(self._priced_on_mesh(state), len(states) + len(own), key[1])
        for state in (*states.values(), *own.values()):
            self.simulation.model(state)  # raises where it can't be built
        controls.update(own)
        return states, shape

    def _refuse_dear(self, seconds, number, effects):
        """Refuse a number of runs of a price if they take too much of what the budget leaves.

        That is more than `DEAREST` of it, and than `ORDINARY` times runs of the reference, or those
        made of an effect before: a fit that was begun is ended.
        """
        paid = [self._paid.get(effect.where, 0.0) for effect in effects]
        ordinary = ORDINARY * max([self._priced_on_mesh(self._reference), *paid])
        most = max(DEAREST * (self.budget - self.spent), number * ordinary)
        if number * seconds > most:
            raise InputError(
                f"not computed: its runs take about {plain_number(number * seconds, 2)} s, of the "
                f"budget {plain_number(most, 2)} s are left for it; give more --minutes"
            )

    @cached_property
    def _reference(self):
        """The reference with one blast, as it is run."""
        return self.simulation.of(self.case.project, self.case.blasts[0])

    def _priced_on_mesh(self, state):
        """Return the price in s of a run on the mesh of a state, computed once.

        Planes and surfaces that nearly meet leave zones without end of their time step.
        """
        if state.geometry not in self._prices:
            self._prices[state.geometry] = self.simulation.price(state)
        return self._prices[state.geometry]

    @property
    def spent(self) -> float:
        """Price in s of all runs so far."""
        return sum(each.priced for each in (self.simulation, *self.others))

    def _run(self, built, controls, projects):
        """Run the states that are not stored, together with their mesh controls."""
        required = {(key, b): state for key, (own, _) in built.items() for b, state in own.items()}
        blasts = [self.case.blasts[b] for _, b in (*required, *controls)]
        done = self.simulation.simulate([*required.values(), *controls.values()], blasts)
        for (key, _), state in required.items():
            for effect in key[1]:
                paid = self._paid.get(effect.where, 0.0)
                self._paid[effect.where] = max(paid, self.price(*key), self._priced_on_mesh(state))
        for mesh, motion in zip(controls, done[len(required) :], strict=True):
            self._corrections[mesh] = self.baseline.reference[mesh[1]] - motion
        for (key, b), motion in zip(required, done[: len(required)], strict=True):
            correction = self._corrections[built[key][1], b]
            if quality_of(projects[key].materials) != quality_of(self.case.project.materials):
                before = self.baseline.reference[b] - correction
                band = self.case.band.low, self.case.band.high
                correction = attenuated(correction, before, motion, self.case.dt, band)
            self._simulated[key, b] = self.carried(*key, b, motion + correction)

    def carried(self, values, effects: Sequence[Effect], blasts, motion) -> np.ndarray:
        """Return motion with effects, without the harmonics that its mesh does not carry.

        What joints that close or slip add above `CARRIED` of the frequency up to which a mesh
        carries waves is wrong by as much as it is; theory.md (14.13).

        Parameters
        ----------
        values : (n_calibrated,) float64
        effects : sequence of Effect
        blasts : int or sequence of int
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
            Of these blasts.
        """
        if all(effect.hypothesis.linear for effect in effects):
            return motion
        baseline, case = self.baseline, self.case
        linear = baseline.reference[blasts] + np.tensordot(values, baseline.slopes[:, blasts], 1)
        highest = CARRIED * HARMONICS * case.project.config.band_hz[1]
        sections = signal.butter(ORDER, highest, fs=1.0 / case.dt, output="sos")
        return linear + signal.sosfiltfilt(sections, motion - linear)

    def _mesh_control(self, effects):
        """Return the reference project with the mesh of effects, but without the effects.

        Hexahedra need none: another grid of them changes less than the model error.
        """
        reference = project = self.case.project
        for effect in effects:
            control = effect.hypothesis.mesh_control
            if control is not None:
                project = control(project, effect.target, **effect.parameters)
        alike = project is not reference and reference.mesh.hexahedral and project.mesh.hexahedral
        return reference if alike else project

    def _gathered(self, key, blasts):
        """Return the motion of one state; records in blasts that were not asked for."""
        return np.stack(
            [
                self._simulated[key, b] if b in blasts else self.case.motion[b]
                for b in range(len(self.case.blasts))
            ]
        )

    def received(
        self, motion: np.ndarray, effects: Sequence[Effect], charges: Mapping | None = None
    ) -> np.ndarray:
        """Return simulated motion with effects on holes and on motion, the same shape, m/s.

        Parameters
        ----------
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        effects : sequence of Effect
        charges : mapping of int to (n_holes, n_receivers, 3, n_samples) float64, m/s, optional
            What each hole sends, by number of the blast; as it was learned by default.

        Raises
        ------
        InputError
            If it is not finite.
        """
        for effect in acting_on(effects, "holes"):
            motion = motion + self._by_holes(effect, charges)
        motion = with_motion_effects(self, motion, effects)
        if not np.isfinite(motion).all():
            raise InputError("its motion is not a finite number at every receiver")
        return motion

    def _by_holes(self, effect, charges):
        """Return the change of motion by an effect on the holes of one blast, or of all."""
        if HOLES in self.failures and superposed in effect.hypothesis.simulated:
            raise InputError(f"{HOLES}: {self.failures[HOLES]}")
        own, _ = blast_and_hole(effect.target)
        charges = self.filtered().charges if charges is None else charges
        return sum(
            self.change_by_holes(
                name, effect.hypothesis.apply(pattern, effect.target, **effect.parameters),
                charges.get(b, self.holes.get(name)),
            )
            for b, (name, pattern) in enumerate(
                zip(self.case.blasts, patterns_of(self.case), strict=True)
            )
            if own in ("", name)
        )  # fmt: skip

    def change_by_holes(
        self, name: str, changes: HoleChange, holes: np.ndarray | None
    ) -> np.ndarray:
        """Return the change of motion by changes of what the holes of a blast send.

        Parameters
        ----------
        name : str
        changes : HoleChange
            Of each hole, or of each hole and receiver.
        holes : (n_holes, n_receivers, 3, n_samples) float64, m/s, or None
            Motion of each, fired at zero; None where it is unknown and all change alike.

        Returns
        -------
        (n_blasts, n_receivers, 3, n_samples) float64, m/s
        """
        blast, at = self.case.project.blasts[name], self.case.blasts.index(name)
        times, n = blast.times, self.case.n_samples
        if holes is None:  # all holes have the same delay and scale
            holes, times = self.baseline.motion[[at]], np.zeros(1)
            changes = HoleChange(*(np.ravel(each)[:1] for each in changes))
        size, factor = self._factor(changes, np.max(times))
        omega = 2.0 * np.pi * fft.rfftfreq(size, self.case.dt)
        fired = np.exp(-1j * np.multiply.outer(times, omega))[:, None] * (factor - 1.0)
        total = np.zeros((*holes.shape[1:3], len(omega)), dtype=complex)
        for each, motion in zip(fired, holes, strict=True):
            if np.any(each):
                total += fft.rfft(motion, size) * each[:, None]
        change = np.zeros((len(self.case.blasts), *holes.shape[1:]))
        change[at] = fft.irfft(total, size)[..., :n]
        return change

    def _factor(self, changes, latest):
        """Return a length of transforms without wrap-around, and the factor on what holes send."""
        n, dt = self.case.n_samples, self.case.dt
        latest = int((latest + np.max(changes.delay, initial=0.0)) / dt) + 1
        size = fft.next_fast_len(n + max(n, latest), real=True)
        return size, self.factor(changes, 2.0 * np.pi * fft.rfftfreq(size, dt))

    def factor(self, changes: HoleChange, omega: np.ndarray) -> np.ndarray:
        """Return the factor (n_holes, n_receivers or 1, n_omega) of changes at omega in rad/s."""
        band = self.case.band
        middle = 2.0 * np.pi * np.sqrt(max(band.low, 0.1) * band.high)
        pulse = self._pulse(omega) if np.any(changes.duration) else 0.0
        return changes.factor(omega, middle, pulse)

    def _pulse(self, omega):
        """Return the derivative of ln S by ln f of the pulse S of a hole, (n_omega,) complex128."""
        rate = self.case.project.shots[0].inside.moment_rate
        times = rate.dt * np.arange(len(rate.values))
        waves = np.exp(-1j * np.multiply.outer(omega, times))
        spectrum, slope = waves @ rate.values, waves @ (-1j * times * rate.values)
        least = WEAKEST * np.max(np.abs(spectrum))
        weak = np.conj(spectrum) / np.maximum(np.abs(spectrum) ** 2, least**2)
        return omega * slope * weak


def _many(holes):
    """Tell whether enough holes send anything, so that they show how much they vary."""
    return sum(bool(np.any(motion)) for motion in holes) >= FEWEST_HOLES


def starting_effects(hypothesis: Hypothesis, target: str, scene: Scene) -> list[Effect]:
    """Return an effect at each starting value of its parameters."""
    blasts, from_residual = scene.case.project.blasts, ()
    n_holes = len(blasts[target].times) if target in blasts else 1
    if hypothesis.begins is not None:
        with contained({}, f"a starting value of {hypothesis.name}"):
            from_residual = (hypothesis.begins(scene),)
    starts = product(*[parameter.starts for parameter in hypothesis.parameters])
    return [
        Effect(
            hypothesis.name,
            target,
            tuple(
                (value,) * (n_holes if parameter.per_hole else 1)
                for parameter, value in zip(hypothesis.parameters, values, strict=True)
            ),
        )
        for values in (*starts, *from_residual)
    ]


def with_motion_effects(
    scene: "Scene | PredictionScene", motion: np.ndarray, effects: Sequence[Effect]
) -> np.ndarray:
    """Apply the effects that act on motion, at the receivers of a scene.

    Parameters
    ----------
    scene : Scene or PredictionScene
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    effects : sequence of Effect

    Returns
    -------
    (n_blasts, n_receivers, 3, n_samples) float64, m/s
    """
    for effect in acting_on(effects, "motion"):
        motion = effect.hypothesis.apply(scene, motion, effect.target, **effect.parameters)
    return motion


def acting_on(effects, on):
    """Return the effects on site, holes or motion, in the order in which they act.

    From source over path and receiver to instrument; within a family in the order of the library.
    """
    order = list(LIBRARY)
    acting = [effect for effect in effects if effect.hypothesis.on == on]
    return tuple(
        sorted(acting, key=lambda e: (FAMILIES.index(e.hypothesis.family), order.index(e.name)))
    )


def of_all_holes(effects: Sequence[Effect]) -> list[Effect]:
    """Return the effects on holes that act on those of each blast of the site, in their order."""
    return [each for each in effects if each.hypothesis.on == "holes" and not each.target]


def changed_site(
    project: Project, values, effects: Sequence[Effect], factors: Sequence[Parameter] | None = None
) -> Project | None:
    """Return a project with calibrated values and the effects on its site.

    None where effects exclude one another. Effects that are not linear have a mesh that carries
    harmonics of the band that is compared, see `Project.sized_for_band`.

    Parameters
    ----------
    project : Project
        The reference.
    values : (n,) float
        Logarithms of factors on the values of the reference.
    effects : sequence of Effect
    factors : sequence of n Parameter, optional
        By default `factors_of` the project, none without values.
    """
    if factors is None:
        factors = factors_of(project) if len(values) else ()
    site = set_all(project, factors, np.exp(values))
    for effect in acting_on(effects, "site"):
        if site is not None:
            site = effect.hypothesis.apply(site, effect.target, **effect.parameters)
    band = project.config.band_hz
    if site is None or band is None or all(each.hypothesis.linear for each in effects):
        return site
    if not project.meshed.mesh.hexahedral:
        return site
    return site.changed(mesh=site.sized_for_band(band[1]))


@dataclass(eq=False)
class PredictionScene:
    """Scene of a prediction: the receivers of a case, a further blast, and motion around them.

    Parameters
    ----------
    simulation : Simulation
    case : Case
        The receivers and the further blast, in the reference ground of the fitted effects.
    project : Project
        As diagnosed, with the further blast.
    """

    simulation: Simulation
    case: Case
    project: Project

    @cached_property
    def surroundings(self) -> Surroundings:
        """Motion around the receivers."""
        return surroundings(self.simulation, self.case, self.project)


def effects_of(table: Mapping) -> tuple[Effect, ...]:
    """Return the effects of the entry ``model`` of ``diagnosis.json``."""
    return tuple(
        Effect(entry["name"], entry["target"], tuple(map(tuple, entry["values"])))
        for entry in table["effects"]
    )
