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
# Functions by what they do; the first of a list that a checkout has is counted.
BUILDERS = {
    "grounds built": ("make_ground", "mesh_ground"),
    "grounds surveyed": ("as_built",),
    "models built": ("model",),
    "records gathered": ("case_of", "records"),
}
HOMES = {
    "make_ground": ("project.elements", "simulation.recipe", "ground"),
    "mesh_ground": ("simulation.recipe", "simulation.simulation"),
    "as_built": ("mesh.as_built",),
    "model": ("project.project", "simulation.simulation"),
    "case_of": ("diagnosis.case",),
    "records": ("survey", "survey.survey"),
}
WALKS = "run", "diagnose", "load_project", "read_blast", "read_recording", "case_of", "make_ground"


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


def counting_reads(folder: Path) -> Counter:
    """Return a counter that counts from now on how often each file of a folder is opened."""
    reads, kinds = Counter(), kinds_of(folder)

    def hook(event, arguments):
        if event != "open" or not isinstance(arguments[0], (str, os.PathLike)):
            return
        path, mode = Path(arguments[0]), arguments[1]
        if path.name in kinds and (mode is None or "r" in mode) and path.parent.name == folder.name:
            reads[path.name] += 1

    sys.addaudithook(hook)
    return reads


def of_reads(job: str, reads: Counter, folder: Path) -> dict[str, int]:
    """Return the numbers of reads by kind of file, and the most of one file."""
    kinds, found = kinds_of(folder), {}
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


def profiled(job: str, folder: Path, order: list[str]) -> dict[str, int]:
    """Profile a job; return how often it does what, and its calls to packages above a caller."""
    do_, profile = (lambda: do(job, folder)), cProfile.Profile()
    reads = counting_reads(folder)
    profile.runcall(do_)
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
    for what, names in BUILDERS.items():
        each = [times[home, name] for name in names for home in HOMES[name]]
        found[f"{job}: {what}"] = sum(each)
    return found | of_reads(job, reads, folder)


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
    own = set(WALKS) - ({"diagnose"} if job == "run" else {"run"})

    def enter(frame):
        module = module_of(frame.f_code.co_filename)
        name = frame.f_code.co_name
        for events in open_walks.values():
            if module:
                callers = [each for each in stack if each]
                events.append((module, callers[-1] if callers else ""))
        stack.append(module)
        if module and name in own - set(open_walks) - set(done):
            open_walks[name] = [(module, "")]
            depths[name] = len(stack)

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
        if own <= set(done):
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
