"""Explosion and point force in a full space: physics rung 17; Stokes (1849), Aki & Richards."""

from functools import cache

import numpy as np
import pytest
from columns import spectrum

from pyblast.meshing.mesh_builder import SIDES, structured_box
from pyblast.solving.boundaries import Viscous
from pyblast.solving.materials import Material
from pyblast.solving.model import Model, Receiver
from pyblast.solving.solver import run
from pyblast.solving.sources import Hole, PointForce, TimeFunction

ROCK = Material.from_speeds(2500.0, 4000.0, 2309.4)
PER_WAVELENGTH, FAR = 10, 3.0
BEHIND, BESIDE, BEYOND = 0.8, 1.4, 0.8  # wavelengths of ground around source and receiver


class Shot:
    """A bell-shaped source whose far field has one dominant frequency."""

    def __init__(self, dominant):
        self.dominant = dominant
        self.peak = 1.1 / dominant

    def bell(self, times, slope=0):
        """Return the bell (n,), or its slope or curvature in time."""
        rate = np.sqrt(2.0) * np.pi * self.dominant
        x = rate * (times - self.peak)
        forms = (1.0, -2.0 * rate * x, rate**2 * (4.0 * x**2 - 2.0))
        return forms[slope] * np.exp(-(x**2))

    def function(self, scale):
        dt = 0.01 / self.dominant
        return TimeFunction(scale * self.bell(np.arange(0.0, 2.2 * self.peak, dt)), dt)


def space(wave_speed, shot, source):
    """Run a source in a box without reflections; return times and motion at FAR wavelengths."""
    length = wave_speed / shot.dominant
    edge = length / PER_WAVELENGTH
    shape = [round(PER_WAVELENGTH * n) for n in (BEHIND + FAR + BEYOND, 2 * BESIDE, 2 * BESIDE)]
    mesh = structured_box(shape, np.array(shape) * edge, pattern="alternating")
    place = np.array([BEHIND, BESIDE, BESIDE]) * length
    receiver = Receiver("far", place + FAR * length * np.eye(3)[0])
    model = Model(
        mesh,
        {"rock": ROCK},
        boundaries=list(map(Viscous, SIDES)),
        sources=[source(place, edge)],
        receivers=[receiver],
    )
    record = run(model, shot.peak + (FAR + 1.0) / shot.dominant).seismograms["far"]
    offset = receiver.position - (place)
    return record.times, record.velocity, offset


@cache
def explosion():
    shot = Shot(20.0)

    def source(place, edge):
        return Hole(place, 25.0, 0.0, shot.function(2e9), exponent=0.5, spread=1.5 * edge)

    times, velocity, offset = space(ROCK.cp, shot, source)
    distance = np.linalg.norm(offset)
    retarded = times - distance / ROCK.cp
    near, far = shot.bell(retarded) / distance**2, shot.bell(retarded, 1) / (ROCK.cp * distance)
    wanted = 1e10 / (4.0 * np.pi * ROCK.density * ROCK.cp**2) * (near + far)
    return times, velocity, np.outer(wanted, offset / distance)


@cache
def point_force():
    """Run a force across the ray, so that the S wave arrives."""
    shot = Shot(20.0 * ROCK.cs / ROCK.cp)
    direction = np.array([0.0, 1.0, 0.0])

    def source(place, edge):
        del edge
        return PointForce(place, direction, shot.function(1e8))

    times, velocity, offset = space(ROCK.cs, shot, source)
    return times, velocity, stokes(times, offset, direction, shot)


def stokes(times, offset, direction, shot):
    """Return the velocity (n, 3) of a force of 1e8 N times the bell; Aki & Richards (4.23)."""
    distance = np.linalg.norm(offset)
    ray = offset / distance
    along = np.outer(ray, ray) @ direction
    delays = np.linspace(distance / ROCK.cp, distance / ROCK.cs, 2001)
    passing = delays * shot.bell(times[:, None] - delays, 1)
    near = np.trapezoid(passing, delays, axis=1)[:, None] * (3.0 * along - direction) / distance**3
    p_wave = shot.bell(times - distance / ROCK.cp, 1)[:, None] * along / ROCK.cp**2
    s_wave = shot.bell(times - distance / ROCK.cs, 1)[:, None] * (along - direction) / ROCK.cs**2
    return 1e8 / (4.0 * np.pi * ROCK.density) * (near + (p_wave - s_wave) / distance)


CASES = {
    "P wave of an explosion": (explosion, 0, 20.0),
    "S wave of a force": (point_force, 1, 20.0 * ROCK.cs / ROCK.cp),
}


@pytest.mark.parametrize("case", CASES)
def test_the_amplitude_at_three_wavelengths_is_the_closed_form(case):
    field, axis, dominant = CASES[case]
    times, found, wanted = field()

    band = dominant * np.array([0.5, 0.7, 1.0])
    ratio = np.abs(spectrum(times, found[:, axis], band))
    ratio /= np.abs(spectrum(times, wanted[:, axis], band))

    assert ratio == pytest.approx(np.ones(3), abs=0.08)


@pytest.mark.parametrize("case", CASES)
def test_the_arrival_at_three_wavelengths_is_the_closed_form(case):
    field, axis, dominant = CASES[case]
    times, found, wanted = field()

    turn = spectrum(times, found[:, axis], [dominant]) / spectrum(
        times, wanted[:, axis], [dominant]
    )
    late = -np.angle(turn[0]) / (2.0 * np.pi)  # in periods, of FAR periods on the way

    assert abs(late) / FAR < 0.025


@pytest.mark.parametrize("case", CASES)
def test_the_motion_points_where_the_closed_form_points(case):
    field, axis, _ = CASES[case]
    _, found, wanted = field()

    other = np.delete(found, axis, axis=1)
    assert np.abs(other).max() < 0.1 * np.abs(found[:, axis]).max()
    best = found[:, axis] @ wanted[:, axis]
    assert best > 0.0
