"""The page of the ball drops: where the published model fails, what is named, and what it gains."""

import base64
import html
import io

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from judge import Bank, compared, compared_records, motion_of
from known_shots import (
    EARLY,
    WINDOWS,
    ShotRecords,
    aligned,
    gains,
    matched,
)
from survey import HERE, Survey

BEFORE_COLOUR, AFTER_COLOUR, RECORD = "#c44e52", "#4c72b0", "0.55"
OCTAVES = (25e3, 50e3), (50e3, 100e3)
STEPS = np.arange(-5e-6, 186e-6, 20e-6)


def predictions(records: ShotRecords, motions) -> np.ndarray:
    """Return predictions (n, n_samples) of each half of the drops, with gains of the other half."""
    result = np.zeros_like(records.samples)
    for (fitted, other), motion in zip(
        (records.halves, records.halves[::-1]), motions, strict=True
    ):
        match = matched(records, motion)
        moved = aligned(records, motion, match.clocks, match.moves)
        amplitudes = gains(records, match, fitted)[1]
        result[other] = (np.exp(amplitudes)[:, None] * moved)[other]
    return result


def pair_of(answer: dict, records: ShotRecords, bank: Bank):
    """Return the compared records and their held-out predictions, published and as answered."""
    used = compared_records(answer, records)
    part = records.taken(used)
    published = [("reference", 1.0, 1.0)] * 2
    answered = [tuple(state) for state in answer["classes"][0]["states"]]
    each = [
        predictions(part, [bank.motion(*state)[:, used] for state in states])
        for states in (published, answered)
    ]
    return part, *each


def explained(records: ShotRecords, prediction, window) -> np.ndarray:
    """Return the explained share (n,) of the energy in a window; NaN where a record ends before."""
    weights = records.window(window)
    energy = np.sum(weights * records.samples**2, axis=1)
    rest = np.sum(weights * (records.samples - prediction) ** 2, axis=1)
    return np.where(energy > 0.0, 1.0 - rest / np.where(energy > 0.0, energy, 1.0), np.nan)


def located(answer: dict, records: ShotRecords, bank: Bank, survey: Survey) -> dict:
    """Return when, where and in which octave records and models part, before and after."""
    part, before, after = pair_of(answer, records, bank)
    times = [
        {"after_p_us": [round(1e6 * start), round(1e6 * start) + 20],
         **{key: round(float(np.nanmedian(explained(part, each, (start, start + 20e-6)))), 3)
            for key, each in (("published", before), ("answer", after))}}
        for start in STEPS
    ]  # fmt: skip
    sensors, late = {}, (15e-6, 100e-6)
    shares = [explained(part, each, late) for each in (before, after)]
    for name in sorted(dict.fromkeys(part.sensors)):
        own = np.array(part.sensors) == name
        if np.isfinite(shares[0][own]).any():
            sensors[name] = [round(float(np.nanmedian(each[own])), 3) for each in shares]
    octaves = []
    used = compared_records(answer, records)
    state = tuple(answer["classes"][0]["states"][0])
    for band in OCTAVES:
        own = compared(survey, band=band).taken(used)
        row = {"band_hz": list(band)}
        for key, each in (("published", ("reference", 1.0, 1.0)), ("answer", state)):
            three = bank.responses(each[0], each[1])
            motion = motion_of(three, each[2], band)[:, used]
            share = explained(own, predictions(own, [motion] * 2), late)
            row[key] = round(float(np.nanmedian(share)), 3)
        octaves.append(row)
    first = next(
        (row for row in times[1:] if row["published"] < 0.7), {"after_p_us": None}
    )  # fmt: skip
    return {"first_window_below_0.7_us": first["after_p_us"], "windows": times,
            "sensors": sensors, "octaves": octaves}  # fmt: skip


def _uri(figure) -> str:
    """Return a figure as a data URI."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    plt.close(figure)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def traces_figure(part, before, after, survey_distances) -> str:
    """Draw a near, a middle and a far sensor, each in a drop that its prediction has not used."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    whole = part.arrivals + WINDOWS[-1][1] <= part.ends
    order = [k for k in np.argsort(part.arrivals) if whole[k]]
    times = part.dt * np.arange(part.samples.shape[1]) - part.before
    for axis, share in zip(axes, (0.1, 0.5, 0.9), strict=True):
        k = order[int(share * (len(order) - 1))]
        own = 1e6 * (times - part.arrivals[k])
        top = np.abs(part.samples[k]).max()
        for each, colour, down in ((before, BEFORE_COLOUR, 0.0), (after, AFTER_COLOUR, -1.7)):
            axis.plot(own, part.samples[k] / top + down, color=RECORD, lw=1.8)
            axis.plot(own, each[k] / top + down, color=colour, lw=1.0)
        axis.axvspan(1e6 * EARLY[0], 1e6 * EARLY[1], color="0.92", zorder=0)
        axis.set(xlim=(-10, 200), ylim=(-2.9, 1.2), yticks=[], xlabel="time after P  µs",
                 title=f"{part.sensors[k]}, drop {part.shots[k]}, "
                       f"{1e3 * survey_distances[k]:.0f} mm")  # fmt: skip
    axes[0].text(195, 0.9, "published model", color=BEFORE_COLOUR, ha="right")
    axes[0].text(195, -0.8, "answer", color=AFTER_COLOUR, ha="right")
    return _uri(figure)


def shares_figure(part, before, after) -> str:
    """Draw the explained share against time after P, with quartiles of records."""
    figure, axis = plt.subplots(figsize=(7, 3.6), layout="constrained")
    starts = np.arange(-5e-6, 181e-6, 5e-6)
    for each, colour, label in (
        (before, BEFORE_COLOUR, "published model"),
        (after, AFTER_COLOUR, "answer"),
    ):
        values = [explained(part, each, (s, s + 20e-6)) for s in starts]
        low, mid, high = np.nanpercentile(values, [25, 50, 75], axis=1)
        axis.plot(1e6 * starts + 10, mid, color=colour, label=label)
        axis.fill_between(1e6 * starts + 10, low, high, color=colour, alpha=0.2, lw=0)
    axis.axvspan(1e6 * EARLY[0], 1e6 * EARLY[1], color="0.92", zorder=0)
    axis.axhline(0.0, color="0.7", lw=0.6)
    axis.set(ylim=(-1.0, 1.0), xlim=(0, 195), xlabel="middle of a window of 20 µs after P  µs",
             ylabel="explained share of energy")  # fmt: skip
    axis.legend(frameon=False, loc="lower left")
    return _uri(figure)  # fmt: skip


def gains_figure(part, before, after, answer) -> str:
    """Draw the change of the explained share of each drop, and the leads of all classes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.0), layout="constrained")
    by_drop = drop_gains(part, before, after)
    names, values = list(by_drop), [row[1] - row[0] for row in by_drop.values()]
    left.bar(names, values, color=[AFTER_COLOUR if v > 0 else BEFORE_COLOUR for v in values])
    left.tick_params(axis="x", rotation=90)
    left.set(xlabel="drop", ylabel="gain of explained share, 15 to 100 µs after P")
    rows = answer["classes"][:12][::-1]
    right.barh([row["name"] for row in rows], [row["log_likelihood"] for row in rows],
               color="#8c8c8c", xerr=[row.get("error", 0.0) for row in rows])  # fmt: skip
    right.set(xlabel="log likelihood of held-out drops over the published model")
    return _uri(figure)


def drop_gains(part, before, after) -> dict[str, list[float]]:
    """Return the median explained share of each drop from 15 to 100 µs, before and after."""
    shares, shots = [explained(part, each, (15e-6, 100e-6)) for each in (before, after)], {}
    for name in part.names:
        own = np.array(part.shots) == name
        if np.isfinite(shares[0][own]).any():
            shots[name] = [round(float(np.nanmedian(each[own])), 3) for each in shares]
    return shots


def write_page(path, answer: dict, records: ShotRecords, bank: Bank, survey: Survey) -> None:
    """Write the page of an answer."""
    part, before, after = pair_of(answer, records, bank)
    used = compared_records(answer, records)
    answer["drops"] = drop_gains(part, before, after)
    odd = "; ".join(f"{name}: {row['what']}" for name, row in answer["odd_sensors"].items())
    text = (HERE / "page.html").read_text(encoding="utf-8").format(
        sentence=html.escape(answer["sentence"]),
        traces=traces_figure(part, before, after, survey.distances[used]),
        shares=shares_figure(part, before, after), gains=gains_figure(part, before, after, answer),
        rivals=html.escape(answer["rivals_sentence"]),
        odd=html.escape(odd or "None is odd by its first arrivals."),
        untestable=html.escape(answer["untestable"]), runs=answer["runs"],
        seconds=answer["processor_s"], program=answer["program"],
    )  # fmt: skip
    path.write_text(text, encoding="utf-8")
