"""Constitutive laws of joints and of zones: what the rows of their Fortran tables say of them.

The grammar of a row stands in fortran/joint_laws.f90, above the rows of joints.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import TypeVar

import numpy as np

from .errors import InputError
from .units import PROPERTY_UNITS, check_stiffness, check_tangent, split_key

_PROPERTY = re.compile(
    r"(?P<name>[a-z]\w*)\[(?P<unit>[^\]]*)\](?: in (?P<file>\S+))?"
    r"(?P<rules>(?: (?:>=|<=|>|<|needs) \S+)*)(?: = (?P<default>\S+))?"
)
_RULES = {
    ">": (float.__gt__, "must exceed"),
    ">=": (float.__ge__, "must not be below"),
    "<": (float.__lt__, "must be below"),
    "<=": (float.__le__, "must not exceed"),
}
_SIGNS = {">": "must be positive", ">=": "must not be negative"}
_SPRINGS = ("kn", "ks")
_STRENGTHS = ("cohesion", "friction", "tension")
_SLIPS = ("slip_x", "slip_y", "slip_z", "failed")


@dataclass(frozen=True)
class LawProperty:
    """Property of a law: unit, range, default.

    Parameters
    ----------
    name : str
    unit : str
        SI; "1" of a pure number, "tan" of the tangent of an angle.
    file_units : tuple of str
        Units, as suffixes of keys, that project files may use; the customary one first.
    rules : tuple of (str, float or str)
        A sign, and the number or the property that bounds it.
    needs : str
        Another property, which must not be zero where this one is not; empty for none.
    default : (float, str) or None
        A number and "", or a factor and the property that it multiplies; None: required.
    """

    name: str
    unit: str
    file_units: tuple[str, ...]
    rules: tuple[tuple[str, float | str], ...] = ()
    needs: str = ""
    default: tuple[float, str] | None = None

    @property
    def key(self) -> str:
        """Key of project files, with the customary unit."""
        return f"{self.name}_{self.file_units[0]}".rstrip("_")

    @property
    def sign(self) -> str:
        """Rule of the sign, "must be positive"; empty where a value may be negative."""
        return next((_SIGNS[sign] for sign, bound in self.rules if bound == 0.0), "")

    def has_sign(self, value: float) -> bool:
        """Tell whether a value has the sign; NaN has none."""
        return all(_RULES[sign][0](float(value), 0.0) for sign, b in self.rules if b == 0.0)

    def check(self, where: str, value: float) -> None:
        """Raise InputError for a value that is out of range, whatever the others are."""
        if not self.has_sign(value):
            raise InputError(f"{where}: {self.sign}, got {self._said(value)}")
        if not math.isfinite(value) and ("<=", math.inf) not in self.rules:
            raise InputError(f"{where}: must be finite, got {self._said(value)}")
        for sign, bound in self.rules:
            if isinstance(bound, float):
                self._keep(where, value, sign, bound, "")
        if self.unit == "Pa/m":
            check_stiffness(where, value)
        if self.unit == "tan":
            check_tangent(where, value)

    def check_beside(self, where: str, values: Mapping[str, float]) -> None:
        """Raise InputError for a value that does not go with those of other properties."""
        value = values[self.name]
        for sign, bound in self.rules:
            if isinstance(bound, str):
                self._keep(f"{where}.{self.name}", value, sign, values[bound], f"{bound} of ")
        if self.needs and value != 0.0 and values[self.needs] == 0.0:
            raise InputError(
                f"{where}.{self.needs}: missing beside {self.name}, got {self.name} of "
                f"{self._said(value)}; give it a value above zero"
            )

    def _keep(self, where, value, sign, bound, whose):
        """Raise InputError for a value beyond a bound."""
        holds, words = _RULES[sign]
        if not holds(float(value), float(bound)):
            raise InputError(
                f"{where}: {words} {whose}{self._said(bound)}, got {self._said(value)}"
            )

    def _said(self, value):
        """Return a value with its unit, as text."""
        return f"{value:g}" + f" {self.unit}" * (self.unit not in ("1", "tan"))


@dataclass(frozen=True, eq=False)
class Law:
    """Constitutive law: its name, its number (from 0), and what its row says.

    Parameters
    ----------
    name : str
    number : int
    properties : dict of str to LawProperty
        In the order of the routine.
    state : tuple of str
        Names, in the order of the routine.
    at_zero : frozenset of str
        States that belong to the displacement, which is zero at the start of a stage.
    linear : bool
        Whether the stress is linear in the displacement and its past.
    """

    name: str
    number: int
    properties: dict[str, LawProperty]
    state: tuple[str, ...]
    at_zero: frozenset[str]
    linear: bool = False

    @property
    def elastic(self) -> bool:
        """Whether the law is linear and keeps no state."""
        return self.linear and not self.state

    def check(self, where: str, given: Mapping[str, float | None]) -> None:
        """Raise InputError for a property that is unknown, or out of range whatever others are.

        Parameters
        ----------
        where : str
            For messages, such as "joints.F1".
        given : dict of str to float or None
            SI; None is not given.
        """
        for name, value in given.items():
            if name not in self.properties:
                raise InputError(
                    f"{where}.{name}: unknown to '{self.name}'; it has {' '.join(self.properties)}"
                )
            if value is not None:
                self.properties[name].check(f"{where}.{name}", value)

    def complete(self, where: str, given: Mapping[str, float | None]) -> dict[str, float]:
        """Return all properties in the order of the routine, checked, those not given by default.

        Parameters
        ----------
        where, given
            As of `check`.

        Raises
        ------
        InputError
            If a property is unknown, missing or out of range, alone or beside others.

        Examples
        --------
        >>> from pyblast.core import JOINT_LAWS
        >>> JOINT_LAWS["elastic"].complete("joints.F1", {"ks": 1e9, "kn": 2e9})
        {'kn': 2000000000.0, 'ks': 1000000000.0}
        """
        self.check(where, given)
        values: dict[str, float] = {}
        for name, prop in self.properties.items():
            value = given.get(name)
            if value is None and prop.default is not None:
                factor, other = prop.default
                value = factor * values[other] if other else factor
            if value is None:
                raise InputError(f"{where}.{name}: missing; the law '{self.name}' needs it")
            values[name] = float(value)
        for prop in self.properties.values():
            prop.check_beside(where, values)
        return values


AnyLaw = TypeVar("AnyLaw", bound=Law)


@dataclass(frozen=True, eq=False)
class TractionLaw(Law):
    """Traction law of a joint.

    Parameters
    ----------
    sticks : bool
        Whether it is elastic, with kn and ks, until it slips or opens.
    stiffens : bool
        Whether its stiffness follows the pressure.
    flows : bool
        Whether it creeps under a constant load.
    """

    sticks: bool = False
    stiffens: bool = False
    flows: bool = False

    def __post_init__(self) -> None:
        """Refuse a row that the columns of arrays of joints contradict."""
        names, state = tuple(self.properties), self.state
        positive = [n for n, prop in self.properties.items() if (">", 0.0) in prop.rules]
        if names[:2] != _SPRINGS or tuple(positive[:2]) != _SPRINGS:
            raise ValueError(f"law {self.name!r}: must begin with kn and ks above zero")
        if self.opens and state[4:6] != ("status", "gap"):
            raise ValueError(f"law {self.name!r}: status and gap must be states 5 and 6")
        if self.sticks and not (self.opens and state[:4] == _SLIPS and {*_STRENGTHS} <= {*names}):
            raise ValueError(
                f"law {self.name!r}: one that sticks has {', '.join(_STRENGTHS)}, and its state "
                f"begins with {' '.join(_SLIPS)} status gap"
            )

    @property
    def opens(self) -> bool:
        """Whether walls part and carry nothing then: it keeps their gap."""
        return "gap" in self.state

    @property
    def superposes(self) -> bool:
        """Whether motions superpose across it, at least while it sticks."""
        return self.linear or self.sticks


@dataclass(frozen=True, eq=False)
class StressLaw(Law):
    """Stress law of zones.

    Parameters
    ----------
    yields : bool
        Whether it is linearly elastic until it yields, and has a memory then.
    """

    yields: bool = False


def of_laws(laws: Mapping[str, Law], numbers: np.ndarray, question: str) -> np.ndarray:
    """Return whether the laws of numbers (n,) are "linear", "sticks" or such, (n,) bool."""
    return np.array([getattr(law, question) for law in laws.values()], dtype=bool)[numbers]


def read_laws(
    kind: type[AnyLaw], rows: Iterable[str], longest: int, most_properties: int, most_states: int
) -> dict[str, AnyLaw]:
    """Read the rows of a table of laws, up to the first blank one.

    Parameters
    ----------
    kind : TractionLaw or StressLaw
    rows : iterable of str
    longest : int
        Characters that a row can have.
    most_properties, most_states : int
        Columns of the arrays of the kernels.

    Raises
    ------
    ValueError
        If a row is not of the grammar, or longer than what holds it: the part, the rule, and what
        to do. It is an error of the source, not of input.

    Examples
    --------
    >>> rows = ["spring: kn[Pa/m] > 0, ks[Pa/m] > 0, rest[m] >= 0 = 0 | linear |", ""]
    >>> law = read_laws(TractionLaw, rows, 1000, 12, 12)["spring"]
    >>> law.linear, law.properties["rest"].key
    (True, 'rest_mm')
    """
    laws: dict[str, AnyLaw] = {}
    for number, row in enumerate(rows):
        if not row.strip():
            break
        if len(row.rstrip()) >= longest:
            raise ValueError(
                f"law {row.partition(':')[0]!r}: its row may be cut; increase n_row in "
                "fortran/kinds.f90.in"
            )
        law = _read_law(kind, row, number)
        for what, held, most in (
            ("properties", law.properties, most_properties), ("states", law.state, most_states),
        ):  # fmt: skip
            if len(held) > most:
                raise ValueError(
                    f"law {law.name!r}: has {len(held)} {what}, the kernels hold {most}; increase "
                    "their number in fortran/kinds.f90.in"
                )
        if law.name in laws:
            raise ValueError(f"law {law.name!r}: stands twice")
        laws[law.name] = law
    return laws


def _read_law(kind, row, number):
    """Read one row; as `read_laws`."""
    where = f"law {row.partition(':')[0]!r}"
    match = re.fullmatch(r"([a-z][\w-]*):([^|]*)\|([^|]*)\|([^|]*)", row)
    if match is None:
        raise ValueError(f"{where}: a row is 'NAME: PROPERTIES | KIND | STATE', got {row!r}")
    table: dict[str, LawProperty] = {}
    for text in filter(None, map(str.strip, match[2].split(","))):
        prop = _read_property(f"{where}, {text!r}", text)
        if prop.default is not None and prop.default[1] not in ("", *table):
            raise ValueError(
                f"{where}, {text!r}: a default is a number, inf, a property that stands before it, "
                "or number*property"
            )
        table[prop.name] = prop
    for prop in table.values():
        for other in (prop.needs, *(bound for _, bound in prop.rules)):
            if isinstance(other, str) and other not in ("", *table):
                raise ValueError(f"{where}, {prop.name}: has no property {other!r}")
    known = sorted(field.name for field in fields(kind) if field.type is bool)
    for word in match[3].split():
        if word not in known:
            raise ValueError(f"{where}: is not {word!r}; a kind is one of {', '.join(known)}")
    states = {text.removesuffix("=0"): text.endswith("=0") for text in match[4].split()}
    at_zero = frozenset(name for name, zero in states.items() if zero)
    words = dict.fromkeys(match[3].split(), True)
    return kind(match[1], number, table, tuple(states), at_zero, **words)


def _read_property(where, text):
    """Read one property of a row."""
    match = _PROPERTY.fullmatch(text)
    if match is None:
        raise ValueError(f"{where}: a property is 'NAME[UNIT] in FILE RULES = DEFAULT'")
    units = PROPERTY_UNITS.get(match["unit"])
    if units is None:
        raise ValueError(
            f"{where}: unknown unit; use one of {', '.join(PROPERTY_UNITS)}, or add it to "
            "PROPERTY_UNITS of pyblast/units.py"
        )
    if match["file"]:
        first = match["file"].lower().replace("/", "_per_")
        if first not in units:
            raise ValueError(f"{where}: project files have no such unit; use one of {units}")
        units = (first, *(other for other in units if other != first))
    if any(
        split_key(f"{match['name']}_{unit}".rstrip("_")) != (match["name"], unit) for unit in units
    ):
        raise ValueError(f"{where}: project files take the end of its name for a unit; rename it")
    words = match["rules"].split()
    pairs = list(zip(words[::2], words[1::2], strict=True))
    return LawProperty(
        match["name"], match["unit"], units,
        tuple((sign, _number_or_name(word)) for sign, word in pairs if sign != "needs"),
        next((word for sign, word in pairs if sign == "needs"), ""),
        None if match["default"] is None else _default(match["default"]),
    )  # fmt: skip


def _number_or_name(text):
    """Return a word of a row as a number, if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


def _default(text):
    """Return a default of a row as a factor and a name, which is empty for a number."""
    factor, times, last = map(_number_or_name, text.rpartition("*"))
    if isinstance(last, float):
        return last, ""
    return (factor, last) if isinstance(factor, float) else (1.0, f"{factor}{times}{last}")
