"""Spectral hexahedra against quadratic tetrahedra on grounds that both can run.

    python -m verification.elements [GROUND ...] [--page] [--again] [--minutes N]

A box with a point force in it, viscous sides and two receivers, in fourteen grounds: every joint
law but the yielding one, layers, a gradient of speed, both kinds of damping, a dipping joint. Each
element runs on two grids. Its stated error is the difference of the two over 1 - r^2, r being the
ratio of their node spacings: what remains of an error of second order, the lowest that a joint's
springs leave. All differences are root mean squares over time, receivers and components, over the
motion. The elements agree where they differ by no more than the sum of their stated errors.
Writes the rows that ``verification/elements.json`` lacks and the table of
docs/quality/verification.md; ``--page`` writes the table alone.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.files import write_text
from pyblast.mesh.builder import structured_box
from pyblast.mesh.grid import Layer
from pyblast.model.boundary import Viscous
from pyblast.model.ground_fields import Gradient
from pyblast.model.joint import Joint
from pyblast.model.material import ConstantQ, Damping, Material
from pyblast.model.model import Model, Receiver
from pyblast.model.source import PointForce, TimeFunction
from pyblast.solver.run import simulate

from .markdown import between
from .rows import each_row, options, read_rows

OUT = Path(__file__).with_suffix(".json")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "quality" / "verification.md"
BEGIN, END = "<!-- elements: from verification/elements.json -->", "<!-- end of elements -->"
SIZE, PLANE = (120.0, 90.0, 60.0), 60.0  # m
SIDES = "west", "east", "south", "north", "bottom"
ORDERS, HEX_GRID = (5, 7), (4, 3, 2)
TET_GRIDS = (12, 9, 6), (16, 12, 8)
DURATION, STEP = 0.25, 1e-3  # s
FREQUENCY, PEAK = 15.0, 0.09  # Hz and s, of the Ricker pulse
SHEAR = 0.5  # shift of a dipping joint per height
SPEEDS = 2600.0, 3000.0, 1700.0  # kg/m3 and m/s
STIFF = {"kn": 4e9, "ks": 2e9}  # Pa/m
STRENGTH = {"cohesion": 1e3, "friction": 0.4, "tension": 1e3}
ROUGH = {"jrc": 8.0, "jcs": 5e7, "friction": 0.5, "peak_slip": 5e-3}


def jointed(law, pressed=0.0, **properties):
    """Return the parts of a model with a joint across the box."""
    joint = Joint("J", law, {**STIFF, **properties}, insitu_pressure=pressed)
    return {"joints": [joint], "planes": {"J": ("x", PLANE)}}


def rock(**parts):
    """Return the rock, with a law other than the elastic one if given."""
    return Material.from_speeds(*SPEEDS, **parts)


GROUNDS = {
    "one rock": {},
    "two layers": {
        "layers": [Layer("soil", 30.0), Layer("rock", None)],
        "materials": {"soil": Material.from_speeds(2200.0, 2200.0, 1200.0), "rock": rock()},
    },
    "speeds that grow with depth": {"ground": [Gradient(0.3, 30.0, SIZE[2])]},
    "constant Q": {"materials": {"rock": rock(law=ConstantQ(40.0, 20.0, (2.0, 60.0)))}},
    "Rayleigh damping": {"damping": Damping(0.02, 15.0)},
    "elastic joint": jointed("elastic"),
    "elastic joint that dips 63°": {**jointed("elastic"), "shear": SHEAR},
    "Coulomb joint that slips": jointed("coulomb", 5e4, **STRENGTH),
    "joint that weakens with slip": jointed(
        "softening", 5e4, cohesion=1e3, friction=0.4, friction_dynamic=0.2, weakening_slip=1e-3,
        tension=1e3,
    ),
    "joint that closes": jointed("closure", 5e4, closure=1e-3),
    "rough joint": jointed("barton_bandis", 5e4, closure=1e-3, **ROUGH),
    "stress-dependent joint": jointed("stress_dependent", 5e4, pressure=1e5, exponent=0.5),
    "Kelvin fill": jointed("kelvin", eta_n=2e7, eta_s=1e7),
    "Maxwell fill": jointed("maxwell", eta_n=2e7, eta_s=1e7),
}  # fmt: skip


def made(shape, order=1, *, planes=None, layers=None, shear=0.0, materials=None, **parts):
    """Return the model of a ground on a grid of hexahedra, or of tetrahedra for order 1.

    These are quadratic unless parts say otherwise.
    """
    cut = {"order": order} if order > 1 else {"pattern": "centred"}
    mesh = structured_box(shape, SIZE, planes=planes, layers=layers, **cut)
    if shear and order > 1:
        mesh = replace(mesh, places=_sheared(mesh.node_places, shear))
    elif shear:
        mesh = replace(mesh, points=_sheared(mesh.points, shear))
    t = np.arange(0.0, 0.4, 1e-4)
    a = (np.pi * FREQUENCY * (t - PEAK)) ** 2
    pulse = TimeFunction((1.0 - 2.0 * a) * np.exp(-a), 1e-4)
    places = _sheared(np.array([(40.0, 40.0, 41.0), (85.0, 52.0, 55.0), (30.0, 70.0, 20.0)]), shear)
    source, *ends = ((float(x), float(y), float(z)) for x, y, z in places)
    return Model(
        mesh.split(list(planes or {})),
        materials or {"rock": rock()},
        sources=(PointForce(source, (1e8, 2e8, -3e8), pulse),),
        receivers=tuple(Receiver(name, end) for name, end in zip("AB", ends, strict=True)),
        boundaries=tuple(Viscous(side) for side in SIDES),
        **{"quadratic": order == 1, **parts},
    )


def _sheared(places, shear):
    """Shift places (..., 3) along x by their height."""
    return places + np.multiply.outer(places[..., 2], (shear, 0.0, 0.0))


def motion(model):
    """Simulate; return the motion (n_receivers, 3, n) in m/s at even instants, and CPU seconds."""
    began = time.process_time()
    run = simulate(model, DURATION)
    times = np.arange(0.0, DURATION - 2.0 * STEP, STEP)
    motion = [run.seismograms[name].sampled(0.0, STEP, len(times)).velocity.T for name in "AB"]
    return np.array(motion), time.process_time() - began


def compared(name):
    """Return the row of a ground: difference of the elements and their stated errors."""
    parts = GROUNDS[name]
    (coarse, hex_cpu), (fine, _) = (motion(made(HEX_GRID, order, **parts)) for order in ORDERS)
    (few, tet_cpu), (many, _) = (motion(made(shape, **parts)) for shape in TET_GRIDS)
    size = np.linalg.norm(fine)
    hexahedra = np.linalg.norm(coarse - fine) / size / (1.0 - (ORDERS[0] / ORDERS[1]) ** 2)
    ratio = TET_GRIDS[0][0] / TET_GRIDS[1][0]
    tetrahedra = np.linalg.norm(few - many) / size / (1.0 - ratio**2)
    difference = np.linalg.norm(coarse - few) / size
    return {
        "difference": float(difference),
        "hexahedra_error": float(hexahedra),
        "tetrahedra_error": float(tetrahedra),
        "within": bool(difference <= hexahedra + tetrahedra),
        "hexahedra_cpu_seconds": hex_cpu,
        "tetrahedra_cpu_seconds": tet_cpu,
    }


def table(rows):
    """Return the lines of the table of some rows."""
    agreed = sum(row["within"] for row in rows.values())
    return [
        f"{agreed} of {len(rows)} grounds: the elements differ by no more than the sum of their "
        "stated errors.",
        "",
        "| ground | difference % | stated: hexahedra % | stated: tetrahedra % | within | CPU s |",
        "|---|---|---|---|---|---|",
        *(
            f"| {ground} | {100 * row['difference']:.2g} | "
            f"{100 * row['hexahedra_error']:.2g} | {100 * row['tetrahedra_error']:.2g} | "
            f"{'✓' if row['within'] else '**no**'} | {row['hexahedra_cpu_seconds']:.1f}, "
            f"{row['tetrahedra_cpu_seconds']:.1f} |"
            for ground, row in rows.items()
        ),
    ]


def paged(page, rows):
    """Return the page with the table of some rows."""
    return between(page, (BEGIN, END), table(rows))


def main(arguments):
    """Run grounds and write their rows and the table."""
    arguments, limits = options(arguments)
    names = [a for a in arguments if a != "--page"] or list(GROUNDS)
    unknown = [name for name in names if name not in GROUNDS]
    if unknown:
        sys.exit(f"elements: no ground {unknown[0]!r}; there are {', '.join(GROUNDS)}")
    only_page = "--page" in arguments
    rows = read_rows(OUT) if only_page else each_row(OUT, names, compared, **limits)
    write_text(PAGE, paged(PAGE.read_text(), {n: rows[n] for n in GROUNDS if n in rows}))


if __name__ == "__main__":
    main(sys.argv[1:])
