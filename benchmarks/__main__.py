"""Measure what the program costs, and write the page.

    python -m benchmarks [PART ...] [--peers] [--quick] [--long]

Without names every part is measured but the peers, which are installed from their packages and
take ten minutes; ``--peers`` adds them. ``--quick`` tries each part once on small meshes, but the
mine, whose mesh takes too long, and keeps nothing; ``--long`` adds the finest meshes and the
largest studies. ``benchmarks/results.json`` keeps what is not measured now; the tables and figures
of docs/quality/performance.md follow from it.
"""

import json
import sys
import time
from pathlib import Path

from pyblast.files import write_text

from . import (
    accuracy,
    case,
    cuts,
    edges,
    held,
    kernels,
    laws,
    layer,
    mine,
    page,
    scale,
    single,
    slip,
    step_sizes,
    timing,
    waits,
    waves,
)
from .peers import beside

RESULTS = Path(__file__).with_name("results.json")
PARTS = {
    "kernels": kernels,
    "edges": edges,
    "laws": laws,
    "peers": beside,
    "steps": step_sizes,
    "mine": mine,
    "accuracy": accuracy,
    "scale": scale,
    "case": case,
    "cuts": cuts,
    "single": single,
    "layer": layer,
    "memory": held,
    "slip": slip,
    "waves": waves,
    "waits": waits,
}
WAITS = ("site", "check", "demo", "tests", "threads")
FLAGS = ("--peers", "--quick", "--long")


def main(arguments):
    """Measure what is asked for."""
    names = [a for a in arguments if a not in FLAGS]
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        sys.exit(f"bench: no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    if not names:
        slow = ("peers", "mine") if "--quick" in arguments else ("peers",)
        names = [name for name in PARTS if name not in slow]
    if "--peers" in arguments and "peers" not in names:
        names.append("peers")
    effort = "quick" if "--quick" in arguments else "long" if "--long" in arguments else "usual"
    results = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    if effort == "quick":
        timing.ROUNDS = 1
    for name in names:
        print(f"{name} ...", end=" ", flush=True)
        began = time.perf_counter()
        found = json.loads(json.dumps(PARTS[name].measure(effort), default=float))
        timing.threads(1)
        took = time.perf_counter() - began
        print(f"{took:.0f} s", flush=True)
        if effort == "quick":
            print("\n".join(PARTS[name].lines(found)))
            continue
        known = results.get(name, {}).get("found", {})
        results[name] = {
            **timing.stamp(), "seconds": round(took, 1), "found": {**known, **found},
        }  # fmt: skip
        _key_figures(name, results)
        if name == "waits":
            keep_waits(results, found)
        ordered = {part: results[part] for part in (*PARTS, *WAITS) if part in results}
        write_text(RESULTS, json.dumps(ordered, indent=1) + "\n")
    if effort != "quick":
        page.write(PARTS, results)


def _key_figures(part, results):
    """Put the key figures of a part where they are looked for, with machine, load and date."""
    found = results[part]["found"]
    said = {name: results[part][name] for name in ("machine", "load", "date")}
    if part == "waves":
        results.setdefault("accuracy", {"found": {}}).update(found["figures"])
        results["accuracy"].update({f"waves_{name}": value for name, value in said.items()})
    if part == "layer":
        results[part]["node_ratio"] = found["double"]["node_ratio"]
    if part == "slip":
        results[part]["error"] = found["error"]
    if part == "memory":
        results[part]["bytes_a_node"] = found["bytes_a_node"]
        results["threads"] = {"serial_share": found["serial_share"], **said}


def keep_waits(results, found):
    """Put what users wait for where it is looked for."""
    for name, one in found.items():
        if name == "mine" and name in results:  # beside the part of that name, with its own stamp
            said = {key: one[key] for key in ("machine", "load", "date")}
            results[name] |= {"file_to_report_s": one["file_to_report_s"]}
            results[name]["file_to_report_s_on"] = said
        else:
            results[name] = one


if __name__ == "__main__":
    main(sys.argv[1:])
