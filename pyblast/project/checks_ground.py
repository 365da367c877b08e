"""Summary of a model, and findings about its mesh, ground, joints, damping and boundaries."""

import math
from dataclasses import dataclass

import numpy as np

from ..errors import Finding, by_wave
from ..ground.surface import benches_of, welded_surfaces
from ..ground.tables import set_normal, set_stiffness
from ..mesh.faces import face_vectors
from ..mesh.mesh import quality, surface_areas, zone_volumes
from ..mesh.quality import count_blocks
from ..model.joint import infill_stiffness
from ..model.terrain import burdens
from ..simulation.estimate import cost_of
from ..solver import assembly
from ..solver.initial_stress import joint_pressures
from ..solver.loads import surface_impedance
from ..units import plain_number
from .places import face_materials

LITTLE, MISMATCH = 0.7, 0.1
MOST_NAMED = 4  # receivers in one sentence
DEAR_JOINT = 2.0  # factor on the number of steps
CLOSED = 0.02  # radian: delay of waves by a joint that counts as closed
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))


def transmitted_share(face, sides, share):
    """Return the share of a long plane wave that viscous sides along its path transmit, (3,).

    Parameters
    ----------
    face : (3, 3) float64, N s/m
        Impedance of the whole input face.
    sides : (3, 3) float64, N s/m
        Impedance of all dashpots on surfaces along the path.
    share : float
        Of the path along the sides that the wave has covered.

    Notes
    -----
    The wave carries the power v Z v through the face and the dashpots dissipate v D v, spread
    along the path: the amplitude decays about as ``exp(-share D / (2 Z))`` where the wavelength
    exceeds the width of the model; shorter waves lose less in the middle. theory.md section 4.1.
    """
    return np.exp(-0.5 * share * np.diag(sides) / np.diag(face))


def dissipating_sides(surfaces, transmitted, receiver, from_below):
    """D23: viscous sides along the path of a plane wave; None where they absorb little.

    Parameters
    ----------
    surfaces : sequence of str
    transmitted : (3,) float64
        Of `transmitted_share`, east, north, vertical.
    receiver : str
        Where.
    from_below : bool
        Whether the wave runs up: free-field sides are then the cure.
    """
    if not len(surfaces) or min(transmitted) > LITTLE:
        return None
    listed = "/".join(f"{100.0 * value:.2g}" for value in transmitted)
    cure = (
        "make it wider, compare with rollers on these sides, or let the wave come from below, "
        "where boundaries.free_field keeps it"
    )
    if from_below:
        cure = "name these sides in boundaries.free_field, so that they move with the ground beside"
    return Finding(
        "D23",
        "Viscous sides absorb the wave that runs along them",
        f"The dashpots on {', '.join(surfaces)} transmit only {listed} % of a long wave "
        f"(east/north/vertical) to {receiver}, so that the width of the model sets the amplitude "
        f"there; {cure}.",
        numbers=dict(zip(("east", "north", "vertical"), map(float, transmitted), strict=True)),
    )


def jointed_stiffness(material, joint_sets):
    """Return the stiffness (3, 3, 3, 3) in Pa of rock with joints closer than waves are long.

    Parameters
    ----------
    material : Material
    joint_sets : sequence of (normal (3,), kn, ks, spacing)
        SI.

    Notes
    -----
    Strain is that of the rock plus ``sym(jump n) / spacing`` of each set, the jump being traction
    over stiffness: Schoenberg (1980).
    """
    compliance = np.zeros((6, 6))
    for column, stress in enumerate(_BASIS):
        strain = stress / (2.0 * material.shear)
        poisson = material.poisson / (2.0 * material.shear * (1.0 + material.poisson))
        strain = strain - poisson * np.trace(stress) * np.eye(3)
        for normal, kn, ks, spacing in joint_sets:
            traction = stress @ normal
            normal_part = (traction @ normal) * normal
            jump = normal_part / kn + (traction - normal_part) / ks
            strain = strain + (np.outer(jump, normal) + np.outer(normal, jump)) / (2.0 * spacing)
        compliance[:, column] = np.einsum("bij,ij->b", _BASIS, strain)
    return np.einsum("aij,ab,bkl->ijkl", _BASIS, np.linalg.inv(compliance), _BASIS)


def _basis():
    """Return the six unit stresses (6, 3, 3), orthonormal."""
    basis = np.zeros((6, 3, 3))
    for tensor, (i, j) in zip(basis, _PAIRS, strict=True):
        tensor[i, j] = tensor[j, i] = 1.0 if i == j else math.sqrt(0.5)
    return basis


_BASIS = _basis()


def jointed_face(group, material, joint_sets, direction):
    """D24: dashpots and stress input of intact rock on a face of jointed rock; None if alike.

    Parameters
    ----------
    group : str
    material : Material
    joint_sets : sequence of (normal (3,), kn, ks, spacing)
        Those that cut the group, SI.
    direction : (3,) float64
        Normal of the face.

    Notes
    -----
    Waves much longer than the spacing meet the impedance rho c' of the jointed rock. A face that is
    driven and damped with rho c then moves by 2 c / (c + c') times the wanted motion, and its
    dashpots reflect (c - c') / (c + c'). theory.md section 4.2.
    """
    stiffness = jointed_stiffness(material, joint_sets)
    christoffel = np.einsum("ijkl,j,l->ik", stiffness, direction, direction)
    moduli, axes = np.linalg.eigh(christoffel)
    along = int(np.argmax(np.abs(direction @ axes)))
    ratio_p = math.sqrt(moduli[along] / material.density) / material.cp
    ratio_s = math.sqrt(np.delete(moduli, along).min() / material.density) / material.cs
    excess = [2.0 / (1.0 + ratio) - 1.0 for ratio in (ratio_p, ratio_s)]
    if max(excess) < MISMATCH:
        return None
    return Finding(
        "D24",
        f"Viscous faces ignore the joints of '{group}'",
        f"Waves much longer than the spacing run at {ratio_p:.2f} (P) and {ratio_s:.2f} (S) of the "
        f"speed of the intact rock, but stress input and dashpots use that of the intact rock: "
        f"the motion that enters is {100 * excess[0]:.0f} % (P) and up to {100 * excess[1]:.0f} % "
        "(S) too large, and viscous faces reflect the same share of the amplitude; set "
        "boundaries.jointed_faces = true for the impedance of the jointed rock.",
        numbers={"speed_p": ratio_p, "speed_s": ratio_s, "excess_p": excess[0],
                 "excess_s": excess[1]},
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
        f"At {frequency:.3g} Hz the wavelengths (P/S) are {listed}, the model is {length:g} m "
        "long: everything is near field, and waves graze the viscous sides, which absorb well only "
        "above about 30 degrees of incidence.",
        numbers={"length": length}
        | by_wave(waves),
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


def transmission(stiffness, impedance, frequency):
    """Return |T| of a joint at normal incidence: 1/sqrt(1 + (omega Z / 2 K)^2)."""
    return 1.0 / math.hypot(1.0, math.pi * frequency * impedance / stiffness)


def fault_low_pass(name, stiffness, group, material, frequency, band):
    """D8 and D9: a fault that itself is a low-pass; None where it passes the band.

    The stiffness is the tangent one, kn and ks in Pa/m, under the pressure before the blast.
    """
    z_p, z_s = material.density * material.cp, material.density * material.cs
    kn, ks = stiffness
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
        "A fault is itself a low-pass",
        f"{name} in '{group}': its corner is {corners[0]:.1f} Hz (P) and {corners[1]:.1f} Hz (S); "
        f"it passes {listed} (P/S). Amplitudes alone can't separate its stiffness from damping, "
        f"soil or mesh (for waveforms: backanalyse --design-survey); at {frequency:.3g} Hz +10 % "
        f"of kn gives {100 * gain[0]:+.0f} % P, of ks {100 * gain[1]:+.0f} % S (D9).",
        numbers={"corner_p": corners[0], "corner_s": corners[1], "gain_p": gain[0],
                 "gain_s": gain[1]}
        | {f"t_{key}": v for key, v in by_wave({f"{f:g}": pair for f, pair in at.items()}).items()},
    )  # fmt: skip


def jointed_speeds(name, stiffness, spacing, group, material, frequency):
    """D11: a joint set delays waves but hardly weakens them; stiffness as of `fault_low_pass`."""
    kn, ks = stiffness
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
        f"One joint passes {passed[0]:.3f} (P) and {passed[1]:.3f} (S) at {frequency:.3g} Hz, but "
        f"the set makes '{group}' slower by {-100 * slower[0]:.0f} % (P) and "
        f"{-100 * slower[1]:.0f} % (S): a comparison of peaks and frequencies "
        "does not see it, arrival times do.",
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
        f"{thickness:g} m on rock of {contrast:.1f} times its impedance resonate at "
        f"{plain_number(own)} Hz and odd multiples; {frequency:.3g} Hz would be "
        f"{plain_number(material.cs / (4.0 * frequency), 2)} m of it: another reading of the same "
        "peak.",
        numbers={"own": own, "thickness_at_centre": material.cs / (4.0 * frequency)},
    )


def rayleigh_price(damping, undamped_dt, group=""):
    """D16: Rayleigh damping away from its central frequency, and its price in time step."""
    if damping is None or damping.ratio == 0.0:
        return None
    if damping.low_passed:
        factor = damping.step_factor
        price = f", low-passed at {damping.corner:g} Hz, leaves {factor:.2f} of the step."
    else:
        share = damping.beta / undamped_dt
        factor = math.hypot(1.0, share) - share
        price = f" cuts the step of {1e3 * undamped_dt:.2g} ms to {factor:.2f} of it."
    ratios = {f: damping.ratio_at(f) for f in (1.0, 2.0, 4.0, 8.0, 20.0)}
    listed = ", ".join(f"{100 * r:.2f} % at {f:g} Hz" for f, r in ratios.items())
    return Finding(
        "D16",
        "Rayleigh damping holds at one frequency and costs time steps",
        f"{f'In {group!r} ' if group else ''}{listed}; rock damps nearly alike at all frequencies. "
        f"Its stiffness part{price}",
        numbers={"factor": factor} | {f"ratio_{f:g}": r for f, r in ratios.items()},
    )


def infill_as_layer(name, joint, thicknesses):
    """D18: what the stiffness of a fault says about its infill as a layer."""
    kn, ks = joint.properties["kn"], joint.properties["ks"]
    ratio = kn / ks
    poisson = (ratio - 2.0) / (2.0 * (ratio - 1.0)) if ratio > 1.0 else math.nan
    moduli = [(kn * t, ks * t) for t in thicknesses]
    listed = " to ".join(f"{plain_number(m / 1e6)}/{plain_number(g / 1e6)} MPa" for m, g in moduli)
    coherent = 0.0 <= poisson < 0.5
    ranges = infill_stiffness(min(thicknesses), max(thicknesses))
    within = all(low <= k <= high for k, (low, high) in zip((kn, ks), ranges, strict=True))
    published = " and ".join(
        f"{name} {_between(*ends)}" for name, ends in zip(("kn", "ks"), ranges, strict=True)
    )
    return Finding(
        "D18",
        f"The infill of {name} read as a layer",
        f"{' to '.join(f'{100 * t:g} cm' for t in thicknesses)} of infill have M/G = {listed} and, "
        f"from kn/ks = {ratio:.2f}, a Poisson's ratio of {poisson:.2f}: "
        f"{'coherent' if coherent else 'no material behaves so; check kn and ks'}. Published for "
        f"clay of this thickness (Infanti & Kanji 1978): {published} GPa/m, "
        f"{'as here' if within else 'not as here'}.",
        numbers={"poisson": poisson, "published": float(within)}
        | {f"m_{n + 1}": m for n, (m, _) in enumerate(moduli)}
        | {f"g_{n + 1}": g for n, (_, g) in enumerate(moduli)},
    )


def _between(low, high):
    """Describe a range of stiffness in GPa/m."""
    low, high = 1e-9 * low, 1e-9 * high
    if not low > 0.0:
        return f"up to {plain_number(high)}" if math.isfinite(high) else "of any size"
    if not math.isfinite(high):
        return f"above {plain_number(low)}"
    return f"{plain_number(low)} to {plain_number(high)}"


def beyond_memory(needed, free):
    """D30: a run that needs more bytes than the machine has left, and will be refused."""
    if needed <= free:
        return None
    return Finding(
        "D30",
        "The run does not fit into memory",
        f"It needs about {plain_number(needed / 1e9)} GB, the machine has "
        f"{plain_number(free / 1e9)} GB left: take longer edges, fewer receivers or a shorter "
        "run.duration_s.",
        failed=True,
        numbers={"needed": needed, "free": free},
    )


@dataclass(frozen=True)
class MaterialSummary:
    """Summary of one material in the mesh: counts, sizes, implicit zones; SI."""

    name: str
    zones: int
    volume: float
    mass: float
    mean_edge: float
    smallest_quality: float
    highest_frequency: float
    implicit: int


@dataclass(frozen=True)
class ModelSummary:
    """Summary of a model: counts, sizes, time step, and cost of the run; SI.

    Parameters
    ----------
    elements : str
        Kind of zones, and why.
    groups : tuple of MaterialSummary
    zones, nodes, contacts, blocks : int
    removable : int
        Blocks that could move out through the free surface past their joints (Goodman & Shi 1985),
        without regard to friction and weight.
    removable_volume : float, m3
        Of the largest of them.
    dt, undamped_dt : float, s
        Time step, and the critical one without stiffness damping.
    limited_by : str
    joint : str
        The joint that limits the time step, empty where zones do.
    price : float
        Factor on the number of steps by that joint.
    implicit : int
        Zones too small for the time step, which are taken implicitly.
    steps : int
    memory : float, bytes
    seconds : float
        Estimated time of the dynamic stage on the threads of a run.
    """

    elements: str
    groups: tuple[MaterialSummary, ...]
    zones: int
    nodes: int
    contacts: int
    blocks: int
    removable: int
    removable_volume: float
    dt: float
    undamped_dt: float
    limited_by: str
    joint: str
    price: float
    implicit: int
    steps: int
    memory: float
    seconds: float


def summarise_model(project, progress=None) -> ModelSummary:
    """Summarise the model of a project.

    Parameters
    ----------
    project : Project
    progress : callable, optional
        Called with (stage, done, total) during the search for the time step.
    """
    model = project.model
    dt, limit = assembly.time_step(model, progress)
    cost = cost_of(model, project.duration)
    mass = model.zone_values("density") * zone_volumes(model.mesh)
    blocks = count_blocks(model.mesh, ("top", *project.config.boundaries.free))
    return ModelSummary(
        elements=project.meshed.reason,
        groups=_groups(model, mass, limit.implicit.zones),
        zones=len(model.mesh.zones),
        nodes=len(model.nodes.points),
        contacts=0 if model.nodes.contacts is None else len(model.nodes.contacts.area),
        blocks=len(blocks.volumes),
        removable=int(blocks.removable.sum()),
        removable_volume=float(blocks.volumes[blocks.removable].max(initial=0.0)),
        dt=float(dt),
        undamped_dt=limit.undamped,
        limited_by=limit.limited_by,
        joint=limit.joint,
        price=limit.price,
        implicit=int(limit.implicit.zones.sum()),
        steps=int(cost.steps),
        memory=cost.memory,
        seconds=60.0 * cost.minutes,
    )


def _groups(model, mass, implicit):
    """Summarise each material."""
    mesh = model.mesh
    edges, carried = model.mean_edges(), model.highest_frequency()
    worst = quality(mesh)
    summaries = []
    for number, name in enumerate(mesh.groups):
        mine = mesh.zone_group == number
        if mine.any():
            material = model.materials[name]
            summaries.append(
                MaterialSummary(
                    name,
                    int(mine.sum()),
                    float(mass[mine].sum() / material.density),
                    float(mass[mine].sum()),
                    float(edges[name]),
                    float(worst[mine].min()),
                    float(carried[name]),
                    int(implicit[mine].sum()),
                )
            )
    return tuple(summaries)


def frequency_of_edge(speed, edge, edges_per_wavelength=10.0):
    """Return the highest frequency in Hz that zones of an edge in m carry; eq. (1) of the paper."""
    return speed / (edges_per_wavelength * edge)


def boundary_defects(project):
    """Yield findings of viscous sides along a plane wave, viscous faces of jointed rock."""
    if project.input is None:
        return
    model, face = project.model, project.config.input.face
    direction = -_mean_normal(model.mesh, face)
    blind = {*project.config.boundaries.viscous} - {face}
    if project.config.input.enters_as == "plane_wave":
        blind = set()
    sides = [n for n in sorted(blind) if abs(_mean_normal(model.mesh, n) @ direction) < 0.7]
    entry = sum(surface_impedance(model, face).values())
    drag = sum((sum(surface_impedance(model, n).values()) for n in sides), np.zeros((3, 3)))
    path = model.mesh.points @ direction
    for receiver in project.receivers:
        share = (direction @ receiver.position - path.min()) / np.ptp(path)
        transmitted = transmitted_share(entry, drag, share)
        yield dissipating_sides(sides, transmitted, receiver.name, direction[2] > 0.7)
    if project.config.boundaries.jointed_faces:
        return
    stiffness = set_stiffness(project.config.mesh, project.joints, joint_pressures(model))
    for group, material in face_materials(project).items():
        sets = [
            (set_normal(part), *stiffness[part.name], part.spacing_m)
            for part in project.config.mesh.joint_sets if group in (part.regions or [group])
        ]  # fmt: skip
        if sets:
            yield jointed_face(group, material, sets, direction)


def _mean_normal(mesh, surface):
    """Return the mean outward normal (3,) of a surface."""
    _, area, normal = surface_areas(mesh, surface)
    return area @ normal / np.linalg.norm(area @ normal)


def stiff_joint(
    joint: str, stiffness: float, price: float, impedance: float, top: float
) -> Finding | None:
    """D45: a joint so stiff that it sets the time step; None where it costs little.

    Parameters
    ----------
    joint : str
    stiffness : float, Pa/m
        Its largest.
    price : float
        Factor on the number of steps.
    impedance : float, kg/(m2 s)
        Of P waves in the stiffest ground.
    top : float, Hz
        Highest frequency of interest.
    """
    if price < DEAR_JOINT:
        return None
    enough = np.pi * top * impedance / CLOSED
    advice = "take that" if enough < stiffness else "so it is not stiffer than it has to be"
    return Finding(
        "D45",
        "A joint sets the time step",
        f"'{joint}' with {stiffness / 1e9:.3g} GPa/m takes {price:.2g} times as many steps as the "
        f"ground alone; one of {enough / 1e9:.2g} GPa/m delays waves up to {top:.3g} Hz by no more "
        f"than {CLOSED:g} radian: {advice}.",
        numbers={"price": price, "stiffness": stiffness, "enough": enough},
    )


def removable_blocks(count: int, blocks: int, largest: float) -> Finding | None:
    """D48: blocks of a free surface that joints alone hold; None where there is none.

    Parameters
    ----------
    count, blocks : int
        Removable ones, and all.
    largest : float, m3
        Volume of the largest removable one.
    """
    if not count:
        return None
    return Finding(
        "D48",
        "Blocks can leave the free surface",
        f"{count} of {blocks} blocks could move out past their joints (Goodman and Shi, without "
        f"regard to friction and weight), the largest of {plain_number(largest, 3)} m3: joints "
        "alone hold them. Turn the sets or move the face where the rock there has none, or read "
        "their motion as that of loose blocks.",
        numbers={"removable": float(count), "largest": largest},
    )


def near_source(rows, names, obstacle=""):
    """D38: receivers so near to a source that the mesh makes an error; None where there is none.

    Parameters
    ----------
    rows : sequence of NearReceiver
    names : sequence of str
        Of all sources of the model.
    obstacle : str
        Why sources are not injected.
    """
    if not rows:
        return None
    texts = []
    for row in sorted(rows, key=lambda row: -row.error)[:MOST_NAMED]:
        texts.append(
            f"'{row.receiver}' stands {row.distance:.3g} m from {names[row.source]}, "
            f"{row.distance / row.edge:.2g} of the edge of {row.edge:.3g} m there: error up to "
            f"{100 * row.error:.2g} %; edges of {row.edge_needed:.3g} m, {row.work:.2g} times the "
            "work if taken throughout, bring it to about 1 %"
        )
    more = len(rows) - len(texts)
    rest = f"; {more} more" if more > 0 else ""
    untrusted = sum(not row.trusted for row in rows)
    count = (
        f" Above 20 % at {untrusted} of {len(rows)}: these count in no fit." if untrusted else ""
    )
    return Finding(
        "D38",
        "Receivers stand near a source",
        f"{'; '.join(texts)}{rest}. Inside of the sphere of a source motion is too small.{count}"
        + (f" Not injected: {obstacle}." if obstacle else ""),
        numbers={"error": max(row.error for row in rows), "untrusted": float(untrusted)},
    )


def ground_notes(project):
    """Say what the fractures add up to, and how far holes stand behind the faces of benches."""
    notes, blast = [], project.blast
    for part in project.config.mesh.fractures:
        faces = project.mesh.surfaces.get(part.name, np.empty((0, 3), dtype=int))
        area = np.linalg.norm(face_vectors(project.mesh.points, faces), axis=1).sum()
        volume = np.prod(project.config.mesh.size_m)
        drawn = "" if part.file else f", drawn with seed {part.seed}"
        notes.append(
            f"Fractures {part.name}: {area:.4g} m2, P32 {area / volume:.3g} 1/m of the box{drawn}."
        )
    for name in welded_surfaces(project.config.mesh, project.mesh):
        notes.append(f"Surface {name} of the mesh file lies inside: welded, no joint and no side.")
    if project.config.mesh.benches and blast is not None:
        burden = burdens(benches_of(project.config.mesh, project.folder), blast.centres)
        burden = burden[np.isfinite(burden)]
        if len(burden):
            notes.append(
                f"Burden of {len(burden)} of {len(blast.centres)} holes, from the middle of the "
                f"charge to the nearest bench face at its height: {burden.min():.3g} to "
                f"{burden.max():.3g} m."
            )
    return tuple(notes)
