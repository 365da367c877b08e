"""Fits of effects together with the calibrated parameters, and their evidence."""

from dataclasses import dataclass, replace

import numpy as np
from scipy import linalg

from ..inference.gauss_newton import LeastSquares, gauss_newton, normal_equations
from .effects import Effect, Scene
from .thresholds import DECISIVE

ROUNDING = 1e-8  # of the largest singular value: what whitening has lost
DIFFERENCE = 0.1  # of a prior standard deviation, for derivatives
ROUNDS = 8
LEAST_DECREASE = 2.0  # of the misfit, Δ ln L of one: a smaller one ends a minimisation
LONGEST = 1.5  # prior standard deviations that a parameter of an effect may go in one round
BACKTRACKS = 2
CLEARLY = 2.0 * DECISIVE  # ln likelihood by which a fit stays behind, whatever its parameters cost
HOPELESS = 4.0  # predicted decreases of a fit that do not bring it near a rival
OUTDATED = 8.0  # further decrease predicted by a kept Jacobian, above which it is computed anew


class Fitter:
    """Standardised parameters of a set of effects: those of the calibration, then of the effects.

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    reference : (n_calibrated,) float64
        Values of the calibrated parameters at which runs are made; the motion at other values
        follows from the slopes of the baseline.
    blasts : sequence of int, optional
        Indices of those that are fitted; all by default.
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s, optional
        What a finer mesh adds to every simulation.
    """

    def __init__(self, scene: Scene, effects, reference, blasts=None, shift=0.0):
        self.scene, self.effects = scene, tuple(effects)
        self.reference, self.shift = np.asarray(reference), shift
        self.blasts = tuple(range(len(scene.case.blasts)) if blasts is None else blasts)
        self.likelihood, self.sigma = scene.baseline.likelihood, scene.baseline.sigma
        self.parameters = [
            (number, order, index, parameter)
            for number, effect in enumerate(self.effects)
            for order, parameter in enumerate(effect.hypothesis.parameters)
            for index in range(len(effect.values[order]))
        ]
        low, high = (
            [each.standardised(end) if np.isfinite(end) else end for each, end in pairs]
            for pairs in (
                [(each, each.low) for *_, each in self.parameters],
                [(each, each.high) for *_, each in self.parameters],
            )
        )
        free = np.full(len(self.sigma), np.inf)
        self.bounds = np.concatenate([-free, low]), np.concatenate([free, high])
        self.longest = np.concatenate([free, np.full(len(low), LONGEST)])

    def belongs_to(self, numbers):
        """Return which parameters, (n,) bool, belong to effects of these numbers, from 0."""
        own = [number in numbers for number, *_ in self.parameters]
        return np.array([False] * len(self.sigma) + own, dtype=bool)

    def start(self):
        """Return the parameters of the reference and of the effects as they were given."""
        standardised = [
            parameter.standardised(self.effects[e].values[p][i])
            for e, p, i, parameter in self.parameters
        ]
        return np.concatenate([self.reference / self.sigma, standardised])

    def state(self, x):
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

    def motions(self, points):
        """Return the motion at parameters; runs are made only for effects on the site.

        Calibrated parameters change it along the slopes of the baseline. Blasts that are not
        fitted have their records. None where an effect is impossible or fails.
        """
        states = [self.state(x) for x in points]
        runs = self.scene.simulate(
            [(self.reference, effects) for _, effects in states], self.blasts
        )
        motions = []
        for (values, effects), run in zip(states, runs, strict=True):
            if run is None:
                motions.append(None)
                continue
            slopes = self.scene.baseline.slopes
            run = run + self.shift + np.tensordot(values - self.reference, slopes, 1)
            received = None
            with self.scene.contained(effects):
                received = self.scene.received(run, effects)
            motions.append(received)
        return motions

    def residual(self, motion):
        """Return the whitened residual of a motion, zero in blasts that are not fitted."""
        residual = self.likelihood.residual(motion)
        residual[[b for b in range(len(residual)) if b not in self.blasts]] = 0.0
        return residual

    def misfit(self, residual):
        """Return -2 ln L of a whitened residual of the blasts that are fitted."""
        return float(self.likelihood.misfit(residual, self.blasts))

    def objective(self, x, motion):
        """Return the misfit with that of the priors."""
        return float(self.misfit(self.likelihood.residual(motion)) + x @ x)

    def jacobian(self, x, motion, free):
        """Return the derivatives of the whitened motion, (n, n_blasts, n_receivers, m).

        Parameters
        ----------
        x : (n,) float64
        motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        free : (n,) bool
            Parameters that may change; derivatives by the others are zero. Differences are
            taken forward, or backward where an effect is impossible forward; zero if both are.
        """
        steps = DIFFERENCE * np.eye(len(x))
        steps[x + DIFFERENCE > self.bounds[1]] *= -1.0
        base, asked = self.likelihood.residual(motion), np.flatnonzero(free)
        jacobian = np.zeros((len(x), *base.shape))
        for _ in ("one way", "the other"):
            moved = self.motions(x + steps[asked])
            for at, changed in zip(asked, moved, strict=True):
                if changed is not None:
                    jacobian[at] = (base - self.likelihood.residual(changed)) / steps[at, at]
            steps *= -1.0
            back = x + steps.sum(axis=1)
            outside = (back < self.bounds[0]) | (back > self.bounds[1])
            refused = [at for at, changed in zip(asked, moved, strict=True) if changed is None]
            asked = [at for at in refused if not outside[at]]
        jacobian[:, [b for b in range(len(base)) if b not in self.blasts]] = 0.0
        return jacobian

    def problem(self, free, known=False) -> LeastSquares:
        """Return the least-squares problem of the free parameters.

        Parameters
        ----------
        free : (n,) bool
        known : bool
            Whether a Jacobian is given, so that none is computed.
        """
        likelihood = self.likelihood
        return LeastSquares(
            lambda x: self.motions([x])[0],
            None if known else lambda x, motion: -self.jacobian(x, motion, free),
            residual=self.residual,
            misfit=self.misfit,
            weights=lambda residual: likelihood.weights(likelihood.chi_square(residual)),
            precision=1.0,
            low=self.bounds[0],
            high=self.bounds[1],
            free=free,
        )

    def minimise(self, x, motion, free=None, known=None, wanted=np.inf):
        """Minimise by Gauss-Newton steps; return parameters, motion, Jacobian and Hessian.

        A ``known`` Jacobian is used in place of new ones, in every step. Each run updates it. Ends
        where `HOPELESS` times the predicted decrease does not reach the ``wanted`` objective.
        """
        free = np.ones(len(x), dtype=bool) if free is None else free
        end = gauss_newton(
            self.problem(free, known is not None), x, motion,
            converged=lambda _, decrease, now: decrease < max(
                LEAST_DECREASE, (now.objective - wanted) / HOPELESS
            ), rounds=ROUNDS, jacobian=None if known is None else -known, broyden=True,
            backtracks=BACKTRACKS, longest=self.longest, least_gain=LEAST_DECREASE,
        )  # fmt: skip
        return end.x, end.simulated, -end.jacobian, end.hessian

    def predicted_decrease(self, x, motion, jacobian, free):
        """Return the decrease of the objective that a kept Jacobian predicts from here."""
        problem = self.problem(free, known=True)
        end = gauss_newton(
            problem, x, motion, converged=lambda *_: True, rounds=1, jacobian=-jacobian,
            longest=self.longest,
        )  # fmt: skip
        return end.decrease


def hessian_of(jacobian, weights):
    """Return half the Gauss-Newton Hessian of the misfit with that of the priors, (n, n)."""
    return normal_equations(jacobian, np.zeros(jacobian.shape[1:]), weights)[1]


@dataclass(frozen=True, eq=False)
class Fit:
    """Fit: effects and calibrated parameters at the maximum of the posterior.

    Parameters
    ----------
    effects : tuple of Effect
    values : (n_calibrated,) float64
    covariance : (n, n) float64
        Of the standardised parameters.
    jacobian : (n, n_blasts, n_receivers, m) float64
        Derivatives of the whitened motion by them.
    x : (n,) float64
        Standardised parameters: those of the calibration, then of the effects.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    chi_square : (n_blasts, n_receivers) float64
        Reduced, of each record.
    misfit : float
    log_evidence : float
        Up to a constant of the records: Laplace's approximation, theory.md (14.3).
    alternatives : tuple of Fit
        Other modes: the same effects at values of nearly the same evidence.
    """

    effects: tuple[Effect, ...]
    values: np.ndarray
    covariance: np.ndarray
    jacobian: np.ndarray
    x: np.ndarray
    motion: np.ndarray
    chi_square: np.ndarray
    misfit: float
    log_evidence: float
    alternatives: tuple["Fit", ...] = ()

    @property
    def where(self):
        """Names and targets of its effects, unordered: equal for fits of the same effects."""
        return frozenset(effect.where for effect in self.effects)

    @property
    def effect_jacobian(self):
        """Derivatives by the parameters of the effects, the last of the Jacobian."""
        return self.jacobian[len(self.values) :]

    @property
    def labels(self):
        """The labels of the effects, each once, in order."""
        return tuple(dict.fromkeys(effect.label for effect in self.effects))


def fit_partly(scene: Scene, effects, reference, n_last=0):
    """Fit the calibrated parameters beside effects, or those of the last ``n_last`` effects alone.

    Returns
    -------
    objective : float
        Misfit with that of the priors; infinite where an effect is impossible.
    effects : tuple of Effect
    """
    fitter = Fitter(scene, effects, reference)
    x = fitter.start()
    motion = fitter.motions([x])[0]
    if motion is None:
        return np.inf, effects
    n = len(effects)
    free = fitter.belongs_to(range(n - n_last, n)) if n_last else ~fitter.belongs_to(range(n))
    x, motion, *_ = fitter.minimise(x, motion, free)
    return fitter.objective(x, motion), fitter.state(x)[1]


def fit(
    scene: Scene,
    effects,
    reference=None,
    first=None,
    base: Fit | None = None,
    rival: Fit | None = None,
) -> Fit | None:
    """Fit effects and calibrated parameters together; theory.md (14.1) to (14.3).

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    reference : (n_calibrated,) float64, optional
        Values of the calibrated parameters to start from; those of the baseline by default.
    first : sequence of int, optional
        Indices of blasts that are fitted alone before all are, which saves runs.
    base : Fit, optional
        Fit of the first of these effects. Those on the site stay fixed until the others are
        fitted, and are then fitted with its Jacobian, which saves runs. The fit ends early if the
        first blasts gain too little over it.
    rival : Fit, optional
        Fit of other effects. The fit ends early if the first blasts, or the first steps in all,
        show that these stay better.

    Returns
    -------
    Fit or None
        None where an effect is impossible at this site, or gains too little.
    """
    reference = scene.baseline.values if reference is None else reference
    every = range(len(scene.case.blasts))
    early = () if first is None else tuple(first)
    fitted = () if base is None else base.effects
    waiting = [e for e, effect in enumerate(fitted) if effect.hypothesis.on == "site"]
    x = jacobian = None
    free = np.ones(0, dtype=bool)
    for blasts in (early, every) if 0 < len(early) < len(every) else (every,):
        fitter = Fitter(scene, effects, reference, blasts)
        x = fitter.start() if x is None else x
        motion = fitter.motions([x])[0]
        if motion is None:
            return None
        free = ~fitter.belongs_to(waiting)
        if jacobian is not None:  # it lacks the blasts that were not fitted first
            others = Fitter(scene, effects, reference, [b for b in every if b not in early])
            jacobian = jacobian + others.jacobian(x, motion, free)
        known, wanted = jacobian, np.inf if rival is None else _wanted(fitter, rival)
        x, motion, jacobian, hessian = fitter.minimise(x, motion, free, known, wanted)
        decrease = 0.0
        if known is not None:
            decrease = fitter.predicted_decrease(x, motion, jacobian, free)
        if fitter.objective(x, motion) - decrease > wanted:
            return None
        if decrease > OUTDATED:
            x, motion, jacobian, hessian = fitter.minimise(x, motion, free)
        if base is not None and not _promising(fitter, base, x, motion):
            return None
    if not effects or any(effect.hypothesis.on == "site" for effect in effects):
        if base is not None and jacobian is not None:
            jacobian[~free] = base.jacobian[~free[: len(base.jacobian)]]
        fitter.reference = fitter.state(x)[0]
        motion = fitter.motions([x])[0]
        x, motion, jacobian, hessian = fitter.minimise(x, motion, known=jacobian)
    return _fit_at(fitter, x, motion, jacobian, hessian)


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


def _promising(fitter, base, x, motion):
    """Tell whether an effect would pay if all blasts gained as those that were fitted first."""
    share = len(fitter.blasts) / len(base.chi_square)
    if share == 1.0:
        return True
    known = fitter.likelihood.misfit_of(base.chi_square, fitter.blasts) + base.x @ base.x
    return known - fitter.objective(x, motion) > 2.0 * DECISIVE * share


def _wanted(fitter, rival):
    """Return the objective of a fit to some blasts from which it may still come near a rival.

    In the other blasts it can at best explain all that exceeds noise and model error.
    """
    others = [b for b in range(len(rival.chi_square)) if b not in fitter.blasts]
    floor = fitter.likelihood.misfit_of(np.minimum(rival.chi_square, 1.0), others)
    return rival.misfit + rival.x @ rival.x - floor + 2.0 * CLEARLY


def unwhitened(likelihood, change) -> np.ndarray:
    """Return whitened changes (..., n_blasts, n_receivers, m) in the band, by component, m/s."""
    roots = likelihood.covariance.roots
    coloured = np.linalg.pinv(roots, rcond=ROUNDING, hermitian=True)
    held = np.einsum("brij,...brj->...bri", coloured, change)
    return held.reshape(*change.shape[:-1], 3, change.shape[-1] // 3)


def corrected(scene: Scene, fit: Fit, shift) -> Fit:
    """Return a fit corrected for the error of the mesh, by its Jacobian.

    Parameters
    ----------
    scene : Scene
    fit : Fit
    shift : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        What a finer mesh adds to the motion of the fit.
    """
    fitter = Fitter(scene, fit.effects, fit.values, shift=shift)
    motion = fitter.motions([fit.x])[0]
    moved = _fit_at(fitter, *fitter.minimise(fit.x, motion, known=fit.jacobian))
    return replace(moved, alternatives=fit.alternatives)


def _fit_at(fitter, x, motion, jacobian, hessian):
    """Return the fit at which a minimisation ended."""
    values, effects = fitter.state(x)
    residual = fitter.likelihood.residual(motion)
    misfit = float(fitter.likelihood.misfit(residual))
    log_evidence = -0.5 * (misfit + x @ x + np.linalg.slogdet(hessian)[1])
    chi_square, covariance = fitter.likelihood.chi_square(residual), linalg.inv(hessian)
    return Fit(
        effects, values, covariance, jacobian, x, motion, chi_square, misfit, float(log_evidence)
    )
