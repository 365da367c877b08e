"""Cases of fading: constant Q by memory variables, stiffness damping of low-passed motion."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import curve_fit

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.material import ConstantQ, Damping, relative_modulus
from pyblast.model.model import Model
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.columns import AXIS, ROCK, SPEED, column, column_model, pulse, spectrum, started
from verification.solutions.attenuation import (
    constant_q_modulus,
    damped_oscillator,
    discrete_wave_number,
    quality,
    wave_number,
)
from verification.step_limits import largest_root
from verification.suite import Curve, Reading, case

QUALITY = {"P": 30.0, "S": 20.0}
BAND = (5.0, 50.0)
WIDE = (1.0, 100.0)
LAW = ConstantQ(QUALITY["P"], QUALITY["S"], BAND)
MIDDLE = float(np.sqrt(BAND[0] * BAND[1]))
PATH = 8  # wavelengths at the top of the band


def travelled(wave, n):
    """Return frequencies, complex wave numbers between two places, edge and time step."""
    edge = SPEED[wave] / BAND[1] / n
    places = np.array([n, (1 + PATH) * n]) * edge
    ends = [Viscous("west"), Viscous("east"), StressInput("west", pulse(20.0, wave))]
    model = column_model(column(22 * n, edge), wave, ends, receivers_at=places)
    model = replace(model, materials={"rock": replace(ROCK, law=LAW)})
    result = simulate(model, 0.68)  # before the far end can answer
    frequency = np.geomspace(*BAND, 25)
    near, far = (
        spectrum(s.times, s.velocity[:, AXIS[wave]], frequency) for s in result.seismograms.values()
    )
    ratio = np.conj(far / near)  # the spectrum is of the other sign
    distance = places[1] - places[0]
    expected = 2.0 * np.pi * frequency * distance / SPEED[wave]  # known to within half a turn
    phase = expected + np.angle(ratio * np.exp(-1j * expected))
    return frequency, (phase - 1j * np.log(np.abs(ratio))) / distance, edge, result.dt


def body(wave, frequency):
    """Return the complex modulus in Pa of the fitted body."""
    lame, shear = LAW.moduli(ROCK)
    if wave == "P":
        return (lame + 2.0 * shear) * relative_modulus(LAW.branches, frequency, "compression")
    return shear * relative_modulus(LAW.branches, frequency)


def worst(quantity, expected, measured):
    """Make a reading of the worst relative error over a curve."""
    k = int(np.abs(measured / expected - 1.0).argmax())
    return Reading.relative(quantity, expected[k], measured[k])


@case(
    "25",
    "Constant Q: attenuation and dispersion of a plane wave",
    source="Kjartansson 1979 (constant Q); Emmerich & Korn 1987 (body); discrete column derived",
    gate="E",
    tolerance={
        **{f"Q of {wave} over the band": 0.05 for wave in SPEED},
        **{f"decay of {wave} against the body": 0.05 for wave in SPEED},
        **{f"speed of {wave} against constant Q": 0.02 for wave in SPEED},
        **{f"wave number of {wave} against the discrete column": 1e-6 for wave in SPEED},
        "1/Q of the body over two decades": 0.05,
    },
    meshes=(12.0, 18.0, 27.0),
    unit="edges per shortest wavelength",
    order=1.8,
    ordered=tuple(f"decay of {wave} against the body" for wave in SPEED),
    quick=True,
    note="Edges are counted at the top of the band, where ten per wavelength change the decay by "
    "5 %",
)
def constant_q(n):
    """Measure Q and phase speed between two places of a column, over a decade."""
    readings, curves = [], []
    for wave, nominal in QUALITY.items():
        frequency, number, edge, dt = travelled(wave, int(n))
        fitted = wave_number(body(wave, frequency), ROCK.density, frequency)
        ideal_modulus = constant_q_modulus(nominal, frequency, MIDDLE)
        ideal = wave_number(ideal_modulus, SPEED[wave] ** -2.0, frequency)
        discrete = discrete_wave_number(
            lambda f, wave=wave: body(wave, f), ROCK.density, frequency, edge, dt
        )
        found = quality(number, frequency)
        speeds = [2.0 * np.pi * frequency / k.real for k in (ideal, number)]
        readings += [
            worst(f"Q of {wave} over the band", np.full(len(found), nominal), found),
            worst(f"decay of {wave} against the body", fitted.imag, number.imag),
            worst(f"speed of {wave} against constant Q", *speeds),
            Reading.norm(f"wave number of {wave} against the discrete column", discrete, number),
        ]
        curves += [
            Curve(f"Q of {wave}", frequency, np.full(len(found), nominal), found,
                  "frequency [Hz]", "Q"),
            Curve(f"phase speed of {wave}", frequency, *speeds, "frequency [Hz]", "speed [m/s]"),
        ]  # fmt: skip
    return [*readings, two_decades()], curves


def two_decades():
    """Read how well the mechanisms follow 1/Q over two decades, no mesh involved."""
    law = ConstantQ(QUALITY["P"], QUALITY["S"], WIDE)
    frequency = np.geomspace(*WIDE, 200)
    modulus = relative_modulus(law.branches, frequency)
    inverse = np.full(200, 1.0 / QUALITY["S"])
    return worst("1/Q of the body over two decades", inverse, -modulus.imag / modulus.real)


DAMPING = Damping(0.05, 10.0, corner=60.0)
BETA = 0.05 / (2.0 * np.pi * 10.0)
HALVES = (1, 2, 4)
LENGTH = 2.0  # wavelengths of the highest standing wave


def standing(wave, n, halves):
    """Let a standing wave die away; return its own frequency, ratio, and that of the mesh, 1/s.

    The highest of them has 40 Hz and ``n`` edges to the wavelength.
    """
    edge = SPEED[wave] / 40.0 / n
    n_edges = int(LENGTH * n)
    number = halves * np.pi / (n_edges * edge)
    place = edge * round(0.5 * n_edges / halves)
    ends = [Fixed("west"), Fixed("east")]
    mesh = column(n_edges, edge)
    model = column_model(mesh, wave, ends, receivers_at=[place], damping=DAMPING)
    omega = number * SPEED[wave]
    velocity = np.zeros_like(model.mesh.points)
    velocity[:, AXIS[wave]] = np.sin(number * model.mesh.points[:, 0])
    result = started(model, 16.0 * np.pi / omega, 0.0 * velocity, velocity)
    (record,) = result.seismograms.values()
    late = record.times > 10.0 / (2.0 * np.pi * DAMPING.corner)  # the filter has settled

    def free(time, amplitude, rate, turn, phase):
        return amplitude * np.exp(-rate * time) * np.cos(turn * time + phase)

    guess = (1.0, DAMPING.ratio_at(omega / 2.0 / np.pi) * omega, omega, 0.0)
    moved = record.velocity[:, AXIS[wave]]
    values, _ = curve_fit(free, record.times[late], moved[late], guess)
    natural = np.hypot(values[1], values[2])
    sine = SPEED[wave] * result.dt / edge * np.sin(0.5 * number * edge)
    return natural, values[1] / natural, 2.0 / result.dt * np.arcsin(sine)


def grows(model, dt):
    """Tell whether any state of a small model grows from step to step."""
    return largest_root(model, dt) > 1.0 + 1e-6


def longest_step(material=ROCK, **parts):
    """Bisect for the longest stable step of two cubes that stand on one face."""
    mesh = structured_box((2, 1, 1), (2.0, 1.0, 1.0))
    model = Model(mesh, {"rock": material}, boundaries=[Fixed("west")], **parts)
    short, long = 0.0, 4.0 * prepare(model, 1e-3).limit.dt
    for _ in range(13):
        dt = 0.5 * (short + long)
        short, long = (short, dt) if grows(model, dt) else (dt, long)
    return 0.5 * (short + long)


@cache
def step_readings():
    """Read the longest stable steps over the undamped one, no wave involved."""
    plain = longest_step()
    return [
        Reading.relative(
            "longest stable step over the undamped one",
            (1.0 + BETA * 2.0 * np.pi * DAMPING.corner) ** -0.5,
            longest_step(damping=DAMPING) / plain,
        ),
    ]


@case(
    "L11",
    "Stiffness damping of low-passed motion",
    source="roots of the damped oscillator with a first-order filter",
    gate="R",
    tolerance={
        **{f"damping ratio of {wave}": 0.01 for wave in SPEED},
        **{f"speed of {wave} over the undamped one": 0.01 for wave in SPEED},
        "longest stable step over the undamped one": 0.01,
    },
    meshes=(10.0, 15.0, 22.0),
    unit="edges per shortest wavelength",
    order=1.8,
    ordered=tuple(f"damping ratio of {wave}" for wave in SPEED),
    quick=True,
)
def low_passed_damping(n):
    """Measure ratio and speed of standing waves of 10, 20 and 40 Hz, and the longest step."""
    readings, curves = [], []
    for wave in SPEED:
        frequency = 40.0 / LENGTH / 2.0 * np.array(HALVES)
        omega = 2.0 * np.pi * frequency
        wanted = np.array(
            [damped_oscillator(w, DAMPING.alpha, BETA, DAMPING.corner) for w in omega]
        )
        natural, ratio, mesh = np.transpose([standing(wave, n, halves) for halves in HALVES])
        readings += [
            worst(f"damping ratio of {wave}", wanted[:, 0], ratio),
            worst(f"speed of {wave} over the undamped one", wanted[:, 1] / omega, natural / mesh),
        ]
        curves += [
            Curve(f"damping ratio of {wave}", frequency, wanted[:, 0], ratio,
                  "frequency [Hz]", "share of critical damping"),
            Curve(f"speed of {wave} over the undamped one", frequency, wanted[:, 1] / omega,
                  natural / mesh, "frequency [Hz]", "ratio"),
        ]  # fmt: skip
    return [*readings, *step_readings()], curves
