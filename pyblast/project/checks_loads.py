"""Findings about blast, firing and load before a run, and about simulated records after it."""

import math

import numpy as np

from ..blasts.blast import ANFO_DENSITY
from ..errors import Finding, by_wave
from ..signals.spectra import dominant_frequency

SOUND_SPEED = 340.0
SAME_INSTANT = 1e-3
ANFO_HEAT = 3.8e6
PLAUSIBLE_SHARE = 0.1


def comb_numbers(firing, frequency, band):
    """Return what the firing times do to the spectrum.

    Returns
    -------
    dict
        ``zeros``, ``lobes`` (list of frequency, height) below the band, ``corner`` (-3 dB),
        ``level`` at ``frequency``, ``band_level`` at the band, ``returns`` (first frequency above
        the band where all holes add up again, None where there is none below ten times the band).
    """
    step = min(0.001 * band, 0.005)
    axis = np.arange(0.0, 10.0 * band, step)
    level = firing.comb_spectrum(axis)
    inner = np.flatnonzero((level[1:-1] < level[:-2]) & (level[1:-1] <= level[2:])) + 1
    outer = np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:])) + 1
    below = np.flatnonzero(level < math.sqrt(0.5))
    whole = [k for k in outer if axis[k] > band and level[k] > 0.99]
    return {
        "zeros": [float(axis[k]) for k in inner if axis[k] <= band and level[k] < 0.01],
        "lobes": [(float(axis[k]), float(level[k])) for k in outer if axis[k] <= band],
        "corner": float(axis[below[0]]) if len(below) else None,
        "level": float(firing.comb_spectrum(frequency)[0]),
        "band_level": float(firing.comb_spectrum(band)[0]),
        "returns": float(axis[whole[0]]) if whole else None,
    }


def firing_comb(firing, frequency, band):
    """D3: the firing times fix the spectrum; None where they hardly touch it."""
    comb = comb_numbers(firing, frequency, band)
    if comb["corner"] is None or comb["corner"] > band:
        return None
    zeros = ", ".join(f"{f:.4g}" for f in comb["zeros"][:6])
    zeros = f"zeros at {zeros} Hz" if zeros else "no zeros"
    lobes = ", ".join(f"{h:.2f} at {f:.2f} Hz" for f, h in comb["lobes"][:4])
    lobes = f"side lobes {lobes}" if lobes else "no side lobes"
    return Finding(
        "D3",
        "The firing times fix the spectrum",
        f"They multiply it by a comb with {zeros}, -3 dB at {comb['corner']:.2f} Hz, "
        f"{comb['level']:.2f} at {frequency:.3g} Hz and {lobes}: a dominant frequency "
        "that fits says little about the ground.",
        numbers={"corner": comb["corner"], "level": comb["level"]}
        | {f"zero_{n + 1}": f for n, f in enumerate(comb["zeros"])}
        | {f"lobe_{n + 1}": h for n, (_, h) in enumerate(comb["lobes"])},
    )


def comb_return(firing, frequency, low_passed):
    """D4: the comb returns above the low-pass; None where nothing is filtered or returns."""
    if low_passed is None:
        return None
    band = low_passed.corner
    comb = comb_numbers(firing, frequency, band)
    if comb["returns"] is None:
        return None
    removed = float(np.nanmax(low_passed.removed_energy))
    change = float(np.nanmin(low_passed.ppv_change))
    return Finding(
        "D4",
        "The low-pass cuts where the holes add up again",
        f"The comb is {comb['band_level']:.2f} at the {band:.3g} Hz filter and 1 again at "
        f"{comb['returns']:.3g} Hz; the filter takes up to {100 * removed:.3g} % of a component's "
        f"energy and changes its PPV by up to {100 * change:.3g} %.",
        removed > 0.5,
        {"returns": comb["returns"], "band_level": comb["band_level"], "removed_energy": removed,
         "ppv_change": change},
    )  # fmt: skip


def plane_load(distance, reach, material, band):
    """D6: a plane load from a source so near that its front is curved over the face."""
    edge = math.hypot(distance, reach)
    lag = (edge - distance) * band / material.cp
    if edge / distance < 1.2 and lag < 0.1:
        return None
    return Finding(
        "D6",
        "A plane load stands for a near source",
        f"The source is {distance:g} m from the input face, {edge:.0f} m from its edge: over the "
        f"face the amplitude falls {edge / distance:.1f} times (1/r) and lags {lag:.2f} P "
        f"wavelengths at {band:.3g} Hz, but the load is the same everywhere.",
        numbers={"edge": edge, "ratio": edge / distance, "lag": lag},
    )


def layered_face(face, materials):
    """D7: one velocity on a face of several materials."""
    if len(materials) < 2:
        return None
    factors = {n: (2.0 * m.density * m.cp, 2.0 * m.density * m.cs) for n, m in materials.items()}
    listed = ", ".join(f"{n} {p / 1e6:.2f}/{s / 1e6:.2f}" for n, (p, s) in factors.items())
    return Finding(
        "D7",
        "One velocity enters through a layered face",
        f"On '{face}' the same velocity becomes different stresses, in MPa per m/s (normal/shear): "
        f"{listed}; the record was made in one material only.",
        numbers=by_wave(factors),
    )  # fmt: skip


def air_blast(receiver, distance, last_firing, duration):
    """D13: the air blast arrives within the record."""
    first = distance / SOUND_SPEED
    if first > duration:
        return None
    return Finding(
        "D13",
        f"The air blast reaches {receiver} within the record",
        f"{distance:.0f} m at {SOUND_SPEED:g} m/s (assumed) are {first:.2f} s, the last hole "
        f"{first + last_firing:.2f} s: late waves in a record need not be reflections.",
        numbers={"first": first, "last": first + last_firing},
    )


def yielding_rock(peak, firing, name, material):
    """D17: the superposed motion may exceed the strength of the rock it comes through."""
    order = np.sort(firing.times)
    together = int(max(np.searchsorted(order, order + SAME_INSTANT) - np.arange(len(order))))
    single = material.density * material.cp * peak
    if not together * single > material.cohesion:
        return None
    return Finding(
        "D17",
        "Superposition may pass through yielding rock",
        f"{1e3 * peak:.0f} mm/s of one hole are {single / 1e6:.1f} MPa in '{name}', {together} "
        f"holes in phase {together * peak:.1f} m/s or {together * single / 1e6:.0f} MPa against a "
        f"cohesion of {material.cohesion / 1e6:.1f} MPa: linear superposition then over-estimates.",
        numbers={"single": single, "together": together * single, "velocity": together * peak},
    )


def load_energy(motion, face, charge, axis=0):
    """D21: whether the load carries more energy than the explosive; None where far less.

    Parameters
    ----------
    motion : Seismogram
        Of the incident wave.
    face : sequence of (area m2, Material)
    charge : float, kg
        Of the whole blast.
    axis : int
        Component along the normal of the face.
    """
    work = motion.dt * np.sum(np.nan_to_num(motion.velocity) ** 2, axis=0)
    normal, shear = float(work[axis]), float(work.sum() - work[axis])
    energy = sum(a * m.density * (m.cp * normal + m.cs * shear) for a, m in face)
    share = energy / (charge * ANFO_HEAT)
    if share < PLAUSIBLE_SHARE:
        return None
    return Finding(
        "D21",
        "The load carries too much energy",
        f"The waves that enter carry {energy / 1e9:.3g} GJ, {100 * share:.0f} % of the heat of "
        f"{charge:g} kg of explosive ({ANFO_HEAT / 1e6:g} MJ/kg, assumed); blasts send at most "
        f"about {100 * PLAUSIBLE_SHARE:.0f} % into waves. One record on the whole face and all "
        "holes of a row in phase put in what the blast can't give.",
        share > 1.0,
        {"energy": energy, "share": share},
    )


def nothing_damps(rim):
    """D22: holes inside a model without a rim; None where there is one."""
    if rim is not None:
        return None
    return Finding(
        "D22",
        "Only dashpots take the waves of holes inside",
        "They absorb well only what comes above about 30 degrees of incidence, and waves from a "
        "hole graze the sides; give mesh.padding_m, or [rim] with a box and a width.",
    )


def short_air_waves(surface, edge, speed, band, per_wave=10.0):
    """D25: zones under an air blast that are too long for its waves; None where they are not.

    On ten edges to a wave, three where zones have 15 nodes, the motion under it is about 6 % too
    small where S waves are faster than the air, half that elsewhere: rung L2.
    """
    carried = speed / (per_wave * edge)
    if carried >= band:
        return None
    return Finding(
        "D25",
        "The mesh does not carry the air blast",
        f"Edges of {edge:.3g} m at '{surface}' carry {carried:.3g} Hz at {speed:g} m/s, the pulse "
        f"has {band:.3g} Hz; what the ground does under it is then too small or scattered. Edges "
        f"there must be at most {speed / (per_wave * band):.2g} m.",
        True,
        {"carried": carried, "needed_edge": speed / (per_wave * band)},
    )


def charge_fits(charge, diameter, depth, density=ANFO_DENSITY):
    """D20: whether the charge fits into its hole."""
    length = charge / (density * math.pi / 4.0 * diameter**2)
    fits = length < depth
    return Finding(
        "D20",
        "The charge fits its hole" if fits else "The charge does not fit its hole",
        f"{charge:g} kg at {density:g} kg/m3 (assumed) in {1e3 * diameter:g} mm fill "
        f"{length:.1f} m of {depth:g} m.",
        not fits,
        {"length": length},
    )


def holes_within(centres, face, low, high):
    """D27: holes inside the model while their motion enters through a face; None where beyond.

    Parameters
    ----------
    centres : (n_holes, 3) float64, m
    face : str
    low, high : (3,) float64, m
        Corners of the box around the mesh.
    """
    within = int(((centres > low) & (centres < high)).all(axis=1).sum())
    if not within:
        return None
    return Finding(
        "D27",
        "Holes lie inside the model, their motion enters from outside",
        f"{within} of {len(centres)} holes of [blast] lie inside the model, yet the motion enters "
        f"through '{face}' as if they lay beyond it: move blast.position_m, or give "
        "[holes_inside] in place of [signature].",
        numbers={"within": float(within)},
    )


END_SHARE = 0.05
STILL = 0.2
LEAST_CYCLES = 2.0


def record_findings(simulated) -> tuple[Finding, ...]:
    """Return what is doubtful about the records of a run.

    Parameters
    ----------
    simulated : dict of str to Seismogram
        By receiver; zero time is the first firing.
    """
    found = cut_short(simulated), low_frequencies(simulated)
    return tuple(finding for finding in found if finding is not None)


def cut_short(simulated):
    """D28: records that end while the ground still moves; None where all are quiet by then."""
    left, late = {}, []
    for name, record in simulated.items():
        size = np.linalg.norm(record.velocity, axis=1)
        last = record.times > record.times[-1] - END_SHARE * (
            record.times[-1] - min(0, record.start)
        )
        share = float(size[last].max() / size.max()) if size.any() else 0.0
        if share > STILL:
            left[name] = share
            late += [name] if last[int(size.argmax())] else []
    if not left:
        return None
    listed = ", ".join(f"{100 * share:.0f} % at {name}" for name, share in left.items())
    peak = f"; the peak at {', '.join(late)} comes that late" if late else ""
    return Finding(
        "D28",
        "The record ends while the ground still moves",
        f"In its last twentieth the motion still reaches {listed} of its peak{peak}: peaks, "
        "durations and low frequencies may change with a longer run.duration_s.",
        numbers=left,
    )


def low_frequencies(simulated):
    """D29: dominant frequencies of which fewer than two cycles fit into the record; else None."""
    low, shortest = {}, np.inf
    for name, record in simulated.items():
        lasts = record.times[-1] - max(0.0, record.start)
        for component, hz in zip(record.components, dominant_frequency(record).hz, strict=True):
            if hz * lasts < LEAST_CYCLES:
                low[f"{name} {component}"] = float(hz)
                shortest = min(shortest, lasts)
    if not low:
        return None
    listed = ", ".join(f"{hz:.3g} Hz at {name}" for name, hz in low.items())
    return Finding(
        "D29",
        "Dominant frequencies are as low as the record is short",
        f"{listed}: fewer than two cycles fit into {shortest:.3g} s, so the length of the record "
        "sets them as much as the ground does; lengthen run.duration_s before you use them.",
        numbers=low,
    )
