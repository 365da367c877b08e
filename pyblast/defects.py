"""Defects of a project that its own numbers show before a run: D1 to D20 of the example's paper."""

import math
from dataclasses import dataclass, field

import numpy as np

from .blast_checks import ANFO_DENSITY
from .materials import Damping

SOUND_SPEED = 340.0
TET_VOLUME = 1.0 / (6.0 * math.sqrt(2.0))
SAME_INSTANT = 1e-3


@dataclass(frozen=True)
class Finding:
    """Something doubtful about a project.

    Parameters
    ----------
    code : str
        D1 to D20.
    title, text : str
        What it is, in words; what it is here, in numbers.
    failed : bool
        Whether a result can't be trusted unless this is changed.
    numbers : dict of str to float
        SI.
    """

    code: str
    title: str
    text: str
    failed: bool = False
    numbers: dict[str, float] = field(default_factory=dict)


def coarse_zones(name, material, edge, volume, band, receivers=()):
    """D1: a material whose zones do not carry the band of the input; None where they do."""
    carried = material.cs / (10.0 * edge)
    if carried >= band:
        return None
    needed = material.cs / (10.0 * band)
    zones = [volume / (TET_VOLUME * size**3) for size in (edge, needed)]
    stands = f", and {', '.join(receivers)} stands on it" if receivers else ""
    return Finding(
        "D1",
        f"The mesh of '{name}' does not carry the input",
        f"{edge:.3g} m edges carry {carried:.3g} Hz in '{name}' ({1.25 * carried:.3g} Hz with 8 "
        f"edges per wavelength), the input has {band:g} Hz{stands}; edges must be at most "
        f"{needed:.2g} m, which makes {zones[1]:.2g} zones of about {zones[0]:.2g}.",
        True,
        {"carried": carried, "carried_8": 1.25 * carried, "needed_edge": needed,
         "zones_now": zones[0], "zones_needed": zones[1]},
    )  # fmt: skip


def short_model(length, materials, frequency):
    """D2: a model shorter than the wavelength of P waves at the central frequency."""
    waves = {name: (m.cp / frequency, m.cs / frequency) for name, m in materials.items()}
    longest = max(p for p, _ in waves.values())
    if length >= longest:
        return None
    listed = ", ".join(f"{p:.0f}/{s:.0f} m in '{name}'" for name, (p, s) in waves.items())
    return Finding(
        "D2",
        "The model is shorter than a wavelength",
        f"At {frequency:g} Hz the wavelengths (P/S) are {listed}, the model is {length:g} m long: "
        "everything is near field, and waves graze the viscous sides, which absorb well only "
        "above about 30 degrees of incidence.",
        numbers={"length": length}
        | {f"{kind}_{name}": v for name, pair in waves.items() for kind, v in zip("ps", pair, strict=True)},
    )  # fmt: skip


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
    zeros = ", ".join(f"{f:.4g}" for f in comb["zeros"][:6]) or "none"
    lobes = ", ".join(f"{h:.2f} at {f:.2f} Hz" for f, h in comb["lobes"][:4]) or "none"
    return Finding(
        "D3",
        "The firing times fix the spectrum",
        f"They multiply it by a comb with zeros at {zeros} Hz, -3 dB at {comb['corner']:.2f} Hz, "
        f"{comb['level']:.2f} at {frequency:g} Hz and side lobes {lobes}: a dominant frequency "
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
        f"The comb is {comb['band_level']:.2f} at the {band:g} Hz filter and 1 again at "
        f"{comb['returns']:.3g} Hz; the filter takes up to {100 * removed:.2g} % of a component's "
        f"energy and changes its PPV by up to {100 * change:.2g} %.",
        removed > 0.5,
        {"returns": comb["returns"], "band_level": comb["band_level"], "removed_energy": removed,
         "ppv_change": change},
    )  # fmt: skip


def fixed_and_viscous(surfaces):
    """D5: the same direction fixed and viscous."""
    if not surfaces:
        return None
    return Finding(
        "D5",
        "Surfaces are fixed and viscous in the same direction",
        f"{', '.join(surfaces)}: a fixed normal has no velocity, so its dashpots do nothing and P "
        "waves reflect fully; compare with viscous_and_fixed = false (rollers in the static stage, "
        "dashpots in the dynamic one).",
    )


def plane_load(distance, reach, material, band):
    """D6: a plane load from a source so near that its front is curved over the face."""
    edge = math.hypot(distance, reach)
    lag = (edge - distance) * band / material.cp
    if edge / distance < 1.2 and lag < 0.1:
        return None
    return Finding(
        "D6",
        "A plane load stands for a near source",
        f"The source is {distance:g} m from the input face, {edge:.0f} m from its edge: over the face "
        f"the amplitude falls {edge / distance:.1f} times (1/r) and lags {lag:.2f} P wavelengths at "
        f"{band:g} Hz, but the load is the same everywhere.",
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
        numbers={f"{kind}_{n}": v for n, pair in factors.items() for kind, v in zip("ps", pair, strict=True)},
    )  # fmt: skip


def transmission(stiffness, impedance, frequency):
    """Return |T| of a joint at normal incidence: 1/sqrt(1 + (omega Z / 2 K)^2)."""
    return 1.0 / math.hypot(1.0, math.pi * frequency * impedance / stiffness)


def fault_low_pass(name, joint, group, material, frequency, band):
    """D8 and D9: a fault that itself is a low-pass; None where it passes the band."""
    z_p, z_s = material.density * material.cp, material.density * material.cs
    kn, ks = joint.properties["kn"], joint.properties["ks"]
    corners = kn / (math.pi * z_p), ks / (math.pi * z_s)
    if min(corners) > band:
        return None
    at = {f: (transmission(kn, z_p, f), transmission(ks, z_s, f)) for f in (2.0, 4.0, 6.0, 10.0)}
    gain = [
        transmission(1.1 * k, z, frequency) / transmission(k, z, frequency) - 1.0
        for k, z in ((kn, z_p), (ks, z_s))
    ]
    listed = ", ".join(f"{p:.2f}/{s:.2f} at {f:g} Hz" for f, (p, s) in at.items())
    return Finding(
        "D8",
        f"The fault '{name}' is itself a low-pass",
        f"In '{group}' its corner is {corners[0]:.1f} Hz (P) and {corners[1]:.1f} Hz (S); it passes "
        f"{listed} (P/S). Its stiffness can't be told from damping, soil or mesh by amplitude; at "
        f"{frequency:g} Hz +10 % of kn gives {100 * gain[0]:+.0f} % P, of ks {100 * gain[1]:+.0f} % S "
        "(D9).",
        numbers={"corner_p": corners[0], "corner_s": corners[1], "gain_p": gain[0],
                 "gain_s": gain[1]}
        | {f"t_{kind}_{f:g}": v for f, pair in at.items() for kind, v in zip("ps", pair, strict=True)},
    )  # fmt: skip


def jointed_speeds(name, joint, spacing, group, material, frequency):
    """D11: a joint set delays waves but hardly weakens them."""
    kn, ks = joint.properties["kn"], joint.properties["ks"]
    passed = (
        transmission(kn, material.density * material.cp, frequency),
        transmission(ks, material.density * material.cs, frequency),
    )
    slower = [
        1.0 / math.sqrt(1.0 + modulus / (k * spacing)) - 1.0
        for modulus, k in ((material.density * material.cp**2, kn), (material.shear, ks))
    ]
    if min(passed) < 0.95 or min(slower) > -0.05:
        return None
    return Finding(
        "D11",
        f"The joints '{name}' change arrival times, not amplitudes",
        f"One joint passes {passed[0]:.3f} (P) and {passed[1]:.3f} (S) at {frequency:g} Hz, but the "
        f"set makes '{group}' slower by {-100 * slower[0]:.0f} % (P) and {-100 * slower[1]:.0f} % "
        "(S): a comparison of peaks and frequencies does not see it, arrival times do.",
        numbers={"t_p": passed[0], "t_s": passed[1], "speed_p": slower[0], "speed_s": slower[1]},
    )


def soil_resonance(name, material, thickness, below, frequency, band):
    """D12: the top layer has a resonance of its own within the band."""
    contrast = below.density * below.cs / (material.density * material.cs)
    own = material.cs / (4.0 * thickness)
    if contrast < 2.0 or own > band:
        return None
    return Finding(
        "D12",
        f"'{name}' resonates by itself",
        f"{thickness:g} m on rock of {contrast:.1f} times its impedance resonate at {own:.2f} Hz and "
        f"odd multiples; {frequency:g} Hz would be {material.cs / (4.0 * frequency):.1f} m of it: "
        "another reading of the same peak.",
        numbers={"own": own, "thickness_at_centre": material.cs / (4.0 * frequency)},
    )


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


def rayleigh_price(damping: Damping, undamped_dt):
    """D16: Rayleigh damping away from its central frequency, and its price in time step."""
    if damping is None or damping.ratio == 0.0:
        return None
    share = damping.beta / undamped_dt
    factor = math.hypot(1.0, share) - share
    ratios = {f: damping.ratio_at(f) for f in (1.0, 2.0, 4.0, 8.0, 20.0)}
    listed = ", ".join(f"{100 * r:.2f} % at {f:g} Hz" for f, r in ratios.items())
    return Finding(
        "D16",
        "Rayleigh damping holds at one frequency and costs time steps",
        f"{listed}; rock damps nearly alike at all frequencies. Its stiffness part shortens the step "
        f"of {1e3 * undamped_dt:.2g} ms to {factor:.2f} of it.",
        numbers={"factor": factor} | {f"ratio_{f:g}": r for f, r in ratios.items()},
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
        f"{1e3 * peak:.0f} mm/s of one hole are {single / 1e6:.1f} MPa in '{name}', {together} holes in "
        f"phase {together * peak:.1f} m/s or {together * single / 1e6:.0f} MPa against a cohesion of "
        f"{material.cohesion / 1e6:.1f} MPa: linear superposition then over-estimates.",
        numbers={"single": single, "together": together * single, "velocity": together * peak},
    )


def infill_as_layer(name, joint, thicknesses):
    """D18: what the stiffness of a fault says about its infill as a layer."""
    kn, ks = joint.properties["kn"], joint.properties["ks"]
    ratio = kn / ks
    poisson = (ratio - 2.0) / (2.0 * (ratio - 1.0)) if ratio > 1.0 else math.nan
    moduli = [(kn * t, ks * t) for t in thicknesses]
    listed = " to ".join(f"{m / 1e6:.3g}/{g / 1e6:.3g} MPa" for m, g in moduli)
    coherent = 0.0 <= poisson < 0.5
    return Finding(
        "D18",
        f"The infill of '{name}' read as a layer",
        f"{' to '.join(f'{100 * t:g} cm' for t in thicknesses)} of infill have M/G = {listed} and, "
        f"from kn/ks = {ratio:.2f}, a Poisson's ratio of {poisson:.2f}: "
        f"{'coherent' if coherent else 'no material behaves so; check kn and ks'}.",
        numbers={"poisson": poisson}
        | {f"m_{n + 1}": m for n, (m, _) in enumerate(moduli)}
        | {f"g_{n + 1}": g for n, (_, g) in enumerate(moduli)},
    )


def charge_fits(charge, diameter, depth, density=ANFO_DENSITY):
    """D20: whether the charge fits into its hole."""
    length = charge / (density * math.pi / 4.0 * diameter**2)
    fits = length < depth
    return Finding(
        "D20",
        "The charge fits its hole" if fits else "The charge does not fit its hole",
        f"{charge:g} kg at {density:g} kg/m3 (assumed) in {1e3 * diameter:g} mm fill {length:.1f} m of "
        f"{depth:g} m.",
        not fits,
        {"length": length},
    )
