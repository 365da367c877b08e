"""The figures of the studies on real recordings."""

import numpy as np
from matplotlib import pyplot as plt
from real_line import FIGURES
from scipy import fft


def draw_hits(pairs, found, floors, octaves, noise, band, bands):
    """One sum in time, misfit and PPV by receiver, misfit by octave."""
    colours, along = {"plain": "C3", "corrected": "C0"}, 2.0 * np.arange(24)
    labels = {"plain": "one hit repeated", "corrected": "with scale and shift per hit"}
    figure, axes = plt.subplots(2, 2, figsize=(12, 8), layout="constrained")
    ((time, misfit), (ppv, octave)) = axes
    time.plot(pairs[0][12][0].times, 1e3 * pairs[0][12][0].bandpassed(*band).velocity[:, 2], "k",
              label="sum of 12 real hits", lw=1.6)  # fmt: skip
    for name, each in zip(colours, pairs, strict=True):
        motion = each[12][1].bandpassed(*band)
        time.plot(motion.times, 1e3 * motion.velocity[:, 2], colours[name], label=labels[name],
                  lw=1)  # fmt: skip
        values = np.array(found[name])
        for axis, what, factor in ((misfit, 0, 1.0), (ppv, 1, 100.0)):
            middle, low, high = factor * np.percentile(values[..., what], [50, 5, 95], axis=0)
            axis.plot(along, middle, colours[name], label=labels[name])
            axis.fill_between(along, low, high, color=colours[name], alpha=0.2, lw=0)
        middle, low, high = np.percentile(octaves[name], [50, 5, 95], axis=(0, 1))
        octave.errorbar(np.arange(5) + 0.1 * (name == "plain"), middle,
                        (middle - low, high - middle), fmt="o", color=colours[name],
                        label=labels[name], capsize=3)  # fmt: skip
    octave.plot([value[0] for value in noise.values()], "k_", ms=16, label="noise alone, median")
    misfit.plot(along, np.median(floors, axis=0), "k:", label="noise before the trigger alone")
    time.set(xlabel="time after the first hole [s]", ylabel="geophone output [mV]",
             title=f"Receiver at 24 m, {band[0]:g} to {band[1]:g} Hz", xlim=(0, 1.1))  # fmt: skip
    misfit.set(xlabel="receiver along the line [m]", ylabel="misfit $\\Sigma(d-s)^2/\\Sigma d^2$",
               yscale="log", title="Waveform: median and 5 to 95 % of the draws")  # fmt: skip
    ppv.set(xlabel="receiver along the line [m]", ylabel="PPV, predicted over real - 1 [%]",
            title="PPV: median and 5 to 95 % of the draws")  # fmt: skip
    octave.set(xticks=range(5), ylabel="misfit", yscale="log", xlabel="band [Hz]",
               xticklabels=[f"{a:g} to {b:g}" for a, b in bands],
               title="Waveform by octave, all receivers and draws")  # fmt: skip
    for axis in axes.flat:
        axis.legend(fontsize=8)
    figure.savefig(FIGURES / "real_hits_superposed.png", dpi=80)


def draw_gather(offsets, dt, recorded, simulated, quiet, breaks, head, misfit, bins, speeds,
                carries, nearest):  # fmt: skip
    """Wiggles with first arrivals, spectra, phase speeds, misfit by receiver and frequency."""
    figure = plt.figure(figsize=(14, 9), layout="constrained")
    axes = figure.subplot_mosaic([["wiggles", "spectra", "speeds"], ["wiggles", "map", "map"]],
                                 width_ratios=(1.4, 1, 1))  # fmt: skip
    times = dt * np.arange(recorded.shape[1])
    for offset, d, s in zip(offsets, recorded, simulated, strict=True):
        for motion, colour in ((d, "k"), (s, "C3")):
            line = offset + 1.8 * motion / np.max(np.abs(d))
            axes["wiggles"].plot(times, line, colour, lw=0.8)
    near = offsets < 35.0
    axes["wiggles"].plot(
        breaks[near], offsets[near], "C0+", ms=9, label="first break, five hits stacked"
    )
    axes["wiggles"].plot(head, offsets, "C0", lw=0.8, label="first arrival of the two layers")
    axes["wiggles"].plot([], [], "k", label="recorded")
    axes["wiggles"].plot([], [], "C3", label="simulated")
    axes["wiggles"].axhspan(offsets[0] - 1.5, offsets[nearest - 1] + 1.0, color="0.93", zorder=0)
    axes["wiggles"].text(0.54, 12.5, "force estimated below", ha="right", fontsize=8)
    axes["wiggles"].set(xlabel="time after the trigger [s]", ylabel="distance from the hit [m]",
                        title="5 to 30 Hz, each pair scaled by its record", xlim=(0, 0.55),
                        ylim=(-8, 54))  # fmt: skip
    frequency = fft.rfftfreq(2048, dt)
    for colour, n in zip(("C0", "C1", "C2"), (4, 12, 20), strict=True):
        for motion, style in ((recorded, "-"), (simulated, "--"), (quiet, ":")):
            amplitude = 1e3 * dt * np.abs(fft.rfft(motion[n], 2048))
            axes["spectra"].semilogy(frequency, amplitude, colour + style, lw=1)
        axes["spectra"].plot([], [], colour, label=f"{offsets[n]:g} m")
    axes["spectra"].set(xlabel="frequency [Hz]", ylabel="amplitude [mV/Hz]", xlim=(4, 35),
                        ylim=(1e-4, 1e-1),
                        title="Recorded -, simulated --, noise ···")  # fmt: skip
    axes["speeds"].plot(speeds[0], speeds[1], "ko", label="recorded")
    axes["speeds"].plot(speeds[0], speeds[2], "C3s", mfc="none", label="simulated")
    axes["speeds"].set(xlabel="frequency [Hz]", ylabel="phase speed [m/s]", ylim=(160, 230),
                       title="Ground wave")  # fmt: skip
    image = axes["map"].pcolormesh(bins, np.append(offsets - 1.0, offsets[-1] + 1.0), misfit,
                                   vmin=0.0, vmax=2.0, cmap="magma_r")  # fmt: skip
    figure.colorbar(image, ax=axes["map"], extend="max",
                    label="misfit $\\Sigma|D-S|^2/\\Sigma|D|^2$")  # fmt: skip
    top = min(carries.values())
    axes["map"].axvline(top, color="C0", ls="--", lw=2)
    axes["map"].axhline(offsets[nearest] - 1.0, color="0.3", lw=0.8)
    axes["map"].set(xlabel="frequency [Hz]", ylabel="distance from the hit [m]",
                    title="Not explained by two layers; dashed: 10 edges per wavelength"
                    )  # fmt: skip
    for name in ("wiggles", "spectra", "speeds"):
        axes[name].legend(fontsize=8, loc="lower right" if name == "wiggles" else "best")
    figure.savefig(FIGURES / "real_ground_point_force.png", dpi=75)


def draw_firing_times(draws):
    """Found against true delays, errors by hole, one unseen receiver, shares explained."""
    figure, ((delays, errors), (time, shares)) = plt.subplots(
        2, 2, figsize=(12, 8), layout="constrained"
    )
    both = [(draw, draw[half]) for draw in draws for half in (0, 1)]
    away = 1e3 * np.array([draw["truth"] - draw["nominal"] for draw, _ in both])
    found = 1e3 * np.array([half["times"] - draw["nominal"] for draw, half in both])
    width = 1e3 * np.array([np.diff(half["intervals"])[:, 0] / 2 for _, half in both])
    delays.errorbar(away.ravel(), found.ravel(), width.ravel(), fmt=".", ms=4, lw=0.5, color="C0",
                    label="found, 90 % interval")  # fmt: skip
    ends = np.array([away.min(), away.max()])
    delays.plot(ends, ends, "k", lw=0.8, label="truth")
    delays.plot(ends, 0.0 * ends, "C3--", lw=0.8, label="plan")
    delays.set(xlabel="true time after the plan [ms]", ylabel="found time after the plan [ms]",
               title="Firing times, all holes, draws and halves")  # fmt: skip
    for gap, colour, label in ((away, "C3", "plan"), (found - away, "C0", "found")):
        middle, high = np.percentile(np.abs(gap), [50, 90], axis=0)
        errors.plot(np.arange(1, 13), middle, colour + "o-", label=f"{label}, median")
        errors.plot(np.arange(1, 13), high, colour + "^:", label=f"{label}, 90 %")
    errors.set(xlabel="hole", ylabel="error of the time [ms]", xticks=range(1, 13),
               title="Errors by hole, two at each of six places", ylim=(0, 8.5))  # fmt: skip
    draw, half = both[0]
    receiver = half["held"][len(half["held"]) // 2]
    seconds = draw["start"] + 1e-3 * np.arange(draw["recorded"].shape[1])
    lines = (draw["recorded"], *half["guesses"]), ("k", "C3", "C0"), ("sum of 12 real hits",
             "one hit, plan", "one hit, found times")  # fmt: skip
    for motion, colour, label in zip(*lines, strict=True):
        time.plot(seconds, 1e3 * motion[receiver], colour, lw=1.0, label=label)
    time.set(xlabel="time after the first hole [s]", ylabel="geophone output [mV]", xlim=(0, 0.8),
             title=f"Receiver at {2 * receiver} m, not used for the times")  # fmt: skip
    share = np.array([half["explained"] for _, half in both])
    shares.plot(share[:, 0], share[:, 1], "ko", ms=4)
    shares.axline((0.0, 0.0), slope=1.0, color="0.6", lw=0.8)
    shares.set(xlabel="by the plan", ylabel="by the found times and scales", ylim=(0, 1),
               title="Share of the energy explained at unseen receivers")  # fmt: skip
    for axis in (delays, errors, time):
        axis.legend(fontsize=8)
    figure.savefig(FIGURES / "real_firing_times.png", dpi=80)


def draw_plans(first, best, real, table, nominal):
    """Bands against real peaks, the map of the search, real blasts by both plans, coverage."""
    figure, ((along, chart), (steps, held)) = plt.subplots(
        2, 2, figsize=(12, 8), layout="constrained"
    )
    bands, peaks = first
    place = 2.0 * np.arange(0, 24, 3)
    for share, colour in ((0.95, "0.88"), (0.9, "0.78"), (0.5, "0.6")):
        low, high = 1e3 * bands.band(share)
        along.fill_between(place, low, high, color=colour, label=f"{100 * share:g} % band")
    along.plot(place, 1e3 * peaks.T, "C3.", ms=2)
    along.plot([], [], "C3.", label="sums of other real hits")
    along.set(xlabel="receiver along the line [m]", ylabel="peak output [mV]", yscale="log",
              title="Peaks of the nominal plan")  # fmt: skip
    points = chart.scatter(1e3 * best.tried[:, 0], 1e3 * best.tried[:, 1], c=best.tried[:, 2],
                           s=14, cmap="viridis_r")  # fmt: skip
    figure.colorbar(points, ax=chart, label="severity, 90 % of blasts are below")
    chart.plot(*(1e3 * np.array(nominal)), "k^", label="nominal")
    chart.plot(*(1e3 * best.delays), "C3*", ms=14, label="best")
    chart.set(xlabel="delay between places [ms]", ylabel="delay between rounds [ms]",
              title="Plans tried (hit 5 of each place)")  # fmt: skip
    for values, colour, label in zip(real.transpose(1, 0, 2).reshape(2, -1), ("k", "C3"),
                                     ("nominal", "best"), strict=True):  # fmt: skip
        steps.plot(np.sort(values), np.linspace(0, 1, len(values)), colour, label=label)
    steps.set(xlabel="largest peak of three receivers over its nominal median",
              ylabel="share of real sums below", title="Real sums by both plans")  # fmt: skip
    for name, rows in table.items():
        wanted = [float(share.split()[0]) for share in rows]
        held.plot(wanted, [100 * row["band"] for row in rows.values()], "o-", label=name)
    held.plot([45, 100], [45, 100], "k", lw=0.8)
    held.set(xlabel="band [%]", ylabel="real peaks inside [%]", title="Reliability of the bands")
    for axis in (along, chart, steps, held):
        axis.legend(fontsize=8)
    figure.savefig(FIGURES / "real_bands_and_delays.png", dpi=80)
