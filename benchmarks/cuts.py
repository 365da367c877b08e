"""Zones of a diagnosis: how near runs on coarser zones, corrected once, come to a finer mesh."""

import time
from dataclasses import replace

import numpy as np

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.calibration import calibrated_parameters, with_values
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.inference.records import band_functions
from pyblast.project.flat_box import Discretization, flat_box, flat_mesh, flat_model
from pyblast.runs.parallel import cached_run
from pyblast.workflows.diagnose import EDGE, FINE_EDGE, GROWTH, PADDING, cut_of

from .blind.sites import AFTER, BAND, DT, draw_site, project_of

TITLE = "Mesh of a diagnosis"
EDGES = 0.45, 0.5, 0.55, 0.6, 0.65, 0.75  # wavelengths of S at the top of the band
SITES = {"quick": 1, "usual": 6, "long": 20}
BLAST = "B2"
DRAWN = 31  # seed of the sites and of the signs
CLOSED = 0.5  # of the largest closure, at rest
SHARPER, WIDER = 0.79, 1.5  # edges and sponge of the finest zones over those of the finer mesh


def measure(effort):
    """Return, by edge, errors and changes of each site as shares of energy, and costs."""
    rows = {str(edge): [] for edge in EDGES}
    for number in range(SITES[effort]):
        rng = np.random.default_rng([DRAWN, number])
        sites = changed(project_of(draw_site(rng)), rng)
        finer = cut_of(sites[0], fine=True)
        fine, cost = heard(sites, finer)
        sharp = replace(finer, edge=SHARPER * finer.edge, padding=WIDER * finer.padding)
        finest, _ = heard(sites[:1], sharp)
        for edge in EDGES:
            found, took = heard(sites, cut(sites[0], edge))
            rows[str(edge)].append({"cost": took / cost, **errors(found, fine, finest[0])})
    return {"edges": rows, "chosen": EDGE, "fine": FINE_EDGE}


def changed(site, rng):
    """Return a site as it is believed, with all its values off by their sigmas, one closing."""
    unknowns = calibrated_parameters(site)
    signs = rng.choice([-1.0, 1.0], len(unknowns)) * [one.sigma for one in unknowns]
    closure = LIBRARY["joint_nonlinear_closure"]
    closing = closure.apply(site, site.joints[0].surface, closed=CLOSED)
    return site, with_values(site, unknowns, signs), closing


def cut(site, edge):
    """Return how a site is cut for the runs of a diagnosis, by zones of another edge."""
    known = cut_of(site)
    return replace(known, edge=known.edge * edge / EDGE)


def heard(sites, cut: Discretization):
    """Return motion (n_sites, n_receivers, 3, n_samples) in the band, and seconds a run."""
    mesh, found = flat_mesh(flat_box(sites[0]), cut), []
    began = time.process_time()
    for site in sites:
        run = cached_run(flat_model(site, BLAST, cut, mesh), DT * AFTER)
        found.append([run.seismograms[r.name].sampled(0.0, DT, AFTER).velocity.T
                      for r in site.receivers])  # fmt: skip
    band = band_functions(AFTER, DT, BAND)
    return np.array(found) @ band.basis, (time.process_time() - began) / len(sites)


def errors(found, fine, finest):
    """Return medians over receivers of shares of energy, for each change of the site.

    Last, what the finer mesh has wrong over what it changes, at the believed site.
    """
    corrected = found[1:] + fine[0] - found[0]
    whole = np.sum(fine[1:] ** 2, axis=(-2, -1))
    missed, moved = (
        np.sum(some**2, axis=(-2, -1)) / whole
        for some in (corrected - fine[1:], fine[1:] - fine[0])
    )
    bare, wrong = (
        np.sum((one - fine[0]) ** 2, axis=(-2, -1)) for one in (found[0], finest)
    )  # fmt: skip
    bare_share = bare / np.sum(fine[0] ** 2, axis=(-2, -1))
    return {
        "missed": np.median(missed, axis=1).tolist(),
        "moved": np.median(moved, axis=1).tolist(),
        "bare": float(np.median(bare_share)),
        "open": float(np.median(wrong / bare)),
    }


def lines(found):
    """Return the table of this part."""
    some = next(iter(found["edges"].values()))
    moved = np.median([row["moved"] for row in some], axis=0)
    told = [
        f"{len(some)} sites drawn as those of the blind benchmark, its largest blast, absorbing "
        "layer of "
        f"{PADDING:g} wavelengths with growth {GROWTH:g}; the finer mesh has {FINE_EDGE:g} and a "
        "layer twice as wide. Shares of energy, medians over receivers and sites: what a change of "
        f"the site changes ({moved[0]:.1%} by all its values off by a standard deviation, "
        f"{moved[1]:.1%} by a joint that closes), and what runs corrected at the reference model "
        f"miss of it. A diagnosis takes {found['chosen']:g}. The finer mesh is itself wrong by "
        f"what one with edges {SHARPER:g} times as long and a layer {WIDER:g} times as wide "
        "changes; "
        "as a share of the correction (`MESH_SHARE` of it counts as an error).",
        "",
        "| edge, wavelengths | missed, values off | missed, closing joint | missed without the "
        "correction | wrong in the finer mesh, of that | time of a run over the finer mesh's |",
        "|---|---|---|---|---|---|",
    ]
    for edge, rows in found["edges"].items():
        missed = np.median([row["missed"] for row in rows], axis=0)
        bare, cost, wrong = (
            np.median([row[key] for row in rows]) for key in ("bare", "cost", "open")
        )
        told.append(f"| {edge} | {missed[0]:.2%} | {missed[1]:.2%} | {bare:.1%} | {wrong:.2f} "
                    f"| {cost:.3f} |")  # fmt: skip
    return told
