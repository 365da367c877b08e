"""Closure law of joints from press tests: hyperbola of Bandis against a line."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize, stats

from pyblast.errors import InputError
from pyblast.line_records.shots import SIGNIFICANCE, EffectDecision, permutation_p, phase_randomised

N_CLOSURE_DRAWS = 59
Pair = tuple[np.ndarray, np.ndarray]  # closure in m, stress in Pa


def closure_law(
    closures: Sequence[ArrayLike], stresses: Sequence[ArrayLike], *, seed: int = 0
) -> EffectDecision:
    """Judge linear closure against Bandis' hyperbola.

    Parameters
    ----------
    closures : list of (n,) float, m
        One specimen each, growing, 0 under the seating load.
    stresses : list of (n,) float, Pa
        Compression positive, as a press gives it.
    seed : int

    Returns
    -------
    Decision
        "joint_nonlinear_closure" with kni [Pa/m], Vm [m] and seat [Pa] of a further specimen;
        ``held_out`` is the root mean square misfit in Pa of every other point of each specimen
        by the points between, by either law. NAMED only if the hyperbola predicts better and
        surrogates seldom let it.

    Notes
    -----
    ``sigma = seat + kni u / (1 - u/Vm)``, theory.md (3.9), against ``seat + kn u``. Surrogates: the
    line plus its own remainders with drawn phases. Specimens differ in stiffness, so the law is
    judged within each and the parameters between them.
    """
    if len(closures) != len(stresses) or len(closures) < 2:
        raise InputError(
            f"closure_law: needs stress and closure of at least 2 specimens, got {len(stresses)} "
            f"and {len(closures)}"
        )
    pairs = [(np.asarray(u, float), np.asarray(s, float))
             for u, s in zip(closures, stresses, strict=True)]  # fmt: skip
    before, after = held_out_misfits(pairs)
    rng, drawn = np.random.default_rng(seed), []
    straight = _line(pairs)
    for _ in range(N_CLOSURE_DRAWS):
        made = [(u, _linear(straight, u) + phase_randomised(s - _linear(straight, u), rng))
                for u, s in pairs]  # fmt: skip
        line, bent = held_out_misfits(made)
        drawn.append(line - bent)
    p_value = permutation_p(before - after, drawn)
    named = after < before and p_value <= SIGNIFICANCE
    return EffectDecision(
        "NAMED" if named else "NULL", "joint_nonlinear_closure",
        f"the hyperbola leaves {after:.3g} Pa, the line {before:.3g} Pa, of closures not fitted; "
        f"{100 * p_value:.1f} % of surrogates gain as much",
        parameters=_of_the_next(pairs) if named else {}, p_value=p_value, held_out=(before, after),
    )  # fmt: skip


def held_out_misfits(pairs: Sequence[Pair]) -> tuple[float, float]:
    """Return the misfits of every other point by the points between, by line and by hyperbola."""
    left = np.zeros(2)
    for u, s in pairs:
        for fitted, held in ((slice(0, None, 2), slice(1, None, 2)),
                             (slice(1, None, 2), slice(0, None, 2))):  # fmt: skip
            some = [(u[fitted], s[fitted])]
            left += [
                np.mean((s[held] - _linear(_line(some), u[held])) ** 2),
                np.mean((s[held] - hyperbola(fit_hyperbola(some), u[held])) ** 2),
            ]
    line, bent = np.sqrt(left / (2 * len(pairs)))
    return float(line), float(bent)


def hyperbola(values: Sequence[float], closure: np.ndarray) -> np.ndarray:
    """Return stress of kni, Vm, seat; straight on, by its tangent, beyond 99 % of Vm."""
    stiffness, most, seat = values
    u = np.minimum(closure, 0.99 * most)
    slope = stiffness / (1.0 - u / most) ** 2
    return seat + stiffness * u / (1.0 - u / most) + slope * (closure - u)


def fit_hyperbola(pairs: Sequence[Pair]) -> tuple[float, float, float]:
    """Return kni, Vm, seat that fit all specimens best."""
    closure, stress = (np.concatenate(one) for one in zip(*pairs, strict=True))
    widest, scale = closure.max(), np.ptp(stress)

    def remainder(x):
        return (hyperbola((np.exp(x[0]), np.exp(x[1]), x[2] * scale), closure) - stress) / scale

    starts = [[np.log(scale / widest / 2), np.log(k * widest), stress.min() / scale]
              for k in (1.3, 4.0)]  # fmt: skip
    best = min((optimize.least_squares(remainder, x) for x in starts), key=lambda fit: fit.cost)
    return np.exp(best.x[0]), np.exp(best.x[1]), best.x[2] * scale


def _line(pairs):
    """Return slope and seat of the best line through all specimens."""
    closure, stress = (np.concatenate(one) for one in zip(*pairs, strict=True))
    return np.polyfit(closure, stress, 1)


def _linear(line, closure):
    """Return the stress of a line."""
    return np.polyval(line, closure)


def _of_the_next(pairs):
    """Return kni, Vm and seat that a further specimen has, by the spread of these."""
    fits = np.array([fit_hyperbola([pair]) for pair in pairs])
    n = len(fits)
    reach = stats.t.ppf(0.95, n - 1) * np.sqrt(1.0 + 1.0 / n)
    found = {}
    for name, values, turn, back in (
        ("kni", fits[:, 0], np.log, np.exp), ("vm", fits[:, 1], np.log, np.exp),
        ("seat", fits[:, 2], np.asarray, np.asarray),
    ):  # fmt: skip
        turned = turn(values)
        middle, half = turned.mean(), reach * turned.std(ddof=1)
        found[name] = tuple(float(back(x)) for x in (middle, middle - half, middle + half))
    return found
