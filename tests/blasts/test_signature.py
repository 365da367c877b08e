import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pyblast.blasts.published_laws import HARD_ROCK
from pyblast.blasts.signature import (
    CavityPulse,
    SmoothPulse,
    cavity_moment,
    cavity_response,
    cavity_seismogram,
    cavity_signature,
    pressure_for_peak,
)
from pyblast.errors import InputError

DENSITY, CP, CS, RADIUS = 4500.0, 3393.9, 1813.5, 4.0
ROCK = (DENSITY, CP, CS, RADIUS)
SHEAR = DENSITY * CS**2
LAME = DENSITY * CP**2 - 2.0 * SHEAR
PRESSURE, RISE, DECAY = 1e8, 0.004, 0.03
PULSE = CavityPulse(PRESSURE, RISE, DECAY)


def radial(distance, dt=2e-5, duration=0.2, rise=RISE, decay=DECAY):
    return cavity_signature(*ROCK, PRESSURE, distance, dt, duration, rise, decay)


def displacement(distance, dt):
    velocity = radial(distance, dt, duration=0.05)
    return dt * np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))])


def test_the_wall_of_the_cavity_carries_the_pressure():
    step, dt = 0.02, 2e-6
    near = np.array([displacement(RADIUS + n * step, dt) for n in range(4)])
    slope = (-11 * near[0] + 18 * near[1] - 9 * near[2] + 2 * near[3]) / (6 * step)
    stress = (LAME + 2 * SHEAR) * slope + 2 * LAME * near[0] / RADIUS

    times = np.arange(len(stress)) * dt
    later = times > 0.001
    assert stress[later] == pytest.approx(-PULSE(times)[later], abs=2e-3 * PRESSURE)


def test_the_closed_form_solves_the_equation_of_the_cavity():
    distance, dt = 39.0, 1e-4
    late = (distance - RADIUS) / CP

    def march(time, state):
        force = -(RADIUS / DENSITY) * PULSE(np.array(time))
        pull = 4 * CS**2 * (state[1] / (CP * RADIUS) + state[0] / RADIUS**2)
        return [state[1], force - pull]

    times = np.arange(1001) * dt
    solution = solve_ivp(march, (0, 0.1), [0, 0], t_eval=times, rtol=1e-10, atol=1e-14)
    first = solution.y[1]
    second = np.array([march(t, y)[1] for t, y in zip(times, solution.y.T, strict=True)])
    expected = -second / (CP * distance) - first / distance**2

    found = cavity_signature(
        DENSITY, CP, CS, RADIUS, PRESSURE, distance, 1e-6, 0.1 + late, RISE, DECAY
    )
    at = np.interp(times + late, np.arange(len(found)) * 1e-6, found)
    assert at == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_nothing_moves_before_the_wave_arrives():
    distance, dt = 39.0, 1e-4
    quiet = np.arange(2001) * dt < (distance - RADIUS) / CP

    assert np.all(radial(distance, dt)[quiet] == 0.0)


def test_a_lasting_pressure_ends_in_the_static_displacement():
    dt, distance = 1e-4, 39.0
    velocity = radial(distance, dt, duration=0.6, rise=0.004, decay=1e4)
    static = CavityPulse(PRESSURE, 0.004, 1e4)(np.array([0.6]))[0] * RADIUS**3
    static /= 4 * SHEAR * distance**2

    assert dt * np.sum(velocity) == pytest.approx(static, rel=1e-3)


def test_the_moment_belongs_to_the_static_displacement_of_an_explosion():
    distance = 500.0
    static = PRESSURE * RADIUS**3 / (4 * SHEAR * distance**2)
    moment = cavity_moment(RADIUS, PRESSURE, CP, CS)

    assert moment / (4 * np.pi * DENSITY * CP**2 * distance**2) == pytest.approx(static, rel=1e-12)


def test_far_away_the_peak_falls_with_distance():
    near, far = (np.max(np.abs(radial(r, duration=1.0))) for r in (1000.0, 2000.0))

    assert near / far == pytest.approx(2.0, rel=0.01)


def test_any_history_gives_what_the_closed_form_gives():
    marched = cavity_response(*ROCK, lambda times: PULSE(times), 39.0, 1e-5, 0.1)
    closed = cavity_response(*ROCK, PULSE, 39.0, 1e-5, 0.1)

    assert marched == pytest.approx(closed, abs=1e-4 * np.abs(closed).max())


@pytest.mark.parametrize("pulse", [PULSE, SmoothPulse(PRESSURE, 0.02)])
def test_a_pulse_peaks_at_its_pressure(pulse):
    assert pulse(np.linspace(-0.1, 0.3, 100001)).max() == pytest.approx(PRESSURE, rel=1e-6)


def test_three_components_point_along_the_ray():
    seismogram = cavity_seismogram(
        *ROCK,
        SmoothPulse(PRESSURE, 0.02),
        source=(1, 2, 3),
        receiver=(31, 42, 3),
        dt=1 / 1024,
        duration=0.5,
    )

    assert seismogram.ppv / seismogram.pvs == pytest.approx([0.6, 0.8, 0.0], abs=1e-9)


@pytest.mark.parametrize("pulse", [CavityPulse(1.0, 0.005, 0.03), SmoothPulse(1.0, 0.02)])
def test_the_pressure_is_chosen_for_the_wanted_peak(pulse):
    scaled = pressure_for_peak(*ROCK, pulse, 39.0, 0.19)
    motion = cavity_response(*ROCK, scaled, 39.0, 1e-5, 0.3)

    assert np.abs(motion).max() == pytest.approx(0.19, rel=1e-3)


def test_the_assumed_law_keeps_450_kg_at_39_m_below_the_clipping_level():
    assert HARD_ROCK.ppv(39.0, 450.0) == pytest.approx(0.1887, abs=1e-4)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cs": 3300.0}, "cp: must exceed"),
        ({"density": -1.0}, "density: must be positive"),
        ({"distance": 1.0}, "at least the radius"),
        ({"dt": 0.0}, "need 0 < dt"),
        ({"dt": 1e-12}, "more than 160000000 samples"),
        ({"rise": 0.5}, "0 < rise < decay"),
    ],
)
def test_an_impossible_cavity_is_refused(changes, message):
    values = {
        "density": DENSITY,
        "cp": CP,
        "cs": CS,
        "radius": RADIUS,
        "pressure": PRESSURE,
        "distance": 39.0,
        "dt": 1e-3,
        "duration": 0.1,
        "rise": RISE,
        "decay": DECAY,
    }

    with pytest.raises(InputError, match=message):
        cavity_signature(**{**values, **changes})
