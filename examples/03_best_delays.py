"""Which delays shake three houses least? Peaks with bands, the search, and what is gained.

Four rows of six holes. The record of a single hole at each house belongs here; until it is
measured, a closed form stands in, scaled to an assumed site law. Argument: the figure.
"""

import sys

import numpy as np
from matplotlib import pyplot as plt

from pyblast import Blast
from pyblast.blasts.published_laws import HARD_ROCK
from pyblast.blasts.signature import (
    SmoothPulse,
    cavity_seismogram,
    pressure_for_peak,
    travel_shifts,
)
from pyblast.planning import FiringScatter, best_delays, gain_of_plan, peak_bands, rows_pattern
from pyblast.runs.blast_ensemble import signature_spectra

ROCK = {"density": 2600.0, "cp": 4000.0, "cs": 2300.0, "radius": 2.0}
HOUSES = {"north": (0.0, 400.0, 0.0), "east": (350.0, 50.0, 0.0), "south": (60.0, -500.0, 0.0)}
LIMIT, CHARGE = 0.005, 60.0  # m/s, kg
SCATTER = FiringScatter(delay_share=0.01, charge=0.2, doubt=0.3)

pattern = rows_pattern(4, 6)  # number of hole and row delays before each hole
places = np.column_stack([pattern * [5.0, -4.0], np.full(24, -10.0)])
nominal = pattern @ [0.017, 0.042]
blast = Blast("bench", places, places, np.full(24, CHARGE), nominal)
signatures, shifts = {}, []
for name, house in HOUSES.items():
    distance = float(np.linalg.norm(np.subtract(house, places[0])))
    peak = HARD_ROCK.ppv(distance, CHARGE)
    pulse = pressure_for_peak(**ROCK, pulse=SmoothPulse(1.0, 0.02), distance=distance, peak=peak)
    signatures[name] = cavity_seismogram(
        **ROCK, pulse=pulse, source=places[0], receiver=house, dt=1e-3, duration=0.4
    )
    shifts.append(travel_shifts(blast, house, ROCK["cp"], reference=places[0]))
spectra = signature_spectra(signatures, 24, earliest=-0.1, latest=0.7, travel_shifts=shifts)

bands = peak_bands(spectra, nominal, SCATTER, n_blasts=1000)
for name, middle, low, high in zip(HOUSES, bands.level(0.5), *bands.band(0.9), strict=True):
    print(f"{name}: PPV {1e3 * middle:.2f} mm/s, 90 % of blasts {1e3 * low:.2f}-{1e3 * high:.2f}")

search = {"limits": LIMIT, "share": 0.9, "points": 6, "n_blasts": 40}
best = best_delays(spectra, pattern, [0.009, 0.025], [0.042, 0.109], SCATTER, **search)
gained = gain_of_plan(spectra, nominal, best.times, SCATTER, limits=LIMIT, n_blasts=1000)
print("best: " + ", ".join(f"{1e3 * delay:.0f} ms" for delay in best.delays), end="; ")
print(f"90 % quantile of PPV falls by {100 * gained.reduction:.0f} % "
      "[{:.0f} to {:.0f}]".format(*100 * gained.interval))  # fmt: skip

figure, axis = plt.subplots(figsize=(8, 5.5), layout="constrained")
tried = best.tried[np.argsort(-best.tried[:, 2])]  # the best last, above the others
points = axis.scatter(*1e3 * tried[:, :2].T, c=1e3 * LIMIT * tried[:, 2], s=24, cmap="viridis_r",
                      label="tried")  # fmt: skip
figure.colorbar(points, label="PPV at the worst house that 90 % of blasts stay below [mm/s]")
axis.plot(17.0, 42.0, "k^", ms=9, mfc="white", mew=1.5, label="as planned: 17 and 42 ms")
axis.plot(*1e3 * best.delays, "C3*", ms=15, mec="white",
          label="best: {:.0f} and {:.0f} ms".format(*1e3 * best.delays))  # fmt: skip
axis.set(xlabel="delay between holes [ms]", ylabel="delay between rows [ms]")
axis.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=3, frameon=False)
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "best_delays.png", dpi=110)
