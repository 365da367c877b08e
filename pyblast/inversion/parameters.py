"""Unknowns of a back-analysis: keys of a project file with their ranges."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..projects.config_section import named_error
from ..projects.key_paths import check_path
from ..projects.project import Project
from ..projects.variants import CHEAP, vary


@dataclass(frozen=True)
class Parameter:
    """An unknown and its range.

    Parameters
    ----------
    path : str
        Dotted path of a number in the project file: ``joints.fault.kn_gpa_per_m``,
        ``damping.ratio``, ``mesh.layers.soil.thickness_m``, ``signature.scale``.
    low, high : float
        In the unit that the key names.
    log : bool
        Whether to search on a logarithmic scale.
    laboratory : (low, high), optional
        What samples gave, to set the result beside; no part of the search.

    Raises
    ------
    InputError
        If the range is none.
    """

    path: str
    low: float
    high: float
    log: bool = False
    laboratory: tuple[float, float] | None = None

    def __post_init__(self):
        for name in ("low", "high"):
            if not math.isfinite(getattr(self, name)):
                raise InputError(f"{self.path}: {name} must be finite, got {getattr(self, name)}")
        if not self.low < self.high:
            raise InputError(
                f"{self.path}: low must be below high, got {self.low:g} and {self.high:g}"
            )
        if self.log and not self.low > 0.0:
            raise InputError(
                f"{self.path}: a logarithmic range must be positive, got {self.low:g}; leave out "
                "log or raise low"
            )
        if self.laboratory is not None:
            object.__setattr__(self, "laboratory", tuple(self.laboratory))
            if not self.laboratory[0] <= self.laboratory[1]:
                raise InputError(f"{self.path}: laboratory must rise, got {self.laboratory}")

    @property
    def is_cheap(self) -> bool:
        """Whether a change leaves the mesh and the ground as they are, so that runs go together."""
        return self.path.split(".")[0] in CHEAP


def parameters_of(project: Project) -> tuple[Parameter, ...]:
    """Return the unknowns that table ``[back_analysis]`` of a project names.

    Raises
    ------
    InputError
        If the table is missing, or a range is none.
    """
    table, where = project.config.back_analysis, f"{project.path.name}: back_analysis"
    if table is None:
        raise InputError(f"{where}: missing; add the table with its parameters")
    with named_error(where):
        return tuple(Parameter(**part.model_dump()) for part in table.parameters)


def check_parameters(project: Project, parameters: Sequence[Parameter]):
    """Refuse parameters that a project does not have, or that its rules forbid in the range.

    Raises
    ------
    InputError
        With the key.
    """
    if not parameters:
        raise InputError("back_analysis.parameters: missing; name at least one key to find")
    paths = [parameter.path for parameter in parameters]
    for number, parameter in enumerate(parameters, start=1):
        with named_error(f"{project.path.name}: back_analysis.parameters[{number}].path"):
            check_path(project.config, parameter.path)
        if paths.count(parameter.path) > 1:
            raise InputError(
                f"{project.path.name}: back_analysis.parameters[{number}].path: "
                f"{parameter.path!r} is given twice; keep one"
            )
        for end in ("low", "high"):
            with named_error(f"{project.path.name}: back_analysis.parameters[{number}].{end}"):
                vary(project, {parameter.path: getattr(parameter, end)})


def with_values(project: Project, parameters: Sequence[Parameter], values) -> Project:
    """Return a project with the values (n,) of its parameters."""
    pairs = zip(parameters, np.asarray(values, dtype=np.float64).tolist(), strict=True)
    return vary(project, {parameter.path: value for parameter, value in pairs})
