"""The ground of a project in SI units: materials, joints, boundaries, mesh, spatial fields."""

from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from ..core import JOINT_LAWS
from ..errors import InputError, named_error
from ..mesh.builder import Fault, JointSet, Layer, build_mesh, structured_box
from ..mesh.grid import SIDES, Fill, Geometry, upward_normal
from ..mesh.mesh import Mesh, inner_facets, surface_faces
from ..model.anisotropy import HoekBrown, UbiquitousJoints, jointed, transverse
from ..model.boundary import Fixed, FreeField, Roller, Viscous
from ..model.ground_fields import DamagedZone, Gradient, Heterogeneity, damaged_group
from ..model.joint import Joint, saturated
from ..model.material import ConstantQ, Damping, Elastic, Material, MohrCoulomb
from ..model.model import InSitu
from ..units import plain_number, split_key, to_si
from .surface import make_fractures

ORDER_OF_FILES = 4  # of hexahedra that are read


def make_fields(config, blast, mesh) -> tuple:
    """Turn a `GroundConfig` into fields of the ground.

    Parameters
    ----------
    config : GroundConfig
    blast : Blast or None
        Whose holes have damaged the ground.
    mesh : Mesh
        A gradient without a height begins at its highest point.

    Raises
    ------
    InputError
        If no hole comes near enough to damage anything.
    """
    fields = []
    if config.gradient is not None:
        part = config.gradient
        top = mesh.points[:, 2].max() if part.top_m is None else part.top_m
        fields.append(Gradient(part.reduction, part.length_m, float(top)))
    if config.damaged_zone is not None:
        zone = _damaged(config.damaged_zone, blast)
        centres = mesh.points[mesh.zones].mean(axis=1)
        nearest = zone.distance(centres).min()
        if nearest > zone.length:
            raise InputError(
                f"ground.damaged_zone.length_m: the ground begins {nearest:.3g} m from the holes "
                f"and is not damaged, got {zone.length:g} m; are the holes inside the model?"
            )
        fields.append(zone)
    if config.heterogeneity is not None:
        part = config.heterogeneity
        fields.append(Heterogeneity(part.deviation, part.length_m, part.seed, part.hurst))
    return tuple(fields)


def damages_material(config) -> bool:
    """Tell whether the damaged zone of a `GroundConfig` has a material, as no other blast has."""
    return config.damaged_zone is not None and config.damaged_zone.material is not None


def with_damaged_material(config, blast, mesh) -> Mesh:
    """Return a mesh whose zones near the holes have the material of a `DamagedZoneConfig`."""
    if not damages_material(config):
        return mesh
    part = config.damaged_zone
    return damaged_group(mesh, _damaged(part, blast), part.radius_m, part.material)


def _damaged(part, blast):
    """Return the damaged zone around all holes."""
    holes = np.stack([blast.collar, blast.toe], axis=1)
    return DamagedZone(holes, part.reduction, part.length_m)


def make_joint(where, surface, config):
    """Turn a `JointConfig` into the `Joint` of one surface.

    Raises
    ------
    InputError
        If the law is unknown, or a key is unknown, missing, without a unit or out of range.
    """
    if config.law not in JOINT_LAWS:
        raise InputError(f"{where}.law: must be one of {', '.join(JOINT_LAWS)}, got {config.law!r}")
    law = JOINT_LAWS[config.law]
    properties = {}
    for key, value in (config.model_extra or {}).items():
        stem, unit = split_key(key)
        if stem not in law.properties or unit not in law.properties[stem].file_units:
            raise InputError(f"{where}.{key}: unknown key; {_proposal(key, law)}")
        if not law.properties[stem].has_sign(value):
            sign = law.properties[stem].sign
            raise InputError(f"{where}.{key}: {sign}, got {plain_number(value, 6)}")
        with named_error(where):
            properties[stem] = to_si(key, value)[1]
    for name, prop in law.properties.items():
        if name not in properties and prop.default is None:
            raise InputError(f"{where}.{prop.key}: missing; add it")
    pressure = to_si("pressure_kpa", config.insitu_pressure_kpa)[1]
    mass = 0.0
    if config.fill_density_kg_per_m3 is not None:
        mass = config.fill_density_kg_per_m3 * to_si("fill_mm", config.fill_thickness_mm)[1]
    shear = tuple(to_si("shear_kpa", config.insitu_shear_kpa)[1])
    gradient = to_si("gradient_mpa_per_m", config.insitu_gradient_mpa_per_m)[1]
    level = config.insitu_level_m or 0.0
    joint = Joint(surface, config.law, properties, pressure, shear, mass, gradient, level)
    if config.water_aperture_mm is None:
        return joint
    return saturated(joint, to_si("aperture_mm", config.water_aperture_mm)[1])


def _proposal(key, law):
    """Propose a known key of a law."""
    known = {name: prop.key for name, prop in law.properties.items()}
    stems = sorted((name for name in known if key.startswith(f"{name}_")), key=len)
    near = [known[stems[-1]]] if stems else get_close_matches(key, known.values(), n=1)
    return f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known.values())}"


def set_normal(part):
    """Return the unit normal (3,) of a `JointSetConfig`, upward."""
    dip, towards = (to_si(key, getattr(part, key))[1] for key in ("dip_deg", "dip_direction_deg"))
    return upward_normal(dip, towards)


def set_stiffness(config, joints, pressures):
    """Return the tangent stiffness of the joint sets of a `MeshConfig`.

    Parameters
    ----------
    config : MeshConfig
    joints : sequence of Joint
    pressures : dict of str to float, Pa
        Mean normal pressure before the blast, by surface; of `joint_pressures`.

    Returns
    -------
    dict of str to (float, float), Pa/m
        kn and ks by set: tangents under the pressure, over the share of the area that is joint.
    """
    by_surface = {joint.surface: joint for joint in joints}
    return {
        part.name: tuple(
            k / part.persistence for k in by_surface[part.name].tangents(pressures[part.name])
        )
        for part in config.joint_sets
    }


def jointed_media(config, materials, joints, pressures):
    """Return the effective medium for long waves of each layer with joint sets.

    Parameters
    ----------
    config : MeshConfig
    materials : dict of str to Material
    joints, pressures
        As of `set_stiffness`.

    Returns
    -------
    dict of str to Material
        By layer; rock bridges reduce the compliance by their share of the area.
    """
    stiffness, media = set_stiffness(config, joints, pressures), {}
    for part in config.joint_sets:
        for group in part.regions or [layer.material for layer in config.layers]:
            rock = media.get(group, materials[group])
            if rock.law.name != "anisotropic":
                rock = replace(rock, law=Elastic())
            media[group] = jointed(rock, set_normal(part), part.spacing_m, *stiffness[part.name])
    return media


LAWS = ("yielding", "hoek_brown", "ubiquitous", "transverse", "joints")
QUALITY = ("qp", "qs", "quality_band_hz", "quality_reference_hz")
CORNER = 15.0  # of the low-pass over the central frequency: leaves 0.756 of the step at 5 %


def make_material(config):
    """Turn a `MaterialConfig` into a `Material`."""
    given = config.model_dump(exclude={"damping", *LAWS, *QUALITY}, exclude_none=True)
    values = dict(to_si(key, value) for key, value in given.items())
    if config.qp is not None:
        qp, qs, band, reference = (getattr(config, key) for key in QUALITY)
        values["law"] = ConstantQ(qp, qs, tuple(band), reference)
    if config.yielding is not None:
        flow = config.yielding.model_dump(exclude_none=True)
        values["law"] = MohrCoulomb(**dict(to_si(key, value) for key, value in flow.items()))
    if config.hoek_brown is not None:
        values["law"] = _hoek_brown(config.hoek_brown)
    if config.ubiquitous is not None:
        normal, strength = _planes(config.ubiquitous)
        values["law"] = UbiquitousJoints(tuple(normal), **strength)
    material = _elastic(config, values)
    for part in config.joints:
        across, stiffness = _planes(part)
        material = jointed(material, across, **stiffness)
    return material


def _hoek_brown(config):
    """Turn a `HoekBrownConfig` into a law."""
    mass = config.sigci_mpa * 1e6, config.mi, config.gsi, config.disturbance
    rest = config.model_dump(exclude={"sigci_mpa", "mi", "gsi", "disturbance"}, exclude_none=True)
    return HoekBrown.of_rock_mass(*mass, **dict(to_si(k, value) for k, value in rest.items()))


def make_materials(config) -> dict[str, Material]:
    """Turn the materials of a `Config` into `Material`, by name."""
    materials = {}
    for name, part in config.materials.items():
        with named_error(f"materials.{name}"):
            materials[name] = make_material(part)
    return materials


def is_anisotropic(materials: dict[str, Material]) -> bool:
    """Return whether a material is anisotropic."""
    return any(material.law.name == "anisotropic" for material in materials.values())


def quality_of(materials: dict[str, Material]) -> tuple[float, float] | None:
    """Return the first pair Qp, Qs of materials, None where none has one."""
    laws = [material.law for material in materials.values()]
    return next(((law.qp, law.qs) for law in laws if isinstance(law, ConstantQ)), None)


def make_joints(config) -> tuple:
    """Return the `Joint` of each joint surface of a `Config`.

    Raises
    ------
    InputError
        If a surface has no joint, or a joint no surface.
    """
    joints, taken = [], joint_of_surface(config.mesh)
    for surface, name in taken.items():
        if name not in config.joints:
            raise InputError(f"joints.{name}: missing; the joint surface {surface!r} needs it")
        joints.append(make_joint(f"joints.{name}", surface, config.joints[name]))
    for name in config.joints:
        if name not in taken.values():
            raise InputError(f"joints.{name}: no joint set or fault of the mesh takes it")
    return tuple(joints)


def _elastic(config, values):
    """Make a material of one of the four ways to give elastic constants."""
    density = values.pop("density")
    if config.transverse is not None:
        across, moduli = _planes(config.transverse)
        return transverse(density, across, **moduli, **values)
    if "young" in values:
        return Material.from_young_poisson(density, values.pop("young"), **values)
    if "cp" in values:
        return Material.from_speeds(density, values.pop("cp"), values.pop("cs"), **values)
    return Material(density, **values)


def _planes(part):
    """Return the normal of dipping planes and their other values, in SI."""
    values = dict(to_si(key, value) for key, value in part.model_dump().items())
    return upward_normal(values.pop("dip"), values.pop("dip_direction")), values


def make_damping(config):
    """Return the damping of a `Config`: one for all, or by material where materials have their own.

    Returns
    -------
    Damping, dict of str to Damping, or None
    """
    own = {name: part.damping for name, part in config.materials.items()}
    if not any(own.values()):
        return None if config.damping is None else _damping(config.damping)
    return {
        name: Damping(0.0, 1.0) if part is None else _damping(part)
        for name, part in ((name, part or config.damping) for name, part in own.items())
    }


def _damping(part):
    """Turn a `DampingConfig` into a `Damping`, low-passed unless it asks for the lagged form."""
    corner = part.corner_hz or CORNER * part.frequency_hz
    low_pass = None if part.lagged or not part.stiffness else corner
    return Damping(part.ratio, part.frequency_hz, part.mass, part.stiffness, low_pass)


def make_insitu(config):
    """Turn an `InSituConfig` or None into an `InSitu` or None."""
    if config is None:
        return None
    stress = to_si("stress_mpa", config.stress_mpa)[1]
    return InSitu(
        config.gravity_m_per_s2, config.horizontal_ratio, tuple(stress),
        config.water_table_m, config.water_density_kg_per_m3,
    )  # fmt: skip


def make_boundaries(config, face=None, media=None):
    """Turn a `BoundariesConfig` into boundaries.

    Parameters
    ----------
    config : BoundariesConfig
    face : str, optional
        Input face; the literal "viscous and fixed" leaves it free to move.
    media : dict of str to Material, optional
        Of `jointed_media`, for faces with the impedance of jointed rock.
    """
    media = media if config.jointed_faces else None
    boundaries = [Viscous(name, media or {}) for name in (*config.viscous, *config.free_field)]
    boundaries += [FreeField(name) for name in config.free_field]
    boundaries += [Roller(name) for name in config.roller]
    boundaries += [Fixed(name) for name in config.fixed]
    if config.viscous_and_fixed:
        boundaries += [Roller(name) for name in config.viscous if name != face]
    return boundaries


def refuse_open_sides(config, mesh, planes=()):
    """Refuse sides without a condition, which would reflect the waves of holes inside.

    Parameters
    ----------
    config : BoundariesConfig
    mesh : Mesh
        Split; its joints are no sides.
    planes : collection of str
        Names of planes inside, which may be closed.

    Raises
    ------
    InputError
    """
    named = {
        *config.viscous,
        *config.free_field,
        *config.roller,
        *config.fixed,
        *config.free,
        "top",
    }
    inside = {*planes, *(() if mesh.contacts is None else mesh.contacts.names)}
    closed = [surface_faces(mesh, name) for name in mesh.surfaces if name in named]
    closed = np.concatenate([np.empty(0, dtype=int), *closed])
    for surface in mesh.surfaces:
        if surface in named or surface in inside:
            continue
        outer = surface_faces(mesh, surface)[~inner_facets(mesh, surface)[0]]
        if not np.isin(outer, closed).all():
            raise InputError(
                f"boundaries.viscous: lacks {surface!r}; the waves of holes inside the model must "
                "leave through viscous sides (or name the side in another list)"
            )


def refuse_unknown_sides(where, names, mesh):
    """Refuse names that no outer surface of a mesh has."""
    joints = () if mesh.contacts is None else mesh.contacts.names
    outer = [name for name in mesh.surfaces if name not in joints]
    for name in names:
        if name not in outer:
            raise InputError(f"{where}: no surface {name!r}; there are {', '.join(outer)}")


def joint_of_surface(config):
    """Return which entry of ``[joints]`` each joint surface of a `MeshConfig` takes."""
    if config.file is not None:
        return dict(config.file_joints)
    parts = (*config.joint_sets, *config.faults, *config.fractures)
    return {part.name: part.joint or part.name for part in parts}


def mean_edge(config, layer, material):
    """Return the edge length of a layer in m, given or from edges per wavelength, else None."""
    if layer.edge_m is not None:
        return layer.edge_m
    per_wavelength = layer.edges_per_wavelength
    if per_wavelength is None and config.edge_m is None:
        per_wavelength = config.edges_per_wavelength
    if per_wavelength is None:
        return config.edge_m
    return material.cs / (per_wavelength * config.frequency_hz)


def make_mesh(config, materials, folder, surface=None, log=None, relief=np.inf) -> Mesh:
    """Build or read the mesh of a project, not yet split.

    Parameters
    ----------
    config : MeshConfig
    materials : dict of str to Material
    folder : Path
        Where files of the project are looked for.
    surface : (n, 3) float64, m, optional
        Surveyed top surface.
    log : ReadLog, optional
        Takes what was read from a mesh file.
    relief : float, m
        Largest distance of the ground from its survey; see `build_mesh`.
    """
    if config.file is not None:
        from ..mesh.importer import read_mesh

        return read_mesh(
            folder / config.file, config.file_groups or None, [*config.file_joints], log,
            order=config.order or ORDER_OF_FILES,
        )  # fmt: skip
    for layer in config.layers:
        if layer.material not in materials:
            raise InputError(
                f"mesh.layers.material: must be one of {', '.join(materials)}, "
                f"got {layer.material!r}"
            )
    layers = [
        Layer(part.material, part.thickness_m, mean_edge(config, part, materials[part.material]))
        for part in config.layers
    ]
    if config.grid_cells is not None:
        return _grid(config, layers, surface)
    return _jointed_rock(config, layers, surface, make_fractures(config, folder), relief)


def _grid(config, layers, surface):
    """Cut a regular grid; faults must lie on its planes."""
    if config.joint_sets or config.fractures or config.refinements or surface is not None:
        raise InputError(
            "mesh.grid_cells: a regular grid takes faults only, no joint_sets, fractures, "
            "refinements, surface_file or benches"
        )
    planes = {}
    for fault in config.faults:
        axis = _axis_of(fault)
        position = fault.through_m["xyz".index(axis)] - config.origin_m["xyz".index(axis)]
        planes[fault.name] = (axis, position)
    mesh = structured_box(config.grid_cells, config.size_m, layers=layers, planes=planes)
    return Mesh(
        mesh.points + config.origin_m, mesh.zones, mesh.zone_group, mesh.groups, mesh.surfaces
    )


def _axis_of(fault):
    """Return the axis that is normal to a plane along a regular grid."""
    if fault.dip_deg == 0.0:
        return "z"
    turned = fault.dip_direction_deg % 180.0
    if fault.dip_deg == 90.0 and turned in (0.0, 90.0):
        return "y" if turned == 0.0 else "x"
    raise InputError(
        f"mesh.faults.{fault.name}: on a regular grid dip_deg is 0, or 90 with dip_direction_deg "
        f"0 or 90, got {fault.dip_deg:g} and {fault.dip_direction_deg:g}; give edge_m instead of "
        "grid_cells"
    )


def _jointed_rock(config, layers, surface, fractures, relief):
    """Build jointed rock through gmsh."""
    low, size = np.array(config.origin_m), np.array(config.size_m)
    sets, faults = joints_and_faults(config)
    padding = None
    if config.padding_m is not None:
        padding = config.padding_m, config.padding_edge_m
    with named_error("mesh"):
        return build_mesh(
            np.column_stack([low, low + size]), layers, sets, [*faults, *fractures],
            edge=config.edge_m,
            surface=surface, padding=padding, tolerance=config.tolerance_m, seed=config.seed,
            refinements=[(part.box_m, part.edge_m) for part in config.refinements],
            relief=relief,
        )  # fmt: skip


def make_geometry(mesh, viscous, surface=None, benches=()) -> Geometry:
    """Return the geometry of the ground that a `MeshConfig` asks for.

    Parameters
    ----------
    mesh : MeshConfig
    viscous : set of str
        Sides through which waves leave.
    surface : (n, 3) or (n, 3, 3) float64, m, optional
        Top surface.
    benches : sequence of Bench, optional
        Whose triangles it is.
    """
    low = np.array(mesh.origin_m, dtype=float)
    sets, faults = joints_and_faults(mesh)
    with named_error("mesh"):
        return Geometry(
            np.column_stack([low, low + mesh.size_m]),
            tuple(
                Layer(part.material, part.thickness_m, follows_surface=part.follows_surface)
                for part in mesh.layers
            ),
            tuple(sets),
            tuple(faults),
            surface,
            standing=frozenset(SIDES) - viscous,
            benches=tuple((bench.crest, bench.toe) for bench in benches),
            fills=tuple(Fill(part.material, np.array(part.box_m, float)) for part in mesh.fills),
        )


def joints_and_faults(config):
    """Return the `JointSet` and `Fault` lists of a `MeshConfig`."""
    sets = [
        JointSet(
            part.name, *_angles(part), part.spacing_m,
            origin=None if part.origin_m is None else tuple(part.origin_m),
            regions=tuple(part.regions) or None, persistence=part.persistence,
        )
        for part in config.joint_sets
    ]  # fmt: skip
    faults = [
        Fault(
            part.name, *_angles(part), tuple(part.through_m), radius=part.radius_m,
            extent=None if part.extent_m is None else tuple(part.extent_m),
        )
        for part in config.faults
    ]  # fmt: skip
    return sets, faults


def _angles(part):
    """Return dip and dip direction in rad."""
    return to_si("dip_deg", part.dip_deg)[1], to_si("direction_deg", part.dip_direction_deg)[1]
