"""Effects on the site as a few runs judge them, before any is fitted."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from .hypotheses import LIBRARY
from .scene import Effect

SCALED = 0.5  # standard deviation of the scale of a change that was run at one value of its knobs
ADAPTING = 6  # rounds of reweighting
TOGETHER = 8  # effects whose runs are made side by side


@dataclass(frozen=True, eq=False)
class Guess:
    """An effect on the site as a few runs judge it.

    Parameters
    ----------
    effect : Effect
    share : float
        Of all energy in excess at the calibrated site, what is gone in its blasts.
    change : (n_blasts, n_receivers, 3, n_samples) float64, m/s
        Of the motion of the believed site; zero in blasts that were not run.
    blasts : tuple of int
    """

    effect: Effect
    share: float
    change: np.ndarray
    blasts: tuple[int, ...]


def started(hypothesis, target, scene):
    """Return an effect at each of its starting values."""
    blasts = scene.case.site.blasts
    count = len(blasts[target].times) if target in blasts else 1
    read = () if hypothesis.begins is None else (hypothesis.begins(scene),)
    return [
        Effect(
            hypothesis.name,
            target,
            tuple(
                (value,) * (count if knob.per_hole else 1)
                for knob, value in zip(hypothesis.knobs, values, strict=True)
            ),
        )
        for values in (*product(*[knob.starts for knob in hypothesis.knobs]), *read)
    ]


def screened(found) -> list[Guess]:
    """Judge effects on the site by runs at their starting values, best first.

    Parameters
    ----------
    found : Search
        With its fit of nothing.
    """
    scene, home = found.scene, np.zeros(len(found.none.values))
    tried = [
        (effect, _seen_in(found, hypothesis, target))
        for hypothesis in LIBRARY.values() if hypothesis.on == "site"
        for target in hypothesis.targets(scene.case)
        for effect in started(hypothesis, target, scene)
    ]  # fmt: skip
    best = {}
    for done, (effect, blasts) in enumerate(tried):
        found.tell("effects on the site", done, len(tried))
        if not found.runs_left():
            break
        if done % TOGETHER == 0:  # side by side
            for some in {b for _, b in tried}:
                these = [(home, (e,)) for e, b in tried[done : done + TOGETHER] if b == some]
                scene.sent(these, some)
        guess = _guess(found, effect, home, blasts)
        key = effect.label, effect.target
        if guess is not None and (key not in best or best[key].share < guess.share):
            best[key] = guess
    return sorted(best.values(), key=lambda one: -one.share)


def _seen_in(found, hypothesis, target):
    """Return the blasts in which an effect is screened: its own, or where most is open.

    What grows with charge is screened in the first blast, too: in one alone it looks like a change
    of the site's own values.
    """
    case, likelihood = found.scene.case, found.scene.baseline.likelihood
    if target in case.blasts:
        return (case.blasts.index(target),)
    each = [likelihood.excess(found.none.size, (b,)) for b in range(len(case.blasts))]
    most = int(np.argmax(each))
    return (most,) if hypothesis.linear else tuple(sorted({0, most or len(case.blasts) - 1}))


def _guess(found, effect, home, blasts):
    """Judge one effect on the site by a run of some blasts, and by its change made less or more."""
    scene, likelihood = found.scene, found.scene.baseline.likelihood
    sent = scene.sent([(home, (effect,))], blasts)[0]
    if sent is None:
        return None
    change = np.zeros_like(sent)
    change[list(blasts)] = (sent - scene.baseline.believed)[list(blasts)]
    size = _adapted(scene, change, blasts)
    return Guess(effect, likelihood.share(found.none.size, size, blasts), change, blasts)


def _adapted(scene, change, blasts):
    """Return sizes of residuals when the site's values and the scale of a change fit best."""
    baseline, likelihood = scene.baseline, scene.baseline.likelihood
    slopes = baseline.slopes * baseline.sigma[:, None, None, None, None]
    columns = likelihood.white(np.concatenate([slopes, change[None]]))
    columns[:, [b for b in range(columns.shape[1]) if b not in blasts]] = 0.0
    centre = np.append(np.zeros(len(slopes)), 1.0)
    precision = np.append(np.ones(len(slopes)), SCALED**-2.0)
    start, place = likelihood.left(baseline.believed), centre
    for _ in range(ADAPTING):
        size = likelihood.size(start - np.tensordot(place, columns, 1))
        weights = likelihood.weights(size)
        curvature = np.einsum("ibrm,jbrm,br->ij", columns, columns, weights, optimize=True)
        pull = np.einsum("ibrm,brm,br->i", columns, start, weights, optimize=True)
        place = np.linalg.solve(curvature + np.diag(precision), pull + precision * centre)
    return likelihood.size(start - np.tensordot(place, columns, 1))


def rescreened(found, base) -> list[Guess]:
    """Judge effects on the site again, on top of those of a fit, by adding their changes."""
    likelihood, kept = found.scene.baseline.likelihood, []
    for guess in found.guesses:
        if guess.effect.label in base.labels:
            continue
        shares = [
            likelihood.share(
                base.size,
                likelihood.size(likelihood.left(base.motion + part * guess.change)),
                guess.blasts,
            )
            for part in (0.5, 1.0)
        ]
        kept.append(Guess(guess.effect, max(shares), guess.change, guess.blasts))
    return sorted(kept, key=lambda one: -one.share)
