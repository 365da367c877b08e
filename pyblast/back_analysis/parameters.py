"""Parameters of a back-analysis: keys of a project file with ranges, and what is held beside."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..config.config import BackAnalysisConfig, required_table
from ..config.section import check_path, value_at
from ..errors import Finding, InputError, named_error
from ..ground.tables import joint_of_surface
from ..inference.parameter import OTHER, SPEED, STIFFNESS, Parameter, kind_of_key
from ..model.material import Material
from ..project.checks import carried_band
from ..project.places import NEAR, resolved_receivers
from ..project.project import CHEAP, Project, load_project, vary
from ..signals.seismogram import Seismogram
from ..solver.assembly import time_step
from ..solver.run import run_many
from ..units import split_key

# Larger values of these keys never allow a longer time step, and no other cheap key affects it.
STIFFENING = {"kn", "ks", "cohesion", "friction", "tension", "ratio"}
LEAST_STEP = 0.5  # of a common time step, as a share of the longest one in the ranges


def table_of(project: Project) -> tuple[BackAnalysisConfig, str]:
    """Return table ``[back_analysis]`` of a project, and its place for messages.

    Raises
    ------
    InputError
        If it is missing.
    """
    table = required_table(project.config, "back_analysis", project.path)
    return table, f"{project.path.name}: back_analysis"


def all_blasts(project: Project) -> tuple[Project, ...]:
    """Return the blasts of a back-analysis, recorded or planned: a project and those it names.

    Raises
    ------
    InputError
        If a blast is named twice.
    """
    table, where = table_of(project)
    blasts = (project, *(load_project(project.folder / name) for name in table.blasts))
    blasts = tuple(blast.with_low_pass for blast in blasts)
    names = [blast.path.name for blast in blasts]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{where}.blasts: {name!r} is named twice")
    return blasts


def candidate_blasts(project: Project) -> tuple[Project, ...]:
    """Return the candidate blasts: those that could be fired and recorded too."""
    names = table_of(project)[0].candidate_blasts
    return tuple(load_project(project.folder / name) for name in names)


def survey_records(blast: Project, project: Project) -> dict[str, Seismogram | None]:
    """Return the records of a blast in a survey by receiver, None where a record is only planned.

    Receivers are those of back_analysis.receivers, else those with a record, else all, without
    those that stand near a source (D38).

    Raises
    ------
    InputError
        If there is no such receiver.
    """
    known = [receiver.name for receiver in blast.config.receivers]
    names = table_of(project)[0].receivers or list(blast.recorded) or known
    for name in names:
        if name not in known:
            raise InputError(
                f"{project.path.name}: back_analysis.receivers: {blast.path.name} has no receiver "
                f"{name!r}; it has {', '.join(known) or 'none'}"
            )
    if not names:
        raise InputError(f"{blast.path.name}: receivers: missing; a survey needs at least one")
    compared, far = blast.comparable, resolved_receivers(blast, names)
    return {name: compared[name].seismogram if name in compared else None for name in far}


def blasts_of(project: Project) -> tuple[Project, ...]:
    """Return the recorded blasts of a back-analysis.

    Raises
    ------
    InputError
        If a blast is named twice, has no record, or lacks that of a receiver in the table.
    """
    table, where = table_of(project)
    blasts = all_blasts(project)
    for blast in blasts:
        for name in table.receivers:
            if name not in blast.recorded:
                known = ", ".join(blast.recorded) or "none"
                raise InputError(
                    f"{where}.receivers: {name!r} has no record in {blast.path.name}; with a "
                    f"record are {known}"
                )
        if not blast.recorded:
            raise InputError(
                f"{blast.path.name}: receivers: none has a record to fit; add "
                "[receivers.recorded], or use backanalyse --design-survey, which needs none"
            )
    return blasts


def fitted_blasts(project: Project) -> tuple[tuple[Project, ...], Finding | None]:
    """Return the recorded blasts in the band that their meshes carry, and D40 where it is less.

    Raises
    ------
    InputError
        As `blasts_of`, and if the meshes carry nothing of the band.
    """
    blasts = blasts_of(project)
    asked = table_of(project)[0].receivers
    names = {name for blast in blasts for name in chosen_records(blast, asked)}
    band, finding = carried_band(blasts, blasts[0].compared_band, sorted(names))
    if finding is None:
        return blasts, None
    return tuple(blast.compared_in(band) for blast in blasts), finding


def chosen_records(blast: Project, names: Sequence[str]) -> dict[str, Seismogram]:
    """Return the records of a blast that a back-analysis uses, low-passed like what enters.

    See `left_out`.
    """
    unused = left_out([blast], names)
    return {
        name: record.seismogram for name, record in blast.comparable.items()
        if (blast.name, name) not in unused
    }  # fmt: skip


def left_out(blasts: Sequence[Project], names: Sequence[str]) -> dict[tuple[str, str], str]:
    """Return why records are not used, by blast and receiver: not named, or near a source (D38).

    Parameters
    ----------
    blasts : sequence of Project
    names : sequence of str
        Receivers whose records are used; all if empty.
    """
    unused = {}
    for blast in blasts:
        asked = tuple(name for name in blast.recorded if not names or name in names)
        far = resolved_receivers(blast, asked)
        unused |= {
            (blast.name, name): NEAR if name in asked else "back_analysis.receivers lacks it"
            for name in blast.recorded if name not in far
        }  # fmt: skip
    return unused


def is_cheap(parameter: Parameter) -> bool:
    """Tell whether a change leaves mesh and ground unchanged, so that runs can form a batch."""
    return parameter.name.split(".")[0] in CHEAP


def range_of(parameter: Parameter) -> dict:
    """Return a parameter as in result files: key, range, scale, laboratory range."""
    return {
        "path": parameter.name, "low": parameter.low, "high": parameter.high,
        "log": parameter.log, "laboratory": parameter.laboratory,
    }  # fmt: skip


def parameters_of(project: Project) -> tuple[Parameter, ...]:
    """Return the parameters of table ``[back_analysis]`` of a project.

    Raises
    ------
    InputError
        If the table is missing, or a range is not valid.
    """
    table, where = table_of(project)
    with named_error(where):
        return tuple(
            Parameter(
                row.path,
                row.low,
                row.high,
                row.log,
                laboratory=None
                if row.laboratory is None
                else (row.laboratory[0], row.laboratory[1]),
            )
            for row in table.parameters
        )


def check_parameters(project: Project, parameters: Sequence[Parameter]):
    """Check that a project has the parameters, and that its rules allow their ranges.

    Raises
    ------
    InputError
        With the key.
    """
    if not parameters:
        raise InputError("back_analysis.parameters: missing; name at least one key")
    paths = [parameter.name for parameter in parameters]
    for number, parameter in enumerate(parameters, start=1):
        with named_error(f"{project.path.name}: back_analysis.parameters[{number}].path"):
            check_path(project.config, parameter.name)
        if paths.count(parameter.name) > 1:
            raise InputError(
                f"{project.path.name}: back_analysis.parameters[{number}].path: "
                f"{parameter.name!r} is given twice; keep one"
            )
        for end in ("low", "high"):
            with named_error(f"{project.path.name}: back_analysis.parameters[{number}].{end}"):
                vary(project, {parameter.name: getattr(parameter, end)})


def with_values(project: Project, parameters: Sequence[Parameter], values) -> Project:
    """Return a project with the values (n,) of its parameters."""
    pairs = zip(parameters, np.asarray(values, dtype=np.float64).tolist(), strict=True)
    return vary(project, {parameter.name: value for parameter, value in pairs})


def common_time_step(project: Project, parameters):
    """Return the time step, with its limit, at which all models of the ranges are stable.

    With a common step the result at a point does not depend on the others of its batch. None if
    models differ in more than stiffness, strength and damping, or if the shortest step is at most
    half of the longest (lagged damping).
    """
    stems = {split_key(parameter.name.split(".")[-1])[0] for parameter in parameters}
    if not (stems <= STIFFENING and all(is_cheap(parameter) for parameter in parameters)):
        return None
    project.model  # noqa: B018  variants stand on the mesh of a model that is there
    ends = np.array([[parameter.low, parameter.high] for parameter in parameters])
    shortest = time_step(with_values(project, parameters, ends[:, 1]).model)
    longest = time_step(with_values(project, parameters, ends[:, 0]).model)
    return shortest if shortest[0] > LEAST_STEP * longest[0] else None


def simulate(project: Project, parameters, points, step=None) -> list[dict[str, Seismogram]]:
    """Simulate a project at points (m, n); return seismograms by receiver, 0 s the first firing.

    Raises
    ------
    SolverError
        If a model can't be run.
    """
    varied = [with_values(project, parameters, point) for point in points]
    if step is not None:
        runs = run_many([variant.model for variant in varied], project.duration, step=step)
    else:
        runs = [run_many([variant.model], variant.duration)[0] for variant in varied]
    pairs = zip(varied, runs, strict=True)
    return [variant.simulated(run.seismograms) for variant, run in pairs]


DENSITY, GEOMETRY = "density", "geometry"
STEPS = {SPEED: 0.02, STIFFNESS: 0.3, OTHER: 0.1}  # of coordinates, for derivatives
OF_SPEEDS = {"cp", "cs", "youngs", "bulk", "shear", "poisson"}  # keys of a material


@dataclass(frozen=True)
class Property:
    """Property of the ground that is looked for, or that is held and not known exactly.

    Its coordinate is zero at the value of the project file.

    Parameters
    ----------
    name : str
        Path of a parameter; else such as ``rock.cp`` or ``F1.dip``.
    kind : str
        ``speed``, ``stiffness`` and ``other`` change in runs, ``density`` and ``geometry`` don't.
    sigma : float
        Prior standard deviation of the coordinate.
    step : float
        Of the difference that gives its derivative.
    change : callable
        ``(project, coordinate) -> project``.
    mean : float
        Of the prior.
    parameter : Parameter, optional
        Where it is looked for.
    start : float
        Value of the parameter at coordinate zero, in the unit of its key.
    """

    name: str
    kind: str
    sigma: float
    step: float
    change: Callable[[Project, float], Project]
    mean: float = 0.0
    parameter: Parameter | None = None
    start: float = 0.0

    @property
    def relative(self) -> bool:
        """Whether the coordinate is the logarithm of a factor."""
        return self.parameter is None or self.parameter.low > 0.0

    @property
    def moves(self) -> bool:
        """Whether a search runs other values of it."""
        return self.kind not in (DENSITY, GEOMETRY)

    def value(self, coordinate):
        """Return the value of a parameter at a coordinate, in the unit of its key."""
        if self.relative:
            return self.start * np.exp(coordinate)
        assert self.parameter is not None  # else relative
        return self.start + coordinate * (self.parameter.high - self.parameter.low)

    def coordinate(self, value):
        """Return the coordinate of a value of a parameter; the inverse of `value`."""
        if self.relative:
            return np.log(value / self.start)
        assert self.parameter is not None  # else relative
        return (value - self.start) / (self.parameter.high - self.parameter.low)


def sought_properties(project: Project, parameters: Sequence[Parameter]) -> tuple[Property, ...]:
    """Return the parameters as properties, with the priors of their ranges.

    They start at the value of the project file, or in the middle of a range without it.
    """
    return tuple(_sought(project, parameter) for parameter in parameters)


def _sought(project, parameter):
    """Return a parameter as a property: its prior has the mean and deviation of its range."""
    low, high = parameter.low, parameter.high
    middle = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
    given = value_at(project.config, parameter.name)
    start = float(given) if given is not None and low <= given <= high else middle
    kind = kind_of_key(parameter.name)
    plain = Property(
        parameter.name, kind, 1.0, STEPS[kind], _set(parameter.name), 0.0, parameter, start
    )
    ends = plain.coordinate(low), plain.coordinate(high)
    width = (ends[1] - ends[0]) / math.sqrt(12.0)
    mean = float(0.5 * (ends[0] + ends[1]))
    other = replace(plain, sigma=width, mean=mean, step=min(plain.step, width))
    return replace(other, change=lambda project, x: plain.change(project, float(plain.value(x))))


def _set(path):
    """Return the change of a project that gives a key a value."""
    return lambda project, value: vary(project, {path: value})


def held_properties(project: Project, parameters: Sequence[Parameter]) -> tuple[Property, ...]:
    """Return what a project takes as known beside its parameters, with its table [priors].

    Speeds of each material of a layer and stiffness of each joint, one factor on all densities,
    thickness of each layer, dip, direction and place of the family of planes.
    """
    paths, priors = [parameter.name for parameter in parameters], project.config.priors
    mesh, held = project.config.mesh, []
    for name in dict.fromkeys(layer.material for layer in mesh.layers):
        keys = {
            split_key(path.rpartition(".")[-1])[0]
            for path in paths
            if path.startswith(f"materials.{name}.")
        }
        if keys & (OF_SPEEDS - {"cp", "cs"}):  # then speeds follow from what is looked for
            continue
        held += [
            Property(f"{name}.{key}", SPEED, priors.speed_percent / 100.0, STEPS[SPEED],
                     _speed(name, key)) for key in ("cp", "cs") if key not in keys
        ]  # fmt: skip
    entries = joint_of_surface(mesh)
    known = [(entries.get(joint.surface), set(joint.properties)) for joint in project.joints]
    for entry in dict.fromkeys(entry for entry, _ in known if entry is not None):
        for key in ("kn", "ks"):
            has = any(name == entry and key in keys for name, keys in known)
            if has and not any(path.startswith(f"joints.{entry}.{key}_") for path in paths):
                held.append(Property(
                    f"{entry}.{key}", STIFFNESS, priors.stiffness_percent / 100.0,
                    STEPS[STIFFNESS], _stiffness(entry, key),
                ))  # fmt: skip
    if not any("density" in path for path in paths):
        sigma = priors.density_percent / 100.0
        held.append(Property("density", DENSITY, sigma, 0.0, lambda project, _: project))
    if mesh.file is None and not any(path.startswith("mesh.") for path in paths):
        held += _held_geometry(mesh, priors)
    return tuple(each for each in held if each.sigma > 0.0)


def _held_geometry(mesh, priors):
    """Yield layers and planes of a mesh as properties."""
    for number, layer in enumerate(mesh.layers):
        if layer.thickness_m is not None:
            yield Property(
                f"{layer.material}.thickness",
                GEOMETRY,
                priors.thickness_m,
                min(0.5, 0.1 * layer.thickness_m),
                _thicker(number),
            )
    if mesh.faults:
        turn = 2.0 if max(fault.dip_deg for fault in mesh.faults) <= 88.0 else -2.0
        yield Property("dip", GEOMETRY, priors.dip_deg, turn, _turned("dip_deg"))
        yield Property("dip direction", GEOMETRY, priors.dip_direction_deg, 3.0,
                       _turned("dip_direction_deg"))  # fmt: skip
    for number, fault in enumerate(mesh.faults):
        yield Property(f"{fault.name}.place", GEOMETRY, priors.plane_m, 1.0, _moved(number))


def _speed(name, key):
    """Return the change of a project by the logarithm of a factor on a wave speed."""

    def change(project: Project, x: float) -> Project:
        rock = project.materials[name]
        speeds = {"cp": rock.cp, "cs": rock.cs}
        speeds[key] *= math.exp(x)
        moduli = Material.from_speeds(rock.density, speeds["cp"], speeds["cs"])
        other = replace(rock, bulk=moduli.bulk, shear=moduli.shear)
        return project.changed(materials={**project.materials, name: other})

    return change


def _stiffness(entry, key):
    """Return the change of a project by the logarithm of a factor on a joint stiffness."""

    def change(project: Project, x: float) -> Project:
        entries = joint_of_surface(project.config.mesh)
        joints = [
            replace(joint, properties={**joint.properties,
                                       key: joint.properties[key] * math.exp(x)})
            if entries.get(joint.surface) == entry and key in joint.properties
            else joint
            for joint in project.joints
        ]  # fmt: skip
        return project.changed(joints=joints)

    return change


def _thicker(number):
    """Return the change of a project by metres of thickness of a layer."""

    def change(project: Project, x: float) -> Project:
        layers = list(project.config.mesh.layers)
        thickness = layers[number].thickness_m + x
        layers[number] = layers[number].model_copy(update={"thickness_m": thickness})
        return project.changed(mesh=project.config.mesh.model_copy(update={"layers": layers}))

    return change


def _turned(key):
    """Return the change of a project by degrees of the dip or direction of all planes."""

    def change(project: Project, x: float) -> Project:
        faults = [
            fault.model_copy(update={key: (getattr(fault, key) + x) % 360.0})
            for fault in project.config.mesh.faults
        ]
        return project.changed(mesh=project.config.mesh.model_copy(update={"faults": faults}))

    return change


def _moved(number):
    """Return the change of a project by metres of a plane along its normal."""

    def change(project: Project, x: float) -> Project:
        faults = list(project.config.mesh.faults)
        fault = faults[number]
        dip, direction = (math.radians(a) for a in (fault.dip_deg, fault.dip_direction_deg))
        sides = math.sin(direction), math.cos(direction)
        normal = np.array([*(math.sin(dip) * side for side in sides), math.cos(dip)])
        through = (np.array(fault.through_m) + x * normal).tolist()
        faults[number] = fault.model_copy(update={"through_m": through})
        return project.changed(mesh=project.config.mesh.model_copy(update={"faults": faults}))

    return change
