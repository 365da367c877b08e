"""Waves across linear joints at normal incidence. Cases 5 and 7."""

import numpy as np

from pyblast.model.joint import Joint
from verification.columns import IMPEDANCE, SPEED, column, driven, spectrum
from verification.suite import Curve, Reading, case

FREQUENCY = 20.0
BAND = np.linspace(5.0, 25.0, 21)
SOFTNESS = (0.1, 0.3, 1.0)


def passed(wave, n, planes, stiffness, far):
    """Return the spectrum at `BAND` behind joints over that without them."""
    edge = SPEED[wave] / FREQUENCY / n
    laws = [Joint(name, "elastic", {"kn": stiffness, "ks": stiffness}) for name in planes]
    behind, length = (far + 1) * n * edge, (far + 5) * n
    duration = 0.45 + 2.0 * far / FREQUENCY
    spectra = []
    for joints, cuts in ((laws, planes), ([], None)):
        mesh = column(length, edge, cuts)
        motion, _ = driven(mesh, wave, FREQUENCY, duration, [behind], joints=joints)
        spectra.append(spectrum(*motion[behind], BAND))
    return spectra[0] / spectra[1]


@case(
    "5",
    "One linear joint, normal P and SH",
    source="displacement discontinuity: T = 1/(1 - i w z/2k); Schoenberg (1980)",
    gate="R",
    tolerance={
        **{f"|T| at k/zw {s:g}, {wave}": 0.0125 for wave in SPEED for s in SOFTNESS},
        **{f"delay at k/zw 1, {wave}": 0.02 for wave in SPEED},
    },
    meshes=(10.0, 15.0, 22.0),
    order=1.8,
    ordered=tuple(f"|T| at k/zw {s:g}, {wave}" for wave in SPEED for s in SOFTNESS[:2]),
    quick=True,
    note="The error is that of the discrete impedance; 10 edges miss 1 %, 15 meet it. At k/zw 1 "
    "it is no larger than the reflection from the viscous ends: no order.",
)
def one_joint(n):
    """Measure transmission and delay of one joint at three stiffnesses."""
    n, readings, curves = round(n), [], []
    at = int(np.argmin(np.abs(BAND - FREQUENCY)))
    for wave, speed in SPEED.items():
        for softness in SOFTNESS:
            k = softness * IMPEDANCE[wave] * 2.0 * np.pi * FREQUENCY
            found = passed(wave, n, {"J": ("x", 3.0 * speed / FREQUENCY)}, k, 3)
            wanted = 1.0 / (1.0 + 1j * np.pi * BAND * IMPEDANCE[wave] / k)
            readings.append(Reading.relative(f"|T| at k/zw {softness:g}, {wave}",
                                             abs(wanted[at]), abs(found[at])))  # fmt: skip
            curves.append(Curve(f"{wave}, k/zw {softness:g}", BAND, np.abs(wanted), np.abs(found),
                                "frequency [Hz]", "|T|"))  # fmt: skip
        delay = [-np.angle(t[at]) / (2.0 * np.pi * FREQUENCY) for t in (wanted, found)]
        readings.append(Reading.relative(f"delay at k/zw 1, {wave}", *delay))
    return readings, curves


@case(
    "7",
    "Parallel joints: transmission and long waves",
    source="cos f = cos(ws/c) - g sin(ws/c), g = wz/2k; |T|2 = 1/[1 + (g sin Nf/sin f)2]",
    gate="R",
    tolerance={"|T| behind 4 joints, 5 to 15 Hz": 0.05, "speed of long waves": 0.01},
    meshes=(20.0, 30.0, 44.0),
    order=1.8,
    ordered=("|T| behind 4 joints, 5 to 15 Hz",),
    note="P, joints a quarter of a wavelength of 20 Hz apart, k/zw 1; largest error below the stop "
    "band. The long-wave speed follows from the delay at 5 Hz, with the exact phase.",
)
def parallel_joints(n):
    """Measure what passes four joints."""
    n, wave, count = round(n / 4) * 4, "P", 4
    spacing = SPEED[wave] / FREQUENCY / 4.0
    k = IMPEDANCE[wave] * 2.0 * np.pi * FREQUENCY
    planes = {f"J{i}": ("x", 3.0 * SPEED[wave] / FREQUENCY + i * spacing) for i in range(count)}
    found = passed(wave, n, planes, k, 4)
    omega = 2.0 * np.pi * BAND
    g, turn = 0.5 * omega * IMPEDANCE[wave] / k, omega * spacing / SPEED[wave]
    phase = np.arccos(np.cos(turn) - g * np.sin(turn) + 0j)
    wanted = np.abs(1.0 / np.sqrt(1.0 + (np.sin(count * phase) / np.sin(phase) * g) ** 2))
    below = BAND <= 15.0
    error = (np.abs(found) / wanted - 1.0)[below]
    worst = int(np.abs(error).argmax())
    delay = -np.unwrap(np.angle(found))[0] / omega[0] + count * spacing / SPEED[wave]
    speed = count * spacing / delay
    exact = many_delay(count, g[0], turn[0], omega[0], spacing, SPEED[wave])
    readings = [
        Reading("|T| behind 4 joints, 5 to 15 Hz", float(wanted[worst]), float(abs(found[worst])),
                float(error[worst])),
        Reading.relative("speed of long waves", count * spacing / exact, speed),
    ]  # fmt: skip
    return readings, [Curve("four joints, P", BAND, wanted, np.abs(found), "frequency [Hz]", "|T|")]


def many_delay(count, g, turn, omega, spacing, speed):
    """Return the delay over some spacings behind identical joints, by transfer matrices.

    Waves e^(-iwt): each joint has T = 1/(1 - ig), R = -ig/(1 - ig).
    """
    one = np.array([[1.0 + 1j * g, -1j * g], [1j * g, 1.0 - 1j * g]])
    way = np.diag([np.exp(1j * turn), np.exp(-1j * turn)])
    total = one
    for _ in range(count - 1):
        total = one @ way @ total
    passing = np.linalg.det(total) / total[1, 1]
    return np.angle(passing) / omega - (count - 1) * spacing / speed + count * spacing / speed
