"""Level of a blast: the law that anchors it, its energy, and the peaks to expect."""

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..blasts.peaks import PeaksOfLaw
from ..blasts.published_laws import (
    BY_NAME,
    EXPLOSIVES,
    HARD_ROCK,
    LAWS,
    PlausibleRange,
    PublishedLaw,
    plausible_ppv,
)
from ..blasts.signature import ground_peak, moment_velocity, superpose
from ..errors import Finding
from ..mesh.faces import face_vectors
from ..mesh.mesh import surface_zones
from ..model.boundary import StressInput
from ..signals.seismogram import Seismogram
from ..signals.spectra import highest_frequency
from ..sources.inside import (
    FREQUENCY,
    charge_depth,
    level_distance,
    level_peak,
    radiated,
    shape,
)
from ..units import plain_number
from .places import face_areas, full_tensor, normal_axis
from .project import Project

CODE = "D36"
ESTIMATE = 3.0  # how far an estimate before the run may be off
FAR = 100.0  # no ground explains it
OFF, NAMED = 3.0, 2.0  # factors from the law that sets the level: fails, and is named
UNITS = (200.0, 5000.0)  # factors at which m/s and mm/s look confused


class Peak(NamedTuple):
    """Peak component of velocity (m/s), what it is and where, and its plausible range or None.

    ``predicted`` is the peak by the law that sets the level of the source, m/s, where one does;
    ``on_crest`` whether it is behind the crest of a bench by less than the height of that.
    """

    name: str
    ppv: float
    plausible: PlausibleRange | None
    recorded: bool = False
    predicted: float | None = None
    on_crest: bool = False

    @property
    def excess(self) -> float:
        """Peak over the nearer end of its range; 1 within, or where there is no range."""
        return 1.0 if self.plausible is None else self.plausible.excess(self.ppv)

    @property
    def times_predicted(self) -> float:
        """Peak over that of the law that sets the level; 1 where none does."""
        return self.ppv / self.predicted if self.predicted else 1.0


def peak_of(motion: Seismogram) -> float:
    """Return the largest peak of a component in m/s; those that are absent do not count."""
    return float(np.nanmax(motion.ppv))


def plausible_at(project: Project, position) -> PlausibleRange | None:
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
    if window is None:
        return None
    config = project.config
    hole = config.holes_inside.charged_hole if config.holes_inside else None
    if config.signature is not None:
        hole = config.signature.cavity
    stated = hole is not None and (hole.law is not None or hole.site_law is not None)
    law = anchoring_law(project) if stated else None
    return plausible_ppv(*window, LAWS if law is None else (law,))


def anchoring_law(project: Project) -> PublishedLaw | None:
    """Return the law that sets the level of the source of a project, None where none does.

    A peak of its own, of a charged hole or of a recorded one at a known distance, is that of the
    law for hard rock through it; a moment rate or a pressure has no law.
    """
    config, blast = project.config, project.blast
    hole, signature = config.holes_inside and config.holes_inside.charged_hole, config.signature
    peak, distance, charge = None, None, None
    if signature is not None and signature.recorded is not None:
        if config.input.distance_m is None or blast is None or config.blast is None:
            return None
        known = blast.charge[blast.charge > 0.0]
        charge = config.blast.reference_charge_kg or (known.mean() if len(known) else None)
        peak, distance = peak_of(project.signature), config.input.distance_m
    elif signature is not None:
        hole, scale = signature.cavity, signature.scale
        assert hole is not None
        peak, distance = hole.peak_mm_per_s, math.dist(hole.hole_m, hole.receiver_m)
        if scale != 1.0:
            peak = 1e3 * scale * level_peak(hole, distance) if hole.pressure_mpa is None else None
        peak, charge = peak and 1e-3 * peak, hole.charge_kg
    elif hole is not None:
        peak = hole.peak_mm_per_s and 1e-3 * hole.peak_mm_per_s
        distance, charge = hole.distance_m, hole.charge_kg
    if peak and distance and charge:
        k = peak * (distance / charge**HARD_ROCK.charge_exponent) ** HARD_ROCK.beta
        name = f"{HARD_ROCK.name} through {plain_number(1e3 * peak)} mm/s"
        return replace(HARD_ROCK, name=name, k=float(k))
    if hole is None or hole.pressure_mpa is not None:
        return None
    if hole.site_law is not None:
        law = hole.site_law
        own = "the site's own law", "your ground", "charged_hole.site_law"
        return PublishedLaw(*own, 1e-3 * law.k_mm_per_s, law.exponent, law.charge_exponent)
    return BY_NAME[hole.law or HARD_ROCK.name]


def predicted_peak(project: Project, position) -> float | None:
    """Return the peak in m/s at a position (3,) m by the law that sets the level, or None."""
    law, window = anchoring_law(project), window_at(project, position)
    return None if law is None or window is None else law.ppv(*window)


def level_error(project: Project, position) -> tuple[PeaksOfLaw, str] | None:
    """Return the distribution of the peak at a position over the simulated one, and its law.

    None where no law sets the level of the source.
    """
    law, window = anchoring_law(project), window_at(project, position)
    if law is None or window is None:
        return None
    return replace(law.peak(*window), median=1.0), law.name


def window_at(project: Project, position) -> tuple[float, float] | None:
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


def level_table(project: Project, position, peaks: Iterable[float]) -> dict:
    """Return prediction, range, laws and whether a peak (m/s) is outside, for a receiver."""
    plausible, predicted = plausible_at(project, position), predicted_peak(project, position)
    table = {"predicted_mm_per_s": None if predicted is None else 1e3 * predicted}
    if plausible is None:
        return table | {
            "plausible_ppv_mm_per_s": None, "laws": [], "implausible": False,
            "charge_distance": None,
        }  # fmt: skip
    return table | {
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


def simulated_peaks(
    project: Project, simulated: dict[str, Seismogram], complete: bool = True
) -> list[Peak]:
    """Return the simulated and recorded peaks of all receivers.

    Where the run does not hold the whole motion of the blast, ``complete`` false, a simulated peak
    is a part of it: only one that is too high is a peak to judge.
    """
    peaks = []
    for receiver in project.receivers:
        plausible = plausible_at(project, receiver.position)
        predicted = predicted_peak(project, receiver.position)
        ppv = peak_of(simulated[receiver.name])
        if complete or ppv > (predicted or math.inf):
            crest = on_crest(project.config.mesh.benches, receiver.position)
            peaks.append(Peak(receiver.name, ppv, plausible, predicted=predicted, on_crest=crest))
        if receiver.name in project.recorded:
            recorded = peak_of(project.recorded[receiver.name])
            peaks.append(Peak(f"{receiver.name}, recorded", recorded, plausible, True))
    return peaks


def on_crest(benches, position) -> bool:
    """Tell whether a position (3,) m stands within the height of a bench of its crest, in plan."""
    for bench in benches:
        if bench.crest_m is not None and bench.height_m is not None:
            crest, plan = np.array(bench.crest_m)[:, :2], np.asarray(position)[:2]
            start, along = crest[:-1], np.diff(crest, axis=0)
            share = np.sum((plan - start) * along, axis=1) / np.sum(along**2, axis=1)
            foot = start + np.clip(share, 0.0, 1.0)[:, None] * along
            if np.linalg.norm(foot - plan, axis=1).min() < bench.height_m:
                return True
    return False


@lru_cache(1)
def expected_peaks(project: Project) -> tuple[Peak, ...]:
    """Return peaks that are known before a run: recorded, of the input, of holes inside.

    No mesh is made: a receiver without height stands as high as the highest collar. Those of the
    last project are kept: the command line and its checks ask for the same.
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
            far = max(plausible.excess(about), 1.0 / plausible.excess(about)) > ESTIMATE
            peaks.append(
                Peak(
                    f"{receiver.name}, estimated", about, plausible if far else None,
                    predicted=predicted_peak(project, position),
                )
            )  # fmt: skip
    return tuple(peaks)


def input_peaks(project: Project) -> list[Peak]:
    """Return the peaks of the single hole and of the whole blast where the motion enters."""
    config, stages = project.config, project.input
    if stages is None or config.signature is None:
        return []
    cavity = config.signature.cavity
    hole = reference = None
    if cavity is not None:
        hole = plausible_ppv(math.dist(cavity.hole_m, cavity.receiver_m), cavity.charge_kg)
    elif config.input.distance_m is not None and project.blast is not None:
        charges = project.blast.charge[project.blast.charge > 0.0]
        assert config.blast is not None
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


def radiated_peak(project: Project, distance: float) -> float:
    """Return about which peak velocity in m/s the holes inside cause at a distance in m.

    Notes
    -----
    Isotropic source of moment M, all holes at one distance: the motion of unbounded rock,
    ``v = (M'/r^2 + M''/(r cp)) / (4 pi density cp^2)``, theory.md (13.9), times what the peak of
    one hole on the ground is over that, `ground_peak`.
    """
    inside, rock = project.inside, rock_of_holes(project)
    rate = inside.unfiltered or inside.moment_rate
    alone = moment_velocity(rate.values, rate.dt, distance, rock.density, rock.cp)
    history = superpose(shape(rate, alone), project.firing).velocity[:, 0]
    depth = charge_depth(project.config, project.blast)
    over = ground_peak(rate, distance, depth, rock) / float(np.abs(alone).max())
    return over * float(np.abs(history).max())


def rock_of_holes(project: Project):
    """Return the `Material` around the holes inside: as named, or the fastest of the model."""
    inside, rocks = project.config.holes_inside, project.materials
    hole = None if inside is None else inside.charged_hole
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
        failed=max(max(peak.excess, 1.0 / max(peak.excess, 1e-300)) for peak in outside) >= FAR,
        numbers={peak.name: peak.excess for peak in outside},
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


def frequency_words(project: Project) -> str:
    """Return that the frequency of simulated motion is assumed, to follow a method; "" if given."""
    inside = project.config.holes_inside
    hole = None if inside is None else inside.charged_hole
    if hole is None or hole.frequency_hz is not None or hole.peak_time_ms is not None:
        return ""
    return (
        f"; of simulated motion it follows from the {plain_number(FREQUENCY)} Hz assumed for each "
        "hole, and so does the limit: give holes_inside.charged_hole.frequency_hz from records"
    )


# Where a level of holes comes from, the most trusted first.
TRUST = ("records of a moment rate", "the site's own law or peak", "a published law", "a pressure")


def level_rank(project: Project) -> dict:
    """Return what the level of the holes inside rests on, its rank in trust, and the low-pass."""
    inside = project.config.holes_inside
    hole = None if inside is None else inside.charged_hole
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


def moment_rate_words(project: Project) -> str:
    """Return where the moment rate of holes inside comes from, and how it was low-passed."""
    config = project.config.holes_inside
    assert config is not None
    words = str(config.moment_rate_file)
    if config.charged_hole is not None:
        distance = level_distance(project.config, project.blast)
        words = f"closed form of a charged hole, {level_words(config.charged_hole, distance)}"
    corner = project.inside.low_pass
    if corner is not None:
        words += f", low-passed at {plain_number(corner)} Hz"
    return words


def level_findings(project: Project, peaks: Iterable[Peak]) -> tuple[Finding, ...]:
    """Return the findings about peaks of a project, if there are any."""
    peaks = tuple(peaks)
    advice = source_advice(project.config)
    findings = implausible_level(peaks, advice), off_its_law(project, peaks)
    return tuple(finding for finding in findings if finding is not None)


def off_its_law(project: Project, peaks: Iterable[Peak]) -> Finding | None:
    """D36: peaks that differ from those of the law that sets the level; None where none do."""
    law = anchoring_law(project)
    factors = {
        peak.name: max(peak.times_predicted, 1.0 / max(peak.times_predicted, 1e-300))
        for peak in peaks
    }
    off = sorted((p for p in peaks if factors[p.name] > NAMED), key=lambda p: -factors[p.name])
    if law is None or not off:
        return None
    listed = "; ".join(
        f"{peak.name}: {plain_number(1e3 * peak.ppv)} mm/s, by the law "
        f"{plain_number(1e3 * (peak.predicted or 0.0))}"
        for peak in off[:3]
    )
    more = f"; and {len(off) - 3} more" if len(off) > 3 else ""
    crests = ", ".join(peak.name for peak in off if peak.on_crest)
    on_edge = (
        f" At {crests}, beside the crest of a bench, the ground moves more than flat ground does, "
        "which no law knows: not an error of the level."
        if crests else ""
    )  # fmt: skip
    return Finding(
        "D36",
        "Peaks are not those of the law that sets the level",
        f"{listed}{more}, {law.name} with the charge of 8 ms. A factor of {NAMED:g} is more "
        f"than the ground of most sites explains, beyond {OFF:g} the run says nothing about the "
        "level. Look at how pulses of delayed holes overlap (a frequency_hz below that of records, "
        "a low-pass), at the distance where the law holds (distance_m, that of the receivers), "
        f"and at soil or faults on the way.{on_edge}",
        failed=max((factors[p.name] for p in off if not p.on_crest), default=0.0) > OFF,
        numbers={peak.name: peak.times_predicted for peak in off},
    )


SEISMIC_SHARE, MOST_SHARE = 0.1, 0.2  # of the heat of an explosive: a note above, failed above


class SourceEnergy(NamedTuple):
    """Energy that the sources of a project put in, and that of its explosive, both in J.

    ``explosive`` is None where no charge is known; ``returned`` is what sources of a run put in
    and took back.
    """

    put_in: float
    explosive: float | None
    returned: float = 0.0

    @property
    def share(self) -> float:
        """What is put in over what the explosive holds; 0 where that is unknown."""
        return 0.0 if self.explosive is None else self.put_in / self.explosive

    def table(self) -> dict:
        """Return these energies for the summary of a run."""
        return {
            "put_in_j": self.put_in, "explosive_j": self.explosive, "returned_j": self.returned,
        }  # fmt: skip


def source_energy(project: Project, ledger: np.ndarray | None = None) -> SourceEnergy:
    """Return the energy that the sources of a project put into the ground.

    Parameters
    ----------
    project : Project
    ledger : (n_lines,) float64, J, optional
        Input of a run over time. Without it, and for what enters through a face, the closed form.

    Notes
    -----
    Of moments M n: ``E = integral M''^2 dt (A/cp^5 + B/cs^5)/(4 pi density)`` with the means A of
    ``(g n g)^2`` and B of ``|n g|^2 - (g n g)^2`` over all directions g, of forces
    ``integral F'^2 dt (1/cp^3 + 2/cs^3)/(12 pi density)``, of waves through a face
    ``integral density (cp v_n^2 + cs v_s^2) dt`` times its area: theory.md (13.10) to (13.12). All
    holes count as if in one place, which is the most that they radiate.
    """
    explosive = explosive_energy(project)
    config = project.config
    if ledger is not None and project.input is None:
        end = max(float(ledger[-1]), 0.0)
        return SourceEnergy(end, explosive, float(ledger.max()) - end)
    rocks, inside = project.materials.values(), project.inside
    rock = max(rocks, key=lambda material: material.cp)
    if config.holes_inside is not None:
        rock = rock_of_holes(project)
    energy = 0.0
    if inside.moment_rate is not None:
        fired = superpose(radiated(inside.moment_rate), project.firing)
        energy += radiated_energy(fired.velocity[:, 0], fired.dt, np.eye(3), rock)
    for part, rate in zip(config.moment_tensors, inside.tensors, strict=True):
        slope = np.gradient(rate.values, rate.dt)
        energy += radiated_energy(slope, rate.dt, full_tensor(part.tensor), rock)
    for force in inside.forces:
        square = force.dt * float(np.sum(np.gradient(force.values, force.dt) ** 2))
        energy += square * (rock.cp**-3 + 2.0 * rock.cs**-3) / (12.0 * math.pi * rock.density)
    if project.input is not None and project.config.input.decay_exponent is not None:
        energy += graded_energy(project)
    elif project.input is not None:
        energy += incident_energy(project.input.motion, face_areas(project), normal_axis(project))
    return SourceEnergy(energy, explosive)


def radiated_energy(slope: np.ndarray, dt: float, tensor: np.ndarray, rock) -> float:
    """Return the energy in J that a moment tensor radiates into unbounded rock.

    Parameters
    ----------
    slope : (n,) float64, N m/s2
        Second derivative of the moment that multiplies the tensor.
    dt : float, s
    tensor : (3, 3) float64
    rock : Material
    """
    square, trace = float(np.sum(tensor**2)), float(np.trace(tensor))
    along = (2.0 * square + trace**2) / 15.0
    waves = along / rock.cp**5 + (square / 3.0 - along) / rock.cs**5
    return dt * float(np.sum(slope**2)) * waves / (4.0 * math.pi * rock.density)


def incident_energy(motion: Seismogram, face, axis: int = 0) -> float:
    """Return the energy in J of a wave that enters through a face.

    Parameters
    ----------
    motion : Seismogram
        Of the incident wave.
    face : sequence of (area m2, Material)
    axis : int
        Component along the normal of the face.
    """
    work = motion.dt * np.sum(np.nan_to_num(motion.velocity) ** 2, axis=0)
    normal, shear = float(work[axis]), float(work.sum() - work[axis])
    return sum(a * m.density * (m.cp * normal + m.cs * shear) for a, m in face)


def graded_energy(project: Project) -> float:
    """Return the energy in J of waves whose amplitude and delay vary over a face.

    The spectra of all holes are summed at each facet: theory.md (5.18).
    """
    mesh, face = project.model.mesh, project.config.input.face
    (boundary,) = (b for b in project.model.boundaries if isinstance(b, StressInput))
    motion, fronts = boundary.seismogram, boundary.fronts
    assert fronts is not None
    n_padded = 2 * len(motion.velocity)
    spectrum = motion.dt * np.fft.rfft(np.nan_to_num(motion.velocity), n_padded, axis=0)
    frequency = np.fft.rfftfreq(n_padded, motion.dt)
    used = frequency <= 1.5 * highest_frequency(motion)
    power = 2.0 * frequency[1] * np.abs(spectrum[used]) ** 2  # both signs of frequency
    axis = int(np.argmax(np.abs(fronts.axis)))
    normal, shear = power[:, axis], power.sum(axis=1) - power[:, axis]
    faces = mesh.surfaces[face]
    area = np.linalg.norm(face_vectors(mesh.points, faces), axis=1)
    group, energy = mesh.zone_group[surface_zones(mesh, face)], 0.0
    for part in np.array_split(np.arange(len(faces)), len(faces) // 100 + 1):
        amplitude, delay, _ = fronts.at(mesh.points[faces[part]].mean(axis=1))
        turns = -2j * np.pi * frequency[used][:, None, None] * delay
        level = np.abs(np.sum(amplitude * np.exp(turns), axis=1)) ** 2  # frequency by facet
        for number in np.unique(group[part]):
            rock, own = project.model.materials[mesh.groups[number]], group[part] == number
            flux = rock.density * (rock.cp * normal + rock.cs * shear) @ level[:, own]
            energy += float(flux @ area[part][own])
    return energy


def explosive_energy(project: Project) -> float | None:
    """Return the heat in J of the explosive of a project, None where no charge is known."""
    signature = project.config.signature
    if project.blast is not None:
        charge = float(project.blast.charge.sum())
    elif signature is not None and signature.cavity is not None:
        charge = signature.cavity.charge_kg
    else:
        return None
    return charge * EXPLOSIVES["ANFO"].heat if charge > 0.0 else None


def energy_finding(energy: SourceEnergy) -> Finding | None:
    """D21: sources that put in more than blasts send into waves; None where it is less."""
    if energy.explosive is None or not energy.share > SEISMIC_SHARE:
        return None
    return Finding(
        "D21",
        "The sources put in too much energy",
        f"They put in {plain_number(energy.put_in / 1e9)} GJ, {plain_number(100 * energy.share)} % "
        f"of the heat of the explosive ({plain_number(energy.explosive / 1e9)} GJ at "
        f"{EXPLOSIVES['ANFO'].heat / 1e6:g} MJ/kg); blasts send 1 to {100 * SEISMIC_SHARE:.0f} % "
        "into waves. Causes: one record on a whole face with all holes in phase; pulses so long "
        "that delayed holes overlap; joints or ground that slip and yield at the sources "
        "(holes_inside.core_m); a level that is too high. Take a law's level per delay and a "
        "pulse of the frequency of records.",
        failed=energy.share > MOST_SHARE,
        numbers={"energy": energy.put_in, "share": energy.share},
    )
