"""Error behind a plane that slips under a shear wave, and what shorter steps and edges cost."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.grid import structured_box
from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.project.project import STEP_FACTOR
from pyblast.solver.run import simulate
from verification.columns import AXIS, IMPEDANCE, SPEED, column_model, misfit, pulse, ricker

TITLE = "Slip"
ORDER, WAVE, FREQUENCY = 4, "S", 12.0  # Hz, of a Ricker pulse
CARRIED = 3.0 * FREQUENCY  # Hz
EDGE = 2.0 * 2.0 / 5.0 * SPEED[WAVE] / CARRIED  # m: five nodes to the shortest wavelength
BESIDE = 8  # zones on each side of the plane
SHARES = (0.3, 0.5, 0.7, 2.0)  # of the stress of the wave: strength; the last never slips
STIFFNESS = 0.26e9  # Pa/m
STEP = STEP_FACTOR[True]  # over the critical one, the default
KINDS = {  # step over the critical one, edge over `EDGE`
    "as by default": (STEP, 1.0), "half the step": (0.5 * STEP, 1.0),
    "two thirds of the edge": (STEP, 2.0 / 3.0), "half the edge": (STEP, 0.5),
}  # fmt: skip
DURATION = 0.6  # s


def measure(effort):
    """Return the error of the waveform by kind and strength, and the cost in three dimensions."""
    kinds = ["as by default"] if effort == "quick" else KINDS
    errors = {name: {f"{share:g}": error(share, *KINDS[name]) for share in SHARES}
              for name in kinds}  # fmt: skip
    costs = {name: STEP / step / edge**4 for name, (step, edge) in KINDS.items()}
    slips = [f"{share:g}" for share in SHARES if share < 1.0]
    largest = {name: max(of[share] for share in slips) for name, of in errors.items()}
    return {"errors": errors, "largest": largest, "error": largest["as by default"], "cost": costs}


def error(share, step, edge):
    """Return the misfit, below `CARRIED`, behind a plane with a share of the stress as strength."""
    found, late = behind(share, step, edge)
    exact = np.zeros_like(found.velocity)
    exact[:, AXIS[WAVE]] = transmitted(share, found.times - late)
    both = (found, replace(found, velocity=exact))
    return misfit(*(motion.lowpassed(CARRIED).velocity[:, AXIS[WAVE]] for motion in both))


def behind(share, step, edge):
    """Return the motion at the end of a column with a plane in its middle, and its delay in s."""
    half = round(BESIDE / edge)
    along = edge * EDGE * np.arange(2 * half + 1)
    wide = np.array([0.0, edge * EDGE])
    mesh = structured_box(along, wide, wide, order=ORDER, planes={"J": ("x", [along[half]])})
    strength = {"cohesion": share * IMPEDANCE[WAVE], "friction": 0.0, "tension": 1e12}
    law = {"kn": STIFFNESS, "ks": STIFFNESS, **strength, "tension_residual": 1e12}
    ends = [Viscous("west"), StressInput("west", pulse(FREQUENCY, WAVE)), Viscous("east")]
    model = column_model(
        mesh.split(["J"]), WAVE, ends, receivers_at=(along[-1],), step_factor=step,
        joints=[Joint("J", "coulomb", law)],
    )  # fmt: skip
    (motion,) = simulate(model, DURATION).seismograms.values()
    return motion, along[-1] / SPEED[WAVE]


def transmitted(share, times):
    """Return the velocity behind the plane; its spring and slider take ``2 (v - tau/Z)``."""
    z, dt = IMPEDANCE[WAVE], 1e-5
    fine = dt * np.arange(round(DURATION / dt))
    given, stress = z * ricker(fine, FREQUENCY), np.zeros(len(fine))
    keeps, limit = np.exp(-2.0 * STIFFNESS / z * dt), share * z
    for n in range(1, len(fine)):
        mean = 0.5 * (given[n - 1] + given[n])
        stress[n] = min(max(mean + (stress[n - 1] - mean) * keeps, -limit), limit)
    return np.interp(times, fine, stress / z, left=0.0)


def lines(found):
    """Return the table of this part."""
    told = [
        f"A shear Ricker pulse of {FREQUENCY:g} Hz meets a plane in a column of hexahedra of "
        f"order {ORDER} with edges of {EDGE:.0f} m; the motion behind it below {CARRIED:g} Hz "
        "is compared with that behind a spring and slider between two half-spaces. Errors of the "
        "waveform, by the ratio of strength to wave stress (2: no slip), and the work in three "
        "dimensions:",
        "",
        f"| mesh and step | {' | '.join(f'{share:g}' for share in SHARES)} | work |",
        f"|---|{'---|' * len(SHARES)}---|",
    ]
    for name, errors in found["errors"].items():
        sizes = " | ".join(f"{100 * value:.2f} %" for value in errors.values())
        told.append(f"| {name} | {sizes} | {found['cost'][name]:.1f} |")
    return told
