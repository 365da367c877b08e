"""Diagnose a site that conceals an effect, and predict a blast that no fit has used.

    python examples/concealed/proof.py [FOLDER]

Results go to FOLDER (``proof`` beside this file). ``truth/truth.toml``, which says what was
concealed, is not read.
"""

import sys
from pathlib import Path

import matplotlib
import numpy as np

from pyblast.diagnosis.summary import diagnosis_lines
from pyblast.inference.records import band_functions
from pyblast.recordings.recording import read_stations
from pyblast.runs.parallel import workers
from pyblast.workflows.diagnose import diagnose_case, predict_case

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent
FIGURE = "proof.png"
BAND = 3.0, 30.0  # Hz, as in the project files
MODELS = ("calibrated", "tab:orange"), ("diagnosed", "tab:blue")


def in_band(recordings):
    """Return the motion (3, n_samples) of each receiver in the band, and its times."""
    motion = {}
    for name, recording in recordings.items():
        record = recording.seismogram
        band = band_functions(len(record.velocity), record.dt, BAND)
        motion[name] = record.times, record.velocity.T @ band.basis @ band.basis.T
    return motion


def misfits(recorded, predicted):
    """Return the energy of the difference over that of the record, by receiver."""
    return {
        name: float(np.sum((motion - predicted[name][1]) ** 2) / np.sum(motion**2))
        for name, (_, motion) in recorded.items()
    }


def shown(misfit):
    """Return the best, the median and the worst predicted receiver, by their captions.

    Ranked by the energy that the diagnosed site leaves unexplained.
    """
    order = sorted(misfit["diagnosed"], key=misfit["diagnosed"].__getitem__)
    return {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}


def draw(path, recorded, predicted, misfit):
    """Draw the best, the median and the worst predicted receiver, and what each model misses."""
    figure, axes = plt.subplot_mosaic(
        [["best", "all"], ["median", "all"], ["worst", "all"]], figsize=(11, 7),
        width_ratios=(3, 1), layout="constrained",
    )  # fmt: skip
    for rank, name in shown(misfit).items():
        axis, (times, motion) = axes[rank], recorded[name]
        k = int(np.argmax(np.abs(motion).max(axis=1)))
        axis.plot(times, 1e3 * motion[k], "k", lw=1.6, label="recorded")
        for model, colour in MODELS:
            label = f"{model}: misses {100 * misfit[model][name]:.1f} % of the energy"
            axis.plot(times, 1e3 * predicted[model][name][1][k], colour, lw=1.0, label=label)
        axis.set_title(f"{name}, the {rank} of {len(recorded)} receivers", fontsize=10, loc="left")
        axis.set_ylabel(f"velocity {('east', 'north', 'up')[k]} [mm/s]")
        axis.set_xlim(0.0, times[-1])
        axis.legend(loc="upper right", fontsize=8, frameon=False)
    axes["worst"].set_xlabel("time after the first hole [s]")
    rows = np.arange(len(recorded))
    for model, colour in MODELS:
        values = [100 * misfit[model][name] for name in recorded]
        axes["all"].plot(values, rows, "o", color=colour, label=model)
        axes["all"].axvline(np.median(values), color=colour, lw=0.8, ls="--")
    axes["all"].set_yticks(rows, recorded)
    axes["all"].set(xlabel="energy missed [%]", ylim=(len(rows) + 0.1, -0.5))
    axes["all"].set_xlim(left=0.0)
    axes["all"].set_title("all receivers; dashed: medians", fontsize=10, loc="left")
    axes["all"].legend(fontsize=8, loc="lower center", ncol=2, frameon=False)
    before, after = (100 * np.median([*misfit[model].values()]) for model, _ in MODELS)
    figure.suptitle(
        f"A blast that no fit has used: the calibrated site misses {before:.1f} % of its energy, "
        f"the diagnosed one {after:.1f} % (medians, {BAND[0]:g} to {BAND[1]:g} Hz)", fontsize=11,
    )  # fmt: skip
    figure.savefig(path, dpi=110)
    return before, after


def main(arguments):
    """Diagnose, predict, draw, and open the truth."""
    out = Path(arguments[0]) if arguments else HERE / "proof"
    project, holes = HERE / "B2.toml", HERE / "further" / "H1_holes.csv"

    def progress(stage, done, total):
        print(f"\r{stage} {done}/{total}".ljust(70), end="", flush=True)

    with workers() as executor:
        answer, folder = diagnose_case(project, out, executor=executor, progress=progress)
    print("\r" + "\n".join(diagnosis_lines(answer)))
    recorded = in_band(read_stations(HERE / "further" / "H1.mseed"))
    predicted = {}
    for model, _ in MODELS:
        path = folder / f"H1_{model}.mseed"
        predict_case(project, folder, holes, path, baseline=model == "calibrated")
        predicted[model] = in_band(read_stations(path))
    misfit = {model: misfits(recorded, motion) for model, motion in predicted.items()}
    before, after = draw(folder / FIGURE, recorded, predicted, misfit)
    better = sum(misfit["diagnosed"][r] < misfit["calibrated"][r] for r in recorded)
    print(
        f"blast H1, used by no fit: {before:.1f} % of its energy missed by the calibrated site, "
        f"{after:.1f} % by the diagnosed one; better at {better} of {len(recorded)} receivers"
    )
    print(f"written: {folder / FIGURE}, {folder / 'report.html'}")
    print("what was concealed: truth/truth.toml, which this command does not read")


if __name__ == "__main__":
    main(sys.argv[1:])
