"""What a viscous face sends back, by angle. Case 12."""

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model
from pyblast.solver.preparation import prepare
from verification.columns import started
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 2000.0 * np.sqrt(3.0), 2000.0)
WAVELENGTH, LENGTH, START, WIDTH = 100.0, 18.0, 9.0, 2.4
ANGLES = {
    "P": (0.0, 30.0, 45.0, 60.0),
    "SV": (30.0, 45.0, 60.0),
    "SH": (0.0, 30.0, 45.0, 60.0),
}


def sent_back(wave, angle):
    """Return the share of energy that dashpots rho c send back from a plane wave.

    Traction -Z v on the face x = 0 of waves in x < 0, all of the slowness sin(angle)/c along it.
    """
    turn, cp, cs = np.radians(angle), ROCK.cp, ROCK.cs
    if wave == "SH":
        return ((np.cos(turn) - 1.0) / (np.cos(turn) + 1.0)) ** 2
    slow = np.sin(turn) / (cp if wave == "P" else cs)
    qp, qs = (np.sqrt(1.0 / c**2 - slow**2 + 0j) for c in (cp, cs))

    def parts(direction, pressure):
        """Return velocity and traction on the face of a wave of unit potential."""
        qx = direction * (qp if pressure else qs)
        u = np.array([qx, slow]) if pressure else np.array([slow, -qx])
        lame, shear = ROCK.first_lame, ROCK.shear
        normal = (lame + 2 * shear) * qx * u[0] + lame * slow * u[1]
        along = shear * (qx * u[1] + slow * u[0])
        return u, -np.array([normal, along])  # of v = u f(t - s.x): stress is -C s u

    z = ROCK.density * np.array([cp, cs])
    u_in, t_in = parts(1.0, wave == "P")
    columns = [t + z * u for u, t in (parts(-1.0, True), parts(-1.0, False))]
    gain = np.linalg.solve(np.array(columns).T, -(t_in + z * u_in))
    flux_in = (qp if wave == "P" else qs).real
    back = abs(gain[0]) ** 2 * qp.real + abs(gain[1]) ** 2 * qs.real
    return float(back / flux_in)


def measured(wave, angle, n):
    """Return the share of a packet's energy that is left when it has met the face."""
    turn, c = np.radians(angle), ROCK.cp if wave == "P" else ROCK.cs
    k = 2.0 * np.pi / WAVELENGTH
    kx, ky, edge = k * np.cos(turn), k * np.sin(turn), WAVELENGTH / n
    width = np.pi / ky if ky > 1e-9 else 2.0 * edge
    rows = max(2, round(width / edge))
    shape = (round(LENGTH * n), rows, 1)
    mesh = structured_box(shape, (LENGTH * WAVELENGTH, width, edge), pattern="alternating")
    if wave == "SH":
        held = [Fixed(side, ("east", "north")) for side in ("bottom", "top")]
    else:
        held = [Fixed(side, ("vertical",)) for side in ("bottom", "top")]
        held += [Fixed(side, ("north",)) for side in ("south", "north")]
    model = Model(mesh, {"rock": ROCK}, boundaries=[*held, Viscous("east")])
    x, y = model.mesh.points[:, 0], model.mesh.points[:, 1]
    omega, group = k * c, c * np.cos(turn)

    def motion(time):
        envelope = np.exp(-((((x - group * time) / WAVELENGTH - START) / WIDTH) ** 2))
        phase = kx * x - omega * time
        u = np.zeros_like(model.mesh.points)
        if wave == "SH":
            u[:, 2] = envelope * np.cos(phase) * np.cos(ky * y)
        elif wave == "P":
            u[:, 0] = -kx / k * envelope * np.sin(phase) * np.cos(ky * y)
            u[:, 1] = -ky / k * envelope * np.cos(phase) * np.sin(ky * y)
        else:
            u[:, 0] = ky / k * envelope * np.cos(phase) * np.cos(ky * y)
            u[:, 1] = kx / k * envelope * np.sin(phase) * np.sin(ky * y)
        return u

    duration = (LENGTH - START + 3.0 * WIDTH) * WAVELENGTH / group
    early, small = -0.5 * prepare(model, 0.01).constants["dt"], 1e-6
    velocity = (motion(early + small) - motion(early - small)) / (2.0 * small)
    energy = started(model, duration, motion(0.0), velocity).energy
    total = energy["kinetic"] + energy["strain"]
    return float(total[-1] / total[0])


@case(
    "12",
    "Viscous face against angle",
    source="Lysmer & Kuhlemeyer (1969); two reflected waves from the balance of tractions",
    gate="R",
    tolerance={f"{wave} at {a:g} deg": 0.02 for wave, angles in ANGLES.items() for a in angles},
    meshes=(10.0, 13.0, 17.0),
    order=0.9,
    ordered=("P at 0 deg", "SV at 45 deg"),
    note="Shares of the energy of a packet of 2.4 wavelengths, Poisson's ratio 0.25. At the other "
    "angles the packet's angular spread matters as much as the mesh.",
)
def against_angle(n):
    """Send packets at a viscous face and count what is left of their energy."""
    readings, curves = [], []
    for wave, angles in ANGLES.items():
        wanted = [sent_back(wave, a) for a in angles]
        found = [measured(wave, a, n) for a in angles]
        readings += [
            Reading.absolute(f"{wave} at {a:g} deg", w, f)
            for a, w, f in zip(angles, wanted, found, strict=True)
        ]
        curves.append(Curve(wave, np.array(angles), np.array(wanted), np.array(found),
                            "angle [deg]", "energy sent back"))  # fmt: skip
    return readings, curves
