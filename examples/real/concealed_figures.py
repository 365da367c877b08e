"""Figure of what analyses of real records say: air wave, soft layer, closure, odd receivers."""

import matplotlib
import numpy as np
from closure_law import fit_hyperbola, hyperbola
from keeper import OUTCOMES, folder_of_recordings, refraction_line, wghs
from real_line import FIGURES
from scipy import signal
from t2_air_wave import BANDS
from t4_soft_layer import BAND, FREQUENCIES
from t7_closure_law import specimens

from pyblast.line_records.waves import phase_speeds, rayleigh_speeds

matplotlib.use("Agg")
from matplotlib import pyplot as plt


def air(axes, shot, said):
    """Draw envelopes by distance with the window that was named."""
    band = BANDS["refrapy_ex02"]
    rows = np.abs(signal.hilbert(shot.banded(band).motion, axis=1))
    order = np.argsort(shot.offsets)
    rows = rows[order] / rows[order].max(axis=1, keepdims=True)
    axes.pcolormesh(1e3 * shot.times, shot.offsets[order], np.log10(rows + 1e-3), vmin=-2.0,
                    cmap="Greys", shading="nearest", rasterized=True)  # fmt: skip
    speed, delay = (said["parameters"][k][0] for k in ("speed", "delay"))
    for edge in said["window"]:
        axes.plot(1e3 * (shot.offsets[order] / speed + delay + edge), shot.offsets[order], "C3")
    axes.set(xlim=(0, 450), xlabel="time [ms]", ylabel="distance [m]",
             title=f"air wave of {speed:.0f} m/s, {band[0]:g} to {band[1]:g} Hz")  # fmt: skip


def layer(axes, hits, said):
    """Draw phase speeds from both ends and the layer found from one end."""
    ends = (
        ((-5.0, -10.0, -20.0), "C0o", "shots from the left, fitted"),
        ((51.0, 56.0, 66.0), "C1s", "shots from the right, held out"),
    )
    for places, style, name in ends:
        picks = phase_speeds([s for p in places for s in hits[p]], FREQUENCIES)
        axes.errorbar(picks.frequency, picks.speed, picks.sigma, fmt=style, ms=4, label=name)
    if said["parameters"]:
        h, one, two = (said["parameters"][k][0] for k in ("thickness", "vs_layer", "vs_below"))
        axes.plot(FREQUENCIES, rayleigh_speeds(FREQUENCIES, [h], [one, two]), "C3",
                  label=f"{h:.1f} m of Vs {one:.0f} on {two:.0f} m/s")  # fmt: skip
    axes.set(xscale="log", xlim=BAND, xlabel="frequency [Hz]", ylabel="phase speed [m/s]",
             title="soft layer")  # fmt: skip
    axes.set_xticks([10, 20, 30, 50], ["10", "20", "30", "50"])
    axes.minorticks_off()
    axes.legend(frameon=False)


def closure(axes, known):
    """Draw the third specimen and what the other two predict."""
    *others, (u, s) = known.values()
    for x, y in others:
        label = None if axes.lines else "two specimens, fitted"
        axes.plot(1e3 * x, 1e-6 * y, "C0.", ms=4, label=label)
    axes.plot(1e3 * u, 1e-6 * s, "ko", ms=4, label="a third, held out")
    x = np.linspace(0.0, u.max(), 50)
    axes.plot(
        1e3 * x, 1e-6 * hyperbola(fit_hyperbola(others), x), "C3", label="hyperbola of the two"
    )
    closure, stress = (np.concatenate(z) for z in zip(*others, strict=True))
    line = np.polyfit(closure, stress, 1)
    axes.plot(1e3 * x, 1e-6 * np.polyval(line, x), "C1--", label="line of the two")
    axes.set(xlabel="closure [mm]", ylabel="normal stress [MPa]", title="closure of a joint")
    axes.legend(frameon=False)


def sizes(axes, rows):
    """Draw sizes found against those that were drawn."""
    for label, knob, unit, style in (("clock_error", "shift", 1e-3, "C0o"),
                                     ("wrong_coordinates", "move", 1.0, "C1s")):  # fmt: skip
        some = [row for row in rows.values() if row["truth"].get("label") == label and row["right"]]
        true = np.array([row["truth"]["size"] for row in some]) / unit
        found = np.array([row["said"][0]["parameters"][knob] for row in some]) / unit
        half = np.abs(found[:, 1:] - found[:, :1]).T
        axes.errorbar(true, found[:, 0] - true, half, fmt=style, ms=4,
                      label=f"{knob} [{'ms' if unit < 1 else 'm'}], 90 %")  # fmt: skip
    axes.axhline(0.0, color="k", lw=0.5)
    axes.set(xlabel="concealed shift [ms] or move [m]", ylabel="estimated less concealed [ms, m]",
             title="odd receivers")  # fmt: skip
    axes.legend(frameon=False, loc="lower center", ncol=2)


def main():
    """Draw what outcomes.json holds."""
    import json

    folder, outcomes = folder_of_recordings(), json.loads(OUTCOMES.read_text(encoding="utf-8"))
    figure, panels = plt.subplots(2, 2, figsize=(9, 7), layout="constrained")
    air(panels[0, 0], refraction_line(folder)[0], outcomes["T2"]["refrapy_ex02"]["said"][0])
    layer(panels[0, 1], wghs(folder), outcomes["T4"]["from the left"]["said"][0])
    closure(panels[1, 0], specimens(folder))
    sizes(panels[1, 1], outcomes["odd_channels"])
    figure.savefig(FIGURES / "real_concealed.png", dpi=110)


if __name__ == "__main__":
    main()
