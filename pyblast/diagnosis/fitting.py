"""Fits of effects together with the calibrated parameters, under the error that is learned."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np

from ..inference.error_model import ErrorModel, Posterior
from ..inference.fit import Coordinates, FitState, minimise
from ..inference.variation import ROUNDS, Filters, filters_of
from .effects import Effect, Scene
from .error import gained
from .thresholds import LARGE

DIFFERENCE = 0.1  # of a prior standard deviation, for derivatives
STILL = 0.2  # levels: filters that move less are not learned anew
LONGEST = 1.5  # prior standard deviations that a parameter of an effect may go in one round


class Fitter:
    """Standardised parameters of a set of effects: those of the calibration, then of the effects.

    A problem of `minimise`.

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    reference : (n_calibrated,) float64
        Values of the calibrated parameters at which runs are made; the motion at other values
        follows from the slopes of the baseline.
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        What a finer mesh adds to every simulation.
    longest : float, optional
        Prior standard deviations that a parameter of an effect may go in one step.
    filters : mapping of int to Filters, optional
        Of charges; those that were learned without an effect by default.
    """

    def __init__(
        self, scene: Scene, effects: Sequence[Effect], reference, shift=0.0, longest=LONGEST,
        filters=None,
    ):  # fmt: skip
        self.scene, self.effects = scene, tuple(effects)
        self.reference, self.shift = np.asarray(reference), shift
        self.sigma = scene.baseline.sigma
        self.error: ErrorModel = scene.error
        self._vary(scene.filters if filters is None else filters)
        self.reasons: list[str] = []
        self.parameters = [
            (number, order, index, parameter)
            for number, effect in enumerate(self.effects)
            for order, parameter in enumerate(effect.hypothesis.parameters)
            for index in range(len(effect.values[order]))
        ]
        ends = [
            [each.standardised(end) if np.isfinite(end) else end for end in (each.low, each.high)]
            for *_, each in self.parameters
        ]
        n_calibrated, n_own = len(self.sigma), len(self.parameters)
        free = np.full((n_calibrated, 2), (-np.inf, np.inf))
        low, high = np.concatenate([free, np.reshape(ends, (n_own, 2))]).T
        own = np.arange(n_calibrated + n_own) >= n_calibrated
        self.coordinates = Coordinates(
            np.zeros(len(own)), np.ones(len(own)), low, high, np.where(own, longest, np.inf),
            np.ones(len(own), bool), own if n_own else ~own, np.zeros(len(own)),
        )  # fmt: skip
        by_runs = [self.effects[e].hypothesis.on == "site" for e, *_ in self.parameters]
        self.by_runs = np.array([False] * n_calibrated + by_runs, dtype=bool)
        self.renews = not self.by_runs.any()

    def _vary(self, filters):
        """Let charges send what filters make of them."""
        self.filters, self.filtered = filters, self.scene.filtered(filters)

    def start(self) -> np.ndarray:
        """Return the parameters of the reference and of the effects as they were given."""
        standardised = [
            parameter.standardised(self.effects[e].values[p][i])
            for e, p, i, parameter in self.parameters
        ]
        return np.concatenate([self.reference / self.sigma, standardised])

    def values_at(self, x) -> tuple[np.ndarray, tuple[Effect, ...]]:
        """Return the values of the calibrated parameters and the effects."""
        n = len(self.sigma)
        changed = [[list(values) for values in effect.values] for effect in self.effects]
        for (e, p, i, parameter), standardised in zip(self.parameters, x[n:], strict=True):
            changed[e][p][i] = float(parameter.value(standardised))
        effects = tuple(
            Effect(effect.name, effect.target, tuple(map(tuple, values)))
            for effect, values in zip(self.effects, changed, strict=True)
        )
        return self.sigma * x[:n], effects

    def motions(self, points) -> list[np.ndarray | None]:
        """Return the motion at parameters; runs are made only for effects on the site.

        Calibrated parameters change it along the slopes of the baseline. None where an effect is
        impossible or fails.
        """
        states = [self.values_at(x) for x in points]
        runs = self.scene.simulate([(self.reference, effects) for _, effects in states])
        motions = []
        for (values, effects), run in zip(states, runs, strict=True):
            if run is None:
                motions.append(None)
                continue
            slopes = self.scene.baseline.slopes
            run = run + np.tensordot(values - self.reference, slopes, 1)
            run = run + self.shift + self.filtered.change
            received = None
            with self.scene.contained(effects):
                received = self.scene.received(run, effects, self.filtered.charges)
            motions.append(received)
        return motions

    def simulated(self, x: np.ndarray) -> np.ndarray | None:
        """Return the motion at parameters (n,), None where an effect is impossible or fails."""
        return self.motions([x])[0]

    def begun(self, x: np.ndarray, known: np.ndarray | None = None) -> FitState | None:
        """Return the state at parameters, None where an effect is impossible.

        Parameters
        ----------
        x : (n,) float64
        known : (n_known, ...) float64, optional
            Derivatives by the first parameters; those by the others are taken.
        """
        motion = self.simulated(x)
        if motion is None:
            return None
        state = FitState(x, motion, np.zeros((len(x), *motion.shape)))
        n_known = 0 if known is None else len(known)
        if known is not None:
            state.slopes[:n_known] = known
        self._derive(state, np.arange(len(x)) >= n_known)
        return state

    def derive(self, state: FitState) -> None:
        """Take the derivatives by all parameters that move at a state anew."""
        self._derive(state, self.coordinates.moves)

    @contextmanager
    def without_runs(self) -> Iterator[None]:
        """Let those parameters alone move that need no run."""
        everything = self.coordinates
        sought = everything.sought & ~self.by_runs
        self.coordinates = replace(everything, moves=~self.by_runs, sought=sought)
        self.renews = True
        yield
        self.coordinates, self.renews = everything, False

    def _derive(self, state, asked):
        """Take derivatives by differences, forward, or backward where an effect is impossible.

        Those of what is possible neither way are zero.
        """
        x, low, high = state.x, self.coordinates.low, self.coordinates.high
        steps = DIFFERENCE * np.eye(len(x))
        steps[x + DIFFERENCE > high] *= -1.0
        asked = np.flatnonzero(asked)
        state.slopes[asked] = 0.0
        for _ in ("one way", "the other"):
            moved = self.motions(x + steps[asked])
            for at, changed in zip(asked, moved, strict=True):
                if changed is not None:
                    state.slopes[at] = (changed - state.motion) / steps[at, at]
            steps *= -1.0
            back = x + steps.sum(axis=1)
            outside = (back < low) | (back > high)
            refused = [at for at, changed in zip(asked, moved, strict=True) if changed is None]
            asked = [at for at in refused if not outside[at]]

    def posterior(self, state: FitState) -> Posterior:
        """Return the posterior of the parameters, linear around a state."""
        case = self.scene.case
        values, effects = self.values_at(state.x)
        self.error = self.scene.error_beside(effects, values, state.motion, self.filters)
        slopes = case.band.project(state.slopes)
        residual = case.band.project(case.residual(state.motion))
        residual = residual + np.tensordot(state.x, slopes, 1)
        return self.error.posterior(residual, slopes, self.coordinates.deviation)

    def relearned(self, state: FitState) -> bool:
        """Learn the filters of charges anew beside the effects of a state; tell whether they moved.

        Then the motion and its derivatives are those with them.
        """
        own, case = self.scene.varied, self.scene.case
        if own is None:
            return False
        _, effects = self.values_at(state.x)
        residual = case.band.project(case.residual(state.motion))
        at, *known = self.error.most_probable(residual)
        around = self.scene.variation_beside(effects, self.filters)
        filters = filters_of(around, self.scene.charges, self.error, at, *known)
        before = self.filters
        moved = max(
            float(np.abs(new.own[:, None] + new.paths - old.own[:, None] - old.paths).max())
            for new, old in ((filters[b], before[b]) for b in filters)
        )
        if moved < STILL * at.holes:
            return False
        self._vary(filters)
        motion = self.simulated(state.x)
        if motion is None:
            self._vary(before)
            return False
        state.motion = motion
        if self.renews:
            self._derive(state, np.ones(len(state.x), dtype=bool))
        return True

    def worsened(self, before: FitState, after: FitState) -> bool:
        """Tell whether a state is less probable than the one before, priors included."""
        return gained(self.error, self.scene.case, before, after) < 0.0

    def reached(self, state: FitState, posterior: Posterior) -> None:
        """Keep nothing of a state on the way."""

    def ended(self, reason: str) -> None:
        """Keep why no further step could be taken."""
        self.reasons.append(reason)

    def fit_at(self, state: FitState, posterior: Posterior) -> "Fit":
        """Return the fit at a state."""
        values, effects = self.values_at(state.x)
        chi_square = self.scene.baseline.chi_square(state.motion - self.filtered.change)
        filters, unplanned = self.filters, self.filtered.change
        return Fit(
            effects, values, state, posterior, chi_square, filters=filters, unplanned=unplanned
        )


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit: effects and calibrated parameters at the maximum of the posterior.

    Parameters
    ----------
    effects : tuple of Effect
    values : (n_calibrated,) float64
    state : FitState
        Standardised parameters, those of the calibration, then of the effects; motion there and
        its derivatives.
    posterior : Posterior
        Of these parameters, linear around the state.
    chi_square : (n_blasts, n_receivers) float64
        Energy that remains of each record over that which usual errors leave.
    alternatives : tuple of Fit
        Other modes: the same effects at values of nearly the same evidence.
    filters : mapping of int to Filters
        Of charges, learned beside the effects.
    unplanned : (n_blasts, n_receivers, 3, n_samples) float64, m/s, or zero
        What these change.
    """

    effects: tuple[Effect, ...]
    values: np.ndarray
    state: FitState
    posterior: Posterior
    chi_square: np.ndarray
    alternatives: tuple["Fit", ...] = ()
    filters: Mapping[int, Filters] = field(default_factory=dict)
    unplanned: np.ndarray | float = 0.0

    @property
    def motion(self) -> np.ndarray:
        """Simulated motion, (n_blasts, n_receivers, 3, n_samples) in m/s."""
        return self.state.motion

    @property
    def log_evidence(self) -> float:
        """Log evidence, levels of the error averaged, up to a constant of the records."""
        return self.posterior.log_evidence

    @property
    def where(self):
        """Names and targets of its effects, unordered: equal for fits of the same effects."""
        return frozenset(effect.where for effect in self.effects)

    @property
    def on_site(self) -> bool:
        """Whether an effect needs runs."""
        return any(effect.hypothesis.on == "site" for effect in self.effects)

    @property
    def labels(self):
        """The labels of the effects, each once, in order."""
        return tuple(dict.fromkeys(effect.label for effect in self.effects))


def fit(
    scene: Scene,
    effects: Sequence[Effect],
    reference=None,
    base: Fit | None = None,
    longest: float = LONGEST,
) -> Fit | None:
    """Fit effects and calibrated parameters together; theory.md (14.1) to (14.3).

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    reference : (n_calibrated,) float64, optional
        Values of the calibrated parameters to start from; those of the baseline by default.
    base : Fit, optional
        Fit of the first of these effects, whose derivatives are kept, which saves runs.
    longest : float, optional
        As of `Fitter`.

    Returns
    -------
    Fit or None
        None where an effect is impossible at this site.
    """
    reference = scene.baseline.values if reference is None else reference
    fitter = Fitter(scene, effects, reference, longest=longest)
    state = fitter.begun(fitter.start(), None if base is None else base.state.slopes)
    if state is None:
        return None
    if base is not None and not fitter.by_runs[len(base.state.x) :].any() and not fitter.renews:
        with fitter.without_runs():
            minimise(fitter, state)
    posterior = _minimised(fitter, state)
    if not fitter.renews:  # the calibrated values have moved along slopes alone
        fitter.reference = fitter.values_at(state.x)[0]
        motion = fitter.simulated(state.x)
        if motion is not None:
            state.motion = motion
            posterior = _minimised(fitter, state)
    return fitter.fit_at(state, posterior)


def _minimised(fitter, state):
    """Take steps from a state, and learn the filters of charges anew beside what they reach."""
    posterior = minimise(fitter, state)
    for _ in range(ROUNDS if fitter.renews else 1):  # further steps cost runs
        if not fitter.relearned(state):
            break
        posterior = minimise(fitter, state)
    return posterior


def fit_calibrated(scene: Scene) -> Fit:
    """Fit the calibrated parameters alone, without effects.

    Raises
    ------
    SolverError
        If a run fails.
    """
    fitted = fit(scene, ())
    assert fitted is not None  # nothing makes it impossible
    return fitted


def corrected(scene: Scene, fit: Fit, shift) -> Fit:
    """Return a fit corrected for the error of the mesh, by its derivatives.

    Parameters
    ----------
    scene : Scene
    fit : Fit
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What a finer mesh adds to the motion of the fit.
    """
    fitter = Fitter(scene, fit.effects, fit.values, shift, filters=fit.filters or None)
    state = fit.state.copy()
    motion = fitter.simulated(state.x)
    assert motion is not None  # it was fitted
    state.motion = motion
    moved = fitter.fit_at(state, minimise(fitter, state))
    return replace(moved, alternatives=fit.alternatives)


def not_fitted(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each effect on the site of which no value could be changed.

    Runs at other values were impossible, or too dear: its values are those where the fit began.
    """
    slopes, sentences = iter(fit.state.slopes[len(fit.values) :]), []
    for effect in fit.effects:
        own = [np.any(next(slopes)) for values in effect.values for _ in values]
        if effect.hypothesis.on == "site" and own and not any(own):
            sentences.append(
                f"{effect.label} {effect.target}".rstrip() + " was not fitted: no run at other "
                "values could be made; those given are where the fit began"
            )
    return tuple(sentences)


def not_improved(scene: Scene, before: Fit, after: Fit) -> tuple[str, ...]:
    """Return a sentence for each large blast of which a fit explains less than another.

    Large are those of at least `LARGE` of the largest charge.
    """
    case = scene.case
    charge = np.array([np.nansum(case.project.blasts[name].charge) for name in case.blasts])
    remaining = [np.sum(fit.chi_square * scene.baseline.usual, axis=1) for fit in (before, after)]
    recorded = np.sum(case.band.project(case.residual(0.0)) ** 2, axis=(1, 2, 3))
    return tuple(
        f"blast {name}: {100.0 * more / whole:.1f} % of its energy remain, "
        f"{100.0 * less / whole:.1f} % without the effect"
        for name, size, less, more, whole in zip(
            case.blasts, charge, *remaining, recorded, strict=True
        )
        if size >= LARGE * charge.max() and more > less
    )  # fmt: skip
