"""How small an effect these records would still have shown: by derivatives, without runs."""

import numpy as np

from .effects import Effect, Scene
from .fitting import DIFFERENCE, GROWS, Fit, hessian_of
from .hypotheses import LIBRARY
from .search import material

HALVINGS = 40
LINEAR = 2.0  # by which the energy of a change may be off its derivative


def visible(scene: Scene, fit: Fit, least: float = GROWS) -> list[dict]:
    """List the smallest effects that would not have passed unseen beside a fit.

    Parameters
    ----------
    scene : Scene
    fit : Fit
        That explains all; nothing is said beside one that does not.
    least : float
        Nats that an effect must bring.

    Returns
    -------
    list of dict
        Of each knob that tells its ``nothing``: ``label``, ``form``, ``knob``, ``unit``,
        ``nothing``, and the ``amount`` from there on that would have been seen at every target but
        the ``unseen`` ones. Knobs that no target would have shown are left out.

    Notes
    -----
    Theory.md (14.7). An amount at which the change is no longer like its derivative is left out.
    """
    found = []
    if material(fit.chi_square):
        return found
    for one in LIBRARY.values():
        if one.label in fit.labels or one.untestable(scene.case):
            continue
        for place, knob in enumerate(one.parameters):
            if knob.null is None:
                continue
            targets = one.targets(scene.case)
            amounts = {t: _amount(scene, fit, one, t, place, least) for t in targets}
            seen = [amount for amount in amounts.values() if np.isfinite(amount)]
            if seen:
                found.append({
                    "label": one.label, "form": one.form, "target": one.target, "knob": knob.name,
                    "unit": knob.unit, "per_hole": knob.per_hole, "nothing": knob.null,
                    "amount": max(seen),
                    "unseen": [t for t, amount in amounts.items() if not np.isfinite(amount)],
                })  # fmt: skip
    return found


def _amount(scene, fit, one, target, place, least):
    """Return the smallest visible change of one knob at a target, of its worst hole if of each.

    Holes without a charge send nothing, whatever their knobs, and don't count.
    """
    knob, case, likelihood = one.parameters[place], scene.case, scene.baseline.likelihood
    charges = case.project.blasts[target].charge if knob.per_hole else np.ones(1)
    live = np.flatnonzero(charges > 0.0)
    unit = knob.sigma * (knob.null or knob.mean or 1.0) if knob.log else knob.sigma
    step = DIFFERENCE * unit
    cost = np.log(len(one.targets(case)) * len(live)) + least
    farthest = max(abs(e - knob.null) for e in (knob.low, knob.high) if np.isfinite(e))
    left = likelihood.residual(fit.motion)

    def change(hole, amount):
        values = [(other.mean,) for other in one.parameters]
        changed = np.full(len(charges), knob.null)
        changed[hole] += amount
        values[place] = tuple(changed.tolist())
        effect = Effect(one.name, target, tuple(values))
        return left - likelihood.residual(scene.received(fit.motion, (effect,)))

    amounts = []
    for hole in live:
        slope = change(hole, step) / step
        amount = _smallest(likelihood, fit, slope, unit, cost, farthest)
        if np.isfinite(amount):
            grown = np.sum(change(hole, amount) ** 2) / np.sum((amount * slope) ** 2)
            amount = amount if 1.0 / LINEAR < grown < LINEAR else np.inf
        amounts.append(amount)
    return max(amounts)


def _smallest(likelihood, fit, change, unit, cost, farthest):
    """Return the smallest amount of a whitened change that shows; infinite beyond the farthest."""
    weights = likelihood.weights(fit.chi_square)
    pull = np.einsum("ibrm,brm,br->i", fit.jacobian, change, weights, optimize=True)
    taken = np.linalg.solve(hessian_of(fit.jacobian, weights), pull)
    change = change - np.tensordot(taken, fit.jacobian, 1)
    size = likelihood.chi_square(change)
    cost += 0.5 * np.log1p(unit**2 * np.sum(weights * likelihood.n_data * size))
    before = likelihood.misfit_of(fit.chi_square)

    def seen(amount):
        after = fit.chi_square + amount**2 * size
        return material(after) and 0.5 * (likelihood.misfit_of(after) - before) >= cost

    if not seen(farthest):
        return np.inf
    low, high = 0.0, farthest
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if seen(middle) else (middle, high)
    return float(high)
