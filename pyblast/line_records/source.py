"""Single holes against their blast, and closure laws of joints from press tests."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft, optimize, stats

from ..back_analysis.firing_times import firing_times
from ..errors import InputError
from .shots import SURE, Verdict, phase_randomised, share_as_large, shifted

N_BLAST_DRAWS, SURE_OF_TIMES, STRENGTHS = 19, 1e-6, 0.25
T_STAR = np.linspace(-4e-3, 12e-3, 33)
SITE_REACH = 0.01
LABELS = ("delay_scatter", "misfire_or_charge_error", "attenuation_Q", "site")
CHARGE = LABELS[1]
NESTED = ((CHARGE, "delay_scatter"),)  # the first is a case of the second


def blast_cause(
    greens: ArrayLike,
    recorded: ArrayLike,
    dt: float,
    nominal: ArrayLike,
    *,
    sigma: float,
    folds: int = 2,
    seed: int = 0,
) -> Verdict:
    """Name what makes a blast differ from its plan.

    Parameters
    ----------
    greens : (n_holes, n_receivers, n_samples) float
        Motion by each hole alone, scale 1.
    recorded : (n_receivers, n_recorded) float
    dt : float, s
    nominal : (n_holes,) float, s
        Planned times after the first sample of the record.
    sigma : float, s
        How much firing times may scatter.
    folds : int
        Every so many-th receiver is held out in turn.
    seed : int

    Returns
    -------
    Verdict
        The label that explains most of receivers it was not fitted to; of one hole's time and
        scale, "time_n" [s] and "scale_n" from all receivers. ``held_out``: shares of energy
        explained by the plan and by the effect. NULL where blasts that the plan makes, with noise
        like what is left, gain as much; a class where another effect gains as much. Times come with
        scales, so they must gain more than in blasts of those scales without scatter.

    Notes
    -----
    Effects are fitted on some receivers and judged on the others; ``site`` (a delay and a gain
    of each receiver) on the other half of the record. Fits: theory.md (13.1).
    """
    greens, recorded = np.asarray(greens, float), np.asarray(recorded, float)
    nominal = np.asarray(nominal, float)
    if not 2 <= folds <= len(recorded):
        raise InputError(
            f"blast_cause.folds: must lie between 2 and {len(recorded)}, got {folds:d}"
        )
    loudness = 1.0 / np.sqrt(np.mean(recorded**2, axis=1))
    parts = np.arange(len(recorded)) % folds
    job = {"greens": greens, "dt": dt, "nominal": nominal, "sigma": sigma,
           "loudness": loudness, "parts": parts}  # fmt: skip
    scores, guesses = _scores(job, recorded, LABELS)
    best = max(LABELS, key=lambda label: scores[label])
    rng = np.random.default_rng(seed)
    shares = ", ".join(f"{label} {share:.2f}" for label, share in scores.items())
    reason = f"explained on records held out: {shares}"
    if best == "delay_scatter" and scores[CHARGE] > scores["plan"]:
        chance = _chance(job, recorded, guesses[CHARGE], (CHARGE, best), scores, rng)
        best = best if chance <= SURE else CHARGE
    chance = _chance(job, recorded, guesses["plan"], ("plan", best), scores, rng)
    if scores[best] <= scores["plan"] or chance > SURE:
        return Verdict("NULL", best, reason, chance=chance)
    own = _left(recorded, guesses[best])
    rivals = [one for one in LABELS if one != best and (best, one) not in NESTED
              and not _surely_less(own, _left(recorded, guesses[one]))]  # fmt: skip
    return Verdict(
        "CLASS" if rivals else "NAMED", " | ".join([best, *rivals]), reason,
        tuple(range(len(nominal))), _parameters(job, recorded, best), chance=chance,
        held_out=(scores["plan"], scores[best]),
    )  # fmt: skip


def _chance(job, recorded, simple, labels, scores, rng):
    """Return how often the second effect gains as much in blasts made by the first, and the play.

    Such a blast is the prediction of the first effect, with noise like the rest of the record.
    """
    drawn = []
    for _ in range(N_BLAST_DRAWS):
        again, _ = _scores(job, simple + phase_randomised(recorded - simple, rng), labels)
        drawn.append(again[labels[1]] - again[labels[0]])
    return share_as_large(scores[labels[1]] - scores[labels[0]], drawn)


def _scores(job, recorded, labels):
    """Return the share explained on held-out records, and the motion predicted, by label."""
    plan = _blast(job["greens"], job["nominal"], np.ones(len(job["nominal"])),
                  recorded.shape[1], job["dt"])  # fmt: skip
    plan = plan * (np.vdot(plan, recorded) / np.vdot(plan, plan))
    guesses = {"plan": plan}
    for label in labels:
        if label != "plan":
            guesses[label] = _PREDICTED[label](job, recorded, plan)
    return {label: _share(recorded, guess) for label, guess in guesses.items()}, guesses


def _by_holes(job, recorded, plan, *, times, scales):
    """Fit times or scales or both on some receivers; predict the others."""
    del plan
    guess = np.zeros_like(recorded)
    for part in np.unique(job["parts"]):
        held = job["parts"] == part
        answer = _fitted(job, recorded, ~held, times=times, scales=scales)
        guess[held] = _blast(
            job["greens"][:, held], answer.times, answer.scales, recorded.shape[1], job["dt"]
        )
    return guess


def _fitted(job, recorded, receivers, *, times, scales):
    """Find times or scales of the holes from some receivers."""
    weights = job["loudness"][receivers, None]
    return firing_times(
        job["greens"][:, receivers], recorded[receivers], job["dt"], job["nominal"],
        sigma=job["sigma"] if times else SURE_OF_TIMES,
        scale_sigma=STRENGTHS if scales else SURE_OF_TIMES,
        whiten=partial(np.multiply, weights),
    )  # fmt: skip


def _by_q(job, recorded, plan):
    """Fit one t* on some receivers; predict the others."""
    frequency = fft.rfftfreq(2 * recorded.shape[1], job["dt"])
    spectrum, guess = fft.rfft(plan, 2 * recorded.shape[1]), np.zeros_like(recorded)
    tried = [fft.irfft(spectrum * np.exp(-np.pi * frequency * t))[:, : recorded.shape[1]]
             for t in T_STAR]  # fmt: skip
    for part in np.unique(job["parts"]):
        held = job["parts"] == part
        sizes = [np.vdot(one[~held], recorded[~held]) / np.vdot(one[~held], one[~held])
                 for one in tried]  # fmt: skip
        best = max(range(len(tried)),
                   key=lambda n: _share(recorded[~held], sizes[n] * tried[n][~held]))  # fmt: skip
        guess[held] = sizes[best] * tried[best][held]
    return guess


def _by_site(job, recorded, plan):
    """Fit delay and gain of each receiver on one half of the record; predict the other."""
    half, guess = recorded.shape[1] // 2, np.zeros_like(recorded)
    delays = np.arange(-SITE_REACH, SITE_REACH, 0.5 * job["dt"])
    tried = np.stack([shifted(plan, np.full(len(plan), t), job["dt"]) for t in delays])
    for fitted, held in ((slice(0, half), slice(half, None)), (slice(half, None), slice(0, half))):
        product = np.einsum("tcn,cn->tc", tried[..., fitted], recorded[:, fitted])
        energy = np.sum(tried[..., fitted] ** 2, axis=-1)
        best = np.argmax(product * np.abs(product) / energy, axis=0)
        each = np.arange(len(plan))
        gain = (product / energy)[best, each]
        guess[:, held] = gain[:, None] * tried[best, each][:, held]
    return guess


def _blast(greens, times, scales, n_samples, dt):
    """Sum holes at the receivers, (n_receivers, n_samples)."""
    size = fft.next_fast_len(n_samples + greens.shape[-1], real=True)
    frequency = fft.rfftfreq(size, dt)
    turns = np.exp(-2j * np.pi * np.outer(times, frequency)) * np.reshape(scales, (-1, 1))
    return fft.irfft(np.einsum("hcf,hf->cf", fft.rfft(greens, size), turns), size)[:, :n_samples]


def _left(recorded, guess):
    """Return the share of energy that stays unexplained at each receiver."""
    return np.sum((recorded - guess) ** 2, axis=1) / np.sum(recorded**2, axis=1)


def _share(recorded, guess):
    """Return the share of energy explained, all receivers weighing the same."""
    return float(1.0 - _left(recorded, guess).mean())


def _surely_less(left, other):
    """Say whether less is left than by another effect, by more than twice the standard error."""
    gain = other - left
    return gain.mean() > 2.0 * gain.std(ddof=1) / np.sqrt(len(gain))


def _parameters(job, recorded, label):
    """Return times and scales with intervals, where the effect is one of the holes."""
    if label not in LABELS[:2]:
        return {}
    receivers = np.ones(len(recorded), bool)
    answer = _fitted(job, recorded, receivers, times=label == LABELS[0], scales=True)
    rows = {"scale": (answer.scales, answer.scale_intervals())}
    if label == LABELS[0]:
        rows["time"] = (answer.times, answer.intervals())
    return {f"{name}_{n}": (float(values[n]), *map(float, bounds[n]))
            for name, (values, bounds) in rows.items() for n in range(len(values))}  # fmt: skip


_PREDICTED = {
    "delay_scatter": partial(_by_holes, times=True, scales=True),
    "misfire_or_charge_error": partial(_by_holes, times=False, scales=True),
    "attenuation_Q": _by_q,
    "site": _by_site,
}


N_CLOSURE_DRAWS = 59
Pair = tuple[np.ndarray, np.ndarray]  # closure in m, stress in Pa


def closure_law(
    closures: Sequence[ArrayLike], stresses: Sequence[ArrayLike], *, seed: int = 0
) -> Verdict:
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
    Verdict
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
    chance = share_as_large(before - after, drawn)
    named = after < before and chance <= SURE
    return Verdict(
        "NAMED" if named else "NULL", "joint_nonlinear_closure",
        f"the hyperbola leaves {after:.3g} Pa, the line {before:.3g} Pa, of closures not fitted; "
        f"{100 * chance:.1f} % of surrogates gain as much",
        parameters=_of_the_next(pairs) if named else {}, chance=chance, held_out=(before, after),
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
