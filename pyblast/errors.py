"""Errors, exit codes, and findings about input and results.

====  ==========================================================================================
code  meaning
====  ==========================================================================================
0     done
1     the solver failed: `SolverError`
2     wrong input or a file that can't be read or written: `InputError`, `ReadError`, wrong usage
3     done, and a check found what forbids trust in the result (commands check and run)
130   interrupted by Ctrl-C or SIGTERM; what was computed is kept, the same command goes on
====  ==========================================================================================
"""

import logging
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

EXIT_CODES = {
    0: "done",
    1: "the solver failed",
    2: "wrong input, or a file that can't be read or written",
    3: "done, and a check found what forbids trust in the result (check, run)",
    130: "interrupted by Ctrl-C or SIGTERM; what was computed is kept, the same command goes on",
}
SOLVER_FAILED, WRONG_INPUT, NOT_TRUSTED, INTERRUPTED = 1, 2, 3, 130
log = logging.getLogger(__name__)


_POWER = re.compile(r"(?<![\w.])-?\d(?:\.\d+)?e\+(?:0\d|1[0-4])(?!\w)")


def written_out(text: str) -> str:
    """Write numbers below 1e15, such as 1.5e+07, of a sentence without powers of ten.

    Examples
    --------
    >>> written_out("must be at most 1.5e+07 Pa, got -2e+09")
    'must be at most 15000000 Pa, got -2000000000'
    """
    return _POWER.sub(lambda match: f"{float(match[0]):.0f}", text)


class PyblastError(Exception):
    """Base class of all errors that pyblast raises on purpose."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(written_out(a) if isinstance(a, str) else a for a in arguments))


class InputError(PyblastError, ValueError):
    """A value breaks a rule; the message says where, which rule, the value and what to do."""


class ReadError(PyblastError, OSError):
    """A file can't be read; the message names the file, the line or field and what was expected."""


class SolverError(PyblastError, RuntimeError):
    """The time integration failed; the message says when, where and the likely cause."""


class LostProcessError(SolverError):
    """A process ended during its run, for lack of memory or by a signal; the same call goes on."""


class PyblastWarning(UserWarning):
    """Questionable physics or data that can still be computed."""


@dataclass(frozen=True)
class Finding:
    """Finding of a check: a questionable point of a project or a result.

    Parameters
    ----------
    code : str
        D and a number, listed in docs/reference/findings.md.
    title, text : str
        What it is in general; what it is here, in numbers.
    failed : bool
        Whether a result can't be trusted unless this is changed.
    numbers : dict of str to float
        SI.
    """

    code: str
    title: str
    text: str
    failed: bool = field(default=False, kw_only=True)
    numbers: dict[str, float] = field(default_factory=dict, kw_only=True)

    def __post_init__(self) -> None:
        """Write large numbers of the text without powers of ten."""
        object.__setattr__(self, "text", written_out(self.text))


def by_wave(pairs: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Name the numbers of P and S waves, ``{"rock": (1, 2)}`` as ``{"p_rock": 1, "s_rock": 2}``."""
    return {f"{w}_{n}": v for n, pair in pairs.items() for w, v in zip("ps", pair, strict=True)}


@contextmanager
def named_error(where):
    """Put a place of the project file before the message of an error in it or in its files."""
    try:
        yield
    except (InputError, ReadError) as error:
        said = str(error)
        raise type(error)(said if said.startswith(f"{where}: ") else f"{where}: {said}") from None


@contextmanager
def contained(failures: dict[Any, str], key: object) -> Iterator[None]:
    """Enter the sentence of an error into ``failures`` in place of raising it.

    For a part of a computation whose failure costs that part alone. What is the fault of the
    machine is raised: lack of memory, a lost process, a disk that can't be written.
    """
    try:
        yield
    except (MemoryError, LostProcessError):
        raise
    except Exception as error:
        own = isinstance(error, PyblastError)
        if isinstance(error, OSError) and not own:
            raise
        log.info("%s: %s", key, error, exc_info=not own)
        name = type(error).__name__
        said = str(error) if own else f"its computation failed ({name}: {error})"
        failures.setdefault(key, said.rstrip("."))
