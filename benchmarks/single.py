"""Marches in numbers of four bytes: how much quicker, and how near those in eight."""

from dataclasses import replace

import numpy as np

from pyblast.diagnosis import library  # noqa: F401  fills the library
from pyblast.diagnosis.hypotheses import LIBRARY
from pyblast.model.material import ConstantQ
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate

from .blind.sites import AFTER, BAND, DT, draw_site, project_of
from .marching import LEDGER_EVERY, Steps
from .timing import interleaved, median, on, ratio

TITLE = "Single precision"
BLAST, DRAWN, CLOSED = "B2", 31, 0.5  # as of the hexahedra of a diagnosis
QUALITY = 40.0, 20.0
SITES = {"quick": 1, "usual": 4, "long": 12}
NAMES = "double", "single"
ROUNDS = 40  # of a march, that fit into the records


def measure(effort):
    """Return ns of a node and step, their ratios, and the largest differences over the peak."""
    drawn = [project_of(draw_site(np.random.default_rng([DRAWN, n]))) for n in range(SITES[effort])]
    found = {}
    for law, changed in laws().items():
        models = [in_eight(changed(site)) for site in drawn]
        apart = max(difference(model) for model in models)
        found[law] = {**times(models[0]), "apart": apart}
    return found


def laws():
    """Return how a site is changed, by what its ground does."""
    closure = LIBRARY["joint_nonlinear_closure"]
    return {
        "linear joints": lambda site: site,
        "a joint that closes": lambda site: closure.apply(
            site, site.joints[0].surface, closed=CLOSED
        ),
        "constant Q": lambda site: site.changed(
            materials={
                name: replace(one, law=ConstantQ.around(*QUALITY, BAND))
                for name, one in site.materials.items()
            }
        ),
    }


def in_eight(site):
    """Return the model of the largest blast as a diagnosis runs it, but in eight bytes."""
    return site.changed(mesh=site.for_band(BAND[1])).of(BLAST).model


def difference(model):
    """Return the largest difference of motion of a run in four bytes, over the peak."""
    double, single = (simulate(replace(model, single=one), AFTER * DT) for one in (False, True))
    return max(
        np.abs(single.seismograms[name].velocity - record.velocity).max()
        / np.abs(record.velocity).max()
        for name, record in double.seismograms.items()
    )


def times(model):
    """Return ns of a node and step of one thread both ways, and their ratio."""
    ready = {name: prepare(replace(model, single=name == "single"), AFTER * DT) for name in NAMES}
    n_steps = LEDGER_EVERY * max(1, ready["double"].n_steps // LEDGER_EVERY // ROUNDS)
    took = interleaved({name: on(1, Steps(one, n_steps)) for name, one in ready.items()})
    count = n_steps * len(model.nodes.points) * 1e-9
    return {
        "nodes": len(model.nodes.points),
        **{f"ns, {name}": median(some) / count for name, some in took.items()},
        "ratio": ratio(took["double"], took["single"]),
    }


def lines(found):
    """Return the table of this part."""
    told = [
        "Sites drawn as in the blind benchmark, with the hexahedra of a diagnosis; one thread. "
        "Energies that pressure stores in closed joints are accurate to 1e-3 only.",
        "",
        "| ground | nodes | ns a node and step | single precision | times as fast "
        "| largest difference over the peak |",
        "|---|---|---|---|---|---|",
    ]
    for law, one in found.items():
        each = [f"{one[key]:.0f}" for key in ("nodes", "ns, double", "ns, single")]
        told.append(f"| {law} | {' | '.join(each)} | {one['ratio']:.2f} | {one['apart']:.0e} |")
    return told
