"""Places in the mesh of a project: receivers, sources, absorbing layer, input face."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from ..blasts.blast import Blast
from ..errors import InputError, named_error
from ..inference.nuisances import Firings
from ..mesh.faces import face_vectors, zone_of_face
from ..mesh.hexahedra import face_nodes, face_shapes, face_slopes
from ..mesh.mesh import Mesh, locate_in_zones, surface_faces, surface_zones
from ..model.model import Model, Receiver, SpongeLayer
from ..model.source import AirBlast, Column, Hole, MomentTensor, PointForce, Pressure, TimeFunction
from ..model.thin_layers import nearest_receiver
from ..solver.injection import near_receivers
from ..solver.moment_density import near_sources
from ..sources.shot import Shot

UPRIGHT = 1e-9  # plan area of a face over the square of its width, below which it has no height
NEAR = "it stands near a source, where the mesh makes errors above 20 % (D38)"
KIND_NAMES = {"PointForce": "force", "MomentTensor": "moment tensor"}


def placed(receivers, mesh) -> tuple[Receiver, ...]:
    """Return receivers in a mesh; those without height stand on its surface.

    Raises
    ------
    InputError
        If a receiver lies outside of the mesh.
    """
    standing = []
    for receiver in receivers:
        with named_error(f"receivers.{receiver.name}"):
            standing.append(replace(receiver, position=on_ground(mesh, receiver.position)))
    refuse_outside(mesh, {f"receivers.{receiver.name}": receiver.position for receiver in standing})
    return tuple(standing)


def on_ground(mesh, position) -> tuple[float, float, float]:
    """Return a position (3,) in m, on the surface "top" where no height is given.

    Raises
    ------
    InputError
        If the mesh has no surface "top", or the position lies outside of it.
    """
    if len(position) == 3:
        x, y, z = map(float, position)
        return x, y, z
    if "top" not in mesh.surfaces:
        raise InputError("position_m: needs a height, the mesh has no surface 'top'")
    x, y = map(float, position)
    return x, y, _height(mesh, np.array(position, dtype=float))


def _height(mesh, position):
    """Return the height of the surface "top" at a position (2,), of the crest of upright faces."""
    if mesh.hexahedral:
        return _height_of_hexahedra(mesh, position)
    corners = mesh.points[mesh.surfaces["top"]]
    a, b, c = (corners[:, k, :2] for k in range(3))
    area = _cross(b - a, c - a)
    level = np.abs(area) > 1e-9 * (np.abs(b - a).max(axis=1) + np.abs(c - a).max(axis=1)) ** 2
    corners, a, b, c, area = corners[level], a[level], b[level], c[level], area[level]
    u = _cross(position - a, c - a) / area
    v = _cross(b - a, position - a) / area
    inside = np.flatnonzero((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1.0 + 1e-9))
    if not len(inside):
        raise InputError(
            f"position_m: ({position[0]:g}, {position[1]:g}) m lies outside of the ground"
        )
    shares = np.column_stack([1.0 - u - v, u, v])[inside]
    return float(np.einsum("nk,nk->n", corners[inside, :, 2], shares).max())


def _height_of_hexahedra(mesh, position):
    """Return the height of the surface "top" of hexahedra at a position (2,), of a crest."""
    faces, highest = _faces_of_hexahedra(mesh, "top"), -np.inf
    inside = (position >= faces[:, :, :2].min(axis=1)) & (position <= faces[:, :, :2].max(axis=1))
    for face in faces[inside.all(axis=1)]:
        coordinates = _on_face(face, mesh.order, position)
        if coordinates is not None:
            highest = max(highest, float(face_shapes(mesh.order, coordinates) @ face[:, 2]))
    if np.isfinite(highest):
        return highest
    raise InputError(f"position_m: ({position[0]:g}, {position[1]:g}) m lies outside of the ground")


def _faces_of_hexahedra(mesh, name):
    """Return the nodes (n, (order + 1)^2, 3) in m of the faces of a surface of hexahedra.

    Faces may be any of their zones, and a zone may have two of them.
    """
    zone, local = zone_of_face(mesh.zones, surface_faces(mesh, name))
    nodes = face_nodes(mesh.order)[local].reshape(len(zone), -1)
    return mesh.node_places[zone[:, None], nodes]


def _on_face(face, order, position):
    """Return the reference coordinates (2,) of a position on a face, None if it lies beside it."""
    at = np.zeros(2)
    for _ in range(50):
        slope = face_slopes(order, at).T @ face[:, :2]
        if abs(np.linalg.det(slope)) < UPRIGHT * np.abs(slope).max() ** 2:
            return None
        step = np.linalg.solve(slope.T, position - face_shapes(order, at) @ face[:, :2])
        at = np.clip(at + step, -1.5, 1.5)
        if np.abs(step).max() < 1e-13:
            break
    return at if np.abs(at).max() <= 1.0 + 1e-9 else None


def _cross(a, b):
    """Return the cross product of plane vectors (n, 2)."""
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def refuse_outside(mesh, positions):
    """Refuse positions outside of the mesh.

    Parameters
    ----------
    mesh : Mesh
    positions : dict of str to (3,) float, m
        By the name for the message.

    Raises
    ------
    InputError
        It names the first position.
    """
    if not positions:
        return
    try:
        _locate(mesh, np.reshape(list(positions.values()), (-1, 3)))
    except InputError:
        for name, position in positions.items():
            with named_error(name):
                _refuse_above(mesh, np.asarray(position, dtype=float))
                _locate(mesh, np.reshape(position, (-1, 3)))


def _refuse_above(mesh, position):
    """Refuse a position above the ground, with both heights."""
    try:
        ground = on_ground(mesh, position[:2])[2]
    except InputError:  # outside in plan, or a mesh without a top
        return
    x, y, z = position
    end = np.inf if mesh.layer is None else float(mesh.layer.inner[2][1])
    if end < min(ground, z):
        raise InputError(
            f"lies {z - end:.4g} m above the box: z is {z:g} m, the box ends at {end:.6g} m "
            "below an absorbing layer; give a z within the box, or enlarge it"
        )
    try:
        locate_in_zones(mesh, position[None])
    except InputError:
        if z > ground:
            raise InputError(
                f"lies {z - ground:.4g} m above the ground: z is {z:g} m, the ground at "
                f"({x:g}, {y:g}) m is {ground:.6g} m high; correct z or its datum, or leave z out "
                "to stand on the ground"
            ) from None


def _locate(mesh, positions):
    """Refuse positions (n, 3) outside of a mesh or in its absorbing layer."""
    locate_in_zones(mesh, positions)
    if mesh.layer is None:
        return
    inside = mesh.layer.depths(positions).max(axis=1) > 0.0
    if inside.any():
        x, y, z = positions[inside][0]
        raise InputError(
            f"point ({x:g}, {y:g}, {z:g}): lies in the absorbing layer; enlarge the model"
        )


def axis_limits(rows) -> tuple[tuple[float, float], tuple[float, float], tuple[float, float]]:
    """Return the low and high ends of a box (3, 2) along x, y and z."""
    x, y, z = ((low, high) for low, high in rows)
    return x, y, z


def make_absorbing_layer(config, lowest=None):
    """Return the absorbing layer of a `Config`: given, or the padding around sources, or None.

    ``lowest`` is the lowest frequency in Hz of the sources, absorbed unless another is given.
    """
    if config.absorbing_layer is not None:
        layer = config.absorbing_layer
        return SpongeLayer(axis_limits(layer.box_m), layer.width_m, layer.lowest_hz or lowest)
    mesh = config.mesh
    inside = config.holes_inside or config.point_forces or config.moment_tensors
    if mesh.padding_m is None or not inside:
        return None
    ends = zip(mesh.origin_m, mesh.size_m, strict=True)
    return SpongeLayer(axis_limits((low, low + size) for low, size in ends), mesh.padding_m, lowest)


def extent_of(project) -> np.ndarray:
    """Return the box (3, 2) in m of the ground of a project without padding or absorbing layer."""
    mesh, layer = project.config.mesh, make_absorbing_layer(project.config)
    if layer is not None:
        return np.array(layer.box, dtype=float)
    if mesh.size_m is not None:
        low = np.array(mesh.origin_m)
        return np.column_stack([low, low + mesh.size_m])
    points = project.mesh.points
    return np.column_stack([points.min(axis=0), points.max(axis=0)])


def positions_of(project) -> dict[str, tuple[float, ...]]:
    """Return the positions (2 or 3,) in m of sources and receivers of all blasts, by name."""
    positions = {}
    for each in project.shots:
        config = each.config
        if each.blast is not None and config.holes_inside is not None:
            positions |= hole_positions(each.blast)
        for kind in ("point_forces", "moment_tensors"):
            parts = enumerate(getattr(config, kind), start=1)
            positions |= {f"{kind}[{number}]": part.position_m for number, part in parts}
        positions |= {f"receivers.{part.name}": part.position_m for part in config.receivers}
    given = project.survey.receivers or ()
    return positions | {f"receivers.{each.name}": each.position for each in given}


def survey_positions(project) -> np.ndarray:
    """Return the horizontal positions (n, 2) in m of sources and receivers of all blasts."""
    positions = [receiver.position[:2] for receiver in project.survey.receivers or ()]
    for shot in project.shots:
        config, blast = shot.config, shot.blast
        parts = [*config.receivers, *config.point_forces, *config.moment_tensors]
        positions += [part.position_m[:2] for part in parts]
        if blast is not None and config.holes_inside is not None:
            positions += [*blast.collar[:, :2], *blast.toe[:, :2]]
    return np.array(positions, dtype=float).reshape(-1, 2)


def longest_path(positions: np.ndarray) -> float:
    """Return the diagonal in m of what horizontal positions (n, 2) of a survey span."""
    return float(np.linalg.norm(np.ptp(positions, axis=0))) if len(positions) else 0.0


def clearance_of(project, positions) -> float:
    """Return the least horizontal distance in m of receivers from sources among positions by name.

    Zero where loads on surfaces, of unknown places before there is a mesh, are sources, too.
    """
    if any(shot.config.pressures or shot.config.air_blast for shot in project.shots):
        return 0.0
    received = {name for name in positions if name.startswith("receivers.")}
    starts = [at for name, at in positions.items() if name not in received]
    return nearest_receiver(starts, [positions[name] for name in received])


def radiating_positions(project) -> np.ndarray:
    """Return the positions (n, 3) in m of the sources of a project; none of what enters by a face.

    Pressures stand in the middle of their surfaces, an air blast at its collars.
    """
    config, mesh = project.config, project.mesh
    rows = list(source_positions(project).values())
    for part in config.pressures:
        rows.append(mesh.points[np.unique(mesh.surfaces[part.surface])].mean(axis=0))
    if config.air_blast is not None and not rows:
        rows += list(project.blast.collar)
    return np.array(rows, dtype=float).reshape(-1, 3)


def start_of_waves(project, position) -> np.ndarray:
    """Return the middle (3,) in m of the sources, or where waves to a receiver enter the face."""
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


def carried_frequency(project, mesh) -> float:
    """Return the highest frequency in Hz that a mesh carries in the ground around the holes."""
    model = Model(
        mesh, project.materials, project.joints, quadratic=project.config.mesh.quadratic,
        sponge=None if mesh.hexahedral else make_absorbing_layer(project.config),
    )  # fmt: skip
    _, zone = KDTree(mesh.points[mesh.zones].mean(axis=1)).query(project.blast.centres)
    carried = model.highest_frequency()
    return min(carried[mesh.groups[group]] for group in np.unique(mesh.zone_group[zone]))


def check_absorbing_layer(layer, mesh, positions):
    """Refuse an absorbing layer without zones, or positions (dict of str to (3,) m) inside it.

    Raises
    ------
    InputError
    """
    centres = mesh.points[mesh.zones].mean(axis=1)
    if not layer.alpha(centres, 1.0).any():
        raise InputError(
            "absorbing_layer.box_m: holds the whole ground; leave some of it to the layer"
        )
    for name, position in positions.items():
        if layer.alpha(np.array([position], dtype=float), 1.0).any():
            raise InputError(
                f"{name}: lies in the absorbing layer, which damps motion; move it into the box"
            )


def hole_positions(blast):
    """Return the centres of the charges by the names of their holes."""
    names = (f"blast: hole {name}" for name in blast.hole_ids)
    return dict(zip(names, blast.centres, strict=True))


def resolved_receivers(project, names, injected=True) -> tuple[str, ...]:
    """Return those of named receivers that stand far enough from the sources of a project.

    Parameters
    ----------
    project : Project
    names : sequence of str
    injected : bool
        Whether motion is that of a run, which may inject its sources, or of stored responses.

    Raises
    ------
    InputError
        If there are receivers, and none does.
    """
    rows = near_receivers(project.model) if injected else near_sources(project.model)
    near = {row.receiver: row for row in rows if not row.trusted}
    chosen = tuple(name for name in names if name not in near)
    if names and not chosen:
        row = min((near[name] for name in names), key=lambda row: row.error)
        raise InputError(
            f"{project.path.name}: receivers.{row.receiver}: stands {row.distance:.3g} m from a "
            f"source, and no other farther, where elements of {row.edge:.3g} m make errors up to "
            f"{100 * row.error:.2g} % (D38); give receivers beyond {1.25 * row.edge:.3g} m, or "
            "shorter edges"
        )
    return chosen


def source_names(sources, blast) -> list[str]:
    """Return a name of each source of a model: the hole, or the kind and its number."""
    holes = iter(() if blast is None else np.asarray(blast.hole_ids)[blast.charge != 0.0])
    names, count = [], {}
    for source in sources:
        kind = type(source).__name__
        if kind in ("Hole", "Column"):
            names.append(f"hole {next(holes, len(names) + 1)}")
            continue
        count[kind] = count.get(kind, 0) + 1
        names.append(f"{KIND_NAMES.get(kind, 'source')} {count[kind]}")
    return names


def source_positions(project):
    """Return the positions of all holes, forces and moment tensors inside, by name."""
    config, positions = project.config, {}
    if project.inside.moment_rate is not None:
        positions |= hole_positions(project.blast)
    for number, part in enumerate(config.point_forces, start=1):
        positions[f"point_forces[{number}]"] = on_ground(project.mesh, part.position_m)
    for number, part in enumerate(config.moment_tensors, start=1):
        positions[f"moment_tensors[{number}]"] = part.position_m
    return positions


def place_sources(shot: Shot, mesh: Mesh) -> tuple:
    """Place all sources of a shot in the mesh; their time 0 is its lead before the first firing.

    Raises
    ------
    InputError
        If a source lies outside of the mesh, no hole has a charge, or a surface is unknown.
    """
    sources, inside, config = [], shot.inside, shot.config
    if inside.moment_rate is not None:
        if not shot.blast.charge.any():
            raise InputError("blast: no hole has a charge; give one a charge_kg above 0")
        refuse_outside(mesh, hole_positions(shot.blast))
        if config.holes_inside.detonation_m_per_s:
            sources += _place_columns(shot, mesh)
        else:
            sources += _place_holes(shot)
    sources += _place_forces(shot, mesh)
    sources += _place_tensors(shot, mesh)
    for number, (part, history) in enumerate(zip(config.pressures, inside.pressures, strict=True)):
        _check_surface(f"pressures[{number + 1}]", part.surface, mesh)
        moving = (part.start_m, part.speed_m_per_s) if part.start_m is not None else ()
        sources.append(Pressure(part.surface, _later(history, shot.lead), *moving))
    if inside.air_pulse is not None:
        sources += _place_air(shot, mesh)
    return tuple(sources)


def _later(history, lead):
    """Delay a time function by the lead in s."""
    return replace(history, start=history.start + lead)


def _place_holes(shot):
    """Return the holes of a blast as points, without those that misfire (charge 0)."""
    spread, exponent = shot.config.holes_inside.spread_m, shot.config.blast.charge_exponent
    rate, times = shot.inside.moment_rate, shot.firing.times + shot.lead
    charges = zip(hole_positions(shot.blast).items(), shot.blast.charge, times, strict=True)
    for (name, position), charge, time in charges:
        if charge == 0.0:
            continue
        with named_error(name):
            yield Hole(position, charge, time, rate, exponent, spread)


def _place_columns(shot, mesh):
    """Return the holes that have a charge as columns that detonate from one end."""
    part, exponent = shot.config.holes_inside, shot.config.blast.charge_exponent
    names, ends = list(hole_positions(shot.blast)), shot.blast.columns
    for end in (0, 1):
        refuse_outside(mesh, dict(zip(names, ends[:, end], strict=True)))
    primed, other = (0, 1) if part.primed_at == "collar" else (1, 0)
    times = shot.firing.times + shot.lead
    for name, column, charge, time in zip(names, ends, shot.blast.charge, times, strict=True):
        if charge == 0.0:
            continue
        with named_error(name):
            yield Column(
                column[primed], column[other], charge, time, shot.inside.moment_rate, exponent,
                part.detonation_m_per_s,
            )  # fmt: skip


def _place_forces(shot, mesh):
    """Return the point forces."""
    parts = zip(shot.config.point_forces, shot.inside.forces, strict=True)
    for number, (part, history) in enumerate(parts):
        with named_error(f"point_forces[{number + 1}]"):
            position = np.array(on_ground(mesh, part.position_m))
        refuse_outside(mesh, {f"point_forces[{number + 1}]": position})
        along = np.array(part.direction) / np.linalg.norm(part.direction)
        yield PointForce(position, along, _later(history, shot.lead))


def _place_tensors(shot, mesh):
    """Return the moment tensors."""
    parts = zip(shot.config.moment_tensors, shot.inside.tensors, strict=True)
    for number, (part, history) in enumerate(parts):
        refuse_outside(mesh, {f"moment_tensors[{number + 1}]": np.array(part.position_m)})
        position = np.array(part.position_m)
        yield MomentTensor(position, full_tensor(part.tensor), shot.lead, history, part.spread_m)


def full_tensor(six) -> np.ndarray:
    """Return the symmetric tensor (3, 3) of xx, yy, zz, yz, zx, xy."""
    xx, yy, zz, yz, zx, xy = six
    return np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])


def _place_air(shot, mesh):
    """Return the air blast of every hole, from its collar."""
    part, blast = shot.config.air_blast, shot.blast
    _check_surface("air_blast", part.surface, mesh)
    pulse, scales = shot.inside.air_pulse, blast.firing().scales
    if part.reference_charge_kg is not None:
        with named_error("air_blast"):
            scales = blast.firing(part.reference_charge_kg, part.charge_exponent).scales
    times = shot.firing.times + shot.lead
    for collar, time, scale in zip(blast.collar, times, scales, strict=True):
        if scale == 0.0:
            continue
        history = TimeFunction(scale * pulse.values, pulse.dt, pulse.start)
        yield AirBlast(
            part.surface, collar, history, part.reference_m, part.speed_m_per_s, part.exponent, time
        )


def _check_surface(where, surface, mesh):
    """Refuse an unknown surface, or a joint."""
    joints = () if mesh.contacts is None else mesh.contacts.names
    outer = [name for name in mesh.surfaces if name not in joints]
    if surface not in outer:
        raise InputError(f"{where}.surface: must be one of {', '.join(outer)}, got {surface!r}")


def face_areas(project):
    """Return area in m2 and material of each part of the input face."""
    mesh, face = project.model.mesh, project.config.input.face
    group = mesh.zone_group[surface_zones(mesh, face)]
    area = np.linalg.norm(face_vectors(mesh.points, mesh.surfaces[face]), axis=1)
    return [
        (float(area[group == n].sum()), project.model.materials[mesh.groups[n]])
        for n in np.unique(group)
    ]


def source_material(project):
    """Return name and material that the signature comes through."""
    cavity = project.config.signature.cavity
    if cavity is not None:
        return cavity.material, project.materials[cavity.material]
    present = face_materials(project)
    return max(present.items(), key=lambda item: item[1].density * item[1].cp)


def normal_axis(project):
    """Return the axis along the normal of the input face."""
    mesh = project.mesh
    corners = mesh.points[np.unique(mesh.surfaces[project.config.input.face])]
    return int(np.argmin(np.ptp(corners, axis=0)))


def face_distance(project):
    """Return how far the source is from the input face, and from its foot to the far edge, m.

    The distance is the one of the file, else that from the middle of the first row; None where
    neither is known.
    """
    mesh = project.mesh
    corners = mesh.points[np.unique(mesh.surfaces[project.config.input.face])]
    across = normal_axis(project)
    along = int(np.argmax(np.ptp(corners, axis=0) * [1.0, 1.0, 0.0]))
    distance, middle = project.config.input.distance_m, float(corners[:, along].mean())
    if project.blast is not None:
        first = project.blast.centres[project.blast.times == project.blast.times.min()].mean(axis=0)
        middle = float(first[along])
        if distance is None:
            distance = float(abs(first[across] - corners[:, across].mean()))
    if not distance:
        return None, 0.0
    reach = max(abs(corners[:, along].max() - middle), abs(middle - corners[:, along].min()))
    return distance, float(reach)


def face_materials(project):
    """Return the materials on the input face, dict of str to Material."""
    mesh = project.model.mesh
    numbers = np.unique(mesh.zone_group[surface_zones(mesh, project.config.input.face)])
    return {mesh.groups[n]: project.model.materials[mesh.groups[n]] for n in numbers}


def single_source(config) -> Blast:
    """Return a blast of one hole at time 0 at the mean position of the sources of a `Config`."""
    parts = (*config.point_forces, *config.moment_tensors)
    centre = np.mean(
        [[*p.position_m, 0.0][:3] for p in parts] or [[0.0] * 3], axis=0, keepdims=True
    )
    return Blast("source", centre, centre, np.full(1, np.nan), np.zeros(1))


def blast_table(blast):
    """Return charge, times and holes of a blast; times in s after the first firing."""
    parts = blast.collar, blast.toe, blast.columns, blast.charge, blast.times
    holes = zip(blast.hole_ids, *parts, strict=True)
    known = not np.isnan(blast.charge).any()
    first = float(blast.times.min())
    return {
        "charge": float(blast.charge.sum()) if known else None,
        "charge_per_8ms": blast.charge_per_window() if known else None,
        "last": float(blast.times.max()) - first,
        "holes": [
            {"id": id_, "collar": collar, "toe": toe, "column": column, "charge": charge,
             "time": time - first}
            for id_, collar, toe, column, charge, time in holes
        ],
    }  # fmt: skip


def undamped_plane(project):
    """Return lower left and upper right corner, m, of the ground without padding; None if all."""
    mesh, layer = project.config.mesh, project.absorbing_layer
    if mesh.size_m is not None:
        low = mesh.origin_m[:2]
        return [list(low), [a + b for a, b in zip(low, mesh.size_m[:2], strict=True)]]
    return None if layer is None else [[side[k] for side in layer.box[:2]] for k in (0, 1)]


def house_positions(project):
    """Return the position of each house of [delays] that has one, m."""
    delays = project.config.delays
    houses = [] if delays is None else delays.houses
    return {h.name: h.position_m for h in houses if h.position_m is not None}


def source_tables(project):
    """Return time in s and moment rate in N m/s, force in N or pressure in Pa of all sources."""
    return {
        name: np.column_stack([f.start + f.dt * np.arange(len(f.values)), f.values])
        for name, f in project.inside.named.items()
    }


def firings_of(blast, receivers: Sequence[str]) -> Firings | None:
    """Return the firings of a blast with their travel times; None where nothing fires by hole.

    Holes inside fire at the centre of their moment rate, from which their waves travel.
    """
    config, fired = blast.config, blast.blast
    if fired is None or (config.holes_inside is None and config.signature is None):
        return None
    if config.holes_inside is None:
        firing = blast.firing
        late = np.zeros((len(receivers), len(firing.times)))
        return Firings(firing.times - firing.times.min(), firing.scales, late)
    exponent = 1.0 if config.blast is None else config.blast.charge_exponent
    charge = np.nan_to_num(fired.charge) ** exponent
    speed = min(rock.cs for rock in blast.materials.values())
    known = {receiver.name: np.asarray(receiver.position) for receiver in blast.receivers}
    late = np.zeros((len(receivers), len(charge)))
    for r, name in enumerate(receivers):
        if name in known:
            away = np.linalg.norm(fired.centres - known[name], axis=1)
            late[r] = (away - away.mean()) / speed
    rate = blast.inside.moment_rate
    emitted = 0.0 if rate is None else rate.centre
    return Firings(fired.times - fired.times.min() + emitted, charge, late)
