"""Judge records of the drops: odd sensors first, then what surrounds the block, then a loss."""

from dataclasses import dataclass, field, replace

import numpy as np
from known_shots import (
    EARLY,
    HeldOut,
    Lead,
    ShotRecords,
    aligned,
    correlations,
    gains,
    held_out,
    in_band,
    lead,
    loss,
    matched,
)
from survey import BEFORE, DT, FORCE, STEP, STIFFNESSES, Survey

BAND = 50e3, 100e3  # Hz
WITNESS = 100e3, 200e3  # Hz, of no fit
VP = 6200.0  # m/s, of the published model
LENGTH = 4.1  # m
COARSE = np.arange(0.96, 1.0401, 0.01)
FINE = 0.005 * np.arange(-2, 3)  # beside the best of them
RATIOS = 0.985, 1.0, 1.015  # of the S speed at one P speed
FINALISTS = 4
KEEP = 2  # samples of the survey to one of the comparison
SENSOR_LEAD, FLIPPED, ODD_GAIN, LEAST_SPREAD = 12.0, 0.3, 4.5, 0.12


def compared(survey: Survey, samples=None, band=BAND) -> ShotRecords:
    """Return the records in a band, with first arrivals and the echoes of the ends of the block."""
    samples = survey.samples if samples is None else samples
    x, d = survey.shots[:, 0], survey.positions[:, 0]
    ends = [np.hypot(far, 0.0) for far in (x + d, 2.0 * LENGTH - x - d)]
    away = survey.shots[:, :2] - survey.positions[:, :2]
    return ShotRecords(
        in_band(samples, DT, band)[:, ::KEEP], KEEP * DT, BEFORE, band, survey.drops,
        survey.sensors, survey.distances / VP, np.minimum(*ends) / VP - 5e-6,
        away / survey.distances[:, None] / VP,
    )  # fmt: skip


def motion_of(three, factor=1.0, band=BAND) -> np.ndarray:
    """Return motion and its slopes per m, (3, n, n_samples), from responses at drops and beside."""
    parts = []
    for each in three:
        velocity = (each if factor == 1.0 else each.faster(factor)).driven(FORCE)
        padded = np.pad(velocity, ((0, 0), (round(BEFORE / DT), 0)))
        parts.append(in_band(padded, DT, band)[:, ::KEEP])
    return np.array([parts[0], (parts[1] - parts[0]) / STEP, (parts[2] - parts[0]) / STEP])


@dataclass(eq=False)
class Bank:
    """Bank of motion: of each member at ratios and factors of speeds, computed when asked for.

    Parameters
    ----------
    classes : dict of str to str
        By member.
    responses : callable
        ``(member, ratio) -> three Responses``.
    """

    classes: dict[str, str]
    responses: object
    band: tuple[float, float] = BAND
    _motion: dict = field(default_factory=dict)

    def motion(self, member: str, ratio: float, factor: float) -> np.ndarray:
        """Return the motion of a member, (3, n, n_samples) float32."""
        key = member, float(ratio), round(float(factor), 6)
        if key not in self._motion:
            three = self.responses(member, ratio)
            self._motion[key] = motion_of(three, factor, self.band).astype(np.float32)
        return self._motion[key]


# --- sensors -------------------------------------------------------------------------------------


def odd_sensors(records: ShotRecords, match) -> dict[str, dict]:
    """Return sensors whose first arrivals do not fit those of the others, with what is odd."""
    everything = np.ones(len(records.shots), dtype=bool)
    known, _ = gains(records, match, everything)
    if not known:
        return {}
    values = np.array(list(known.values()))
    usual = np.median(values)
    spread = max(1.4826 * np.median(np.abs(values - usual)), LEAST_SPREAD)
    odd = {}
    for name in known:
        if abs(known[name] - usual) > ODD_GAIN * spread:
            odd[name] = {"what": "gain", "factor": float(np.exp(known[name] - usual))}
    return odd


def signed_agreement(records: ShotRecords, motion, match, own) -> float:
    """Return the mean correlation of first arrivals of some records at the clocks of their shots.

    The clocks come from the other sensors, whose median decides.
    """
    moved = aligned(records, motion, match.clocks, match.moves)
    early = records.window(EARLY)
    data = records.samples * early
    cross = np.sum(data * moved, axis=1)
    size = np.sqrt(np.sum(data**2, axis=1) * np.sum((moved * early) ** 2, axis=1))
    return float(np.mean((cross / np.maximum(size, 1e-300))[own]))


def moved_sensors(records: ShotRecords, match) -> dict[str, dict]:
    """Return sensors whose delays ask for another place along the block, or another clock."""
    shots, sensors = np.array(records.shots), np.array(records.sensors)
    names = list(dict.fromkeys(records.sensors))
    raw = match.times + np.array([
        match.clocks[s] + records.slopes[k] @ match.moves[s] for k, s in enumerate(records.shots)
    ])  # fmt: skip
    base = [(shots == name).astype(float) for name in records.names]
    sigma = np.full(len(base), 3e-6)
    columns = [*base, *(records.slopes.T[:, None] * np.array(base)).reshape(-1, len(shots))]
    sigma = np.concatenate([sigma, np.full(2 * len(base), 3e-3)])
    # Places of sensors are rounded to 5 to 10 mm: a deviation of 3 mm along the block for each.
    for name in names:
        columns.append(np.where(sensors == name, -records.slopes[:, 0], 0.0))
    sigma = np.concatenate([sigma, np.full(len(names), 3e-3)])
    matrix = np.array(columns).T * sigma
    noise = 0.5e-6
    base_cov = matrix @ matrix.T + noise**2 * np.eye(len(shots))

    def evidence(covariance):
        sign, logdet = np.linalg.slogdet(covariance)
        return -0.5 * (raw @ np.linalg.solve(covariance, raw) + logdet) * sign

    plain, odd = evidence(base_cov), {}
    for name in names:
        own = sensors == name
        along = np.where(own, -records.slopes[:, 0], 0.0) * 25e-3
        clock = np.where(own, 1.0, 0.0) * 2e-6
        gain_along = evidence(base_cov + np.outer(along, along)) - plain
        gain_clock = evidence(base_cov + np.outer(clock, clock)) - plain
        if max(gain_along, gain_clock) > SENSOR_LEAD:
            what = "place" if gain_along >= gain_clock else "clock"
            odd[name] = {"what": what, "lead": float(max(gain_along, gain_clock))}
    if not odd:
        return {}
    worst = max(odd, key=lambda name: odd[name]["lead"])
    return {worst: odd[worst]}


def swapped_sensors(records: ShotRecords, motion) -> dict[str, dict]:
    """Return two sensors whose records fit one another's motion, in the drops that have both."""
    best = correlations(records, motion[0])[1].max(axis=1)
    index = {pair: k for k, pair in enumerate(zip(records.shots, records.sensors, strict=True))}
    names = list(dict.fromkeys(records.sensors))
    top, answer = 0.0, {}
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            both = [(index[s, first], index[s, second]) for s in records.names
                    if (s, first) in index and (s, second) in index]  # fmt: skip
            if not both:
                continue
            order = np.array(both)
            exchanged = records.taken(order.ravel())
            exchanged = replace(exchanged, samples=records.samples[order[:, ::-1].ravel()])
            after = correlations(exchanged, motion[0][order.ravel()])[1].max(axis=1)
            before = best[order.ravel()]
            gain = float(np.sum(after - before))
            if after.min() > 0.75 and np.median(before) < 0.75 and gain > max(top, 1.0):
                top = gain
                answer = {first: {"what": "swap", "with": second, "gain": gain},
                          second: {"what": "swap", "with": first, "gain": gain}}  # fmt: skip
    return answer


def screened(records: ShotRecords, bank: Bank) -> tuple[dict[str, dict], np.ndarray]:
    """Return odd sensors, and which records stay in the comparison.

    First exchanged sensors, then signs, then places and clocks, then gains.
    """
    best = max(COARSE, key=lambda f: float(np.median(
        matched(records, bank.motion("reference", 1.0, f)).agreement)))  # fmt: skip
    motion, odd = bank.motion("reference", 1.0, best), {}
    whole = records.window(EARLY).any(axis=1)  # an end may be nearer than a first arrival lasts
    for _ in range(3):
        used = whole & ~np.isin(records.sensors, list(odd))
        part, its = records.taken(used), motion[:, used]
        odd_now = swapped_sensors(part, its)
        if not odd_now:
            match = matched(part, its)
            signs = {
                name: signed_agreement(part, its, match, np.array(part.sensors) == name)
                for name in dict.fromkeys(part.sensors)
            }
            odd_now = {
                name: {"what": "polarity", "agreement": value}
                for name, value in signs.items() if value < -FLIPPED
            }  # fmt: skip
            odd_now = odd_now or moved_sensors(part, match) or odd_sensors(part, match)
        if not odd_now:
            break
        odd |= odd_now
    return odd, whole & ~np.isin(records.sensors, list(odd))


def compared_records(answer: dict, records: ShotRecords) -> np.ndarray:
    """Return which records (n,) an answer compares: first arrivals whole, of no odd sensor."""
    odd = np.isin(records.sensors, list(answer["odd_sensors"]))
    return records.window(EARLY).any(axis=1) & ~odd


# --- ground --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Judged:
    """Class of members with its best speeds, chosen by each half for the other."""

    name: str
    states: list[tuple[str, float, float]]
    result: HeldOut

    @property
    def total(self) -> float:
        """Log likelihood of held-out records in all windows."""
        return float(self.result.scores.sum())


def judged(records, used, bank, name, states) -> Judged:
    """Return the held-out score of a class over states (member, ratio, factor)."""
    part = records.taken(used)
    matches = [matched(part, bank.motion(*state)[:, used]) for state in states]
    return Judged(name, list(states), held_out(part, matches))


def judge(records: ShotRecords, bank: Bank, prepare=None, ratios=RATIOS) -> dict:
    """Judge records: odd sensors, the class that leads, whether it may be named, and a loss.

    ``prepare`` may run states (member, ratio) at once before they are asked for.
    """
    odd, used = screened(records, bank)
    part = records.taken(used)
    classes = {}
    for member, label in bank.classes.items():
        classes.setdefault(label, []).append(member)
    fixed = judged(records, used, bank, "reference", [("reference", 1.0, 1.0)])
    answer = {
        "odd_sensors": odd, "records": int(used.sum()),
        "unexplained": summary_of(fixed), "outcome": "NULL", "named": [], "rivals": [],
    }  # fmt: skip
    if not np.any(np.isfinite(fixed.result.shares)):
        answer["outcome"] = "NOT TESTABLE"
        answer["reason"] = "no record lasts to the first window after P"
        return named_sensors(answer)
    coarse = []
    for label, group in classes.items():
        states = [(member, 1.0, f) for member in group for f in COARSE]
        coarse.append(judged(records, used, bank, label, states))
    coarse.sort(key=lambda each: -each.total)
    finals = [each.name for each in coarse[:FINALISTS]]
    finals += [] if "reference" in finals else ["reference"]
    near = {
        each.name: list(dict.fromkeys(each.states[k][0] for k in each.result.chosen))
        for each in coarse if each.name in finals
    }  # fmt: skip
    if prepare is not None:
        prepare([(member, r) for group in near.values() for member in group for r in ratios])
    ranked = []
    for each in coarse:
        if each.name not in finals:
            ranked.append(each)
            continue
        factors = {each.states[k][2] for k in each.result.chosen}
        fine = sorted({round(f + step, 6) for f in factors for step in FINE})
        states = [(member, r, f) for member in near[each.name] for r in ratios for f in fine]
        label = "speeds" if each.name == "reference" else each.name
        ranked.append(judged(records, used, bank, label, states))
    ranked.append(fixed)
    ranked.sort(key=lambda each: -each.total)
    return named_sensors(decided(part, bank, used, ranked, fixed, answer))


def decided(part, bank, used, ranked, fixed, answer) -> dict:
    """Add to an answer which class leads, by how much, and what cannot be told apart from it."""
    first = ranked[0]
    over = {each.name: lead(part, first.result.scores, each.result.scores) for each in ranked[1:]}
    answer["classes"] = [
        {"name": each.name, "log_likelihood": round(each.total - fixed.total, 1),
         **({} if each is first else lead_table(over[each.name])),
         "states": [list(each.states[k]) for k in each.result.chosen]}
        for each in ranked
    ]  # fmt: skip
    if first is not fixed:
        near = [name for name, value in over.items() if not value.decisive]
        near = [name for name in near if not is_limit(ranked, name, first.name)]
        gain = over["reference"]
        rest = [name for name in near if name not in ("reference", "speeds")]
        allowed = gain.decisive and gain.general
        if allowed and not near:
            answer |= {"outcome": "NAMED", "named": [first.name]}
        elif allowed and not {"reference", "speeds"} & set(near):
            answer |= {"outcome": "AMBIGUOUS", "rivals": [first.name, *rest]}
        elif allowed and gain.decisive and "reference" not in near:
            answer |= {"outcome": "AMBIGUOUS", "rivals": [first.name, *near]}
        answer["gain_held_out"] = lead_table(gain)
        answer["unexplained_after"] = summary_of(first)
    state = first.states[first.result.chosen[0]]
    match = matched(part, bank.motion(*state)[:, used])
    moved = aligned(part, bank.motion(*state)[:, used], match.clocks, match.moves)
    both = np.ones(len(part.shots), dtype=bool)
    prediction = np.exp(gains(part, match, both)[1])[:, None] * moved
    inverse, error = loss(part, prediction)
    answer["loss"] = {"inverse_q": round(inverse, 5), "error": round(error, 5)}
    explained = 1.0 - np.nanmedian(first.result.shares[:, 1])
    if abs(inverse) > max(4.0 * error, 0.003) and explained > 0.6:
        answer["named"] = [*answer["named"], "loss"]
        answer["outcome"] = "NAMED"
    return answer


def is_limit(ranked, name: str, first: str) -> bool:
    """Return whether a joint has gone to an end of its stiffnesses, where it is the first class.

    Without stiffness it is a free face, and stiff enough it is welded, as published.
    """
    if not name.endswith("joint"):
        return False
    states = [(each, each.states[k][0]) for each in ranked if each.name == name
              for k in each.result.chosen]  # fmt: skip
    ends = {float(member.rpartition(" ")[2]) for _, member in states}
    free = name.replace("joint", "free")
    return (ends == {STIFFNESSES[0]} and first == free) or (
        ends == {STIFFNESSES[-1]} and first in ("reference", "speeds")
    )


def lead_table(value: Lead) -> dict:
    """Return a lead for a table."""
    return {"behind": round(value.value, 1), "error": round(value.error, 1),
            "drops_that_gain": value.better, "drops": value.of}  # fmt: skip


def summary_of(each: Judged) -> list[float | None]:
    """Return the median unexplained share in each window of held-out records."""
    columns = each.result.shares.T
    return [None if np.isnan(c).all() else round(float(np.nanmedian(c)), 3) for c in columns]


def named_sensors(answer: dict) -> dict:
    """Name odd sensors before anything else."""
    if answer["odd_sensors"]:
        marks = [f"{name} {row['what']}" for name, row in answer["odd_sensors"].items()]
        answer["named"] = [*marks, *answer["named"]]
        answer["outcome"] = "NAMED"
    return answer
