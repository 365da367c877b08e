"""Ground whose stiffness depends on direction: wave speeds, joints as a medium, viscous faces."""

import numpy as np

from pyblast import core
from pyblast.mesh.builder import structured_box
from pyblast.mesh.mesh import Mesh
from pyblast.model.anisotropy import christoffel, jointed, transverse
from pyblast.model.boundary import Fixed, StressInput, Viscous
from pyblast.model.joint import Joint
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.signals.seismogram import Seismogram
from pyblast.solver.preparation import prepare
from pyblast.solver.run import simulate
from verification.ladder import Curve, Reading, rung

SCHIST = transverse(
    2700.0, (np.sin(0.6), 0.0, np.cos(0.6)), young=60e9, young_normal=30e9,
    poisson=0.2, poisson_normal=0.15, shear_normal=12e9,
)  # fmt: skip
DIRECTIONS = np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [-1, 0, 1], [0, 1, 1], [1, 1, 1]]
)
ROCK = Material.from_speeds(2700.0, 4000.0, 2300.0)
JOINTS_PER_WAVE, LENGTH, SHARE = 15, 100.0, 0.53  # share: speed over that of the intact rock


def mesh_speeds(material, per_wavelength, direction):
    """Return the three speeds (3,) that a grid of cubes of one metre gives plane waves."""
    mesh = structured_box((4, 4, 4), (4.0, 4.0, 4.0))
    prepared = prepare(Model(mesh, {"rock": material}, _ordered=True), 1e-3)
    views = core.to_fortran(prepared.constants)
    middle = int(np.flatnonzero((mesh.points == 2.0).all(axis=1))[0])
    wave = 2.0 * np.pi / per_wavelength * direction
    phase = (mesh.points - mesh.points[middle]) @ wave
    matrix = np.zeros((3, 3), dtype=complex)
    for axis in range(3):
        for part, unit in ((np.cos, 1.0), (np.sin, 1j)):
            state = {name: value.copy() for name, value in prepared.state.items()}
            state["displacement"][:, axis] = part(phase)
            core.advance(views, state, 0, 1, 10**6)
            matrix[:, axis] -= unit * state["velocity"][middle] / prepared.constants["dt"]
    return np.sqrt(np.linalg.eigvalsh(matrix)) / np.linalg.norm(wave)


def jointed_column(edges_per_spacing, *, ends=False, told=False):
    """Return gain, speed and motion of a P wave among joints.

    Parameters
    ----------
    edges_per_spacing : int
    ends : bool
        Whether both ends are ground with the joints as a medium.
    told : bool
        Whether the faces, with joints up to them, count with that medium.
    """
    spacing = LENGTH / JOINTS_PER_WAVE
    kn = ROCK.density * ROCK.cp**2 / spacing / (SHARE**-2 - 1.0)
    edge, length, beyond = spacing / edges_per_spacing, 76.0 * spacing, 8 * int(ends)
    joints = spacing * (np.arange(beyond, 76 - beyond) + 0.5)
    places = np.arange(0.0, length + 0.5 * edge, 0.5 * edge)
    mesh = structured_box(places, [0.0, 0.4 * edge], [0.0, 0.4 * edge], planes={"J": ("x", joints)})
    middle = mesh.points[mesh.zones].mean(axis=1)[:, 0]
    soft = (middle < beyond * spacing) | (middle > length - beyond * spacing)
    mesh = Mesh(mesh.points, mesh.zones, soft.astype(int), ("rock", "soft"), mesh.surfaces)
    frequency = SHARE * ROCK.cp / LENGTH
    times = np.arange(0.0, 4.0 / frequency, 0.01 / frequency)
    phase = (np.pi * (frequency * times - 1.5)) ** 2
    pulse = np.outer((1.0 - 2.0 * phase) * np.exp(-phase), [1.0, 0.0, 0.0])
    sides = [Fixed(side, ("north", "vertical")) for side in ("south", "north", "bottom", "top")]
    mine = [20.0 * spacing, 30.0 * spacing]
    medium = jointed(ROCK, (1.0, 0.0, 0.0), spacing, kn, 0.5 * kn)
    media = {"rock": medium} if told else {}
    model = Model(
        mesh.split(["J"]),
        {"rock": ROCK, "soft": medium},
        joints=[Joint("J", "elastic", {"kn": kn, "ks": 0.5 * kn})],
        boundaries=[
            *sides, Viscous("west", media), Viscous("east", media),
            StressInput("west", Seismogram(pulse, times[1])),
        ],
        receivers=[Receiver(f"{x}", (x, 0.1 * edge, 0.1 * edge)) for x in mine],
    )  # fmt: skip
    found = list(simulate(model, 8.0 / frequency).seismograms.values())
    waves = [s.velocity[:, 0] @ np.exp(2j * np.pi * frequency * s.times) * s.dt for s in found]
    asked = pulse[:, 0] @ np.exp(2j * np.pi * frequency * times) * times[1]
    lag = np.angle(waves[1] / waves[0]) % (2.0 * np.pi)
    speed = 2.0 * np.pi * frequency * (mine[1] - mine[0]) / lag
    late = found[1].times - mine[1] / (SHARE * ROCK.cp)
    wanted = np.interp(late, times, pulse[:, 0], left=0.0, right=0.0)
    curve = Curve(
        "among joints", found[1].times, wanted, found[1].velocity[:, 0], "time (s)",
        "velocity over the one asked",
    )  # fmt: skip
    return abs(waves[0]) / abs(asked), speed, curve


@rung(
    "L1",
    "Anisotropic ground: wave speeds in turned axes, joints as a medium, viscous faces",
    source="Christoffel's equation; Schoenberg (1980)",
    gate="C",
    tolerance={
        "fastest wave": 0.01,
        "slower waves": 0.01,
        "speed across joints": 0.01,
        "motion of a face with the medium's impedance": 0.02,
        "motion of a face with jointed impedance": 0.02,
    },
    meshes=(15, 30, 45),
    order=1.8,
    ordered=("fastest wave", "slower waves"),
    note=(
        "the grid of six tetrahedra round one diagonal has the errors of case 2; one joint in 15 "
        "edges, one in 30 is 2 edges and so on"
    ),
)
def anisotropic_ground(per_wavelength):
    """Speeds of a dipping schist in eight directions; a column of joints and its equivalent."""
    found, exact = [], []
    for direction in DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1)[:, None]:
        moduli = np.linalg.eigvalsh(christoffel(SCHIST.law.stiffness, direction))
        exact.append(np.sqrt(moduli / SCHIST.density))
        found.append(mesh_speeds(SCHIST, per_wavelength, direction))
    found, exact = np.array(found), np.array(exact)
    error = np.abs(found / exact - 1.0)
    fast, (row, wave) = error[:, 2].argmax(), np.unravel_index(error[:, :2].argmax(), (8, 2))
    edges = per_wavelength // JOINTS_PER_WAVE
    gain, speed, curve = jointed_column(edges, ends=True)
    told, *_ = jointed_column(edges, told=True)
    bare, *_ = jointed_column(edges)
    readings = [
        Reading.relative("fastest wave", exact[fast, 2], found[fast, 2]),
        Reading.relative("slower waves", exact[row, wave], found[row, wave]),
        Reading.relative("speed across joints", SHARE * ROCK.cp, speed),
        Reading.relative("motion of a face with the medium's impedance", 1.0, gain),
        Reading.relative("motion of a face with jointed impedance", 1.0, told),
        Reading.relative("the same, face of intact rock", 1.0, bare),
    ]
    return readings, [curve]
