"""Project files as an engineer has them, and beside each what is to be predicted afterwards."""

from pathlib import Path

import numpy as np

from examples.case_folder import PADDING, PADDING_EDGES, PER_WAVE, write_project
from pyblast.blasts.hole_tables import read_blast
from pyblast.files import write_bytes, write_text
from pyblast.recordings.seismic import mseed_bytes

from .sites import BEFORE, DT, FURTHER, HIDDEN, tables_of

START = "2024-05-01T10:00:00"
CODES = ("HHE", "HHN", "HHZ")
NETWORK = "PB"


def write_case(folder: Path, name, site, records, before=BEFORE * DT):
    """Write the known site with the records of its logged blasts at its known receivers.

    A project file for each blast, of which the first names the others, and what they name.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    name : str
    site : Site
    records : dict of str to (n_receivers, 3, n_samples) float64, m/s
        From ``before`` s before the first hole on.
    before : float, s
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    known = [n for n, r in enumerate(site.receivers) if r.name != HIDDEN]
    receivers = [site.receivers[n] for n in known]
    logged = [blast for blast in site.blasts if blast != FURTHER]
    pulse = site.moment_rate
    times = pulse.start + pulse.dt * np.arange(len(pulse.values))
    rows = [f"{t:.9g},{v:.9g}" for t, v in zip(times, pulse.values, strict=True)]
    head = "time_s,moment_rate_per_kg_Nm_per_s"
    write_text(folder / "source.csv", "\n".join([head, *rows]) + "\n")
    for blast in logged:
        lines, holes = ["id,x,y,z,charge_kg,delay_s"], site.blasts[blast]
        for n, (place, charge, time) in enumerate(
            zip(holes.centres, holes.charge, holes.times, strict=True), 1
        ):
            lines.append(f"{n},{_numbers(place)},{charge:.9g},{time:.9g}")
        write_text(folder / f"{blast}_holes.csv", "\n".join(lines) + "\n")
        channels = [[f"{NETWORK}.{r.name}..{code}" for code in CODES] for r in receivers]
        motion = mseed_bytes(records[blast][known], channels, DT, START)
        write_bytes(folder / f"{blast}.mseed", motion)
        tables = _tables(name, site, receivers, blast, before)
        if blast == logged[0]:
            tables["diagnosis"]["blasts"] = [f"{other}.toml" for other in logged[1:]]
        write_project(folder / f"{blast}.toml", tables)


def _tables(name, site, receivers, blast, before):
    """Return the tables of the project file of a blast."""
    low, high = site.band
    slowest = min(rock.cs for _, _, rock in site.layers)
    tables = tables_of(
        site, name, edges_per_wavelength=PER_WAVE, frequency_hz=high,
        padding_m=PADDING * slowest / low,
        padding_edge_m=PADDING_EDGES * slowest / (PER_WAVE * high),
    )  # fmt: skip
    record = {"file": f"{blast}.mseed", "unit": "m_per_s", "start_s": -before}
    tables["blast"]["file"] = f"{blast}_holes.csv"
    tables["receivers"] = [
        {"name": one.name, "position_m": list(one.position), "recorded": {**record, "record": n}}
        for n, one in enumerate(receivers, 1)
    ]
    return tables


def _numbers(values, between=","):
    """Return numbers as text that TOML and CSV know."""
    return between.join(f"{float(value):.9g}" for value in values)


def write_asked(folder: Path, site):
    """Write what is to be predicted after the diagnosis: a further blast, a further receiver."""
    folder.mkdir(parents=True, exist_ok=True)
    blast = site.blasts[FURTHER]
    rows = zip(blast.hole_ids, blast.centres, blast.charge, blast.times, strict=True)
    lines = [f"{i},{x:.3f},{y:.3f},{z:.3f},{w:.3f},{t:.4f}" for i, (x, y, z), w, t in rows]
    text = "\n".join(["id,x,y,z,charge_kg,delay_s", *lines]) + "\n"
    write_text(folder / "holes.csv", text)
    place = next(r.position for r in site.receivers if r.name == HIDDEN)
    write_text(folder / "receiver.csv", ",".join(map(str, place)) + "\n")


def read_asked(folder: Path):
    """Return the further blast and the place (3,) in m of the further receiver."""
    place = np.loadtxt(folder / "receiver.csv", delimiter=",")
    return read_blast(folder / "holes.csv"), tuple(place.tolist())
