"""Waves across joints that flow, slip and close, at normal incidence. Cases 8, 10, 11, L10."""

import numpy as np

from pyblast.model.boundary import StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.run import simulate
from verification.columns import AXIS, IMPEDANCE, SPEED, column, column_model, ricker, spectrum
from verification.contact import DT, KN, Contact
from verification.solutions.joints import (
    past_closure,
    past_friction,
    through_heavy_spring,
    through_kelvin,
    through_layer,
    through_maxwell,
)
from verification.suite import Curve, Reading, case

FREQUENCY = 20.0
OMEGA = 2.0 * np.pi * FREQUENCY
BAND = np.linspace(5.0, 25.0, 21)


def crossed(wave, n, values, dt, joint, periods, front=1.0, at=2.0, behind=3.0, length=5.0):
    """Send a wave through a column with and without a joint; places are in wavelengths.

    Returns
    -------
    dict of bool to list of (times, velocity)
        Before and behind the place of the joint, with it (True) and without.
    """
    edge = SPEED[wave] / FREQUENCY / n
    velocity = np.zeros((len(values), 3))
    velocity[:, AXIS[wave]] = values
    ends = [Viscous("west"), StressInput("west", Seismogram(velocity, dt)), Viscous("east")]
    places = [front * n * edge, behind * n * edge]
    motion = {}
    for there in (True, False):
        planes = {joint.surface: ("x", at * n * edge)} if there else None
        mesh = column(round(length * n), edge, planes)
        joints = [joint] if there else []
        model = column_model(mesh, wave, ends, receivers_at=places, joints=joints)
        records = simulate(model, periods / FREQUENCY).seismograms.values()
        motion[there] = [(s.times, s.velocity[:, AXIS[wave]]) for s in records]
    return motion


def pulse():
    """Return samples and step of a Ricker pulse at `FREQUENCY`."""
    times = np.arange(0.0, 3.0 / FREQUENCY, 0.005 / FREQUENCY)
    return ricker(times, FREQUENCY), times[1]


def passed(wave, n, joint, size=1.0):
    """Return the spectrum at `BAND` of a pulse behind a joint over that without it."""
    values, dt = pulse()
    motion = crossed(wave, n, size * values, dt, joint, 9.0)
    return spectrum(*motion[True][1], BAND) / spectrum(*motion[False][1], BAND)


FILLS = {
    "Kelvin": ("kelvin", 0.3, 0.5, through_kelvin),
    "Maxwell": ("maxwell", 0.3, 3.0, through_maxwell),
}


def filled(wave, kind):
    """Return a joint with a fill and its T over `BAND`; stiffness over zw, w eta over stiffness."""
    law, softness, share, form = FILLS[kind]
    k = softness * IMPEDANCE[wave] * OMEGA
    eta = share * k / OMEGA
    properties = {"kn": k, "ks": k, "eta_n": eta, "eta_s": eta}
    return Joint("J", law, properties), form(2.0 * np.pi * BAND, IMPEDANCE[wave], k, eta)


def thick(wave, phase=0.3, ratio=0.1):
    """Return a thick fill, its T as a spring with mass and as a layer, over `BAND`."""
    density, z = 1900.0, ratio * IMPEDANCE[wave]
    speed = z / density
    width = phase * speed / OMEGA
    omega = 2.0 * np.pi * BAND
    stiffness, mass = density * speed**2 / width, density * width
    spring = through_heavy_spring(omega, IMPEDANCE[wave], stiffness, mass)
    layer = through_layer(omega, IMPEDANCE[wave], z, width / speed)
    fill = Joint("J", "elastic", {"kn": stiffness, "ks": stiffness}, fill_mass=mass)
    return fill, spring, layer


def driven_alone(kind):
    """Return the complex stiffness of a contact with a fill at `FREQUENCY`, wanted and found."""
    law, _, share, _ = FILLS[kind]
    eta = share * KN / OMEGA
    contact = Contact(law, eta_n=eta, eta_s=eta)
    period = round(1.0 / (FREQUENCY * DT))
    times = DT * np.arange(20 * period)
    place = 1e-6 * np.sin(OMEGA * times)
    traction = np.array([contact.move(0.0, 0.0, x)[2] for x in place])
    last = slice(-period, None)
    answer, cause = (spectrum(times[last], v[last], [FREQUENCY])[0] for v in (traction, place))
    flow = -1j * OMEGA * eta
    wanted = KN + flow if kind == "Kelvin" else KN * flow / (KN + flow)
    return wanted, np.conj(answer / cause)


@case(
    "11",
    "Joints with Kelvin, Maxwell and thick fills, normal P and SH",
    source="displacement discontinuity with k - i w eta, Maxwell's row, layer of finite width",
    gate="C",
    tolerance={
        **{f"T of a {kind} fill, {wave}": 0.03 for kind in (*FILLS, "thick") for wave in SPEED},
        **{f"|T| of the layer behind the thick fill, {wave}": 0.05 for wave in SPEED},
        **{f"a {kind} fill driven alone": 0.01 for kind in FILLS},
    },
    meshes=(10.0, 15.0, 22.0),
    order=1.8,
    ordered=tuple(f"T of a {kind} fill, {wave}" for kind in (*FILLS, "thick") for wave in SPEED),
    quick=True,
    note="T is complex, over the band of 5 to 25 Hz. The layer itself, at a phase of 0.3, differs "
    "from a spring with mass by up to 3 %, whatever the mesh.",
)
def fills(n):
    """Measure what passes joints with fills."""
    n, curves = round(n), []
    readings = [
        Reading.norm(f"a {kind} fill driven alone", *map(np.atleast_1d, driven_alone(kind)))
        for kind in FILLS
    ]
    at = int(np.argmin(np.abs(BAND - FREQUENCY)))
    for wave in SPEED:
        cases = {kind: filled(wave, kind) for kind in FILLS}
        joint, spring, layer = thick(wave)
        for kind, (one, wanted) in {**cases, "thick": (joint, spring)}.items():
            found = np.conj(passed(wave, n, one))
            readings.append(Reading.norm(f"T of a {kind} fill, {wave}", wanted, found))
            curves.append(Curve(f"{kind}, {wave}", BAND, np.abs(wanted), np.abs(found),
                                "frequency [Hz]", "|T|"))  # fmt: skip
        readings.append(Reading.relative(f"|T| of the layer behind the thick fill, {wave}",
                                         abs(layer[at]), abs(found[at])))  # fmt: skip
    return readings, curves


SHARES = (0.9, 0.7, 0.5, 0.3, 0.1)


NEARLY_RIGID = IMPEDANCE["S"] * OMEGA / 0.02  # Pa/m


def harmonic():
    """Return samples and step of a wave that grows to an amplitude of 1 in two periods."""
    times = np.arange(0.0, 9.0 / FREQUENCY, 0.005 / FREQUENCY)
    ramp = np.sin(0.5 * np.pi * np.minimum(1.0, 0.5 * FREQUENCY * times)) ** 2
    return ramp * np.sin(OMEGA * times), times[1]


def coulomb_plane(share):
    """Return a nearly rigid plane whose strength is a share of the stress of the wave."""
    strength = {"cohesion": share * IMPEDANCE["S"], "friction": 0.0, "tension": 1e12}
    law = {"kn": NEARLY_RIGID, "ks": NEARLY_RIGID, **strength, "tension_residual": 1e12}
    return Joint("J", "coulomb", law)


def slipping(n, joint):
    """Return T, R, A of a joint under a harmonic wave, and one period of the wave behind it."""
    motion = crossed("S", n, *harmonic(), joint, 7.9)
    phase = np.linspace(6.8, 7.8, 400, endpoint=False) / FREQUENCY
    (front, behind), (given_front, given) = (
        [np.interp(phase, *record) for record in motion[there]] for there in (True, False)
    )
    size = np.sqrt(np.mean(given**2))
    passes = np.sqrt(np.mean(behind**2)) / size
    back = np.sqrt(np.mean((front - given_front) ** 2) / np.mean(given_front**2))
    lost = np.sqrt(max(0.0, 1.0 - passes**2 - back**2))
    return (passes, back, lost), phase, behind, given


@case(
    "8",
    "Coulomb plane under a harmonic shear wave",
    source="incident wave clipped at the strength; Miller (1978)",
    gate="R",
    tolerance={
        **{f"T at strength {share:g}": 0.02 for share in SHARES},
        **{f"{what} at strength {share:g}": 0.05 for what in "RA" for share in SHARES},
    },
    meshes=(10.0, 20.0, 40.0),
    order=0.9,
    ordered=tuple(f"T at strength {share:g}" for share in SHARES[2:]),
    note="T is good to 2 % from 20 edges on for strengths down to half the stress, from 40 on for "
    "a tenth. Above half the stress T is within 1.1 % on every mesh: no order. The plane's "
    "spring, 0.02 of the impedance, "
    "adds 2 % to the small R at 0.9.",
)
def friction(n):
    """Measure what passes, returns and is lost at a plane that slips."""
    n, readings, curves = round(n), [], []
    for share in SHARES:
        found, phase, behind, given = slipping(n, coulomb_plane(share))
        for what, wanted, value in zip("TRA", past_friction(share), found, strict=True):
            readings.append(Reading.relative(f"{what} at strength {share:g}", wanted, value))
        curves.append(Curve(f"strength {share:g} of the stress", 1e3 * phase,
                            np.clip(given, -share, share), behind,
                            "time [ms]", "velocity [m/s]"))  # fmt: skip
    return readings, curves


GAMMAS = (0.2, 1.0, 2.0)
TONES = {"T at the dominant frequency": 1.0, "T at twice it": 2.0}


def closing(n, gamma, law="closure", pressed=0.0, **walls):
    """Return times, wanted and found velocity behind a closing joint, and the half-sine push.

    ``pressed`` is the pressure before it over k Vm, ``walls`` what the law needs beside closure.
    """
    z, dt = IMPEDANCE["P"], 0.0025 / FREQUENCY
    times = np.arange(0.0, 4.0 / FREQUENCY, dt)
    k = 0.35 * z * OMEGA
    properties = {"kn": k, "ks": k, "closure": z / (k * gamma), **walls}
    pressure = pressed * z / gamma
    values = np.where(times < 0.5 / FREQUENCY, np.sin(OMEGA * times), 0.0)
    motion = crossed("P", n, values, dt, Joint("J", law, properties, pressure), 6.0)
    t, found = motion[True][1]
    start = 3.0 / FREQUENCY

    def push(time):
        after = time - start
        return np.sin(OMEGA * after) if 0.0 < after < 0.5 / FREQUENCY else 0.0

    wanted = past_closure(t, push, z, k, properties["closure"], pressure)
    return t, wanted, found, np.array([push(time) for time in t])


@case(
    "10",
    "Closing joint under a half-sine push, normal P",
    source="differential equation of the hyperbola; Zhao and Cai (2001)",
    gate="E",
    tolerance={
        **{f"{what}, amplitude {g:g}": 0.03 for what in TONES for g in GAMMAS},
        **{f"peak, amplitude {g:g}": 0.035 for g in GAMMAS},
    },
    meshes=(20.0, 40.0, 80.0),
    order=0.9,
    ordered=(
        *(f"{what}, amplitude {g:g}" for what in (*TONES, "peak") for g in GAMMAS[:2]),
        "T at the dominant frequency, amplitude 2",
    ),
    note="Amplitude is z v/(k Vm). 20 edges meet 3 % in T, 40 meet 0.8 %. A pulse that begins "
    "with a kink rings on the mesh: its peak needs 40 edges, 80 at the largest amplitude. At "
    "twice the "
    "frequency the largest amplitude is within 0.6 % on every mesh: no order.",
)
def closure(n):
    """Measure spectrum and peak behind a joint that stiffens as it closes."""
    n, readings, curves = round(n), [], []
    for gamma in GAMMAS:
        t, wanted, found, given = closing(n, gamma)
        tones = FREQUENCY * np.array(list(TONES.values()))
        spectra = [np.abs(spectrum(t, v, tones)) for v in (given, wanted, found)]
        for what, before, *behind in zip(TONES, *spectra, strict=True):
            readings.append(Reading.relative(f"{what}, amplitude {gamma:g}",
                                             *(value / before for value in behind)))  # fmt: skip
        readings.append(Reading.relative(f"peak, amplitude {gamma:g}",
                                         wanted.max(), found.max()))  # fmt: skip
        curves.append(Curve(f"amplitude {gamma:g}", 1e3 * t, wanted, found,
                            "time [ms]", "velocity [m/s]"))  # fmt: skip
    return readings, curves


@case(
    "L10",
    "Small waves across joints whose stiffness follows the pressure",
    source="tangent of the hyperbola, kn (1 + p/(kn Vm))^2; power of the pressure",
    gate="C",
    tolerance={"closure": 1e-3, "stress_dependent": 1e-3},
    quick=True,
    note="10 edges per wavelength; both sides of the comparison are on the same mesh, and the cap "
    "of the stiffness lies just above it, so that their time steps are alike.",
)
def small_waves():
    """Compare small waves across a closing and a stress-dependent joint with an elastic one."""
    pressure, k, vm = 1e6, 0.1 * IMPEDANCE["P"] * OMEGA, 1e-3
    tangent = {"closure": k * (1.0 + pressure / (k * vm)) ** 2, "stress_dependent": 2.0 * k}
    rest = {"closure": {"closure": vm}, "stress_dependent": {"pressure": pressure / 4.0,
                                                             "exponent": 0.5}}  # fmt: skip
    readings, curves = [], []
    for law, stiffness in tangent.items():
        springs = {"kn": k, "ks": k, "kn_max": 1.01 * stiffness}
        one = Joint("J", law, {**springs, **rest[law]}, pressure)
        alike = Joint("J", "elastic", {"kn": stiffness, "ks": k})
        found, wanted = (passed("P", 10, joint, 1e-7) for joint in (one, alike))
        readings.append(Reading.norm(law, wanted, found))
        curves.append(Curve(law, BAND, np.abs(wanted), np.abs(found), "frequency [Hz]", "|T|"))
    return readings, curves
