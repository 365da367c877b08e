"""A real hammer hit compared with a simulated one: point force on two layers found by hand.

The ground was chosen from first breaks and phase speeds in a few tries; the force history is
estimated from the four nearest geophones, the other twenty are predicted. Arguments: the
folder, then the edge of the zones in m (0.6, about two minutes on one core).
"""

import sys

import numpy as np
from line_analysis import first_breaks, misfit_map, phase_speeds, with_hammer
from real_figures import draw_gather
from real_line import hits_by_place, keep_results, recordings_folder, seismograms, vertical

from pyblast import (
    Damping,
    Material,
    Model,
    PointForce,
    Receiver,
    Roller,
    SpongeLayer,
    TimeFunction,
    Viscous,
    compare,
    simulate,
    structured_box,
)
from pyblast.mesh.builder import Layer
from pyblast.mesh.grid import graded_axis

PLACE, OPPOSITE, HIT, NEAREST = 51.0, -5.0, 2, 4
DRY, WET, DEPTH = (380.0, 178.0), (1400.0, 231.0), 2.4
BAND, BINS, DURATION, DT = (5.0, 30.0), np.arange(5.0, 33.0, 3.0), 0.55, 1e-3
OFFSETS = 5.0 + 2.0 * np.arange(24)
PULSE_HZ, SPEED_HZ = 15.0, np.array([10.0, 12, 15, 20, 25, 30])


def ground(edge):
    """Return half of the ground, with the line as plane of symmetry and the force at the origin.

    Only the dry layer has stiffness damping; in the fast one it would shorten the time step.
    """
    mesh = structured_box(
        graded_axis((-2.0, 53.0), [0.0], edge, 15.0, 15.0),
        graded_axis((0.0, 2.4), [], edge, 0.0, 18.0),
        graded_axis((-DEPTH, 0.0), [], edge, 20.0, 0.0),
        layers=[Layer("dry", DEPTH), Layer("wet")], pattern="alternating",
    )  # fmt: skip
    times = DT * np.arange(200)
    x = (np.pi * PULSE_HZ * (times - 0.08)) ** 2
    ricker = TimeFunction(1e3 * (1.0 - 2.0 * x) * np.exp(-x), DT)
    return Model(
        mesh,
        {"dry": Material.from_speeds(1900.0, *DRY), "wet": Material.from_speeds(1900.0, *WET)},
        boundaries=(Roller("south"), *map(Viscous, ("west", "east", "north", "bottom"))),
        damping={
            "dry": Damping(0.1, 25.0, mass=False),
            "wet": Damping(0.06, 15.0, stiffness=False),
        },
        sponge=SpongeLayer(((-2.0, 53.0), (0.0, 8.0), (-12.0, 0.0)), 14.0),
        sources=(PointForce(np.zeros(3), np.array([0.0, 0.0, -1.0]), ricker),),
        receivers=tuple(Receiver(f"{x:g} m", (x, 0.0, 0.0)) for x in OFFSETS),
    )


def in_band(motions):
    """Vertical motion in the band from the hit on, (n_receivers, n_samples)."""
    n_samples = round(DURATION / DT)
    return np.array([s.bandpassed(*BAND).sampled(0.0, DT, n_samples).velocity[:, 2]
                     for s in motions])  # fmt: skip


def head_wave(offsets):
    """First arrival of the two layers: direct, or along the water table [s]."""
    delay = 2.0 * DEPTH * np.sqrt(DRY[0] ** -2 - WET[0] ** -2)
    return np.minimum(offsets / DRY[0], offsets / WET[0] + delay)


def compared(hit, response):
    """Compare the records of a hit with the simulation, in the band, from near to far."""
    order = np.argsort(hit.offsets)
    recorded = in_band([seismograms(hit, (-0.4, 0.9))[c] for c in order])
    return recorded, with_hammer(recorded, response, NEAREST)


def lags_of(recorded, simulated):
    """How much later the simulated ground wave comes, by receiver [s]."""
    pairs = [[vertical(x, DT) for x in pair] for pair in zip(recorded, simulated, strict=True)]
    return np.array([compare(d, s, time_frequency=False).lag[2] for d, s in pairs])


def main():
    """Simulate one hit, compare, keep the numbers and draw."""
    arguments = sys.argv[1:]
    places = hits_by_place(recordings_folder(arguments) / "wghs")
    model = ground(float(arguments[1]) if len(arguments) > 1 else 0.6)
    result = simulate(model, DURATION + 0.05)
    response = in_band([result.seismograms[r.name] for r in model.receivers])
    pairs = {place: compared(places[place][HIT], response) for place in (PLACE, OPPOSITE)}
    recorded, simulated = pairs[PLACE]
    hit = places[PLACE][HIT]
    quiet = in_band([s.shifted(0.5) for s in seismograms(hit, (-0.5, 0.0))])[hit.offsets.argsort()]
    lags, breaks = lags_of(recorded, simulated), first_breaks(places[PLACE])
    speeds = [phase_speeds(x, OFFSETS, DT, SPEED_HZ) for x in (recorded, simulated)]
    maps = [misfit_map(d, s, DT, BINS) for d, s in ((recorded, simulated), pairs[OPPOSITE])]
    whole = {f"{p:g} m": np.sum((d - s) ** 2, axis=1) / np.sum(d**2, axis=1)
             for p, (d, s) in pairs.items()}  # fmt: skip
    keep_results("ground_point_force", {
        "band_hz": BAND, "zones": len(model.mesh.zones), "steps": result.prepared.n_steps,
        "dt_ms": 1e3 * result.dt, "wall_s": result.wall_seconds,
        "carried_hz": {group: float(hz) for group, hz in model.highest_frequency().items()},
        "misfit": {p: {"fitted": float(np.median(m[:NEAREST])),
                       "predicted": [float(v) for v in np.percentile(m[NEAREST:], [50, 5, 95])]}
                   for p, m in whole.items()},
        "misfit_by_frequency": {f"{low:g}-{low + 3:g} Hz": [float(np.median(m[NEAREST:, b]))
                                for m in maps] for b, low in enumerate(BINS[:-1])},
        "lag_ms": [1e3 * float(v) for v in np.percentile(lags[NEAREST:], [50, 5, 95])],
        "phase_speed_m_per_s": {f"{hz:g} Hz": [float(v) for v in pair] for hz, pair in
                                zip(SPEED_HZ, np.transpose(speeds), strict=True)},
        "first_break_ms": {"recorded": list(1e3 * breaks[:15]),
                           "two_layers": list(1e3 * head_wave(OFFSETS[:15]))},
    })  # fmt: skip
    draw_gather(OFFSETS, DT, recorded, simulated, quiet, breaks, head_wave(OFFSETS),
                maps[0], BINS, (SPEED_HZ, *speeds), model.highest_frequency(), NEAREST)  # fmt: skip


if __name__ == "__main__":
    main()
