"""Monitoring with hidden changes: what `pyblast site` finds of twelve years of invented records.

    python -m verification.site [COUNT] [--seed N] [--again]

Each site has 36 blasts a year for twelve years, recorded at five stations. A blast is the sum of
24 to 40 holes with drawn charges, firing times and waveforms; a path has its own gain, corner and
polarization. Six changes are hidden, one of each kind, at drawn dates: a sensor turned, a gain
halved, a new bench, ground blasted loose, another explosive, other delays. No code of pyblast makes
them. Scores: dates within two blasts, kinds, false alarms, coverage of the bands before each blast.
"""

import math

import numpy as np

from pyblast.line_records.changes import residuals
from pyblast.line_records.monitoring import features_of

YEARS, A_YEAR, STATIONS, RATE, SAMPLES = 12, 36, 5, 256, 384
HIDDEN = {  # what is hidden, and the kind that names it
    "turned": "orientation", "halved": "gain", "bench": "ground", "loosened": "ground",
    "explosive": "charge", "delays": "timing",
}  # fmt: skip
TRIGGER = 2.5e-4  # m/s
NEAR = 2  # blasts by which a date may be off


def site(seed: int) -> dict:
    """Make a site: places, charges, motions and the blasts from which each change holds."""
    draw = np.random.default_rng([78, seed])
    count = YEARS * A_YEAR
    firsts = np.sort(draw.choice(np.arange(2, count // 12 - 2), len(HIDDEN), replace=False)) * 12
    firsts = firsts + draw.integers(-4, 5, len(HIDDEN))
    hidden = dict(zip(draw.permutation(list(HIDDEN)), firsts.tolist(), strict=True))
    angle = draw.uniform(0.0, 2.0 * np.pi, STATIONS)
    far = draw.uniform(250.0, 700.0, STATIONS)
    stations = np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)
    at = np.cumsum(draw.normal([0.25, 0.0], 2.0, (count, 2)), axis=0)
    bench = np.arange(count) >= hidden["bench"]
    way = draw.uniform(0.0, 2.0 * np.pi)
    at[bench] += 120.0 * np.array([np.cos(way), np.sin(way)])
    path = np.tile(draw.normal(0.0, 0.35, STATIONS), (count, 1))
    path[bench] += draw.normal(0.0, 0.35, STATIONS)
    corner = np.tile(draw.uniform(14.0, 26.0, STATIONS), (count, 1))
    loose = np.arange(count) >= hidden["loosened"]
    behind = draw.permutation(STATIONS)[: draw.integers(1, 4)]
    path[np.ix_(loose, behind)] -= draw.uniform(0.3, 0.6)
    corner[np.ix_(loose, behind)] *= draw.uniform(0.7, 0.85)
    strength = np.where(np.arange(count) >= hidden["explosive"], draw.choice([-0.35, 0.35]), 0.0)
    delay = np.where(np.arange(count) >= hidden["delays"], draw.choice([0.009, 0.042]), 0.025)
    gains, turns = np.ones((count, STATIONS)), np.zeros((count, STATIONS))
    gains[hidden["halved"] :, draw.integers(STATIONS)] = 0.5
    turns[hidden["turned"] :, draw.integers(STATIONS)] = draw.choice([-1, 1]) * draw.uniform(
        0.5, 1.5
    )
    charge, motion = np.zeros(count), np.zeros((count, STATIONS, SAMPLES, 3))
    polar = draw.uniform(-0.5, 0.5, STATIONS)
    for b in range(count):
        motion[b], charge[b] = _blast(draw, stations - at[b], delay[b], path[b] + strength[b],
                                      corner[b], polar, gains[b], turns[b])  # fmt: skip
    lost = draw.uniform(size=(count, STATIONS)) < 0.08
    return {"hidden": hidden, "stations": stations, "at": at, "charge": charge, "motion": motion,
            "recorded": ~lost & (np.abs(motion).max(axis=(2, 3)) > TRIGGER)}  # fmt: skip


def _blast(draw, away, delay, level, corner, polar, gains, turns):
    """Return the motions (n_stations, n_samples, 3) in m/s of a blast, and its charge in 8 ms."""
    holes = int(draw.integers(24, 41))
    charge = draw.uniform(35.0, 70.0) * draw.lognormal(0.0, 0.1, holes)
    times = delay * np.arange(holes) * 0.5 + draw.normal(0.0, 0.002, holes) + 0.05
    common = level + draw.normal(0.0, 0.12)
    time = np.arange(SAMPLES) / RATE
    motion = np.zeros((len(away), SAMPLES, 3))
    for s, (east, north) in enumerate(away):
        far, azimuth = math.hypot(east, north), math.atan2(north, east)
        hz = corner[s] * (far / 400.0) ** -0.3 * draw.lognormal(0.0, 0.05, holes)
        size = draw.lognormal(0.0, 0.25, holes) * charge**0.7 * 6.0 * far**-1.5
        since = time[:, None] - times - far / 2500.0
        since = np.maximum(since, 0.0)
        parts = []
        for weight, slow in ((1.0, 1.0), (0.45, 0.8), (0.7, 1.1)):
            phase = 2.0 * np.pi * hz * slow * since
            envelope = hz * since * np.exp(-0.6 * hz * since)
            parts.append(weight * (envelope * size * np.sin(phase + draw.normal(0.0, 0.4))).sum(1))
        radial, across, upright = np.array(parts) * np.exp(common[s] + draw.normal(0.0, 0.1))
        wave = (radial + 1j * across) * np.exp(1j * (azimuth + polar[s] + draw.normal(0, 0.08)))
        wave = gains[s] * wave * np.exp(1j * turns[s])
        motion[s] = 0.15 * np.stack([wave.real, wave.imag, gains[s] * upright], axis=1)
    window = np.arange(0.0, times.max(), 0.001)[:, None]
    inside = (times >= window) & (times < window + 0.008)
    return motion, float((inside * charge).sum(axis=1).max())


def measured(made: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return the residuals of a site, and log10 of distance and charge."""
    features = features_of(made["motion"], 1.0 / RATE)
    features[~made["recorded"]] = np.nan
    away = made["at"][:, None] - made["stations"]
    far = np.linalg.norm(away, axis=-1)
    scaled = np.log10(np.stack([far, np.broadcast_to(made["charge"][:, None], far.shape)], axis=-1))
    return residuals(features, scaled, np.arctan2(away[..., 1], away[..., 0])), scaled


def scored(hidden: dict[str, int], result: list) -> dict:
    """Compare the changes that were found with those that were hidden."""
    rest, rows = list(result), {}
    for name, first in sorted(hidden.items(), key=lambda row: row[1]):
        near = [c for c in rest if abs(c.blast - first) <= 10]
        right = [c for c in near if HIDDEN[name] in c.kinds]
        one = min(right or near, key=lambda c: abs(c.blast - first), default=None)
        if one is not None:
            rest.remove(one)
        rows[name] = None if one is None else {
            "off": one.blast - first, "kinds": list(one.kinds), "right": HIDDEN[name] in one.kinds,
            "inside": one.interval[0] <= first <= one.interval[1],
        }  # fmt: skip
    return {"found": rows, "false": [(c.blast, list(c.kinds), c.station) for c in rest]}
