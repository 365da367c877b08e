"""Where a run holds: receivers and frequencies that count."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ..errors import Finding, InputError
from ..mesh.mesh import zone_edge_lengths
from ..signals.spectra import highest_frequency
from ..sources.inside import LEAST_PEAK, NEARLY, held_shares
from ..units import plain_number
from .places import normal_axis, radiating_positions
from .project import Project

LEAST_ENERGY = 0.95  # share of the blast's motion that a run has to hold
HELD = 1.0 / 3.0  # share of the peak of the blast, below which a run is of another blast
LEAST_SPAN = 1.5  # highest over lowest frequency of a band in which records can be compared
SAMPLES = 200  # along the way to a receiver
THIN = 8.0  # layers thinner than a wavelength over this move as one
STIFF = 0.5  # S speed over that around the sources, of ground through which waves come


@dataclass(frozen=True)
class ReceiverValidity:
    """Where a run holds at one receiver.

    Parameters
    ----------
    name : str
    carried : float, Hz
        Highest frequency that the mesh carries on the straight way from the sources.
    limited_by : str
        The ground on that way that carries least.
    """

    name: str
    carried: float
    limited_by: str


@dataclass(frozen=True)
class Band:
    """Frequencies of a run beside those of its blast.

    Parameters
    ----------
    carried, needed : float, Hz
        What the mesh carries at all receivers; below what 95 % of the energy of the motion lies
        that enters, before any low-pass.
    limited_by : str
        Ground that sets ``carried``; of the thinnest waves where nothing is received.
    energy_share, peak_share : float
        What the run holds of the energy and of the peak of that motion.
    """

    carried: float
    needed: float
    limited_by: str
    energy_share: float
    peak_share: float

    @property
    def of_its_blast(self) -> bool:
        """Whether the run holds enough of its blast to be one of it, in whatever band."""
        return self.peak_share >= HELD and self.energy_share >= HELD**2

    @property
    def complete(self) -> bool:
        """Whether peaks, frequencies and limits may be compared."""
        return self.energy_share >= LEAST_ENERGY and self.peak_share >= LEAST_PEAK

    def table(self) -> dict:
        """Return the table ``band`` of a summary."""
        return {
            "carried_hz": self.carried, "needed_hz": self.needed, "limited_by": self.limited_by,
            "energy_share": self.energy_share, "peak_share": self.peak_share,
            "complete": self.complete,
        }  # fmt: skip


def validity(project: Project) -> tuple[ReceiverValidity, ...]:
    """Return where the run of a project holds, for each receiver.

    Notes
    -----
    The mesh carries ``cs / (n e)`` in the zones, of mean edge e, that the way from the middle of
    the sources to the receiver meets, at last up through its soft ground; n edges make a
    wavelength. A layer of height H
    carries ``cs / 8 H`` at least: below that frequency it moves as one.
    """
    mesh = project.model.mesh
    zones = KDTree(mesh.points[mesh.zones].mean(axis=1))
    return tuple(
        ReceiverValidity(r.name, *_least(project, zones, _way(project, zones, r.position)))
        for r in project.receivers
    )


def _way(project: Project, zones, position):
    """Return points (n, 3) on the way from the sources of a project to a receiver.

    Waves turn upwards into soft ground: the way goes straight to the stiff ground below the
    receiver, and from there up.
    """
    share = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    end, start = np.asarray(position, dtype=float), _middle(project, position)
    mesh, cs = project.model.mesh, project.model.zone_values("cs")
    below = end - share * [0.0, 0.0, np.ptp(mesh.points[:, 2])]
    below = below[below[:, 2] >= mesh.points[:, 2].min()]
    stiff = cs[zones.query(below)[1]] >= STIFF * cs[zones.query(start)[1]]
    turn = below[int(np.argmax(stiff)) if stiff.any() else 0]
    return np.concatenate([start + share * (turn - start), turn + share * (end - turn)])


def _middle(project: Project, position):
    """Return the middle (3,) of the sources, or where their waves enter the face."""
    sources = radiating_positions(project)
    if len(sources):
        return sources.mean(axis=0)
    mesh, across = project.mesh, normal_axis(project)
    face = mesh.points[np.unique(mesh.surfaces[project.config.input.face])]
    start = np.array(position, dtype=float)
    if project.blast is not None:
        start[2] = np.clip(project.blast.centres[:, 2].mean(), face[:, 2].min(), face[:, 2].max())
    start[across] = face[:, across].mean()
    return start


def _least(project: Project, zones, points):
    """Return the frequency in Hz that zones next to points carry, and which ground sets it."""
    model = project.model
    mesh, (_, zone) = model.mesh, zones.query(points)
    edges = model.edges_per_wavelength * zone_edge_lengths(mesh)[zone].mean(axis=1)
    speed, group = model.zone_values("cs")[zone], mesh.zone_group[zone]
    layers = project.config.mesh.layers
    height = {part.material: part.thickness_m for part in layers if part.thickness_m is not None}
    carried = {}
    for number in np.unique(group):
        own, name = group == number, mesh.groups[number]
        carried[name] = 1.0 / float(np.mean(edges[own] / speed[own]))
        if name in height:
            carried[name] = max(carried[name], float(speed[own].mean()) / (THIN * height[name]))
    name = min(carried, key=lambda group: carried[group])
    return carried[name], name


def band_of(project: Project) -> Band:
    """Return the band of the run of a project beside that of its blast."""
    before, after = project.shot.unfiltered, project.shot.motions
    needed = max(highest_frequency(motion) for motion in before)
    rows = validity(project)
    if rows:
        least = min(rows, key=lambda row: row.carried)
        carried, ground = least.carried, least.limited_by
    else:
        by_group = project.model.highest_frequency()
        ground = min(by_group, key=lambda name: by_group[name])
        carried = by_group[ground]
    shares = [
        held_shares(whole, passed, carried) for whole, passed in zip(before, after, strict=True)
    ]
    energy, peak = np.min(shares, axis=0)
    return Band(carried, needed, ground, float(energy), float(peak))


def carried_band(
    projects: Sequence[Project], band: tuple[float, float] | None, names: Sequence[str]
) -> tuple[tuple[float, float] | None, Finding | None]:
    """Return the part of a band in Hz that the meshes of blasts carry to receivers, and D40.

    Parameters
    ----------
    projects : sequence of Project
        One for each blast.
    band : tuple of 2 float, Hz, or None
        None: all that enters; it stays None where the meshes carry that.
    names : sequence of str
        Of receivers; those of them that a project has.

    Raises
    ------
    InputError
        If they carry nothing of the band.
    """
    low = 1.0 / min(project.config.run.duration_s for project in projects)
    top = max(project.shot.highest_frequency for project in projects)
    low, top = (low, top) if band is None else band
    rows = [(row, each) for each in projects for row in validity(each) if row.name in names]
    row, project = min(rows, key=lambda pair: pair[0].carried)
    if row.carried >= NEARLY * top:
        return band, None
    ground, hz = project.model, plain_number(row.carried)
    edge = plain_number(float(ground.mean_edges()[row.limited_by]) * row.carried / top, 2)
    carried = f"carries motion up to {hz} Hz on the way to {row.name}: {row.limited_by!r} sets that"
    remedy = f"edges of {edge} m there carry {plain_number(top)} Hz"
    if row.carried < LEAST_SPAN * low:
        raise InputError(
            f"{project.path.name}: mesh {carried}, and records are compared from "
            f"{plain_number(low)} Hz on; {remedy}"
        )
    return (low, row.carried), Finding(
        "D40",
        "Records are compared in the band that the mesh carries",
        f"{project.path.name}: the mesh {carried}, so records are compared from "
        f"{plain_number(low)} to {hz} Hz and not to {plain_number(top)}; {remedy}. A receiver that "
        "is left out no longer sets it.",
        numbers={"carried": row.carried, "asked": top},
    )


def band_finding(project: Project, band: Band, seconds: float | None = None) -> Finding | None:
    """D40: a run that holds less than the band of its blast; None where it holds it.

    ``seconds`` are those of the run, where they are known. It fails no project that states the
    band of its comparison, whose mesh carries that, and whose run holds a third of the peak and a
    ninth of the energy of its blast.
    """
    if band.complete:
        return None
    corner = project.inside.low_pass
    if project.input is not None:
        corner = project.config.input.low_pass_hz
    compared = project.config.run.compare_band_hz
    filtered = "" if corner is None else f" (low-passed at {plain_number(corner)} Hz)"
    return Finding(
        "D40",
        "The run does not hold the motion of the blast",
        f"It holds motion up to {plain_number(band.carried)} Hz{filtered}, the blast has motion up "
        f"to {plain_number(band.needed)} Hz: {100 * band.energy_share:.2g} % of the energy and "
        f"{100 * band.peak_share:.2g} % of the peak of what enters are in the run. '"
        f"{band.limited_by}' decides that.{_steep_front(project)}"
        f"{_price(project, band, seconds)} Peaks are those of "
        f"motion below {plain_number(band.carried)} Hz; frequencies and limits are not compared.",
        failed=compared is None or NEARLY * compared[1] > band.carried or not band.of_its_blast,
        numbers={"carried": band.carried, "needed": band.needed, "energy": band.energy_share,
         "peak": band.peak_share},
    )  # fmt: skip


def _steep_front(project: Project):
    """Return a sentence on a pulse by the time of its peak, whose front holds high frequencies."""
    inside = project.config.holes_inside
    hole = None if inside is None else inside.charged_hole
    if hole is None or hole.peak_time_ms is None:
        return ""
    return (
        f" A pulse by peak_time_ms = {plain_number(hole.peak_time_ms)} has the front of a cavity: "
        "frequency_hz in its place gives one of the frequency of records."
    )


def _price(project: Project, band, seconds):
    """Return what a mesh for the band of the blast would cost, a sentence."""
    model = project.model
    ratio = {name: band.needed / hz for name, hz in model.highest_frequency().items()}
    ratio[band.limited_by] = max(ratio[band.limited_by], band.needed / band.carried)
    if max(ratio.values()) <= 1.0:
        return " Its mesh carries more; raise low_pass_hz."
    edge = float(model.mean_edges()[band.limited_by]) / ratio[band.limited_by]
    counts = np.bincount(model.mesh.zone_group, minlength=len(model.mesh.groups))
    finer = [max(1.0, ratio.get(name, 1.0)) ** 3 for name in model.mesh.groups]
    zones, now = float(counts @ finer), len(model.mesh.zones)
    longer = zones / now * max(ratio.values())
    wait = f"{plain_number(longer, 2)} times the run time"
    if seconds is not None:
        minutes = [plain_number(max(0.1, time / 60.0), 2) for time in (longer * seconds, seconds)]
        wait = f"{minutes[0]} min in place of {minutes[1]}"
    return (
        f" Edges of {plain_number(edge, 2)} m there, in all about {plain_number(zones, 2)} zones "
        f"in place of {now}, carry it in about {wait}."
    )
