"""Cause of a misfit between a blast and its plan: firing times, charges, attenuation or site."""

from functools import partial

import numpy as np
from firing_times import firing_times
from numpy.typing import ArrayLike
from scipy import fft

from pyblast.errors import InputError
from pyblast.line_records.shots import (
    SIGNIFICANCE,
    EffectDecision,
    permutation_p,
    phase_randomised,
    shifted,
)

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
) -> EffectDecision:
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
    Decision
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
        p_value = _chance(job, recorded, guesses[CHARGE], (CHARGE, best), scores, rng)
        best = best if p_value <= SIGNIFICANCE else CHARGE
    p_value = _chance(job, recorded, guesses["plan"], ("plan", best), scores, rng)
    if scores[best] <= scores["plan"] or p_value > SIGNIFICANCE:
        return EffectDecision("NULL", best, reason, p_value=p_value)
    own = _left(recorded, guesses[best])
    rivals = [one for one in LABELS if one != best and (best, one) not in NESTED
              and not _surely_less(own, _left(recorded, guesses[one]))]  # fmt: skip
    return EffectDecision(
        "CLASS" if rivals else "NAMED", " | ".join([best, *rivals]), reason,
        tuple(range(len(nominal))), _parameters(job, recorded, best), p_value=p_value,
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
    return permutation_p(scores[labels[1]] - scores[labels[0]], drawn)


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
