"""Null cases of an independent finite-difference program against pyblast, on three meshes.

    python verification/independent_null.py [FOLDER OF CASES]

Writes ``verification/independent_null.json`` and ``docs/figures/independent_null.png``. Twice for
each case: with the site as it is believed, which is what a user would get, and with the true
nuisances (velocities, stiffnesses, places, times), where only method and mesh differ.
"""

import json
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np

from pyblast.motion.comparison import compare
from pyblast.projects.site import read_site, site_mesh, site_model
from pyblast.records.recordings import read_stations
from pyblast.solving.materials import Material
from pyblast.solving.solver import run

matplotlib.use("Agg")
import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parents[1]
CASES = ("case-11", "case-10")
EDGES = (12.0, 8.0, 5.5)
DURATION = 1.2


def true_site(cases, site):
    """Return a site with its true nuisances, and its records without noise."""
    folder = cases / "truth" / site.name
    truth = tomllib.loads((folder / "truth.toml").read_text())
    nuisance = truth["nuisance"]
    layers = tuple(
        (name, thickness, Material.from_speeds(m.density * rho, m.cp * vp, m.cs * vs))
        for (name, thickness, m), (rho, vp, vs) in zip(
            site.layers, nuisance["material_factors_rho_vp_vs"], strict=True
        )
    )
    joints = tuple(
        replace(j, joint=replace(j.joint, properties={
            "kn": j.joint.properties["kn"] * kn, "ks": j.joint.properties["ks"] * ks}))
        for j, (kn, ks) in zip(site.joints, nuisance["joint_factors_kn_ks"], strict=True)
    )  # fmt: skip
    receivers = tuple(
        replace(r, position=(r.position[0] + x, r.position[1] + y, min(0.0, r.position[2] + z)))
        for r, (x, y, z) in zip(site.receivers, nuisance["receiver_offsets_m"], strict=True)
    )
    blasts, records = {}, {}
    for name, blast in site.blasts.items():
        times = blast.times + np.array(nuisance["hole_time_s"][name])
        blasts[name] = replace(blast, times=np.maximum(times, 0.0))
        zero = site.time_zeros[name]
        records[name] = read_stations(folder / f"clean_{name}.mseed", time_zero=zero)
    changed = replace(
        site, layers=layers, joints=joints, receivers=receivers, blasts=blasts, records=records
    )
    return changed, truth


def misfits(site, blast, edge):
    """Run one blast; return misfit by receiver, the seismograms and what the run cost."""
    done = run(site_model(site, blast, site_mesh(site, edge), edge), DURATION)
    found = {
        name: compare(
            recording.seismogram, done.seismograms[name], site.band, time_frequency=False
        ).total_waveform_misfit
        for name, recording in site.records[blast].items()
    }
    cost = {
        "zones": len(done.prepared.constants["zone_volume"]),
        "steps": done.prepared.n_steps,
        "wall_s": round(done.wall_seconds, 1),
        "balance_error": done.balance_error,
    }
    return found, done.seismograms, cost


def study(cases):
    """Run all cases, blasts and meshes."""
    rows, pictures = [], {}
    for case in CASES:
        believed = read_site(cases / case)
        true, truth = true_site(cases, believed)
        for blast in ("S1", "B2"):
            for site, kind in ((believed, "believed"), (true, "true")):
                for edge in EDGES:
                    found, seismograms, cost = misfits(site, blast, edge)
                    row = {
                        "case": case, "blast": blast, "site": kind, "edge_m": edge, **cost,
                        "median": float(np.median(list(found.values()))),
                        "per_receiver": {n: round(v, 5) for n, v in found.items()},
                        "independent_believed": truth["misfit_believed"][blast]["median"],
                        "noise_alone": truth["misfit_floor_true_no_noise"][blast]["median"],
                    }  # fmt: skip
                    rows.append(row)
                    print(case, blast, kind, edge, f"{row['median']:.4f}", cost, flush=True)
                    pictures[case, blast, kind] = (site, seismograms)
    return rows, pictures


def draw(rows, pictures, path):
    """Draw misfit against edge, and seismograms of the finest mesh over the records."""
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.5), layout="constrained")
    for case, blast in dict.fromkeys((r["case"], r["blast"]) for r in rows):
        for kind, style in (("believed", "o-"), ("true", "s--")):
            chosen = [r for r in rows if (r["case"], r["blast"], r["site"]) == (case, blast, kind)]
            edges = [r["edge_m"] for r in chosen]
            axes[0].loglog(edges, [100 * r["median"] for r in chosen], style,
                           label=f"{case} {blast}, {kind} site")  # fmt: skip
    axes[0].axhspan(1.2, 2.5, color="0.9", label="believed site in the independent program")
    axes[0].set(xlabel="edge of the cells [m]", ylabel="median misfit, 3-30 Hz [% of energy]")
    axes[0].legend(fontsize=7)
    for axis, key in zip(axes[1:], (("case-11", "S1", "believed"), ("case-10", "B2", "believed")),
                         strict=True):  # fmt: skip
        site, seismograms = pictures[key]
        for row, name in enumerate(list(seismograms)[:6]):
            data = site.records[key[1]][name].seismogram.bandpassed(*site.band)
            scale = 0.45 / np.max(np.abs(data.velocity))
            model = seismograms[name].bandpassed(*site.band)
            axis.plot(data.times, row + scale * data.velocity[:, 2], "k", lw=1.6)
            axis.plot(model.times, row + scale * model.velocity[:, 2], "r", lw=0.9)
        axis.set(xlim=(0, 0.6), xlabel="time [s]", yticks=range(6),
                 yticklabels=list(seismograms)[:6],
                 title=f"{key[0]} {key[1]}: vertical, recorded black, pyblast red")  # fmt: skip
    figure.savefig(path, dpi=110)


def main():
    """Run the study and write its results."""
    cases = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT.parent / "shared" / "cases"
    if not (cases / CASES[0] / "site.toml").is_file():
        print(f"independent_null: skipped, no case folders in {cases}")
        return
    rows, pictures = study(cases)
    out = ROOT / "verification" / "independent_null.json"
    out.write_text(json.dumps(rows, indent=1) + "\n")
    (ROOT / "docs" / "figures").mkdir(exist_ok=True)
    draw(rows, pictures, ROOT / "docs" / "figures" / "independent_null.png")
    print(f"independent_null: {out.name} and docs/figures/independent_null.png written")


if __name__ == "__main__":
    main()
