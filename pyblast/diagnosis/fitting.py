"""Effects fitted together with what is calibrated, and what the data think of them."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from .calibration import remainder
from .scene import Effect, Scene

DIFFERENCE = 0.1  # of a knob's sigma, for derivatives
ROUNDS = 6
WORTH = 1.0  # foreseen drop of the sum of squares that is not worth another round
FARTHEST = 1.5  # sigmas that a knob may go in one round


@dataclass(frozen=True, eq=False)
class Fit:
    """A site with effects, fitted to the records.

    Parameters
    ----------
    effects : tuple of Effect
    values : (n_unknowns,) float64
        Logarithms of factors on what was believed of the site.
    covariance : (n, n) float64
        Of these values in their sigmas, then of all knobs in theirs.
    motion : (n_blasts, n_receivers, 3, n_samples) float64, m/s
    squares : float
        Whitened sum of squares, with what the priors take.
    chi_square : float
        Without.
    log_evidence : float
        Up to a constant of the records: Laplace's approximation, theory.md (14.2).
    """

    effects: tuple[Effect, ...]
    values: np.ndarray
    covariance: np.ndarray
    motion: np.ndarray
    squares: float
    chi_square: float
    log_evidence: float


class Fitter:
    """Coordinates of a set of effects: sigmas of the unknowns, then those of the knobs.

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At their starting values.
    whitener : Whitener, optional
        That of the baseline if not given.

    Attributes
    ----------
    home : (n_unknowns,) float64
        At which runs are made; from there on the slopes of the baseline lead.
    """

    def __init__(self, scene: Scene, effects, whitener=None):
        self.scene, self.effects = scene, tuple(effects)
        self.whitener = whitener or scene.baseline.whitener
        self.home = scene.baseline.values
        self.sigma = np.array([one.sigma for one in scene.baseline.unknowns])
        self.knobs = [
            (number, place, index, knob)
            for number, effect in enumerate(self.effects)
            for place, knob in enumerate(effect.hypothesis.knobs)
            for index in range(len(effect.values[place]))
        ]
        low = [knob.coordinate(knob.low) if np.isfinite(knob.low) else -np.inf
               for *_, knob in self.knobs]  # fmt: skip
        high = [knob.coordinate(knob.high) if np.isfinite(knob.high) else np.inf
                for *_, knob in self.knobs]  # fmt: skip
        free = np.full(len(self.sigma), np.inf)
        self.bounds = np.concatenate([-free, low]), np.concatenate([free, high])

    def start(self):
        """Return the coordinates of the baseline and of the effects as they were given."""
        at = [knob.coordinate(self.effects[e].values[p][i]) for e, p, i, knob in self.knobs]
        return np.concatenate([self.scene.baseline.values / self.sigma, at])

    def state(self, place):
        """Return the values of the unknowns and the effects at coordinates."""
        n = len(self.sigma)
        changed = [[list(some) for some in effect.values] for effect in self.effects]
        for (e, p, i, knob), coordinate in zip(self.knobs, place[n:], strict=True):
            changed[e][p][i] = float(knob.value(coordinate))
        effects = tuple(
            Effect(effect.name, effect.target, tuple(map(tuple, values)))
            for effect, values in zip(self.effects, changed, strict=True)
        )
        return self.sigma * place[:n], effects

    def motions(self, places):
        """Return the motion at coordinates; runs are made only for effects on the site.

        Unknowns of the site move it along the slopes of the baseline.
        """
        states = [self.state(place) for place in places]
        home = self.home
        sent = self.scene.sent([(home, effects) for _, effects in states])
        found = []
        for (values, effects), one in zip(states, sent, strict=True):
            if one is None:
                found.append(None)
                continue
            one = one + np.tensordot(values - home, self.scene.baseline.slopes, 1)
            found.append(self.scene.received(one, effects))
        return found

    def white(self, motion):
        """Return what is left of the records, whitened, (n_data,)."""
        return self.whitener.apply(remainder(self.scene.case, motion)).ravel()

    def squares(self, place, motion):
        """Return the sum of squares with that of the coordinates."""
        return float(np.sum(self.white(motion) ** 2) + place @ place)

    def columns(self, place, motion):
        """Return the derivatives of the whitened motion, (n_coordinates, n_data)."""
        steps = DIFFERENCE * np.eye(len(place))
        steps[place + DIFFERENCE > self.bounds[1]] *= -1.0
        base = self.white(motion)
        return np.stack(
            [
                (base - self.white(moved)) / step.sum()
                for step, moved in zip(steps, self.motions(place + steps), strict=True)
            ]
        )

    def step(self, place, columns, motion):
        """Return the best move within reach, what it promises, and the curvature."""
        curvature = columns @ columns.T + np.eye(len(place))
        pull = columns @ self.white(motion) - place
        move = linalg.solve(curvature, pull, assume_a="pos")
        n = len(self.sigma)
        longest = np.max(np.abs(move[n:]), initial=0.0)
        move *= min(1.0, FARTHEST / max(longest, 1e-12))
        move = np.clip(place + move, *self.bounds) - place
        return move, float(2.0 * pull @ move - move @ curvature @ move), curvature


def fit(scene: Scene, effects, whitener=None) -> Fit | None:
    """Fit effects and unknowns together; theory.md (14.1), (14.2).

    Parameters
    ----------
    scene : Scene
    effects : sequence of Effect
        At the values to start from.
    whitener : Whitener, optional

    Returns
    -------
    Fit or None
        None where an effect can't be at this site.
    """
    fitter = Fitter(scene, effects, whitener)
    place = fitter.start()
    motion = fitter.motions([place])[0]
    if motion is None:
        return None
    runs = any(effect.hypothesis.on == "site" for effect in effects)
    place, motion, curvature = _descended(fitter, place, motion)
    if runs:
        fitter.home = fitter.state(place)[0]
        motion = fitter.motions([place])[0]
        place, motion, curvature = _descended(fitter, place, motion)
    values, effects = fitter.state(place)
    squares, chi_square = fitter.squares(place, motion), float(np.sum(fitter.white(motion) ** 2))
    log_evidence = -0.5 * (squares + np.linalg.slogdet(curvature)[1])
    covariance = linalg.inv(curvature)
    return Fit(effects, values, covariance, motion, squares, chi_square, log_evidence)


def _descended(fitter, place, motion):
    """Go down by damped Gauss-Newton steps; return place, motion and curvature there."""
    squares = fitter.squares(place, motion)
    for _ in range(ROUNDS):
        columns = fitter.columns(place, motion)
        move, promised, curvature = fitter.step(place, columns, motion)
        if promised < WORTH:
            break
        for _ in range(3):
            trial = fitter.motions([place + move])[0]
            found = np.inf if trial is None else fitter.squares(place + move, trial)
            if found < squares:
                break
            move = 0.4 * move
        else:
            break
        gained, squares = squares - found, found
        place, motion = place + move, trial
        if gained < WORTH:
            break
    return place, motion, curvature
