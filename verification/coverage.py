"""Coverage of the intervals of a back-analysis, on sites recorded by an independent program.

    ./dev coverage [--minutes 25] [--again] [row ...]

Writes the table ``[back_analysis]`` for sites in ``PYBLAST_SITES`` as a user would from the papers,
fits blast B2, and only then reads the truth. ``verification/coverage.json`` has a row for each
site, set of unknowns, choice of receivers and seed; a study that was stopped goes on. Rows of one
site share their stored runs, so processor seconds are those of runs that no earlier row made.
"""

import os
import sys
import tempfile
import time
import tomllib
from pathlib import Path

import numpy as np
import obspy

from pyblast.back_analysis.findings import findings_of_fit
from pyblast.back_analysis.fit import Fitter, on_mesh_of_band
from pyblast.back_analysis.search import make_target
from pyblast.config.section import value_at
from pyblast.files import write_text
from pyblast.project.project import load_project
from pyblast.workflows.back_analysis import result_of_fit

from .markdown import reflow
from .rows import Rows, each_row, options, read_rows

ROOT = Path(__file__).resolve().parents[1]
PATH, PAGE = ROOT / "verification" / "coverage.json", ROOT / "docs" / "quality" / "intervals.md"
SITES = Path(os.environ.get("PYBLAST_SITES", ROOT.parent / "shared" / "sites"))
BLAST = "B2"
NULLS = ("18", "04", "19", "01", "13", "15")  # cheapest first
EFFECTS = ("06", "07", "08", "20", "03", "16")
RANGES = {"joints": (("kn", "ks"), 4.0), "speeds": (("cp", "cs"), 1.15)}  # up and down by a factor
SUBSETS = {"all": None, "5": 5, "3": 3}
WARNINGS = ("D43", "D44")


def row_names() -> list[str]:
    """Return the names of all rows: every site once first, then subsets and seeds."""
    once = [f"{site} both all 1" for site in (*NULLS[:4], *EFFECTS[:2])]
    others = [
        f"{site} {unknowns} {subset} {seed}"
        for site in NULLS
        for seed in (1, 2)
        for subset in SUBSETS
        for unknowns in ("both", "joints", "speeds")
    ]
    later = [f"{site} both all 1" for site in EFFECTS[2:]]
    names = [*once, *(name for name in others if _exists(name)), *later]
    return list(dict.fromkeys(names))


def _exists(name):
    """Tell whether a site has the unknowns of a row; one without joints has speeds alone."""
    site, unknowns, *_ = name.split()
    return unknowns == "both" or "joints" in _config(site)


def _config(site):
    """Return the tables of the project file of a site."""
    return tomllib.loads((SITES / f"case-{site}" / f"{BLAST}.toml").read_text(encoding="utf-8"))


def paths_of(site: str, unknowns: str) -> dict[str, tuple[float, float]]:
    """Return the ranges by path that a user would write for a site."""
    tables, ranges = {"joints": "joints", "speeds": "materials"}, {}
    for kind in RANGES if unknowns == "both" else (unknowns,):
        keys, factor = RANGES[kind]
        for entry, values in _config(site).get(tables[kind], {}).items():
            for key in values:
                if key.split("_")[0] in keys:
                    path = f"{tables[kind]}.{entry}.{key}"
                    ranges[path] = values[key] / factor, values[key] * factor
    return ranges


def judged(name: str, folder: Path) -> dict:
    """Fit one row and compare its intervals with the truth."""
    site, unknowns, subset, seed = name.split()
    source = folder / f"{site}-{seed}"
    if not source.exists():
        _copy_site(site, int(seed), source)
    project = source / "fit.toml"
    project.write_text(_project_text(site, unknowns, subset, int(seed)), encoding="utf-8")
    loaded = load_project(project)
    given = {path: float(str(value_at(loaded.config, path))) for path in paths_of(site, unknowns)}
    began, stored = time.process_time(), []
    target, table = make_target(loaded), loaded.config.back_analysis
    records = target.records
    assert records is not None  # the default misfit
    assert table is not None  # written above
    blasts = on_mesh_of_band(target.projects, records.band.high)
    fitter = Fitter(blasts, records, target.parameters, table.runs, folder / f"runs-{site}",
                    report=lambda row: stored.append(row["stored"]))  # fmt: skip
    result = result_of_fit(target, table, fitter.fit())
    spent = time.process_time() - began
    assert result.fit is not None  # of waveforms
    truth, intervals = truth_of(site), result.fit.intervals()
    warned = [f.code for f in findings_of_fit(result) if f.code in WARNINGS]
    values = {}
    for n, path in enumerate(given):
        low, high = (end / given[path] for end in intervals[path])
        values[path] = {
            "true": truth[path], "best": result.best[path] / given[path], "low": low,
            "high": high, "inside": low <= truth[path] <= high,
            "constraint": result.constraint(n),
        }  # fmt: skip
    held = [(row["parameter"], row["held"][0]["name"]) for row in result.fit.influences()]
    return {
        "site": site, "blasts": [BLAST], "receivers": subset, "seed": int(seed),
        "effect": site in EFFECTS, "values": values, "converged": result.fit.converged,
        "warned": warned, "error_level": result.fit.posterior.level, "runs": result.runs,
        "new_runs": stored.count(False), "processor_s": round(spent, 1), "most_held": dict(held),
    }  # fmt: skip


def _copy_site(site, seed, target):
    """Copy the site, with its own records for seed 1, else noise-free ones with other noise.

    The noise is what the records hold beside the noise-free ones, that of the next receiver,
    reversed in time.
    """
    source = SITES / f"case-{site}"
    target.mkdir(parents=True)
    (target / "records").mkdir()
    for file in [*source.glob("*.csv"), *source.glob(f"{BLAST}.toml")]:
        (target / file.name).write_bytes(file.read_bytes())
    files = sorted(source.glob(f"records/{BLAST}_*.mseed"))
    if seed == 1:
        for file in files:
            (target / "records" / file.name).write_bytes(file.read_bytes())
        return
    clean = obspy.read(SITES / "truth" / f"case-{site}" / f"clean_{BLAST}.mseed", format="MSEED")
    recorded = [obspy.read(file, format="MSEED") for file in files]
    noise = [
        {trace.stats.channel[-1]: (trace.data - _like(clean, trace))[::-1] for trace in stream}
        for stream in recorded
    ]
    for file, stream, other in zip(files, recorded, noise[1:] + noise[:1], strict=True):
        for trace in stream:
            noise_free = _like(clean, trace)
            trace.data = noise_free + other[trace.stats.channel[-1]][: len(noise_free)]
        stream.write(target / "records" / file.name, format="MSEED", encoding="FLOAT64")


def _like(clean, trace):
    """Return the noise-free samples beside a recorded trace."""
    wanted = next(
        t for t in clean
        if t.stats.station == trace.stats.station
        and t.stats.channel[-1] == trace.stats.channel[-1]
    )  # fmt: skip
    data = np.zeros(len(trace.data))
    n = min(len(data), len(wanted.data))
    data[:n] = wanted.data[:n]
    return data


def _project_text(site, unknowns, subset, seed):
    """Return the project file of a site with its table ``[back_analysis]``."""
    config = _config(site)
    names = [row["name"] for row in config["receivers"] if "recorded" in row]
    count = SUBSETS[subset]
    if count is not None:
        rng = np.random.default_rng([seed, len(names)])
        names = sorted(rng.choice(names, count, replace=False).tolist())
    lines = [(SITES / f"case-{site}" / f"{BLAST}.toml").read_text(encoding="utf-8")]
    lines += ["", "[back_analysis]", f"receivers = {names}"]
    for path, (low, high) in paths_of(site, unknowns).items():
        lines += ["[[back_analysis.parameters]]", f'path = "{path}"']
        lines += [f"low = {low:.6g}", f"high = {high:.6g}", "log = true"]
    return "\n".join(lines) + "\n"


def truth_of(site: str) -> dict[str, float]:
    """Return the true values of a site over those of its project file, by path."""
    truth = tomllib.loads((SITES / "truth" / f"case-{site}" / "truth.toml").read_text())
    config, factors = _config(site), {}
    layers = dict.fromkeys(layer["material"] for layer in config["mesh"]["layers"])
    for name, row in zip(layers, truth["nuisance"]["material_factors_rho_vp_vs"], strict=False):
        factors[f"materials.{name}.cp_m_per_s"], factors[f"materials.{name}.cs_m_per_s"] = row[1:]
    for name, row in zip(
        config.get("joints", {}), truth["nuisance"]["joint_factors_kn_ks"], strict=False
    ):
        keys = (f"joints.{name}.kn_gpa_per_m", f"joints.{name}.ks_gpa_per_m")
        factors |= dict(zip(keys, row, strict=True))
    return factors


def write_page(rows: Rows) -> None:
    """Write the table of rows into docs/quality/intervals.md."""
    head = "## Rows"
    text = PAGE.read_text(encoding="utf-8").partition(head)[0]
    nulls = [row for row in rows.values() if not row["effect"]]
    effects = [row for row in rows.values() if row["effect"]]
    inside = [v["inside"] for row in nulls for v in row["values"].values()]
    warned = sum(bool(row["warned"]) for row in effects)
    wrong = [
        f"{name}: {path}" for name, row in rows.items() for path, v in row["values"].items()
        if not v["inside"] and v["constraint"] == "well"
    ]  # fmt: skip
    lines = [
        head, "",
        f"Sites without an effect: {sum(inside)} of {len(inside)} intervals hold the truth "
        f"({100 * np.mean(inside or [0]):.0f} %). With an effect: {warned} of {len(effects)} "
        f"warned. Values outside that are called well constrained: {'; '.join(wrong) or 'none'}.",
        "", "| row | inside | converged | warned | error % | runs (new) | processor s |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for name, row in rows.items():
        held = [v["inside"] for v in row["values"].values()]
        lines.append(
            f"| {name} | {sum(held)} of {len(held)} | {'yes' if row['converged'] else 'no'} | "
            f"{', '.join(row['warned']) or '–'} | {100 * row['error_level']:.2g} | "
            f"{row['runs']} ({row['new_runs']}) | {row['processor_s']:.0f} |"
        )
    lines += [
        "",
        "A row is a site, the unknowns, the receivers and the seed of noise and receivers.",
        "",
    ]
    write_text(PAGE, reflow(text.rstrip() + "\n\n" + "\n".join(lines)))


def main(arguments: list[str]) -> None:
    """Compute the missing rows, and write the page."""
    names, how = options(arguments)
    keep = Path(os.environ.get("PYBLAST_COVERAGE", Path(tempfile.gettempdir()) / "coverage"))
    keep.mkdir(parents=True, exist_ok=True)
    try:
        each_row(PATH, names or row_names(), lambda name: judged(name, keep), **how)
    finally:
        write_page(read_rows(PATH))


if __name__ == "__main__":
    main(sys.argv[1:])
