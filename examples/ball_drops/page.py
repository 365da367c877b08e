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

BEFORE_COLOUR, AFTER_COLOUR, RECORD, FITTED = "#c44e52", "#4c72b0", "0.55", "0.92"
MODELS = ("published model", BEFORE_COLOUR), ("diagnosed model", AFTER_COLOUR)
LATE = 15e-6, 100e-6  # s after the first arrival
LATE_US = f"{1e6 * LATE[0]:.0f} to {1e6 * LATE[1]:.0f} µs"
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
    sensors = {}
    shares = [explained(part, each, LATE) for each in (before, after)]
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
            share = explained(own, predictions(own, [motion] * 2), LATE)
            row[key] = round(float(np.nanmedian(share)), 3)
        octaves.append(row)
    first = next(
        (row for row in times[1:] if row["published"] < 0.7), {"after_p_us": None}
    )  # fmt: skip
    return {"first_window_below_0.7_us": first["after_p_us"], "windows": times,
            "sensors": sensors, "octaves": octaves}  # fmt: skip


def _png(figure) -> bytes:
    """Return a figure as PNG."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=110)
    plt.close(figure)
    return file.getvalue()


def _uri(image: bytes) -> str:
    """Return a PNG as a data URI."""
    return "data:image/png;base64," + base64.b64encode(image).decode()


def traces_figure(part, before, after, distances):
    """Draw a near, a middle and a far sensor, each in a drop that its prediction has not used."""
    figure, axes = plt.subplots(
        2, 3, figsize=(13, 6), sharex=True, sharey="col", layout="constrained"
    )
    whole = part.arrivals + WINDOWS[-1][1] <= part.ends
    order = [k for k in np.argsort(part.arrivals) if whole[k]]
    times = part.dt * np.arange(part.samples.shape[1]) - part.before
    handles = {}
    for column, share in zip(axes.T, (0.1, 0.5, 0.9), strict=True):
        k = order[int(share * (len(order) - 1))]
        own = 1e6 * (times - part.arrivals[k])
        seen = (own >= -10.0) & (own <= 200.0)
        column[0].set_title(
            f"sensor {part.sensors[k]}, drop {part.shots[k]}, {1e3 * distances[k]:.0f} mm apart",
            fontsize=10,
        )
        for axis, each, (name, colour) in zip(column, (before, after), MODELS, strict=True):
            _shade_early(axis)
            axis.plot(own[seen], part.samples[k, seen], color=RECORD, lw=1.8,
                      label="recorded")  # fmt: skip
            axis.plot(own[seen], each[k, seen], color=colour, lw=1.0, label=name)
            energy = explained(part, each, LATE)[k]
            axis.text(0.98, 0.03, f"explained from {LATE_US}: {energy:.2f} of the energy",
                      color=colour, ha="right", transform=axis.transAxes, fontsize=8)  # fmt: skip
            lines, labels = axis.get_legend_handles_labels()
            handles |= dict(zip(labels, lines, strict=True))
        low, high = column[1].get_ylim()
        column[1].set(xlim=(-10.0, 200.0), ylim=(low - 0.12 * (high - low), high),
                      xlabel="time after the first arrival [µs]")  # fmt: skip
    for axis in axes[:, 0]:
        axis.set_ylabel("sensor output [V]")
    figure.legend(handles.values(), handles, loc="outside upper center", ncol=4, frameon=False)
    return figure


def _shade_early(axis):
    """Shade the first arrival, to which gains, clocks and places are fitted."""
    axis.axvspan(1e6 * EARLY[0], 1e6 * EARLY[1], color=FITTED, zorder=0,
                 label="first arrival: sets gain and clock")  # fmt: skip


def shares_figure(part, before, after):
    """Draw the explained share against time after the first arrival, with quartiles of records."""
    figure, axis = plt.subplots(figsize=(7.5, 4), layout="constrained")
    starts = np.arange(-5e-6, 181e-6, 5e-6)
    _shade_early(axis)
    for each, (name, colour) in zip((before, after), MODELS, strict=True):
        values = [explained(part, each, (s, s + 20e-6)) for s in starts]
        low, mid, high = np.nanpercentile(values, [25, 50, 75], axis=1)
        axis.plot(1e6 * starts + 10, mid, color=colour, label=f"{name}: median, quartiles")
        axis.fill_between(1e6 * starts + 10, low, high, color=colour, alpha=0.2, lw=0)
    axis.axhline(0.0, color="0.7", lw=0.6)
    axis.set(ylim=(-1.0, 1.0), xlim=(0, 195),
             xlabel="time after the first arrival, middle of a window of 20 µs [µs]",
             ylabel="explained share of energy")  # fmt: skip
    figure.legend(loc="outside upper center", ncol=3, frameon=False, fontsize=8)
    return figure


def gains_figure(part, before, after, answer):
    """Draw the change of the explained share of each drop, and the leads of all classes."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.4), layout="constrained")
    by_drop = drop_gains(part, before, after)
    names, values = list(by_drop), [row[1] - row[0] for row in by_drop.values()]
    left.bar(names, values, color=[AFTER_COLOUR if v > 0 else BEFORE_COLOUR for v in values])
    left.axhline(0.0, color="0.5", lw=0.6)
    left.tick_params(axis="x", rotation=90)
    left.set(xlabel="drop", ylabel=f"gain of explained share, {LATE_US}",
             title="diagnosed over published model, by drop")  # fmt: skip
    rows = answer["classes"][:12][::-1]
    right.barh([row["name"] for row in rows], [row["log_likelihood"] for row in rows],
               color="#8c8c8c", xerr=[row.get("error", 0.0) for row in rows])  # fmt: skip
    right.axvline(0.0, color="0.5", lw=0.6)
    right.set(xlabel="log likelihood of held-out drops over the published model",
              title="boundaries, joints and cracks that were tried")  # fmt: skip
    return figure


def drop_gains(part, before, after) -> dict[str, list[float]]:
    """Return the median explained share of each drop from 15 to 100 µs, before and after."""
    shares, shots = [explained(part, each, LATE) for each in (before, after)], {}
    for name in part.names:
        own = np.array(part.shots) == name
        if np.isfinite(shares[0][own]).any():
            shots[name] = [round(float(np.nanmedian(each[own])), 3) for each in shares]
    return shots


def write_page(path, answer: dict, records: ShotRecords, bank: Bank, survey: Survey) -> None:
    """Write the page of an answer, with its figures ``traces.png`` and ``shares.png`` beside it."""
    part, before, after = pair_of(answer, records, bank)
    used = compared_records(answer, records)
    answer["drops"] = drop_gains(part, before, after)
    traces = _png(traces_figure(part, before, after, survey.distances[used]))
    shares = _png(shares_figure(part, before, after))
    gains = _png(gains_figure(part, before, after, answer))
    odd = "; ".join(f"{name}: {row['what']}" for name, row in answer["odd_sensors"].items())
    text = (HERE / "page.html").read_text(encoding="utf-8").format(
        sentence=html.escape(answer["sentence"]),
        traces=_uri(traces), shares=_uri(shares), gains=_uri(gains),
        rivals=html.escape(answer["rivals_sentence"]),
        odd=html.escape(odd or "None is odd by its first arrivals."),
        untestable=html.escape(answer["untestable"]), runs=answer["runs"],
        seconds=answer["processor_s"], program=answer["program"],
    )  # fmt: skip
    path.write_text(text, encoding="utf-8")
    path.with_name("traces.png").write_bytes(traces)
    path.with_name("shares.png").write_bytes(shares)
