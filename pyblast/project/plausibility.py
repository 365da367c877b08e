"""Plausibility: peaks for their charge and distance, and values for their unit."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..blasts.published_laws import HARD_ROCK, PlausibleRange, plausible_ppv
from ..blasts.signature import moment_velocity, superpose
from ..errors import Finding
from ..signals.seismogram import Seismogram
from ..units import plain_number
from .inputs import FREE_SURFACE, shape
from .places import level_distance

CODE = "D36"
ESTIMATE = 3.0  # how far an estimate before the run may be off
FAR = 100.0  # no ground explains it
UNITS = (200.0, 5000.0)  # factors at which m/s and mm/s look confused


class Peak(NamedTuple):
    """Peak component of velocity (m/s), what it is and where, and its plausible range or None."""

    name: str
    ppv: float
    plausible: PlausibleRange | None
    recorded: bool = False

    @property
    def excess(self) -> float:
        """Peak over the nearer end of its range; 1 within, or where there is no range."""
        return 1.0 if self.plausible is None else self.plausible.excess(self.ppv)


def peak_of(motion: Seismogram) -> float:
    """Return the largest peak of a component in m/s; those that are absent do not count."""
    return float(np.nanmax(motion.ppv))


def plausible_at(project, position) -> PlausibleRange | None:
    """Return the plausible range of peak velocity at a position.

    Parameters
    ----------
    project : Project
    position : (3,) float, m

    Returns
    -------
    PlausibleRange or None
        Of the 8 ms window that is nearest by scaled distance, or of the hole of the closed form
        where there is no [blast]. None where no hole moves the ground or its charge is unknown,
        and where no law reaches.
    """
    window = window_at(project, position)
    return None if window is None else plausible_ppv(*window)


def window_at(project, position) -> tuple[float, float] | None:
    """Return distance in m and charge in kg of the 8 ms that are nearest by scaled distance.

    None where no hole moves the ground or its charge is unknown.
    """
    config = project.config
    if project.blast is not None and (config.holes_inside or config.signature):
        return project.blast.strongest_window(position)
    if config.signature is not None and config.signature.cavity is not None:
        hole = config.signature.cavity
        return math.dist(hole.hole_m, position), hole.charge_kg
    return None


def level_table(plausible: PlausibleRange | None, peaks: Iterable[float]) -> dict:
    """Return range, laws and whether a peak (m/s) is outside, for the summary of a receiver."""
    if plausible is None:
        return {
            "plausible_ppv_mm_per_s": None, "laws": [], "implausible": False,
            "charge_distance": None,
        }  # fmt: skip
    return {
        "plausible_ppv_mm_per_s": [1e3 * plausible.low, 1e3 * plausible.high],
        "laws": list(plausible.laws),
        "implausible": any(plausible.excess(peak) != 1.0 for peak in peaks),
        "charge_distance": {"charge": plausible.charge, "distance": plausible.distance},
    }


def plausible_of_table(table: dict) -> PlausibleRange | None:
    """Return the plausible range of a receiver from its summary; None where it has none."""
    ends = table.get("plausible_ppv_mm_per_s")
    if ends is None:
        return None
    low, high = (1e-3 * end for end in ends)
    return PlausibleRange(low, high, **table["charge_distance"], laws=tuple(table["laws"]))


def simulated_peaks(project, simulated: dict[str, Seismogram]) -> list[Peak]:
    """Return the simulated and recorded peaks of all receivers."""
    peaks = []
    for receiver in project.receivers:
        plausible = plausible_at(project, receiver.position)
        peaks.append(Peak(receiver.name, peak_of(simulated[receiver.name]), plausible))
        if receiver.name in project.recorded:
            recorded = peak_of(project.recorded[receiver.name])
            peaks.append(Peak(f"{receiver.name}, recorded", recorded, plausible, True))
    return peaks


def expected_peaks(project) -> list[Peak]:
    """Return peaks that are known before a run: recorded, of the input, of holes inside.

    No mesh is made: a receiver without height stands as high as the highest collar.
    """
    config = project.config
    peaks = input_peaks(project)
    others = config.point_forces or config.moment_tensors or config.pressures
    for receiver in config.receivers:
        top = 0.0 if project.blast is None else float(project.blast.collar[:, 2].max())
        position = np.array([*receiver.position_m, top][:3])
        plausible = plausible_at(project, position)
        if plausible is None:
            continue
        if receiver.name in project.recorded:
            recorded = peak_of(project.recorded[receiver.name])
            peaks.append(Peak(f"{receiver.name}, recorded", recorded, plausible, True))
        if config.holes_inside is not None and not others:
            about = radiated_peak(project, plausible.distance)
            if max(plausible.excess(about), 1.0 / plausible.excess(about)) > ESTIMATE:
                peaks.append(Peak(f"{receiver.name}, estimated", about, plausible))
    return peaks


def input_peaks(project) -> list[Peak]:
    """Return the peaks of the single hole and of the whole blast where the motion enters."""
    config, stages = project.config, project.input
    if stages is None:
        return []
    cavity = config.signature.cavity
    hole = reference = None
    if cavity is not None:
        hole = plausible_ppv(math.dist(cavity.hole_m, cavity.receiver_m), cavity.charge_kg)
    elif config.input.distance_m is not None and project.blast is not None:
        charges = project.blast.charge[project.blast.charge > 0.0]
        reference = config.blast.reference_charge_kg or (
            float(charges.mean()) if len(charges) else math.nan
        )
        if not math.isnan(reference):
            hole = plausible_ppv(config.input.distance_m, reference)
    scale = config.signature.scale
    words = "single hole" if scale == 1.0 else f"single hole times {scale:g}"
    peaks = [Peak(words, peak_of(stages.signature), hole, cavity is None)]
    if cavity is not None:
        whole = plausible_at(project, cavity.receiver_m)
        peaks.append(Peak("whole blast at the input", peak_of(stages.superposed), whole))
    return peaks


def radiated_peak(project, distance: float) -> float:
    """Return about which peak velocity in m/s the holes inside cause at a distance in m.

    Notes
    -----
    Isotropic source of moment M in unbounded rock, doubled at the free surface, all holes at one
    distance: ``v = 2 (M'/r^2 + M''/(r cp)) / (4 pi density cp^2)``, theory.md (13.9).
    """
    inside, rock = project.inside, rock_of_holes(project)
    rate = inside.moment_rate
    alone = moment_velocity(rate.values, rate.dt, distance, rock.density, rock.cp)
    history = superpose(shape(rate, alone), inside.firing).velocity[:, 0]
    return FREE_SURFACE * float(np.abs(history).max())


def rock_of_holes(project):
    """Return the `Material` around the holes inside: as named, or the fastest of the model."""
    hole, rocks = project.config.holes_inside.charged_hole, project.materials
    fastest = max(rocks.values(), key=lambda material: material.cp)
    return fastest if hole is None else rocks[hole.material]


def implausible_level(peaks: Iterable[Peak], advice: str = "") -> Finding | None:
    """D36: peaks outside of what published laws find plausible; None where all lie within.

    Parameters
    ----------
    peaks : iterable of Peak
    advice : str
        What to do about the source.
    """
    outside = sorted(
        (peak for peak in peaks if peak.excess != 1.0),
        key=lambda peak: -abs(math.log(max(peak.excess, 1e-300))),
    )
    if not outside:
        return None
    listed = "; ".join(
        f"{peak.name}: {peak.plausible.describe(peak.ppv)}"
        for peak in outside[:3]
        if peak.plausible
    )
    more = f"; and {len(outside) - 3} more" if len(outside) > 3 else ""
    remedies = []
    if any(peak.recorded for peak in outside):
        remedies.append(_record_advice([peak for peak in outside if peak.recorded]))
    if advice and not all(peak.recorded for peak in outside):
        remedies.append(advice)
    low = sum(peak.excess < 1.0 for peak in outside)
    which = "too low" if low == len(outside) else "too high" if low == 0 else "implausible"
    return Finding(
        "D36",
        f"The level is {which} for charge and distance",
        f"{listed}{more} (5-95 %). {' '.join(remedies)}".strip(),
        max(max(peak.excess, 1.0 / max(peak.excess, 1e-300)) for peak in outside) >= FAR,
        {peak.name: peak.excess for peak in outside},
    )


def _record_advice(peaks) -> str:
    """Return what to look at where a recorded peak is implausible."""
    hint = ""
    for peak in peaks:
        middle = peak.ppv / math.sqrt(peak.plausible.low * peak.plausible.high)
        if UNITS[0] <= max(middle, 1.0 / max(middle, 1e-300)) <= UNITS[1]:
            hint = (
                ": m/s read as mm/s are 1000 times too low" if middle < 1.0 else
                ": mm/s read as m/s are 1000 times too high"
            )  # fmt: skip
    return f"Check the unit of the record{hint}, and the distance and charge of its blast."


def source_advice(config) -> str:
    """Return what sets the level of the source of a `Config`, and what to do about it."""
    inside = config.holes_inside
    if inside is not None and inside.moment_rate_file is not None:
        return "Check the moment_rate_file: N m/s of 1 kg; and blast.charge_exponent."
    if inside is not None:
        by_pressure = inside.charged_hole.pressure_mpa is not None
        sets = "pressure_mpa and radius_m set" if by_pressure else "a law or a peak sets"
        less = "leave out pressure_mpa for a published law, or better " if by_pressure else ""
        return (
            f"In the charged hole {sets} the level: {less}give a moment_rate_file from records of "
            "a signature shot (pyblast source), your site_law (pyblast sitelaw), or "
            "peak_mm_per_s and distance_m."
        )
    if config.signature is not None and config.signature.cavity is not None:
        return (
            "The closed form sets the level: give peak_mm_per_s by your own records or site law "
            "(pyblast sitelaw), leave out both it and pressure_mpa for a published law, or "
            "superpose a recorded hole."
        )
    if config.signature is not None:
        return (
            "Check unit and distance of the recorded hole, signature.scale and "
            "blast.reference_charge_kg."
        )
    return "Check the forces and pressures beside the blast."


def level_words(hole, distance=None) -> str:
    """Return what the level of a `CavityConfig` or `ChargedHoleConfig` rests on."""
    if hole.pressure_mpa is not None:
        return f"its level by a pressure of {plain_number(hole.pressure_mpa)} MPa"
    at = distance or math.dist(hole.hole_m, hole.receiver_m)
    if hole.peak_mm_per_s is not None:
        rests = f"a peak of {plain_number(hole.peak_mm_per_s)} mm/s"
    elif hole.site_law is not None:
        law = hole.site_law
        rests = (
            f"the site's law {plain_number(law.k_mm_per_s)} mm/s "
            f"(R/W^{plain_number(law.charge_exponent)})^-{plain_number(law.exponent)}"
        )
    else:
        rests = f"the law {hole.law or HARD_ROCK.name}"
    return f"its level by {rests} at {plain_number(at)} m"


# Where a level of holes comes from, the most trusted first.
TRUST = ("records of a moment rate", "the site's own law or peak", "a published law", "a pressure")


def level_rank(project) -> dict:
    """Return what the level of the holes inside rests on, its rank in trust, and the low-pass."""
    hole = project.config.holes_inside.charged_hole
    if hole is None:
        rank = 1
    elif hole.pressure_mpa is not None:
        rank = 4
    else:
        rank = 2 if hole.peak_mm_per_s is not None or hole.site_law is not None else 3
    return {
        "rests_on": TRUST[rank - 1], "rank_of_trust": rank, "of": len(TRUST),
        "low_pass_hz": project.inside.low_pass,
    }  # fmt: skip


def moment_rate_words(project) -> str:
    """Return where the moment rate of holes inside comes from, and how it was low-passed."""
    config = project.config.holes_inside
    words = str(config.moment_rate_file)
    if config.charged_hole is not None:
        distance = level_distance(project.config, project.blast)
        words = f"closed form of a charged hole, {level_words(config.charged_hole, distance)}"
    corner = project.inside.low_pass
    if corner is not None:
        words += f", low-passed at {plain_number(corner)} Hz"
    return words


def level_findings(project, peaks: Iterable[Peak]) -> tuple[Finding, ...]:
    """Return the finding about peaks of a project, if there is any."""
    finding = implausible_level(peaks, source_advice(project.config))
    return () if finding is None else (finding,)


# Smallest and largest value that ground and blasts have, in SI: beyond is likely another unit.
LIKELY = {
    "density": (300.0, 9000.0, "kg/m3", 1.0),
    "cp": (50.0, 12000.0, "m/s", 1.0),
    "kn": (1e5, 1e14, "GPa/m", 1e-9),
    "ks": (1e4, 1e14, "GPa/m", 1e-9),
    "wave_speed_m_per_s": (50.0, 12000.0, "m/s", 1.0),
    "detonation_m_per_s": (1000.0, 10000.0, "m/s", 1.0),
    "explosive_kg_per_m3": (200.0, 2500.0, "kg/m3", 1.0),
    "charge_exponent": (0.0, 2.0, "", 1.0),
    "radius_m": (0.02, 20.0, "m", 1.0),
    "peak_time_ms": (5e-3, 1e3, "ms", 1.0),
    "duration_s": (5e-3, 60.0, "s", 1.0),
    "horizontal_ratio": (0.0, 10.0, "", 1.0),
    "stress": (0.0, 5e8, "MPa", 1e-6),
}
LOOSEST, STIFFEST, WET = 1.45, 15.0, (1300.0, 2100.0)  # cp/cs of ground; cp of wet soil, m/s
SOFT, HEAVY = 150.0, 2300.0  # cs in m/s that no rock has which is denser, kg/m3
SHORTEST_DELAY, SHORTEST_BLAST, LONGEST_DELAY = 0.5e-3, 10e-3, 5.0  # s


def unlikely_values(materials, joints, config=None, times=()) -> Finding | None:
    """D26: values that no ground, hole or detonator has; None where all are likely.

    Parameters
    ----------
    materials : dict of str to Material
    joints : sequence of Joint
    config : Config, optional
        Its blast and holes inside.
    times : (n_holes,) float64, s
        When the holes of [blast] fire.
    """
    listed = {f"materials.{name}": vars(rock) | {"cp": rock.cp} for name, rock in materials.items()}
    listed |= {f"joint {joint.surface}": joint.properties for joint in joints}
    parts = "blast", "holes_inside", "run", "insitu"
    tables = {name: getattr(config, name, None) for name in parts}
    tables["charged_hole"] = getattr(tables["holes_inside"], "charged_hole", None)
    listed |= {name: vars(table) for name, table in tables.items() if table is not None}
    if "insitu" in listed:
        stress = 1e6 * max(map(abs, listed["insitu"]["stress_mpa"]), default=0.0)
        listed["insitu"] = listed["insitu"] | {"stress": stress}
    given = {
        f"{part} {key}": (values[key], LIKELY[key])
        for part, values in listed.items()
        for key in LIKELY
        if values.get(key) is not None
    }
    unlikely = {
        key: (value, bounds)
        for key, (value, bounds) in given.items()
        if not bounds[0] <= value <= bounds[1]
    }
    words = [
        f"{key} is {plain_number(factor * value)} {unit}, usual are "
        f"{plain_number(factor * low)} to {plain_number(factor * high)}"
        for key, (value, (low, high, unit, factor)) in unlikely.items()
    ]
    numbers = {key: value for key, (value, _) in unlikely.items()}
    for name, rock in materials.items():
        ratio = rock.cp / rock.cs if rock.cs > 0.0 else math.inf
        wet = WET[0] <= rock.cp <= WET[1]
        if ratio < LOOSEST or (ratio > STIFFEST and not wet):
            words.append(f"materials.{name} cp/cs is {ratio:.3g}, usual are 1.45 to 15")
            numbers[f"materials.{name} cp/cs"] = ratio
        if rock.cs < SOFT and rock.density > HEAVY:
            words.append(
                f"materials.{name} cs is {rock.cs:.3g} m/s at {rock.density:.4g} kg/m3, as if its "
                "moduli were given in GPa"
            )
            numbers[f"materials.{name} cs"] = rock.cs
    gap = _unlikely_delay(times)
    if gap is not None:
        likely = "seconds" if gap < SHORTEST_DELAY else "microseconds"
        words.append(
            f"blast delays are {plain_number(1e3 * gap)} ms and more, as if given in {likely}"
        )
        numbers["blast delay"] = gap
    if not words:
        return None
    return Finding(
        "D26",
        "A value looks like one in another unit",
        f"{'; '.join(words)}; units are in the keys.",
        True,
        numbers,
    )


def _unlikely_delay(times) -> float | None:
    """Return the shortest delay in s if no detonators are so quick, or so slow; else None."""
    gaps = np.diff(np.unique(np.round(np.asarray(times, dtype=float), 9)))
    if not len(gaps):
        return None
    shortest = float(gaps.min())
    quick = shortest < SHORTEST_DELAY and float(gaps.sum()) < SHORTEST_BLAST
    return shortest if quick or shortest > LONGEST_DELAY else None
