"""Ground that is elastic in a run: around sources of given moment, soil at strain."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from ..core import JOINT_LAWS
from ..errors import Finding, InputError
from ..mesh.mesh import locate_in_zones, zone_edge_lengths
from ..model.ground_fields import elastic_radius, near_groups, near_joints
from ..model.material import Damping, Elastic
from ..model.model import Model
from ..model.source import Column, Hole, MomentTensor
from ..signals.seismogram import Seismogram
from ..solver.initial_stress import insitu_stress, joint_pressures
from ..units import plain_number

SUFFIX = " (elastic)"
INSTANTS = 2000  # of the sum of moments
ALWAYS_ELASTIC = Damping(0.0, 1.0)
HALF_WAY = 0.5
SOFT = 800.0  # m/s: S speed below which ground is soil, EN 1998-1 table 3.1
ELASTIC_STRAIN = 1e-4  # shear strain up to which soil is elastic; Vucetic (1994)


@dataclass(frozen=True, eq=False)
class ElasticGround:
    """Ground that stays elastic around the sources of a model.

    Parameters
    ----------
    ends : (n, 2, 3) float64, m
        Of each source, equal for points.
    radius : (n,) float64, m
    """

    ends: np.ndarray
    radius: np.ndarray

    def beyond(self, places: np.ndarray) -> np.ndarray:
        """Return how far beyond this ground places (n, 3) lie, in m; negative inside."""
        places = np.atleast_2d(np.asarray(places, dtype=float))
        nearest = np.full(len(places), np.inf)
        for (start, end), radius in zip(self.ends, self.radius, strict=True):
            along = end - start
            square = float(along @ along)
            share = np.clip((places - start) @ along / square, 0.0, 1.0) if square > 0.0 else 0.0
            foot = start + np.multiply.outer(share, along)
            nearest = np.minimum(nearest, np.linalg.norm(places - foot, axis=1) - radius)
        return nearest


def elastic_ground(model: Model, stated: float | None = None) -> ElasticGround | None:
    """Return the ground of a model that has to stay elastic around its sources.

    Parameters
    ----------
    model : Model
    stated : float, m, optional
        Its radius in place of that of the closed form.

    Returns
    -------
    ElasticGround or None
        None where neither ground nor joints can yield, or no source has a moment.

    Notes
    -----
    The yield law sees the stress of the strain, to which the moment of a source adds what it holds
    against: without elastic ground around it a source pulls its zones onto the tension cut-off and
    its moment acts as a dead load without bounds. The radius is that of `elastic_radius`, for the
    largest sum over time of the moments of sources whose elastic grounds touch.
    """
    sources = [s for s in model.sources if isinstance(s, (Hole, Column, MomentTensor))]
    yields = any(material.yields for material in model.materials.values())
    slips = not all(JOINT_LAWS[joint.law].linear for joint in model.joints)
    if not sources or not (yields or slips):
        return None
    ends = np.array([_ends(source) for source in sources])
    middles = ends.mean(axis=1)
    zone, _ = locate_in_zones(model.mesh, middles)
    if stated is not None:
        centres = model.mesh.points[model.mesh.zones[zone]].mean(axis=1)
        least = float(np.linalg.norm(centres - middles, axis=1).max())
        if stated < least:
            raise InputError(
                f"holes_inside.core_m: must hold the zones of all holes, at least {least:.3g} m, "
                f"got {stated:g}; a moment in ground that yields is a load without bounds"
            )
        return ElasticGround(ends, np.full(len(ends), stated))
    names = [model.mesh.groups[group] for group in model.mesh.zone_group[zone]]
    materials = [model.materials[name.removesuffix(SUFFIX)] for name in names]
    strengths = [_strength(material) for material in materials]
    if not all(np.isfinite(list(strength.values())).all() for strength in strengths):
        return None
    pressure = np.zeros(len(ends))
    if model.insitu is not None:
        pore = model.insitu.pore_pressure(middles[:, 2])
        pressure = -insitu_stress(model, middles)[:, :3].mean(axis=1) - pore
    moments = _moments(sources)

    def radii(most):
        return np.array([
            elastic_radius(size, rock.cs / rock.cp, strength, max(p, 0.0))
            for size, rock, strength, p in zip(most, materials, strengths, pressure, strict=True)
        ])  # fmt: skip

    radius = radii(moments.max(axis=1))
    apart = np.linalg.norm(middles[:, None] - middles, axis=2)
    for _ in range(len(sources)):
        count, part = connected_components(apart <= radius[:, None] + radius, directed=False)
        summed = np.array([moments[part == n].sum(axis=0).max() for n in range(count)])
        grown = np.maximum(radius, radii(summed[part]))
        if np.array_equal(grown, radius):
            break
        radius = grown
    least = zone_edge_lengths(model.mesh)[zone].mean(axis=1)
    spread = [getattr(source, "spread", None) for source in sources]
    acts = least + np.array([e if s is None else s for s, e in zip(spread, least, strict=True)])
    return ElasticGround(ends, np.maximum(radius + least, acts))  # whole zones


def _ends(source):
    """Return both ends (2, 3) of a source."""
    if isinstance(source, Column):
        return source.primed, source.end
    return source.position, source.position


def _moments(sources):
    """Return the largest principal moment of each source at common times, (n, n_times) N m."""
    whole = [source.moment_rate.integral() for source in sources]
    first = [source.time + moment.start for source, moment in zip(sources, whole, strict=True)]
    last = [t + m.dt * len(m.values) for t, m in zip(first, whole, strict=True)]
    times = np.linspace(min(first), max(last), INSTANTS)
    rows = []
    for source, moment in zip(sources, whole, strict=True):
        size = (
            float(np.abs(np.linalg.eigvalsh(source.tensor)).max())
            if isinstance(source, MomentTensor)
            else source.charge**source.exponent
        )
        rows.append(size * np.abs(moment(times - source.time)))
    return np.array(rows)


def _strength(material):
    """Return the strength of a material, of its law or as given for the checks."""
    if material.yields:
        return material.law.properties(material)
    return {name: getattr(material, name) for name in ("cohesion", "friction", "tension")}


def with_elastic_ground(model: Model, ground: ElasticGround | None) -> Model:
    """Return a model whose ground, joints and damping are elastic around the sources."""
    if ground is None:
        return model
    pressures = joint_pressures(model)
    near = ground.beyond(model.mesh.points[model.mesh.zones].mean(axis=1)) <= 0.0
    mesh = near_groups(model.mesh, near, SUFFIX)
    slipping = [joint for joint in model.joints if not JOINT_LAWS[joint.law].linear]
    mesh = near_joints(mesh, ground.beyond, SUFFIX, [joint.surface for joint in slipping])
    materials, damping = dict(model.materials), model.damping
    for name in mesh.groups[len(model.mesh.groups) :]:
        rock = model.materials[name.removesuffix(SUFFIX)]
        materials[name] = replace(rock, law=Elastic()) if rock.yields else rock
    if damping is not None:
        known = damping if isinstance(damping, dict) else dict.fromkeys(model.mesh.groups, damping)
        damping = {name: known.get(name, ALWAYS_ELASTIC) for name in mesh.groups}
    parted = () if mesh.contacts is None else mesh.contacts.names
    joints = list(model.joints)
    for joint in slipping:
        if joint.surface + SUFFIX in parted:
            kn, ks = joint.tangents(pressures[joint.surface])
            joints.append(
                replace(
                    joint, surface=joint.surface + SUFFIX, law="elastic",
                    properties={"kn": kn, "ks": ks},
                )
            )  # fmt: skip
    return replace(
        model, mesh=mesh, materials=materials, damping=damping, joints=tuple(joints), _ordered=False
    )


def elastic_finding(ground: ElasticGround | None, receivers) -> Finding | None:
    """D42: ground that is kept elastic around the sources; None where there is none.

    Parameters
    ----------
    ground : ElasticGround or None
    receivers : sequence of Receiver
        Where it reaches half of the way to one of these, what yields there follows from the level
        and not from the rock.
    """
    if ground is None:
        return None
    radius, reached = float(ground.radius.max()), {}
    for receiver in receivers:
        beyond = float(ground.beyond(np.array([receiver.position]))[0])
        if beyond <= radius:
            reached[receiver.name] = max(beyond, 0.0)
    text = (
        f"Ground and joints within {plain_number(radius)} m of the sources are kept elastic and "
        "undamped: a level holds for motion outside of the ground that the charge itself breaks. "
        "What yields beyond is computed."
    )
    if reached:
        listed = ", ".join(reached)
        text += (
            f" That is more than half of the way to {listed}: what yields there follows from the "
            "level, not from the rock; move the receiver, lower the charge that fires together, or "
            "compare with elastic ground."
        )
    return Finding(
        "D42", "The ground around the sources is kept elastic", text, failed=bool(reached),
        numbers={"radius": radius} | reached,
    )  # fmt: skip


def soil_strain(model: Model, simulated: dict[str, Seismogram]) -> Finding | None:
    """D47: soil that is elastic in a run and strained beyond that; None where there is none.

    Parameters
    ----------
    model : Model
    simulated : dict of str to Seismogram
        By receiver.

    Notes
    -----
    The shear strain of a wave is at most its peak velocity over the S speed; Newmark (1967).
    """
    if not model.receivers:
        return None
    mesh, strained = model.mesh, {}
    zones, _ = locate_in_zones(mesh, np.array([each.position for each in model.receivers]))
    for receiver, number in zip(model.receivers, mesh.zone_group[zones], strict=True):
        soil = model.materials[mesh.groups[number]]
        strain = float(np.linalg.norm(simulated[receiver.name].velocity, axis=1).max()) / soil.cs
        if soil.cs < SOFT and not soil.yields and strain > ELASTIC_STRAIN:
            strained[receiver.name] = strain, mesh.groups[number]
    if not strained:
        return None
    worst = max(strained, key=lambda name: strained[name][0])
    strain, ground = strained[worst]
    return Finding(
        "D47",
        "Soil is strained beyond its elastic range",
        f"At {worst} {ground!r} has a shear strain of up to {strain:.2g}; {len(strained)} "
        f"receivers have more than {ELASTIC_STRAIN:g}: such soil is softer and damps more than in "
        "the run, where it is elastic. Frequencies there are lower, and peaks mostly; lower cs and "
        "qs to what they are at that strain.",
        numbers={"strain": strain, "receivers": float(len(strained))},
    )
