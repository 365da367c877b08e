"""Shear waves at joints with rough walls and at joints that yield, from their own equations.

Sources: Barton and Choubey (1977) for the strength, Barton's table for its wear; continuously
yielding joints by theory.md (3.17) to (3.19). Nothing is shared with pyblast.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

SLIP_OVER_PEAK = (1.0, 2.0, 4.0, 10.0, 25.0, 100.0)
MOBILISED = (1.0, 0.85, 0.7, 0.5, 0.4, 0.0)


@dataclass(frozen=True)
class RoughWalls:
    """A joint that Bandis closes and Barton slips: Pa/m, m, degrees, Pa, tangent, m."""

    stiffness: float
    closure: float
    jrc: float
    jcs: float
    friction: float
    peak_slip: float

    def roughness(self, pressure, slid):
        """Return the angle in rad that the roughness adds after a length of slip."""
        worn = np.interp(np.log(max(slid / self.peak_slip, 1e-300)),
                         np.log(SLIP_OVER_PEAK), MOBILISED)  # fmt: skip
        return np.radians(worn * self.jrc * max(0.0, np.log10(self.jcs / pressure)))

    def strength(self, pressure, slid=0.0):
        """Return the shear strength in Pa."""
        angle = np.arctan(self.friction) + self.roughness(pressure, slid)
        return pressure * np.tan(min(angle, np.radians(70.0)))

    def pressure(self, before, dilated):
        """Return the pressure in Pa of walls that are held while they dilate."""
        start = self.closure * before / (self.stiffness * self.closure + before)
        closed = start + dilated
        return self.stiffness * closed / (1.0 - closed / self.closure)


def past_rough_walls(times, incident, impedance, walls, pressure):
    """Return the velocity (n,) behind rough walls that stick, or slip, dilate and wear.

    Parameters
    ----------
    times : (n,) float, s
    incident : callable
        Velocity in m/s of the incident shear wave.
    impedance : float, Pa s/m
    walls : RoughWalls
        Rigid in shear; held in the normal direction, so that dilation presses them.
    pressure : float, Pa
        Before the wave.

    Notes
    -----
    The wave is clipped at the strength, and what is missing slips: with the length of slip L and
    the dilation d, ``dL/dt = 2 |v_I - v_T|``, ``dd/dt = tan(i/2) dL/dt``.
    """

    def limit(state):
        return walls.strength(walls.pressure(pressure, state[1]), state[0]) / impedance

    def rate(t, state):
        slid = 2.0 * max(0.0, abs(incident(t)) - limit(state))
        angle = walls.roughness(walls.pressure(pressure, state[1]), state[0])
        return [slid, slid * np.tan(0.5 * angle)]

    found = solve_ivp(rate, times[[0, -1]], [0.0, 0.0], t_eval=times, rtol=1e-7, atol=1e-12,
                      max_step=(times[-1] - times[0]) / 4000.0)  # fmt: skip
    limits = np.array([limit(state) for state in found.y.T])
    return np.clip([incident(t) for t in times], -limits, limits)


@dataclass(frozen=True)
class Yielding:
    """A joint under constant pressure that yields from the start: Pa/m, Pa, angles in rad, m."""

    stiffness: float
    pressure: float
    last: float
    first: float
    roughness: float

    def strength(self, angle):
        """Return the shear that is approached, and never exceeded, in Pa."""
        return self.pressure * np.tan(angle)

    def growth(self, state, speed, way, ratio):
        """Return the rates of (shear, angle) where the walls slide at a speed along +1 or -1."""
        share = (1.0 - way * state[0] / self.strength(state[1])) / (1.0 - ratio)
        share = min(1.0, max(0.0, share))
        wear = (state[1] - self.last) * (1.0 - share) / self.roughness
        return np.array([way * share * self.stiffness * speed, -wear * speed])

    def turned(self, state, way):
        """Return r where the motion turns to +1 or -1."""
        return min(0.75, way * state[0] / self.strength(state[1]))


def led_by(law, turns, points):
    """Lead a yielding joint from rest to each turn (m); return place and shear (n,), points each.

    Where the shear meets the strength that slip wears down, it stays there to the next turn.
    """
    state, ratio, place = np.array([0.0, law.first]), 0.0, 0.0
    places, shears = [np.zeros(1)], [np.zeros(1)]
    for number, goal in enumerate(turns):
        way, at = np.sign(goal - place), np.linspace(0.0, abs(goal - place), points + 1)
        ratio = law.turned(state, way) if number else 0.0

        def meets(_, y, way=way):
            return law.strength(y[1]) - way * y[0]

        meets.terminal = True
        part = solve_ivp(lambda _, y, w=way, r=ratio: law.growth(y, 1.0, w, r), (0.0, at[-1]),
                         state, dense_output=True, events=meets, method="LSODA",
                         rtol=1e-10, atol=1e-10)  # fmt: skip
        met = part.t[-1]
        shear, angle = part.sol(np.minimum(at, met))
        after = law.last + (angle - law.last) * np.exp(-np.maximum(0.0, at - met) / law.roughness)
        shear = np.where(at > met, way * law.strength(after), shear)
        places.append(place + way * at[1:])
        shears.append(shear[1:])
        state, place = np.array([shear[-1], after[-1]]), goal
    return np.concatenate(places), np.concatenate(shears)


def past_yielding(times, incident, impedance, law):
    """Return the velocity (n,) behind a yielding joint; arguments as `past_rough_walls`.

    Notes
    -----
    The walls slide with ``2 (v_I - v_T)``, the shear stress is ``z v_T``. By the rule of Heun in
    8 steps between two times; where the motion turns, r is taken anew.
    """
    state, ratio, way = np.array([0.0, law.first]), 0.0, 1.0
    step = (times[1] - times[0]) / 8.0
    found = np.zeros(len(times))
    for number, time in enumerate(times[:-1]):
        for now in time + step * np.arange(8):
            slide = 2.0 * (incident(now) - state[0] / impedance)
            if way * slide < 0.0:
                way = -way
                ratio = law.turned(state, way)
            first = law.growth(state, abs(slide), way, ratio)
            guess = state + step * first
            ahead = 2.0 * way * (incident(now + step) - guess[0] / impedance)
            second = law.growth(guess, max(0.0, ahead), way, ratio)
            state = state + 0.5 * step * (first + second)
            limit = law.strength(state[1])
            state[0] = min(limit, max(-limit, state[0]))
        found[number + 1] = state[0] / impedance
    return found
