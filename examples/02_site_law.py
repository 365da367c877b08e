"""The law of a site: peaks of many blasts, their 50 and 95 % lines, and charges that keep a limit.

The table beside this script is synthetic: 34 draws around PPV = 1100 SD^-1.58 mm/s with a scatter
of 0.17 in log10. Arguments: the table, the figure.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from pyblast import fit_site_law
from pyblast.blasts.site_law import read_site_records, scaled_distance

TABLE = sys.argv[1] if len(sys.argv) > 1 else Path(__file__).with_name("site_peaks.csv")
LIMIT = 0.005

records = read_site_records(TABLE)
law = fit_site_law(*records)
low, high = law.beta_interval(0.9)
print(f"PPV = {1e3 * law.k:.0f} SD^-{law.beta:.2f} mm/s, exponent {low:.2f} to {high:.2f} (90 %)")
print(*law.notes, sep="\n")
for distance in (100.0, 200.0, 500.0):
    charge = law.largest_charge(distance, LIMIT)
    print(f"{distance:.0f} m: {charge:.1f} kg in 8 ms keep {1e3 * LIMIT:g} mm/s in 95 % of blasts")

figure, axis = plt.subplots(figsize=(7.5, 5.5), layout="constrained")
scaled = np.geomspace(law.reach[0] / 1.5, law.reach[1] * 1.5, 100)
axis.axvspan(*law.reach, color="0.95", zorder=0, label="range of the records")
axis.loglog(scaled_distance(records.distance, records.charge), 1e3 * records.ppv, "ko", ms=4,
            label=f"{len(records.ppv)} records")  # fmt: skip
for share, style in ((0.5, "C0-"), (0.95, "C3--")):
    line = law.peak(scaled, 1.0).level(share)
    axis.loglog(scaled, 1e3 * line, style, label=f"{100 * share:g} % of new blasts are below")
axis.set(xlabel="scaled distance, by the root of the charge in 8 ms [m/√kg]", ylabel="PPV [mm/s]",
         title=f"PPV = {1e3 * law.k:.0f} SD$^{{-{law.beta:.2f}}}$ mm/s")  # fmt: skip
axis.grid(which="both", color="0.9")
for each in (axis.xaxis, axis.yaxis):
    each.set_major_formatter("{x:g}")
axis.legend()
figure.savefig(sys.argv[2] if len(sys.argv) > 2 else "site_law.png", dpi=110)
