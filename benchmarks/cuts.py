"""Hexahedra of a diagnosis: how near coarse runs, corrected once, come to a finer mesh."""

import time

import numpy as np

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.inference.parameter import set_all
from pyblast.inference.records import band_functions
from pyblast.project.uncertain_ground import factors_of
from pyblast.runs.parallel import cached_run
from pyblast.simulation.recipe import FINER_ERROR, OF_FITS

from .blind.sites import AFTER, BAND, DT, draw_site, project_of

TITLE = "Mesh of a diagnosis"
ACCURACIES = 0.005, 0.01, 0.015, 0.03  # as of `Project.for_band`
SITES = {"quick": 1, "usual": 6, "long": 20}
BLAST = "B2"
DRAWN = 31  # seed of the sites and of the signs
CLOSED = 0.5  # of the largest closure, at rest
FINEST = 0.2  # error of the finest mesh over that of the finer one, by the rule


def measure(effort):
    """Return, by accuracy, errors and changes of each site as shares of energy, and costs."""
    rows = {str(accuracy): [] for accuracy in ACCURACIES}
    for number in range(SITES[effort]):
        rng = np.random.default_rng([DRAWN, number])
        sites = changed(project_of(draw_site(rng)), rng)
        fine, cost = heard(sites, FINER_ERROR * OF_FITS)
        finest, _ = heard(sites[:1], FINEST * FINER_ERROR * OF_FITS)
        for accuracy in ACCURACIES:
            found, took = heard(sites, accuracy)
            rows[str(accuracy)].append({"cost": took / cost, **errors(found, fine, finest[0])})
    return {"accuracies": rows, "chosen": OF_FITS, "fine": FINER_ERROR * OF_FITS}


def changed(site, rng):
    """Return a site as it is believed, with all its values off by their sigmas, one closing."""
    unknowns = factors_of(site)
    signs = rng.choice([-1.0, 1.0], len(unknowns)) * [one.sigma for one in unknowns]
    closure = LIBRARY["joint_nonlinear_closure"]
    closing = closure.apply(site, site.joints[0].surface, closed=CLOSED)
    return site, set_all(site, unknowns, np.exp(signs)), closing


def heard(sites, accuracy):
    """Return motion (n_sites, n_receivers, 3, n_samples) in the band, and seconds a run."""
    mesh, found = sites[0].for_band(BAND[1], accuracy), []
    began = time.process_time()
    for site in sites:
        own = site.changed(mesh=mesh).of(BLAST)
        run = cached_run(own.model, DT * AFTER)
        found.append([run.seismograms[r.name].sampled(own.lead, DT, AFTER).velocity.T
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
    some = next(iter(found["accuracies"].values()))
    moved = np.median([row["moved"] for row in some], axis=0)
    told = [
        f"{len(some)} sites drawn as in the blind benchmark, their largest blast, hexahedra with "
        f"an absorbing layer; the finer mesh has an accuracy of {found['fine']:g} by the rule "
        "of nodes per wavelength. Shares of energy, medians over receivers and sites: what a "
        f"change of the site changes ({moved[0]:.1%} if all its values are off by a standard "
        f"deviation, {moved[1]:.1%} if a joint closes), and what runs corrected at the reference "
        f"model miss of that change. A diagnosis uses {found['chosen']:g}. The error of the finer "
        f"mesh is its difference from a mesh with {FINEST:g} of its error, as a share of the "
        "correction (`MESH_SHARE` of the correction counts as an error).",
        "",
        "| accuracy | missed, values off | missed, closing joint | missed without the "
        "correction | wrong in the finer mesh, of that | time of a run over the finer mesh's |",
        "|---|---|---|---|---|---|",
    ]
    for accuracy, rows in found["accuracies"].items():
        missed = np.median([row["missed"] for row in rows], axis=0)
        bare, cost, wrong = (
            np.median([row[key] for row in rows]) for key in ("bare", "cost", "open")
        )
        told.append(f"| {accuracy} | {missed[0]:.2%} | {missed[1]:.2%} | {bare:.2%} | {wrong:.2f} "
                    f"| {cost:.3f} |")  # fmt: skip
    return told
