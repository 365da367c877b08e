"""What one run or one diagnosis does how often, counted from outside the program.

    python -P verification/house_walks.py JOB FOLDER PACKAGES

Runs by itself in the interpreter of any checkout and imports nothing else of it than pyblast.
JOB is ``run``, ``diagnose`` or ``walks``, FOLDER the case of examples/04_hidden_closure.py,
PACKAGES the order of the packages from the ground up, with commas. Prints one line of JSON.
"""

import cProfile
import json
import os
import pstats
import sys
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

import pyblast

PACKAGE = Path(pyblast.__file__).parent
FIRST = 300  # calls of a walk that are followed
# What is counted and walked, with the functions that do it, ``module:name``: those of this tree,
# and those of older ones.
COUNTED = {
    "grounds built": ("simulation.recipe:mesh_ground", "project.elements:make_ground"),
    "grounds surveyed": ("mesh.as_built:as_built",),
    "models built": ("project.project:model",),
    "records gathered": ("survey:records", "diagnosis.case:case_of"),
}
WALKED = {
    "run": ("workflows.run:run",),
    "diagnose": ("workflows.diagnose:diagnose",),
    "load_project": ("project.project:load_project",),
    "read_blast": ("blasts.hole_tables:read_blast",),
    "read_recording": ("recordings.recording:read_recording",),
    "case_of": COUNTED["records gathered"],
    "make_ground": COUNTED["grounds built"],
}


def kinds_of(folder: Path) -> dict[str, str]:
    """Return the kind of each file that the project files of a folder name."""
    kinds = {}
    for path in sorted(folder.glob("*.toml")):
        kinds[path.name] = "project file"
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
        kinds |= {table["file"]: "hole table" for table in _tables(tables, "blast", "blasts")}
        for receiver in tables.get("receivers", []):
            if "recorded" in receiver:
                kinds[receiver["recorded"]["file"]] = "recording"
    return kinds


def _tables(tables, *names):
    """Return the tables of such names, single ones and lists, that name a file."""
    found = []
    for name in names:
        table = tables.get(name, [])
        found += table if isinstance(table, list) else [table]
    return [table for table in found if "file" in table]


def counting_reads(folder: Path, kinds: dict[str, str]) -> Counter:
    """Return a counter that counts from now on how often each file of a folder is opened."""
    reads = Counter()

    def hook(event, arguments):
        if event != "open" or not isinstance(arguments[0], (str, os.PathLike)):
            return
        path, mode = Path(arguments[0]), arguments[1]
        if path.name in kinds and (mode is None or "r" in mode) and path.parent.name == folder.name:
            reads[path.name] += 1

    sys.addaudithook(hook)
    return reads


def of_reads(job: str, reads: Counter, kinds: dict[str, str]) -> dict[str, int]:
    """Return the numbers of reads by kind of file, and the most of one file."""
    found = {}
    for kind in ("project file", "hole table", "recording"):
        names = [name for name in reads if kinds[name] == kind]
        found[f"{job}: {kind}s"] = len(names)
        found[f"{job}: reads of {kind}s"] = sum(reads[name] for name in names)
    return found | {f"{job}: most reads of a file": max(reads.values(), default=0)}


def do(job: str, folder: Path) -> None:
    """Run or diagnose the case once, without stored runs."""
    with tempfile.TemporaryDirectory() as out:
        if job == "run":
            pyblast.run(folder / "B2.toml", Path(out) / "out")
        else:
            pyblast.diagnose(folder / "S1.toml", Path(out) / "out")


def module_of(filename: str) -> str | None:
    """Return the dotted name of a file of the package, None of any other file."""
    if not filename.startswith(f"{PACKAGE}{os.sep}"):
        return None
    return filename[len(str(PACKAGE)) + 1 : -3].replace(os.sep, ".").removesuffix(".__init__")


def is_there(function: str) -> bool:
    """Return whether the package has a function ``module:name``."""
    module, name = function.split(":")
    path = PACKAGE / f"{module.replace('.', '/')}.py"
    return path.is_file() and f"def {name}(" in path.read_text(encoding="utf-8")


def profiled(job: str, folder: Path, order: list[str]) -> dict[str, int | None]:
    """Profile a job; return how often it does what, and its calls to packages above a caller."""
    profile, kinds = cProfile.Profile(), kinds_of(folder)
    reads = counting_reads(folder, kinds)
    profile.runcall(do, job, folder)
    calls, upwards, times = 0, 0, Counter()
    for (file, _, name), (_, count, _, _, callers) in pstats.Stats(profile).stats.items():
        module = module_of(file)
        if module is None:
            continue
        calls += count
        times[module, name] += count
        rank = order.index(module.split(".")[0]) if module.split(".")[0] in order else -1
        for (from_file, _, _), about in callers.items():
            caller = module_of(from_file)
            if caller and caller.split(".")[0] in order:
                upwards += about[0] * (order.index(caller.split(".")[0]) < rank)
    found = {f"{job}: calls": calls, f"{job}: calls of a package above": upwards}
    for what, functions in COUNTED.items():
        there = [each for each in functions if is_there(each)]
        found[f"{job}: {what}"] = sum(times[tuple(each.split(":"))] for each in there)
        if not there:
            found[f"{job}: {what}"] = None
            print(f"house: {what}: by which function? Name it in {__file__}", file=sys.stderr)
    return found | of_reads(job, reads, kinds)


class Walked(BaseException):
    """Every walk that a job contains was followed to its end, or as far as walks go."""


def climbs_of(events: list[tuple[str, str]]) -> tuple[int, int, int]:
    """Return stays, rooms and climbs of a walk.

    Parameters
    ----------
    events : list of (str, str)
        Module of each call in turn and that of its caller.

    Returns
    -------
    stays, rooms, climbs : int
        Stretches of calls within one module; modules; stretches that another module begins than
        that of the stretch before, since this one was left by returning to a caller.
    """
    stays, climbs, last = 0, 0, None
    for module, caller in events:
        if module != last:
            stays += 1
            climbs += last is not None and caller != last
        last = module
    return stays, len({module for module, _ in events}), climbs


def walks(job: str, folder: Path) -> dict[str, str]:
    """Follow the first calls of each walk in a job; return stays, rooms and climbs as text."""
    open_walks, done, stack = {}, {}, []
    own = {
        tuple(function.split(":")): walk
        for walk, functions in WALKED.items()
        for function in functions
        if walk not in {"run", "diagnose"} - {job} and is_there(function)
    }

    def enter(frame):
        module = module_of(frame.f_code.co_filename)
        walk = own.get((module, frame.f_code.co_name))
        for events in open_walks.values():
            if module:
                callers = [each for each in stack if each]
                events.append((module, callers[-1] if callers else ""))
        stack.append(module)
        if walk and walk not in open_walks and walk not in done:
            open_walks[walk] = [(module, "")]
            depths[walk] = len(stack)

    def close(name):
        done[name] = open_walks.pop(name)

    def follow(frame, event, _):
        if event == "call":
            enter(frame)
        elif event == "return" and stack:
            for name in [n for n in open_walks if depths[n] == len(stack)]:
                close(name)
            stack.pop()
        for name in [n for n, events in open_walks.items() if len(events) >= FIRST]:
            close(name)
        if set(own.values()) <= set(done):
            sys.setprofile(None)
            raise Walked

    depths: dict[str, int] = {}
    sys.setprofile(follow)
    try:
        do(job, folder)
    except Walked:
        pass
    finally:
        sys.setprofile(None)
    return {
        f"walk of {name}": "{} / {} / {}".format(*climbs_of(events))
        + (" (cut)" if len(events) >= FIRST else "")
        for name, events in done.items()
    }


if __name__ == "__main__":
    job, case, packages = sys.argv[1], Path(sys.argv[2]), sys.argv[3].split(",")
    if job == "walks":
        print(json.dumps(walks("run", case) | walks("diagnose", case)))
    else:
        print(json.dumps(profiled(job, case, packages)))
