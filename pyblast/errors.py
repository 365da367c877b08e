"""Errors, with an exit code each, and findings about input and results."""

from dataclasses import dataclass, field


class PyblastError(Exception):
    """Every error that pyblast raises on purpose."""


class InputError(PyblastError, ValueError):
    """A value breaks a rule; the message says where, which rule, the value and what to do."""


class ReadError(PyblastError, OSError):
    """A file can't be read; the message names the file, the line or field and what was expected."""


class SolverError(PyblastError, RuntimeError):
    """The march through time failed; the message says when, where and the likely cause."""


class PyblastWarning(UserWarning):
    """Physics that is doubtful but can be computed."""


@dataclass(frozen=True)
class Finding:
    """Something doubtful about a project.

    Parameters
    ----------
    code : str
        D1 to D35.
    title, text : str
        What it is, in words; what it is here, in numbers.
    failed : bool
        Whether a result can't be trusted unless this is changed.
    numbers : dict of str to float
        SI.
    """

    code: str
    title: str
    text: str
    failed: bool = False
    numbers: dict[str, float] = field(default_factory=dict)


def by_wave(pairs):
    """Name the numbers of P and S waves, ``{"rock": (1, 2)}`` as ``{"p_rock": 1, "s_rock": 2}``."""
    return {f"{w}_{n}": v for n, pair in pairs.items() for w, v in zip("ps", pair, strict=True)}
