"""What joints, strength and damping add to the elastic step, alone and in batches of eight.

Each law marches as the program chooses; the elastic step is that by springs along edges, and the
same ground marched zone by zone is timed beside it.
"""

from dataclasses import replace

from pyblast.model.material import ConstantQ, Damping, MohrCoulomb
from pyblast.solver.edge_springs import ALWAYS_USED, BATCH_ONLY

from .marching import (
    LEDGER_EVERY,
    ROCK,
    March,
    by_zones,
    cube,
    prepared,
    rock_model,
    rounds_of_ledger,
)
from .timing import interleaved, median, on, ratio

TITLE = "Laws"
CELLS, EVERY = 31, 5  # joints each five cells along all axes: 0.19 facets a zone
ZONE_STEPS = 4_000_000
ZONES = "elastic, by zones"
WAYS = {0: "zones", BATCH_ONLY: "zones, edges in batches", ALWAYS_USED: "edges"}
STRONG = {"cohesion": 1e9, "friction": 0.7, "tension": 1e9}


def measure(effort):
    """Return the time of steps with each law over that of the elastic step."""
    cells = 16 if effort == "quick" else CELLS
    intact, cut = cube(cells), cube(cells, EVERY)
    found = {
        "zones": len(intact.zones),
        "contacts_a_zone": len(cut.contacts.area) / len(cut.zones),
        "facets_a_zone": 3.0 * ((cells - 1) // EVERY) * 2.0 * cells**2 / len(cut.zones),
    }
    steps = rounds_of_ledger(len(intact.zones), ZONE_STEPS)
    every = {law: prepared(model, steps) for law, model in laws(intact, cut).items()}
    every = {"elastic": every["elastic"], ZONES: by_zones(every["elastic"]), **every}
    found["by"] = {law: way(one.constants) for law, one in every.items()}
    for name, over, lanes in (("single", "by zones", False), ("batch", "batch by zones", True)):
        some = LEDGER_EVERY if lanes else steps
        works = {law: on(1, March(model, some, lanes)) for law, model in every.items()}
        took = interleaved(works)
        found[name] = {law: ratio(times, took["elastic"]) for law, times in took.items()}
        found[over] = {law: ratio(times, took[ZONES]) for law, times in took.items()}
        found[f"ns, {name}"] = (
            1e9 * median(took["elastic"]) / some / len(intact.zones) / (8 if lanes else 1)
        )
    return found


def way(constants):
    """Return how the zones of a model march."""
    return ", ".join(dict.fromkeys(WAYS[form] for form in constants["set_form"]))


def laws(intact, cut):
    """Return a model for each law; none of them slips, opens or yields."""
    strong = replace(ROCK, **STRONG, law=MohrCoulomb())
    fading = replace(ROCK, law=ConstantQ(40.0, 20.0, (1.0, 30.0)))
    return {
        "elastic": rock_model(intact),
        "elastic joints": rock_model(cut),
        "coulomb joints": rock_model(cut, "coulomb"),
        "Mohr-Coulomb, not yielding": rock_model(intact, material=strong),
        "constant Q": rock_model(intact, material=fading),
        "Rayleigh, mass only": rock_model(intact, damping=Damping(0.02, 10.0, stiffness=False)),
        "Rayleigh, low-passed": rock_model(intact, damping=Damping(0.02, 10.0, corner=150.0)),
        "Rayleigh, lagged": rock_model(intact, damping=Damping(0.02, 10.0)),
    }


def lines(found):
    """Return the table of this part."""
    told = [
        f"Time of a step relative to the elastic one, by edges ({found['ns, single']:.1f} ns a "
        f"zone, {found['ns, batch']:.1f} ns in a batch of 8) and by zones; one thread, "
        f"{found['zones']} zones; joints at {found['facets_a_zone']:.2f} facets and "
        f"{found['contacts_a_zone']:.2f} contacts per zone. Each law runs as the program chooses.",
        "",
        "| law | runs by | over edges | over zones | batch of 8 over edges | over zones |",
        "|---|---|---|---|---|---|",
    ]
    for law, by in found["by"].items():
        each = (found[way][law] for way in ("single", "by zones", "batch", "batch by zones"))
        told.append(f"| {law} | {by} | {' | '.join(f'{one:.2f}' for one in each)} |")
    return told
