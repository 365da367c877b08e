"""Case folders as an engineer has them, and beside each what is to be predicted afterwards."""

from pathlib import Path

import numpy as np
from obspy import UTCDateTime

from pyblast.blasts.hole_tables import read_blast
from pyblast.project.result import write_bytes, write_text
from pyblast.recordings.seismic import mseed_bytes

from .sites import BEFORE, DT, FURTHER, HIDDEN

START = "2024-05-01T{:02d}:00:00"
CODES = ("HHE", "HHN", "HHZ")
NETWORK = "PB"


def write_case(folder: Path, name, site, records, zeros=None, before=BEFORE * DT):
    """Write the known site with the records of its logged blasts at its known receivers.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    name : str
    site : Site
    records : dict of str to (n_receivers, 3, n_samples) float64, m/s
        From ``before`` s before the first hole on.
    zeros : dict of str to str, optional
        Instants at which the tables of holes have time 0; an hour apart if not given.
    before : float, s
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    known = [n for n, r in enumerate(site.receivers) if r.name != HIDDEN]
    receivers = [site.receivers[n] for n in known]
    zeros = zeros or {
        blast: START.format(10 + k)
        for k, blast in enumerate(blast for blast in site.blasts if blast != FURTHER)
    }
    pulse = site.moment_rate
    times = pulse.start + pulse.dt * np.arange(len(pulse.values))
    rows = [f"{t:.9g},{v:.9g}" for t, v in zip(times, pulse.values, strict=True)]
    head = "time_s,moment_rate_per_kg_Nm_per_s"
    write_text(folder / "source.csv", "\n".join([head, *rows]) + "\n")
    for blast, zero in zeros.items():
        lines, holes = ["id,x,y,z,charge_kg,delay_s"], site.blasts[blast]
        for n, (place, charge, time) in enumerate(
            zip(holes.centres, holes.charge, holes.times, strict=True), 1
        ):
            lines.append(f"{n},{_numbers(place)},{charge:.9g},{time:.9g}")
        write_text(folder / f"{blast}_holes.csv", "\n".join(lines) + "\n")
        channels = [[f"{NETWORK}.{r.name}..{code}" for code in CODES] for r in receivers]
        start = UTCDateTime(zero) - before
        motion = mseed_bytes(records[blast][known], channels, DT, str(start))
        write_bytes(folder / f"{blast}.mseed", motion)
    write_text(folder / "site.toml", _table(name, site, receivers, zeros))


def _table(name, site, receivers, zeros):
    """Return the text of site.toml."""
    lines = [f'case = "{name}"', "layers = ["]
    for layer, thickness, rock in site.layers:
        height = "" if thickness is None else f", thickness_m = {thickness:.9g}"
        speeds = f"density = {rock.density:.9g}, vp = {rock.cp:.9g}, vs = {rock.cs:.9g}"
        lines.append(f'    {{ name = "{layer}"{height}, {speeds} }},')
    lines += ["]", "receivers = ["]
    for one in receivers:
        x, y, z = (f"{float(v):.9g}" for v in one.position)
        lines.append(f'    {{ id = "{one.name}", x = {x}, y = {y}, z = {z} }},')
    lines += ["]", "[box]"]
    lines += [
        f"{axis} = [{_numbers(limits, ', ')}]" for axis, limits in zip("xyz", site.box, strict=True)
    ]
    lines += ["[attenuation]", "known = false"]
    for one in site.joints:
        lines += [
            "[[joints]]", f'id = "{one.joint.surface}"', f'axis = "{one.axis}"',
            f"position = {one.position:.9g}", 'law = "linear"',
            f"kn = {one.joint.properties['kn']:.9g}", f"ks = {one.joint.properties['ks']:.9g}",
            f"insitu_normal_stress = {one.joint.insitu_pressure:.9g}", "whole_box = true",
        ]  # fmt: skip
    lines += ["[source]", 'file = "source.csv"', f"charge_exponent = {site.exponent:.9g}"]
    for blast, zero in zeros.items():
        lines += [
            "[[blasts]]", f'id = "{blast}"', f'holes = "{blast}_holes.csv"',
            f'records = "{blast}.mseed"', f'time_zero = "{zero}"',
        ]  # fmt: skip
    lines += [
        "[recording]", f"band_hz = [{_numbers(site.band, ', ')}]",
        f"noise_window_s = [{_numbers(site.noise_window, ', ')}]",
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


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
