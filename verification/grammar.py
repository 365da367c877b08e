"""Project files by grammar, with mistakes on purpose, for `pyblast check`.

Each file is drawn from a seed: a small ground of any kind with a source, receivers and the tables
beside it, all of which the program must take; then one or two mistakes. Of many of them it is known
that the file must be refused: a number beyond the range of its key, a value of another type, a name
that nothing has. The program must end soon, by exit code 2 with one sentence about the file, or go
on to its checks; never by a traceback, a signal, or words of Python.
"""

import os
import re
import resource
import signal
import string
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from copy import deepcopy
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, get_args, get_origin

import numpy as np
from numpy.random import Generator

from pyblast.cli.commands import main
from pyblast.config.config import Config
from pyblast.config.keys import range_of_key, section_in
from pyblast.project import checks, project

SECONDS, WAIT = 60, 300.0  # of processor, and by the clock, that a check may take
MEMORY = 4 << 30  # bytes that it may take
OUTCOMES = {0: "accepted", 2: "refused", 3: "finding"}  # by exit code
PYTHON = re.compile(
    r"Traceback|NoneType|numpy|\bnp\.|<class|<built-in|object at 0x|datetime\.|Error\(|KeyError|"
    r"\bindex out of range|dtype|float64|unhashable|broadcast|ndarray|argument|Qhull|\bErrno\b"
)
UNREAL = re.compile(r"\b(nan|inf)\b")
LOADED = checks, project  # before processes are forked, so that none loads them again
FORCE = ["time_s,force_n", *(f"{0.002 * n:.3f},{1e5 * np.hanning(21)[n]:.6g}" for n in range(21))]
HOLES = [
    "hole,x_m,y_m,z_m,depth_m,diameter_mm,charge_kg,time_ms",
    *(f"H{n},{14 + 4 * n},10,30,12,115,50,{25 * n}" for n in range(3)),
]
SURFACE = [
    "x_m,y_m,z_m",
    *(f"{x},{y},{30 + 0.02 * x:.6g}" for x in range(-20, 90, 10) for y in range(-20, 50, 10)),
]
CELLS = (
    "", "nan", "inf", "-inf", "abc", "1e400", "-", "1,5", "1e300", "-1", "0", "1;2", '"', "0x10",
    "1979-05-27", "=1+1", "\u0000", "\u202e", "١", "1 000",
)  # fmt: skip


class Drawn(NamedTuple):
    """A project file before it is written: its tables, and the lines of the tables beside it."""

    tables: dict
    beside: dict[str, list[str]]


def drawn(rng: Generator) -> Drawn:
    """Return a file without mistakes: mesh, materials, joints, source and receivers of any kind."""
    mesh = {"size_m": [60, 20, 30], "layers": [{"material": "rock"}]} | _one(rng, [
        {"grid_cells": [6, 2, 3]}, {"frequency_hz": 20}, {"edge_m": 10.0, "kind": "tetrahedra"},
    ])  # fmt: skip
    tables = {
        "title": "Drawn",
        "mesh": mesh,
        "materials": {"rock": {"density_kg_per_m3": 2600} | _one(rng, [
            {"cp_m_per_s": 3000, "cs_m_per_s": 1700}, {"young_mpa": 30000, "poisson": 0.25},
            {"bulk_mpa": 15600, "shear_mpa": 7200},
        ])},
        "boundaries": {"viscous": ["west", "east", "south", "north", "bottom"], "free": ["top"]},
        "receivers": [{"name": "R1", "position_m": [52, 10], "azimuth_deg": 90},
                      {"name": "R2", "position_m": [40, 4]}],
        "run": {"duration_s": 0.1, "snapshots_s": [0.05]},
    }  # fmt: skip
    beside: dict[str, list[str]] = {}
    if rng.random() < 0.4:
        tables["materials"]["soil"] = {"density_kg_per_m3": 2000, "bulk_mpa": 600, "shear_mpa": 250}
        mesh["layers"] = [{"material": "soil", "thickness_m": 10}, {"material": "rock"}]
    if rng.random() < 0.6:
        mesh["faults"] = [{"name": "F1", "dip_deg": 90, "dip_direction_deg": 90,
                           "through_m": [30, 0, 0]}]  # fmt: skip
        stiff = {"kn_gpa_per_m": 0.5, "ks_gpa_per_m": 0.2}
        slips = {"cohesion_kpa": 20, "friction_angle_deg": 25, "tension_kpa": 0}
        tables["joints"] = {"F1": stiff | _one(rng, [{"law": "elastic"}, slips])}
    elif "grid_cells" not in mesh and rng.random() < 0.4:
        mesh["surface_file"], beside["surface.csv"] = "surface.csv", list(SURFACE)
    if rng.random() < 0.3:
        tables["damping"] = {"ratio": 0.02, "frequency_hz": 20}
    if rng.random() < 0.2:
        tables["insitu"] = {"horizontal_ratio": 0.8}
    _one(rng, [_force, _moment, _holes, _cavity])(rng, tables, beside)
    return Drawn(tables, beside)


def _force(_rng, tables, beside):
    tables["point_forces"] = [{"position_m": [12, 10, 15], "direction": [0, 0, 1],
                               "file": "force.csv"}]  # fmt: skip
    beside["force.csv"] = list(FORCE)


def _moment(_rng, tables, beside):
    tables["moment_tensors"] = [{"position_m": [12, 10, 15], "tensor": [1, 1, 1, 0, 0, 0],
                                 "file": "moment.csv"}]  # fmt: skip
    beside["moment.csv"] = [FORCE[0].replace("force_n", "moment_rate_Nm_per_s"), *FORCE[1:]]


def _holes(rng, tables, beside):
    tables["blast"] = _blast(rng, beside)
    level = _one(rng, [{"pressure_mpa": 100}, {"peak_mm_per_s": 40, "distance_m": 30}, {}])
    hole = {"material": "rock", "charge_kg": 50, "radius_m": 0.5, "peak_time_ms": 40}
    tables["holes_inside"] = {"charged_hole": hole | level}


def _cavity(rng, tables, beside):
    tables["blast"] = _blast(rng, beside) | {"shift_m": [-60, 0, 0]}
    tables["signature"] = {"cavity": {
        "material": "rock", "hole_m": [-39, 5, 20], "receiver_m": [0, 10, 30], "charge_kg": 50,
        "radius_m": 3, "peak_time_ms": 30,
    }}  # fmt: skip
    tables["input"] = {"low_pass_hz": 20}


def _blast(rng, beside):
    """Return a [blast] of rows, or of a table."""
    if rng.random() < 0.5:
        beside["holes.csv"] = list(HOLES)
        return {"file": "holes.csv"}
    return {"rows": 1, "holes_per_row": 3, "delay_ms": 25, "charge_kg": 50, "diameter_mm": 115,
            "depth_m": 12, "burden_m": 3, "spacing_m": 4, "position_m": [14, 10, 30]}  # fmt: skip


def _one(rng, choices):
    """Draw one of some things."""
    return choices[rng.integers(len(choices))]


def toml(value: object) -> str:
    """Write a value as TOML has it, tables within a value in braces."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_quoted(k)} = {toml(v)}' for k, v in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, bool):
        return str(value).lower()
    return value.isoformat() if isinstance(value, datetime) else repr(value)


def _quoted(text):
    """Write text as a basic string of TOML."""
    inner = "".join(c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in text)
    return f'"{inner}"'


def places(section, table: dict, path: tuple = ()) -> Iterator[tuple[tuple, dict, type]]:
    """Yield each table of a project file with its path and its class."""
    yield path, table, section
    for name, value in list(table.items()):
        field = section.model_fields.get(name)
        inner = field and section_in(field.annotation)
        if inner is None:
            continue
        if isinstance(value, list):
            parts = [((*path, name), part) for part in value]
        elif get_origin(field.annotation) is dict:
            parts = [((*path, name, key), part) for key, part in value.items()]
        else:
            parts = [((*path, name), value)]
        for at, part in parts:
            if isinstance(part, dict):
                yield from places(inner, part, at)


def _key(rng, made, wanted: Callable[[type, str], bool]):
    """Draw a table and a key of it that a rule wants, one that is given more often than not."""
    every = [(table, section, key) for _, table, section in places(Config, made.tables)
             for key in section.model_fields if wanted(section, key)]  # fmt: skip
    given = [one for one in every if one[2] in one[0]]
    return _one(rng, given if given and rng.random() < 0.6 else every)


def _is_number(section, key):
    """Tell whether a key holds one number, and nothing else beside it."""
    kinds = {
        kind for kind in _kinds(section.model_fields[key].annotation) if kind is not type(None)
    }
    return kinds <= {int, float} and range_of_key(section, key) is not None


def _kinds(annotation):
    """Yield the kinds of value that an annotation takes at its first level."""
    if get_origin(annotation) in (list, dict) or not get_args(annotation):
        yield get_origin(annotation) or annotation
        return
    for part in get_args(annotation):
        if isinstance(part, type) or get_args(part):
            yield from _kinds(part)
        elif isinstance(part, str):
            yield str


# Mistakes: each changes what was drawn and returns whether the file must be refused.


def beyond(rng: Generator, made: Drawn) -> bool:
    """Give a number that lies beyond the range of its key, or is not finite."""
    table, section, key = _key(rng, made, _is_number)
    known = range_of_key(section, key)
    over = known.high * (1.0 + 10.0 ** rng.uniform(-3, 30)) + 1.0
    under = known.low - max(1.0, abs(known.low)) * 10.0 ** rng.uniform(-3, 30)
    table[key] = float(_one(rng, [over, under, np.nan, np.inf, -np.inf]))
    return True


def other_type(rng: Generator, made: Drawn) -> bool:
    """Give a value of a type that the key does not take."""
    table, section, key = _key(rng, made, lambda *_: True)
    kinds = {kind if isinstance(kind, type) else dict for kind in
             _kinds(section.model_fields[key].annotation)}  # fmt: skip
    tables = section_in(section.model_fields[key].annotation) is not None
    values = [True, 3, 2.5, "soon", [], [[1]], {"soon": [True]}, datetime(1979, 5, 27), [1] * 50]
    wrong = [v for v in values if type(v) not in kinds and not (tables and isinstance(v, dict))
             and not (float in kinds and type(v) is int)]  # fmt: skip
    table[key] = _one(rng, wrong)
    return True


def unknown_key(rng: Generator, made: Drawn) -> bool:
    """Misspell a key, or add one that nothing has."""
    _, table, section = _one(rng, list(places(Config, made.tables)))
    name = _one(rng, sorted(table))
    at = int(rng.integers(len(name)))
    wrong = _one(
        rng, [name[:at] + name[at + 1 :], name + "_", name.upper(), "colour", "", "a" * 300]
    )
    if wrong in section.model_fields:
        return False
    table[wrong] = table.pop(name) if rng.random() < 0.5 else table[name]
    return True


def taken_away(rng: Generator, made: Drawn) -> bool:
    """Take a key away."""
    _, table, _ = _one(rng, list(places(Config, made.tables)))
    del table[_one(rng, sorted(table))]
    return False


def odd_number(rng: Generator, made: Drawn) -> bool:
    """Give a number that the range of its key allows, of any size."""
    table, section, key = _key(rng, made, _is_number)
    known = range_of_key(section, key)
    low, high = max(known.low, 1e-12), max(known.high, 1e-12)
    value = float(_one(rng, [known.low, known.high, np.exp(rng.uniform(*np.log([low, high])))]))
    whole = int in set(_kinds(section.model_fields[key].annotation))
    table[key] = round(value) if whole else value
    return False


def odd_list(rng: Generator, made: Drawn) -> bool:
    """Shorten, lengthen, turn, or fill a list with one number."""
    lists = [(table, key) for _, table, _ in places(Config, made.tables) for key in table
             if isinstance(table[key], list)]  # fmt: skip
    table, key = _one(rng, lists)
    held = table[key]
    table[key] = _one(rng, [held[:-1], held + held[-1:], held[::-1], held * 400, [held],
                            [deepcopy(held[0])] * len(held)])  # fmt: skip
    return False


def wrong_name(rng: Generator, made: Drawn) -> bool:
    """Name what is not there: a material, a joint, a surface."""
    tables = made.tables
    name = _one(rng, ["nowhere", "ROCK", "rock ", "Rock\u0301", "-1"])
    where = _one(rng, [tables["mesh"]["layers"][0], tables["boundaries"], tables])
    if where is tables:
        tables.setdefault("joints", {})[name] = {"kn_gpa_per_m": 1.0, "ks_gpa_per_m": 1.0}
    elif where is tables["boundaries"]:
        where[_one(rng, ["viscous", "free", "fixed", "roller"])] = [name]
    else:
        where["material"] = name
    return True


def unprintable(rng: Generator, made: Drawn) -> bool:
    """Put characters into a name that no file or terminal bears."""
    bad = _one(rng, ["\u0000", "\u001b[31m", "\n", "\u202e", "\u0007"])
    named = [(table, key) for _, table, _ in places(Config, made.tables) for key in table
             if isinstance(table[key], str)]  # fmt: skip
    table, key = _one(rng, named)
    table[key] = table[key] + bad
    return True


def outside(rng: Generator, made: Drawn) -> bool:
    """Put a receiver or a source far beyond the box."""
    parts = [part for name in ("receivers", "point_forces", "moment_tensors")
             for part in made.tables.get(name, [])]  # fmt: skip
    place = _one(rng, parts)["position_m"]
    place[int(rng.integers(2))] = _one(rng, [-1e4, 61.0, 1e6, 500000.0])
    return True


def bad_table(rng: Generator, made: Drawn) -> bool:
    """Damage a table beside the project file."""
    if not made.beside:
        return taken_away(rng, made)
    lines = made.beside[_one(rng, sorted(made.beside))]
    at = int(rng.integers(1, len(lines)))
    cells = lines[at].split(",")
    cells[int(rng.integers(len(cells)))] = _one(rng, CELLS)
    ways = {
        "cell": [*lines[:at], ",".join(cells), *lines[at + 1 :]],
        "row": lines[:at] + lines[at + 1 :],
        "twice": [*lines[:at], lines[at], *lines[at:]],
        "turned": [lines[0], *lines[:0:-1]],
        "column": [line.partition(",")[2] for line in lines],
        "semicolons": [line.replace(",", ";") for line in lines],
        "title": [lines[0].upper().replace("_", " "), *lines[1:]],
        "no title": lines[1:],
        "empty": [],
        "title alone": lines[:1],
        "zeros": [lines[0], *(",".join("0" for _ in line.split(",")) for line in lines[1:])],
        "binary": ["\u0000\u0001\ufffd" * 40],
    }
    way = _one(rng, sorted(ways))
    lines[:] = ways[way]
    return way in ("empty", "title alone", "binary", "zeros")


def bad_path(rng: Generator, made: Drawn) -> bool:
    """Name a file that is not there, or is none."""
    tables = [table for _, table, _ in places(Config, made.tables)
              for key in ("file", "surface_file") if isinstance(table.get(key), str)]  # fmt: skip
    if not tables:
        return taken_away(rng, made)
    table = _one(rng, tables)
    table["file" if "file" in table else "surface_file"] = _one(
        rng, ["", ".", "..", "missing.csv", "/dev/zero", "/dev/null", "pipe", "a" * 300,
              "project.toml", "a/" * 200 + "b", "~", "http://x/y.csv"])  # fmt: skip
    return True


# In the order in which two of them are made: the first ones need tables that are whole, and the
# last one says whether the file must be refused.
MISTAKES = (
    wrong_name, outside, bad_table, bad_path, taken_away, odd_number, odd_list, beyond, other_type,
    unknown_key, unprintable,
)  # fmt: skip


def spoil(text: str, rng: Generator) -> tuple[bytes, bool]:
    """Damage the text of a project file; return it, and whether it must be refused."""
    raw, lines = text.encode(), text.splitlines()
    at, line = int(rng.integers(len(raw))), int(rng.integers(len(lines)))
    ways = {
        "cut": (raw[:at], False),
        "byte": (raw[:at] + bytes([rng.integers(256)]) + raw[at + 1 :], False),
        "letter": (raw[:at] + _one(rng, string.punctuation).encode() + raw[at:], False),
        "zero": (raw[:at] + b"\0" + raw[at:], True),
        "twice": ("\n".join([*lines[:line], lines[line], *lines[line:]]).encode(), True),
        "deep": (raw + b"\nx = " + b"[" * 5000 + b"]" * 5000, True),
        "digits": (raw + b"\nx = 1" + b"0" * 6000, True),
        "latin": (raw.replace(b"Drawn", b"Dr\xe4wn"), True),
        "utf-16": (text.encode("utf-16"), True),
        "empty": (b"", True),
        "large": (raw + b"\n#" + b"x" * 2_000_000, True),
    }
    return ways[_one(rng, sorted(ways))]


def write(folder: Path, rng: Generator) -> tuple[str, bool]:
    """Write a project file with mistakes; return their names, and whether it must be refused."""
    made = drawn(rng)
    ways = sorted(
        {_one(rng, MISTAKES) for _ in range(1 + (rng.random() < 0.3))}, key=MISTAKES.index
    )
    must = [way(rng, made) for way in ways][-1]
    text = "\n".join(f"{_quoted(key)} = {toml(value)}" for key, value in made.tables.items())
    raw, names = text.encode("utf-8", "surrogatepass"), [way.__name__ for way in ways]
    if rng.random() < 0.1:
        raw, broken = spoil(text, rng)
        must, names = broken, ["spoil"]
    (folder / "project.toml").write_bytes(raw)
    os.mkfifo(folder / "pipe")
    for name, lines in made.beside.items():
        (folder / name).write_text("\n".join(lines), encoding="utf-8")
    return " and ".join(names), must


def fault_of(folder: Path, must_refuse: bool) -> tuple[str, int]:
    """Return what is wrong with how `pyblast check` takes a project, or nothing; its exit code."""
    code, seconds = checked(folder)
    said, told = ((folder / n).read_text(errors="replace") for n in ("out.txt", "err.txt"))
    words = PYTHON.search(said + told)
    sentences = [line for line in told.splitlines() if not line.startswith("pyblast: note: ")]
    if seconds > WAIT:
        return f"takes longer than {WAIT:g} s", code
    if code not in OUTCOMES or words:
        return f"ends with {code}: {told.strip()[-300:]!r}", code
    if code == 2 and (len(sentences) != 1 or not sentences[0].startswith("pyblast: ")):
        return f"says {len(sentences)} lines: {told[:300]!r}", code
    if not (said + told).replace("\n", "").isprintable():
        return f"says what terminals obey: {told[:300]!r}", code
    if code != 2 and must_refuse:
        return "is accepted, and must not be", code
    return (f"holds {UNREAL.search(said)[0]}" if UNREAL.search(said) else ""), code


def checked(folder: Path) -> tuple[int, float]:
    """Run `pyblast check` in a child process, which is killed if it is late; code and seconds."""
    began, child = time.monotonic(), os.fork()
    if child == 0:
        _check(folder)
    while (ended := os.waitpid(child, os.WNOHANG))[0] == 0:
        if time.monotonic() - began > WAIT:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -signal.SIGKILL, WAIT + 1.0
        time.sleep(0.01)
    return os.waitstatus_to_exitcode(ended[1]), time.monotonic() - began


def _check(folder):
    """Check a project in this process, and end it."""
    code = 1
    try:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.chdir(folder)
        for number, name in ((1, "out.txt"), (2, "err.txt")):
            os.dup2(os.open(name, os.O_WRONLY | os.O_CREAT), number)
        sys.argv[1:] = ["check", "project.toml"]
        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:  # what a process of its own would print
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def fuzz(number: int, seed: int, kept: Path) -> tuple[str, str]:
    """Check one drawn project; return its outcome, and the fault if there is one."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        names, must = write(folder, np.random.default_rng([seed, number]))
        fault, code = fault_of(folder, must)
        if fault:
            at = kept / f"project-{seed}-{number}"
            at.mkdir(parents=True, exist_ok=True)
            for file in folder.iterdir():
                if file.is_file():
                    (at / file.name).write_bytes(file.read_bytes())
            return "fault", f"{number} ({names}) {fault}"
        return OUTCOMES[code], ""
