"""Steps of the blocky test: raw, repaired, with added mass; and what that mass does to motion.

    python -m benchmarks.step_sizes

Writes docs/step_sizes.md.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.motion.seismogram import Seismogram
from pyblast.solving.boundaries import StressInput, Viscous
from pyblast.solving.model import Receiver
from pyblast.solving.preparation import prepare
from pyblast.solving.solver import run
from pyblast.solving.stability import critical_step
from verification.step_limits import true_limit

from .blocky import blocky_mesh, blocky_model

PAGE = Path(__file__).resolve().parents[1] / "docs" / "step_sizes.md"
SIDES = ("west", "east", "south", "north", "bottom")
BUILDS = {
    "cut as mapped, not repaired": {"tolerance": 0.0, "optimize": False},
    "cuts bent to corners nearby": {"optimize": False},
    "and thin zones repaired": {},
}
SHARES = (0.001, 0.0025, 0.005)
DURATION = 0.12
WORDS = """# Steps of a blocky mesh

Written by `python -m benchmarks.step_sizes`. 100 × 100 × 60 m of magnetite, joint sets of 75°/14 m,
80°/11 m and 20°/20 m, a fault, elastic joints of the mine's stiffness, edges of 5 m.

## Step sizes

"""


def steps():
    """Return rows of (mesh, share, step, share added, limit over bound); steps in ms."""
    rows, mesh = [], None
    for name, options in BUILDS.items():
        mesh, report = blocky_mesh(**options)
        limit = critical_step(blocky_model(mesh, added_mass=0.0))
        rows.append((name, report.cells, len(mesh.zones), report.slivers[1], limit.dt))
    scaled = []
    for share in SHARES:
        model = blocky_model(mesh, added_mass=share, step_factor=1.0)
        limit = critical_step(model)
        true = true_limit(prepare(model, 1e-3))
        scaled.append((share, limit.added_share["rock"], limit.dt, true))
    return mesh, rows, scaled


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
    bare = run(replace(model, added_mass=0.0), DURATION).seismograms
    found = []
    for share in SHARES:
        scaled = run(replace(model, added_mass=share), DURATION).seismograms
        found.append(np.transpose([apart(bare[name], other) for name, other in scaled.items()]))
    return found


def apart(exact, other):
    """Return the relative L2 difference of two seismograms and that of their PPVs."""
    at = np.transpose([np.interp(other.times, exact.times, v) for v in exact.velocity.T])
    wave = np.linalg.norm(other.velocity - at) / np.linalg.norm(at)
    return wave, abs(np.abs(other.velocity).max() / np.abs(exact.velocity).max() - 1.0)


def write(rows, scaled, effects):
    """Write the page."""
    raw = rows[0][-1]
    lines = [
        "| mesh | blocks | zones | slivers | step ms | over raw |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {name} | {blocks} | {zones} | {slivers} | {1e3 * dt:.4f} | {dt / raw:.1f} |"
        for name, blocks, zones, slivers, dt in rows
    ]
    lines += [
        f"| with {100 * added:.2f} % of mass added (limit {100 * share:g} %) | | | | "
        f"{1e3 * dt:.3f} | {dt / raw:.1f} |"
        for share, added, dt, _ in scaled
    ]
    lines += [
        "",
        "Slivers are zones whose smallest altitude is below a tenth of their longest edge. The",
        "step is the bound that the program marches by, before its factor of 0.8. Mass is limited",
        "by material, and to 20 times that share in one place: less than the limit may be added.",
        "",
        "## Bound and true limit",
        "",
        "The largest frequency of the assembled operator, by Lanczos iteration:",
        "",
        "| limit of added mass | bound ms | true limit ms | bound over limit |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| {100 * share:g} % | {1e3 * dt:.3f} | {1e3 * true:.3f} | {dt / true:.2f} |"
        for share, _, dt, true in scaled
    ]
    lines += [
        "",
        "## What the mass does to motion",
        "",
        "Ricker wavelets enter through the west face. The same mesh with and without added mass,",
        f"{DURATION:g} s, 72 receivers on the top and at half height: L2 difference of waveforms",
        "(all components) and difference of PPV, as median / nine of ten / worst in %. The worst",
        "stands on a small block that took mass.",
        "",
        "| frequency | limit of added mass | waveform | PPV |",
        "|---|---|---|---|",
    ]
    for frequency, found in effects.items():
        for share, parts in zip(SHARES, found, strict=True):
            spread = 100.0 * np.quantile(parts, (0.5, 0.9, 1.0), axis=1).T
            told = [" / ".join(f"{value:.2f}" for value in row) for row in spread]
            lines.append(f"| {frequency:g} Hz | {100 * share:g} % | {' | '.join(told)} |")
    PAGE.write_text(WORDS + "\n".join(lines) + "\n", encoding="utf-8")


def main():
    """Measure and write."""
    mesh, rows, scaled = steps()
    print(*rows, *scaled, sep="\n", flush=True)
    effects = {f: differences(mesh, f) for f in (10.0, 20.0, 40.0)}
    write(rows, scaled, effects)


if __name__ == "__main__":
    main()
