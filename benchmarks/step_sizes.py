"""Steps of the blocky test: raw, repaired, with implicit zones; and what these do to motion."""

import numpy as np

from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.material import Damping
from pyblast.model.model import Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from pyblast.solver.time_step import critical_step, model_frequencies
from verification.step_limits import explicit, true_limit

from .blocky import blocky_mesh, blocky_model

TITLE = "Steps of a blocky mesh"
SIDES = ("west", "east", "south", "north", "bottom")
BUILDS = {
    "cut as mapped, not repaired": {"tolerance": 0.0, "optimize": False},
    "cuts bent to corners nearby": {"optimize": False},
    "and thin zones repaired": {},
}
DURATION = 0.12
FREQUENCIES = (20.0,)


def measure(effort):
    """Return the steps of the meshes and with implicit zones, and by frequency what these do."""
    size = (40.0, 40.0, 30.0) if effort == "quick" else (100.0, 100.0, 60.0)
    builds = {}
    for name, options in BUILDS.items():
        mesh, report = blocky_mesh(size, **options)
        limit = critical_step(blocky_model(mesh))
        builds[name] = {
            "blocks": int(report.cells), "zones": len(mesh.zones),
            "slivers": int(report.slivers[1]), "dt_ms": 1e3 * limit.explicit,
            "implicit": int(limit.implicit.zones.sum()), "implicit_dt_ms": 1e3 * limit.dt,
        }  # fmt: skip
    model = blocky_model(mesh, step_factor=1.0)
    effects = {} if effort == "quick" else {f"{f:g}": effect(mesh, f) for f in FREQUENCIES}
    return {
        "builds": builds, "local": local(model, critical_step(model)),
        "explicit_limit_ms": 1e3 * true_limit(explicit(model)),
        "low_passed": low_passed(mesh), "effects": effects,
    }  # fmt: skip


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
    low, lagged, free = (critical_step(model).explicit for model in models)
    return {"low-passed": low / free, "lagged": lagged / free}


def effect(mesh, frequency):
    """Return median, ninth tenth and worst of the differences of waveforms and PPV, (2, 3)."""
    return np.quantile(differences(mesh, frequency), (0.5, 0.9, 1.0), axis=1).T.tolist()


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
    """Return how far waveforms (L2) and PPVs are off those without implicit zones, (2, n)."""
    sides = [*(Viscous(side) for side in SIDES), StressInput("west", pulse(frequency))]
    model = blocky_model(mesh, boundaries=sides, receivers=receivers())
    bare = simulate(model, DURATION, prepared=explicit(model, DURATION)).seismograms
    own = simulate(model, DURATION).seismograms
    return np.transpose([apart(bare[name], other) for name, other in own.items()])


def apart(exact, other):
    """Return the relative L2 difference of two seismograms and that of their PPVs."""
    at = np.transpose([np.interp(other.times, exact.times, v) for v in exact.velocity.T])
    wave = np.linalg.norm(other.velocity - at) / np.linalg.norm(at)
    return wave, abs(np.abs(other.velocity).max() / np.abs(exact.velocity).max() - 1.0)


def lines(found):
    """Return the tables of this part."""
    raw = next(iter(found["builds"].values()))["dt_ms"]
    text = [
        "100 × 100 × 60 m of magnetite, joint sets of 75°/14 m, 80°/11 m and 20°/20 m, a fault, "
        "elastic joints of the mine's stiffness, edges of 5 m. Slivers are zones whose smallest "
        "altitude is below a tenth of their longest edge. The step is the bound that the program "
        "uses, before its factor of 0.8, with all zones explicit and with the smallest implicit. "
        "The true limit of the last mesh with all zones explicit is that of the assembled "
        f"operator, by Lanczos iteration: {found['explicit_limit_ms']:.4f} ms.",
        "",
        "| mesh | blocks | zones | slivers | explicit step ms | over raw | implicit zones "
        "| step ms | over raw |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, one in found["builds"].items():
        text.append(
            f"| {name} | {one['blocks']} | {one['zones']} | {one['slivers']} | {one['dt_ms']:.4f} "
            f"| {one['dt_ms'] / raw:.1f} | {one['implicit']} | {one['implicit_dt_ms']:.4f} "
            f"| {one['implicit_dt_ms'] / raw:.1f} |"
        )
    shares = ", ".join(f"{name} {part:.2f}" for name, part in found["low_passed"].items())
    text += [
        "",
        "Local time steps, the longest halved as often as each zone needs, would leave at most "
        f"{found['local']:.2f} times fewer zone steps after that; neighbours and the order of "
        "sums would cost part of this gain, so all zones share one step.",
        "",
        f"Of the explicit step, damping of 5 % at 4 Hz leaves: {shares}.",
        "",
        "Ricker wavelets enter through the west face. The same mesh with and without implicit "
        f"zones, {DURATION:g} s, 72 receivers on the top and at half height: L2 difference of "
        "waveforms (all components) and difference of PPV, as median / 90th percentile / worst, "
        "in %.",
        "",
        "| frequency | waveform | PPV |",
        "|---|---|---|",
    ]
    for frequency, parts in found["effects"].items():
        words = [" / ".join(f"{100 * value:.2f}" for value in row) for row in parts]
        text.append(f"| {frequency} Hz | {' | '.join(words)} |")
    return text
