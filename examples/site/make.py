"""Write a monitoring folder: log, stations and records of a quarry, simulated with a seed.

    python examples/site/make.py [FOLDER]

Three stations record 24 blasts of two years, and the log plans one more; the vertical channel of
the school loses 60 % after blast 12, and one blast is 3.5 times too strong.
"""

import sys
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

SEED, COUNT, RATE, LENGTH = 78, 24, 256, 0.75
STATIONS = {"farm": (350.0, 120.0), "school": (620.0, -240.0), "mill": (-280.0, 500.0)}
HEADER = """"Serial Number","{serial}"
"Event Time","{time:%H:%M:%S}"
"Event Date","{time:%Y-%m-%d}"
"Sample Rate","256 sps"
"Pre-trigger Length","-0.125 sec"
"Units","mm/s"
"""


def wave(generator, peak, hz):
    """Return three components in mm/s of a blast, (n, 3)."""
    time = np.arange(int(LENGTH * RATE)) / RATE - 0.125
    on = np.where(time > 0.0, np.exp(-time / 0.12) * np.minimum(time / 0.02, 1.0), 0.0)
    phase = generator.uniform(0.0, 2.0 * np.pi, 3)
    size = generator.lognormal(0.0, 0.1, 3) * [1.0, 0.6, 0.8]
    motion = on[:, None] * size * np.sin(2.0 * np.pi * hz * time[:, None] + phase)
    return motion * peak / np.abs(motion).max()


def main(folder):
    """Write the folder."""
    generator = np.random.default_rng(SEED)
    (folder / "records").mkdir(parents=True, exist_ok=True)
    stations = ["name,serial,x (m),y (m),trigger (mm/s)"]
    log = ["blast,date,time,x (m),y (m),charge (kg),bench"]
    for n, (name, (x, y)) in enumerate(STATIONS.items()):
        stations.append(f"{name},BE{4711 + n},{x:g},{y:g},0.3")
    when = datetime(2024, 1, 9, 11, 2)
    for blast in range(1, COUNT + 1):
        when += timedelta(
            days=int(generator.integers(20, 40)), minutes=int(generator.integers(-30, 30))
        )
        at, charge = generator.uniform(-60.0, 60.0, 2), float(generator.integers(20, 90))
        log.append(
            f"B{blast:02d},{when:%Y-%m-%d},{when:%H:%M},{at[0]:.1f},{at[1]:.1f},{charge:g},north"
        )
        strength = generator.lognormal(0.0, 0.12) * (3.5 if blast == 17 else 1.0)
        for n, (name, place) in enumerate(STATIONS.items()):
            scaled = np.linalg.norm(np.subtract(place, at)) / np.sqrt(charge)
            peak = 600.0 * strength * scaled**-1.5 * generator.lognormal(0.0, 0.18)
            motion = wave(generator, peak, generator.normal(18.0, 1.5))
            if name == "school" and blast > 12:
                motion[:, 1] *= 0.4
            if np.abs(motion).max() < 0.3:
                continue  # below the trigger
            began = when + timedelta(seconds=float(generator.integers(0, 240)))
            text = HEADER.format(serial=f"BE{4711 + n}", time=began) + '"Tran","Vert","Long"\n'
            text += "\n".join(",".join(f"{v:.3f}" for v in row) for row in motion) + "\n"
            (folder / "records" / f"{name}_{blast:02d}.csv").write_text(text)
    log.append(
        f"B{COUNT + 1},{when + timedelta(days=30):%Y-%m-%d},11:00,20,-10,60,north"
    )  # planned
    (folder / "stations.csv").write_text("\n".join(stations) + "\n")
    (folder / "blasts.csv").write_text("\n".join(log) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "quarry")
