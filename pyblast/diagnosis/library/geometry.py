"""Geometry that differs from the model: joints of any dip, misplaced faults, benches, suspects."""

import math
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

from ...config.ground import FaultConfig
from ...config.section import with_candidate
from ...ground.tables import is_anisotropic, joint_of_surface, make_joint, make_material
from ...model.joint import Joint
from ...model.material import Material
from ...project.places import survey_positions
from ...simulation.recipe import scaled
from ..hypotheses import hypothesis, remeshable

UPRIGHT = 90.0  # deg
STEEP = 60.0  # deg, dip of candidate planes where no plane is listed
COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
MIDDLE = "middle"
EDGES = 1.5  # candidate planes per shortest S wavelength in the fastest layer
NEAREST = 0.25  # of that spacing, least distance of an unlisted joint from listed parallel ones
PARALLEL = 1e-6  # deg
ALIKE = 0.01  # deg, of an orientation in the name of a plane
APART = 20.0  # deg, of candidate planes from listed ones and from one another
MOST_ORIENTATIONS = 4  # of candidate planes beside listed ones: each costs eight runs
COARSER = 1.5  # edges of tetrahedra across listed planes, over those that a project asks for
SURVEY = 9  # rows of places along a slope, and places of a row
BEYOND = 2.0  # box diagonals that a slope covers on either side
RINGS = np.linspace(0.25, 2.5, 10)  # half widths, of places around a crest
BEARINGS = 16  # of places on a ring


def _as_meshed(project, changed):
    """Return a changed project, to be refused where its mesh needs another kind of zones."""
    return replace(changed, uncut=project.meshed.mesh.hexahedral and not project.meshed.cut)


def _direction(degrees):
    """Return the horizontal unit vector (2,) of a bearing."""
    return np.array([math.sin(math.radians(degrees)), math.cos(math.radians(degrees))])


def _highest(project):
    """Return the highest frequency in Hz that is compared."""
    band = project.config.band_hz
    assert band is not None  # a case has one
    return band[1]


def _top(project):
    """Return the height in m of the flat top of the box."""
    mesh = project.config.mesh
    return mesh.origin_m[2] + mesh.size_m[2]


def _centre(project):
    """Return the horizontal centre (2,) in m of the box."""
    mesh = project.config.mesh
    return np.add(mesh.origin_m[:2], 0.5 * np.array(mesh.size_m[:2]))


def _orientation(part):
    """Return dip and dip direction in deg of a listed plane; of upright ones below 180."""
    turn = 180.0 if part.dip_deg == UPRIGHT else 360.0
    return part.dip_deg, part.dip_direction_deg % turn


def _listed(project):
    """Return the orientations of all faults and joint sets, each once."""
    mesh = project.config.mesh
    return tuple(dict.fromkeys(_orientation(part) for part in (*mesh.faults, *mesh.joint_sets)))


def _along_axes(orientation):
    """Tell whether a plane is upright and along x or y."""
    return orientation[0] == UPRIGHT and orientation[1] % 90.0 == 0.0


def oblique_planes(case) -> str:
    """Require a listed plane that is not upright along x or y."""
    if any(not _along_axes(each) and each[0] > 0.0 for each in _listed(case.project)):
        return ""
    return "no listed fault or joint set dips or is oblique: other forms try all directions"


def _on_top(places, dip, direction, project):
    """Return where planes through places (n, 3) meet the top, in m along the dip direction."""
    slope = 0.0 if dip == UPRIGHT else 1.0 / math.tan(math.radians(dip))
    along = (places[:, :2] - _centre(project)) @ _direction(direction)
    return along + slope * (places[:, 2] - _top(project))


def _candidates(case, orientations):
    """Name candidate planes of orientations, between holes and receivers, away from listed ones."""
    project, names = case.project, []
    fastest = max(project.materials[name].cs for name in project.ground_materials)
    spacing = fastest / (EDGES * case.band.high)
    holes = np.concatenate([blast.centres for blast in project.blasts.values()])
    receivers = np.array([r.position for r in project.receivers if r.name in case.receivers])
    for dip, direction in orientations:
        at = _on_top(np.concatenate([holes, receivers]), dip, direction, project)
        own = [p for p in project.config.mesh.faults if _orientation(p) == (dip, direction)]
        through = np.array([p.through_m for p in own], dtype=float).reshape(-1, 3)
        inner = [*at[: len(holes)], *_on_top(through, dip, direction, project)]
        stops = [at.min(), *sorted(p for p in inner if at.min() < p < at.max()), at.max()]
        names += [
            f"dip {dip:g} to {direction:g} at {position:.1f}"
            for before, after in pairwise(stops)
            for position in between(before, after, spacing)
        ]
    return tuple(names)


def between(before: float, after: float, spacing: float) -> np.ndarray:
    """Return evenly spaced places in a gap, half a spacing from its ends; none if it is narrow.

    Examples
    --------
    >>> between(0.0, 60.0, 20.0).tolist(), between(0.0, 9.0, 20.0).tolist()
    ([20.0, 40.0], [])
    """
    if after - before <= 0.5 * spacing:
        return np.zeros(0)
    span = max(after - before - spacing, 0.0)
    count = max(int(np.ceil(span / spacing)), 1)
    return 0.5 * (before + after - span) + span * (np.arange(count) + 0.5) / count


def parallel_planes(case) -> tuple[str, ...]:
    """Name candidate planes parallel to listed dipping or oblique ones, and upright across them."""
    return _candidates(case, _with_listed(case.project))


def _with_listed(project):
    """Return the orientations of planes that one family of zones fits beside listed ones."""
    orientations = []
    for dip, direction in _listed(project):
        if dip > 0.0 and not _along_axes((dip, direction)):
            orientations += [(dip, direction), (UPRIGHT, (direction + 90.0) % 180.0)]
    return tuple(dict.fromkeys(orientations))


def dipping_planes(case) -> tuple[str, ...]:
    """Name candidate planes that dip in eight directions or are upright along two diagonals.

    Beside listed planes: that dip against and along them, one of each orientation, in the middle.
    """
    listed = _listed(case.project)
    if not listed:
        dipping = [(STEEP, 45.0 * k) for k in range(len(COMPASS))]
        return _candidates(case, [*dipping, (UPRIGHT, 45.0), (UPRIGHT, 135.0)])
    orientations = []
    for turn, (_, direction) in product((180.0, 90.0, 270.0), listed):
        new = STEEP, (direction + turn) % 360.0
        if all(_angle(new, other) > APART for other in (*listed, *orientations)):
            orientations.append(new)
    positions = [_candidates(case, [each]) for each in orientations[:MOST_ORIENTATIONS]]
    return tuple(each[len(each) // 2] for each in positions if each)


def _angle(first, second):
    """Return the angle in deg between planes of two orientations."""
    normals = []
    for dip, direction in (first, second):
        horizontal = math.sin(math.radians(dip)) * _direction(direction)
        normals.append([*horizontal, math.cos(math.radians(dip))])
    return math.degrees(math.acos(min(abs(float(np.dot(*normals))), 1.0)))


def _turned(target, turn, steeper):
    """Return dip, dip direction in deg and the position of a candidate plane."""
    _, dip, _, direction, _, position = target.split()
    dip, direction = float(dip) + math.degrees(steeper), float(direction) + math.degrees(turn)
    if dip > UPRIGHT:
        dip, direction = 2.0 * UPRIGHT - dip, direction + 180.0
    return dip, direction % 360.0, float(position)


def turned_plane(target, offset, turn=0.0, steeper=0.0, **_):
    """Return a candidate plane at fitted values: its position is along the direction of the name.

    Examples
    --------
    >>> turned_plane("dip 60 to 45 at 12.0", -2.5, math.radians(10.0), math.radians(5.0))
    'dipping 65° to 55°, 9.5 m from the centre towards 45°'
    """
    dip, direction, position = _turned(target, turn, steeper)
    return (
        f"dipping {dip:.0f}° to {direction:.0f}°, {position + offset:.1f} m from the centre "
        f"towards {float(target.split()[3]):.0f}°"
    )


def _fault(project, target, offset, turn=0.0, steeper=0.0):
    """Return the `FaultConfig` of a candidate plane; None outside of the box or beside another."""
    dip, direction, position = _turned(target, turn, steeper)
    x, y = _centre(project) + (position + offset) * _direction(float(target.split()[3]))
    mesh = project.config.mesh
    low, high = np.array(mesh.origin_m[:2]), np.add(mesh.origin_m, mesh.size_m)[:2]
    if not (np.all(low < (x, y)) and np.all((x, y) < high)):
        return None
    return FaultConfig(
        name=f"missing {target}", dip_deg=dip, dip_direction_deg=direction,
        through_m=[float(x), float(y), _top(project)],
    )  # fmt: skip


def _apart(project, fault):
    """Tell whether a plane keeps its distance from listed parallel ones."""
    fastest = max(project.materials[name].cs for name in project.ground_materials)
    least = NEAREST * fastest / (EDGES * _highest(project))
    dip, direction = _orientation(fault)
    along = _direction(direction)
    for other in project.config.mesh.faults:
        turned = np.subtract(_orientation(other), (dip, direction))
        gap = np.subtract(other.through_m[:2], fault.through_m[:2]) @ along
        slope = 0.0 if dip == UPRIGHT else 1.0 / math.tan(math.radians(dip))
        gap += slope * (other.through_m[2] - fault.through_m[2])
        if np.all(np.abs(turned) < PARALLEL) and abs(gap) < least:
            return False
    return True


def _with_joint(project, target, kn, ks, **where):
    """Return a project with one more joint on a candidate plane; None if it can't be meshed."""
    fault = _fault(project, target, **where)
    if fault is None or not _apart(project, fault):
        return None
    joint = Joint(fault.name, "elastic", {"kn": kn, "ks": ks})
    return _cut(project, target, fault, (*project.joints, joint))


def _cut(project, target, fault, joints):
    """Return a project whose zones end on one more fault; None if it can't be meshed.

    Hexahedra fit one family of planes: where the target is across listed ones, zones become
    tetrahedra.
    """
    mesh, named = project.config.mesh, _turned(target, 0.0, 0.0)[:2]
    family = _with_listed(project)
    across = _listed(project) and all(_angle(named, each) > ALIKE for each in family)
    cut = mesh.model_copy(update={"faults": [*mesh.faults, fault]})
    if not (across and project.meshed.mesh.hexahedral):
        return _as_meshed(project, project.changed(mesh=cut, joints=joints))
    return project.changed(mesh=scaled(cut, COARSER, kind="tetrahedra"), joints=joints)


def cut_there(project, target, **_):
    """Return the mesh control of a missing joint: zones that end on its plane, as it is named."""
    fault = _fault(project, target, 0.0)
    return (fault and _cut(project, target, fault, project.joints)) or project


BOTH_SIDES = "receivers close to the plane on both sides, or a blast on its other side"


@hypothesis(
    "missing_joint",
    form="parallel",
    family="path",
    on="site",
    target="plane",
    targets=parallel_planes,
    axis="both",
    decided_by=BOTH_SIDES,
    described=turned_plane,
    mesh_control=cut_there,
    simulated=(remeshable, oblique_planes),
)
def parallel_joint(project, target, offset, kn, ks):
    """A joint that the model does not list lies parallel to a listed plane, or across it."""
    return _with_joint(project, target, kn, ks, offset=offset)


@hypothesis(
    "missing_joint",
    form="dipping",
    family="path",
    on="site",
    target="plane",
    targets=dipping_planes,
    axis="both",
    decided_by=BOTH_SIDES,
    described=turned_plane,
    mesh_control=cut_there,
    simulated=(remeshable,),
)
def dipping_joint(project, target, offset, turn, steeper, kn, ks):
    """A joint that the model does not list, of any strike and dip, crosses the ground."""
    return _with_joint(project, target, kn, ks, offset=offset, turn=turn, steeper=steeper)


def families(case) -> tuple[str, ...]:
    """Name the faults that share an orientation, together."""
    parallel = {}
    for fault in case.project.config.mesh.faults:
        parallel.setdefault(_orientation(fault), []).append(fault.name)
    return tuple(", ".join(names) for names in parallel.values())


def faults_of_families(case) -> tuple[str, ...]:
    """Name the faults that are parallel to another, each on its own."""
    together = [family.split(", ") for family in families(case)]
    return tuple(name for family in together if len(family) > 1 for name in family)


def _moved(project, target, dip, turn, shift):
    """Return a project whose faults of some names are turned and shifted; None if impossible."""
    mesh, names, faults = project.config.mesh, target.split(", "), []
    for fault in mesh.faults:
        if fault.name in names:
            steeper = fault.dip_deg + math.degrees(dip)
            if not 0.0 < steeper <= UPRIGHT:
                return None
            x, y = np.add(fault.through_m[:2], shift * _direction(fault.dip_direction_deg))
            bearing = (fault.dip_direction_deg + math.degrees(turn)) % 360.0
            through = [float(x), float(y), fault.through_m[2]]
            changed = {"dip_deg": steeper, "dip_direction_deg": bearing, "through_m": through}
            fault = fault.model_copy(update=changed)
        faults.append(fault)
    return _as_meshed(project, project.changed(mesh=mesh.model_copy(update={"faults": faults})))


SURVEYED = "a borehole through the fault, or its outcrop surveyed again"


@hypothesis(
    "wrong_geometry",
    family="path",
    on="site",
    target="fault",
    targets=families,
    axis="both",
    decided_by=SURVEYED,
    odd=True,
    simulated=(remeshable,),
)
def wrong_geometry(project, target, dip, turn, shift):
    """This fault, with those parallel to it, has another dip, direction or place than listed."""
    return _moved(project, target, dip, turn, shift)


@hypothesis(
    "wrong_geometry",
    form="place",
    family="path",
    on="site",
    target="fault",
    targets=faults_of_families,
    axis="both",
    decided_by=SURVEYED,
    odd=True,
    simulated=(remeshable,),
)
def misplaced_fault(project, target, shift):
    """One of several parallel faults is elsewhere than listed."""
    return _moved(project, target, 0.0, 0.0, shift)


def endless_faults(case) -> tuple[str, ...]:
    """Name the faults with joints that cross the whole ground."""
    project = case.project
    jointed = {joint.surface for joint in project.joints}
    return tuple(
        part.name
        for part in project.config.mesh.faults
        if part.radius_m is part.extent_m is None and part.dip_deg > 0.0 and part.name in jointed
    )


@hypothesis(
    "partial_joint",
    family="path",
    on="site",
    target="fault",
    targets=endless_faults,
    axis="both",
    decided_by="a borehole through the fault at depth",
    simulated=(remeshable,),
)
def partial_joint(project, target, depth):
    """This fault ends at a depth: the rock is whole below it."""
    mesh, faults = project.config.mesh, []
    if depth >= mesh.size_m[2]:
        return project
    for fault in mesh.faults:
        if fault.name == target:
            dip, rise = math.radians(fault.dip_deg), _top(project) - fault.through_m[2]
            x, y = fault.through_m[:2] - rise / math.tan(dip) * _direction(fault.dip_direction_deg)
            along = 2.0 * BEYOND * math.hypot(*mesh.size_m[:2]) + 4.0 * (mesh.padding_m or 0.0)
            limits = {"through_m": [float(x), float(y), _top(project)],
                      "extent_m": [along, 2.0 * depth / math.sin(dip)]}  # fmt: skip
            fault = fault.model_copy(update=limits)
        faults.append(fault)
    return _as_meshed(project, project.changed(mesh=mesh.model_copy(update={"faults": faults})))


def sampled_top(case) -> str:
    """Require a top that is flat or surveyed by places, on which a slope can be added."""
    surface = case.project.ground.surface
    if surface is not None and surface.ndim == 3:
        return (
            "the ground is given as triangles or benches: give another one in "
            "[[diagnosis.candidates]]"
        )
    return ""


def directions(case) -> tuple[str, ...]:
    """Name the directions into which a slope may rise or fall."""
    del case
    return COMPASS


@hypothesis(
    "topography",
    family="path",
    on="site",
    target="direction",
    targets=directions,
    axis="both",
    decided_by="a survey of the ground surface",
    odd=True,
    further=(("position", (-40.0, -20.0, 20.0, 40.0)),),
    simulated=(remeshable, sampled_top),
)
def slope(project, target, height, position, width, turn):
    """A bench or slope is left out: the ground beyond it, in this direction, is higher or lower."""
    along = _direction(45.0 * COMPASS.index(target) + math.degrees(turn))
    across = np.array([-along[1], along[0]])
    reach = BEYOND * math.hypot(*project.config.mesh.size_m[:2])
    edges = position + width * np.linspace(-0.5, 0.5, SURVEY)
    rows = np.array([-reach, *edges, reach])
    sides = np.linspace(-reach, reach, SURVEY)
    middle = survey_positions(project).mean(axis=0)
    plan = [middle + row * along + side * across for row in rows for side in sides]

    def rise(places):
        beyond = (places - middle) @ along - position
        return height * np.clip(beyond / width + 0.5, 0.0, 1.0)

    return _raised(project, plan, rise)


def crests(case) -> tuple[str, ...]:
    """Name the places of a crest: the middle of holes and receivers, and halfway to their edge."""
    del case
    return MIDDLE, *COMPASS


@hypothesis(
    "topography",
    form="hill",
    family="path",
    on="site",
    target="place",
    targets=crests,
    axis="both",
    decided_by="a survey of the ground surface",
    odd=True,
    further=(("width", (12.0, 40.0)), ("turn", (-0.8, 0.8, 1.57))),
    simulated=(remeshable, sampled_top),
)
def hill(project, target, height, east, north, width, longer, turn):
    """A hill, ridge or hollow is left out: the ground rises or falls to a crest on all sides."""
    places = survey_positions(project)
    crest = places.mean(axis=0) + np.array([east, north])
    if target != MIDDLE:
        crest = crest + 0.25 * np.ptp(places, axis=0) * _towards(target)
    along = _direction(math.degrees(turn))
    axes = np.array([along / (longer * width), np.array([-along[1], along[0]]) / width])
    reach = BEYOND * math.hypot(*project.config.mesh.size_m[:2])
    bearings = np.radians(np.linspace(0.0, 360.0, BEARINGS, endpoint=False))
    circle = np.column_stack([np.cos(bearings), np.sin(bearings)])
    rings = [crest + radius * circle @ np.linalg.inv(axes).T for radius in RINGS]
    sides = np.linspace(-reach, reach, SURVEY)
    plan = np.vstack([crest, *rings, crest + np.array(list(product(sides, sides)))])

    def rise(places):
        away = np.sum(((places - crest) @ axes.T) ** 2, axis=1)
        return height * np.where(away < RINGS[-1] ** 2, 0.5**away, 0.0)

    return _raised(project, plan, rise)


def _towards(target):
    """Return the step (2,) from the middle of a square to an edge or a corner of it."""
    return np.round(_direction(45.0 * COMPASS.index(target)))


def _raised(project, plan, rise):
    """Return a project whose surface is higher by ``rise(places)``; a plan (n, 2) is sampled."""
    survey = project.ground.surface
    places = np.column_stack([plan, np.full(len(plan), _top(project))])
    if survey is not None:
        places = np.vstack([np.column_stack([plan, _draped(survey, plan)]), survey])
    places[:, 2] += rise(places[:, :2])
    return _as_meshed(project, project.changed(surface=places))


def _draped(survey, plan):
    """Return the heights (n,) of a survey (m, 3) at places (n, 2); beyond it, of its nearest."""
    inside = LinearNDInterpolator(survey[:, :2], survey[:, 2])(plan)
    return np.where(
        np.isnan(inside), NearestNDInterpolator(survey[:, :2], survey[:, 2])(plan), inside
    )


def isotropic_materials(case) -> tuple[str, ...]:
    """Name the materials of the ground whose two speeds may change."""
    project = case.project
    isotropic = not is_anisotropic(project.materials)
    return tuple(project.ground_materials) if isotropic else ()


@hypothesis(
    "rock_speed",
    family="path",
    on="site",
    target="material",
    targets=isotropic_materials,
    axis="both",
    decided_by="a hammer test or a crosshole survey in this material",
)
def rock_speed(project, target, p, s):
    """The wave speeds of this material are off by more than their prior allows."""
    rock = project.materials[target]
    if not rock.cp * p > math.sqrt(4.0 / 3.0) * rock.cs * s:
        return None
    moduli = Material.from_speeds(rock.density, rock.cp * p, rock.cs * s)
    faster = _with_moduli(rock, moduli)
    return project.changed(materials={**project.materials, target: faster})


def _with_moduli(rock, moduli):
    """Return a material with the moduli of another."""
    return replace(rock, bulk=moduli.bulk, shear=moduli.shear)


def named_candidates(case) -> str:
    """Require candidates in the project file."""
    return "" if suspects(case) else "the project file has no [[diagnosis.candidates]]: add some"


def suspects(case) -> tuple[str, ...]:
    """Name the candidates of the project file."""
    table = case.project.config.diagnosis
    return () if table is None else tuple(each.name for each in table.candidates)


@hypothesis(
    "candidate",
    family="path",
    on="site",
    target="candidate",
    targets=suspects,
    axis="both",
    parameters=[],
    decided_by="a survey of what this candidate changes",
    simulated=(named_candidates, remeshable),
)
def candidate(project, target):
    """The ground is as this candidate of the project file says."""
    given = next(each for each in project.config.diagnosis.candidates if each.name == target)
    config = with_candidate(project.config, given)
    materials = {name: make_material(config.materials[name]) for name in given.materials}
    known, joints = {joint.surface: joint for joint in project.joints}, []
    for surface, entry in joint_of_surface(config.mesh).items():
        if entry in given.joints or surface not in known:
            where = f"diagnosis.candidates.{target}.joints.{entry}"
            known[surface] = make_joint(where, surface, config.joints[entry])
        joints.append(known[surface])
    materials = {**project.materials, **materials}
    changed = project.changed(
        materials=materials, joints=joints, mesh=config.mesh, ground=config.ground,
        boundaries=config.boundaries,
    )  # fmt: skip
    return changed.changed(mesh=changed.for_band(_highest(project)))
