"""Case folders as an engineer has them, and beside each what is to be foretold afterwards."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from pyblast.blasts.hole_tables import read_blast
from pyblast.project.result import write_text
from pyblast.project.site_file import write_site
from pyblast.recordings.recording import Recording
from pyblast.signals.seismogram import Seismogram

from .sites import BEFORE, DT, FURTHER, HIDDEN

START = "2024-05-01T{:02d}:00:00"


def write_case(folder: Path, name, site, records):
    """Write the believed site with the records of its logged blasts at its known receivers."""
    known = [n for n, r in enumerate(site.receivers) if r.name != HIDDEN]
    logged = [blast for blast in site.blasts if blast != FURTHER]
    write_site(
        folder,
        replace(
            site, name=name, receivers=tuple(site.receivers[n] for n in known),
            blasts={blast: site.blasts[blast] for blast in logged},
            records={
                blast: {site.receivers[n].name: _recording(records[blast][n]) for n in known}
                for blast in logged
            },
            time_zeros={blast: START.format(10 + k) for k, blast in enumerate(logged)},
        ),
    )  # fmt: skip


def _recording(velocity):
    """Return a recording of velocity (3, n_samples) in m/s."""
    seismogram = Seismogram(velocity.T, DT, -BEFORE * DT, "")
    return Recording(seismogram, "", "", None, np.zeros(velocity.T.shape, dtype=bool))


def write_asked(folder: Path, site):
    """Write what is to be foretold after the diagnosis: a further blast, a further receiver."""
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
