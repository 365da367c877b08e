"""Plane waves from outside: what faces that see them send back, tilted ground. Cases L8, L5."""

from dataclasses import replace

import numpy as np

from pyblast.mesh.builder import structured_box
from pyblast.model.boundary import Fixed, Viscous
from pyblast.model.material import Material
from pyblast.model.model import Model, Receiver
from pyblast.model.plane_wave import PlaneWave
from pyblast.model.source import TimeFunction
from pyblast.solver.run import simulate
from verification.cases.quiet_faces import sent_back
from verification.columns import ricker, spectrum
from verification.solutions.free_surface import plane_field, surface_gain
from verification.suite import Curve, Reading, case

ROCK = Material.from_speeds(2500.0, 2000.0 * np.sqrt(3.0), 2000.0)
FREQUENCY = 20.0
WAVELENGTH = ROCK.cs / FREQUENCY
EAST = np.pi / 2.0
GROUND = (("P", 30.0), ("P", 65.0), ("SV", 20.0), ("SH", 50.0))
ONE_SIDED = ("P", "SV", "SH")
DIAGONAL = 45.0
TILT = 20.0
BAND = np.linspace(0.5, 1.5, 41) * FREQUENCY


def pulse():
    """Return the history of the waves."""
    times = np.arange(0.0, 3.0 / FREQUENCY, 0.01 / FREQUENCY)
    return TimeFunction(ricker(times, FREQUENCY), times[1])


def slab_model(n, size, wave, quiet, **parts):
    """Return a slab one cell thick, along the path of a wave that runs east."""
    edge = WAVELENGTH / n
    nx, nz = (round(length * n) for length in size)
    mesh = structured_box((nx, 1, nz), (nx * edge, edge, nz * edge), pattern="alternating")
    held = ("east", "vertical") if wave.wave == "SH" else ("north",)
    guides = [Fixed(side, held) for side in ("south", "north")]
    boundaries = [*guides, *map(Viscous, quiet)]
    return Model(mesh, {"rock": ROCK}, boundaries=boundaries, sources=[wave], **parts)


def scattered(model, trains, first):
    """Return times, energy of motion that should be there, and of that which should not.

    Parameters
    ----------
    model : Model
    trains : list of (slowness (3,), motion (3,))
        Along the axes of the model.
    first : float, s
        When they would all pass the origin, less the time of the run.
    """
    last = max((model.mesh.points @ s).max() for s, _ in trains) - first
    times = np.linspace(0.02, last + 3.0 / FREQUENCY, 40)
    result = simulate(model, times[-1], snapshot_times=times)
    history, mass = pulse(), result.prepared.constants["node_mass"]
    energies = []
    for time, velocity in result.snapshots.items():
        at = time - 0.5 * result.dt + first
        wanted = sum(np.outer(history(at - model.mesh.points @ s), motion) for s, motion in trains)
        energies.append([time, *((mass @ v**2).sum() for v in (wanted, velocity - wanted))])
    return np.array(energies).T


def over_ground(n, wave, angle):
    """Return the energies of `scattered` of a block under free ground, all faces seeing a wave."""
    plane = PlaneWave(wave, pulse(), EAST, np.radians(angle))
    model = slab_model(n, (2.0, 1.5), plane, ("west", "east", "bottom"))
    trains = [
        (s, motion * [1.0, -1.0, 1.0])  # north is across the path to the left
        for s, motion in plane_field(wave, np.radians(angle), ROCK.cp, ROCK.cs)
    ]
    lift = model.mesh.points[:, 2].max() * np.array([0.0, 0.0, 1.0])
    shifted = model.mesh.points - lift
    model_first = (shifted @ trains[0][0]).min()
    moved = replace(model, mesh=replace(model.mesh, points=shifted))
    return scattered(moved, trains, model_first)


def one_blind_face(n, wave):
    """Return the energies of a block without ground where one face does not see what leaves."""
    plane = PlaneWave(wave, pulse(), EAST, np.radians(DIAGONAL), ("west", "bottom", "top"))
    model = slab_model(n, (2.0, 2.0), plane, ("west", "east", "bottom", "top"))
    slowness = plane.direction / (ROCK.cp if wave == "P" else ROCK.cs)
    return scattered(model, [(slowness, plane.polarisation)], 0.0)


@case(
    "L8",
    "Plane waves of any incidence through viscous faces",
    source="plane waves of a homogeneous half space, Aki & Richards (2002); case 12",
    gate="C",
    tolerance={
        **{f"{wave} at {angle:g} deg": 0.02 for wave, angle in GROUND},
        **{f"{wave} at 45 deg, one blind face": 0.02 for wave in ONE_SIDED},
    },
    meshes=(10.0, 15.0, 22.5),
    unit="edges per S wavelength",
    order=0.9,
    ordered=tuple(f"{wave} at {angle:g} deg" for wave, angle in GROUND),
    note="Largest energy of motion that the half space would not have, over the largest that it "
    "has: 0 where all faces receive the wave as input; where the face through which it leaves "
    "does not, at most the share of case 12, and only the excess counts as error. On coarse "
    "meshes most of it is the lag of waves inside.",
)
def plane_waves_from_outside(n):
    """Send pulses through blocks and subtract what a half space would do."""
    readings, curves = [], []
    for wave, angle in GROUND:
        times, there, beyond = over_ground(n, wave, angle)
        name = f"{wave} at {angle:g} deg"
        readings.append(Reading.absolute(name, 0.0, beyond.max() / there.max()))
        if wave != "SH":
            curves.append(Curve(name, times, 0.0 * times, beyond / there.max(), "time [s]",
                                "energy beyond the half space"))  # fmt: skip
    for wave in ONE_SIDED:
        _, there, beyond = one_blind_face(n, wave)
        most, found = sent_back(wave, DIAGONAL), float(beyond.max() / there.max())
        name = f"{wave} at 45 deg, one blind face"
        readings.append(Reading(name, most, found, max(0.0, found - most)))
    return readings, curves


def tilted_ground(n, wave):
    """Return the spectral gain (3, n_frequencies) of ground that dips, under a wave from below.

    Axes: down the slope, across it, out of the ground.
    """
    plane, rise = PlaneWave(wave, pulse(), EAST, 0.0), np.tan(np.radians(TILT))
    model = slab_model(n, (3.0, 1.2), plane, ("west", "east", "bottom"))
    points = model.mesh.points.copy()
    length, height = points[:, 0].max(), points[:, 2].max()
    points[:, 2] += rise * (length - points[:, 0]) * points[:, 2] / height
    middle = (0.5 * length, 0.5 * WAVELENGTH / n, height + 0.5 * rise * length - 1e-6)
    model = replace(
        model,
        mesh=replace(model.mesh, points=points),
        receivers=[Receiver("ground", middle)],
    )
    record = simulate(model, 0.35).seismograms["ground"]
    turn, history = np.radians(TILT), pulse()
    axes = np.array([
        [np.cos(turn), 0.0, -np.sin(turn)], [0.0, 1.0, 0.0], [np.sin(turn), 0.0, np.cos(turn)],
    ])  # fmt: skip
    given = spectrum(record.times, history(record.times), BAND)
    motion = record.velocity @ axes.T
    return np.array([np.abs(spectrum(record.times, v, BAND) / given) for v in motion.T])


@case(
    "L5",
    "Tilted ground under plane waves",
    source="reflection at a free surface, Aki & Richards (2002)",
    gate="C",
    tolerance={f"{wave}, ground at 20 deg": 0.05 for wave in ONE_SIDED},
    meshes=(10.0, 15.0, 22.5),
    unit="edges per S wavelength",
    order=1.8,
    note="Gain of both components of the ground from half to one and a half times the dominant "
    "frequency, norm of the difference; P, SV and SH travel vertically upwards, so they meet "
    "ground dipping 20 deg as they would meet level ground at 20 deg.",
)
def tilted_half_space(n):
    """Compare the gain of dipping ground with that of level ground under inclined waves."""
    readings, curves = [], []
    for wave in ONE_SIDED:
        found = tilted_ground(n, wave)
        wanted = np.abs(surface_gain(wave, np.radians(TILT), ROCK.cp, ROCK.cs))
        expected = np.repeat(wanted[:, None], len(BAND), axis=1)
        readings.append(Reading.norm(f"{wave}, ground at 20 deg", expected, found))
        axis = int(np.argmax(wanted))
        curves.append(Curve(f"{wave}, largest component", BAND, expected[axis], found[axis],
                            "frequency [Hz]", "gain"))  # fmt: skip
    return readings, curves
