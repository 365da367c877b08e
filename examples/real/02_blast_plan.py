"""Real firing plans, fired numerically: read, checked, superposed at a house 500 m away.

The plans are real; whether they were fired is unknown. The motion of one hole is a closed form
or a hammer hit from another place: nothing here shows what any house experienced.
Argument: the folder.
"""

import sys

import numpy as np
from matplotlib import pyplot as plt
from real_line import FIGURES, hits_by_place, keep_results, recordings_folder, seismograms

from pyblast import Seismogram, read_blast, superpose
from pyblast.blasts.published_laws import HARD_ROCK
from pyblast.blasts.signature import (
    SmoothPulse,
    cavity_seismogram,
    pressure_for_peak,
    travel_shifts,
)
from pyblast.signals.spectra import dominant_frequency, smoothed_spectrum, zero_crossing_frequency

PLANS = ("KAB_BLAST_ALLCOL", "blastlogic_kirra_S4_226_401", "blastlogic_kirra_S4_226_414P")
ROCK = {"density": 2600.0, "cp": 4000.0, "cs": 2300.0, "radius": 2.0}
AWAY, EXPONENT, LOW = 500.0, 0.8, 3.0


def house_of(blast):
    """Choose a place 500 m south of the nearest charge, at the height of the collars."""
    south = blast.centres[np.argmin(blast.centres[:, 1])]
    return np.array([south[0], south[1] - AWAY, blast.collar[:, 2].mean()])


def closed_form(house, centre, charge):
    """Return the motion of one hole at the house: pressurised cavity, peak by AS 2187.2."""
    distance = float(np.linalg.norm(house - centre))
    peak = HARD_ROCK.ppv(distance, charge)
    pulse = pressure_for_peak(**ROCK, pulse=SmoothPulse(1.0, 0.03), distance=distance, peak=peak)
    return cavity_seismogram(
        **ROCK, pulse=pulse, source=centre, receiver=house, dt=1e-3, duration=1.0
    )


def hammer_hit(line, peak):
    """Take a recorded hit, 56 m away, as signature; its peak is that of the closed form."""
    hit = seismograms(line[-10.0][0], (-0.1, 0.9))[23].bandpassed(5.0, 100.0)
    scaled = hit.velocity * peak / hit.ppv[2]
    return Seismogram(scaled, hit.dt, hit.start, "hammer hit, scaled")


def fire(path, line):
    """Read, check and fire one plan; return numbers, motions and the blast."""
    blast = read_blast(path)
    print(f"\n{path.name}", *blast.checks(), sep="\n  ")
    house, charge = house_of(blast), float(np.median(blast.charge))
    centre = blast.centres[np.argmin(np.abs(blast.charge - charge))]
    firing = blast.firing(charge, EXPONENT)
    shifts = travel_shifts(blast, house, ROCK["cp"], reference=centre)
    single = closed_form(house, centre, charge)
    motions, numbers = {}, {"checks": blast.checks(), "holes": len(blast.charge),
                            "charge_kg": float(np.sum(blast.charge)),
                            "charge_per_8_ms_kg": blast.charge_per_window(),
                            "median_charge_kg": charge}  # fmt: skip
    for name, signature in (("closed form", single), ("hammer hit", hammer_hit(line, single.pvs))):
        motion = superpose(signature, firing, travel_shifts=shifts)
        main = int(np.nanargmax(motion.ppv))
        motions[name] = motion, main
        numbers[name] = {
            "one_hole_mm_per_s": 1e3 * float(np.nanmax(signature.ppv)),
            "ppv_mm_per_s": 1e3 * float(motion.ppv[main]),
            "component": motion.components[main],
            "dominant_hz": float(dominant_frequency(motion, band=(LOW, 200.0)).hz[main]),
            "dominant_of_one_hole_hz": float(dominant_frequency(
                signature, band=(LOW, 200.0)).hz[int(np.nanargmax(signature.ppv))]),
            "zero_crossing_hz": float(zero_crossing_frequency(motion).hz[main]),
        }  # fmt: skip
        print(f"  {name}: {numbers[name]}")
    comb = firing.comb_spectrum(np.arange(LOW, 100.0, 0.05))
    numbers["strongest_comb_line_hz"] = float(np.arange(LOW, 100.0, 0.05)[np.argmax(comb)])
    numbers["strongest_comb_line"] = float(np.max(comb))
    return numbers, motions, firing


def main():
    """Fire the three plans, keep the numbers and draw them."""
    folder = recordings_folder(sys.argv[1:])
    line, results = hits_by_place(folder / "wghs"), {}
    figure, axes = plt.subplots(3, 3, figsize=(14, 10), layout="constrained")
    for row, plan in zip(axes, PLANS, strict=True):
        path = folder / "blast_plans" / f"{plan}.csv"
        results[plan], motions, firing = fire(path, line)
        draw(row, path, motions, firing)
    for axis, title in zip(axes[0], ("Motion", "Spectrum", "Comb of the plan"), strict=True):
        axis.set_title(title)
    keep_results("blast_plans", results)
    figure.savefig(FIGURES / "real_blast_plans.png", dpi=70)


def draw(row, path, motions, firing):
    """Draw motion, spectra and comb of one plan."""
    for (name, (motion, main)), colour in zip(motions.items(), ("C0", "C1"), strict=True):
        label = f"{name}, {motion.components[main]}"
        row[0].plot(motion.times, 1e3 * motion.velocity[:, main], colour, label=label, lw=0.7)
        smooth = smoothed_spectrum(motion)
        row[1].loglog(smooth.frequency, 1e3 * smooth.amplitude[:, main], colour, label=label)
    frequency = np.geomspace(1.0, 100.0, 4000)
    row[2].loglog(frequency, firing.comb_spectrum(frequency), "k", lw=0.6)
    noun = path.stem.replace("blastlogic_kirra_", "")
    row[0].set(xlabel="time after zero of the plan [s]", ylabel=f"{noun}\nvelocity [mm/s]")
    row[1].set(xlabel="frequency [Hz]", ylabel="amplitude [mm/s/Hz]", xlim=(1, 200))
    row[2].set(xlabel="frequency [Hz]", ylabel="|sum| / sum of scales", xlim=(1, 100),
               ylim=(1e-3, 1.5))  # fmt: skip
    row[0].legend(fontsize=8)


if __name__ == "__main__":
    main()
