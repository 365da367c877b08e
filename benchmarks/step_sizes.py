"""Steps of the blocky test: raw, repaired, with added mass; and what that mass does to motion."""

from dataclasses import replace

import numpy as np

from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.material import Damping
from pyblast.model.model import Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from pyblast.solver.time_step import critical_step, model_frequencies
from verification.step_limits import true_limit

from .blocky import blocky_mesh, blocky_model

TITLE = "Steps of a blocky mesh"
SIDES = ("west", "east", "south", "north", "bottom")
BUILDS = {
    "cut as mapped, not repaired": {"tolerance": 0.0, "optimize": False},
    "cuts bent to corners nearby": {"optimize": False},
    "and thin zones repaired": {},
}
SHARES = (0.001, 0.0025, 0.005)
DURATION = 0.12
FREQUENCIES = (10.0, 20.0, 40.0)


def measure(effort):
    """Return the steps of the meshes and of added masses, and by frequency what these do."""
    size = (40.0, 40.0, 30.0) if effort == "quick" else (100.0, 100.0, 60.0)
    builds = {}
    for name, options in BUILDS.items():
        mesh, report = blocky_mesh(size, **options)
        builds[name] = {
            "blocks": int(report.cells), "zones": len(mesh.zones),
            "slivers": int(report.slivers[1]),
            "dt_ms": 1e3 * critical_step(blocky_model(mesh, added_mass=0.0)).dt,
        }  # fmt: skip
    scaled = {}
    for share in SHARES:
        model = blocky_model(mesh, added_mass=share, step_factor=1.0)
        limit = critical_step(model)
        true = true_limit(prepare(model, 1e-3))
        added = limit.added_share["rock"]
        scaled[str(share)] = {
            "added": added, "dt_ms": 1e3 * limit.dt, "limit_ms": 1e3 * true,
            "local": local(model, limit),
        }  # fmt: skip
    effects = {} if effort == "quick" else {f"{f:g}": effect(mesh, f) for f in FREQUENCIES}
    return {"builds": builds, "scaled": scaled, "low_passed": low_passed(mesh), "effects": effects}


def local(model, limit):
    """Return how many times fewer steps of zones there would be, each by its own half, quarter...

    At most: neighbours that march together, and what joins them, are left out.
    """
    own = 2.0 / np.sqrt(model_frequencies(model))
    halved = np.floor(np.log2(np.maximum(own / limit.dt, 1.0)))
    return float(1.0 / np.mean(2.0**-halved))


def low_passed(mesh):
    """Return the step at 5 % of damping over that without any."""
    models = [
        blocky_model(mesh, damping=damping)
        for damping in (Damping(0.05, 4.0, corner=60.0), Damping(0.05, 4.0), None)
    ]
    low, lagged, free = (critical_step(model).dt for model in models)
    return {"low-passed": low / free, "lagged": lagged / free}


def effect(mesh, frequency):
    """Return median, ninth tenth and worst of the differences, by share, of waveforms and PPV."""
    return {
        str(share): np.quantile(parts, (0.5, 0.9, 1.0), axis=1).T.tolist()
        for share, parts in zip(SHARES, differences(mesh, frequency), strict=True)
    }


def pulse(frequency):
    """Return a Ricker wavelet of 0.1 m/s on all components."""
    time = np.arange(0.0, 2.5 / frequency, 1e-4)
    turn = (np.pi * frequency * (time - 1.1 / frequency)) ** 2
    return Seismogram(np.outer(0.1 * (1.0 - 2.0 * turn) * np.exp(-turn), [1.0, 0.7, 0.5]), 1e-4)


def receivers():
    """Return receivers on the top and at half height, away from the sides."""
    ways = np.linspace(15.0, 85.0, 6)
    places = [(x, y, z) for z in (60.0, 30.0) for y in ways for x in ways]
    return [Receiver(f"R{n}", place) for n, place in enumerate(places)]


def differences(mesh, frequency):
    """Return by share how far waveforms (L2) and PPVs are off those without, (n_shares, 2, n)."""
    sides = [*(Viscous(side) for side in SIDES), StressInput("west", pulse(frequency))]
    model = blocky_model(mesh, boundaries=sides, receivers=receivers())
    bare = simulate(replace(model, added_mass=0.0), DURATION).seismograms
    found = []
    for share in SHARES:
        scaled = simulate(replace(model, added_mass=share), DURATION).seismograms
        found.append(np.transpose([apart(bare[name], other) for name, other in scaled.items()]))
    return found


def apart(exact, other):
    """Return the relative L2 difference of two seismograms and that of their PPVs."""
    at = np.transpose([np.interp(other.times, exact.times, v) for v in exact.velocity.T])
    wave = np.linalg.norm(other.velocity - at) / np.linalg.norm(at)
    return wave, abs(np.abs(other.velocity).max() / np.abs(exact.velocity).max() - 1.0)


def lines(found):
    """Return the tables of this part."""
    raw = next(iter(found["builds"].values()))["dt_ms"]
    told = [
        "100 × 100 × 60 m of magnetite, joint sets of 75°/14 m, 80°/11 m and 20°/20 m, a fault, "
        "elastic",
        "joints of the mine's stiffness, edges of 5 m. Slivers are zones whose smallest "
        "altitude is below",
        "a tenth of their longest edge. The step is the bound that the program uses, before its",
        "factor of 0.8. Mass is limited by material, and to 20 times that share in one place: "
        "less than",
        "the limit may be added. The true limit is that of the assembled operator, by Lanczos "
        "iteration.",
        "",
        "| mesh | blocks | zones | slivers | step ms | over raw | true limit ms |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, one in found["builds"].items():
        told.append(
            f"| {name} | {one['blocks']} | {one['zones']} | {one['slivers']} | {one['dt_ms']:.4f} "
            f"| {one['dt_ms'] / raw:.1f} | |"
        )
    for share, one in found["scaled"].items():
        told.append(
            f"| with {100 * one['added']:.2f} % of mass added (limit {100 * float(share):g} %) "
            "| | | "
            f"| {one['dt_ms']:.3f} | {one['dt_ms'] / raw:.1f} | {one['limit_ms']:.3f} |"
        )
    *_, last = found["scaled"].values()
    told += [
        "",
        "Local steps, each zone's by halves of the longest, would leave at most "
        f"{last['local']:.2f} times fewer steps of zones after that; neighbours and the order of "
        "sums would cost part of it, so all zones have one step.",
    ]
    if "low_passed" in found:
        kept = ", ".join(f"{name} {part:.2f}" for name, part in found["low_passed"].items())
        told += ["", f"Of the step, damping of 5 % at 4 Hz leaves: {kept}."]
    told += [
        "",
        "Ricker wavelets enter through the west face. The same mesh with and without added mass,",
        f"{DURATION:g} s, 72 receivers on the top and at half height: L2 difference of waveforms",
        "(all components) and difference of PPV, as median / nine of ten / worst in %. The worst",
        "stands on a small block that took mass.",
        "",
        "| frequency | limit of added mass | waveform | PPV |",
        "|---|---|---|---|",
    ]
    for frequency, rows in found["effects"].items():
        for share, parts in rows.items():
            words = [" / ".join(f"{100 * value:.2f}" for value in row) for row in parts]
            told.append(f"| {frequency} Hz | {100 * float(share):g} % | {' | '.join(words)} |")
    return told
